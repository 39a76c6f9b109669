"""Hysteresis with memory: the branch of a live reading follows from the readings before it.

After a reversal in mid-range, a reading is on neither branch of the calibrated loop. Its position
between them follows from the states of play (backlash) operators of several widths w, which the
readings move:

    p ← max(x − w, min(x + w, p)),    s = (x − p) / w  in [−1, 1]

(A. Visintin, Differential Models of Hysteresis, Springer 1994, chapter III; M. Brokate and
J. Sprekels, Hysteresis and Phase Transitions, Springer 1996.) The weighted mean of the s is +1
after a long rise and −1 after a long fall. It is compared with the states that the calibration
passed through at the same reading. On the calibrated loop the result is the branch-aware model's
two curves, between them a mixture, and beyond them (a reversal through zero, which a series in one
direction doesn't contain) the loop's own amplitude. An unknown initial state is an interval of
states, which closes as the history becomes known: the operators keep their order.

A calibrated loop determines the operators' weights poorly, and says nothing of loops that were
never measured. The position within the loop is therefore also computed with equal weights, and the
difference counts as an uncertainty; beyond the loop the whole amplitude is uncertain.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, isfinite, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.compensation.table import CompensationTable
from torquebench.elementwise import Values, elementwise, in_rows, located, on_lines
from torquebench.errors import InputError
from torquebench.message import Message

FloatArray = NDArray[np.float64]

_GENERIC_WIDTHS = np.geomspace(0.005, 0.9, 14)
"""Widths of the play operators in full scales: the narrowest is far above the noise of a reading,
the widest never reverses within one direction.
"""

_REFERENCE_STEPS = 512
"""Steps of a full scale along the calibration's path."""


def one_sided_path(full_scale_nm: float) -> FloatArray:
    """Return the turning points of a calibration whose directions are each preloaded, in N·m."""
    return full_scale_nm * np.array([0.0, 1.0, 0.0, 1.0, 0.0, -1.0, 0.0, -1.0, 0.0])


_AT_ONCE = 1 << 12
"""Readings whose states are in memory at once."""

_ONE_BY_ONE = 48
"""Up to this number of readings, a loop over readings is faster than parallel chunks."""


