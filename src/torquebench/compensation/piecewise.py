"""Uniform piecewise polynomials that follow a curve within a proved bound."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import ceil, exp, log
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.elementwise import functions_for
from torquebench.errors import InputError
from torquebench.message import Message

FloatArray = NDArray[np.float64]

Curve = Callable[[FloatArray, int], FloatArray]
"""Function from readings, shape (n,), and a branch -1, 0 or +1 to a value in N·m."""

BRANCHES = (-1, 0, 1)
"""Order of the branches in `PiecewisePolynomial.coefficients`."""

_POLICY = ((1, 4096), (3, 2048), (1, 1 << 18))
"""Degree and largest number of intervals, in the order of speed: the first two fit the first-level
cache, the last one is for curves with kinks, where a higher degree doesn't help.
"""

LARGEST = _POLICY[-1][1]
"""Largest number of intervals of a branch."""

_FIRST_INTERVALS = 128
_NEAR = 0.02
"""Share of full scale on each side of zero with narrower intervals, as curves bend at the
reversal."""

_CHECKS = {1: 5, 3: 9}
"""Number of evenly spaced points at which an interval's deviation is checked, by degree."""

_NODES = {1: (0, 4), 3: (0, 2, 6, 8)}
"""Check points at which polynomial and curve are equal: the Chebyshev-Lobatto points."""

_MODEL_ROWS = 1 << 15
"""Largest number of readings evaluated at once: a Gaussian process needs a matrix of readings ×
points.
"""

_BESIDE_ZERO = 1e-12
"""Distance from zero, in full scales, at which the limit at the reversal is evaluated."""


_BLOCK = 4096
"""Readings evaluated at once: they fit the second-level cache."""


