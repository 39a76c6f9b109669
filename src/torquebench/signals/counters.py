"""Counters: conversion of edge times to a frequency per window, however the stream is divided."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals import _kernels
from torquebench.signals.edges import EdgeBlock
from torquebench.signals.faults import SignalFaultKind
from torquebench.signals.record import Record

CounterMethod = Literal["reciprocal", "regression", "triangular"]
Ticks = NDArray[np.int64]
Counted = tuple[NDArray[np.float64], NDArray[np.uint8]]
"""Rows of centres, frequencies and uncertainties of windows, and their faults."""

_NUMBERS: dict[str, int] = {
    "reciprocal": _kernels.RECIPROCAL,
    "regression": _kernels.REGRESSION,
    "triangular": _kernels.TRIANGULAR,
}
# Edges² x ticks of a window: a regression's sum is at most a sixth of it, and must stay below 2^63.
_LARGEST_SUM = 2.0**65
# Number of edges before a window that its check for irregular intervals needs.
_EDGES_BEFORE = 2
# Up to this number of windows, new and stored edges are joined and counted together, which takes
# less time than a second call.
_FEW_WINDOWS = 8
# Shares of the period: in an interval above the first share, pulses are missing; an edge closer to
# the one before than the second share is doubled. A surplus pulse always splits off an interval
# shorter than this.
_LONG = 1.5
_SHORT = 0.6
# Quantile of the intervals that is used as the period: above the median, so that it is right even
# if every pulse is doubled.
_PERIOD_QUANTILE = 0.7


class FrequencyCounter:
    """Counter of a stream of edge blocks, whose state is carried exactly from block to block.

    Windows are on a fixed grid of the timebase: window k covers the ticks [k·window, (k + 1)·
    window), so all channels of one timebase share their windows, and a stream cut anywhere gives
    the same samples to the last bit. A window that began before the stream did is left out.

    An edge's time has the variance σ_t² = σ_j² + T_c²/12 of its jitter and of the timebase's
    quantisation. From it follow the standard uncertainties, exact for n edges (n(n²−1) instead
    of n³): reciprocal √2 f σ_t/τ, regression √12 f σ_t/(τ√n) (E. Rubiola, M. Lenczner,
    P.-Y. Bourgeois, F. Vernotte, The Ω counter, arXiv:1506.05009), triangular 4 f σ_t/(τ√n).

    They hold where the quantisation errors of successive edges are independent: with jitter
    of about a third of a tick or more, or a period that isn't near a small fraction of ticks.
    A period within about 1/n² of a tick of such a fraction, without any jitter, can be several
    times worse, but never worse than 1.5·T_c/τ relative.

    Parameters
    ----------
    method : {"reciprocal", "regression", "triangular"}
        Counter: first to last edge (Π); least-squares slope (Ω); difference of the mean times of
        the window's two halves (Λ).
    window_s : float
        Length of a window in seconds, rounded to whole ticks.
    timebase_hz : float
        Frequency of the timebase in Hz; each block must have the same.
    edge_jitter_s : float
        Standard deviation σ_j of the edges' own time noise in seconds, for the uncertainty.
    check_train : bool
        Whether to look for missing and doubled pulses; a window with one is a fault.

    Raises
    ------
    InputError
        When a parameter is outside its range.

    Examples
    --------
    >>> counter = FrequencyCounter("regression", window_s=1e-3, timebase_hz=100e6)
    >>> edges = np.arange(0, 300_000, 1600)
    >>> counter.push(EdgeBlock(edges[:100], 0, 160_000, 100e6))["frequency_hz"]
    array([62500.])
    >>> counter.push(EdgeBlock(edges[100:], 160_000, 300_000, 100e6))["time_s"]
    array([0.0015, 0.0025])
    """

    def __init__(
        self,
        method: CounterMethod,
        window_s: float,
        timebase_hz: float,
        *,
        edge_jitter_s: float = 0.0,
        check_train: bool = True,
    ) -> None:
        if method not in _NUMBERS:
            raise InputError(Message("counter {method!r}", method), ", ".join(_NUMBERS))
        if not (timebase_hz > 0 and np.isfinite(timebase_hz)):
            raise InputError(
                Message("timebase {timebase_hz} Hz", timebase_hz), "a frequency above 0 Hz"
            )
        if not (edge_jitter_s >= 0 and np.isfinite(edge_jitter_s)):
            raise InputError(Message("edge jitter {edge_jitter_s} s", edge_jitter_s), "0 s or more")
        ticks = window_s * timebase_hz
        if not (np.isfinite(ticks) and ticks >= 1):
            raise InputError(
                Message("window_s = {window_s} s", window_s),
                Message("at least one tick, {timebase_hz:.3g} s", 1 / timebase_hz),
            )
        self.method: CounterMethod = method
        self.timebase_hz = float(timebase_hz)
        self.window_ticks = round(ticks)
        self._number = _NUMBERS[method]
        self._edge_noise = float(np.sqrt((edge_jitter_s * timebase_hz) ** 2 + 1 / 12))
        self._check_train = check_train
        self._most_edges = (_LARGEST_SUM / self.window_ticks) ** 0.5
        self._kept: Ticks = np.empty(0, dtype=np.int64)  # edges that later windows need
        self._next: int | None = None
        self._stop_tick: int | None = None
        self._lost_until: int | None = None

    def push(self, block: EdgeBlock) -> Record:
        """Count the next block; return the windows that it completes.

        If a block starts later than the previous one stopped, there is a gap: windows that touch it
        have the fault LOST_DATA.

        Returns
        -------
        Record
            `time_s` (centres of the windows), `frequency_hz`, `frequency_uncertainty_hz` (NaN where
            there is a fault) and `fault`.

        Raises
        ------
        InputError
            When the block has another timebase, overlaps the one before or has edges out of order,
            or a regression window is too long for 64-bit sums.
        """
        self._accept(block)
        window = self.window_ticks
        first = -(-block.start_tick // window) if self._next is None else self._next
        self._next = max(block.stop_tick // window, first)
        rows, fault = self._count(block.ticks, first, self._next - first)
        if self._lost_until is not None:
            lost = np.arange(first, self._next) * window < self._lost_until
            rows[1:, lost], fault[lost] = np.nan, SignalFaultKind.LOST_DATA
            if self._next * window >= self._lost_until:
                self._lost_until = None
        time_s, frequency, uncertainty = rows
        return Record.unchecked(
            {
                "time_s": time_s,
                "frequency_hz": frequency,
                "frequency_uncertainty_hz": uncertainty,
                "fault": fault,
            },
            fault.size,
        )

    def _accept(self, block: EdgeBlock) -> None:
        """Check that a block continues the stream, and record a gap before it."""
        if block.timebase_hz != self.timebase_hz:
            raise InputError(
                Message("block with a timebase of {timebase_hz} Hz", block.timebase_hz),
                Message("{timebase_hz} Hz", self.timebase_hz),
            )
        if self._stop_tick is not None and block.start_tick != self._stop_tick:
            if block.start_tick < self._stop_tick:
                raise InputError(
                    Message(
                        "block from tick {start_tick} after one up to {stop_tick}",
                        block.start_tick,
                        self._stop_tick,
                    ),
                    "blocks in order, without overlap",
                )
            self._lost_until = block.start_tick
            self._kept = self._kept[:0]
        self._stop_tick = block.stop_tick

    def _count(self, ticks: Ticks, first: int, size: int) -> Counted:
        """Count windows with the stored edges and the new ones; store what later windows need."""
        joined_windows = size
        if size > _FEW_WINDOWS and ticks.size >= _EDGES_BEFORE:
            begun = int(ticks[_EDGES_BEFORE - 1]) // self.window_ticks + 1 - first
            joined_windows = min(max(begun, 0), size)
        rest = size - joined_windows
        stop = ticks.searchsorted((first + joined_windows) * self.window_ticks) if rest else None
        edges = np.concatenate((self._kept, ticks[:stop]))
        rows, fault, end = self._counted(edges, first, joined_windows, self._check_train)
        if rest:
            edges = ticks
            others = self._counted(ticks, first + joined_windows, rest, self._check_train)
            rows, fault = np.concatenate((rows, others[0]), axis=1), np.append(fault, others[1])
            end = others[2]
        self._kept = edges[max(end - _EDGES_BEFORE, 0) :].copy()
        return rows, fault

    def _counted(self, ticks: Ticks, first: int, size: int, check: bool) -> tuple[Any, Any, int]:
        """Count windows; with `check`, inspect those with an irregular train.

        Return their rows and faults, and the index of the first edge after them.
        """
        rows, fault = np.empty((3, size)), np.empty(size, dtype=np.uint8)
        wrong, suspects, most, end = _kernels.count(
            ticks,
            first,
            self.window_ticks,
            self._number,
            check,
            self.timebase_hz,
            self._edge_noise,
            rows,
            fault,
        )
        if wrong >= 0:
            raise InputError(
                Message(
                    "edge at tick {tick} after one at {before}", ticks[wrong], ticks[wrong - 1]
                ),
                "strictly increasing edges",
            )
        if self.method == "regression" and most >= self._most_edges:
            raise InputError(
                Message(
                    "regression whose edges² x ticks are {largest:.3g}",
                    float(most) ** 2 * self.window_ticks,
                ),
                Message("below {high:.3g}", _LARGEST_SUM),
                "use shorter windows and average them",
            )
        if suspects:
            self._inspect(ticks, first, rows, fault)
        return rows, fault, end

    def _inspect(
        self, ticks: Ticks, first: int, rows: NDArray[np.float64], fault: NDArray[np.uint8]
    ) -> None:
        """Decide for windows with an irregular train whether pulses are missing or doubled."""
        for index in np.flatnonzero(fault == _kernels.SUSPECT).tolist():
            window = first + index
            start, stop = window * self.window_ticks, (window + 1) * self.window_ticks
            low, high = ticks.searchsorted((start, stop))
            train = irregularities(ticks[max(low - 1, 0) : high], stop)
            if train.missing or train.stopped:
                fault[index] = SignalFaultKind.MISSING_PULSES
            elif train.doubled:
                fault[index] = SignalFaultKind.DOUBLED_PULSES
            else:
                one = slice(index, index + 1)
                rows[:, one], fault[one], _ = self._counted(ticks, window, 1, check=False)


class Irregularities(NamedTuple):
    """Missing and doubled pulses in an interval of a pulse train.

    Parameters
    ----------
    missing, doubled : int
        Number of missing and of doubled pulses.
    stopped : bool
        Whether the train had stopped before the end of the interval.
    """

    missing: int
    doubled: int
    stopped: bool


def irregularities(ticks: NDArray[np.int64], stop_tick: int | None = None) -> Irregularities:
    """Count missing and doubled pulses of a train of nearly constant frequency.

    Parameters
    ----------
    ticks : int64 array, shape (n,)
        Edges, increasing.
    stop_tick : int, optional
        End of the interval, to check whether the train stopped before it.

    Returns
    -------
    Irregularities
        Zero and False for a train with fewer than two edges.

    Examples
    --------
    >>> irregularities(np.array([0, 100, 200, 400, 500, 510, 600, 700]))
    Irregularities(missing=1, doubled=1, stopped=False)
    """
    intervals = np.diff(ticks)
    if not intervals.size:
        return Irregularities(0, 0, False)
    period = np.sort(intervals)[int(_PERIOD_QUANTILE * intervals.size)]
    doubled = 0
    if intervals.min() < _SHORT * period:
        single = [int(ticks[0])]
        for tick in ticks[1:].tolist():
            if tick - single[-1] < _SHORT * period:
                doubled += 1
            else:
                single.append(tick)
        intervals = np.diff(single)
    long = intervals[intervals > _LONG * period]
    missing = int(np.sum(np.rint(long / period).astype(np.int64) - 1))
    stopped = stop_tick is not None and bool(stop_tick - ticks[-1] > _LONG * period)
    return Irregularities(missing, doubled, stopped)
