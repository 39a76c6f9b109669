"""Samples of one block of bench time, and the recent ones."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.acceleration import Acceleration
from torquebench.bench.drivers.base import AngleSamples
from torquebench.bench.roles import Side, torque_channel
from torquebench.chain import Torque
from torquebench.signals import EdgeBlock, SignalFaultKind, TorqueSamples

__all__ = [
    "FAST_WINDOW_S",
    "FINE_WINDOW_S",
    "AcquiredBlock",
    "ChannelSamples",
    "FineCount",
    "SampleRing",
    "Stretch",
    "Viewer",
]

FINE_WINDOW_S = 0.002
"""Windows of a finely resolved interval, s: they resolve a drive's ripple of some 10 Hz."""
FAST_WINDOW_S = 0.001
"""Windows of steps of torque, s: they resolve the vibration of a shaft, up to 400 Hz."""


@dataclass(frozen=True, slots=True, eq=False)
class ChannelSamples:
    """Windows of one torque channel that one block completed.

    Parameters
    ----------
    channel : str
        One of `CHANNELS`.
    side : str
    standard : bool
        Whether it is the mounted standard's transducer.
    time_s : ndarray of float64, shape (n,)
        Centres of the windows in bench time, s.
    frequency_hz, torque_nm : ndarray of float64, shape (n,)
        NaN where `fault` isn't 0. The torque of a standard is corrected by its certificate; a
        module's torque is its reading, uncompensated.
    fault : ndarray of uint8, shape (n,)
        `SignalFaultKind` codes.
    counter_nm : ndarray of float64, shape (n,), or None
        Standard uncertainty of the reading by counting, N·m; None for an instrument that doesn't
        state it.
    """

    channel: str
    side: Side
    standard: bool
    time_s: NDArray[np.float64]
    frequency_hz: NDArray[np.float64]
    torque_nm: NDArray[np.float64]
    fault: NDArray[np.uint8]
    counter_nm: NDArray[np.float64] | None = None

    def raise_on_fault(self) -> None:
        """Raise `SignalFault` for the first faulty window, if there is one."""
        if self.fault.any():
            TorqueSamples(
                time_s=self.time_s,
                fault=self.fault,
                torque_nm=self.torque_nm,
                standard_uncertainty_nm=self.torque_nm,
            ).raise_on_fault(self.channel)

    @property
    def fault_kind(self) -> SignalFaultKind:
        """Fault of the last window."""
        return SignalFaultKind(int(self.fault[-1])) if self.fault.size else SignalFaultKind.NONE


class FineCount(Protocol):
    """Shorter windows of one channel, counted when a stretch of blocks is evaluated.

    Attributes
    ----------
    window_s : float
        Their length, s.
    """

    window_s: float

    def count(self, edges: Sequence[EdgeBlock]) -> list[TorqueSamples]:
        """Return the windows that each of the next blocks completes."""


@dataclass(frozen=True, slots=True, eq=False)
class AcquiredBlock:
    """All data of one block of bench time.

    Parameters
    ----------
    index : int
        Number of the block since the bench was opened.
    start_s, stop_s : float
        Bench time, s.
    channels : mapping of channel name to ChannelSamples
        The channels in use.
    angles : mapping of side to AngleSamples
    speed_rad_s : mapping of side to float
        Mean speed over the block.
    temperatures : mapping of probe to °C
    edges : mapping of channel name to EdgeBlock
        The raw edges.
    fine : mapping of channel name to FineCount
        Shorter windows of the finely counted channels. Supervision doesn't need them.
    accelerations : mapping of side to Acceleration
        Over the block; a side without sufficient encoder data is missing.
    compensated : mapping of side to Torque
        Only sides with an active measuring chain: torque and uncertainty of the windows of its
        channel, NaN where the reading has a fault or lies outside the calibrated range. Empty as
        long as the block is judged; see `Stretch`.
    """

    index: int
    start_s: float
    stop_s: float
    channels: Mapping[str, ChannelSamples]
    angles: Mapping[Side, AngleSamples]
    speed_rad_s: Mapping[Side, float]
    temperatures: Mapping[str, float]
    edges: Mapping[str, EdgeBlock]
    fine: Mapping[str, FineCount] = field(default_factory=dict)
    accelerations: Mapping[Side, Acceleration] = field(default_factory=dict)
    compensated: Mapping[Side, Torque] = field(default_factory=dict)

    def follows(self, before: AcquiredBlock) -> bool:
        """Whether the same signals go on from another block without a gap."""
        return (
            self.channels.keys() == before.channels.keys()
            and self.fine == before.fine
            and self.temperatures.keys() == before.temperatures.keys()
            and self.speed_rad_s.keys() == before.speed_rad_s.keys()
            and self.angles.keys() == before.angles.keys()
            and all(
                (each.time_s.size > 0) == (before.angles[side].time_s.size > 0)
                for side, each in self.angles.items()
            )
            and all(
                samples.time_s.size > 0
                and (earlier := before.channels[name].time_s).size > 1
                and samples.time_s[0] - earlier[-1] < 1.5 * (earlier[-1] - earlier[-2])
                for name, samples in self.channels.items()
            )
        )


