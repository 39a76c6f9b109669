"""Uniform piecewise polynomials that follow a curve within a proved bound."""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import NDArray

from torquebench.compensation.lookup import evaluate
from torquebench.errors import InputError

__all__ = ["BRANCHES", "Curve", "PiecewisePolynomial", "approximate"]

FloatArray = NDArray[np.float64]

Curve = Callable[[FloatArray, int], FloatArray]
"""Value in N·m at readings of shape (n,) on a branch -1, 0 or +1."""

BRANCHES = (-1, 0, 1)
"""Order of the branches in `PiecewisePolynomial.coefficients`."""

_POLICY = ((1, 4096), (3, 4096), (1, 1 << 19))
"""Degree and largest number of intervals, in the order of their speed: the first one still fits
the first-level cache, the last one is for curves with kinks, which no degree helps."""

_CHECKS_PER_INTERVAL = {1: 5, 3: 9}
"""By degree; the middle and both ends among them, and points between those where they meet."""

_MODEL_ROWS = 1 << 15
"""Readings evaluated at once: a Gaussian process makes a matrix of them and its points."""

_BESIDE_ZERO = 1e-12
"""Distance from zero, in full scales, at which the curve's limit at a reversal is taken."""


@dataclass(frozen=True)
class PiecewisePolynomial:
    """Polynomials of one degree on the intervals of a uniform grid, one set a branch.

    Attributes
    ----------
    coefficients : float32 array of shape (3, intervals, degree + 1)
        For the branches -1, 0, +1; powers of the distance from an interval's centre in intervals.
    scale : float
        Intervals per N·m.
    zero : float
        Position of the reading 0 N·m in intervals; half-way between two whole numbers, so that 0
        lies between two intervals and a step at torque reversal is kept.
    low, high : float
        Limits of the reading in N·m.
    gain : float
        1 where the reading itself is added to the polynomial, else 0.
    bound : float
        No deviation from the curve in N·m is larger; see `approximate`.
    branch_aware : bool
        Whether the three branches differ.
    """

    coefficients: NDArray[np.float32]
    scale: float
    zero: float
    low: float
    high: float
    gain: float
    bound: float
    branch_aware: bool

    @property
    def degree(self) -> int:
        """1 (linear) or 3 (cubic)."""
        return self.coefficients.shape[2] - 1

    @property
    def intervals(self) -> int:
        """Number of intervals of a branch."""
        return self.coefficients.shape[1]

    @property
    def interval_nm(self) -> float:
        """Width of an interval in N·m."""
        return 1.0 / self.scale

    @property
    def grid(self) -> tuple[float, float, float, float, float]:
        """The grid as `lookup.evaluate` takes it."""
        return self.scale, self.zero, self.low, self.high, self.gain

    def evaluate(
        self,
        reading: FloatArray,
        branch: NDArray[np.int8] | None,
        out: FloatArray,
        workers: int | None = None,
    ) -> int:
        """Fill `out` and return the number of readings outside the limits, see `lookup`."""
        signs = branch if self.branch_aware else None
        return evaluate(reading, signs, out, self.coefficients, self.grid, workers)

    def edges(self) -> FloatArray:
        """Edges of the intervals in N·m, shape (intervals + 1,)."""
        return (np.arange(self.intervals + 1) - 0.5 - self.zero) / self.scale


def approximate(
    curve: Curve,
    limits: tuple[float, float],
    full_scale: float,
    tolerance: float,
    *,
    gain: float,
    branch_aware: bool,
    name: str,
) -> PiecewisePolynomial:
    """Approximate a curve so that the deviation stays below a bound everywhere.

    Each interval's polynomial meets the curve at its Chebyshev-Lobatto points, ends included, so
    that it is continuous. The deviation is then taken at five (linear) or nine (cubic) points of
    every interval of every branch, ends and middle included, at a step at 0 from both sides, and
    the largest one is enlarged by what the deviation's own curvature allows between the points,
    twice over. The proof holds for curves with no feature narrower than the points' distance; the
    intervals are narrowed until the bound is met.

    Parameters
    ----------
    curve : callable
        Value at readings in N·m for a branch, `gain · reading` included.
    limits : tuple of two floats
        Lowest and highest reading in N·m; the curve isn't evaluated beyond them.
    full_scale : float
        Full scale in N·m.
    tolerance : float
        Largest deviation, as a fraction of full scale.
    gain : float
        1 when the curve is near the reading (only the difference is tabulated), else 0.
    branch_aware : bool
        Whether the curve depends on the branch.
    name : str
        What the curve is, for messages.

    Returns
    -------
    PiecewisePolynomial

    Raises
    ------
    InputError
        When no grid meets the tolerance, naming the reading where the curve jumps.

    Examples
    --------
    >>> parabola = approximate(
    ...     lambda reading, branch: reading + 1e-6 * reading**2, (-1000.0, 1000.0), 1000.0, 1e-6,
    ...     gain=1.0, branch_aware=False, name="parabola",
    ... )
    >>> parabola.degree, parabola.bound < 1e-3
    (1, True)
    """
    allowed = tolerance * full_scale
    used = BRANCHES if branch_aware else (0,)
    builder = _Builder(curve, limits, full_scale, gain, used)
    worst, at, branch = np.inf, 0.0, 0
    for degree, largest in _POLICY:
        wanted, previous = 128, np.inf
        while wanted <= largest:
            attempt = builder.attempt(wanted, degree)
            worst, at, branch = attempt.worst, attempt.worst_at, attempt.worst_branch
            if worst <= allowed:
                return attempt.piecewise
            stalled = worst > 0.7 * previous
            previous = worst
            growth = (worst / allowed) ** (1.0 / (degree + 1))
            # a curve with kinks gains less than its degree promises: grow by at least half
            wanted = ceil(wanted * min(max(1.1 * growth, 1.5), 16.0))
            if stalled and wanted > 4096:
                break
    where = {1: " on the upward branch", -1: " on the downward branch", 0: ""}[branch]
    raise InputError(
        f"a table deviates from the {name} by {worst:.3g} N·m at {at:.6g} N·m{where}",
        f"{allowed:.3g} N·m ({tolerance:.1g} of full scale)",
        "the model jumps there or has a feature far narrower than the range; use the model itself",
    )