@dataclass(frozen=True)
class PiecewisePolynomial:
    """Polynomials of one degree on the intervals of a grid, one set for each branch.

    Attributes
    ----------
    coefficients : float64 array of shape (3, intervals, degree + 1)
        For the branches -1, 0, +1: coefficients of powers of the position in an interval, -0.5 to
        0.5.
    scale : float
        Intervals per N·m.
    zero : float
        Position of the reading 0 N·m in intervals; half-way between two whole numbers, so that 0 is
        the border of two intervals and a step at torque reversal is kept.
    extra : float
        Further intervals per N·m near zero.
    near : float
        Size of reading in N·m up to which a reading counts as near zero.
    low, high : float
        Limits of the reading in N·m.
    gain : float
        1 if the reading itself is added to the polynomial, else 0.
    bound : float
        Bound of the deviation from the curve in N·m; see `approximate`.
    branch_aware : bool
        Whether the three branches differ.
    """

    coefficients: FloatArray
    scale: float
    zero: float
    extra: float
    near: float
    low: float
    high: float
    gain: float
    bound: float
    branch_aware: bool

    @property
    def degree(self) -> int:
        """1 (linear) or 3 (cubic)."""
        return int(self.coefficients.shape[2]) - 1

    @cached_property
    def intervals(self) -> int:
        """Number of intervals of a branch."""
        return int(self.coefficients.shape[1])

    def evaluate(
        self, reading: FloatArray, branch: NDArray[np.int8] | None, out: FloatArray
    ) -> int:
        """Evaluate for many readings.

        A reading x lies at ``scale · x + extra · clamp(x, -near, near) + zero`` on a scale where
        interval k reaches from k - ½ to k + ½. With f the distance from the middle of the
        interval, the result is ``gain · x + c₀ + c₁ f (+ c₂ f² + c₃ f³)``.

        Parameters
        ----------
        reading : float64 array of shape (n,), C-contiguous
            Readings in N·m. Beyond the limits the value at the limit is returned.
        branch : int8 array of shape (n,), or None
            -1, 0 or +1; None takes 0 for all.
        out : float64 array of shape (n,), C-contiguous
            Filled with the results; may be `reading` itself.

        Returns
        -------
        outside : int
            Number of readings outside the limits, or not a number.
        """
        signs = branch if self.branch_aware else None
        outside = 0
        for start in range(0, reading.size, _BLOCK):
            block = slice(start, start + _BLOCK)
            value = reading[block]
            held, interval, place = self._located(np, value)
            outside += int(np.count_nonzero(held != value))
            row = interval + self.intervals
            if signs is not None:
                row += self.intervals * signs[block].astype(np.intp)
            out[block] = self._in_interval(value, row, place)
        return outside

    def branches(self, reading: FloatArray | float) -> tuple[Any, Any]:
        """Return the values on the rising and on the falling branch of the signed torque.

        Parameters
        ----------
        reading : float or float64 array of shape (n,)
            Beyond the limits the polynomial is taken at the limit.

        Returns
        -------
        rising, falling : float or float64 array of shape (n,)
        """
        if isinstance(reading, float):
            return self._branches(functions_for(reading), reading)
        blocks = [
            self._branches(np, reading[start : start + _BLOCK])
            for start in range(0, reading.size, _BLOCK)
        ]
        rising, falling = zip(*blocks, strict=True) if blocks else ((reading,), (reading,))
        return np.concatenate(rising), np.concatenate(falling)

    def _branches(self, number: Any, reading: Any) -> tuple[Any, Any]:
        """Return the curve's values at readings while the torque rises, and while it falls."""
        _, interval, place = self._located(number, reading)
        middle = interval + self.intervals
        if not self.branch_aware:
            value = self._in_interval(reading, middle, place)
            return value, value
        size_grows = number.where(reading >= 0.0, self.intervals, -self.intervals)
        return (
            self._in_interval(reading, middle + size_grows, place),
            self._in_interval(reading, middle - size_grows, place),
        )

    def _located(self, number: Any, reading: Any) -> tuple[Any, Any, Any]:
        """Return readings within the limits, with interval and place there as in `evaluate`."""
        held = number.fmin(number.fmax(reading, self.low), self.high)  # NaN: the lower limit
        central = number.minimum(number.maximum(held, -self.near), self.near)
        location = held * self.scale + (central * self.extra + self.zero) + 0.5
        single = isinstance(location, float)
        interval = int(location) if single else location.astype(np.intp)
        return held, interval, location - interval - 0.5

    def _in_interval(self, reading: Any, row: Any, place: Any) -> Any:
        """Return the values of readings by the polynomials in the given rows of the table."""
        powers: Any
        if isinstance(place, float):
            powers = self._table[row].tolist()
        else:
            powers = self._table.take(row, axis=0).T
        value = powers[-1]
        for power in range(len(powers) - 2, -1, -1):
            value = powers[power] + place * value
        # not `gain · reading`: an infinite or missing reading times 0 would not be 0
        return reading + value if self.gain else value

    @cached_property
    def _table(self) -> FloatArray:
        """The coefficients of all branches, a row for each interval."""
        return self.coefficients.reshape(-1, self.degree + 1)

    def nodes(self) -> FloatArray:
        """Edges of the intervals in N·m in ascending order, from the lower to the upper limit."""
        edges = np.arange(self.intervals + 1) - 0.5 - self.zero
        central = self.near * (self.scale + self.extra)
        inside = np.clip(edges, -central, central)
        reading = inside / (self.scale + self.extra) + (edges - inside) / self.scale
        within = reading[(reading > self.low) & (reading < self.high)]
        return np.concatenate([[self.low], within, [self.high]])


@dataclass(frozen=True)
class _Attempt:
    piecewise: PiecewisePolynomial
    worst_far: float
    worst_near: float
    worst_at: float
    worst_branch: int


