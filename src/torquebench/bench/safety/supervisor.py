"""The supervisor: watches the bench below every procedure and brings it to a safe state.

Acquisition hands it what the counter delivered before anybody else sees it; drives, heartbeats,
the operator's presence and acquisition itself are watched from a thread of its own. So it acts
when the run engine hangs, when the event loop is blocked and when acquisition stalls. When the
whole process is gone, nobody feeds the drives' watchdogs any more, and they act.
Software on a computer is never the safety function: safe torque off, the emergency stop and the
hardware watchdog belong to the drive and the safety relay.
"""

from __future__ import annotations

import contextlib
import functools
import logging
import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping

from torquebench.bench.clock import BenchClock
from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import CounterBlock, DriverSet
from torquebench.bench.roles import SIDES, Side
from torquebench.bench.safety.alarms import (
    Alarm,
    AlarmBook,
    AlarmKind,
    AlarmLevel,
    StandingAlarm,
    Violation,
)
from torquebench.bench.safety.drives import DriveWorker, unreachable
from torquebench.bench.safety.heartbeats import Heartbeats
from torquebench.bench.safety.limits import LimitBook, SideLimits, StepLimits
from torquebench.bench.safety.priority import lift_process, prefer_this_thread
from torquebench.bench.safety.signals import Change, FastCheck, SignalJudge
from torquebench.bench.samples import AcquiredBlock
from torquebench.bench.state import CommandState
from torquebench.errors import InterlockError

__all__ = [
    "Alarm",
    "AlarmKind",
    "AlarmLevel",
    "SafetySupervisor",
    "StandingAlarm",
    "StepLimits",
]

logger = logging.getLogger(__name__)

WATCH_PERIOD_S = 0.005
"""How often the supervisor's thread looks in real time, s of wall time."""
IDLE_PERIOD_S = 0.05
"""The same in simulated time, where acquisition does most of it, block by block."""
UNLOAD_SETTLING_S = 0.2
"""How long shafts and drives swing after an orderly ramp to zero, s of bench time."""
FAST_PATIENCE = 15.0
"""How much longer a stall may be in simulated time, which doesn't pass meanwhile."""
DRIVE_PATIENCE_S = 0.1
"""How long simulated time stands for a drive that takes its time to answer, s of wall time."""
ANSWER_S = 10.0
"""How long a drive may take to be told to go off, with all tries of its wire, s of wall time."""

