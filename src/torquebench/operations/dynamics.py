"""Identify a chain's dynamics from runs, and the factor of its present lubricant."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as data_field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from torquebench.message import Message
from torquebench.operations.operation import Number, Request, field, on_files
from torquebench.operations.place import Place
from torquebench.operations.result import HIDDEN, Result
from torquebench.progress import Progress
from torquebench.reports.page import Block, Facts, Page, Section, Table
from torquebench.units import MS_PER_S

if TYPE_CHECKING:
    from torquebench.campaign.dynamics import IdentifiedDynamics


class DynamicRuns(Request):
    """Identify resonance, damping and lag of a chain, and design the inverse filter.

    The torque at the flange must be known in every row, by a reference that is faster than the
    chain; runs begin at rest and have one constant rate. A run of `turn --profile dynamics` shows
    the vibration of the motor's inertia on the shaft instead, and needs an empty run. Data that
    can't identify a parameter are refused, and the message names the missing data. `apply
    --dynamics` and `fit --dynamics` use the file.
    """

    basic = ("runs", "out", "empty", "model", "window", "bandwidth_hz")

    runs: Annotated[
        tuple[Path, ...],
        field(
            "Tables with time_s, reading_nm and standard_nm: steps, sines; or of "
            "`turn --profile dynamics`.",
            argument=True,
            min_length=1,
        ),
    ]
    out: Annotated[Path, field("The JSON file to write.", title="File", output=(".json",))]
    empty: Annotated[
        Path | None,
        field("Table of an empty run with ramps: inertia, stiffness, damping.", title="Empty run"),
    ] = None
    model: Annotated[
        Path | None,
        field("The chain's model file: compensate readings first.", title="Model file"),
    ] = None
    window: Annotated[
        Number | None,
        field("Window of the counter; that between two rows by default.", unit="ms", ge=0),
    ] = None
    bandwidth_hz: Annotated[
        Number | None, field("Desired bandwidth; 3.3 times the chain's own by default.", ge=0)
    ] = None
    rate: Annotated[
        Number | None,
        field(
            "Rate of the readings to be filtered, if it isn't that of the runs.", unit="1/s", ge=1
        ),
    ] = None
    motor_inertia_kgm2: Annotated[
        Number | None,
        field(
            "Moment of inertia of motor and shaft up to the transducer, by their data sheets.",
            ge=1e-9,
        ),
    ] = None
    motor_inertia_u: Annotated[
        Number,
        field("Expanded uncertainty (k = 2) of that moment of inertia.", unit="%", ge=0, le=100),
    ] = 6.0


class LubricatedRun(Request):
    """Determine the factor of the present lubricant on the bearings' drag.

    The empty run goes over the working speeds in both directions. The new file is the same chain
    with that factor, whose U contains the deviations of single speeds. A run that doesn't determine
    the factor is refused.
    """

    basic = ("run", "model", "out", "lubricant")

    run: Annotated[
        Path,
        field(
            "Table of an empty run with the present lubricant.", title="Empty run", argument=True
        ),
    ]
    model: Annotated[Path, field("The chain, fitted with empty runs.", title="Model file")]
    out: Annotated[Path, field("The chain's new file.", title="File", output=(".json",))]
    lubricant: Annotated[
        str, field("Type, amount and hours of the lubricant, for the record.", max_length=200)
    ] = ""
    column: Annotated[
        tuple[str, ...],
        field(
            "Assigns a header to a quantity, as in reading=Drehmoment[Nm]; a minus sign before "
            "the header reverses the sign. May be repeated.",
        ),
    ] = ()


@dataclass(frozen=True)
class EstimatedValue:
    """A value with U (k = 2)."""

    value: float
    expanded_uncertainty: float
    unit: str

    def __str__(self) -> str:
        return f"{self.value:.4g} ± {self.expanded_uncertainty:.2g} {self.unit}".rstrip()


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
                Message(
                    "bandwidth {bandwidth:.4g} Hz, overshoot of a step {overshoot:.2g} %, rise "
                    "time {rise:.3g} ms",
                    step.bandwidth_hz,
                    100.0 * max(step.overshoot, 0.0),
                    MS_PER_S * step.rise_time_s,
                ),
            )
            for words, step in self.steps
        ]
        blocks: list[Block] = [Table(("", "value", "U (k = 2)", "unit"), rows), Facts(facts)]
        return Page("Identified", "", [Section("", "", blocks)], simulated=self.simulated)


@dataclass(frozen=True, kw_only=True)
class EvaluatedLubrication(Result):
    """Factor on the drag of the bearings by the present lubricant."""

    record: str
    factor: EstimatedValue


def run_dynamics(place: Place, request: DynamicRuns, _progress: Progress) -> EvaluatedDynamics:
    """Identify the dynamics and write the filter."""
    from torquebench.campaign.dynamics import identify_dynamics, save_dynamics
    from torquebench.dynamics import MotorInertia

    inertia = request.motor_inertia_kgm2
    found = identify_dynamics(
        request.runs,
        request.empty,
        model=request.model,
        window_s=None if request.window is None else request.window / MS_PER_S,
        bandwidth_hz=request.bandwidth_hz,
        interval_s=None if request.rate is None else 1.0 / request.rate,
        motor=None if inertia is None else MotorInertia.stated(inertia, request.motor_inertia_u),
    )
    if request.empty is not None and request.model is None:
        place.remarks.append(
            "inertia, stiffness and damping follow from uncompensated readings and contain the "
            "error of the chain's curve at small torques; give --model"
        )
    save_dynamics(request.out, found)
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
        remarks=tuple(place.remarks),
        files=(str(request.out),),
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


def run_lubrication(
    _place: Place, request: LubricatedRun, _progress: Progress
) -> EvaluatedLubrication:
    """Determine the factor and write the chain with it."""
    from torquebench.chain import MeasuringChain, identify_lubrication
    from torquebench.compensation import load_model, save_model
    from torquebench.tables import read_empty_run

    stored = load_model(request.model)
    chain = MeasuringChain.of(stored)
    run = read_empty_run(request.run, request.column, stored)
    found = identify_lubrication(chain.stored, run, request.lubricant)
    renewed = chain.with_effects([found])
    save_model(
        request.out,
        replace(stored, provenance=replace(stored.provenance, effects=renewed.specification())),
    )
    value, u = found.lubrication, 2.0 * found.lubrication_uncertainty
    return EvaluatedLubrication(
        headline=Message(
            "Drag of the bearings: {value:.3g} times that of the chain's empty runs, U = {u:.2g}",
            value,
            u,
        ),
        files=(str(request.out),),
        record=found.record,
        factor=EstimatedValue(value, u, ""),
    )


DYNAMICS = on_files(
    "evaluate dynamics",
    DynamicRuns,
    run_dynamics,
    lambda request: Message("identify the dynamics in {name}", request.runs[0].name),
)
LUBRICATION = on_files(
    "evaluate lubrication",
    LubricatedRun,
    run_lubrication,
    lambda request: Message("evaluate {name}", request.run.name),
)
