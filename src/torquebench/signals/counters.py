"""Counters on streams: edge times in, frequency per window out, independent of the blocks."""

from collections.abc import Sequence
from typing import TypedDict, Unpack

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals._kernels import mark_repeats
from torquebench.signals.edges import EdgeBlock
from torquebench.signals.faults import SignalFaultKind
from torquebench.signals.samples import FrequencySamples
from torquebench.signals.windows import CounterMethod, WindowCounter

__all__ = [
    "CounterOptions",
    "FrequencyCounter",
    "StreamOptions",
    "WindowStream",
    "gated",
    "reciprocal",
    "regression",
    "triangular",
]

# Edges before a window that its check for irregular intervals needs.
_EDGES_BEFORE = 2
# This few windows are joined with the stored edges and counted at once, which costs less than a
# second call.
_FEW_WINDOWS = 8


class _Train:
    """Edges of one polarity that later windows need, and the two before them."""

    def __init__(self) -> None:
        self._kept: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def windows_at_seam(self, ticks: NDArray[np.int64], starts: NDArray[np.int64]) -> int:
        """Count the first windows that need edges from before these."""
        if ticks.size < _EDGES_BEFORE:
            return starts.size
        return int(starts.searchsorted(ticks[_EDGES_BEFORE - 1], side="right"))

    def joined(self, ticks: NDArray[np.int64], stop: int) -> NDArray[np.int64]:
        """Join the kept edges with the new ones before a tick."""
        return np.concatenate((self._kept, ticks[: ticks.searchsorted(stop)]))

    def keep(self, ticks: NDArray[np.int64], from_tick: int) -> None:
        """Keep what windows from `from_tick` on need."""
        first = int(ticks.searchsorted(from_tick))
        if first >= _EDGES_BEFORE:
            self._kept = ticks[first - _EDGES_BEFORE :].copy()
            return
        joined = np.concatenate((self._kept, ticks))
        first = int(joined.searchsorted(from_tick))
        self._kept = joined[max(first - _EDGES_BEFORE, 0) :].copy()

    def forget(self) -> None:
        self._kept = self._kept[:0]


class StreamOptions(TypedDict, total=False):
    """Options that all counters on streams have."""

    edge_jitter_s: float
    both_edges: bool
    check_train: bool
    stuck_windows: int | None


class WindowStream:
    """Counter over windows of a stream of edge blocks; the windows come from the caller.

    `FrequencyCounter` feeds it windows of time, `AngleCounter` windows of angle.

    Parameters
    ----------
    method : {"gated", "reciprocal", "regression", "triangular"}
        The counter.
    timebase_hz : float
        Timebase of every block in Hz.
    edge_jitter_s : float
        Standard deviation of the edges' own time noise in seconds, for the uncertainty.
    both_edges : bool
        Use falling edges too.
    check_train : bool
        Look for missing and doubled pulses.
    stuck_windows : int or None
        So many equal numbers in a row are a fault.
    """

    def __init__(
        self,
        method: CounterMethod,
        timebase_hz: float,
        *,
        edge_jitter_s: float = 0.0,
        both_edges: bool = False,
        check_train: bool = True,
        stuck_windows: int | None = 25,
    ) -> None:
        if stuck_windows is not None and stuck_windows < 2:
            raise InputError(
                Message("stuck_windows = {stuck_windows}", stuck_windows), "2 or more, or None"
            )
        self._counter = WindowCounter(
            method, timebase_hz, edge_jitter_s=edge_jitter_s, check_train=check_train
        )
        self._trains = [_Train(), _Train()] if both_edges else [_Train()]
        # A gate's counts naturally repeat.
        self._stuck_windows = None if method == "gated" else stuck_windows
        self._last_frequency = np.nan
        self._repeats = 0
        self._stop_tick: int | None = None
        self._lost_until: int | None = None

    @property
    def method(self) -> CounterMethod:
        """The counter's method."""
        return self._counter.method

    @property
    def timebase_hz(self) -> float:
        """Timebase in Hz."""
        return self._counter.timebase_hz

    @property
    def stop_tick(self) -> int | None:
        """Tick up to which the stream has been read; None before the first block."""
        return self._stop_tick

    def accept(self, block: EdgeBlock) -> None:
        """Check that a block continues the stream, and note a gap before it."""
        if block.timebase_hz != self.timebase_hz:
            raise InputError(
                Message("block with a timebase of {timebase_hz} Hz", block.timebase_hz),
                Message("{timebase_hz} Hz", self.timebase_hz),
            )
        if len(self._trains) > 1 and block.falling_ticks is None:
            raise InputError("block without falling edges", "rising and falling edges")
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
            for train in self._trains:
                train.forget()
        self._stop_tick = block.stop_tick

    def count(
        self,
        block: EdgeBlock,
        starts: NDArray[np.int64],
        stops: NDArray[np.int64],
        next_start: int,
    ) -> FrequencySamples:
        """Count windows that end within an accepted block; keep the edges from `next_start` on.

        Parameters
        ----------
        block : EdgeBlock
            The block that was accepted last.
        starts, stops : int64 arrays, shape (n,)
            Windows, in order, that end at or before the block's end.
        next_start : int
            Start of the first window still to come.
        """
        new = [block.ticks]
        if len(self._trains) > 1 and block.falling_ticks is not None:
            new.append(block.falling_ticks)
        pairs = list(zip(self._trains, new, strict=True))
        samples = self._counter.room(starts.size)
        head = starts.size
        if head > _FEW_WINDOWS:
            head = max(train.windows_at_seam(ticks, starts) for train, ticks in pairs)
        if head:
            stop = int(stops[head - 1])
            joined = [train.joined(ticks, stop) for train, ticks in pairs]
            self._counter.fill(samples, slice(0, head), joined, starts[:head], stops[:head])
        if head < starts.size:
            # Most of a long block is counted in place.
            rest = slice(head, starts.size)
            self._counter.fill(samples, rest, new, starts[rest], stops[rest])
        for train, ticks in pairs:
            train.keep(ticks, next_start)
        if self._lost_until is not None:
            samples = samples.marked(
                starts < self._lost_until, SignalFaultKind.LOST_DATA, over_others=True
            )
            if next_start >= self._lost_until:
                self._lost_until = None
        return self._mark_stuck(samples)

    def _mark_stuck(self, samples: FrequencySamples) -> FrequencySamples:
        if self._stuck_windows is None:
            return samples
        self._last_frequency, self._repeats, marked = mark_repeats(
            samples.frequency_hz,
            samples.fault,
            self._stuck_windows,
            int(SignalFaultKind.STUCK),
            self._last_frequency,
            self._repeats,
        )
        if marked:
            stuck = samples.fault == SignalFaultKind.STUCK
            samples.frequency_hz[stuck] = np.nan
            samples.standard_uncertainty_hz[stuck] = np.nan
        return samples


