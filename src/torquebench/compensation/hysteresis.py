"""Hysteresis with memory: the branch of a live reading follows from the readings before it.

A reading that reverses in mid-range is on neither branch of the calibrated loop. Its place
between them follows from the state of play (backlash) operators of several widths w, which the
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
never measured. The place within the loop is therefore also computed with equal weights, and the
difference counts as an uncertainty; beyond the loop the whole amplitude is uncertain.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.compensation.piecewise import evaluate_piecewise, interpolated
from torquebench.compensation.table import CompensationTable
from torquebench.errors import InputError
from torquebench.kernels import inner, kernel
from torquebench.message import Message

__all__ = [
    "BranchTracker",
    "HistoryCompensator",
    "HysteresisOperator",
    "LiveTorque",
    "one_sided_path",
    "reversing_path",
]

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


def reversing_path(full_scale_nm: float) -> FloatArray:
    """Return the turning points of a calibration in cycles 0 → +FS → 0 → −FS → 0, in N·m."""
    return full_scale_nm * np.array([0.0, 1.0, -1.0, 1.0, -1.0, 0.0])


@kernel
def _follow(reading, operators, low, high):  # type: ignore[no-untyped-def] # Numba infers
    """Move the play operators along the readings.

    The rows of `operators` are widths, weights, and the lower and upper bounds of their states.
    """
    widths, weights, lowest, highest = operators[0], operators[1], operators[2], operators[3]
    for k in range(reading.size):
        x = reading[k]
        state_low = 0.0
        state_high = 0.0
        for j in range(widths.size):
            width = widths[j]
            lowest[j] = max(x - width, min(x + width, lowest[j]))
            highest[j] = max(x - width, min(x + width, highest[j]))
            state_low += weights[j] * (x - highest[j]) / width
            state_high += weights[j] * (x - lowest[j]) / width
        low[k] = state_low
        high[k] = state_high


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
        Compensated torque after a long rise less that half-way, at the same reading.
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

        Returns
        -------
        HysteresisOperator
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
        """Fit the play operators' loop along the calibration's path to the model's.

        The widths are the generic ones; their weights follow from how the model's two branches
        part and meet (non-negative least squares).

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
        rising, falling = _rising_and_falling(table, grid)
        parts = np.column_stack(
            [generic._only(play)._loop_width_at(grid) for play in range(generic.widths_nm.size)]
        )
        std = 0.0
        if table.uncertainty_curve is not None and table.curve.branch_aware:
            std = float(np.mean(table.standard_uncertainty(grid, np.ones(grid.size))))
        return replace(generic._weighted(parts, rising - falling), amplitude_std_nm=std)

    def tracker(self) -> BranchTracker:
        """Return a tracker without history."""
        return BranchTracker(self)

    def _only(self, play: int) -> HysteresisOperator:
        return HysteresisOperator(
            self.widths_nm[play : play + 1],
            np.ones(1),
            self.amplitude_nm,
            self.path_nm,
            self.full_scale_nm,
        )

    def _weighted(self, parts: FloatArray, loop: FloatArray) -> HysteresisOperator:
        """Fit the operators' weights, smooth over the widths, to a loop."""
        from scipy.optimize import nnls  # imported late: a chain without loops doesn't need it

        # neighbouring widths have similar weights: without that, noise would select single widths
        bend = np.diff(np.eye(parts.shape[1]), 2, axis=0)
        scale = float(np.sqrt(np.sum(parts**2) / parts.shape[1]))
        rows = [np.vstack([sign * parts, scale * bend]) for sign in (1.0, -1.0)]
        goal = np.append(loop, np.zeros(len(bend)))
        solutions = [nnls(row, goal) for row in rows]
        sign = 1.0 if solutions[0][1] <= solutions[1][1] else -1.0
        shares = solutions[0 if sign > 0 else 1][0]
        total = float(np.sum(shares))
        if total <= 1e-7 * self.full_scale_nm:
            return self
        kept = shares > 1e-6 * total
        return HysteresisOperator(
            self.widths_nm[kept],
            shares[kept] / total,
            sign * total,
            self.path_nm,
            self.full_scale_nm,
        )

    @cached_property
    def _grid(self) -> FloatArray:
        largest = max(float(np.max(np.abs(self.path_nm))), self.full_scale_nm)
        steps = int(np.ceil(_REFERENCE_STEPS * largest / self.full_scale_nm))
        step = self.full_scale_nm / _REFERENCE_STEPS
        return step * np.arange(-steps, steps + 1, dtype=np.float64)

    @cached_property
    def reference(self) -> FloatArray:
        """Readings, and the states that the calibration passed there, falling and rising."""
        falling, rising = np.full((2, self._grid.size), np.nan)
        tracker = self.tracker()
        # a calibration starts at rest, with the operators in the middle
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
        grid, falling, rising = self.reference
        width = np.interp(reading, grid, rising) - np.interp(reading, grid, falling)
        return np.asarray(np.maximum(width, 0.0))


