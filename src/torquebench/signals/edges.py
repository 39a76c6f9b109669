"""Edge times of one channel, as delivered by counter hardware."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["EdgeBlock", "as_ticks"]


def as_ticks(values: ArrayLike, name: str = "ticks") -> NDArray[np.int64]:
    """Take integer ticks as a contiguous int64 array; refuse anything that isn't integer.

    Parameters
    ----------
    values : array_like of int, shape (n,)
        Ticks of the timebase.
    name : str
        Name in error messages.

    Raises
    ------
    InputError
        When the values aren't a one-dimensional array of integers.
    """
    array = np.asarray(values)
    if array.dtype == np.int64 and array.ndim == 1 and array.flags.c_contiguous:
        return array
    if array.ndim != 1:
        raise InputError(
            Message("{name} with {ndim} dimensions", name, array.ndim), "one dimension"
        )
    if array.size == 0:
        return np.empty(0, dtype=np.int64)
    if not np.issubdtype(array.dtype, np.integer):
        raise InputError(
            Message("{name} of type {dtype}", name, array.dtype),
            "integer ticks",
            "convert times by the timebase",
        )
    return np.ascontiguousarray(array, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class EdgeBlock:
    """Edges of one channel over the half-open interval of ticks [start_tick, stop_tick).

    Parameters
    ----------
    ticks : int64 array, shape (n,)
        Rising edges, strictly increasing, in ticks of the timebase since its start
        (absolute, so that blocks and channels share one time axis).
    start_tick, stop_tick : int
        The interval that the block covers. The next block starts where this one stops.
    timebase_hz : float
        Frequency of the timebase in Hz (80-100 MHz here). All times inherit its error.
    falling_ticks : int64 array, shape (m,), optional
        Falling edges, likewise, when the counter times both.

    Raises
    ------
    InputError
        When ticks aren't integers, lie outside the interval, or the timebase isn't positive.
        `validate` and the counters check the order of the ticks, so that building a block is fast.

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
    falling_ticks: NDArray[np.int64] | None = None

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
        object.__setattr__(self, "ticks", self._inside(self.ticks, "ticks"))
        if self.falling_ticks is not None:
            object.__setattr__(
                self, "falling_ticks", self._inside(self.falling_ticks, "falling_ticks")
            )

    def _inside(self, values: ArrayLike, name: str) -> NDArray[np.int64]:
        ticks = as_ticks(values, name)
        if ticks.size and not (self.start_tick <= ticks[0] and ticks[-1] < self.stop_tick):
            raise InputError(
                Message("{name} from {first} to {last}", name, ticks[0], ticks[-1]),
                Message("inside [{start_tick}, {stop_tick})", self.start_tick, self.stop_tick),
            )
        return ticks

    def __len__(self) -> int:
        return int(self.ticks.size)

    @property
    def duration_s(self) -> float:
        """Length of the covered interval in seconds."""
        return (self.stop_tick - self.start_tick) / self.timebase_hz

    def validate(self) -> "EdgeBlock":
        """Check that all edges are strictly increasing; return the block itself.

        Raises
        ------
        InputError
            When an edge isn't later than the one before it.
        """
        for name, ticks in (("ticks", self.ticks), ("falling_ticks", self.falling_ticks)):
            if ticks is None:
                continue
            wrong = np.flatnonzero(np.diff(ticks) <= 0)
            if wrong.size:
                at = int(wrong[0])
                raise InputError(
                    Message(
                        "{name}[{at}] = {tick} after {before}",
                        name,
                        at + 1,
                        ticks[at + 1],
                        ticks[at],
                    ),
                    "strictly increasing edges",
                )
        return self
