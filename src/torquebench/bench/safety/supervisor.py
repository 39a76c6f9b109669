"""The supervisor: monitors the bench independently of procedures and brings it to a safe state.

Acquisition passes each block to the supervisor first; the supervisor's own thread monitors drives,
heartbeats, the operator's presence and acquisition itself. It therefore acts when the run engine
hangs, when the event loop is blocked and when acquisition stalls. If the whole process ends, the
drives' watchdogs are no longer fed and stop the drives.
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
from torquebench.bench.safety.limits import LimitBook
from torquebench.bench.safety.priority import lift_process, prefer_this_thread
from torquebench.bench.safety.signals import Change, FastCheck, SignalJudge
from torquebench.bench.safety.stopping import (
    FAST_PATIENCE,
    GOING_OFF_S,
    PRESS_STOP,
    Remaining,
    Stage,
    StopSequence,
    remaining_in_words,
)
from torquebench.bench.state import CommandState
from torquebench.errors import InterlockError
from torquebench.message import Message

logger = logging.getLogger(__name__)

WATCH_PERIOD_S = 0.005
"""Interval of the supervisor's thread in real time, s of wall time."""
REST_PERIOD_S = 0.02
"""Interval of the checks in real time while no drive has power and the bench is safe, s."""
IDLE_PERIOD_S = 0.05
"""Interval of that thread in simulated time, in which acquisition makes most checks, block by
block."""
FAST_SILENCE_S = 0.5
"""Time without a block after which the drives are polled in simulated time, s of wall time."""
DRIVE_PATIENCE_S = 0.1
"""Longest time for which simulated time waits for a slow drive, s of wall time."""
ANSWER_S = 10.0
"""Longest time for switching a drive off, with all attempts of its connection, s of wall time."""