def _places(
    reading: FloatArray, widths: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return readings, and play positions for two initial positions, both in columns of chunks.

    A reading clamps a position to its own value ± the width. All clamps of a chunk of readings
    together are one clamp, which gives the positions at the start of the next chunk. The readings
    of all chunks are then followed side by side. The results equal those of a loop over readings
    bit by bit.

    The last of n readings fills up the last chunk, which doesn't move the operators. Shapes: widths
    (j, 1), start (j, 2), columns (length, chunks), places (length, j, 2, chunks).
    """
    length, chunks, columns = reading.size, 1, reading[:, None]
    if length > _ONE_BY_ONE:
        length = ceil(sqrt(reading.size))
        chunks = -(-reading.size // length)
        columns = np.pad(reading, (0, chunks * length - reading.size), mode="edge")
        columns = columns.reshape(chunks, length).T.copy()
    low, high = columns[:, None] - widths, columns[:, None] + widths
    now = start[:, :, None]
    if chunks > 1:
        clamp = np.stack((low[0], high[0]))
        for k in range(1, length):
            np.maximum(low[k], np.minimum(high[k], clamp, out=clamp), out=clamp)
        least, most = clamp.transpose(0, 2, 1)[..., None]
        starts = np.empty((chunks, *start.shape))
        starts[0] = start
        for chunk in range(1, chunks):
            before = np.minimum(most[chunk - 1], starts[chunk - 1])
            np.maximum(least[chunk - 1], before, out=starts[chunk])
        now = starts.transpose(1, 2, 0)
    places = np.empty((length, *start.shape, chunks))
    for k in range(length):
        now = np.minimum(high[k, :, None], now, out=places[k])
        np.maximum(low[k, :, None], now, out=now)
    return columns, places


def non_negative_solution(matrix: FloatArray, goal: FloatArray) -> tuple[FloatArray, float]:
    """Return x ≥ 0 of least ‖matrix·x − goal‖, and that distance.

    By active sets (C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, chapter
    23). SciPy has it, too, but with its optimisers, which take 40 MB of a server that fits nothing.

    Parameters
    ----------
    matrix : float64 array of shape (n, k)
        Of full column rank.
    goal : float64 array of shape (n,)
    """
    solution = np.zeros(matrix.shape[1])
    free = np.zeros(solution.size, dtype=bool)
    small = 1e-12 * float(np.linalg.norm(matrix) * np.linalg.norm(goal))
    for _ in range(3 * solution.size):  # as in SciPy: rounding may let one come and go for ever
        residual = goal - matrix @ solution
        wish = np.where(free, -np.inf, matrix.T @ residual)
        if not wish.max() > small:
            break
        free[wish.argmax()] = True
        while True:
            trial = np.zeros(solution.size)
            trial[free] = np.linalg.lstsq(matrix[:, free], goal, rcond=None)[0]
            below = free & (trial <= 0.0)
            if not below.any():
                break
            way = np.maximum(solution[below] - trial[below], np.finfo(float).tiny)
            step = float(np.min(solution[below] / way))
            solution += step * (trial - solution)
            free &= solution > 1e-14 * solution.max()
            solution[~free] = 0.0
        solution = trial
    return solution, float(np.linalg.norm(goal - matrix @ solution))


@dataclass(frozen=True)
class HysteresisOperator:
    """Play operators of a chain, and their states during the calibration.

    Parameters
    ----------
    widths_nm : float64 array of shape (j,)
        Play widths, above 0.
    weights : float64 array of shape (j,)
        Shares of the play operators, adding up to 1.
    amplitude_nm : float
        Half the loop: compensated torque after a long rise, less the middle of the loop, at the
        same reading.
    path_nm : float64 array of shape (k,)
        Turning points of the calibration's path; the last pass over a reading counts.
    full_scale_nm : float
        Calibrated range.
    amplitude_std_nm : float
        Standard uncertainty of the amplitude.
    """

    widths_nm: FloatArray
    weights: FloatArray
    amplitude_nm: float
    path_nm: FloatArray
    full_scale_nm: float
    amplitude_std_nm: float = 0.0

    def __post_init__(self) -> None:
        widths, weights = np.asarray(self.widths_nm), np.asarray(self.weights)
        if widths.ndim != 1 or widths.size == 0 or not np.all(widths > 0):
            raise InputError(
                Message("play widths {widths}", widths.tolist()), "one or more, all above 0 N·m"
            )
        if weights.shape != widths.shape or not np.all(weights >= 0) or weights.sum() <= 0:
            raise InputError("weights of the play operators", "one for each width, not negative")

    @classmethod
    def generic(cls, full_scale_nm: float, path_nm: ArrayLike | None = None) -> HysteresisOperator:
        """Return play operators from 0.5 % of full scale upwards, equally weighted.

        Parameters
        ----------
        full_scale_nm : float
            Calibrated range in N·m.
        path_nm : array_like, optional
            Turning points of the calibration; `one_sided_path` where not given.
        """
        count = _GENERIC_WIDTHS.size
        path = one_sided_path(full_scale_nm) if path_nm is None else path_nm
        return cls(
            _GENERIC_WIDTHS * full_scale_nm,
            np.full(count, 1.0 / count),
            0.0,
            np.asarray(path, dtype=np.float64),
            full_scale_nm,
        )

    @classmethod
    def from_table(
        cls, table: CompensationTable, path_nm: ArrayLike | None = None
    ) -> HysteresisOperator:
        """Fit the play operators so that their loop along the calibration's path is the model's.

        The operators have the generic widths; their weights are fitted to the distance of the
        model's two branches over the range (non-negative least squares).

        Parameters
        ----------
        table : CompensationTable
            Compiled branch-aware model.
        path_nm : array_like, optional
            Turning points of the calibration; `one_sided_path` where not given.

        Returns
        -------
        HysteresisOperator
            `generic` where the model has no loop.
        """
        generic = cls.generic(table.reach_nm, path_nm)
        grid = generic._grid[(generic._grid >= table.reading_low_nm)]
        grid = grid[grid <= table.reading_high_nm]
        rising, falling = table.curve.branches(grid)
        parts = np.column_stack(
            [generic._only(play)._loop_width_at(grid) for play in range(generic.widths_nm.size)]
        )
        std = 0.0
        if table.uncertainty_curve is not None and table.curve.branch_aware:
            std = float(np.mean(table.standard_uncertainty(grid, np.ones(grid.size))))
        return replace(generic._weighted(parts, rising - falling), amplitude_std_nm=std)

    def tracker(self) -> BranchTracker:
        """Return a tracker without history."""
        return BranchTracker((self,))

    def _only(self, play: int) -> HysteresisOperator:
        """Return an operator that has one of the widths only."""
        return HysteresisOperator(
            self.widths_nm[play : play + 1],
            np.ones(1),
            self.amplitude_nm,
            self.path_nm,
            self.full_scale_nm,
        )

    def _weighted(self, parts: FloatArray, loop: FloatArray) -> HysteresisOperator:
        """Fit the operators' weights, smooth over the widths, to a loop."""
        # weights of neighbouring widths are kept similar: otherwise noise would select single
        # widths
        bend = np.diff(np.eye(parts.shape[1]), 2, axis=0)
        scale = float(np.sqrt(np.sum(parts**2) / parts.shape[1]))
        rows = [np.vstack([sign * parts, scale * bend]) for sign in (1.0, -1.0)]
        goal = np.append(loop, np.zeros(len(bend)))
        solutions = [non_negative_solution(row, goal) for row in rows]
        sign = 1.0 if solutions[0][1] <= solutions[1][1] else -1.0
        shares = solutions[0 if sign > 0 else 1][0]
        total = float(np.sum(shares))
        if total <= 1e-7 * self.full_scale_nm:
            return self
        significant = shares > 1e-6 * total
        return HysteresisOperator(
            self.widths_nm[significant],
            shares[significant] / total,
            sign * total,
            self.path_nm,
            self.full_scale_nm,
        )

    @cached_property
    def _grid(self) -> FloatArray:
        """Torques of even steps over the whole path, N·m."""
        largest = max(float(np.max(np.abs(self.path_nm))), self.full_scale_nm)
        steps = int(np.ceil(_REFERENCE_STEPS * largest / self.full_scale_nm))
        step = self.full_scale_nm / _REFERENCE_STEPS
        return step * np.arange(-steps, steps + 1, dtype=np.float64)

    @cached_property
    def reference(self) -> FloatArray:
        """Readings, and the states of the calibration at each, falling and rising."""
        falling, rising = np.full((2, self._grid.size), np.nan)
        tracker = self.tracker()
        # a calibration starts at rest, with all operators in their middle positions
        tracker.settle(float(self.path_nm[0]))
        for start, stop in zip(self.path_nm[:-1], self.path_nm[1:], strict=True):
            low, high = min(start, stop), max(start, stop)
            passed = np.flatnonzero((self._grid >= low) & (self._grid <= high))
            if stop < start:
                passed = passed[::-1]
            state, _ = tracker.push(np.append(self._grid[passed], stop))
            (rising if stop > start else falling)[passed] = state[:-1]
        return np.array([self._grid, _filled(falling, rising), _filled(rising, falling)])

    def _loop_width_at(self, reading: FloatArray) -> FloatArray:
        """Return the width of the reference loop at readings."""
        grid, falling, rising = self.reference
        width = np.interp(reading, grid, rising) - np.interp(reading, grid, falling)
        return np.asarray(np.maximum(width, 0.0))


class BranchTracker:
    """Follows the state of the play operators along a stream of readings.

    The result depends on the readings only, not on how the stream is cut into blocks.

    Parameters
    ----------
    operators : sequence of HysteresisOperator
        Operators of the same range and path.

    Examples
    --------
    >>> tracker = HysteresisOperator.generic(100.0).tracker()
    >>> low, high = tracker.push([0.0, 100.0, -100.0, 100.0])
    >>> low.round(3).tolist(), high.round(3).tolist()
    ([-0.912, 1.0, -1.0, 1.0], [0.912, 1.0, -1.0, 1.0])
    """

    def __init__(self, operators: Sequence[HysteresisOperator]) -> None:
        widths = np.unique(np.concatenate([operator.widths_nm for operator in operators]))
        weights = np.zeros((len(operators), widths.size))
        for operator, row in zip(operators, weights, strict=True):
            np.add.at(row, widths.searchsorted(operator.widths_nm), operator.weights)
        self._widths, self._weights = widths[:, None], weights[:, None, :, None, None]
        path_nm, full_scale_nm = operators[0].path_nm, operators[0].full_scale_nm
        self._largest_nm = max(full_scale_nm, float(np.max(np.abs(path_nm))))
        self.forget()

    def forget(self) -> None:
        """Forget the past, as after a gap in the readings or after another mounting.

        Only full scale limits the operators: none is farther out than full scale less its width.
        """
        farthest = np.maximum(self._largest_nm - self._widths, 0.0)
        self._bounds = farthest * (-1.0, 1.0)

    def settle(self, reading_nm: float) -> None:
        """Start from a demagnetised state: every operator in its middle at a reading."""
        self._bounds = np.full((self._widths.size, 2), reading_nm)

    def copy(self) -> BranchTracker:
        """Return a second tracker in the same state."""
        return copy(self)

    def push(self, reading_nm: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Update the state with the next readings of the stream.

        Parameters
        ----------
        reading_nm : array_like of shape (n,)
            Next readings in N·m, in the order of time.

        Returns
        -------
        low, high : float64 array of shape (n,)
            Bounds of the first operator's state at each reading, -1 to 1; equal where the past is
            known.

        Raises
        ------
        InputError
            When a reading is not a number.
        """
        high, low = self.follow(np.ascontiguousarray(reading_nm, dtype=np.float64))[0]
        return low, high

    def follow(self, reading_nm: FloatArray) -> FloatArray:
        """Update the state by readings; return each operator's largest and smallest possible state.

        The shape is (operators, 2, n).
        """
        if reading_nm.ndim != 1 or not np.isfinite(reading_nm).all():
            raise _gap()
        states = np.empty((len(self._weights), 2, reading_nm.size))
        for start in range(0, reading_nm.size, _AT_ONCE):
            part = reading_nm[start : start + _AT_ONCE]
            columns, places = _places(part, self._widths, self._bounds)
            terms = self._weights * (columns[:, None, None] - places) / self._widths[:, None]
            # not along the last axis, where NumPy's order of addition depends on the number of
            # readings
            total = np.add.reduce(terms, axis=2)
            # chunks lie side by side in columns: put their readings one after the other
            in_order = total.transpose(0, 2, 3, 1).reshape(*states.shape[:2], -1)
            states[:, :, start : start + part.size] = in_order[:, :, : part.size]
            self._bounds = places[-1, :, :, -1]
        return states

    def follow_one(self, reading_nm: float) -> FloatArray:
        """Update the state by one reading; return what `follow` does, as (operators, 2)."""
        if not isfinite(reading_nm):
            raise _gap()
        low, high = reading_nm - self._widths, reading_nm + self._widths
        self._bounds = np.maximum(low, np.minimum(high, self._bounds))
        weights = self._weights[:, 0, :, :, 0]  # (operators, widths, 1): one chunk, one reading
        terms = weights * (reading_nm - self._bounds) / self._widths
        return np.asarray(np.add.reduce(terms, axis=1))


def _gap() -> InputError:
    """Return the error for readings that aren't finite."""
    return InputError(
        "readings with gaps (not a number)",
        "finite readings in one row",
        "call forget() after a gap",
    )


class LiveTorque(NamedTuple):
    """Compensated live readings; floats for a single reading that was a float.

    Attributes
    ----------
    torque_nm : float64 array of shape (n,)
        Compensated torque.
    coordinate : float64 array of shape (n,)
        Position in the calibrated loop: +1 rising curve, -1 falling curve.
    half_width_nm : float64 array of shape (n,)
        Root sum of squares of half the interval due to the unknown part of the past, the influence
        of the play operators' weights within the calibrated loop, and the uncertainty beyond it; 0
        on the loop if the past is known. Its standard uncertainty is that of a rectangular
        distribution.
    curve_uncertainty_nm : float64 array of shape (n,)
        Standard uncertainty of the model at this position of the loop; 0 for a table without
        uncertainty.
    middle_nm : float64 array of shape (n,)
        Torque half-way between the two curves of the calibrated loop.
    """

    torque_nm: Any
    coordinate: Any
    half_width_nm: Any
    curve_uncertainty_nm: Any
    middle_nm: Any

    @property
    def standard_uncertainty_nm(self) -> Any:
        """Root sum of squares of `curve_uncertainty_nm` and of `half_width_nm` / √3."""
        return np.sqrt(np.square(self.curve_uncertainty_nm) + np.square(self.half_width_nm) / 3.0)


class HistoryCompensator:
    """Compensate a stream of readings by a branch-aware table and the history of the readings.

    Parameters
    ----------
    table : CompensationTable
        Compiled model.
    operator : HysteresisOperator, optional
        Play operators; fitted to the table by default.
    """

    def __init__(
        self, table: CompensationTable, operator: HysteresisOperator | None = None
    ) -> None:
        self.table = table
        self.operator = HysteresisOperator.from_table(table) if operator is None else operator
        even = HysteresisOperator.generic(self.operator.full_scale_nm, self.operator.path_nm)
        self._grid = self.operator.reference[0]
        self._calibrated = np.concatenate((self.operator.reference[1:], even.reference[1:]))
        self._tracker = BranchTracker((self.operator, even))
        self._unloaded_nm = float(_GENERIC_WIDTHS[0] * self.operator.full_scale_nm)
        self._zero_nm, self._farthest_nm = 0.0, float("inf")

    def copy(self) -> HistoryCompensator:
        """Return a second compensator in the same state."""
        other = copy(self)
        other._tracker = self._tracker.copy()
        return other

    def forget(self) -> None:
        """Discard the history, as after a gap in the readings or a fault."""
        self._tracker.forget()
        self._farthest_nm = float("inf")

    def take_zero(self) -> None:
        """Let the next readings count from a zero that was just taken without load.

        A reading of 0 is a torque of 0 until the first load. What remains after that load is
        hysteresis. A load that moves no play operator leaves nothing.
        """
        self._farthest_nm = float("inf")
        self._zero_nm = self.copy().push(0.0).torque_nm
        self._farthest_nm = 0.0

    def push(self, reading_nm: ArrayLike | float) -> LiveTorque:
        """Compensate the next readings of the stream.

        Parameters
        ----------
        reading_nm : array_like of shape (n,), or float
            Next readings in N·m, finite and in the order of time.
        """
        like: Values
        if isinstance(reading_nm, float):
            like, followed = reading_nm, self._tracker.follow_one(reading_nm)
        else:
            like = np.ascontiguousarray(reading_nm, dtype=np.float64)
            followed = self._tracker.follow(like)
        number, (reading, *states) = elementwise(like, like, *followed.reshape(4, -1))
        # Positions in the loop by the highest and the lowest possible past, with the fitted weights
        # of the play operators, and with even weights.
        calibrated = on_lines(self._calibrated, located(self._grid, reading))
        shares, beyond = _in_loop(number, states[:2], *calibrated[:2])
        even, _ = _in_loop(number, states[2:], *calibrated[2:])
        rising, falling = self.table.curve.branches(reading)
        loop = rising - falling
        amplitude, amplitude_std = self.operator.amplitude_nm, self.operator.amplitude_std_nm
        one, other = (
            falling + share * loop + amplitude * outside
            for share, outside in zip(shares, beyond, strict=True)
        )
        # Half of the torque's interval: unknown past, weights, and the way beyond the loop.
        share = 0.5 * (shares[0] + shares[1])
        by_past = 0.5 * abs(one - other)
        by_weights = (share - 0.5 * (even[0] + even[1])) * loop
        largest = number.maximum(abs(beyond[0]), abs(beyond[1]))
        by_amplitude = (abs(amplitude) + amplitude_std) * largest
        half = number.sqrt(
            by_past * by_past + by_weights * by_weights + by_amplitude * by_amplitude
        )
        u: FloatArray | float = 0.0
        if self.table.uncertainty_curve is not None:
            up, down = self.table.uncertainty_curve.branches(reading)
            u = number.sqrt(share * (up * up) + (1.0 - share) * (down * down))
        middle = 0.5 * (rising + falling)
        torque = 0.5 * (one + other)
        if self._farthest_nm < self._unloaded_nm:
            loaded = self._loaded(reading)
            torque, half = torque - (1.0 - loaded) * self._zero_nm, loaded * half
        return LiveTorque(*in_rows(like, torque, 2.0 * share - 1.0, half, u, middle))

    def _loaded(self, reading_nm: FloatArray | float) -> Any:
        """Return how far the chain was loaded since its zero: 0 not at all, 1 where it counts."""
        sizes = np.abs(np.append(self._farthest_nm, reading_nm))
        farthest = np.maximum.accumulate(sizes)[1:]
        self._farthest_nm = float(np.max(sizes))
        loaded = np.minimum((farthest / self._unloaded_nm) ** 2, 1.0)
        return loaded if isinstance(reading_nm, np.ndarray) else float(loaded[0])


def _in_loop(
    number: Any, states: Sequence[Any], falling: Any, rising: Any
) -> tuple[list[Any], list[Any]]:
    """Return each state's position from falling (0) to rising (1), and its excess beyond both.

    `falling` and `rising` are the states that the calibration passed.
    """
    rising = number.maximum(rising, falling)
    width = number.maximum(rising - falling, 1e-9)
    inside = [number.maximum(falling, number.minimum(rising, state)) for state in states]
    shares = [(state - falling) / width for state in inside]
    return shares, [state - within for state, within in zip(states, inside, strict=True)]


def _filled(wanted: FloatArray, other: FloatArray) -> FloatArray:
    """Fill values missing in one direction from the other direction, then from neighbours."""
    result = np.where(np.isnan(wanted), other, wanted)
    finite = np.flatnonzero(~np.isnan(result))
    return np.asarray(np.interp(np.arange(result.size), finite, result[finite]), dtype=np.float64)
