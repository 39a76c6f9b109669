"""Starting and back-driving torque: the quasi-static torque at which a reducer begins to turn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import (
    Samples,
    finite_columns,
    levels_of,
    outliers,
    step_of,
)
from torquebench.reducers.quantities import (
    Finding,
    LimitedQuantity,
    ResultQuantity,
    budget,
    common_of_both,
    refuse,
)
from torquebench.reducers.torque_uncertainty import TorqueUncertainty
from torquebench.uncertainty import Budget, BudgetLine, Shared

if TYPE_CHECKING:
    from torquebench.reducers.description import DataSheetLimits

Floats = NDArray[np.float64]
BreakawayKind = Literal["starting", "back-driving"]

# -- first motion -----------------------------------------------------------------------------

QUIET_SAMPLES = 6
"""Fewest samples at rest before the first motion."""
CREEP_WINDOWS = 40
"""Parts of a ramp in which its speed is checked."""
ACCELERATION_OF_CREEP = 1.5
"""Largest growth of the acceleration from one fifth of a ramp to the next in creep; a turning
inertia doubles it."""
SIGNIFICANT = 5.0
"""Deviation that is treated as motion, in standard deviations of the noise."""
POWERS = (2.0, 3.0)
"""Powers of time by which a motion may begin: at constant torque, and under a rising one."""


@dataclass(frozen=True)
class FirstMotion:
    """Position at which an angle begins to move.

    Parameters
    ----------
    index : int
        Last sample at rest.
    time_s, standard_uncertainty_s : float
        Moment of the change.
    direction : int
        +1 or -1.
    crossing : int
        First sample beyond the threshold.
    """

    index: int
    time_s: float
    standard_uncertainty_s: float
    direction: int
    crossing: int


def first_motion(
    time_s: ArrayLike, angle_rad: ArrayLike, *, threshold_rad: float = 0.0
) -> FirstMotion:
    """Find the change point at which an angle departs from its line at rest.

    At rest the angle follows a slow line (elastic wind-up, drift) with noise; with a threshold, a
    parabola: contacts creep faster as a uniform ramp proceeds. The angle moves where it departs
    from that curve permanently, by more than five standard deviations of the noise and more than
    the threshold. The start of the motion comes from fits of the square and the cube of time,
    weighted by how well each fits; with a threshold, from the cube alone, by which a uniformly
    rising torque turns an inertia.

    Parameters
    ----------
    time_s, angle_rad : array of float, shape (n,)
        Samples of one ramp, times not falling.
    threshold_rad : float
        Changes up to this don't count as motion (resolution, presliding).

    Raises
    ------
    InputError
        Where it never moves, or moves from the beginning.

    Examples
    --------
    >>> time = np.linspace(0.0, 1.0, 101)
    >>> noise = 1e-6 * np.cos(40.0 * np.arange(101) ** 2)
    >>> found = first_motion(time, noise + np.maximum(0.0, time - 0.6) ** 2)
    >>> round(found.time_s, 2)
    0.6
    """
    time, angle = finite_columns(8, time_s=time_s, angle_rad=angle_rad)
    if np.any(np.diff(time) < 0.0):
        raise InputError("times that go back", "times that rise within a run", "sort the run")
    if threshold_rad > 0.0:
        farthest = int(np.argmax(np.abs(angle - angle[0])))
        if farthest > time.size // 2:  # the angle may swing back after the motion
            time, angle = time[: farthest + 1], angle[: farthest + 1]
    crossing, line, noise, level = _crossing(time, angle, threshold_rad)
    if threshold_rad > 0.0 and time.size >= 4 * CREEP_WINDOWS:
        creeping = _creeping(time, angle, threshold_rad, moves=crossing < time.size)
        # A straight line through strong creep detects the motion too late, or too early.
        if creeping is not None and (crossing == time.size or creeping[0] > crossing):
            crossing, line, noise = creeping
    if crossing >= time.size:
        rest = np.max(np.abs(angle - np.polyval(line, time)))
        raise InputError(
            Message("an angle that stays within {rest:.3g} rad of its line at rest", rest),
            Message("motion by more than {level:.3g} rad", level),
            "raise the torque further, or check that the encoder turns with the shaft",
        )
    if crossing < QUIET_SAMPLES:
        raise InputError(
            Message("motion from sample {crossing} on", crossing + 1),
            Message(
                "at least {quiet_samples} samples at rest before the first motion", QUIET_SAMPLES
            ),
            "begin each ramp at rest and zero torque; check that angle and torque aren't swapped",
        )
    deviation = angle - np.polyval(line, time)
    farthest = crossing + int(np.argmax(np.abs(deviation[crossing:])))
    direction = 1 if deviation[farthest] > 0 else -1
    if threshold_rad > SIGNIFICANT * noise:
        moment, spread = _cube_start(time, direction * deviation, crossing, threshold_rad)
    else:
        sigma = float(np.hypot(noise, 0.3 * step_of(angle)))
        moment, spread = _power_start(time, direction * angle, crossing, level, sigma)
    index = int(np.clip(np.searchsorted(time, moment, side="right") - 1, 0, crossing - 1))
    return FirstMotion(index, moment, spread, direction, crossing)


def _crossing(time: Floats, angle: Floats, threshold: float) -> tuple[int, Floats, float, float]:
    """Return the first sample permanently off the line at rest, the line, the noise and the limit.

    Without motion, the index is one past the last sample. The part at rest grows from the start as
    long as the next samples follow its line.
    """
    quiet = max(QUIET_SAMPLES, angle.size // 20)
    floor = 0.3 * step_of(angle)
    while True:
        line = np.polyfit(time[:quiet] - time[0], angle[:quiet], 1)
        line = np.array([line[0], line[1] - line[0] * time[0]])
        residual = angle - np.polyval(line, time)
        noise = float(np.std(residual[:quiet], ddof=2))
        level = max(SIGNIFICANT * max(noise, floor), threshold, 1e-15)
        beyond = np.abs(residual) > level
        inside = np.flatnonzero(~beyond)
        last = int(inside[-1]) if inside.size else -1
        crossing = last + 1
        # The line of a short start may be tilted: extend it while later samples follow it.
        grown = min(int(0.8 * crossing), angle.size)
        if grown <= quiet or crossing >= angle.size:
            break
        quiet = grown
    return crossing, line, noise, level


def _creeping(
    time: Floats, angle: Floats, threshold: float, *, moves: bool
) -> tuple[int, Floats, float] | None:
    """Return first moving sample, parabola and noise of an angle that creeps first; else None.

    Under a uniform ramp the creep's speed grows with time, so that its path is a parabola. Creep
    ends where the angle permanently leaves the parabola by more than the threshold. The first
    samples, in which elastic parts wind up, aren't checked. `moves` states that the angle
    permanently leaves a straight line: an inertia may already be turning then.
    """
    # Mean speeds in windows of equal numbers of samples, and the times of the windows' middles.
    edges = np.linspace(0, angle.size - 1, CREEP_WINDOWS + 1).astype(np.int64)
    speed = np.diff(angle[edges]) / np.maximum(np.diff(time[edges]), 1e-12)
    middle_s = 0.5 * (time[edges][1:] + time[edges][:-1]) - time[0]
    early = slice(CREEP_WINDOWS // 10, 3 * CREEP_WINDOWS // 10)
    later = slice(early.stop, CREEP_WINDOWS // 2)
    growth = float(np.median((speed / middle_s)[later]))
    if moves and abs(growth) > 2.0 * abs(float(np.median((speed / middle_s)[early]))):
        # An inertia that is turning gets faster with the square of time: its acceleration doubles.
        # Creep keeps its acceleration, but may start in the other direction after the brake is
        # released.
        before, after = (np.polyfit(middle_s[part], speed[part], 1)[0] for part in (early, later))
        if after * before <= 0.0 or abs(after) > ACCELERATION_OF_CREEP * abs(before):
            return None
    # Creep ends with the last window that is slow, before the fastest one: at its turning point
    # the shaft is slow, too.
    largest_creep = 1.5 * abs(growth) * middle_s + threshold / (time[-1] - time[0])
    searched = CREEP_WINDOWS // 3
    fastest = searched + int(np.argmax(np.abs(speed[searched:])))
    slow = np.flatnonzero(np.abs(speed[:fastest]) <= largest_creep[:fastest])
    if not slow.size or slow[-1] < searched or abs(speed[fastest]) <= largest_creep[fastest]:
        return None
    rows = slice(angle.size // 10, int(edges[slow[-1]]))
    creep = np.polynomial.Polynomial.fit(time[rows], angle[rows], 2)
    residual = angle - creep(time)
    inside = np.flatnonzero(np.abs(residual[rows.start :]) <= threshold)
    crossing = rows.start + int(inside[-1]) + 1 if inside.size else angle.size
    if crossing >= angle.size:
        return None
    line = np.asarray(creep.convert().coef[::-1], dtype=np.float64)
    return crossing, line, float(np.std(residual[rows], ddof=3))


def _cube_start(
    time: Floats, moved: Floats, crossing: int, threshold: float
) -> tuple[float, float]:
    """Return the start of a motion and its standard uncertainty, by a line of the cube root.

    A torque that rises uniformly above the resisting torque turns an inertia by the cube of time,
    so that the cube root is a line. Drag makes the motion slower; friction that falls after the
    start makes it faster. The start is anywhere between the line's zero and the threshold.
    """
    step = float(time[crossing] - time[crossing - 1])
    late = float(time[crossing]) - 0.5 * step
    beyond = np.flatnonzero(moved[crossing:] > 4.0 * threshold)
    stop = min(crossing + (int(beyond[0]) if beyond.size else moved.size) + 1, moved.size)
    rows = slice(crossing, stop)
    if stop - crossing < 4 or np.ptp(moved[rows]) < threshold:
        return late, step / np.sqrt(12.0)
    slope, level = np.polyfit(time[rows] - late, np.cbrt(moved[rows]), 1)
    if slope <= 0.0:
        return late, step / np.sqrt(12.0)
    earliest = float(time[0]) - late
    lag = float(np.clip(level / slope, 0.0, -earliest))
    return late - 0.5 * lag, float(np.hypot(step, lag)) / np.sqrt(12.0)


def _power_start(
    time: Floats, angle: Floats, crossing: int, level: float, sigma: float
) -> tuple[float, float]:
    """Return the mean start of a motion and its spread, from fits of the square and cube of time.

    Before the start the angle follows a line. The fits use the motion up to twelve times the level
    at which it was detected.
    """
    far = np.flatnonzero(angle[crossing:] - angle[crossing] > 12.0 * level)
    stop = min(crossing + (int(far[0]) if far.size else angle.size) + 1, angle.size)
    stop = max(stop, min(crossing + 3, angle.size))
    begin = max(0, crossing - max(4 * QUIET_SAMPLES, crossing // 2, 2 * (stop - crossing)))
    t, values = time[begin:stop] - time[crossing], angle[begin:stop]
    step = float(np.median(np.diff(t))) or 1e-12
    earliest = t[max(2, (crossing - begin) // 3)]
    starts = np.linspace(earliest, t[crossing - begin] - 0.02 * step, 240)
    still, _ = np.linalg.qr(np.column_stack([np.ones_like(t), t]))
    residual = values - still @ (still.T @ values)
    weights, moments = [], []
    for power in POWERS:
        moved = np.maximum(t[:, None] - starts[None, :], 0.0) ** power
        scale = np.abs(moved).max(axis=0)
        moved = moved / np.where(scale > 0.0, scale, 1.0)
        moved -= still @ (still.T @ moved)
        size = np.sum(moved**2, axis=0)
        along = residual @ moved
        gain = np.where((size > 1e-12) & (along > 0.0), along**2 / np.maximum(size, 1e-12), 0.0)
        weights.append(gain)
        moments.append(starts)
    gain, moment = np.concatenate(weights), np.concatenate(moments)
    squares = float(residual @ residual) - gain.max()
    variance = max(sigma**2, squares / max(t.size - 4, 1), 1e-30)
    weight = np.exp(np.maximum((gain - gain.max()) / (2.0 * variance), -700.0))
    weight /= weight.sum()
    mean = float(weight @ moment)
    spread = float(np.sqrt(weight @ (moment - mean) ** 2))
    return mean + float(time[crossing]), float(np.hypot(spread, step / 12.0**0.5))


# -- torque at the first motion ---------------------------------------------------------------

MEDIAN_EFFICIENCY = np.sqrt(np.pi / 2.0)
"""Standard error of a median of normal values, in standard errors of their mean."""
SATURATED_SHARE = 0.2
"""A drive is saturated where the torque is constant over more than this share of a ramp."""
LEAST_LINE = 6
"""Samples of a line through the torque before the motion."""
CHANGED = 25.0
"""Gain in the sum of squares, in variances, from which on a bend of the torque shows the motion."""


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
        times the uncertainty of that time; on a staircase its step.
    time_s : float
        Moment of the first motion.
    held_nm : float
        On a staircase, the level before; NaN on a ramp.
    """

    label: float
    position: float
    torque_nm: float
    standard_uncertainty_nm: float
    time_s: float
    held_nm: float = float("nan")


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
        stairs = [run for run in self.runs if np.isfinite(run.held_nm)]
        rule = Message("{rule} N·m", rule)
        if stairs:
            middle = sorted(stairs, key=lambda each: abs(each.torque_nm))[len(stairs) // 2]
            rule = Message(
                "{rule}; slips at {slips:.4g} N·m, held at {held:.4g} N·m",
                rule,
                abs(middle.torque_nm),
                abs(middle.held_nm),
            )
        rows = [
            ResultQuantity(f"{key}_torque", Message("{kind} torque", self.kind), self.torque, rule)
        ]
        for name, estimate in (
            ("clockwise", self.clockwise),
            ("counter-clockwise", self.counter_clockwise),
        ):
            if estimate is not None:
                title = Message("{kind} torque, {name}", self.kind, name)
                short = name.replace("-", "_")
                rows.append(ResultQuantity(f"{key}_torque_{short}", title, estimate))
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
    row: ArrayLike | None = None,
    keep_outliers: bool = False,
) -> BreakawayResult:
    """Find the torque at the first motion in ramps of torque.

    It is the largest torque before the first motion: that of a line through the torque before it,
    at the moment of the slip that the torque itself shows, otherwise at that of the angle. On a
    staircase it is the level of the slip, with the step as its resolution.

    Parameters
    ----------
    time_s, angle_rad, torque_nm : array of float, shape (n,)
        Samples of the driven side, all runs one after another.
    kind : {"starting", "back-driving"}
        Driven from the input, or from the output.
    run, position : array, shape (n,), optional
        Labels of each ramp and its position; without `run` everything is one ramp.
    resolution_rad : float
        Resolution of the angle: smaller changes don't count as motion; the visible one by default.
    presliding_rad : float
        Elastic motion before the break-away that doesn't count as motion.
    largest_share : float, optional
        Refuse the result where its U exceeds this share of it.
    row : array of int, shape (n,), optional
        Number of each sample in its file, for messages.
    keep_outliers : bool
        Whether single samples far from their neighbours are evaluated, too.

    Raises
    ------
    InputError
        Where a run never moves, moves from its first sample, or holds too few samples; where the
        uncertainty exceeds `largest_share`.
    """
    samples = Samples.of(
        8,
        row=row,
        keep=keep_outliers,
        time_s=time_s,
        angle_rad=angle_rad,
        torque_nm=torque_nm,
        run=run,
        position=position,
    )
    ramp = samples.get("run", 1.0)
    order = np.lexsort((samples["time_s"], ramp))
    samples = samples.where(order)
    samples = samples.screened(samples.get("run", 1.0), angle=samples["angle_rad"])
    threshold = max(resolution_rad, presliding_rad)
    samples = samples.less({"torque": _torque_outliers(samples, threshold)})
    ramp, place = samples.get("run", 1.0), samples.get("position", 0.0)
    runs: list[BreakawayRun] = []
    saturated: list[float] = []
    for label in np.unique(ramp):
        ramp_samples = samples.where(ramp == label)
        where = float("nan") if position is None else float(place[ramp == label][0])
        breakaway, stood = _run_of(ramp_samples, float(label), where, threshold)
        runs.append(breakaway)
        if stood:
            saturated.append(float(label))
    stated = uncertainty or TorqueUncertainty()
    return _result(kind, tuple(runs), stated, saturated, largest_share, samples.findings)


