"""Encoders that the counter doesn't time: their positions are polled between its blocks."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import inf
from typing import Protocol

import numpy as np

from torquebench.bench.blocks import Block
from torquebench.bench.drivers.base import CounterCard, Drive, Identity, Positioned
from torquebench.bench.roles import SIDES, Side, angle_channel
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals import Record

RECENT_PARTS = 100
"""Number of parts among which the fastest one relates both clocks, which differ slowly."""
LEAST_DISTANCE_S = 1e-4
"""Least time between two polls, so that a speed between them is finite."""
POLLS = 2
"""Number of polls in a block, one at the end of each part: the fewest that give a speed."""


class AngleSource(Protocol):
    """A source of the angles of both sides, to be polled."""

    def counts(self) -> Mapping[Side, int]:
        """Request the present encoder counts of each side, unwrapped, clockwise positive."""

    def close(self) -> None:
        """Release it. A second call does nothing."""


@dataclass
class CounterWithAngles:
    """A counter without encoder inputs, combined with a source of angles.

    A block is read in `POLLS` parts, and the positions are polled at the end of each part. In real
    time a poll is as late as the computer was; the part that arrived fastest of the last ones
    relates the computer's clock to the counter's. Their times are known to the duration of a poll,
    some milliseconds. That is enough for standstill, speed limits and friction, but not for
    transmission error.

    Parameters
    ----------
    window_s : float
        The counter's window: parts are whole windows.
    in_real_time : bool
        Whether the counter's time is that of the wall; simulated time stands during a poll.
    """

    counter: CounterCard
    source: AngleSource
    window_s: float
    in_real_time: bool
    _delays: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT_PARTS))
    _polled_s: float = -inf

    @property
    def shortest_read_s(self) -> float:
        """Infinite: a block is never read in slices, because `read_block` divides it itself."""
        return float("inf")

    @property
    def timebase_hz(self) -> float:
        """Nominal frequency of the counter's clock, Hz."""
        return self.counter.timebase_hz

    @property
    def clock_identity(self) -> str:
        """Identity of the clock that counts."""
        return self.counter.clock_identity

    def identity(self) -> Identity:
        """Read the identity of the counter."""
        return self.counter.identity()

    def select(self, channels: frozenset[str]) -> None:
        """Time only these channels."""
        self.counter.select(channels)

    def read_block(self, duration_s: float) -> Block:
        """Return the next block with the positions polled in the meantime."""
        parts: list[Block] = []
        polled: list[Mapping[Side, int]] = []
        times: list[float] = []
        windows = max(POLLS, round(duration_s / self.window_s))
        borders = [windows * k // POLLS for k in range(POLLS + 1)]
        for first, last in pairwise(borders):
            parts.append(self.counter.read_block((last - first) * self.window_s))
            asked_s = time.monotonic()
            polled.append(self.source.counts())
            times.append(self._time_s(parts[-1].stop_s, asked_s, time.monotonic()))
        angles = {
            angle_channel(side): Record(
                {
                    "time_s": np.array(times),
                    "angle_counts": np.array([c[side] for c in polled], np.int64),
                }
            )
            for side in SIDES
        }
        block = Block.join(parts)
        return replace(block, records={**block.records, **angles})

    def _time_s(self, part_s: float, asked_s: float, answered_s: float) -> float:
        """Return the time of a poll after a part of a block, by the counter's clock."""
        polled_s = part_s
        if self.in_real_time:
            self._delays.append(asked_s - part_s)
            polled_s = 0.5 * (asked_s + answered_s) - min(self._delays)
        self._polled_s = max(polled_s, self._polled_s + LEAST_DISTANCE_S)
        return self._polled_s

    def close(self) -> None:
        """Release both."""
        self.source.close()
        self.counter.close()


def unwrapped(word: int, before: int | None) -> int:
    """Return the counts of a 32-bit position, unwrapped to continue the earlier counts.

    Examples
    --------
    >>> unwrapped(-(2**31), 2**31 - 1), unwrapped(7, None)
    (2147483648, 7)
    """
    if before is None:
        return word
    return before + (word - before + 2**31) % 2**32 - 2**31


class DriveAngles:
    """Positions from the drives' own encoders, clockwise positive at the shaft.

    Parameters
    ----------
    drives : mapping of side to Drive
        Drives that are `Positioned`.

    Raises
    ------
    InputError
        A drive's protocol states no position.
    """

    def __init__(self, drives: Mapping[Side, Drive]) -> None:
        self._drives: dict[Side, Positioned] = {}
        self._position: dict[Side, int] = {}
        for side, drive in drives.items():
            if isinstance(drive, Positioned):
                self._drives[side] = drive
            else:
                raise InputError(
                    Message("driver.{side}_drive states no position", side),
                    "a drive that does, for driver.angles.protocol = 'drives'",
                    "choose another source of the angles",
                )

    def counts(self) -> Mapping[Side, int]:
        """Request both drives' positions, and unwrap their 32 bits."""
        for side, drive in self._drives.items():
            word = drive.position_counts()
            self._position[side] = unwrapped(word, self._position.get(side))
        return dict(self._position)

    def close(self) -> None:
        """Do nothing: the caller closes the drives."""
