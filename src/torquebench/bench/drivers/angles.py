"""Encoders that the counter doesn't time: positions that are polled between its blocks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from torquebench.bench.drivers.base import Block, CounterCard, Drive, Identity
from torquebench.bench.roles import SIDES, Side, angle_channel
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals import Record

__all__ = ["AngleSource", "CounterWithAngles", "DriveAngles", "unwrapped", "with_angles"]

POLLS = 2
"""Positions a block: the fewest that give a speed. Each ends a part of the block."""


class AngleSource(Protocol):
    """States the angles of both sides when asked."""

    def counts(self) -> Mapping[Side, int]:
        """Ask for the encoder counts of each side now, unwrapped, clockwise positive."""

    def close(self) -> None:
        """Release it. A second call does nothing."""


@dataclass
class CounterWithAngles:
    """A counter without encoder inputs, and the source of the angles.

    A block is read in `POLLS` parts and the position polled at the end of each: its time is known
    as well as the poll is quick, some milliseconds. That is enough for standstill, speed limits
    and friction, not for transmission error.

    Parameters
    ----------
    counter : CounterCard
    source : AngleSource
    window_s : float
        The counter's window: parts are whole windows.
    """

    counter: CounterCard
    source: AngleSource
    window_s: float

    @property
    def shortest_read_s(self) -> float:
        """A block is read whole: half of it ends at each poll."""
        return float("inf")

    @property
    def timebase_hz(self) -> float:
        """Nominal frequency of the counter's clock, Hz."""
        return self.counter.timebase_hz

    @property
    def clock_identity(self) -> str:
        """Which clock counts."""
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
        windows = max(POLLS, round(duration_s / self.window_s))
        borders = [windows * k // POLLS for k in range(POLLS + 1)]
        for first, last in pairwise(borders):
            parts.append(self.counter.read_block((last - first) * self.window_s))
            polled.append(self.source.counts())
        time_s = np.array([part.stop_s for part in parts])
        angles = {
            angle_channel(side): Record(
                {"time_s": time_s, "angle_counts": np.array([c[side] for c in polled], np.int64)}
            )
            for side in SIDES
        }
        block = Block.join(parts)
        return replace(block, records={**block.records, **angles})

    def close(self) -> None:
        """Release both."""
        self.source.close()
        self.counter.close()


def unwrapped(word: int, before: int | None) -> int:
    """Return the counts of a 32-bit position that continues those before.

    Examples
    --------
    >>> unwrapped(-(2**31), 2**31 - 1), unwrapped(7, None)
    (2147483648, 7)
    """
    if before is None:
        return word
    return before + (word - before + 2**31) % 2**32 - 2**31


class DriveAngles:
    """The positions that the drives' own encoders state, clockwise positive at the shaft.

    Parameters
    ----------
    drives : mapping of side to Drive
        Each states `position_counts`.

    Raises
    ------
    InputError
        A drive's protocol states no position.
    """

    def __init__(self, drives: Mapping[Side, Drive]) -> None:
        self._drives: Mapping[Side, Any] = drives
        self._position: dict[Side, int] = {}
        for side, drive in drives.items():
            motor = getattr(drive, "drive", drive)  # behind a gear
            if not hasattr(motor, "position_counts"):
                raise InputError(
                    Message("driver.{side}_drive states no position", side),
                    "a drive that does, for driver.angles.protocol = 'drives'",
                    "choose another source of the angles",
                )

    def counts(self) -> Mapping[Side, int]:
        """Ask both drives; the wrapping of 32 bits is undone."""
        for side, drive in self._drives.items():
            word = drive.position_counts()
            self._position[side] = unwrapped(word, self._position.get(side))
        return dict(self._position)

    def close(self) -> None:
        """Do nothing: the drives are closed by those who opened them."""


def with_angles(counter: CounterCard, source: AngleSource, window_s: float) -> CounterWithAngles:
    """Return a counter card that takes its angles from another source."""
    return CounterWithAngles(counter, source, window_s)