def _torque_outliers(samples: Samples, threshold_rad: float) -> NDArray[np.bool_]:
    """Find outliers of the torque before the first motion: at the slip, a peak is no outlier."""
    ramp = samples.get("run", 1.0)
    found = np.zeros(ramp.size, dtype=np.bool_)
    for label in np.unique(ramp):
        rows = np.flatnonzero(ramp == label)
        motion = _motion(samples.where(rows), float(label), threshold_rad)
        before = np.flatnonzero(outliers(samples["torque_nm"][rows]))
        found[rows[before[before < motion.index - 2]]] = True
    return found


def _motion(samples: Samples, label: float, threshold_rad: float) -> FirstMotion:
    """Find the first motion of a ramp; name the ramp if that fails."""
    try:
        return first_motion(samples["time_s"], samples["angle_rad"], threshold_rad=threshold_rad)
    except InputError as problem:
        message = Message("run {label:g}: {found}", label, problem.found)
        raise InputError(message, problem.allowed, problem.remedy) from problem


def _run_of(
    samples: Samples, label: float, position: float, threshold_rad: float
) -> tuple[BreakawayRun, bool]:
    """Evaluate one ramp; return also whether the torque stood still before the motion."""
    time, torque = samples["time_s"], samples["torque_nm"]
    motion = _motion(samples, label, threshold_rad)
    stairs = _staircase(time, torque, motion)
    if stairs is not None:
        level, held = stairs
        # The break-away torque lies anywhere between the last torque held and that of the slip.
        step = abs(level - held) / 3.0**0.5
        run = BreakawayRun(label, position, level, step, motion.time_s, held)
        return run, False
    level, error = _torque_at(time, torque, motion)
    ramp_range = abs(level - float(torque[0]))
    tail = torque[: motion.index + 1]
    still = np.mean(np.abs(tail - tail[-1]) < 0.02 * ramp_range) if ramp_range > 0 else 0.0
    run = BreakawayRun(label, position, level, error, motion.time_s)
    return run, bool(still > SATURATED_SHARE)