@dataclass(frozen=True)
class _Attempt:
    piecewise: PiecewisePolynomial
    worst: float
    worst_at: float
    worst_branch: int


class _Builder:
    """Builds and checks approximations of one curve."""

    def __init__(
        self,
        curve: Curve,
        limits: tuple[float, float],
        full_scale: float,
        gain: float,
        branches: tuple[int, ...],
    ) -> None:
        self.curve, self.gain, self.branches = curve, gain, branches
        self.low, self.high = limits
        self.beside_zero = _BESIDE_ZERO * full_scale

    def attempt(self, wanted: int, degree: int) -> _Attempt:
        width = (self.high - self.low) / wanted
        # an even number of intervals below zero: ties round to even, so 0 itself counts as positive
        below = 2 * ceil(-self.low / (2.0 * width) + 1e-9)
        count = ceil(self.high / width + 1e-9) + below
        zero = below - 0.5
        centres = (np.arange(count) - zero) * width
        sides = np.where(np.arange(count) >= below, 1.0, -1.0)
        # where the limits cut an interval, its points keep to the part inside, at least half of it
        first = np.clip(centres - 0.5 * width, self.low, self.high - 0.5 * width)
        last = np.clip(centres + 0.5 * width, self.low + 0.5 * width, self.high)
        lobatto = 0.5 - 0.5 * np.cos(np.pi * np.arange(degree + 1) / degree)
        nodes = first[:, None] + (last - first)[:, None] * lobatto
        places = (nodes - centres[:, None]) / width
        powers = places[:, :, None] ** np.arange(degree + 1)
        single = np.empty((3, count, degree + 1), dtype=np.float32)
        for branch in self.branches:
            value = self._difference(nodes, sides, branch)
            single[branch + 1] = np.linalg.solve(powers, value[:, :, None])[:, :, 0]
        if len(self.branches) == 1:
            single[:] = single[1]
        worst, at, worst_branch = self._check(single, centres, width, sides)
        piecewise = PiecewisePolynomial(
            single, 1.0 / width, zero, self.low, self.high, self.gain, worst, len(self.branches) > 1
        )
        return _Attempt(piecewise, worst, at, worst_branch)

    def _check(
        self, single: NDArray[np.float32], centres: FloatArray, width: float, sides: FloatArray
    ) -> tuple[float, float, int]:
        first = np.clip(centres - 0.5 * width, self.low, self.high)
        last = np.clip(centres + 0.5 * width, self.low, self.high)
        steps = np.linspace(0.0, 1.0, _CHECKS_PER_INTERVAL[single.shape[2] - 1])
        points = first[:, None] + (last - first)[:, None] * steps
        places = (points - centres[:, None]) / width
        worst, at, worst_branch = -1.0, 0.0, 0
        for branch in self.branches:
            rows = single[branch + 1].astype(np.float64)
            value = np.zeros_like(places)
            for column in rows.T[::-1]:
                value = value * places + column[:, None]
            deviation = value - self._difference(points, sides, branch)
            bend = np.max(np.abs(np.diff(deviation, 2, axis=1)), axis=1)
            deviation = np.abs(deviation)
            # between two points a parabola rises by an eighth of its second difference
            bound = np.max(deviation, axis=1) + 2.0 * bend / 8.0
            index = int(np.argmax(bound))
            if bound[index] > worst:
                worst, worst_branch = float(bound[index]), branch
                at = float(points[index, int(np.argmax(deviation[index]))])
        return worst, at, worst_branch

    def _difference(self, points: FloatArray, sides: FloatArray, branch: int) -> FloatArray:
        """Curve less `gain · reading`, at 0 from the interval's own side."""
        beside = np.where(points == 0.0, sides[:, None] * self.beside_zero, points)
        readings = np.clip(beside, self.low, self.high).ravel()
        value = np.concatenate(
            [
                self.curve(readings[start : start + _MODEL_ROWS], branch)
                for start in range(0, readings.size, _MODEL_ROWS)
            ]
        )
        if not np.all(np.isfinite(value)):
            place = float(readings[int(np.argmin(np.isfinite(value)))])
            raise InputError(f"the model gives no number at {place:.6g} N·m", "finite predictions")
        return np.asarray((value - self.gain * readings).reshape(points.shape))
