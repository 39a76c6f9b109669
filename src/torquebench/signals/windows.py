"""Counters over any windows of a train of edges: fixed, sliding or synchronous with an angle."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.signals import _kernels
from torquebench.signals.edges import as_ticks
from torquebench.signals.faults import SignalFaultKind
from torquebench.signals.pulse_train import irregularities
from torquebench.signals.samples import FrequencySamples

__all__ = ["CounterMethod", "WindowCounts", "count_windows", "samples_of", "windows_of_angle"]

CounterMethod = Literal["gated", "reciprocal", "regression", "triangular"]

_NUMBERS: dict[str, int] = {
    "gated": _kernels.GATED,
    "reciprocal": _kernels.RECIPROCAL,
    "regression": _kernels.REGRESSION,
    "triangular": _kernels.TRIANGULAR,
}
# n²·window/6 of a regression must stay below this, or its integer sums overflow.
_LARGEST_SUM = 2.0**62


@dataclass(frozen=True, slots=True, eq=False)
class WindowCounts:
    """Integer results of one counter over n windows of one or two trains of edges.

    Parameters
    ----------
    method : {"gated", "reciprocal", "regression", "triangular"}
        The counter.
    trains : int
        Trains in the sums: 1, or 2 for rising and falling edges.
    edges, numerator, denominator : int64 arrays, shape (n,)
        Edges counted; the period is numerator/denominator in ticks (a sixth of the denominator
        for the regression).
    fault : uint8 array, shape (n,)
        `SignalFaultKind` codes.
    missing, doubled : int32 arrays, shape (n,)
        Irregular pulses.
    """

    method: CounterMethod
    trains: int
    edges: NDArray[np.int64]
    numerator: NDArray[np.int64]
    denominator: NDArray[np.int64]
    fault: NDArray[np.uint8]
    missing: NDArray[np.int32]
    doubled: NDArray[np.int32]

    @classmethod
    def empty(cls, method: CounterMethod, windows: int) -> "WindowCounts":
        """Make room for the results of so many windows of one train."""
        if method not in _NUMBERS:
            raise InputError(f"counter {method!r}", ", ".join(_NUMBERS))
        return cls(
            method=method,
            trains=1,
            edges=np.empty(windows, dtype=np.int64),
            numerator=np.empty(windows, dtype=np.int64),
            denominator=np.empty(windows, dtype=np.int64),
            fault=np.empty(windows, dtype=np.uint8),
            missing=np.zeros(windows, dtype=np.int32),
            doubled=np.zeros(windows, dtype=np.int32),
        )

    def part(self, windows: slice) -> "WindowCounts":
        """Return a view of some of the windows."""
        return WindowCounts(
            method=self.method,
            trains=self.trains,
            edges=self.edges[windows],
            numerator=self.numerator[windows],
            denominator=self.denominator[windows],
            fault=self.fault[windows],
            missing=self.missing[windows],
            doubled=self.doubled[windows],
        )

    def pooled(self, other: "WindowCounts") -> "WindowCounts":
        """Pool with a further train of the same frequency, such as the falling edges.

        Each train keeps its own phase, so a duty cycle other than a half does no harm.
        """
        return WindowCounts(
            method=self.method,
            trains=self.trains + other.trains,
            edges=self.edges + other.edges,
            numerator=self.numerator + other.numerator,
            denominator=self.denominator + other.denominator,
            fault=np.where(self.fault != 0, self.fault, other.fault),
            missing=self.missing + other.missing,
            doubled=self.doubled + other.doubled,
        )

    def fill(
        self,
        ticks: NDArray[np.int64],
        starts: NDArray[np.int64],
        stops: NDArray[np.int64],
        check_train: bool = True,
    ) -> None:
        """Count the windows [starts, stops) of one train into this room; see `count_windows`."""
        wrong, suspects, most, longest = _kernels.count(
            ticks,
            starts,
            stops,
            _NUMBERS[self.method],
            self.edges,
            self.numerator,
            self.denominator,
            self.fault,
        )
        if wrong >= 0:
            raise InputError(
                f"edge at tick {ticks[wrong]} after one at {ticks[wrong - 1]}",
                "strictly increasing edges",
            )
        if self.method == "regression" and float(most) ** 2 * longest / 6 >= _LARGEST_SUM:
            raise InputError(
                f"regression over {most} edges in {longest:.4g} ticks",
                f"edges² x ticks below {6 * _LARGEST_SUM:.3g}",
                "use shorter windows and average them",
            )
        if suspects:
            for window in np.flatnonzero(self.fault == _kernels.SUSPECT):
                self.fault[window] = SignalFaultKind.NONE
                if check_train:
                    self._inspect(int(window), ticks, starts, stops)

    def _inspect(
        self,
        window: int,
        ticks: NDArray[np.int64],
        starts: NDArray[np.int64],
        stops: NDArray[np.int64],
    ) -> None:
        first, last = np.searchsorted(ticks, (starts[window], stops[window]))
        found = irregularities(ticks[max(first - 1, 0) : last], int(stops[window]))
        self.missing[window] = found.missing
        self.doubled[window] = found.doubled
        if found.missing or found.stopped:
            self.fault[window] = SignalFaultKind.MISSING_PULSES
        elif found.doubled:
            self.fault[window] = SignalFaultKind.DOUBLED_PULSES


def count_windows(
    ticks: ArrayLike,
    starts: ArrayLike,
    stops: ArrayLike,
    method: CounterMethod = "regression",
    *,
    check_train: bool = True,
) -> WindowCounts:
    """Run a counter over any windows of one train of edges.

    Parameters
    ----------
    ticks : array_like of int, shape (m,)
        Edges, strictly increasing.
    starts, stops : array_like of int, shape (n,)
        Half-open windows [start, stop) in ticks; neither may decrease. They may overlap
        (sliding windows), touch, or leave gaps.
    method : {"gated", "reciprocal", "regression", "triangular"}
        The counter.
    check_train : bool
        Look for missing and doubled pulses. Switch it off for trains whose frequency may jump
        by more than a half from one pulse to the next, such as a starting encoder.

    Returns
    -------
    WindowCounts
        Exact integers; `samples_of` turns them into frequency.

    Raises
    ------
    InputError
        When edges don't increase, windows decrease, or a regression window is too long for
        64-bit sums.

    Examples
    --------
    >>> counts = count_windows(np.arange(0, 100_000, 1600), [0, 50_000], [50_000, 100_000])
    >>> counts.edges
    array([32, 31])
    >>> samples_of(counts, [0, 50_000], [50_000, 100_000], timebase_hz=100e6).frequency_hz
    array([62500., 62500.])
    """
    first = as_ticks(starts, "starts")
    last = as_ticks(stops, "stops")
    if first.shape != last.shape:
        raise InputError(f"{first.size} starts and {last.size} stops", "as many of each")
    if np.any(np.diff(first) < 0) or np.any(np.diff(last) < 0) or np.any(last <= first):
        raise InputError("windows that decrease or are empty", "ordered windows, start < stop")
    counts = WindowCounts.empty(method, first.size)
    counts.fill(as_ticks(ticks), first, last, check_train)
    return counts


def samples_of(
    counts: WindowCounts,
    starts: ArrayLike,
    stops: ArrayLike,
    *,
    timebase_hz: float,
    edge_jitter_s: float = 0.0,
) -> FrequencySamples:
    """Turn counts into frequency samples with their standard uncertainty.

    An edge's time has the variance σ_t² = σ_j² + T_c²/12 of its jitter and of the timebase's
    quantisation. From it follow the standard uncertainties of physics.md, exact for n edges
    (n(n²−1) instead of n³): gated 1/(√6 τ), reciprocal √2 f σ_t/τ, regression
    √12 f σ_t/(τ√n) (E. Rubiola, M. Lenczner, P.-Y. Bourgeois, F. Vernotte, The Ω counter,
    arXiv:1506.05009), triangular 4 f σ_t/(τ√n).

    They hold where the quantisation errors of successive edges are independent: with jitter
    of about a third of a tick or more, or a period that isn't near a small fraction of ticks.
    A period within about 1/n² of a tick of such a fraction, without any jitter, can be several
    times worse, but never worse than 1.5·T_c/τ relative.

    Parameters
    ----------
    counts : WindowCounts
        From `count_windows`.
    starts, stops : array_like of int, shape (n,)
        The same windows.
    timebase_hz : float
        Timebase in Hz.
    edge_jitter_s : float
        Standard deviation σ_j of the edges' own time noise in seconds.
    """
    time, frequency, uncertainty = (np.empty(counts.edges.size) for _ in range(3))
    edge_noise = float(np.sqrt((edge_jitter_s * timebase_hz) ** 2 + 1 / 12))
    _kernels.frequencies(
        as_ticks(starts, "starts"),
        as_ticks(stops, "stops"),
        counts.numerator,
        counts.denominator,
        counts.fault,
        _NUMBERS[counts.method],
        counts.trains,
        float(timebase_hz),
        edge_noise,
        time,
        frequency,
        uncertainty,
    )
    return FrequencySamples(
        time_s=time,
        fault=counts.fault,
        frequency_hz=frequency,
        edges=counts.edges,
        standard_uncertainty_hz=uncertainty,
        missing=counts.missing,
        doubled=counts.doubled,
    )


def windows_of_angle(
    mark_ticks: ArrayLike, marks_per_window: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Windows that are synchronous with an angle: each spans so many marks of an encoder.

    Parameters
    ----------
    mark_ticks : array_like of int, shape (n,)
        Edges of the encoder's channel on the same timebase.
    marks_per_window : int
        Marks (encoder periods) in a window.

    Returns
    -------
    starts, stops : int64 arrays
        For `count_windows`. Marks after the last whole window are left over.

    Examples
    --------
    >>> windows_of_angle([0, 10, 20, 30, 40, 50], 2)
    (array([ 0, 20]), array([20, 40]))
    """
    if marks_per_window < 1:
        raise InputError(f"{marks_per_window} marks per window", "1 or more")
    borders = as_ticks(mark_ticks, "mark_ticks")[::marks_per_window]
    return borders[:-1].copy(), borders[1:].copy()