def approximate(
    curve: Curve,
    limits: tuple[float, float],
    full_scale: float,
    tolerance: float,
    *,
    gain: float,
    branch_aware: bool,
    name: str,
    largest: int = LARGEST,
) -> PiecewisePolynomial:
    """Approximate a curve so that the deviation stays below a bound everywhere.

    Each interval's polynomial meets the curve at its Chebyshev-Lobatto points, ends included, so
    that it is continuous. The deviation is then computed at five (linear) or nine (cubic) points of
    every interval of every branch, ends and middle included, and on both sides of a step at 0. The
    bound is the largest deviation plus half the largest second difference of the deviations. This
    covers kinks, as in a tabulated uncertainty, and a square root at an interval's edge, as in
    loops and reversals. It proves the bound for curves without other features narrower than the
    distance of the points; such features can't be excluded. The intervals are narrowed, separately
    near zero and elsewhere, until the bound is met. Full scale is an edge as well, because models
    taper there.

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
        Name of the curve, for messages.
    largest : int
        Largest number of intervals of a branch.

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
    builder = _Builder(curve, limits, full_scale, gain, BRANCHES if branch_aware else (0,))
    attempt: _Attempt | None = None
    for degree, most in _POLICY:
        # intervals over the range, and in how many parts each of those near zero is divided
        far, fineness = _FIRST_INTERVALS, 1
        previous, needed = np.inf, 0.0  # last deviation; intervals that it lets expect
        known: tuple[int, float] | None = None  # intervals and deviation of the last attempt
        most = min(most, largest)
        while builder.count(far, fineness) <= most and needed <= 4 * most:
            attempt = builder.attempt(far, fineness, degree)
            worst = max(attempt.worst_far, attempt.worst_near)
            if worst <= allowed:
                return attempt.piecewise
            if worst > 0.85 * previous and builder.count(far, fineness) > 4096:
                break  # a jump: narrower intervals don't help
            previous = worst
            if attempt.worst_far > allowed:
                needed = _needed(known, (far, attempt.worst_far), allowed)
                known = far, attempt.worst_far
            far = _narrower(far, attempt.worst_far / allowed, degree)
            fineness = _narrower(fineness, attempt.worst_near / allowed, degree)
    assert attempt is not None
    where = {1: " on the upward branch", -1: " on the downward branch", 0: ""}
    raise InputError(
        Message(
            "a table deviates from the {name} by {worst_far:.3g} N·m at {worst_at:.6g} N·m{where}",
            name,
            max(attempt.worst_far, attempt.worst_near),
            attempt.worst_at,
            where[attempt.worst_branch],
        ),
        Message("{allowed:.3g} N·m ({tolerance:.1g} of full scale)", allowed, tolerance),
        "the model jumps there or has a feature far narrower than the range; use the model itself",
    )


def _needed(previous: tuple[int, float] | None, now: tuple[int, float], allowed: float) -> float:
    """Return the number of intervals to be expected from the convergence of the last two attempts.

    The position of a kink in its interval can hide the convergence. Its order is therefore assumed
    to be at least ½, that of a curve that begins steeply.
    """
    if previous is None or now[0] <= previous[0]:
        return 0.0
    order = max(log(previous[1] / now[1]) / log(now[0] / previous[0]), 0.5)
    return exp(min(log(now[0]) + log(now[1] / allowed) / order, 99.0))


def _narrower(count: int, excess: float, degree: int) -> int:
    """Return the number of intervals that lowers the deviation to its limit."""
    if excess <= 1.0:
        return count
    growth = 1.1 * float(excess ** (1.0 / (degree + 1)))
    # a curve with kinks converges more slowly than its degree promises: grow by at least a half
    return ceil(count * min(max(growth, 1.5), 12.0))


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
        self.full_scale = full_scale

    def count(self, far: int, fineness: int) -> int:
        """Return the approximate number of intervals."""
        near = 2.0 * _NEAR * self.full_scale / (self.high - self.low) * far
        return far + ceil(near) * (fineness - 1)

    def attempt(self, far: int, fineness: int, degree: int) -> _Attempt:
        """Approximate on a grid of about `far` intervals, near zero `fineness` times as fine."""
        width = self.full_scale / ceil(self.full_scale * far / (self.high - self.low))
        near_intervals = ceil(_NEAR * self.full_scale / width)
        near, extra = near_intervals * width, (fineness - 1) / width

        def position(reading: float) -> float:
            return reading / width + min(max(reading, -near), near) * extra

        # zero lies on the edge between two intervals; 0 itself counts as positive
        below = 2 * ceil(-position(self.low) / 2.0 + 1e-9)
        count = ceil(position(self.high) + 1e-9) + below
        edges = np.arange(count + 1) - below
        central = np.clip(edges, -near_intervals * fineness, near_intervals * fineness)
        edges_nm = width * (central / fineness + (edges - central))
        pieces = _Pieces(edges_nm, self.low, self.high, degree)
        is_near = np.abs(edges[:-1] + 0.5) < near_intervals * fineness
        coefficients = np.zeros((3, count, degree + 1))
        worst = {True: -1.0, False: -1.0}
        at, worst_branch = 0.0, 0
        for branch in self.branches:
            value = self._difference(pieces.points, pieces.sides, branch)
            coefficients[branch + 1] = pieces.fit(value)
            bound, place = pieces.bound(coefficients[branch + 1], value)
            for part in (True, False):
                here = np.where(is_near == part, bound, -1.0)
                index = int(np.argmax(here))
                if here[index] > max(worst.values()):
                    at, worst_branch = float(place[index]), branch
                worst[part] = max(worst[part], float(here[index]))
        if len(self.branches) == 1:
            coefficients[:] = coefficients[1]
        piecewise = PiecewisePolynomial(
            coefficients=coefficients,
            scale=1.0 / width,
            zero=below - 0.5,
            extra=extra,
            near=near,
            low=self.low,
            high=self.high,
            gain=self.gain,
            bound=max(worst.values()),
            branch_aware=len(self.branches) > 1,
        )
        return _Attempt(piecewise, worst[False], worst[True], at, worst_branch)

    def _difference(self, points: FloatArray, sides: FloatArray, branch: int) -> FloatArray:
        """Return the curve less `gain · reading`; at 0, its limit from the interval's side."""
        beside = sides[:, None] * _BESIDE_ZERO * self.full_scale
        readings = np.clip(np.where(points == 0.0, beside, points), self.low, self.high)
        distinct, back = np.unique(readings, return_inverse=True)
        value = np.concatenate(
            [
                self.curve(distinct[start : start + _MODEL_ROWS], branch)
                for start in range(0, distinct.size, _MODEL_ROWS)
            ]
        )
        if not np.all(np.isfinite(value)):
            place = float(distinct[int(np.argmin(np.isfinite(value)))])
            raise InputError(
                Message("the model gives no number at {place:.6g} N·m", place), "finite predictions"
            )
        return np.asarray((value - self.gain * distinct)[back].reshape(points.shape))


