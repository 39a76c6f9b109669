"""Two calibrations of one transducer compared: changes, and whether they are significant.

The models of both are compared at the same readings over the range that both calibrations cover. A
change is significant where it exceeds the combined uncertainty, E_n = Δ/√(U_A² + U_B²) beyond ±1
(ISO/IEC 17043, B.3). Errors that both calibrations share, such as those of one reference standard,
cancel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.chain import (
    Component,
    MeasuredTemperature,
    MeasuringChain,
    Readings,
    Reference,
    Shared,
    Temperature,
    Torque,
    load_chain,
)
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records import CalibrationEntry, ModelEntry, Registry

FloatArray = NDArray[np.float64]

STEPS = 10
"""Number of equal steps in each direction of the common range."""
SAME_RANGE = 0.05
"""Calibrations whose largest torques differ by less than this share have the same range."""


@dataclass(frozen=True)
class ComparedCalibration:
    """One of the compared calibrations.

    Parameters
    ----------
    model : ModelEntry
        The calibration's model in use, or its latest one.
    """

    entry: CalibrationEntry
    model: ModelEntry

    @property
    def name(self) -> str:
        """Name of the calibration in records."""
        return f"calibration-{self.entry.calibration_id}"


@dataclass(frozen=True)
class CalibrationStep:
    """Comparison of both calibrations at one reading.

    Parameters
    ----------
    branch : int
        +1 rising, -1 falling, 0 if neither model has branches.
    before_nm, after_nm : float
        Additional torque by each, N·m.
    change_nm, expanded_uncertainty_nm : float
        After less before, and its U (k = 2).
    normalised_error : float
        E_n: the change in expanded uncertainties.
    """

    reading_nm: float
    branch: int
    before_nm: float
    after_nm: float
    change_nm: float
    expanded_uncertainty_nm: float
    normalised_error: float

    @property
    def significant(self) -> bool:
        """Whether the change exceeds its uncertainty."""
        return abs(self.normalised_error) > 1.0


@dataclass(frozen=True)
class CalibrationComparison:
    """Two calibrations of one transducer.

    Parameters
    ----------
    before, after : ComparedCalibration
        The earlier and the later calibration.
    low_nm, high_nm : float
        Range of torques that both cover.
    remarks : tuple of str
        Differences other than torque: ranges, standards, counters, adjustments.
    """

    before: ComparedCalibration
    after: ComparedCalibration
    low_nm: float
    high_nm: float
    steps: tuple[CalibrationStep, ...]
    remarks: tuple[str, ...]

    @property
    def range_nm(self) -> float:
        """Full scale that % FS refers to."""
        return self.after.entry.range_nm

    @property
    def simulated(self) -> bool:
        """Whether one of the calibrations is simulated."""
        return self.before.entry.simulated or self.after.entry.simulated

    @property
    def worst(self) -> CalibrationStep:
        """The step with the largest E_n."""
        return max(self.steps, key=lambda each: abs(each.normalised_error))

    @property
    def significant(self) -> tuple[CalibrationStep, ...]:
        """Steps at which the change exceeds its uncertainty."""
        return tuple(step for step in self.steps if step.significant)

    def verdict(self) -> str:
        """Return one sentence that states whether the chain has changed."""
        count, worst = len(self.significant), self.worst
        if not count:
            return Message(
                "no change beyond the uncertainties: |E_n| up to {normalised_error:.2f}",
                abs(worst.normalised_error),
            )
        return Message(
            "changed at {count} of {steps_count} steps, by {change_nm:+.3g} N·m at "
            "{reading_nm:g} N·m (E_n = {normalised_error:+.2f})",
            count,
            len(self.steps),
            worst.change_nm,
            worst.reading_nm,
            worst.normalised_error,
        )


def model_of_calibration(registry: Registry, calibration: CalibrationEntry) -> ModelEntry | None:
    """Return the model of a calibration that is in use, or the latest one; None without one."""
    fitted = registry.models(calibration_id=calibration.calibration_id)
    used = [
        activation.model_id for activation in registry.activations(calibration.transducer_serial)
    ]
    for model_id in reversed(used):
        for entry in fitted:
            if entry.model_id == model_id:
                return entry
    return fitted[0] if fitted else None


def compare_calibrations(registry: Registry, first: int, second: int) -> CalibrationComparison:
    """Compare two calibrations of one transducer, the earlier one first.

    Parameters
    ----------
    first, second : int
        Their numbers.

    Raises
    ------
    InputError
        The calibrations are the same one, belong to different transducers, lack a model, or share
        no range.
    RecordError
        There is no such calibration, or a model file was changed.
    """
    if first == second:
        raise InputError(Message("calibration-{first} twice", first), "two calibrations")
    entries = sorted(
        (registry.calibration(number) for number in (first, second)),
        key=lambda entry: (entry.performed, entry.calibration_id),
    )
    serials = {entry.transducer_serial for entry in entries}
    if len(serials) > 1:
        raise InputError(
            Message("calibrations of the transducers {serials}", " and ".join(sorted(serials))),
            "two calibrations of one transducer",
            "torquebench records list calibrations",
        )
    before, after = (_compared(registry, entry) for entry in entries)
    low, high = _common(before.entry, after.entry)
    chains = [load_chain(compared.model.check_file()) for compared in (before, after)]
    low = max(low, *(float(chain.curve.low_nm) for chain in chains))
    high = min(high, *(float(chain.curve.high_nm) for chain in chains))
    return CalibrationComparison(
        before=before,
        after=after,
        low_nm=low,
        high_nm=high,
        steps=_steps(chains, low, high, same_standard=_same_standard(before, after)),
        remarks=_remarks(registry, before.entry, after.entry),
    )


def _compared(registry: Registry, entry: CalibrationEntry) -> ComparedCalibration:
    """Return a calibration with its model; refuse one without a model."""
    model = model_of_calibration(registry, entry)
    if model is None:
        raise InputError(
            Message("calibration-{calibration_id} has no model", entry.calibration_id),
            "calibrations with a fitted model",
            "torquebench records finish, or torquebench fit on its table",
        )
    return ComparedCalibration(entry, model)


def _common(before: CalibrationEntry, after: CalibrationEntry) -> tuple[float, float]:
    """Return the range that two calibrations have in common, N·m."""
    low = max(before.valid_nm[0], after.valid_nm[0])
    high = min(before.valid_nm[1], after.valid_nm[1])
    if not low < high:
        raise InputError(
            Message(
                "calibrations of {before_low_nm:g} to {before_high_nm:g} N·m and "
                "{after_low_nm:g} to {after_high_nm:g} N·m",
                before.valid_nm[0],
                before.valid_nm[1],
                after.valid_nm[0],
                after.valid_nm[1],
            ),
            "a common range",
            "compare calibrations in the same direction",
        )
    return low, high


def _same_standard(before: ComparedCalibration, after: ComparedCalibration) -> bool:
    serial = before.entry.standard_serial
    return bool(serial) and serial == after.entry.standard_serial


def _steps(
    chains: list[MeasuringChain], low: float, high: float, *, same_standard: bool
) -> tuple[CalibrationStep, ...]:
    """Compare two calibrations' torques, with U of the change, at equal readings."""
    shares = np.arange(1, STEPS + 1) / STEPS
    sides = [shares * end for end in (min(low, 0.0), max(high, 0.0)) if end]
    reading = np.concatenate(sides)
    reading = np.sort(reading[(reading >= low) & (reading <= high)])
    branches = (1, -1) if any(chain.curve.branch_aware for chain in chains) else (0,)
    steps = []
    for branch in branches:
        readings = _readings(reading, branch, chains)
        before, after = (chain.torque(readings) for chain in chains)
        shared = _of_standard(chains, before) if same_standard else frozenset[str]()
        added = [torque.value_nm - reading for torque in (before, after)]
        for row in range(reading.size):
            pair = _side_by_side(before.at([row]), after.at([row]), shared)
            change = pair.combined([-1.0, 1.0], loading=[0, 0])
            before_nm, after_nm = (float(each[row]) for each in added)
            change_nm, u_nm = after_nm - before_nm, float(change.expanded_uncertainty_nm[0])
            if u_nm:
                error = change_nm / u_nm
            else:
                error = float(np.sign(change_nm) * np.inf) if change_nm else 0.0
            steps.append(
                CalibrationStep(
                    float(reading[row]), branch, before_nm, after_nm, change_nm, u_nm, error
                )
            )
    return tuple(steps)


