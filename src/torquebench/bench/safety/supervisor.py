"""The supervisor: monitors the bench independently of procedures and brings it to a safe state.

Acquisition passes each block to the supervisor first; a thread of its own monitors drives,
heartbeats, the operator's presence and acquisition itself. So it acts when the run engine hangs,
when the event loop is blocked and when acquisition stalls. When the whole process is gone, the
drives' watchdogs are no longer fed and act.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from torquebench.bench.blocks import Block
from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.roles import SIDES, Side
from torquebench.bench.safety.alarms import (
    Alarm,
    AlarmBook,
    AlarmKind,
    AlarmLevel,
    RaisedAlarm,
    Violation,
)
from torquebench.bench.safety.drives import DriveWorker, unreachable
from torquebench.bench.safety.heartbeats import Heartbeats
from torquebench.bench.safety.limits import LimitBook, SideLimits, StepLimits
from torquebench.bench.safety.priority import lift_process, prefer_this_thread
from torquebench.bench.safety.signals import Change, FastCheck, SignalJudge
from torquebench.bench.safety.stopping import (
    PRESS_STOP,
    Deadline,
    ReadBack,
    Remaining,
    Stage,
    said,
)
from torquebench.bench.state import CommandState
from torquebench.errors import InterlockError
from torquebench.message import Message

__all__ = [
    "Alarm",
    "AlarmKind",
    "AlarmLevel",
    "RaisedAlarm",
    "SafetySupervisor",
    "StepLimits",
]

logger = logging.getLogger(__name__)

WATCH_PERIOD_S = 0.005
"""Interval of the supervisor's thread in real time, s of wall time."""
IDLE_PERIOD_S = 0.05
"""The same in simulated time, where most checks are made by acquisition, block by block."""
UNLOAD_SETTLING_S = 0.2
"""Settling time of shafts and drives after a ramp to zero, s of bench time."""
GOING_OFF_S = 1.0
"""Longest time until power and torque are gone, s, in addition to a drive's own watchdog."""
UNREAD_S = 0.5
"""How long the supervisor waits for a torque reading after power is off, s."""
NEWS = 0.05
"""An alarm that states the remaining torque is updated when it has changed by this share."""
RETOLD_S = 1.0
"""Interval at which a drive that is still on is told again to go off, s of wall time."""
FAST_PATIENCE = 15.0
"""Additional stall time in simulated time, which stands meanwhile."""
FAST_SILENCE_S = 0.5
"""In simulated time, drives are polled without a block after this time, s of wall time."""
DRIVE_PATIENCE_S = 0.1
"""How long simulated time waits for a slow drive, s of wall time."""
ANSWER_S = 10.0
"""Longest time for switching a drive off, with all attempts of its link, s of wall time."""