class BranchTracker:
    """Follows the state of the play operators along a stream of readings.

    The result depends on the readings only, not on how the stream is cut into blocks.

    Parameters
    ----------
    operator : HysteresisOperator
        Widths and weights of the play operators.

    Examples
    --------
    >>> tracker = HysteresisOperator.generic(100.0).tracker()
    >>> low, high = tracker.push([0.0, 100.0, -100.0, 100.0])
    >>> low.round(3).tolist(), high.round(3).tolist()
    ([-0.912, 1.0, -1.0, 1.0], [0.912, 1.0, -1.0, 1.0])
    """

    def __init__(self, operator: HysteresisOperator) -> None:
        self.operator = operator
        self._operators = np.empty((4, len(operator.widths_nm)))
        self._operators[0], self._operators[1] = operator.widths_nm, operator.weights
        self.forget()

    def forget(self) -> None:
        """Take the past as unknown, as after a gap in the readings or with another mounting.

        Limited by full scale only: no operator is farther out than full scale less its width.
        """
        largest = max(self.operator.full_scale_nm, float(np.max(np.abs(self.operator.path_nm))))
        self._operators[3] = np.maximum(largest - self._operators[0], 0.0)
        self._operators[2] = -self._operators[3]

    def settle(self, reading_nm: float) -> None:
        """Start from a demagnetised state at a reading: every operator in its middle."""
        self._operators[2:] = reading_nm

    def copy(self) -> BranchTracker:
        """Return another tracker in the same state."""
        other = BranchTracker(self.operator)
        other._operators = self._operators.copy()
        return other

    def push(self, reading_nm: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Move along the next readings of the stream.

        Parameters
        ----------
        reading_nm : array_like of shape (n,)
            Next readings in N·m, in the order of time.

        Returns
        -------
        low, high : float64 array of shape (n,)
            Bounds of the state at each reading, -1 to 1; equal where the past is known.

        Raises
        ------
        InputError
            When a reading is not a number.
        """
        reading = np.ascontiguousarray(reading_nm, dtype=np.float64)
        if reading.ndim != 1 or not np.all(np.isfinite(reading)):
            raise _gaps()
        low, high = np.empty((2, reading.size))
        _follow(reading, self._operators, low, high)
        return low, high


def _gaps() -> InputError:
    return InputError(
        "readings with gaps (not a number)",
        "finite readings in one row",
        "call forget() after a gap",
    )


class LiveTorque(NamedTuple):
    """Compensated live readings.

    Attributes
    ----------
    torque_nm : float64 array of shape (n,)
        Compensated torque.
    coordinate : float64 array of shape (n,)
        Place in the calibrated loop: +1 rising curve, -1 falling curve.
    half_width_nm : float64 array of shape (n,)
        Root sum of squares of half the interval due to the unknown part of the past, the influence
        of the play operators' weights within the calibrated loop, and the uncertainty beyond it; 0
        on the loop if the past is known. Its standard uncertainty is that of a rectangular
        distribution.
    fault : bool array of shape (n,)
        True where the reading is outside the calibrated range.
    standard_uncertainty_nm : float64 array of shape (n,)
        Root sum of squares of `curve_uncertainty_nm` and of `half_width_nm` / √3.
    curve_uncertainty_nm : float64 array of shape (n,)
        The model's own at this place of the loop; 0 for a table without uncertainty.
    middle_nm : float64 array of shape (n,)
        Torque half-way between the two curves of the calibrated loop.
    """

    torque_nm: FloatArray
    coordinate: FloatArray
    half_width_nm: FloatArray
    fault: NDArray[np.bool_]
    standard_uncertainty_nm: FloatArray
    curve_uncertainty_nm: FloatArray
    middle_nm: FloatArray


class HistoryCompensator:
    """Compensates a stream of readings by a branch-aware table and the readings' own history.

    Parameters
    ----------
    table : CompensationTable
        Compiled model.
    operator : HysteresisOperator, optional
        From the table itself where not given.
    """

    def __init__(
        self, table: CompensationTable, operator: HysteresisOperator | None = None
    ) -> None:
        self.table = table
        self.operator = HysteresisOperator.from_table(table) if operator is None else operator
        self.tracker = self.operator.tracker()
        self._even = HysteresisOperator.generic(self.operator.full_scale_nm, self.operator.path_nm)
        self._even_tracker = self._even.tracker()

    def copy(self) -> HistoryCompensator:
        """Return another compensator in the same state."""
        other = copy(self)
        other.tracker, other._even_tracker = self.tracker.copy(), self._even_tracker.copy()
        return other

    def push(self, reading_nm: ArrayLike) -> LiveTorque:
        """Compensate the next readings of the stream.

        Parameters
        ----------
        reading_nm : array_like of shape (n,)
            Next readings in N·m, in the order of time.

        Returns
        -------
        LiveTorque
        """
        reading = np.ascontiguousarray(reading_nm, dtype=np.float64)
        curve, spread = self.table.curve, self.table.uncertainty_curve
        result = np.empty((6, reading.size))
        outside = _compensate(
            reading,
            (self.tracker._operators, self._even_tracker._operators),
            (self.operator.reference, self._even.reference),
            curve.packed,
            (curve if spread is None else spread).packed,
            (curve.branch_aware, spread is not None and spread.branch_aware, spread is not None),
            (self.operator.amplitude_nm, self.operator.amplitude_std_nm),
            result,
        )
        if outside < 0:
            raise _gaps()
        fault = np.zeros(reading.size, dtype=np.bool_)
        if outside:
            fault = (reading < self.table.reading_low_nm) | (reading > self.table.reading_high_nm)
        return LiveTorque(result[0], result[1], result[2], fault, *result[3:])

    def forget(self) -> None:
        """Discard the history, as after a gap in the readings or a fault."""
        self.tracker.forget()
        self._even_tracker.forget()


@kernel
def _compensate(reading, operators, references, curve, spread, flags, amplitude, result):  # type: ignore[no-untyped-def] # Numba infers
    """Move both sets of play operators along the readings and fill in what `_mix` does.

    Return the number of readings outside the table, or -1, without moving anything, if one isn't
    finite. The flags are whether curve and spread have branches, and whether there is a spread.
    """
    count = reading.size
    for k in range(count):
        if not np.isfinite(reading[k]):
            return -1
    states = np.empty((8, count))
    for number in range(2):
        first = 4 * number
        _follow(reading, operators[number], states[first], states[first + 1])
        grid, falling, rising = references[number]
        for k in range(count):
            lower = interpolated(reading[k], grid, falling)
            states[first + 2, k] = lower
            states[first + 3, k] = max(interpolated(reading[k], grid, rising), lower)
    both, branch = np.empty(2 * count), np.empty(2 * count, dtype=np.int8)
    for k in range(count):
        both[k] = both[count + k] = reading[k]
        branch[k] = 1 if reading[k] >= 0.0 else -1
        branch[count + k] = -branch[k]
    torque, std = np.empty(2 * count), np.empty(2 * count if flags[2] else 0)
    outside = evaluate_piecewise(both, branch[: 2 * count * flags[0]], torque, *curve)
    if flags[2]:
        evaluate_piecewise(both, branch[: 2 * count * flags[1]], std, *spread)
    others = (states[4], states[5], states[6], states[7])
    low, high, falling, rising = states[0], states[1], states[2], states[3]
    _mix(low, high, falling, rising, torque, std, amplitude, others, result)
    return outside


@inner
def _mix(  # type: ignore[no-untyped-def] # Numba infers
    low, high, falling, rising, torque, std, amplitude, others, result
):
    """Fill in torque, place, half-width, uncertainties and middle between the bounds of the state.

    `torque` and `std` hold the rising curve's values and then the falling one's, `amplitude` the
    loop's amplitude and its standard uncertainty, and `others` the bounds of the state and both
    curves for equal weights.
    """
    count = low.size
    bound = np.empty(2)
    place = np.empty(2)
    for k in range(count):
        bottom, top = others[2][k], others[3][k]
        nearest = max(bottom, min(top, others[0][k])) - bottom
        other = nearest / max(top - bottom, 1e-9)
        nearest = max(bottom, min(top, others[1][k])) - bottom
        other = (other + nearest / max(top - bottom, 1e-9)) / 2.0  # 0 falling, 1 rising
        width = max(rising[k] - falling[k], 1e-9)
        farthest = 0.0
        for side in range(2):
            state = low[k] if side == 0 else high[k]
            inside = max(falling[k], min(rising[k], state))
            share = (inside - falling[k]) / width
            beyond = amplitude[0] * (state - inside)
            bound[side] = torque[count + k] + share * (torque[k] - torque[count + k]) + beyond
            place[side] = 2.0 * share - 1.0
            farthest = max(farthest, abs(state - inside))
        result[0, k] = 0.5 * (bound[0] + bound[1])
        result[1, k] = 0.5 * (place[0] + place[1])
        by_past = 0.5 * abs(bound[1] - bound[0])
        by_weights = (0.5 + 0.5 * result[1, k] - other) * (torque[k] - torque[count + k])
        by_amplitude = (abs(amplitude[0]) + amplitude[1]) * farthest
        half_width = np.sqrt(by_past**2 + by_weights**2 + by_amplitude**2)
        curve = 0.0
        if std.size > 0:
            share = 0.5 * (1.0 + result[1, k])
            curve = np.sqrt(share * std[k] ** 2 + (1.0 - share) * std[count + k] ** 2)
        result[2, k] = half_width
        result[3, k] = np.sqrt(curve * curve + half_width * half_width / 3.0)
        result[4, k] = curve
        result[5, k] = 0.5 * (torque[k] + torque[count + k])


def _rising_and_falling(
    table: CompensationTable, reading: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return torque on the rising and on the falling curve of the signed torque."""
    upward = np.where(reading >= 0.0, 1, -1).astype(np.int8)
    return table.torque(reading, upward), table.torque(reading, -upward)


def _filled(wanted: FloatArray, other: FloatArray) -> FloatArray:
    """Fill readings never passed in one direction from the other, then from neighbours."""
    result = np.where(np.isnan(wanted), other, wanted)
    known = np.flatnonzero(~np.isnan(result))
    return np.asarray(np.interp(np.arange(result.size), known, result[known]), dtype=np.float64)