class FrequencyCounter:
    """Counter on a stream of edge blocks, with its state carried over block borders exactly.

    Windows are on a fixed grid of the timebase: window k covers the ticks [k·step, k·step +
    window), so all channels of one timebase share their windows, and a stream cut anywhere gives
    the same samples to the last bit. A window that began before the stream did is left out.

    Parameters
    ----------
    method : {"gated", "reciprocal", "regression", "triangular"}
        Counter: edges per gate; first to last edge (Π); least-squares slope (Ω); difference of
        the mean times of the window's two halves (Λ).
    window_s : float
        Length of a window in seconds, rounded to whole ticks.
    timebase_hz : float
        Frequency of the timebase in Hz; each block must have the same.
    edge_jitter_s : float
        Standard deviation of the edges' own time noise in seconds, for the uncertainty.
    step_s : float, optional
        Distance of the windows in seconds; shorter than the window they slide. The window's
        length when not given.
    both_edges : bool
        Use rising and falling edges, whatever the duty cycle.
    check_train : bool
        Look for missing and doubled pulses; a window that has one is a fault.
    stuck_windows : int, optional
        So many windows in a row with the same number to the last bit are a stuck counter: real
        edges have jitter. None switches the check off; a gated counter never has it.

    Raises
    ------
    InputError
        When a parameter is outside its range.

    Examples
    --------
    >>> counter = FrequencyCounter("regression", window_s=1e-3, timebase_hz=100e6)
    >>> edges = np.arange(0, 300_000, 1600)
    >>> counter.push(EdgeBlock(edges[:100], 0, 160_000, 100e6)).frequency_hz
    array([62500.])
    >>> samples = counter.push(EdgeBlock(edges[100:], 160_000, 300_000, 100e6))
    >>> samples.time_s, samples.edges
    (array([0.0015, 0.0025]), array([62, 63]))
    """

    def __init__(
        self,
        method: CounterMethod,
        window_s: float,
        timebase_hz: float,
        *,
        step_s: float | None = None,
        **options: Unpack[StreamOptions],
    ) -> None:
        self._stream = WindowStream(method, timebase_hz, **options)
        self.window_ticks = _whole_ticks(window_s, timebase_hz, "window_s")
        self.step_ticks = (
            self.window_ticks if step_s is None else _whole_ticks(step_s, timebase_hz, "step_s")
        )
        self._next: int | None = None

    @property
    def method(self) -> CounterMethod:
        """The counter's method."""
        return self._stream.method

    @property
    def timebase_hz(self) -> float:
        """Timebase in Hz."""
        return self._stream.timebase_hz

    def push(self, block: EdgeBlock) -> FrequencySamples:
        """Take the next block; return the samples of all windows that it completes.

        A block that starts after the one before it stopped leaves a gap: the windows that touch
        the gap carry the fault LOST_DATA.

        Parameters
        ----------
        block : EdgeBlock
            The next edges of the stream.

        Raises
        ------
        InputError
            When the block has another timebase, overlaps the stream, lacks falling edges that
            are needed, or its edges don't increase.
        """
        self._stream.accept(block)
        step, window = self.step_ticks, self.window_ticks
        first = -(-block.start_tick // step) if self._next is None else self._next
        self._next = max((block.stop_tick - window) // step + 1, first)
        borders = np.arange(first, self._next + 1, dtype=np.int64) * step
        starts = borders[:-1]
        stops = borders[1:] if window == step else starts + window
        return self._stream.count(block, starts, stops, self._next * step)


class CounterOptions(StreamOptions, total=False):
    """Options of `FrequencyCounter` that the one-call functions take too."""

    step_s: float | None


Blocks = EdgeBlock | Sequence[EdgeBlock]


def gated(blocks: Blocks, window_s: float, **options: Unpack[CounterOptions]) -> FrequencySamples:
    """Frequency by counting edges per gate: n/τ, quantised to 1/τ.

    Parameters
    ----------
    blocks : EdgeBlock or sequence of EdgeBlock
        The stream, whole or cut.
    window_s : float
        Gate in seconds.
    **options
        As for `FrequencyCounter`.

    Examples
    --------
    >>> block = EdgeBlock(np.arange(0, 1_000_000, 1666), 0, 1_000_000, 100e6)
    >>> samples = gated(block, 10e-3)
    >>> samples.frequency_hz, samples.standard_uncertainty_hz.round(1)
    (array([60100.]), array([40.8]))
    """
    return _count(blocks, "gated", window_s, options)


def reciprocal(
    blocks: Blocks, window_s: float, **options: Unpack[CounterOptions]
) -> FrequencySamples:
    """Frequency by the time from the first to the last edge of a window (Π counter).

    Parameters are those of `gated`.

    Examples
    --------
    >>> block = EdgeBlock(np.arange(0, 1_000_000, 1666), 0, 1_000_000, 100e6)
    >>> reciprocal(block, 10e-3).frequency_hz.round(3)
    array([60024.01])
    """
    return _count(blocks, "reciprocal", window_s, options)


def regression(
    blocks: Blocks, window_s: float, **options: Unpack[CounterOptions]
) -> FrequencySamples:
    """Frequency by least squares through all edges of a window (Ω counter).

    The best there is for white noise of the edges' times (arXiv:1506.05009). Parameters are
    those of `gated`.

    Examples
    --------
    >>> block = EdgeBlock(np.arange(0, 1_000_000, 1666), 0, 1_000_000, 100e6)
    >>> samples = regression(block, 10e-3)
    >>> samples.frequency_hz.round(3), samples.standard_uncertainty_hz.round(4)
    (array([60024.01]), array([0.0024]))
    """
    return _count(blocks, "regression", window_s, options)


def triangular(
    blocks: Blocks, window_s: float, **options: Unpack[CounterOptions]
) -> FrequencySamples:
    """Frequency by the mean times of a window's two halves (Λ counter).

    Within 15 % of the regression's noise, with additions only. Parameters are those of `gated`.

    Examples
    --------
    >>> block = EdgeBlock(np.arange(0, 1_000_000, 1666), 0, 1_000_000, 100e6)
    >>> triangular(block, 10e-3).frequency_hz.round(3)
    array([60024.01])
    """
    return _count(blocks, "triangular", window_s, options)


def _count(
    blocks: Blocks, method: CounterMethod, window_s: float, options: CounterOptions
) -> FrequencySamples:
    stream = [blocks] if isinstance(blocks, EdgeBlock) else list(blocks)
    if not stream:
        raise InputError("no block of edges", "at least one")
    counter = FrequencyCounter(method, window_s, stream[0].timebase_hz, **options)
    return FrequencySamples.concatenate([counter.push(block) for block in stream])


def _whole_ticks(duration_s: float, timebase_hz: float, name: str) -> int:
    ticks = duration_s * timebase_hz
    if not (np.isfinite(ticks) and ticks >= 1):
        raise InputError(
            Message("{name} = {duration_s} s", name, duration_s),
            Message("at least one tick, {timebase_hz:.3g} s", 1 / timebase_hz),
        )
    return round(ticks)
