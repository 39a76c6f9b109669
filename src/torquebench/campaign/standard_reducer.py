"""End-to-end check of the bench with a standard reducer of certified friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Unpack

from torquebench.bench.description import BenchDescription
from torquebench.campaign.measuring import Measured, RunKind, RunOptions, run_only
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.procedures import FrictionSettings, FrictionSweep, friction_sweep
from torquebench.progress import Progress
from torquebench.records import Registry
from torquebench.reducers import (
    CertifiedFriction,
    FrictionCheck,
    ReducerDescription,
    check_friction,
)
from torquebench.station import Station

STANDARD_REDUCER = "standard_reducer"
"""Key of a run's metadata with the certificate and the tolerance of a standard reducer."""


@dataclass(frozen=True)
class StandardReducer:
    """The mounted standard reducer, and its certificate.

    Attributes
    ----------
    max_speed_rpm : float
        Largest input speed in its data sheet, 1/min.
    """

    name: str
    certificate: str
    friction: tuple[CertifiedFriction, ...]
    max_speed_rpm: float = FrictionSettings().speeds_rpm[-1]

    def settings(self, repeats: int = 3, *, both_directions: bool = False) -> FrictionSettings:
        """Return a sweep over the speeds of the certificate that the data sheet allows."""
        return within_certificate(
            FrictionSettings(repeats=repeats, counter_clockwise=both_directions),
            self.friction,
            self.max_speed_rpm,
        )


@dataclass(frozen=True)
class MeasuredFriction:
    """A measured sweep; its comparison with the certificate, None for a reducer without one."""

    sweep: FrictionSweep
    check: FrictionCheck | None
    run_id: str


def certified_reducer(
    kind: ReducerDescription | None,
    description: BenchDescription,
    brought_along: tuple[CertifiedFriction, ...] = (),
) -> StandardReducer:
    """Return the standard reducer by its description, or that of the simulated bench.

    Raises
    ------
    InputError
        No standard reducer is described, it has no certified friction, or its ratio isn't that of
        the bench.
    """
    if kind is None:
        if not description.simulated:
            raise InputError(
                Message("no standard reducer for {name}", description.name),
                "a description with certified friction",
                "name the mounted reducer",
            )
        return StandardReducer(
            "standard reducer of the simulated bench", "of the simulated reducer", brought_along
        )
    if not kind.certified_friction:
        raise InputError(
            Message("{name}: no certified_friction", kind.name),
            "[[certified_friction]] with speed_rpm, torque_nm, expanded_uncertainty_nm",
            "enter its certificate in the reducer's description",
        )
    expected = description.bench.reducer_ratio
    if abs(kind.ratio / expected - 1.0) > 1e-6:
        raise InputError(
            Message("{name}: a ratio of {ratio:g}", kind.name, kind.ratio),
            Message(
                "{expected:g}, the ratio of what is mounted on {name}", expected, description.name
            ),
            "correct the reducer's description, or reducer_ratio of the bench",
        )
    return StandardReducer(
        kind.name, kind.certificate, kind.certified_friction, kind.max_input_speed_rpm
    )


def within_certificate(
    settings: FrictionSettings,
    certified: tuple[CertifiedFriction, ...],
    max_speed_rpm: float = float("inf"),
) -> FrictionSettings:
    """Return a sweep over the speeds that the certificate covers.

    Raises
    ------
    InputError
        The certificate covers none of the speeds.
    """
    speeds = [point.speed_rpm for point in certified]
    high = min(speeds[-1], max_speed_rpm) if speeds else 0.0
    wanted = tuple(
        speed_rpm for speed_rpm in settings.speeds_rpm if speeds and speeds[0] <= speed_rpm <= high
    )
    wanted = wanted or tuple(speed for speed in speeds if speed <= high)
    if not wanted:
        raise InputError(
            Message(
                "a sweep over {speeds_rpm:g} to {settings_speeds_rpm:g} rpm",
                settings.speeds_rpm[0],
                settings.speeds_rpm[-1],
            ),
            Message(
                "speeds within the certificate's {lowest:g} to {highest:g} rpm",
                speeds[0],
                speeds[-1],
            )
            if speeds
            else "a certificate of friction",
        )
    return FrictionSettings(
        wanted, settings.repeats, settings.clockwise, settings.counter_clockwise
    )


def check_standard_reducer(
    station: Station,
    reducer: StandardReducer,
    settings: FrictionSettings,
    *,
    tolerance_percent: float = 0.1,
    **options: Unpack[RunOptions],
) -> MeasuredFriction:
    """Sweep the mounted standard reducer and compare the readings with its certificate.

    Parameters
    ----------
    settings : FrictionSettings
        Of `StandardReducer.settings`.
    tolerance_percent : float
        Largest error and difference between repeats, % FS of the input module.
    **options
        See `RunOptions`.

    Raises
    ------
    InputError
        There is no certificate.
    LimitError, InterlockError, SignalFault, BenchError, RunAbortedError
        As every procedure.
    """
    metadata = {
        STANDARD_REDUCER: {
            "name": reducer.name,
            "certificate": reducer.certificate,
            "tolerance_percent": tolerance_percent,
            "certified_friction": [point.model_dump() for point in reducer.friction],
        }
    }
    options["metadata"] = {**metadata, **options.get("metadata", {})}
    measured = FRICTION.measure(station, "input", settings, **options)
    return FRICTION.evaluate_and_register(station.registry, measured)


def _evaluate(
    _registry: Registry, measured: Measured[FrictionSweep], _progress: Progress
) -> MeasuredFriction:
    """Compare a sweep with the certificate and by the tolerance in its run's record."""
    sweep, record, check = measured.result, measured.record, None
    standard = record.metadata.get(STANDARD_REDUCER)
    if standard is not None:
        check = check_friction(
            sweep.nominal_rpm,
            sweep.torque_nm,
            sweep.repeat,
            [CertifiedFriction.model_validate(point) for point in standard["certified_friction"]],
            BenchDescription.model_validate(record.metadata["bench"]).input.range_nm,
            standard["tolerance_percent"],
        )
    return MeasuredFriction(sweep, check, record.run_id)


def _describe(friction: MeasuredFriction) -> Message:
    """Return errors and tolerance in a sentence."""
    check = friction.check
    if check is None:
        return Message("run {run_id} is a friction sweep without a certificate", friction.run_id)
    return Message(
        "Standard reducer: error {error:.3g} % FS, repeatability {spread:.3g} % FS, tolerance "
        "{limit:g} % FS.",
        check.error_percent,
        check.repeatability_percent,
        check.tolerance_percent,
    )


FRICTION = RunKind(
    "no-load-friction",
    lambda _side: Message("No-load friction of the reducer"),
    lambda devices, _side, settings: friction_sweep(devices, settings),
    _evaluate,
    run_only,
    _describe,
)
"""Sweep of a mounted reducer's input speed with the output free."""
