"""The way to the safe state: zero, power off, and both read back before work continues.

A drive that accepts a command may not have executed it. Its power state and the torque at its side
are therefore read after every stop, until both are zero.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

from torquebench.bench.blocks import Block
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES, Side, reference_channel, torque_channel
from torquebench.bench.safety.alarms import AlarmBook, AlarmKind, AlarmLevel, Violation
from torquebench.bench.safety.drives import DriveWorker
from torquebench.bench.state import CommandState
from torquebench.message import Message

PRESS_STOP = (
    "press the emergency stop and keep away from the bench; then find out why the drive doesn't "
    "go off"
)
UNLOAD_SETTLING_S = 0.2
"""Settling time of shafts and drives after a ramp to zero, s of bench time."""
GOING_OFF_S = 1.0
"""Longest time until power and torque are zero, s, in addition to a drive's own watchdog time."""
UNREAD_S = 0.5
"""Time for which a torque reading is awaited after power is off, s."""
NEWS = 0.05
"""Change of the remaining torque, as a share of the range, after which the alarm is updated."""
RETOLD_S = 1.0
"""Interval at which a drive that is still on is commanded to switch off again, s of wall time."""
READ_PERIOD_S = 0.005
"""Interval at which a drive that was switched off is polled, s of wall time."""
FAST_PATIENCE = 15.0
"""Factor on time-outs of the wall clock for simulated time, which may stand still meanwhile."""
NO_SET_POINT = 1e-3
"""Share of the range below which a set point counts as zero."""


class Stage(Enum):
    """Stages of the way to the safe state."""

    SAFE = "safe"
    RAMPING = "ramping to zero"
    GOING_OFF = "going off"
    NOT_SAFE = "not safe"


class Deadline:
    """A time-out: `lasts_s` of bench time, or `longest_wall_s` of wall time if that stops."""

    def __init__(self, clock: BenchClock, lasts_s: float, longest_wall_s: float) -> None:
        self._clock = clock
        self._bench_s = clock.now() + lasts_s
        self._wall_s = time.monotonic() + longest_wall_s

    def passed(self, now_s: float | None = None) -> bool:
        """Return whether the time-out is over, at a bench time or now."""
        now_s = self._clock.now() if now_s is None else now_s
        return now_s > self._bench_s - 1e-6 or time.monotonic() > self._wall_s