class SafetySupervisor:
    """Watches limits, signals, drives and heartbeats; ramps to zero, stops, disables, latches.

    Parameters
    ----------
    description : BenchDescription
        Limits of both sides and the section `[safety]`.
    drivers : DriverSet
    clock : BenchClock
    commands : CommandState

    Attributes
    ----------
    limits : LimitBook
        The limits in force; steps of a procedure tighten them.
    heartbeats : Heartbeats
        Who has to show signs of life.
    """

    def __init__(
        self,
        description: BenchDescription,
        drivers: DriverSet,
        clock: BenchClock,
        commands: CommandState,
    ) -> None:
        self._description = description
        self._clock = clock
        self._commands = commands
        self.limits = LimitBook(description)
        safety = description.safety
        self.heartbeats = Heartbeats(clock.now, safety.presence_s)
        self._signals = SignalJudge(description, self.limits, commands, drivers.reference)
        patience_s = DRIVE_PATIENCE_S if clock.fast else 0.0
        self._workers = {
            side: DriveWorker(side, drive, threaded=drivers.blocking, patience_s=patience_s)
            for side, drive in drivers.drives.items()
        }
        self._stall_s = safety.stall_s * (FAST_PATIENCE if clock.fast else 1.0)
        self._lock = threading.RLock()
        self._book = AlarmBook()
        self._unloaded_s = 0.0
        self._read_back = ReadBack(description, self._workers)
        self._stage = Stage.SAFE
        self._stage_s, self._stage_wall = 0.0, 0.0  # start, bench and wall time
        self._deadline = self._unread = Deadline(clock, 0.0, 0.0)
        self._ended = threading.Event()  # state of the way to the safe state: reached, or given up
        self._ended.set()
        self._powered = False  # since power and torque were last read back as gone
        self._off_s: float | None = None  # bench time of the last orderly switching off
        self._told_wall = 0.0
        self._unreachable_since: dict[Side, float] = {}
        self._on_since: dict[Side, float] = {}
        self._remains: int | None = None
        self._late: int | None = None  # number of the warning that acquisition is late
        self._stated: list[Remaining] = []
        self._news: list[int] = []  # numbers of alarms that are announced without the lock
        self._failed = ""
        self._busy_since: float | None = None
        self._checked_wall = time.monotonic()
        self._enabled_since: dict[Side, float] = {}
        self._closing = threading.Event()
        self._lifted = contextlib.ExitStack()
        self._thread = threading.Thread(target=self._watch, name="torquebench-safety", daemon=True)

    # -- alarms -----------------------------------------------------------------------------

    @property
    def alarm(self) -> Alarm | None:
        """The latched alarm, None when there is none."""
        return self._book.latched

    @property
    def alarms(self) -> tuple[RaisedAlarm, ...]:
        """Active alarms, the worst first: the latched alarm, its later causes, warnings."""
        return self._book.active

    @property
    def history(self) -> tuple[Alarm, ...]:
        """Every critical alarm since the bench was opened, later causes of a latched one too."""
        critical = AlarmLevel.CRITICAL
        return tuple(each.alarm for each in self._book.entries if each.alarm.level is critical)

    @property
    def entries(self) -> tuple[RaisedAlarm, ...]:
        """Every alarm and warning since the bench was opened, with its history."""
        return self._book.entries

    @property
    def safe(self) -> bool:
        """Whether the bench is at rest: after an alarm, the safe state was read back."""
        return self._stage is Stage.SAFE

    @property
    def unsafe(self) -> Alarm | None:
        """The alarm about remaining power or torque after a stop; None if none is known."""
        latched = self._book.latched
        if latched is None or latched.kind is not AlarmKind.NOT_SAFE or self.safe:
            return None
        return latched

    @property
    def unconfirmed(self) -> bool:
        """Whether drives had power that wasn't read back as off since."""
        return self._powered

    def raise_if_latched(self) -> None:
        """Raise the latched alarm's error."""
        alarm = self._book.latched
        if alarm is not None:
            raise alarm.error()

    def wait_safe(self, timeout_s: float) -> bool:
        """Wait (wall time) until the safe state was read back; False when it isn't reached."""
        self._ended.wait(timeout_s)
        return self.safe

    def still_on(self) -> Sequence[Remaining]:
        """Return power and torque that remain by reading back, or may remain.

        Nothing while drives are meant to have power.
        """
        if self._commands.any_enabled and self._book.latched is None:
            return ()
        since_s, since = self._stage_s, self._stage_wall
        found = self._read_back.remaining(since_s, since, torque=self._powered)
        return [each for each in found if not each.gone]

    def acknowledge(self, who: str, seen: Collection[int] | None = None) -> Alarm | None:
        """Clear the latched alarm, once the safe state was read back; return the cleared alarm.

        A cause that is still there, such as heat within the hysteresis of its limit, raises its
        alarm again at once.

        Parameters
        ----------
        who : str
            The person who has removed the cause.
        seen : collection of int, optional
            Numbers of the alarms that the person has seen; by default all.

        Raises
        ------
        InterlockError
            The bench isn't in its safe state yet, no person is named, or there is a critical alarm
            that the person hasn't seen.
        """
        with self._lock:
            alarm = self._book.latched
            if alarm is None:
                return None
            if self._stage is Stage.RAMPING:
                raise InterlockError(
                    Message("alarm {alarm} while the drives still ramp to zero", alarm.kind.value),
                    "acknowledgement in the safe state",
                    "wait a moment",
                )
            if still := self.still_on():
                known = self._stage is Stage.NOT_SAFE or any(each.power for each in still)
                raise InterlockError(
                    Message("alarm {alarm}, {still}", alarm.kind.value, said(still)),
                    self._read_back.allowed(),
                    PRESS_STOP
                    if known
                    else "wait a moment; check that drive and signal can be read",
                )
            if not who.strip():
                raise InterlockError("acknowledgement by nobody", "a person's name")
            acknowledged = self._book.acknowledge(who.strip(), seen)
            self._signals.forget()
        self._book.announce(*acknowledged)  # without the lock: a listener may wait for a disk
        return alarm

    def subscribe(self, listener: Callable[[RaisedAlarm], None]) -> None:
        """Call this when an alarm or a warning comes, is cleared or is acknowledged.

        Called in the supervisor's or acquisition's thread: it must be fast.
        """
        self._book.subscribe(listener)

    def warn(self, kind: AlarmKind, source: str, found: str, allowed: str, remedy: str) -> Alarm:
        """Raise a warning, which doesn't stop the bench and lasts until acknowledged or cleared."""
        alarm = self._book.add(
            Alarm(kind, source, found, allowed, remedy, self._clock.now(), AlarmLevel.WARNING)
        )
        self._book.announce(alarm.number)
        return alarm

    def clear_warning(self, number: int) -> None:
        """Clear a warning whose cause is gone."""
        self._book.clear(number)

    # -- limits of a step, heartbeats, presence ---------------------------------------------

    def limits_of(self, side: Side) -> SideLimits:
        """Limits in force on a side, as the bench description and the present step have them."""
        return self.limits.side(side)

    def expect(self, name: str, timeout_s: float, ping: Callable[[], None] | None = None) -> None:
        """Require a heartbeat from now on, at the latest every `timeout_s` of bench time.

        `ping` is called at every check and may ask for the beat without waiting for it.
        """
        self.heartbeats.expect(name, timeout_s, ping)

    def beat(self, name: str) -> None:
        """Record a heartbeat of the named part."""
        self.heartbeats.beat(name)

    def release(self, name: str) -> None:
        """Require the heartbeat no longer."""
        self.heartbeats.release(name)

    def confirm_presence(self, who: str) -> None:
        """Confirm the operator's presence for `safety.presence_s`."""
        self.heartbeats.confirm_presence(who)

    # -- called by acquisition --------------------------------------------------------------

    @contextlib.contextmanager
    def guarding_block(self) -> Iterator[None]:
        """Report a stall if one block takes longer than `stall_s` of wall time."""
        self._busy_since = time.monotonic()
        try:
            yield
        finally:
            self._busy_since = None

    def check_edges(self, measured: Block, channels: Mapping[str, FastCheck]) -> None:
        """Check the bare edges of a few milliseconds, before they become samples."""
        self._busy_since = time.monotonic()  # part of a block arrived, so acquisition doesn't stall
        self._act(*self._signals.check_edges(measured, channels))

    def check(self, block: Block) -> None:
        """Check a block; act on violations, continue an action that has begun."""
        self._checked_wall = time.monotonic()
        self._act(*self._signals.judge(block))
        self._read_back.take(block)
        # bench time passes only with blocks, so the other checks are made with them
        if self._clock.fast:
            self._look_around()
        self._go_on(block.stop_s)

    def _act(self, violation: Violation | None, changes: list[Change]) -> None:
        if violation is not None and self._book.latched is None:
            self._trip_for(self._with_the_drives_words(violation))
        for change in changes:
            if change.watch.number:
                self._book.clear(change.watch.number)
                change.watch.number = 0
            found = change.violation
            if found is not None:
                change.watch.number = self.warn(
                    found.kind, found.source, found.found, found.allowed, found.remedy
                ).number

    def _with_the_drives_words(self, violation: Violation) -> Violation:
        """Add what the drive states about a command that it doesn't follow."""
        if violation.kind is not AlarmKind.FOLLOWING:
            return violation
        state = next(w.state for side, w in self._workers.items() if side == violation.source)
        if state is None or not state.limited:
            return violation
        words = Message("{found}; the drive states that its own limit acts", violation.found)
        return replace(violation, found=words)

    def check_lateness(self, late_s: float, allowed_s: float) -> None:
        """Check how late acquisition is: with power on that stops the bench, else it is shown."""
        if late_s <= allowed_s:
            if self._late is not None:
                self._book.clear(self._late)
                self._late = None
            return
        found = Message("the newest samples are {seconds:.1f} s old", late_s)
        allowed = Message("at most {seconds:g} s", allowed_s)
        remedy = "wait until it has caught up; close other programs that load the computer"
        if self._commands.any_enabled and self._book.latched is None:
            self.trip(AlarmKind.STALL, "acquisition", found, allowed, remedy)
        elif self._late is None:
            self._late = self.warn(AlarmKind.STALL, "acquisition", found, allowed, remedy).number

    # -- drives and heartbeats --------------------------------------------------------------

    def _look_around(self) -> None:
        """Poll the drives, feed their watchdogs and check the heartbeats."""
        latched = self._book.latched is not None
        for side in self._workers:
            if not self._commands.side(side).enabled:
                self._enabled_since.pop(side, None)
            else:
                self._powered = True
                self._enabled_since.setdefault(side, time.monotonic())
        feed = not latched or self._stage is Stage.RAMPING
        self.heartbeats.ask()  # also without power: heartbeats must be present when power comes on
        for worker in self._workers.values():
            worker.ask(feed=feed)
        for worker in self._workers.values():
            worker.wait_asked()
        if latched:
            return
        violation = self._unasked_power()
        if violation is None and self._commands.any_enabled:
            violation = self._drive_violation() or self.heartbeats.missing()
        if violation is not None:
            self._trip_for(violation)

    def _drive_violation(self) -> Violation | None:
        for side, worker in self._workers.items():
            since = self._enabled_since.get(side)
            if since is None:
                continue
            commands = self._commands.side(side)
            watchdog_s = self._description.module(side).drive.watchdog_s
            found = worker.found_wrong(since, commands.enabled_wall_s, watchdog_s)
            # It may have been switched off meanwhile: the last command counts.
            if found and commands.enabled:
                return Violation(
                    AlarmKind.DRIVE_FAULT,
                    side,
                    Message("{side} drive: {fault}", side, found),
                    "an enabled drive without fault",
                    "read the drive's fault code",
                )
        return None

    def _unasked_power(self) -> Violation | None:
        """Detect a drive that has power without a command."""
        now = self._clock.now() if self._clock.fast else time.monotonic()
        for side, worker in self._workers.items():
            commands = self._commands.side(side)
            state = worker.read(time.monotonic() - GOING_OFF_S)
            if commands.enabled or commands.switching or state is None or not state.enabled:
                self._on_since.pop(side, None)
            elif now - self._on_since.setdefault(side, now) > GOING_OFF_S:
                torque_nm = self._read_back.torque_nm(side, self._clock.now() - GOING_OFF_S)
                return self._not_safe([Remaining(side, True, torque_nm)])
        return None

    def _not_safe(self, remaining: Sequence[Remaining]) -> Violation:
        sides = " and ".join(each.side for each in remaining)
        return Violation(
            AlarmKind.NOT_SAFE, sides, said(remaining), self._read_back.allowed(), PRESS_STOP
        )

    # -- acting -----------------------------------------------------------------------------

    def trip(self, kind: AlarmKind, source: str, found: str, allowed: str, remedy: str) -> Alarm:
        """Bring the bench to its safe state and latch an alarm; callable from any thread.

        While one alarm is latched a further one is only added to the history.
        """
        with self._lock:
            first = self._book.latched is None
            if first:  # before others see that the bench is on its way to the safe state
                self._powered = self._powered or self._commands.any_enabled
                self._begin_ramp()
            violation = Violation(kind, source, found, allowed, remedy)
            alarm = self._book.add(_alarm(violation, self._clock.now()))
            if first:
                for side in SIDES:
                    self._ramp_to_zero(side, self._description.safety.ramp_to_zero_s)
                self._begin_ramp()
        if first:
            self._clock.interrupt(alarm.error())
            self._go_on()
        self._book.announce(alarm.number)  # without the lock: a listener may wait for a disk
        return alarm

    def _begin_ramp(self) -> None:
        """Start a ramp's time; power goes off when zero is read back or the time is over."""
        safety = self._description.safety
        lasts_s = safety.ramp_to_zero_s + UNLOAD_SETTLING_S + self._description.counter.block_s
        self._enter(Stage.RAMPING, lasts_s, safety.stall_s)
        self._unloaded_s = max(self._unloaded_s, self._clock.now() + lasts_s)

    def _enter(self, stage: Stage, lasts_s: float, patience_s: float) -> None:
        self._stage = stage
        self._stage_s, self._stage_wall = self._clock.now(), time.monotonic()
        self._deadline = Deadline(self._clock, lasts_s, lasts_s + patience_s)
        self._ended.clear()

    def _go_on(self, now_s: float | None = None) -> None:
        """Continue to the safe state as far as the readings allow."""
        now_s = self._clock.now() if now_s is None else now_s
        with self._lock:
            violation = self._advance(now_s)
            if self._clock.fast and self._stage in (Stage.RAMPING, Stage.GOING_OFF):
                self._clock.require(self._clock.now() + 2.0 * self._description.counter.block_s)
            news, self._news = self._news, []
        self._book.announce(*news)
        if violation is not None:
            self._trip_for(violation)

    def _advance(self, now_s: float) -> Violation | None:
        """Take the next step to the safe state; return a reason to stop the bench again."""
        stage, since_s, since = self._stage, self._stage_s, self._stage_wall
        if stage is Stage.RAMPING:
            if self._deadline.passed(now_s) or self._read_back.at_zero(since_s, since):
                self._take_power_off()
        elif stage is not Stage.SAFE:
            self._await_off(now_s)
        elif self._book.latched is not None:
            states = [worker.read(since) for worker in self._workers.values()]
            if any(state is not None and state.enabled for state in states):
                self._take_power_off()
        elif self._commands.any_enabled:
            self._off_s = None
        elif self._powered:
            return self._watch_torque_go(now_s)
        return None

    def _trip_for(self, found: Violation) -> Alarm:
        return self.trip(found.kind, found.source, found.found, found.allowed, found.remedy)

    def _take_power_off(self) -> None:
        """Take the power off both drives; from now on their watchdogs aren't fed."""
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
        """Read back whether power and torque are gone; raise an alarm where they aren't in time."""
        found = self._read_back.remaining(self._stage_s, self._stage_wall, torque=self._powered)
        known = [each for each in found if each.known]
        if all(each.gone for each in found):
            self._powered = False
        if not known:
            # A torque that can't be read delays the acknowledgement only.
            if all(each.gone for each in found) or self._unread.passed(now_s):
                self._stage = Stage.SAFE
                self._ended.set()
            return
        if self._stage is Stage.GOING_OFF and self._deadline.passed(now_s):
            self._stage = Stage.NOT_SAFE
        if self._stage is Stage.NOT_SAFE:
            self._state_what_is_on(known)
            self._ended.set()
        if time.monotonic() - self._told_wall > RETOLD_S:
            self._told_wall = time.monotonic()
            for side in (each.side for each in known if each.power is not False):
                if self._workers[side].idle:
                    self._workers[side].disable(lambda _told: None)

    def _state_what_is_on(self, known: Sequence[Remaining]) -> None:
        """State remaining power and torque in the alarm, again after each change."""
        latched, found = self._book.latched, self._not_safe(known)
        if latched is None or latched.kind is not AlarmKind.NOT_SAFE:
            self._news.append(self._book.add(_alarm(found, self._clock.now())).number)
        elif self._differs(known):
            self._book.restate(latched.number, found.found)
            self._news.append(latched.number)
        else:
            return
        self._stated = list(known)

    def _differs(self, known: Sequence[Remaining]) -> bool:
        """Whether the state has changed: another power state, or 5 % of the range."""
        if [(each.side, each.power) for each in known] != [
            (each.side, each.power) for each in self._stated
        ]:
            return True
        return any(
            abs(each.torque_nm - before.torque_nm)
            > NEWS * self._description.module(each.side).range_nm
            for each, before in zip(known, self._stated, strict=True)
        )

    def _watch_torque_go(self, now_s: float) -> Violation | None:
        """Check that torque goes after an orderly stop; return torque that a drive may cause."""
        if self._off_s is None:
            self._off_s = now_s
        found = self._read_back.remaining(self._off_s, self._stage_wall, torque=True)
        if all(each.gone for each in found):
            self._powered, self._off_s = False, None
            if self._remains is not None:
                self._book.clear(self._remains)
                self._remains = None
            return None
        loaded = [each for each in found if abs(each.torque_nm) > 0.0]
        if not loaded or now_s - self._off_s <= GOING_OFF_S:
            return None
        violation = self._not_safe(loaded)
        if any(abs(each.torque_nm) > self._much_nm(each.side) for each in loaded):
            return violation
        if self._remains is None:
            warning = replace(
                violation, remedy="release the shafts by hand before you reach in, or zero again"
            )
            alarm = _alarm(warning, self._clock.now(), AlarmLevel.WARNING)
            self._remains = self._book.add(alarm).number
            self._news.append(self._remains)
        return None

    def _much_nm(self, side: Side) -> float:
        """Torque that a drive may cause, beyond what friction holds in a shaft, N·m."""
        share = self._description.safety.following_percent / 100.0
        return share * self._description.module(side).range_nm

    def unload(self, sides: Iterable[Side] = SIDES) -> float:
        """Bring drives to zero torque and speed at their usual rates, without an alarm.

        Returns
        -------
        float
            Bench time until they are there and have settled, s; 0 where they are already.
        """
        with self._lock:
            now, present = self._clock.now(), self._clock.present()
            for side in sides:
                commands, rates = self._commands.side(side), self._description.module(side).drive
                ramp_s = max(
                    abs(commands.torque_nm) / rates.torque_rate_nm_per_s,
                    abs(commands.speed_rad_s) / rates.speed_rate_rad_per_s2,
                    commands.uncertain_s,
                )
                if commands.enabled and ramp_s > 0.0:  # otherwise it is at zero, or on its way
                    self._ramp_to_zero(side, ramp_s)
                    self._unloaded_s = max(self._unloaded_s, present + ramp_s + UNLOAD_SETTLING_S)
            return max(0.0, self._unloaded_s - now)

    def _ramp_to_zero(self, side: Side, ramp_s: float) -> None:
        """Tell a drive to go to zero torque and speed, and disable one that can't."""
        commands = self._commands.side(side)
        asked = commands.ask_zero(self._clock.now(), ramp_s)  # the drive may move at once
        self._workers[side].ramp_to_zero(ramp_s)
        commands.told_zero(asked, self._clock.present())

    def disable(self) -> None:
        """Switch off both drives after an operation; check that the power goes.

        With an alarm latched the supervisor does so by itself, after the ramp. A drive that doesn't
        take the command causes an alarm.
        """
        with self._lock:
            if self._book.latched is not None and self._stage is not Stage.SAFE:
                return
            self._unreachable_since = dict.fromkeys(self._workers, time.monotonic())

            def done(side: Side, was_told: bool) -> None:
                self._unreachable_since.pop(side, None)
                if not was_told and self._book.latched is None:
                    self._trip_for(unreachable(side))

            for side, worker in self._workers.items():
                self._commands.side(side).off(self._clock.now())  # it may be off from now on
                worker.disable(functools.partial(done, side))

    def read_off(self, sides: Sequence[Side] = SIDES, *, torque: bool = False) -> Alarm | None:
        """Read back that drives are off after an orderly stop; else raise and return an alarm.

        Parameters
        ----------
        sides : sequence of {"input", "output"}
            Drives that were switched off.
        torque : bool
            Whether the torque must be zero, too.
        """
        if self._book.latched is not None:
            self.wait_safe(GOING_OFF_S)
            return self.unsafe
        begun, begun_s = time.monotonic(), self._clock.now() - GOING_OFF_S
        while True:
            for side in sides:
                self._workers[side].ask(feed=True)
                self._workers[side].wait_asked(GOING_OFF_S)
            found = self._read_back.remaining(begun_s, begun, torque=torque)
            left = [
                each
                for each in found
                if each.side in sides
                and (each.power is not False or abs(each.torque_nm) > self._much_nm(each.side))
            ]
            if not left:
                return None
            if time.monotonic() - begun > GOING_OFF_S:
                break
            time.sleep(WATCH_PERIOD_S)
        found = self._read_back.remaining(begun_s, begun, torque=True)
        violation = self._not_safe([each for each in found if each.side in sides])
        return self._trip_for(violation)

    # -- the supervisor's own thread --------------------------------------------------------

    def start(self) -> None:
        """Start the supervisor's thread."""
        if not self._clock.fast:
            self._lifted = lift_process()
        for worker in self._workers.values():
            worker.start()
        self._thread.start()

    def close(self) -> None:
        """End the supervisor's thread. A second call does nothing."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join()
        for worker in self._workers.values():
            worker.close()
        self._lifted.close()

    def _watch(self) -> None:
        period_s = IDLE_PERIOD_S if self._clock.fast else WATCH_PERIOD_S
        if not self._clock.fast:
            prefer_this_thread()
        while not self._closing.wait(period_s):
            try:
                self._watch_once()
            except Exception as error:  # nothing supervises this thread: continue
                self._fail(error)

    def _watch_once(self) -> None:
        if self._stalls() and self._book.latched is None and self._commands.any_enabled:
            found = Message("no block of samples for {seconds:g} s of wall time", self._stall_s)
            remedy = "check the counter's connection and the computer's load"
            self.trip(AlarmKind.STALL, "acquisition", found, "a block in its own time", remedy)
        if not self._clock.fast:
            self._look_around()
        elif self._stage is not Stage.SAFE:
            if time.monotonic() - self._checked_wall > FAST_SILENCE_S:  # no more blocks come
                self._look_around()
            if self._stage is Stage.NOT_SAFE:  # wall time continues until the bench is safe
                self._clock.require(self._clock.now() + self._description.counter.block_s)
        self._go_on()
        for side, since in tuple(self._unreachable_since.items()):
            if time.monotonic() - since > ANSWER_S:
                self._unreachable_since.pop(side, None)
                if self._book.latched is None:
                    self._trip_for(unreachable(side))

    def _stalls(self) -> bool:
        """Whether a block takes too long or, in real time, none is being acquired."""
        busy_since, now = self._busy_since, time.monotonic()
        if busy_since is not None:
            return now - busy_since > self._stall_s
        between_s = self._stall_s + self._description.counter.block_s
        return not self._clock.fast and now - self._checked_wall > between_s

    def _fail(self, error: Exception) -> None:
        """Go to the safe state after an error in the supervisor itself."""
        found = Message("{name}: {error}", type(error).__name__, error)
        if found == self._failed:
            return  # it repeats with every check
        self._failed = found
        logger.error("the supervisor failed", exc_info=error)
        try:
            self.trip(
                AlarmKind.SUPERVISOR,
                "supervisor",
                found,
                "a supervisor that receives all data",
                "open the bench again; if it happens again, report it",
            )
        except Exception:  # even that failed: the power goes off without a ramp
            logger.exception("the supervisor can't stop the bench normally")
            for worker in self._workers.values():
                worker.disable(lambda _told: None)


def _alarm(found: Violation, time_s: float, level: AlarmLevel = AlarmLevel.CRITICAL) -> Alarm:
    return Alarm(found.kind, found.source, found.found, found.allowed, found.remedy, time_s, level)