class SafetySupervisor:
    """Monitors limits, signals, drives and heartbeats; ramps to zero, stops, disables and latches.

    Parameters
    ----------
    description : BenchDescription
        Limits of both sides and the section `[safety]`.

    Attributes
    ----------
    limits : LimitBook
        The limits in force; steps of a procedure tighten them.
    heartbeats : Heartbeats
        Required heartbeats.
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
        self._stop = StopSequence(description, clock, commands, self._workers, self._book)
        self._unreachable_since: dict[Side, float] = {}
        self._on_since: dict[Side, float] = {}
        self._late: int | None = None  # number of the warning about late acquisition
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
        """The latched alarm; None if there is none."""
        return self._book.latched

    @property
    def alarms(self) -> tuple[RaisedAlarm, ...]:
        """Active alarms, the worst first: the latched alarm, its later causes, warnings."""
        return self._book.active

    @property
    def history(self) -> tuple[Alarm, ...]:
        """Every critical alarm since the bench was opened, with later causes of a latched one."""
        critical = AlarmLevel.CRITICAL
        return tuple(entry.alarm for entry in self._book.entries if entry.alarm.level is critical)

    @property
    def entries(self) -> tuple[RaisedAlarm, ...]:
        """Every alarm and warning since the bench was opened, with its history."""
        return self._book.entries

    @property
    def safe(self) -> bool:
        """Whether the bench is at rest: after an alarm, the safe state has been read back."""
        return self._stop.stage is Stage.SAFE

    @property
    def unsafe(self) -> Alarm | None:
        """The alarm about remaining power or torque after a stop; None if there is none."""
        latched = self._book.latched
        if latched is None or latched.kind is not AlarmKind.NOT_SAFE or self.safe:
            return None
        return latched

    @property
    def unconfirmed(self) -> bool:
        """Whether drives had power and haven't been read back as off since."""
        return self._stop.powered

    def raise_if_latched(self) -> None:
        """Raise the latched alarm's error."""
        alarm = self._book.latched
        if alarm is not None:
            raise alarm.error()

    def wait_safe(self, timeout_s: float) -> bool:
        """Wait (wall time) until the safe state is read back; return False if it isn't reached."""
        self._stop.wait(timeout_s)
        return self.safe

    def still_on(self) -> Sequence[Remaining]:
        """Return power and torque that remain, or may remain, by reading back.

        Empty while drives are supposed to have power.
        """
        if self._commands.any_enabled and self._book.latched is None:
            return ()
        return [rest for rest in self._stop.remaining() if not rest.gone]

    def acknowledge(self, who: str, seen: Collection[int] | None = None) -> Alarm | None:
        """Acknowledge the latched alarm after the safe state was read back; return this alarm.

        If the cause persists, for example a temperature within the hysteresis of its limit, the
        alarm is raised again at once.

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
            if self._stop.stage is Stage.RAMPING:
                raise InterlockError(
                    Message("alarm {alarm} while the drives still ramp to zero", alarm.kind.value),
                    "acknowledgement in the safe state",
                    "wait a moment",
                )
            if still := self.still_on():
                certain = self._stop.stage is Stage.NOT_SAFE or any(rest.power for rest in still)
                raise InterlockError(
                    Message("alarm {alarm}, {still}", alarm.kind.value, remaining_in_words(still)),
                    self._stop.read_back.allowed(),
                    PRESS_STOP
                    if certain
                    else "wait a moment; check that drive and signal can be read",
                )
            if not who.strip():
                raise InterlockError("acknowledgement by nobody", "a person's name")
            acknowledged = self._book.acknowledge(who.strip(), seen)
            self._signals.forget()
        self._book.announce(*acknowledged)  # without the lock: a listener may wait for a disk
        return alarm

    def subscribe(self, listener: Callable[[RaisedAlarm], None]) -> None:
        """Call this function when an alarm or a warning is raised, cleared or acknowledged.

        It is called in the supervisor's or acquisition's thread, and must be fast.
        """
        self._book.subscribe(listener)

    def warn(self, kind: AlarmKind, source: str, found: str, allowed: str, remedy: str) -> Alarm:
        """Raise a warning: it doesn't stop the bench, and lasts until acknowledged or cleared."""
        alarm = self._book.add(
            Alarm(kind, source, found, allowed, remedy, self._clock.now(), AlarmLevel.WARNING)
        )
        self._book.announce(alarm.number)
        return alarm

    def clear_warning(self, number: int) -> None:
        """Clear a warning whose cause has disappeared."""
        self._book.clear(number)

    # -- called by acquisition --------------------------------------------------------------

    @contextlib.contextmanager
    def guarding_block(self) -> Iterator[None]:
        """Report a stall if a block takes longer than `stall_s` of wall time."""
        self._busy_since = time.monotonic()
        try:
            yield
        finally:
            self._busy_since = None

    def check_edges(self, measured: Block, channels: Mapping[str, FastCheck]) -> None:
        """Check the raw edges of a few milliseconds, before they become samples."""
        self._busy_since = (
            time.monotonic()
        )  # part of a block has arrived, so that acquisition isn't stalled
        self._act(*self._signals.check_edges(measured, channels))

    def check(self, block: Block) -> None:
        """Check a block, react to violations, and continue a stop that has begun."""
        self._checked_wall = time.monotonic()
        self._act(*self._signals.judge(block))
        self._stop.read_back.take(block)
        # bench time passes only with blocks, so that the other checks are made with them
        if self._clock.fast:
            self._look_around()
        self._go_on(block.stop_s)

    def _act(self, violation: Violation | None, changes: list[Change]) -> None:
        """Trip for a violation, and raise or clear the warnings that changed."""
        if violation is not None and self._book.latched is None:
            self._trip_for(self._with_acting_limit(violation))
        for change in changes:
            if change.watch.number:
                self._book.clear(change.watch.number)
                change.watch.number = 0
            found = change.violation
            if found is not None:
                change.watch.number = self.warn(
                    found.kind, found.source, found.found, found.allowed, found.remedy
                ).number

    def _with_acting_limit(self, violation: Violation) -> Violation:
        """Add to a command that a drive doesn't follow whether the drive's own limit acts."""
        if violation.kind is not AlarmKind.FOLLOWING:
            return violation
        state = next(w.state for side, w in self._workers.items() if side == violation.source)
        if state is None or not state.limited:
            return violation
        words = Message("{found}; the drive states that its own limit acts", violation.found)
        return replace(violation, found=words)

    def check_lateness(self, late_s: float, allowed_s: float) -> None:
        """Check acquisition's delay: with power on it stops the bench, otherwise it is shown."""
        if late_s <= allowed_s:
            if self._late is not None:
                self._book.clear(self._late)
                self._late = None
            return
        message = Message("the newest samples are {seconds:.1f} s old", late_s)
        allowed = Message("at most {seconds:g} s", allowed_s)
        remedy = "wait until it has caught up; close other programs that load the computer"
        if self._commands.any_enabled and self._book.latched is None:
            self.trip(AlarmKind.STALL, "acquisition", message, allowed, remedy)
        elif self._late is None:
            self._late = self.warn(AlarmKind.STALL, "acquisition", message, allowed, remedy).number

    # -- drives and heartbeats --------------------------------------------------------------

    def _look_around(self) -> None:
        """Poll the drives, feed their watchdogs, and check the heartbeats."""
        latched = self._book.latched is not None
        for side in self._workers:
            if not self._commands.side(side).enabled:
                self._enabled_since.pop(side, None)
            else:
                self._stop.powered = True
                self._enabled_since.setdefault(side, time.monotonic())
        feed = not latched or self._stop.stage is Stage.RAMPING
        self.heartbeats.ask()  # also without power: they must be present when it comes on
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
        """Return the first fault of an enabled drive; None without any."""
        for side, worker in self._workers.items():
            since = self._enabled_since.get(side)
            if since is None:
                continue
            commands = self._commands.side(side)
            watchdog_s = self._description.module(side).drive.watchdog_s
            defect = worker.found_wrong(since, commands.enabled_wall_s, watchdog_s)
            # It may have been switched off meanwhile: the last command counts.
            if defect and commands.enabled:
                return Violation(
                    AlarmKind.DRIVE_FAULT,
                    side,
                    Message("{side} drive: {fault}", side, defect),
                    "an enabled drive without fault",
                    "read the drive's fault code",
                )
        return None

    def _unasked_power(self) -> Violation | None:
        """Return a violation if a drive has power without a command."""
        now = self._clock.now() if self._clock.fast else time.monotonic()
        for side, worker in self._workers.items():
            commands = self._commands.side(side)
            state = worker.read(time.monotonic() - GOING_OFF_S)
            if commands.enabled or commands.switching or state is None or not state.enabled:
                self._on_since.pop(side, None)
            elif now - self._on_since.setdefault(side, now) > GOING_OFF_S:
                torque_nm = self._stop.read_back.torque_nm(side, self._clock.now() - GOING_OFF_S)
                return self._stop.not_safe([Remaining(side, True, torque_nm)])
        return None

    # -- acting -----------------------------------------------------------------------------

    def trip(self, kind: AlarmKind, source: str, found: str, allowed: str, remedy: str) -> Alarm:
        """Bring the bench to its safe state and latch an alarm; callable from any thread.

        While an alarm is latched, further alarms are only added to the history.
        """
        with self._lock:
            first = self._book.latched is None
            if first:  # before others see that the bench is on its way to the safe state
                self._stop.powered = self._stop.powered or self._commands.any_enabled
                self._stop.begin_ramp()
            violation = Violation(kind, source, found, allowed, remedy)
            alarm = self._book.add(violation.alarm(self._clock.now()))
            if first:
                for side in SIDES:
                    self._stop.ramp_to_zero(side, self._description.safety.ramp_to_zero_s)
                self._stop.begin_ramp()  # its time counts from the drives' answers
        if first:
            self._clock.interrupt(alarm.error())
            self._go_on()
        self._book.announce(alarm.number)  # without the lock: a listener may wait for a disk
        return alarm

    def _go_on(self, now_s: float | None = None) -> None:
        """Take the next steps towards the safe state that the present readings allow."""
        now_s = self._clock.now() if now_s is None else now_s
        with self._lock:
            violation = self._stop.advance(now_s)
            if self._clock.fast and self._stop.stage in (Stage.RAMPING, Stage.GOING_OFF):
                self._clock.require(self._clock.now() + 2.0 * self._description.counter.block_s)
            news, self._stop.news = self._stop.news, []
        self._book.announce(*news)
        if violation is not None:
            self._trip_for(violation)

    def _trip_for(self, violation: Violation) -> Alarm:
        return self.trip(
            violation.kind, violation.source, violation.found, violation.allowed, violation.remedy
        )

    def unload(self, sides: Iterable[Side] = SIDES) -> float:
        """Ramp drives to zero torque and speed at their usual rates, without an alarm.

        Returns
        -------
        float
            Bench time until the drives are at zero and have settled, s; 0 if they already are.
        """
        with self._lock:
            return self._stop.unload(sides)

    def disable(self) -> None:
        """Switch off both drives after an operation, and check that the power goes off.

        With an alarm latched, the supervisor does this by itself after the ramp. A drive that
        doesn't accept the command causes an alarm.
        """
        with self._lock:
            if self._book.latched is not None and self._stop.stage is not Stage.SAFE:
                return
            self._unreachable_since = dict.fromkeys(self._workers, time.monotonic())

            def done(side: Side, was_told: bool) -> None:
                """Trip if a drive didn't take the order to go off."""
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
            Whether the torque must also be zero.
        """
        if self._book.latched is not None:
            self.wait_safe(GOING_OFF_S)
            return self.unsafe
        violation = self._stop.read_off(sides, torque=torque)
        return None if violation is None else self._trip_for(violation)

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
        """Watch drives, acquisition and heartbeats until the bench is closed."""
        if not self._clock.fast:
            prefer_this_thread()
        while not self._closing.wait(self._period_s()):
            try:
                self._watch_once()
            except Exception as error:  # nobody supervises this thread, so that it has to continue
                self._fail(error)

    def _period_s(self) -> float:
        """Return the time until the next check."""
        if self._clock.fast:
            return IDLE_PERIOD_S
        resting = self._stop.stage is Stage.SAFE and not self._commands.any_powered
        return REST_PERIOD_S if resting else WATCH_PERIOD_S

    def _watch_once(self) -> None:
        """Look for stalls and unreachable drives, and go on towards the safe state."""
        if self._stalls() and self._book.latched is None and self._commands.any_enabled:
            message = Message("no block of samples for {seconds:g} s of wall time", self._stall_s)
            remedy = "check the counter's connection and the computer's load"
            self.trip(AlarmKind.STALL, "acquisition", message, "a block in its own time", remedy)
        if not self._clock.fast:
            self._look_around()
        elif self._stop.stage is not Stage.SAFE:
            if time.monotonic() - self._checked_wall > FAST_SILENCE_S:  # no more blocks come
                self._look_around()
            if self._stop.stage is Stage.NOT_SAFE:  # wall time continues until the bench is safe
                self._clock.require(self._clock.now() + self._description.counter.block_s)
        self._go_on()
        for side, since in tuple(self._unreachable_since.items()):
            if time.monotonic() - since > ANSWER_S:
                self._unreachable_since.pop(side, None)
                if self._book.latched is None:
                    self._trip_for(unreachable(side))

    def _stalls(self) -> bool:
        """Return whether a block takes too long or, in real time, no block is being acquired."""
        busy_since, now = self._busy_since, time.monotonic()
        if busy_since is not None:
            return now - busy_since > self._stall_s
        between_s = self._stall_s + self._description.counter.block_s
        return not self._clock.fast and now - self._checked_wall > between_s

    def _fail(self, error: Exception) -> None:
        """Go to the safe state after an error in the supervisor itself."""
        message = Message("{name}: {error}", type(error).__name__, error)
        if message == self._failed:
            return  # it repeats with every check
        self._failed = message
        logger.error("the supervisor failed", exc_info=error)
        try:
            self.trip(
                AlarmKind.SUPERVISOR,
                "supervisor",
                message,
                "a supervisor that receives all data",
                "open the bench again; if it happens again, report it",
            )
        except Exception:  # if even that fails, the power is switched off without a ramp
            logger.exception("the supervisor can't stop the bench normally")
            for worker in self._workers.values():
                worker.disable(lambda _told: None)