ROUNDING_S = 1e-6


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
        self._signals = SignalJudge(description, self.limits, commands)
        patience_s = DRIVE_PATIENCE_S if clock.fast else 0.0
        self._workers = {
            side: DriveWorker(side, drive, threaded=drivers.blocking, patience_s=patience_s)
            for side, drive in drivers.drives.items()
        }
        self._stall_s = safety.stall_s * (FAST_PATIENCE if clock.fast else 1.0)
        self._lock = threading.RLock()
        self._book = AlarmBook()
        self._unloaded_s = 0.0
        self._disable_at_s = 0.0
        self._disable_at_wall = 0.0
        self._cut = False
        self._left_alone_s = self._left_alone_wall = math.inf
        self._safe = threading.Event()
        self._safe.set()
        self._told: Mapping[Side, bool] = dict.fromkeys(self._workers, True)
        self._answered_wall = math.inf
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
    def alarms(self) -> tuple[StandingAlarm, ...]:
        """Alarms that stand, the worst first: what is latched, its later causes, warnings."""
        return self._book.standing

    @property
    def history(self) -> tuple[Alarm, ...]:
        """Every critical alarm since the bench was opened, later causes of a latched one too."""
        critical = AlarmLevel.CRITICAL
        return tuple(each.alarm for each in self._book.entries if each.alarm.level is critical)

    @property
    def entries(self) -> tuple[StandingAlarm, ...]:
        """Every alarm and warning since the bench was opened, and what has become of it."""
        return self._book.entries

    @property
    def safe(self) -> bool:
        """Whether no way to the safe state is being gone: the drives are off after an alarm."""
        return self._safe.is_set()

    def raise_if_latched(self) -> None:
        """Raise the latched alarm's error."""
        alarm = self._book.latched
        if alarm is not None:
            raise alarm.error()

    def wait_safe(self, timeout_s: float) -> bool:
        """Wait (wall time) until the drives are disabled after an alarm; True when they are."""
        return self._safe.wait(timeout_s)

    def acknowledge(self, who: str) -> Alarm | None:
        """Clear the latched alarm, once the safe state is reached; return what was cleared.

        A cause that is still there, such as heat within the hysteresis of its limit, raises its
        alarm again at once.

        Parameters
        ----------
        who : str
            The person who has removed the cause.

        Raises
        ------
        InterlockError
            The bench isn't in its safe state yet, or nobody is named.
        """
        with self._lock:
            alarm = self._book.latched
            if alarm is None:
                return None
            if not self._safe.is_set():
                raise InterlockError(
                    f"alarm {alarm.kind.value} while the drives still ramp to zero",
                    "acknowledgement in the safe state",
                    "wait a moment",
                )
            if not who.strip():
                raise InterlockError("acknowledgement by nobody", "a person's name")
            self._signals.forget()
            acknowledged = self._book.acknowledge(who.strip())
        self._book.announce(*acknowledged)  # without the lock: a listener may wait for a disk
        return alarm

    def subscribe(self, listener: Callable[[StandingAlarm], None]) -> None:
        """Call this when an alarm or a warning comes, is cleared or is acknowledged.

        In the thread that notes it, which is the supervisor's or acquisition's: be quick.
        """
        self._book.subscribe(listener)

    def warn(self, kind: AlarmKind, source: str, found: str, allowed: str, remedy: str) -> Alarm:
        """Note a warning, which stops nothing and stands until it is acknowledged or cleared."""
        alarm = self._book.add(
            Alarm(kind, source, found, allowed, remedy, self._clock.now(), AlarmLevel.WARNING)
        )
        self._book.announce(alarm.number)
        return alarm

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
        """Note that the named part lives."""
        self.heartbeats.beat(name)

    def release(self, name: str) -> None:
        """Require the heartbeat no longer."""
        self.heartbeats.release(name)

    def confirm_presence(self, who: str) -> None:
        """Note that somebody is at the bench; counts for `safety.presence_s`."""
        self.heartbeats.confirm_presence(who)

    # -- what acquisition calls -------------------------------------------------------------

    @contextlib.contextmanager
    def guarding_block(self) -> Iterator[None]:
        """Guard the making of one block: taking longer than `stall_s` of wall time is a stall."""
        self._busy_since = time.monotonic()
        try:
            yield
        finally:
            self._busy_since = None

    def check_edges(self, raw: CounterBlock, channels: Mapping[str, FastCheck]) -> None:
        """Judge the bare edges of a few milliseconds, before they become samples."""
        self._busy_since = time.monotonic()  # a part of a block came: nothing stalls
        self._act(*self._signals.check_edges(raw, channels))

    def check(self, block: AcquiredBlock) -> None:
        """Judge a block; act on what is wrong, go on with an action that has begun."""
        self._checked_wall = time.monotonic()
        self._act(*self._signals.judge(block))
        if self._clock.fast:  # time passes with blocks only, so the rest is looked at with them
            self._look_around()
        if not self._safe.is_set():
            if block.stop_s > self._left_alone_s - ROUNDING_S:
                self._arrive()
            elif block.stop_s > self._disable_at_s - ROUNDING_S and not self._cut:
                self.disable()

    def _act(self, violation: Violation | None, changes: list[Change]) -> None:
        if violation is not None and self._book.latched is None:
            self._trip_for(violation)
        for change in changes:
            if change.watch.number:
                self._book.clear(change.watch.number)
                change.watch.number = 0
            found = change.violation
            if found is not None:
                change.watch.number = self.warn(
                    found.kind, found.source, found.found, found.allowed, found.remedy
                ).number

    # -- drives and heartbeats --------------------------------------------------------------

    def _look_around(self) -> None:
        """Ask the drives, feed their watchdogs, look for signs of life."""
        latched = self._book.latched is not None
        for side in self._workers:
            if not self._commands.side(side).enabled:
                self._enabled_since.pop(side, None)
            else:
                self._enabled_since.setdefault(side, time.monotonic())
        feed = not latched or not (self._cut or self._safe.is_set())
        for worker in self._workers.values():
            worker.ask(feed=feed)
        for worker in self._workers.values():
            worker.wait_asked()
        if latched or not self._commands.any_enabled:
            return
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
            # It may have been switched off meanwhile: what was told last is what counts.
            if found and commands.enabled:
                return Violation(
                    AlarmKind.DRIVE_FAULT,
                    side,
                    f"{side} drive: {found}",
                    "an enabled drive without fault",
                    "read the drive's fault code",
                )
        return None

    # -- acting -----------------------------------------------------------------------------

    def trip(self, kind: AlarmKind, source: str, found: str, allowed: str, remedy: str) -> Alarm:
        """Bring the bench to its safe state and latch an alarm; callable from any thread.

        While one alarm is latched a further one is only added to the history.
        """
        with self._lock:
            first = self._book.latched is None
            if first:  # before anybody else sees that a way to safety is being gone
                settled_s = self._allow_for_ramp()
                self._cut = False
                self._left_alone_s = self._left_alone_wall = math.inf
                self._safe.clear()
            alarm = self._book.add(Alarm(kind, source, found, allowed, remedy, self._clock.now()))
            if first:
                for side in SIDES:
                    self._ramp_to_zero(side, self._description.safety.ramp_to_zero_s)
                settled_s = self._allow_for_ramp()
        if first:
            self._clock.interrupt(alarm.error())
            self._clock.require(settled_s)
        self._book.announce(alarm.number)  # without the lock: a listener may wait for a disk
        return alarm

    def _allow_for_ramp(self) -> float:
        """Put off the end of the power until a ramp from now is over; return that bench time."""
        ramp_s = self._description.safety.ramp_to_zero_s
        settled_s = self._clock.now() + ramp_s + self._description.counter.block_s
        self._disable_at_s = settled_s
        self._disable_at_wall = time.monotonic() + ramp_s + self._description.safety.stall_s
        return settled_s

    def _trip_for(self, found: Violation) -> None:
        self.trip(found.kind, found.source, found.found, found.allowed, found.remedy)

    def unload(self, sides: Iterable[Side] = SIDES) -> float:
        """Bring drives to zero torque and speed at their own rates, as no alarm demands haste.

        Returns
        -------
        float
            Bench time until they are there and have settled, s; 0 where they are already.
        """
        with self._lock:
            now = self._clock.now()
            for side in sides:
                commands, rates = self._commands.side(side), self._description.module(side).drive
                ramp_s = max(
                    abs(commands.torque_nm) / rates.torque_rate_nm_per_s,
                    abs(commands.speed_rad_s) / rates.speed_rate_rad_per_s2,
                    commands.set_point.uncertain_s,
                )
                if commands.enabled and ramp_s > 0.0:  # else it is there, or on its way
                    self._ramp_to_zero(side, ramp_s)
                    self._unloaded_s = max(self._unloaded_s, now + ramp_s + UNLOAD_SETTLING_S)
            return max(0.0, self._unloaded_s - now)

    def _ramp_to_zero(self, side: Side, ramp_s: float) -> None:
        """Tell a drive to go to zero torque and speed, and disable one that can't."""
        self._workers[side].ramp_to_zero(ramp_s)
        self._commands.side(side).at_zero(self._clock.now(), ramp_s)

    def disable(self) -> None:
        """Take the power off both drives; with an alarm latched this ends the way to safety.

        A drive that can't be told is an alarm. It isn't fed any more, and the bench counts as safe
        when that drive's own watchdog has had its time to act.
        """
        told: dict[Side, bool] = {}
        self._told = told
        self._answered_wall = time.monotonic() + ANSWER_S
        self._cut = True

        def done(side: Side, was_told: bool) -> None:
            told[side] = was_told
            if not was_told and self._book.latched is None:
                self._trip_for(unreachable(side))
            elif len(told) == len(self._workers):
                self._arrive() if all(told.values()) else self._leave_alone(told)

        for side, worker in self._workers.items():
            self._commands.side(side).off(self._clock.now())  # from now on it may be off
            worker.disable(functools.partial(done, side))

    def _leave_alone(self, told: Mapping[Side, bool]) -> None:
        """Give drives that couldn't be told the time that their own watchdogs need."""
        drives = [self._description.module(side).drive for side in told if not told[side]]
        lasts_s = max(drive.watchdog_s for drive in drives)
        lasts_s += self._description.safety.ramp_to_zero_s + self._description.counter.block_s
        self._left_alone_s = self._clock.now() + lasts_s
        patience = FAST_PATIENCE if self._clock.fast else 1.0
        self._left_alone_wall = time.monotonic() + patience * lasts_s
        self._clock.require(self._left_alone_s)

    def _arrive(self) -> None:
        """End the way to the safe state."""
        self._left_alone_s = self._left_alone_wall = math.inf
        self._safe.set()

    # -- the supervisor's own thread --------------------------------------------------------

    def start(self) -> None:
        """Start the supervisor's own thread."""
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
            except Exception as error:  # nobody watches the watcher, so it goes on
                self._fail(error)

    def _watch_once(self) -> None:
        if self._stalls() and self._book.latched is None and self._commands.any_enabled:
            found = f"no block of samples for {self._stall_s:g} s of wall time"
            remedy = "check the counter's connection and the computer's load"
            self.trip(AlarmKind.STALL, "acquisition", found, "a block in its own time", remedy)
        if not self._clock.fast:
            self._look_around()
        now = time.monotonic()
        if self._cut and len(self._told) < len(self._workers) and now > self._answered_wall:
            self._give_up()
        elif not self._safe.is_set():
            if now > self._left_alone_wall:
                self._arrive()
            elif now > self._disable_at_wall and not self._cut:
                self.disable()

    def _stalls(self) -> bool:
        """Whether a block takes too long, or in real time none is being made any more."""
        busy_since, now = self._busy_since, time.monotonic()
        if busy_since is not None:
            return now - busy_since > self._stall_s
        between_s = self._stall_s + self._description.counter.block_s
        return not self._clock.fast and now - self._checked_wall > between_s

    def _give_up(self) -> None:
        """Leave alone drives that haven't even answered to being told to go off."""
        self._answered_wall = math.inf
        silent = [side for side in self._workers if side not in self._told]
        if self._book.latched is None:
            self._trip_for(unreachable(silent[0]))  # and then the way to safety, with a second try
        else:
            self._leave_alone({**dict.fromkeys(silent, False), **self._told})

    def _fail(self, error: Exception) -> None:
        """Go to the safe state, since the supervisor can't tell any more whether all is well."""
        found = f"{type(error).__name__}: {error}"
        if found == self._failed:
            return  # it comes with every look
        self._failed = found
        logger.error("the supervisor failed", exc_info=error)
        try:
            self.trip(
                AlarmKind.SUPERVISOR,
                "supervisor",
                found,
                "a supervisor that sees everything",
                "open the bench again; if it comes again, report it",
            )
        except Exception:  # not even that: the power goes off without ceremony
            logger.exception("the supervisor can't stop the bench in order")
            for worker in self._workers.values():
                worker.disable(lambda _told: None)
