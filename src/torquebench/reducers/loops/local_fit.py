"""Readings of a loop's branch at a torque: local fits with windows as wide as the knots allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

Floats = NDArray[np.float64]
GROWTH = 1.3
CONFIDENCE = 1.5
"""Standard errors within which fits of neighbouring windows must agree."""
NARROWER = 2
"""Steps by which the widest window that agrees is narrowed: the biases of several readings add up,
and each step halves the bias for a tenth more scatter."""
BIAS = 2.0**0.5
"""Factor on the standard error, because the remaining bias is at most one standard error."""
LEAST_KNOTS = 3
"""Fewest knots of a branch."""


@dataclass(frozen=True, eq=False)
class Branch:
    """A branch as knots: angle (rad) over torque (N·m), in the order of measurement.

    `noise` and `step` are standard uncertainties of a knot's angle, by independent noise and by
    counts that may be alike in every loop. `sparse` says that the branch has few, exact knots.
    """

    torque: Floats
    angle: Floats
    noise: float
    step: float
    sparse: bool = False

    def __post_init__(self) -> None:
        if self.torque.size < LEAST_KNOTS:
            raise InputError(
                Message("{size} samples, levels or counts in a branch of a loop", self.torque.size),
                Message("at least {limit}", LEAST_KNOTS),
                "record more samples per loop, or use a finer encoder",
            )


@dataclass(frozen=True)
class Reading:
    """A branch's angle at a torque, rad: value, slope per N·m, and standard uncertainties.

    `noise` averages over loops; `step` and `between` (error of interpolation between knots) don't.
    """

    value: float
    slope: float
    noise: float
    step: float
    between: float


@dataclass(frozen=True, eq=False)
class LocalFit:
    """Values, slopes and standard errors of local lines at several torques."""

    value: Floats
    slope: Floats
    standard_error: Floats


def read(branches: Sequence[Branch], torque: float, widest: float) -> list[Reading]:
    """Read the same branch of several loops at a torque, by local parabolas with one common window.

    The window grows as long as the means of all fits so far agree within their standard errors
    (intersection of confidence intervals: Goldenshluger and Nemirovski, Mathematical Methods of
    Statistics 6 (1997) 135), up to a half width of `widest`. A narrower one is used, so that its
    bias is smaller than the error of the mean. The error of interpolation between the two nearest
    knots is bounded by the chord between them and by the lines that lead to them from either side.
    """
    knots = []
    for branch in branches:
        order = np.argsort(branch.torque, kind="stable")
        knots.append((branch.torque[order], branch.angle[order]))
    after = [int(np.clip(np.searchsorted(x, torque), 1, x.size - 1)) for x, _ in knots]
    beside = [
        np.abs(x[k - 1 : k + 1] - torque).max() for (x, _), k in zip(knots, after, strict=True)
    ]
    half, noise = float(max(beside)) * (1.0 + 1e-9), [branch.noise for branch in branches]
    low, high = -np.inf, np.inf
    agreeing: list[list[tuple[float, float, float]]] = []
    while True:
        inside = [np.abs(x - torque) <= half for x, _ in knots]
        fits = [_parabola(x[m] - torque, y[m]) for (x, y), m in zip(knots, inside, strict=True)]
        value, _, gain = np.transpose(fits)
        scatter = float(np.linalg.norm(gain * noise)) / len(branches)
        step = float(np.mean(gain * [branch.step for branch in branches]))
        reach = CONFIDENCE * float(np.hypot(scatter, step))
        low, high = max(low, value.mean() - reach), min(high, value.mean() + reach)
        if agreeing and low > high:
            agreeing = agreeing[: max(1, len(agreeing) - NARROWER)]
            break
        agreeing.append(fits)
        if half >= widest or all(used.all() for used in inside):
            break
        half = min(half * GROWTH, max(widest, half))
    readings = []
    for branch, (x, y), (angle, slope, factor) in zip(branches, knots, agreeing[-1], strict=True):
        between = _between(x, y, torque, angle, float(np.hypot(branch.noise, branch.step)))
        errors = (BIAS * branch.noise * factor, BIAS * branch.step * factor)
        readings.append(Reading(angle, slope, *errors, between))
    return readings


def _parabola(x: Floats, y: Floats) -> tuple[float, float, float]:
    """Return a fit's value and slope at 0, and the value's standard error per unit noise.

    The fit is a parabola through six knots or more, a line through fewer.
    """
    scale = max(float(np.max(np.abs(x))), 1e-300)
    if np.ptp(x) <= 1e-12 * scale:
        return float(y.mean()), 0.0, float(y.size**-0.5)
    basis = np.vander(x / scale, 3 if np.unique(x).size >= 6 else 2, increasing=True)
    weights = np.linalg.pinv(basis)
    value, slope = weights[0] @ y, weights[1] @ y
    return float(value), float(slope / scale), float(np.sqrt(np.sum(weights[0] ** 2)))


def _between(x: Floats, y: Floats, place: float, value: float, sigma: float) -> float:
    """Return the standard uncertainty of a value interpolated at a place between two knots.

    It is the difference to lines through neighbouring knots, beyond their noise `sigma`.
    """
    torque, first = np.unique(x, return_index=True)
    if torque.size < 3:
        return 0.0
    angle = np.add.reduceat(y, first) / np.diff(np.append(first, y.size))
    after = int(np.clip(np.searchsorted(torque, place), 1, torque.size - 1))
    lines = []
    for a, b in ((after - 1, after), (after - 2, after - 1), (after, after + 1)):
        if a >= 0 and b < torque.size:
            slope = (angle[b] - angle[a]) / (torque[b] - torque[a])
            lines.append(float(angle[a] + slope * (place - torque[a])))
    if torque[after - 1] <= place <= torque[after]:
        lines = np.clip(lines, *sorted((angle[after - 1], angle[after]))).tolist()
    difference = max(abs(line - value) for line in lines)
    return float(np.sqrt(max(difference**2 - (4.0 * sigma) ** 2, 0.0) / 3.0))


class LocalLines:
    """Local straight lines through a branch at many torques, for its curve.

    Like `read`, but with lines, and with cumulative sums: a fit needs no pass over the samples.

    Examples
    --------
    >>> torque = np.linspace(-10.0, 10.0, 2001)
    >>> angle = np.where(torque < 0.0, torque, torque + 1.0)  # a jump of 1 at zero
    >>> fit = LocalLines(Branch(torque, angle, 0.0, 0.0), 1.0).at([-0.1, 0.1, 5.0])
    >>> fit.value.round(6).tolist(), fit.slope.round(6).tolist()
    ([-0.1, 1.1, 6.0], [1.0, 1.0, 1.0])
    """

    def __init__(self, branch: Branch, widest: float) -> None:
        order = np.argsort(branch.torque, kind="stable")
        self._x, y = branch.torque[order], branch.angle[order]
        self._sparse, self._y = branch.sparse, y
        self._sigma, self._widest = float(np.hypot(branch.noise, branch.step)), widest
        self._offset = float(y.mean())
        y = y - self._offset
        sums = np.column_stack([np.ones_like(y), self._x, self._x**2, y, self._x * y])
        self._sums = np.vstack([np.zeros(5), np.cumsum(sums, axis=0)])

    def at(self, places: ArrayLike) -> LocalFit:
        """Return the local lines at several torques, shape (n,)."""
        x = np.atleast_1d(np.asarray(places, dtype=np.float64))
        if self._sparse:
            value = np.interp(x, self._x, self._y)
            slope = np.gradient(value, x) if x.size > 1 else np.zeros(1)
            return LocalFit(value, slope, np.full(x.size, self._sigma))
        half = self._least_half_width(x)
        best = self._lines(x, half)
        low = best.value - CONFIDENCE * best.standard_error
        high = best.value + CONFIDENCE * best.standard_error
        open_ = half < self._widest
        while np.any(open_):
            half = np.where(open_, np.minimum(half * 1.5, self._widest), half)
            wider = self._lines(x, half)
            low = np.maximum(low, wider.value - CONFIDENCE * wider.standard_error)
            high = np.minimum(high, wider.value + CONFIDENCE * wider.standard_error)
            agree = open_ & (low <= high)
            best = LocalFit(
                np.where(agree, wider.value, best.value),
                np.where(agree, wider.slope, best.slope),
                np.where(agree, wider.standard_error, best.standard_error),
            )
            open_ = agree & (half < self._widest)
        return best

    def _least_half_width(self, places: Floats) -> Floats:
        """Return the smallest half width around each torque that contains enough samples."""
        size, need = self._x.size, min(8, self._x.size)
        middle = np.searchsorted(self._x, places)
        starts = np.clip(middle[:, None] - np.arange(need + 1), 0, size - need)
        first, last = self._x[starts], self._x[starts + need - 1]
        reach = np.maximum(np.abs(places[:, None] - first), np.abs(last - places[:, None]))
        scale = max(float(np.ptp(self._x)), 1e-300)
        return np.asarray(reach.min(axis=1) * (1 + 1e-12) + 1e-12 * scale)

    def _lines(self, x: Floats, half: Floats) -> LocalFit:
        """Return lines fitted to the samples within given distances of given torques."""
        left = np.searchsorted(self._x, x - half, side="left")
        right = np.searchsorted(self._x, x + half, side="right")
        n, sx, sxx, sy, sxy = (self._sums[right] - self._sums[left]).T
        mean_x, mean_y = sx / n, sy / n
        spread = np.maximum(sxx / n - mean_x**2, 0.0)
        flat = spread <= 1e-18 * max(float(np.max(np.abs(self._x))), 1e-300) ** 2
        spread = np.where(flat, 1.0, spread)
        slope = np.where(flat, 0.0, (sxy / n - mean_x * mean_y) / spread)
        leverage = 1.0 / n + np.where(flat, 0.0, (x - mean_x) ** 2 / (n * spread))
        return LocalFit(
            value=mean_y + slope * (x - mean_x) + self._offset,
            slope=slope,
            standard_error=self._sigma * np.sqrt(leverage),
        )