def _readings(reading: FloatArray, branch: int, chains: list[MeasuringChain]) -> Readings:
    """Return ideal readings: long means right after zeroing and calibration, at its temperature.

    Their uncertainty contains the errors of the calibrations only.
    """
    calibrated_c = [
        effect.calibrated_c
        for chain in chains
        for effect in chain.stored
        if isinstance(effect, Temperature | MeasuredTemperature)
    ]
    celsius = float(np.mean(calibrated_c)) if calibrated_c else None
    return Readings(
        reading,
        branch=np.full(reading.size, float(branch)),
        counter_nm=0.0,
        speed_rpm=0.0,
        acceleration_rad_s2=0.0,
        window_s=np.inf,
        temperature_c=celsius,
        zero_age_h=0.0,
        zero_temperature_c=celsius,
        zero_nm=0.0,
        calibration_age_h=0.0,
        loadings=np.inf,
    )


def _of_standard(chains: list[MeasuringChain], torque: Torque) -> frozenset[str]:
    """Return the names of components that come from the reference standard."""
    nothing = Readings(torque.value_nm)
    return frozenset(
        component.name
        for chain in chains
        for effect in chain.stored
        if isinstance(effect, Reference)
        for component in effect.components(nothing, torque.value_nm)
    )


def _side_by_side(before: Torque, after: Torque, of_standard: frozenset[str]) -> Torque:
    """Return readings by both calibrations as one torque, with common and separate components.

    The errors of the two calibrations and of the two mountings are separate. Those of the common
    standard and those of the reading itself are shared.
    """
    components: list[Component] = []
    nothing = np.zeros(1)
    first, second = _by_name(before), _by_name(after)
    for key in dict.fromkeys((*first, *second)):
        pair = [named.get(key) for named in (first, second)]
        sizes = [
            nothing if component is None else nothing + component.uncertainty_nm
            for component in pair
        ]
        shared = next(component.shared for component in pair if component is not None)
        rows = [(sizes[0], sizes[1])]
        if shared in (Shared.CALIBRATION, Shared.MOUNTING) and key[0] not in of_standard:
            rows = [(sizes[0], nothing), (nothing, sizes[1])]
        components += [Component(key[0], shared, np.concatenate(row)) for row in rows]
    return Torque(np.concatenate([before.value_nm, after.value_nm]), tuple(components))


