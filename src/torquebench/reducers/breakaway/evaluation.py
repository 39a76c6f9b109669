"""Starting and back-driving torque: the quasi-static torque at which a reducer begins to turn."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.breakaway.change_point import first_motion
from torquebench.reducers.preparation import finite_columns, labels
from torquebench.reducers.quantities import (
    Contribution,
    Finding,
    LimitedQuantity,
    ResultQuantity,
    budget,
    common_of_both,
    refuse,
)
from torquebench.reducers.torque_uncertainty import TorqueUncertainty
from torquebench.uncertainty import Budget, Shared

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

__all__ = ["BreakawayResult", "BreakawayRun", "evaluate_breakaway"]

BreakawayKind = Literal["starting", "back-driving"]
MEDIAN_EFFICIENCY = np.sqrt(np.pi / 2.0)
"""Standard error of a median of normal values, in standard errors of their mean."""
LEAST_MOVING = 8
"""Number of samples between start and threshold from which on their torque is checked."""
SATURATED_SHARE = 0.2
"""A drive is saturated where the torque is constant over more than this share of a ramp."""


@dataclass(frozen=True)
class BreakawayRun:
    """One ramp of torque up to the first motion.

    Parameters
    ----------
    label : float
        Number of the run.
    position : float
        Label of the position; NaN where there is none.
    torque_nm : float
        Torque at the first motion, with its sign.
    standard_uncertainty_nm : float
        Standard uncertainty due to the time of the first motion: noise of the torque, and its rate
        times the uncertainty of that time.
    time_s : float
        Moment of the first motion.
    angle_noise_rad : float
        Standard deviation of the angle before it.
    """

    label: float
    position: float
    torque_nm: float
    standard_uncertainty_nm: float
    time_s: float
    angle_noise_rad: float


@dataclass(frozen=True, eq=False)
class BreakawayResult:
    """Starting or back-driving torque from several ramps.

    Parameters
    ----------
    kind : {"starting", "back-driving"}
    torque : Budget
        Median of the magnitudes, N·m at the driven side; where both directions were driven the
        mean of both medians, in which an error of the zero cancels.
    clockwise, counter_clockwise : Budget or None
        Median of each direction.
    largest_nm, smallest_nm : float
        Over all runs: the spread.
    runs : tuple of BreakawayRun
    findings : tuple of Finding
    """

    kind: BreakawayKind
    torque: Budget
    clockwise: Budget | None
    counter_clockwise: Budget | None
    largest_nm: float
    smallest_nm: float
    runs: tuple[BreakawayRun, ...]
    findings: tuple[Finding, ...]

    def quantities(self) -> tuple[ResultQuantity, ...]:
        """Return the values under their names, for tables and reports."""
        key = self.kind.replace("-", "_")
        rule = Message(
            "median of {count} ramps, {smallest_nm:.4g} to {largest_nm:.4g}",
            len(self.runs),
            self.smallest_nm,
            self.largest_nm,
        )
        rows = [
            ResultQuantity(
                f"{key}_torque",
                Message("{kind} torque", self.kind),
                self.torque,
                Message("{rule} N·m", rule),
            )
        ]
        for name, found in (
            ("clockwise", self.clockwise),
            ("counter-clockwise", self.counter_clockwise),
        ):
            if found is not None:
                rows.append(
                    ResultQuantity(
                        f"{key}_torque_{name.replace('-', '_')}",
                        Message("{kind} torque, {name}", self.kind, name),
                        found,
                    )
                )
        return tuple(rows)

    def limited(self, limits: DataSheetLimits) -> Iterator[LimitedQuantity]:
        """Return the values that the data sheet limits; those without a limit may be missing."""
        starting = self.kind == "starting"
        limit = limits.starting_torque_nm if starting else limits.back_driving_torque_nm
        only = self.quantities()[0]
        yield LimitedQuantity(only.key, only.title, only.estimate, upper=limit)


def evaluate_breakaway(
    time_s: ArrayLike,
    angle_rad: ArrayLike,
    torque_nm: ArrayLike,
    *,
    kind: BreakawayKind = "starting",
    run: ArrayLike | None = None,
    position: ArrayLike | None = None,
    uncertainty: TorqueUncertainty | None = None,
    resolution_rad: float = 0.0,
    presliding_rad: float = 0.0,
    largest_share: float | None = None,
) -> BreakawayResult:
    """Find the torque at the first motion in ramps of torque.

    Parameters
    ----------
    time_s, angle_rad, torque_nm : array of float, shape (n,)
        Samples of the driven side, all runs one after another.
    kind : {"starting", "back-driving"}
        Driven from the input, or from the output.
    run, position : array, shape (n,), optional
        Labels of each ramp and its position; without `run` everything is one ramp.
    uncertainty : TorqueUncertainty, optional
    resolution_rad : float
        Resolution of the angle: smaller changes don't count as motion.
    presliding_rad : float
        Elastic motion before the break-away that doesn't count as motion.
    largest_share : float, optional
        Refuse the result where its U exceeds this share of it.

    Raises
    ------
    InputError
        Where a run never moves, moves from its first sample, or holds too few samples; where the
        uncertainty exceeds `largest_share`.
    """
    time, angle, torque = finite_columns(8, time_s=time_s, angle_rad=angle_rad, torque_nm=torque_nm)
    ramp = labels(run, time.size, 1.0, "run")
    place = labels(position, time.size, 0.0, "position")
    known = uncertainty or TorqueUncertainty()
    runs: list[BreakawayRun] = []
    saturated: list[float] = []
    for label in np.unique(ramp):
        rows = np.flatnonzero(ramp == label)
        rows = rows[np.argsort(time[rows], kind="stable")]
        where = float("nan") if position is None else float(place[rows[0]])
        found, stood = _run_of(
            time[rows],
            angle[rows],
            torque[rows],
            float(label),
            where,
            max(resolution_rad, presliding_rad),
        )
        runs.append(found)
        if stood:
            saturated.append(float(label))
    return _result(kind, tuple(runs), known, saturated, largest_share)


def _run_of(
    time: NDArray[np.float64],
    angle: NDArray[np.float64],
    torque: NDArray[np.float64],
    label: float,
    position: float,
    threshold_rad: float,
) -> tuple[BreakawayRun, bool]:
    try:
        motion = first_motion(time, angle, threshold_rad=threshold_rad)
    except InputError as problem:
        found = Message("run {label:g}: {found}", label, problem.found)
        raise InputError(found, problem.allowed, problem.remedy) from problem
    before = slice(max(0, motion.index - max(8, motion.index // 4)), motion.index + 1)
    level, error, rate = _line_at(time[before] - motion.time_s, torque[before])
    # After the start the inertia before the transducer takes up the drive's increase: the torque
    # hardly rises, so an error of the start's time changes it little.
    after = slice(motion.index, motion.crossing + 1)
    if motion.crossing - motion.index >= LEAST_MOVING:
        level, error, _ = _line_at(time[after] - motion.time_s, torque[after])
    spread = float(np.hypot(error, rate * motion.standard_uncertainty_s))
    ramp_range = abs(float(level) - float(torque[0]))
    tail = torque[: motion.index + 1]
    still = np.mean(np.abs(tail - tail[-1]) < 0.02 * ramp_range) if ramp_range > 0 else 0.0
    run = BreakawayRun(label, position, float(level), spread, motion.time_s, motion.noise_rad)
    return run, bool(still > SATURATED_SHARE)


def _line_at(span: NDArray[np.float64], torque: NDArray[np.float64]) -> tuple[float, float, float]:
    """Return a line's value at 0, its standard error, and its slope."""
    if span.size < 3 or np.ptp(span) == 0.0:
        return float(torque.mean()), 0.0, 0.0
    rate, level = np.polyfit(span, torque, 1)
    rest = float(np.std(torque - rate * span - level, ddof=2))
    basis = np.column_stack([span, np.ones_like(span)])
    error = rest * float(np.sqrt(np.linalg.inv(basis.T @ basis)[1, 1]))
    return float(level), error, float(rate)


