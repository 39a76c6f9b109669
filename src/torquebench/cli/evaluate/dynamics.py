"""`torquebench evaluate dynamics`: a chain's resonance, damping and lag, and its inverse filter."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.answers import EVALUATED_DYNAMICS
from torquebench.cli.options import check_output
from torquebench.cli.terminal.console import answer, narrow_table, out, say, say_file, warn
from torquebench.units import MS_PER_S

if TYPE_CHECKING:
    from torquebench.campaign.dynamics import IdentifiedDynamics


def dynamics(
    runs: Annotated[
        list[Path],
        typer.Argument(
            help="Tables with time_s, reading_nm and standard_nm: steps, sines; or of "
            "`turn --profile dynamics`."
        ),
    ],
    result: Annotated[Path, typer.Option("--out", help="The JSON file to write.")],
    empty: Annotated[
        Path | None,
        typer.Option(help="Table of an empty run with ramps: inertia, stiffness, damping."),
    ] = None,
    model: Annotated[
        Path | None, typer.Option(help="The chain's model file: compensate readings first.")
    ] = None,
    window: Annotated[
        float | None,
        typer.Option(min=0, help="Window of the counter, ms; that between two rows by default."),
    ] = None,
    bandwidth: Annotated[
        float | None,
        typer.Option(min=0, help="Desired bandwidth, Hz; 3.3 times the chain's own by default."),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            min=1, help="Rate of the readings to be filtered, 1/s, if it isn't that of the runs."
        ),
    ] = None,
    motor_inertia: Annotated[
        float | None,
        typer.Option(
            min=1e-9,
            help=(
                "Moment of inertia of motor and shaft up to the transducer, kg·m², by their data "
                "sheets."
            ),
        ),
    ] = None,
    motor_inertia_u: Annotated[
        float,
        typer.Option(
            min=0, max=100, help="Expanded uncertainty (k = 2) of that moment of inertia, %."
        ),
    ] = 6.0,
) -> None:
    """Identify resonance, damping and lag of a chain, and design the inverse filter.

    The torque at the flange must be known in every row, by a reference that is faster than the
    chain; runs begin at rest and have one constant rate. A run of `turn --profile dynamics` shows
    the vibration of the motor's inertia on the shaft instead, and needs --empty. Data that can't
    identify a parameter are refused, and the message names the missing data. `apply --dynamics` and
    `fit --dynamics` use the file.
    """
    check_output(result, *runs, *([] if empty is None else [empty]), endings=(".json",))
    from torquebench.campaign.dynamics import identify_dynamics, save_dynamics
    from torquebench.dynamics import MotorInertia

    found = identify_dynamics(
        runs,
        empty,
        model=model,
        window_s=None if window is None else 1e-3 * window,
        bandwidth_hz=bandwidth,
        interval_s=None if rate is None else 1.0 / rate,
        motor=None
        if motor_inertia is None
        else MotorInertia.stated(motor_inertia, motor_inertia_u),
    )
    _print(found)
    if empty is not None and model is None:
        warn(
            "inertia, stiffness and damping follow from uncompensated "
            "readings and contain the error "
            "of the chain's curve at small torques; give --model"
        )
    save_dynamics(result, found)
    say_file("Dynamics", result)


def _estimated(value: float, u: float, unit: str) -> dict[str, float | str]:
    return {"value": value, "expanded_uncertainty": 2.0 * u, "unit": unit}


def _print(found: IdentifiedDynamics) -> None:
    transfer, designed = found.transfer, found.designed
    rows = [
        ("resonance", "resonance_hz", 1.0, "Hz"),
        ("damping ratio", "damping_ratio", 1.0, ""),
        ("lag", "lag_s", 1e6, "µs"),
        ("delay", "delay_s", 1e6, "µs"),
    ]
    simulated = " - simulated" if found.simulated else ""
    table = narrow_table(f"Identified{simulated}", columns=("", ">value", ">U (k = 2)", "unit"))
    parameters: dict[str, dict[str, float | str]] = {}
    for words, name, factor, unit in rows:
        value, u = getattr(transfer, name), transfer.standard_uncertainty(name)
        table.add_row(words, f"{factor * value:.4g}", f"{2.0 * factor * u:.2g}", unit)
        parameters[words] = _estimated(factor * value, factor * u, unit)
    if found.vibration is not None:
        u = found.vibration.covariance[0][0] ** 0.5
        table.add_row("vibration", f"{found.vibration.frequency_hz:.4g}", f"{2.0 * u:.2g}", "Hz")
        parameters["vibration"] = _estimated(found.vibration.frequency_hz, u, "Hz")
    if found.inertia is not None and found.shaft is not None:
        moment, shaft = found.inertia, found.shaft
        for words, value, u, unit in (
            ("inertia", moment.inertia_kgm2, moment.standard_uncertainty_kgm2, "kg·m²"),
            ("stiffness", shaft.stiffness_nm_rad, shaft.stiffness_uncertainty_nm_rad, "N·m/rad"),
            ("damping", shaft.damping_nm_s, shaft.damping_uncertainty_nm_s, "N·m·s/rad"),
        ):
            table.add_row(words, f"{value:.4g}", f"{2.0 * u:.2g}", unit)
            parameters[words] = _estimated(value, u, unit)
    out().print(table)
    answer(**EVALUATED_DYNAMICS.of(found, parameters=parameters))
    for words, step in (("raw", designed.raw), ("with the filter", designed.compensated)):
        say(
            f"{words}: bandwidth {step.bandwidth_hz:.4g} Hz, overshoot of a step "
            f"{100.0 * max(step.overshoot, 0.0):.2g} %, "
            f"rise time {MS_PER_S * step.rise_time_s:.3g} ms"
        )
    say(
        f"the filter needs readings every {MS_PER_S * designed.interval_s:.4g} ms, "
        f"amplifies white noise by a factor of {designed.noise_gain:.3g} and delays the torque by "
        f"{MS_PER_S * designed.delay_s:.3g} ms"
    )