@dataclass(frozen=True, slots=True, eq=False)
class Stretch:
    """Consecutive blocks of the same signals, and their compensated torque.

    Parameters
    ----------
    blocks : tuple of AcquiredBlock
        At least one.
    compensated : mapping of side to Torque
        Of all windows, as in `AcquiredBlock`.
    """

    blocks: tuple[AcquiredBlock, ...]
    compensated: Mapping[Side, Torque] = field(default_factory=dict)

    def channel(self, name: str) -> ChannelSamples | None:
        """Return the windows of a channel; None if it isn't in use."""
        first = self.blocks[0].channels.get(name)
        if first is None or len(self.blocks) == 1:
            return first
        parts = [block.channels[name] for block in self.blocks]
        return ChannelSamples(
            first.channel,
            first.side,
            first.standard,
            np.concatenate([each.time_s for each in parts]),
            np.concatenate([each.frequency_hz for each in parts]),
            np.concatenate([each.torque_nm for each in parts]),
            np.concatenate([each.fault for each in parts]),
            _joined([each.counter_nm for each in parts]),
        )

    def angles(self, side: Side) -> AngleSamples | None:
        """Return the samples of an encoder; None without any."""
        first = self.blocks[0].angles.get(side)
        if first is None or len(self.blocks) == 1:
            return first
        parts = [block.angles[side] for block in self.blocks]
        return AngleSamples(
            np.concatenate([each.time_s for each in parts]),
            np.concatenate([each.counts for each in parts]),
            first.counts_per_revolution,
        )

    def windows(self, name: str, values: Sequence[float]) -> NDArray[np.float64] | float:
        """Return for each window of a channel its block's value."""
        if len(self.blocks) == 1:
            return float(values[0])
        counts = [block.channels[name].time_s.size for block in self.blocks]
        return np.repeat(np.asarray(values, dtype=np.float64), counts)

    def each(self) -> Iterator[AcquiredBlock]:
        """Yield the blocks, each with its compensated torque."""
        if len(self.blocks) == 1:  # in real time every block is
            yield replace(self.blocks[0], compensated=self.compensated)
            return
        first = dict.fromkeys(self.compensated, 0)
        for block in self.blocks:
            parts: dict[Side, Torque] = {}
            for side, torque in self.compensated.items():
                count = block.channels[torque_channel(side)].time_s.size
                parts[side] = torque.at(np.arange(first[side], first[side] + count))
                first[side] += count
            yield replace(block, compensated=parts)


def _joined(parts: Sequence[NDArray[np.float64] | None]) -> NDArray[np.float64] | None:
    """Concatenate columns of blocks; None where a block has none."""
    known = [each for each in parts if each is not None]
    return np.concatenate(known) if known and len(known) == len(parts) else None


class SampleRing:
    """The most recent rows of some columns over time, for one writer and many readers.

    Parameters
    ----------
    columns : int
        Columns beside the time.
    capacity : int
        Rows that are kept at least.

    Examples
    --------
    >>> ring = SampleRing(columns=1, capacity=4)
    >>> for second in range(6):
    ...     ring.append(np.array([float(second)]), np.array([10.0 * second]))
    >>> ring.window(3.5, 9.0)
    array([[ 4.,  5.],
           [40., 50.]])
    """

    def __init__(self, columns: int, capacity: int) -> None:
        self._capacity = capacity
        self._rows = np.empty((columns + 1, 2 * capacity))
        self._start = self._stop = 0
        self._lock = threading.Lock()

    def append(self, time_s: NDArray[np.float64], *columns: NDArray[np.generic]) -> None:
        """Append rows whose times go on from those before."""
        count = time_s.size
        with self._lock:
            if self._stop + count > self._rows.shape[1]:
                kept = min(self._capacity, self._stop - self._start)
                self._rows[:, :kept] = self._rows[:, self._stop - kept : self._stop]
                self._start, self._stop = 0, kept
            place = slice(self._stop, self._stop + count)
            self._rows[0, place] = time_s
            for index, column in enumerate(columns, start=1):
                self._rows[index, place] = column
            self._stop += count
            self._start = max(self._start, self._stop - self._capacity)

    def window(self, start_s: float, stop_s: float) -> NDArray[np.float64]:
        """Copy of the rows with start <= time < stop, shape (1 + columns, n)."""
        with self._lock:
            time = self._rows[0, self._start : self._stop]
            first, last = np.searchsorted(time, (start_s, stop_s)) + self._start
            return self._rows[:, first:last].copy()

    def tail(self, count: int) -> NDArray[np.float64]:
        """Copy of the newest rows, shape (1 + columns, at most count)."""
        with self._lock:
            first = max(self._start, self._stop - max(count, 0))
            return self._rows[:, first : self._stop].copy()

    def last(self) -> NDArray[np.float64] | None:
        """Copy of the newest row, shape (1 + columns,); None before the first one."""
        with self._lock:
            if self._stop == self._start:
                return None
            return self._rows[:, self._stop - 1].copy()


@dataclass(eq=False)
class Viewer:
    """A watcher's bounded queue of blocks: it drops the oldest and counts the dropped ones.

    Never critical: acquisition neither waits for a viewer nor fails with it.
    """

    maximum: int = 100
    dropped: int = 0
    _blocks: deque[AcquiredBlock] = field(default_factory=deque)
    _condition: threading.Condition = field(default_factory=threading.Condition)

    def put(self, block: AcquiredBlock) -> None:
        """Take a block (called by acquisition)."""
        with self._condition:
            if len(self._blocks) >= self.maximum:
                self._blocks.popleft()
                self.dropped += 1
            self._blocks.append(block)
            self._condition.notify()

    def get(self, timeout_s: float = 1.0) -> AcquiredBlock | None:
        """Return the oldest block that is waiting; None when none comes in time."""
        with self._condition:
            if not self._blocks:
                self._condition.wait(timeout_s)
            return self._blocks.popleft() if self._blocks else None