def _result(
    kind: BreakawayKind,
    runs: tuple[BreakawayRun, ...],
    known: TorqueUncertainty,
    saturated: list[float],
    largest_share: float | None,
) -> BreakawayResult:
    torques = np.array([each.torque_nm for each in runs])
    sides: dict[int, Budget | None] = {}
    for sign in (1, -1):
        mine = [each for each in runs if np.sign(each.torque_nm) == sign]
        sides[sign] = _median(mine, known) if mine else None
    first, second = sides[1], sides[-1]
    if first is not None and second is not None:
        total = _mean_of_both(first, second)
    else:
        total = first or second or _median(list(runs), known)
    findings = []
    if len(runs) < 3:
        findings.append(
            Finding(
                "few ramps",
                Message("{count} ramps say little about the spread over positions", len(runs)),
                "measure at several positions, five or more by preference",
            )
        )
    if saturated:
        findings.append(
            Finding(
                "drive saturation",
                Message(
                    "the torque stood still before the first motion in the ramps {ramps}",
                    ", ".join(f"{label:g}" for label in saturated),
                ),
                "check the drive's torque limit: the reducer may have crept at it",
                severe=True,
            )
        )
    if largest_share is not None:
        refuse(total, largest_share, Message("{kind} torque", kind))
    return BreakawayResult(
        kind=kind,
        torque=total,
        clockwise=first,
        counter_clockwise=second,
        largest_nm=float(np.abs(torques).max()),
        smallest_nm=float(np.abs(torques).min()),
        runs=runs,
        findings=tuple(findings),
    )


def _median(runs: list[BreakawayRun], known: TorqueUncertainty) -> Budget:
    values = np.abs([each.torque_nm for each in runs])
    middle = float(np.median(values))
    own = float(np.sqrt(np.mean([each.standard_uncertainty_nm**2 for each in runs])))
    sign = float(np.sign(runs[0].torque_nm)) or 1.0
    parts = [
        Contribution("torque zero", known.zero_nm, inf, sign, Shared.ZEROING),
        Contribution("torque scale", known.relative * middle, shared=Shared.CALIBRATION),
        Contribution("compensation model", known.model_nm, shared=Shared.CALIBRATION),
        Contribution("mounting and drag", known.mounting_nm, shared=Shared.MOUNTING),
        Contribution("loading effects", known.loading_nm, shared=Shared.LOADING),
    ]
    if values.size > 1:
        efficiency = MEDIAN_EFFICIENCY if values.size > 2 else 1.0
        error = efficiency * float(np.std(values, ddof=1)) / values.size**0.5
        parts.append(Contribution("spread over runs", error, values.size - 1))
    else:
        parts.append(Contribution("chain repeatability", known.repeatability_nm))
    # One rule detects the motion in all runs: its error doesn't average out.
    parts.append(Contribution("first motion", own, shared=Shared.LOADING))
    return budget(middle, "N·m", parts)


def _mean_of_both(first: Budget, second: Budget) -> Budget:
    """Mean of both directions: zero cancels, scale and timing errors remain, the rest averages."""
    parts = common_of_both(first, second)
    for name, side in (("clockwise", first), ("counter-clockwise", second)):
        parts += [
            Contribution(f"{line.name}, {name}", 0.5 * line.contribution, line.degrees_of_freedom)
            for line in side.lines
            if not line.common
        ]
    return budget(0.5 * (first.value + second.value), "N·m", parts)
