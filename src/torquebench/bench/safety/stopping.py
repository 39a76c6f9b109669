"""The way to the safe state: zero, power off, and both read back before work continues.

A drive that takes an order hasn't carried it out. So its power state and the torque at its side
are read after every stop, until both are gone.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum

from torquebench.bench.blocks import Block
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES, Side, reference_channel, torque_channel
from torquebench.bench.safety.drives import DriveWorker
from torquebench.message import Message

__all__ = ["PRESS_STOP", "Deadline", "ReadBack", "Remaining", "Stage", "said"]

PRESS_STOP = (
    "press the emergency stop and keep away from the bench; then find out why the drive doesn't "
    "go off"
)
NO_SET_POINT = 1e-3
"""A set point below this share of the range is zero."""


class Stage(Enum):
    """Stages of the way to the safe state."""

    SAFE = "safe"
    RAMPING = "ramping to zero"
    GOING_OFF = "going off"
    NOT_SAFE = "not safe"


class Deadline:
    """A time-out in bench time; in wall time while bench time stands.

    Parameters
    ----------
    clock : BenchClock
    lasts_s : float
        From now on.
    longest_wall_s : float
        Limit by the wall clock, s.
    """

    def __init__(self, clock: BenchClock, lasts_s: float, longest_wall_s: float) -> None:
        self._clock = clock
        self._bench_s = clock.now() + lasts_s
        self._wall_s = time.monotonic() + longest_wall_s

    def passed(self, now_s: float | None = None) -> bool:
        """Whether it is over, at a bench time or now."""
        now_s = self._clock.now() if now_s is None else now_s
        return now_s > self._bench_s - 1e-6 or time.monotonic() > self._wall_s


@dataclass(frozen=True)
class Remaining:
    """Remaining torque and power of one side after a stop, as read back.

    Parameters
    ----------
    side : {"input", "output"}
    power : bool or None
        None where the drive doesn't say.
    torque_nm : float
        NaN if it can't be read, 0 if there is none.
    """

    side: Side
    power: bool | None
    torque_nm: float

    @property
    def known(self) -> bool:
        """Whether torque or power remains, or the power state is unknown."""
        return self.power is not False or abs(self.torque_nm) > 0.0

    @property
    def gone(self) -> bool:
        """Whether power and torque were read back as zero."""
        return self.power is False and self.torque_nm == 0.0

    @property
    def words(self) -> str:
        """Say it."""
        if math.isnan(self.torque_nm):
            torque = "torque can't be read"
        else:
            torque = Message("{torque_nm:.1f} N·m", self.torque_nm)
        if self.power is False:
            return Message("{side} side: drive off, {torque}", self.side, torque)
        if self.power:
            return Message("{side} side: drive still on, {torque}", self.side, torque)
        return Message("{side} side: state of the drive unknown, {torque}", self.side, torque)


class ReadBack:
    """Readings of drives and transducers after a stop.

    Parameters
    ----------
    description : BenchDescription
    workers : mapping of side to DriveWorker
    """

    def __init__(self, description: BenchDescription, workers: Mapping[Side, DriveWorker]) -> None:
        self._description = description
        self._workers = workers
        self._torque: dict[Side, tuple[float, float]] = {}

    def take(self, block: Block) -> None:
        """Store the newest torque of each side: its own, otherwise the mounted standard's."""
        for side in SIDES:
            for name in (torque_channel(side), reference_channel(side)):
                record = block.records.get(name)
                if record is None or not len(record) or record["fault"][-1]:
                    continue
                torque_nm = float(record["reading_nm"][-1])
                if math.isfinite(torque_nm):
                    self._torque[side] = (block.stop_s, torque_nm)
                    break

    def torque_nm(self, side: Side, since_s: float) -> float:
        """Return the torque read after a bench time, 0 below `unloaded_percent`; NaN if none."""
        read_s, torque_nm = self._torque.get(side, (-math.inf, math.nan))
        if read_s <= since_s:
            return math.nan
        return 0.0 if abs(torque_nm) <= self._description.unloaded_nm(side) else torque_nm

    def at_zero(self, since_s: float, since: float) -> bool:
        """Whether every drive is off or at zero set points, and no torque is read.

        Parameters
        ----------
        since_s, since : float
            Bench time and `time.monotonic` seconds; earlier readings don't count.
        """
        return all(
            self._without_set_point(side, since) and self.torque_nm(side, since_s) == 0.0
            for side in self._workers
        )

    def _without_set_point(self, side: Side, since: float) -> bool:
        state = self._workers[side].read(since)
        if state is None:
            return False
        return not state.enabled or (
            abs(state.torque_nm or 0.0) <= NO_SET_POINT * self._description.module(side).range_nm
            and self._description.safety.at_standstill(state.speed_rad_s or 0.0)
        )

    def remaining(self, since_s: float, since: float, *, torque: bool) -> list[Remaining]:
        """Return the remaining torque and power of each side.

        Parameters
        ----------
        since_s, since : float
            As above.
        torque : bool
            Whether torque counts: without power before, it isn't a drive's.
        """
        found = []
        for side, worker in self._workers.items():
            state = worker.read(since)
            power = None if state is None else state.enabled
            found.append(Remaining(side, power, self.torque_nm(side, since_s) if torque else 0.0))
        return found

    def allowed(self) -> str:
        """Describe the safe state."""
        limits = Message.joined(
            Message("{value:g} N·m at the {side}", self._description.unloaded_nm(side), side)
            for side in self._workers
        )
        return Message("no power, and torque of at most {limits}", limits)


def said(remaining: Iterable[Remaining]) -> str:
    """Describe remaining torque and power of the sides."""
    return Message.joined((each.words for each in remaining if not each.gone), "; ")
