"""Detection of the first motion: the change point of an angle under a slow ramp of torque."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reducers.preparation import finite_columns

__all__ = ["FirstMotion", "first_motion"]

QUIET_SAMPLES = 6
"""Fewest samples at rest before the first motion."""
CREEP_WINDOWS = 40
"""Parts of a ramp in which its speed is checked."""
ACCELERATION_OF_CREEP = 1.5
"""Largest growth of creep's acceleration from one fifth of a ramp to the next (motion: 2)."""
SIGNIFICANT = 5.0
"""Deviation that is treated as motion, in standard deviations of the noise."""


@dataclass(frozen=True)
class FirstMotion:
    """Position at which an angle begins to move.

    Parameters
    ----------
    index : int
        Last sample at rest.
    time_s : float
        Moment of the change.
    standard_uncertainty_s : float
        Of that moment.
    noise_rad : float
        Standard deviation of the angle at rest, about its own slow line.
    direction : int
        +1 or -1.
    crossing : int
        First sample beyond the threshold.
    """

    index: int
    time_s: float
    standard_uncertainty_s: float
    noise_rad: float
    direction: int
    crossing: int


def first_motion(
    time_s: ArrayLike, angle_rad: ArrayLike, *, threshold_rad: float = 0.0
) -> FirstMotion:
    """Find the change point at which an angle departs from its line at rest.

    At rest the angle follows a slow line (elastic wind-up, drift) with noise; with a threshold, a
    parabola: contacts creep faster as a uniform ramp proceeds. Motion begins where the angle
    departs from that permanently, by five standard deviations of the noise or the threshold if
    larger. The moment itself is the start of the parabola that fits best between, or, beyond a
    threshold, of the cube by which a uniformly rising torque turns an inertia.

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
        if farthest > time.size // 2:  # it may swing back after its motion
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
    direction = 1 if deviation[crossing] > 0 else -1
    if threshold_rad > SIGNIFICANT * noise:
        moment, spread = _cube_start(time, direction * deviation, crossing, threshold_rad)
        index = int(np.clip(np.searchsorted(time, moment, side="right") - 1, 0, crossing - 1))
        return FirstMotion(index, moment, spread, noise, direction, crossing)
    moment, spread = _parabola_start(time, angle, crossing, noise)
    index = int(np.clip(np.searchsorted(time, moment, side="right") - 1, 0, crossing))
    return FirstMotion(index, moment, spread, noise, direction, crossing)


def _crossing(
    time: NDArray[np.float64], angle: NDArray[np.float64], threshold: float
) -> tuple[int, NDArray[np.float64], float, float]:
    """Return the first sample permanently beyond the line at rest, that line, noise and limit.

    Without motion, the first sample is one after the last.

    The part at rest grows from the start as long as the next samples follow its line.
    """
    quiet = max(QUIET_SAMPLES, angle.size // 20)
    resolution = float(np.min(np.diff(np.unique(angle)), initial=np.inf))
    floor = 0.3 * resolution if np.isfinite(resolution) else 0.0
    least = float(np.median(np.abs(np.diff(angle)))) * 1.05 + 1e-15
    while True:
        line = np.polyfit(time[:quiet] - time[0], angle[:quiet], 1)
        line = np.array([line[0], line[1] - line[0] * time[0]])
        rest = angle - np.polyval(line, time)
        noise = float(np.std(rest[:quiet], ddof=2))
        level = max(SIGNIFICANT * max(noise, min(floor, least)), threshold, 1e-15)
        beyond = np.abs(rest) > level
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
    time: NDArray[np.float64], angle: NDArray[np.float64], threshold: float, *, moves: bool
) -> tuple[int, NDArray[np.float64], float] | None:
    """Return the result of `_crossing` for an angle with creep before motion; else None.

    Under a uniform ramp the creep's speed grows with time, so that its path is a parabola. It ends
    where the angle permanently exceeds it by half. The very beginning, where elastic parts wind up,
    isn't checked. `moves` states that the angle permanently leaves a straight line: an inertia may
    already be turning then.
    """
    edges = np.linspace(0, angle.size - 1, CREEP_WINDOWS + 1).astype(np.int64)
    speed = np.diff(angle[edges]) / np.maximum(np.diff(time[edges]), 1e-12)
    since = 0.5 * (time[edges][1:] + time[edges][:-1]) - time[0]
    first = slice(CREEP_WINDOWS // 10, 3 * CREEP_WINDOWS // 10)
    second = slice(first.stop, CREEP_WINDOWS // 2)
    growth = float(np.median((speed / since)[second]))
    if moves and abs(growth) > 2.0 * abs(float(np.median((speed / since)[first]))):
        # An inertia that is turning gets faster with the square of time: its acceleration doubles.
        # Creep keeps its acceleration, but may start in the other direction after the brake is
        # released.
        before, after = (np.polyfit(since[part], speed[part], 1)[0] for part in (first, second))
        if after * before <= 0.0 or abs(after) > ACCELERATION_OF_CREEP * abs(before):
            return None
    fastest = 1.5 * abs(growth) * since + threshold / (time[-1] - time[0])
    # At its turning point the shaft is slow, too: creep is what precedes the fastest motion.
    begun = CREEP_WINDOWS // 3
    peak = begun + int(np.argmax(np.abs(speed[begun:])))
    slow = np.flatnonzero(np.abs(speed[:peak]) <= fastest[:peak])
    if not slow.size or slow[-1] < begun or abs(speed[peak]) <= fastest[peak]:
        return None
    rows = slice(angle.size // 10, int(edges[slow[-1]]))
    creep = np.polynomial.Polynomial.fit(time[rows], angle[rows], 2)
    rest = angle - creep(time)
    inside = np.flatnonzero(np.abs(rest[rows.start :]) <= threshold)
    crossing = rows.start + int(inside[-1]) + 1 if inside.size else angle.size
    if crossing >= angle.size:
        return None
    line = np.asarray(creep.convert().coef[::-1], dtype=np.float64)
    return crossing, line, float(np.std(rest[rows], ddof=3))


def _cube_start(
    time: NDArray[np.float64], moved: NDArray[np.float64], crossing: int, threshold: float
) -> tuple[float, float]:
    """Go back from the threshold to the start; return it and its standard uncertainty.

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


def _parabola_start(
    time: NDArray[np.float64], angle: NDArray[np.float64], crossing: int, noise: float
) -> tuple[float, float]:
    """Fit line plus parabola with a free start; return the start and its standard uncertainty."""
    stop = min(crossing + 3, time.size)
    begin = max(0, crossing - max(4 * QUIET_SAMPLES, crossing // 2))
    t, values = time[begin:stop] - time[crossing], angle[begin:stop]
    earliest = max(2, t.size - max(3 * QUIET_SAMPLES, t.size // 2))
    candidates = np.unique(np.linspace(t[earliest], t[-2], 200))
    squares = np.empty(candidates.size)
    for k, start in enumerate(candidates):
        basis = np.column_stack([np.ones_like(t), t, np.maximum(t - start, 0.0) ** 2])
        fit, *_ = np.linalg.lstsq(basis, values, rcond=None)
        squares[k] = float(np.sum((values - basis @ fit) ** 2))
    best = int(np.argmin(squares))
    likely = candidates[squares <= squares[best] + max(noise, 1e-15) ** 2]
    half = 0.5 * float(np.ptp(likely))
    step = float(np.median(np.diff(t)))
    lag = float(t[-(stop - crossing)] - candidates[best])
    spread = float(np.hypot(max(half, 0.5 * step / np.sqrt(3.0)), lag / np.sqrt(12.0)))
    return float(candidates[best] + time[crossing]), spread