class _Pieces:
    """Intervals with the points where polynomials and curve agree and where they are compared."""

    def __init__(self, edges: FloatArray, low: float, high: float, degree: int) -> None:
        left, right, widths = edges[:-1], edges[1:], np.diff(edges)
        self.degree = degree
        self.sides = np.where(left >= 0.0, 1.0, -1.0)
        # in an interval that the limits cut, the points cover the inner part, at least half of it
        first = np.clip(left, low, high - 0.5 * widths)
        last = np.clip(right, low + 0.5 * widths, high)
        steps = np.linspace(0.0, 1.0, _CHECKS[degree])
        self.points = first[:, None] + (last - first)[:, None] * steps
        self.points[:, -1] = last
        self.places = (self.points - left[:, None]) / widths[:, None] - 0.5

    def fit(self, value: FloatArray) -> FloatArray:
        """Return the coefficients of polynomials through the nodes, (intervals, degree + 1)."""
        nodes = list(_NODES[self.degree])
        powers = self.places[:, nodes, None] ** np.arange(self.degree + 1)
        return np.asarray(np.linalg.solve(powers, value[:, nodes, None])[:, :, 0])

    def bound(self, coefficients: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the bound of each interval's deviation, and where it is largest."""
        result = np.zeros_like(self.places)
        for column in coefficients.T[::-1]:
            result = result * self.places + column[:, None]
        deviation = result - value
        # between two points a parabola rises by an eighth of its second difference, a kink by
        # up to three eighths more than the points show; two kinks in one interval by more
        bend = np.max(np.abs(np.diff(deviation, 2, axis=1)), axis=1)
        size = np.abs(deviation)
        place = self.points[np.arange(len(size)), np.argmax(size, axis=1)]
        return np.max(size, axis=1) + 0.5 * bend, place