def _staircase(time: Floats, torque: Floats, motion: FirstMotion) -> tuple[float, float] | None:
    """Return the torque levels of the slip and before it; None if the torque has no levels."""
    reached = torque[: motion.crossing + 1]
    levels = levels_of(reached, 3)
    if not levels:
        return None
    late = motion.time_s + 2.0 * motion.standard_uncertainty_s
    stop = min(int(np.searchsorted(time, late)) + 2, motion.crossing + 1)
    sign = 1.0 if reached[:stop][-1] >= reached[0] else -1.0
    heights = [sign * float(np.median(reached[part])) for part in levels if part.start < stop]
    if len(heights) < 2:
        return None
    top, step = max(heights), float(np.median(np.abs(np.diff(heights))))
    # The shaft may have slipped, and the torque fallen, before the last level was complete.
    beyond = sign * reached[levels[int(np.argmax(heights))].stop : stop]
    beyond = beyond[beyond > top + 0.5 * step]
    if beyond.size:
        return sign * float(np.median(beyond)), sign * top
    held = max((height for height in heights if height < top - 0.5 * step), default=top)
    return sign * top, sign * held


def _torque_at(time: Floats, torque: Floats, motion: FirstMotion) -> tuple[float, float]:
    """Return the torque at the slip and its standard uncertainty.

    A fall or a bend of the torque shows the slip more sharply than the angle does.
    """
    spread = motion.standard_uncertainty_s
    first = int(np.searchsorted(time, motion.time_s - 4.0 * spread)) - 2
    first = max(first, min(LEAST_LINE, motion.index))
    stop = min(motion.crossing + max(3, motion.crossing - motion.index) + 1, time.size)
    # The elastic parts relax as the torque falls, which hides the motion at first: a fall of the
    # torque may therefore precede the visible motion.
    earliest = max(LEAST_LINE, min(first, 3 * motion.index // 4))
    for begin_at, falls in ((earliest, True), (first, False)):
        begin = _line_begin(time, torque, begin_at)
        changed = _change(time[begin:stop], torque[begin:stop], begin_at - begin, falls=falls)
        if changed is not None:
            return changed
    begin = _line_begin(time, torque, first)
    before = slice(begin, max(first, begin + 2) + 1)
    level, error, rate = _line_at(time[before] - motion.time_s, torque[before])
    return level, float(np.hypot(error, rate * spread))


def _change(t: Floats, load: Floats, first: int, *, falls: bool) -> tuple[float, float] | None:
    """Return the torque at a bend over time, and its standard uncertainty; None without a bend."""
    breaks = np.arange(max(first, LEAST_LINE - 1), t.size - 3)
    if not breaks.size:
        return None
    sums = np.array(
        [_squares(t[: k + 1], load[: k + 1]) + _squares(t[k + 1 :], load[k + 1 :]) for k in breaks]
    )
    best = int(np.argmin(sums))
    variance = max(float(sums[best]) / max(t.size - 4, 1), 1e-30)
    if _squares(t, load) - sums[best] <= CHANGED * variance:
        return None
    k = int(breaks[best])
    at = 0.5 * float(t[k] + t[k + 1])
    level, error, rate = _line_at(t[: k + 1] - at, load[: k + 1])
    beyond, other, _ = _line_at(t[k + 1 :] - at, load[k + 1 :])
    pressed = float(np.sign(level)) or 1.0
    if falls and pressed * (level - beyond) < SIGNIFICANT * float(np.hypot(error, other)):
        return None
    likely = breaks[sums <= sums[best] + 4.0 * variance]
    values = [_line_at(t[: j + 1] - 0.5 * (t[j] + t[j + 1]), load[: j + 1])[0] for j in likely]
    step = abs(rate) * float(t[k + 1] - t[k]) / 12.0**0.5
    return level, float(np.linalg.norm([error, float(np.std(values)), step]))


def _line_begin(time: Floats, torque: Floats, end: int) -> int:
    """Return the first sample of the longest line through the torque that fits up to a sample."""
    begin = end // 2
    while end - begin >= 4 * LEAST_LINE:
        half = begin + (end - begin) // 2
        slope, error, _ = _line_at(time[begin : end + 1] - time[end], torque[begin : end + 1])
        nearer, other, _ = _line_at(time[half : end + 1] - time[end], torque[half : end + 1])
        if abs(slope - nearer) <= 2.0 * float(np.hypot(error, other)):
            break
        begin = half
    return max(0, min(begin, end - LEAST_LINE))


def _squares(t: Floats, values: Floats) -> float:
    """Return the sum of squares about a fitted line."""
    if t.size < 3:
        return 0.0
    t, values = t - t.mean(), values - values.mean()
    along, size = float(t @ values), float(t @ t)
    return max(float(values @ values) - (along**2 / size if size else 0.0), 0.0)


def _line_at(span: Floats, torque: Floats) -> tuple[float, float, float]:
    """Return a fitted line's value at 0, its standard error, and its slope."""
    if span.size < 3 or np.ptp(span) == 0.0:
        return float(torque.mean()), 0.0, 0.0
    rate, level = np.polyfit(span, torque, 1)
    residual = float(np.std(torque - rate * span - level, ddof=2))
    basis = np.column_stack([span, np.ones_like(span)])
    error = residual * float(np.sqrt(np.linalg.pinv(basis.T @ basis)[1, 1]))
    return float(level), error, float(rate)


# -- all ramps --------------------------------------------------------------------------------


def _result(
    kind: BreakawayKind,
    runs: tuple[BreakawayRun, ...],
    uncertainty: TorqueUncertainty,
    saturated: Sequence[float],
    largest_share: float | None,
    findings: Sequence[Finding],
) -> BreakawayResult:
    """Return the result over all ramps: medians of both directions and their mean."""
    torques = np.array([run.torque_nm for run in runs])
    sides: dict[int, Budget | None] = {}
    for sign in (1, -1):
        ramps = [run for run in runs if np.sign(run.torque_nm) == sign]
        sides[sign] = _median_torque(ramps, uncertainty) if ramps else None
    first, second = sides[1], sides[-1]
    if first is not None and second is not None:
        total = _mean_of_both(first, second)
    else:
        total = first or second or _median_torque(list(runs), uncertainty)
    remarks = list(findings)
    if len(runs) < 3:
        remarks.append(
            Finding(
                "few ramps",
                Message("{count} ramps say little about the spread over positions", len(runs)),
                "measure at several positions, five or more by preference",
            )
        )
    if saturated:
        remarks.append(
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
        findings=tuple(remarks),
    )


def _median_torque(runs: Sequence[BreakawayRun], uncertainty: TorqueUncertainty) -> Budget:
    """Return the median torque of ramps in one direction with its budget."""
    values = np.abs([run.torque_nm for run in runs])
    middle = float(np.median(values))
    first_motion_nm = float(np.sqrt(np.mean([run.standard_uncertainty_nm**2 for run in runs])))
    sign = float(np.sign(runs[0].torque_nm)) or 1.0
    parts = [
        BudgetLine("torque zero", uncertainty.zero_nm, inf, sign, Shared.ZEROING),
        BudgetLine("torque scale", uncertainty.relative * middle, shared=Shared.CALIBRATION),
        BudgetLine("compensation model", uncertainty.model_nm, shared=Shared.CALIBRATION),
        BudgetLine("mounting and drag", uncertainty.mounting_nm, shared=Shared.MOUNTING),
        BudgetLine("loading effects", uncertainty.loading_nm, shared=Shared.LOADING),
    ]
    if values.size > 1:
        efficiency = MEDIAN_EFFICIENCY if values.size > 2 else 1.0
        error = efficiency * float(np.std(values, ddof=1)) / values.size**0.5
        parts.append(BudgetLine("spread over runs", error, values.size - 1))
    else:
        parts.append(BudgetLine("chain repeatability", uncertainty.repeatability_nm))
    # All runs share one rule for the motion, so its error doesn't average out.
    parts.append(BudgetLine("first motion", first_motion_nm, shared=Shared.LOADING))
    return budget(middle, "N·m", parts)


def _mean_of_both(first: Budget, second: Budget) -> Budget:
    """Return the mean of both directions: zero errors cancel, scale and timing errors remain."""
    parts = common_of_both(first, second)
    for name, side in (("clockwise", first), ("counter-clockwise", second)):
        parts += [
            BudgetLine(f"{line.name}, {name}", 0.5 * line.contribution, line.degrees_of_freedom)
            for line in side.lines
            if not line.common
        ]
    return budget(0.5 * (first.value + second.value), "N·m", parts)