def _by_name(torque: Torque) -> dict[tuple[str, int], Component]:
    """Return components keyed by their name and their number among components of that name."""
    names = [component.name for component in torque.components]
    return {
        (each.name, names[:number].count(each.name)): each
        for number, each in enumerate(torque.components)
    }


def _remarks(
    registry: Registry, before: CalibrationEntry, after: CalibrationEntry
) -> tuple[str, ...]:
    """Name the circumstances in which two calibrations differ."""
    remarks: list[str] = []
    for number, direction in ((1, "clockwise"), (0, "counter-clockwise")):
        reached = [abs(entry.valid_nm[number]) for entry in (before, after)]
        if abs(reached[1] - reached[0]) > SAME_RANGE * max(reached):
            remarks.append(
                Message(
                    "{direction} the calibrations reach {before_nm:g} and {after_nm:g} N·m: "
                    "only the common range is compared",
                    direction,
                    reached[0],
                    reached[1],
                )
            )
    for what, one, other in (
        ("reference standard", before.standard_serial, after.standard_serial),
        ("counter", before.counter_identity, after.counter_identity),
        ("profile", before.profile_name, after.profile_name),
    ):
        if one != other:
            remarks.append(
                Message(
                    "another {what}: {one}, then {other}",
                    what,
                    one or "unknown",
                    other or "unknown",
                )
            )
    remarks += [
        Message(
            "the transducer was adjusted between them, {performed:%Y-%m-%d}", adjustment.performed
        )
        for adjustment in registry.adjustments(before.transducer_serial)
        if before.performed < adjustment.performed <= after.performed
    ]
    return tuple(remarks)
