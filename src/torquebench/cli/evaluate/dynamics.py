"""`torquebench evaluate dynamics`: a chain's resonance, damping and lag, and its inverse filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as data_field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.options import check_output
from torquebench.cli.terminal.console import warn
from torquebench.message import Message
from torquebench.operations.result import HIDDEN, Result
from torquebench.reports.page import Block, Facts, Page, Section, Table
from torquebench.units import MS_PER_S

if TYPE_CHECKING:
    from torquebench.campaign.dynamics import IdentifiedDynamics


@dataclass(frozen=True)
class EstimatedValue:
    """A value with U (k = 2)."""

    value: float
    expanded_uncertainty: float
    unit: str


@dataclass(frozen=True, kw_only=True)
class EvaluatedDynamics(Result):
    """Resonance, damping and lag of a chain, and the filter that inverts them."""

    bandwidth_hz: float
    noise_gain: float
    delay_s: float
    parameters: Mapping[str, EstimatedValue]
    steps: Sequence[Any] = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        rows = [
            (name, f"{each.value:.4g}", f"{each.expanded_uncertainty:.2g}", each.unit)
            for name, each in self.parameters.items()
        ]
        facts = [
            (
                words,
                f"bandwidth {step.bandwidth_hz:.4g} Hz, overshoot of a step "
                f"{100.0 * max(step.overshoot, 0.0):.2g} %, "
                f"rise time {MS_PER_S * step.rise_time_s:.3g} ms",
            )
            for words, step in self.steps
        ]
        blocks: list[Block] = [Table(("", "value", "U (k = 2)", "unit"), rows), Facts(facts)]
        return Page("Identified", "", [Section("", "", blocks)], simulated=self.simulated)


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
) -> EvaluatedDynamics:
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
    if empty is not None and model is None:
        warn(
            "inertia, stiffness and damping follow from uncompensated "
            "readings and contain the error "
            "of the chain's curve at small torques; give --model"
        )
    save_dynamics(result, found)
    designed = found.designed
    return EvaluatedDynamics(
        headline=Message(
            "The filter needs readings every {interval:.4g} ms, amplifies white noise by a factor "
            "of {gain:.3g} and delays the torque by {delay:.3g} ms.",
            MS_PER_S * designed.interval_s,
            designed.noise_gain,
            MS_PER_S * designed.delay_s,
        ),
        simulated=found.simulated,
        files=(str(result),),
        bandwidth_hz=designed.bandwidth_hz,
        noise_gain=designed.noise_gain,
        delay_s=designed.delay_s,
        parameters=_parameters(found),
        steps=[("raw", designed.raw), ("with the filter", designed.compensated)],
    )


def _parameters(found: IdentifiedDynamics) -> dict[str, EstimatedValue]:
    transfer = found.transfer
    rows = [
        ("resonance", "resonance_hz", 1.0, "Hz"),
        ("damping ratio", "damping_ratio", 1.0, ""),
        ("lag", "lag_s", 1e6, "µs"),
        ("delay", "delay_s", 1e6, "µs"),
    ]
    parameters = {}
    for words, name, factor, unit in rows:
        value, u = getattr(transfer, name), transfer.standard_uncertainty(name)
        parameters[words] = EstimatedValue(factor * value, 2.0 * factor * u, unit)
    if found.vibration is not None:
        u = found.vibration.covariance[0][0] ** 0.5
        parameters["vibration"] = EstimatedValue(found.vibration.frequency_hz, 2.0 * u, "Hz")
    if found.inertia is not None and found.shaft is not None:
        moment, shaft = found.inertia, found.shaft
        for words, value, u, unit in (
            ("inertia", moment.inertia_kgm2, moment.standard_uncertainty_kgm2, "kg·m²"),
            ("stiffness", shaft.stiffness_nm_rad, shaft.stiffness_uncertainty_nm_rad, "N·m/rad"),
            ("damping", shaft.damping_nm_s, shaft.damping_uncertainty_nm_s, "N·m·s/rad"),
        ):
            parameters[words] = EstimatedValue(value, 2.0 * u, unit)
    return parameters
