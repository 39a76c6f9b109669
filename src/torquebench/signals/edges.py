"""Edge times of one channel, as delivered by counter hardware."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message


@dataclass(frozen=True, slots=True, eq=False)
class EdgeBlock:
    """Rising edges of one channel over the half-open interval of ticks [start_tick, stop_tick).

    Parameters
    ----------
    ticks : int64 array, shape (n,)
        Edges, strictly increasing, in ticks of the timebase since its start (absolute, so that
        blocks and channels share one time axis).
    start_tick, stop_tick : int
        The interval that the block covers. The next block starts where this one stops.
    timebase_hz : float
        Frequency of the timebase in Hz (80-100 MHz here). All times inherit its error.

    Raises
    ------
    InputError
        When ticks aren't integers, lie outside the interval, or the timebase isn't positive.
        The counter checks the order of the ticks, so that building a block is fast.

    Examples
    --------
    >>> block = EdgeBlock(np.array([0, 1000, 2000]), 0, 3000, timebase_hz=100e6)
    >>> block.duration_s, len(block)
    (3e-05, 3)
    """

    ticks: NDArray[np.int64]
    start_tick: int
    stop_tick: int
    timebase_hz: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "start_tick", int(self.start_tick))
        object.__setattr__(self, "stop_tick", int(self.stop_tick))
        if not (np.isfinite(self.timebase_hz) and self.timebase_hz > 0):
            raise InputError(
                Message("timebase {timebase_hz} Hz", self.timebase_hz), "a frequency above 0 Hz"
            )
        if self.stop_tick < self.start_tick:
            raise InputError(
                Message(
                    "block from tick {start_tick} to {stop_tick}", self.start_tick, self.stop_tick
                ),
                "stop at or after start",
            )
        ticks = np.asarray(self.ticks)
        if ticks.ndim != 1 or (ticks.size and not np.issubdtype(ticks.dtype, np.integer)):
            raise InputError(
                Message("ticks of type {dtype}, {ndim} dimensions", ticks.dtype, ticks.ndim),
                "one row of integer ticks",
                "convert times by the timebase",
            )
        ticks = np.ascontiguousarray(ticks, dtype=np.int64)
        object.__setattr__(self, "ticks", ticks)
        if ticks.size and not (self.start_tick <= ticks[0] and ticks[-1] < self.stop_tick):
            raise InputError(
                Message("ticks from {first} to {last}", ticks[0], ticks[-1]),
                Message("inside [{start_tick}, {stop_tick})", self.start_tick, self.stop_tick),
            )

    def __len__(self) -> int:
        return int(self.ticks.size)

    @property
    def duration_s(self) -> float:
        """Length of the covered interval in seconds."""
        return (self.stop_tick - self.start_tick) / self.timebase_hz

    @classmethod
    def join(cls, blocks: Sequence[EdgeBlock]) -> EdgeBlock:
        """Concatenate blocks of one channel that follow each other.

        Raises
        ------
        InputError
            A gap between two blocks.
        """
        if len(blocks) == 1:
            return blocks[0]
        for before, after in itertools.pairwise(blocks):
            if after.start_tick != before.stop_tick:
                raise InputError(
                    Message(
                        "edges up to tick {stop_tick} and then from {start_tick}",
                        before.stop_tick,
                        after.start_tick,
                    ),
                    "blocks without a gap",
                )
        return cls(
            np.concatenate([block.ticks for block in blocks]),
            blocks[0].start_tick,
            blocks[-1].stop_tick,
            blocks[0].timebase_hz,
        )
