"""Glitch filter: removes edges caused by bouncing before anything is counted."""

import numpy as np
from numba import int64
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.kernels import kernel
from torquebench.message import Message
from torquebench.signals.edges import EdgeBlock

__all__ = ["GlitchFilter"]


@kernel
def _after_dead_time(ticks, last, least, kept):  # type: ignore[no-untyped-def] # Numba infers
    """Keep edges that come `least` ticks or more after the one kept before."""
    count = 0
    for tick in ticks:
        if tick - last >= least:
            kept[count] = tick
            count += 1
            last = tick
    return count


@kernel
def _without_short_pulses(ticks, least, waiting, kept):  # type: ignore[no-untyped-def] # Numba infers
    """Leave out both edges of every pulse and pause shorter than `least` ticks."""
    count = waiting.size
    kept[:count] = waiting
    for tick in ticks:
        if count and tick - kept[count - 1] < least:
            count -= 1
        else:
            kept[count] = tick
            count += 1
    return count


class GlitchFilter:
    """Filter of a stream of edge blocks against chatter and spikes.

    With rising edges alone, an edge sooner than the least time after the one kept before is left
    out (dead time). With both edges, every pulse and every pause shorter than the least time is
    left out with both its edges, so that only lasting levels remain; the stream then ends the least
    time before its last block, since a pulse is only decided then.

    Parameters
    ----------
    least_s : float
        Least time in seconds: above the longest chatter, below the shortest real pulse (or
        period, for rising edges alone).
    timebase_hz : float
        Timebase of the stream in Hz.
    both_edges : bool
        Use rising and falling edges.

    Examples
    --------
    >>> chatter = GlitchFilter(0.2e-6, 100e6)
    >>> block = EdgeBlock(np.array([1000, 1005, 2000, 3000]), 0, 4000, 100e6)
    >>> chatter.push(block).ticks, chatter.removed
    (array([1000, 2000, 3000]), 1)
    """

    def __init__(self, least_s: float, timebase_hz: float, *, both_edges: bool = False) -> None:
        ticks = least_s * timebase_hz
        if not (np.isfinite(ticks) and ticks >= 1):
            raise InputError(
                Message("least time {least_s} s", least_s),
                Message("one tick or more, {timebase_hz} s", 1 / timebase_hz),
            )
        self.least_ticks = round(ticks)
        self.timebase_hz = float(timebase_hz)
        self.both_edges = both_edges
        self.removed = 0
        self._last = int(np.iinfo(np.int64).min // 2)
        self._waiting: NDArray[np.int64] = np.empty(0, dtype=np.int64)
        # Kind of the first waiting edge, or of the next one to come.
        self._rises: bool | None = None
        self._stop_tick: int | None = None
        self._decided_until = 0

    def push(self, block: EdgeBlock) -> EdgeBlock:
        """Take the next block; return the remaining edges that are decided.

        `removed` counts the edges left out so far.

        Raises
        ------
        InputError
            When the block has another timebase, lacks falling edges that are needed, doesn't
            continue the stream, or its edges don't alternate.
        """
        if block.timebase_hz != self.timebase_hz:
            raise InputError(
                Message("timebase {timebase_hz} Hz", block.timebase_hz),
                Message("{timebase_hz} Hz", self.timebase_hz),
            )
        if self.both_edges:
            return self._push_both(block)
        kept = np.empty_like(block.ticks)
        count = _after_dead_time(block.ticks, self._last, self.least_ticks, kept)
        self.removed += block.ticks.size - count
        if count:
            self._last = int(kept[count - 1])
        return EdgeBlock(kept[:count], block.start_tick, block.stop_tick, block.timebase_hz)

    def _push_both(self, block: EdgeBlock) -> EdgeBlock:
        if block.falling_ticks is None:
            raise InputError("block without falling edges", "rising and falling edges")
        if self._stop_tick is not None and block.start_tick != self._stop_tick:
            raise InputError(
                Message("block from tick {start_tick}", block.start_tick),
                Message("the next from tick {stop_tick}", self._stop_tick),
            )
        if self._stop_tick is None:
            self._decided_until = block.start_tick
        self._stop_tick = block.stop_tick
        edges, first_rises = _interleaved(block.ticks, block.falling_ticks)
        waiting = self._waiting.size
        if edges.size:
            if self._rises is None:
                self._rises = first_rises
            elif first_rises != self._rises ^ bool(waiting % 2):
                raise InputError("two edges of one kind in a row", "alternating edges")
        kept = np.empty(waiting + edges.size, dtype=np.int64)
        count = _without_short_pulses(edges, int64(self.least_ticks), self._waiting, kept)
        self.removed += kept.size - count
        return self._decide(kept[:count], block)

    def _decide(self, kept: NDArray[np.int64], block: EdgeBlock) -> EdgeBlock:
        """Return the edges that no later edge can remove."""
        start = self._decided_until
        self._decided_until = max(block.stop_tick - self.least_ticks, start)
        decided = int(np.searchsorted(kept, self._decided_until))
        rising, falling = kept[0:decided:2], kept[1:decided:2]
        if self._rises is False:
            rising, falling = falling, rising
        self._waiting = kept[decided:].copy()
        if self._rises is not None:
            self._rises ^= bool(decided % 2)
        return EdgeBlock(rising, start, self._decided_until, block.timebase_hz, falling)


def _interleaved(
    rising: NDArray[np.int64], falling: NDArray[np.int64]
) -> tuple[NDArray[np.int64], bool]:
    """All edges in order, and whether the first rises."""
    edges = np.concatenate((rising, falling))
    order = np.argsort(edges, kind="stable")
    rises = order < rising.size
    if np.any(rises[1:] == rises[:-1]):
        raise InputError("two edges of one kind in a row", "alternating edges")
    return edges[order], bool(rises[0]) if rises.size else True