@dataclass(frozen=True)
class Remaining:
    """Remaining power and torque of one side after a stop, as read back.

    `power` is None if the drive doesn't report it; `torque_nm` is NaN if it can't be read.
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
        """Text about power and torque of the side."""
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
    """Readings of drives and transducers after a stop."""

    def __init__(self, description: BenchDescription, workers: Mapping[Side, DriveWorker]) -> None:
        self._description = description
        self._workers = workers
        self._torque: dict[Side, tuple[float, float]] = {}

    def take(self, block: Block) -> None:
        """Store the newest torque of each side: the module's, otherwise the mounted standard's."""
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
        """Return whether every drive is off or at zero set points, and no torque is read.

        Readings before `since_s` of bench time and `since` of `time.monotonic` don't count.
        """
        return all(
            self._without_set_point(side, since) and self.torque_nm(side, since_s) == 0.0
            for side in self._workers
        )

    def _without_set_point(self, side: Side, since: float) -> bool:
        """Return whether a drive that was read since a moment is off or has set points of zero."""
        state = self._workers[side].read(since)
        if state is None:
            return False
        return not state.enabled or (
            abs(state.torque_nm or 0.0) <= NO_SET_POINT * self._description.module(side).range_nm
            and self._description.safety.at_standstill(state.speed_rad_s or 0.0)
        )

    def remaining(self, since_s: float, since: float, *, torque: bool) -> list[Remaining]:
        """Return whether each side still has power, and its torque; 0 N·m unless `torque` is set.

        Readings count as in `at_zero`.
        """
        sides = []
        for side, worker in self._workers.items():
            state = worker.read(since)
            power = None if state is None else state.enabled
            sides.append(Remaining(side, power, self.torque_nm(side, since_s) if torque else 0.0))
        return sides

    def allowed(self) -> str:
        """Return the description of the safe state."""
        limits = Message.joined(
            Message("{value:g} N·m at the {side}", self._description.unloaded_nm(side), side)
            for side in self._workers
        )
        return Message("no power, and torque of at most {limits}", limits)


def remaining_in_words(remaining: Iterable[Remaining]) -> str:
    """Describe the remaining torque and power of the sides."""
    return Message.joined((side.words for side in remaining if not side.gone), "; ")


class StopSequence:
    """Sequence that brings both drives to the safe state; its caller holds the lock.

    It adds alarms about remaining power and torque to the book of alarms.
    """

    def __init__(
        self,
        description: BenchDescription,
        clock: BenchClock,
        commands: CommandState,
        workers: Mapping[Side, DriveWorker],
        book: AlarmBook,
    ) -> None:
        self._description = description
        self._clock = clock
        self._commands = commands
        self._workers = workers
        self._book = book
        self.read_back = ReadBack(description, workers)
        self.stage = Stage.SAFE
        self.powered = False  # since power and torque were last read back as zero
        self.news: list[int] = []  # numbers of alarms to be announced without the lock
        self._began_s, self._began = 0.0, 0.0  # of the stage, in bench and wall time
        self._deadline = self._unread = Deadline(clock, 0.0, 0.0)
        self._ended = threading.Event()  # the safe state is reached, or the sequence has given up
        self._ended.set()
        self._unloaded_s = 0.0
        self._off_s: float | None = None  # bench time of the last orderly switching off
        self._told_wall = 0.0
        self._remains: int | None = None  # number of the warning about torque without power
        self._stated: list[Remaining] = []

    def wait(self, timeout_s: float) -> None:
        """Wait (wall time) until the safe state is reached or the sequence gives up."""
        self._ended.wait(timeout_s)

    def remaining(self) -> list[Remaining]:
        """Return the torque and power of each side, read since the stage began."""
        return self.read_back.remaining(self._began_s, self._began, torque=self.powered)

    def begin_ramp(self) -> None:
        """Start a ramp's time: power goes off when zero is read back or the time is over."""
        safety = self._description.safety
        lasts_s = safety.ramp_to_zero_s + UNLOAD_SETTLING_S + self._description.counter.block_s
        self._enter(Stage.RAMPING, lasts_s, safety.stall_s)
        self._unloaded_s = max(self._unloaded_s, self._clock.now() + lasts_s)

    def _enter(self, stage: Stage, lasts_s: float, patience_s: float) -> None:
        """Begin a stage with its time-out."""
        self.stage = stage
        self._began_s, self._began = self._clock.now(), time.monotonic()
        self._deadline = Deadline(self._clock, lasts_s, lasts_s + patience_s)
        self._ended.clear()

    def ramp_to_zero(self, side: Side, ramp_s: float) -> None:
        """Command a drive to zero torque and speed; disable it if that fails."""
        commands = self._commands.side(side)
        requested = commands.ask_zero(self._clock.now(), ramp_s)  # the drive may move at once
        self._workers[side].ramp_to_zero(ramp_s)
        commands.told_zero(requested, self._clock.present())

    def unload(self, sides: Iterable[Side] = SIDES) -> float:
        """Ramp drives to zero at their own rates; return the bench time until it is done, s."""
        now, present = self._clock.now(), self._clock.present()
        for side in sides:
            commands, rates = self._commands.side(side), self._description.module(side).drive
            ramp_s = max(
                abs(commands.torque_nm) / rates.torque_rate_nm_per_s,
                abs(commands.speed_rad_s) / rates.speed_rate_rad_per_s2,
                commands.uncertain_s,
            )
            if commands.enabled and ramp_s > 0.0:  # otherwise the drive is at zero, or on its way
                self.ramp_to_zero(side, ramp_s)
                self._unloaded_s = max(self._unloaded_s, present + ramp_s + UNLOAD_SETTLING_S)
        return max(0.0, self._unloaded_s - now)

    def advance(self, now_s: float) -> Violation | None:
        """Take the next step to the safe state; return a violation that demands a new stop."""
        stage, since_s, since = self.stage, self._began_s, self._began
        if stage is Stage.RAMPING:
            if self._deadline.passed(now_s) or self.read_back.at_zero(since_s, since):
                self._take_power_off()
        elif stage is not Stage.SAFE:
            self._await_off(now_s)
        elif self._book.latched is not None:
            states = [worker.read(since) for worker in self._workers.values()]
            if any(state is not None and state.enabled for state in states):
                self._take_power_off()
        elif self._commands.any_enabled:
            self._off_s = None
        elif self.powered:
            return self._watch_torque_go(now_s)
        return None

    def _take_power_off(self) -> None:
        """Switch off the power of both drives; their watchdogs aren't fed from now on."""
        drives = [self._description.module(side).drive for side in self._workers]
        lasts_s = max(drive.watchdog_s for drive in drives) + GOING_OFF_S
        lasts_s += self._description.safety.ramp_to_zero_s + self._description.counter.block_s
        self._unread = Deadline(self._clock, UNREAD_S, 2.0 * UNREAD_S)
        self._enter(Stage.GOING_OFF, lasts_s, FAST_PATIENCE * lasts_s if self._clock.fast else 0.0)
        self._told_wall = time.monotonic()
        for side, worker in self._workers.items():
            self._commands.side(side).off(self._clock.now())
            worker.disable(lambda _told: None)

    def _await_off(self, now_s: float) -> None:
        """Read back whether power and torque are zero; raise an alarm if they aren't in time."""
        remaining = self.remaining()
        unsafe = [rest for rest in remaining if rest.known]
        if all(rest.gone for rest in remaining):
            self.powered = False
        if not unsafe:
            # A torque that can't be read only delays the acknowledgement.
            if all(rest.gone for rest in remaining) or self._unread.passed(now_s):
                self.stage = Stage.SAFE
                self._ended.set()
            return
        if self.stage is Stage.GOING_OFF and self._deadline.passed(now_s):
            self.stage = Stage.NOT_SAFE
        if self.stage is Stage.NOT_SAFE:
            self._state_what_is_on(unsafe)
            self._ended.set()
        if time.monotonic() - self._told_wall > RETOLD_S:
            self._told_wall = time.monotonic()
            for side in (rest.side for rest in unsafe if rest.power is not False):
                if self._workers[side].idle:
                    self._workers[side].disable(lambda _told: None)

    def _state_what_is_on(self, remaining: Sequence[Remaining]) -> None:
        """State remaining power and torque in the alarm, and again after each change."""
        latched, violation = self._book.latched, self.not_safe(remaining)
        if latched is None or latched.kind is not AlarmKind.NOT_SAFE:
            self.news.append(self._book.add(violation.alarm(self._clock.now())).number)
        elif self._differs(remaining):
            self._book.restate(latched.number, violation.found)
            self.news.append(latched.number)
        else:
            return
        self._stated = list(remaining)

    def _differs(self, remaining: Sequence[Remaining]) -> bool:
        """Return whether the power state has changed, or the torque by 5 % of the range."""
        if [(rest.side, rest.power) for rest in remaining] != [
            (rest.side, rest.power) for rest in self._stated
        ]:
            return True
        return any(
            abs(rest.torque_nm - before.torque_nm)
            > NEWS * self._description.module(rest.side).range_nm
            for rest, before in zip(remaining, self._stated, strict=True)
        )

    def _watch_torque_go(self, now_s: float) -> Violation | None:
        """Check that torque falls after an orderly stop; return a violation by a drive."""
        if self._off_s is None:
            self._off_s = now_s
        remaining = self.read_back.remaining(self._off_s, self._began, torque=True)
        if all(rest.gone for rest in remaining):
            self.powered, self._off_s = False, None
            if self._remains is not None:
                self._book.clear(self._remains)
                self._remains = None
            return None
        loaded = [rest for rest in remaining if abs(rest.torque_nm) > 0.0]
        if not loaded or now_s - self._off_s <= GOING_OFF_S:
            return None
        violation = self.not_safe(loaded)
        if any(abs(rest.torque_nm) > self.much_nm(rest.side) for rest in loaded):
            return violation
        if self._remains is None:
            warning = replace(
                violation, remedy="release the shafts by hand before you reach in, or zero again"
            )
            alarm = warning.alarm(self._clock.now(), AlarmLevel.WARNING)
            self._remains = self._book.add(alarm).number
            self.news.append(self._remains)
        return None

    def much_nm(self, side: Side) -> float:
        """Torque above which a drive, and not friction in a shaft, must be its cause, N·m."""
        share = self._description.safety.following_percent / 100.0
        return share * self._description.module(side).range_nm

    def not_safe(self, remaining: Sequence[Remaining]) -> Violation:
        """Return the violation about remaining power and torque."""
        sides = " and ".join(rest.side for rest in remaining)
        return Violation(
            AlarmKind.NOT_SAFE,
            sides,
            remaining_in_words(remaining),
            self.read_back.allowed(),
            PRESS_STOP,
        )

    def read_off(self, sides: Sequence[Side], *, torque: bool) -> Violation | None:
        """Wait until drives, or also torques, are read back as off; else return a violation.

        To be called without the supervisor's lock.
        """
        begun, begun_s = time.monotonic(), self._clock.now() - GOING_OFF_S
        while True:
            for side in sides:
                self._workers[side].ask(feed=True)
                self._workers[side].wait_asked(GOING_OFF_S)
            remaining = self.read_back.remaining(begun_s, begun, torque=torque)
            left = [
                rest
                for rest in remaining
                if rest.side in sides
                and (rest.power is not False or abs(rest.torque_nm) > self.much_nm(rest.side))
            ]
            if not left:
                return None
            if time.monotonic() - begun > GOING_OFF_S:
                break
            time.sleep(READ_PERIOD_S)
        remaining = self.read_back.remaining(begun_s, begun, torque=True)
        return self.not_safe([rest for rest in remaining if rest.side in sides])
