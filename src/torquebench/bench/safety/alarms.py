"""Alarms: their kinds, which of them are active, and who has acknowledged them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from enum import Enum, IntEnum

from torquebench.errors import (
    BenchError,
    InterlockError,
    LimitError,
    RecordError,
    SignalFault,
    TorquebenchError,
)
from torquebench.message import Message


class AlarmKind(Enum):
    """Kind of an alarm: what is wrong."""

    TORQUE_LIMIT = "torque limit"
    SPEED_LIMIT = "speed limit"
    ANGLE_LIMIT = "angle limit"
    RATE_LIMIT = "rate limit"
    TEMPERATURE_LIMIT = "temperature limit"
    SIGNAL_LOST = "signal lost"
    DISAGREEMENT = "signals disagree"
    FOLLOWING = "command not followed"
    DRIVE_FAULT = "drive fault"
    JOURNAL = "journal failed"
    AUDIT = "audit log failed"
    REGISTRY = "registry behind"
    HEARTBEAT = "heartbeat missing"
    PRESENCE = "operator missing"
    STALL = "acquisition stalled"
    SUPERVISOR = "supervisor failed"
    DRIVER = "instrument failed"
    STOP = "stop requested"
    NOT_SAFE = "not in the safe state"


class AlarmLevel(IntEnum):
    """Severity: a warning is only displayed, a critical alarm stops the bench and latches."""

    WARNING = 1
    CRITICAL = 2


@dataclass(frozen=True)
class AlarmEntry:
    """Cause and remedy of a kind of alarm, for panel and documentation."""

    cause: str
    remedy: str


ALARM_CATALOGUE: dict[AlarmKind, AlarmEntry] = {
    AlarmKind.TORQUE_LIMIT: AlarmEntry(
        "A measured torque exceeded the limit in force for its side.",
        "Look for a jam or an overload of the chain. Unload before you touch anything.",
    ),
    AlarmKind.SPEED_LIMIT: AlarmEntry(
        "A measured speed exceeded the limit in force for its side.",
        "Look for a loose coupling and a wrong speed in the test's settings.",
    ),
    AlarmKind.ANGLE_LIMIT: AlarmEntry(
        "A side turned further from where its drive was switched on than `angle_deg` allows.",
        "Check whether the shaft slips or the test turns further than its settings allow.",
    ),
    AlarmKind.RATE_LIMIT: AlarmEntry(
        "Torque or speed changed faster than the limits allow.",
        "Look for a coupling that slips or a part that breaks, then load more slowly.",
    ),
    AlarmKind.TEMPERATURE_LIMIT: AlarmEntry(
        "A temperature probe is above its limit.",
        "Let the bench cool down and look at its cooling and lubrication.",
    ),
    AlarmKind.SIGNAL_LOST: AlarmEntry(
        "A channel delivered no valid signal for longer than allowed: no pulses, a stuck "
        "counter, a frequency outside its modulation, a silent encoder or probe.",
        "Look at the transducer's cable, plug and supply. A missing signal is never zero torque.",
    ),
    AlarmKind.DISAGREEMENT: AlarmEntry(
        "Transducer and reference standard read the same torque and differ by more than allowed.",
        "Two signals of the same quantity differ. Look for a slipping coupling, a loose cable "
        "or a swapped channel.",
    ),
    AlarmKind.FOLLOWING: AlarmEntry(
        "A drive does not do what it was commanded: torque or speed differs from the set point "
        "for too long.",
        "Look at the drive's enable, supply and settings. It didn't follow its command; don't "
        "use it until you know the cause.",
    ),
    AlarmKind.DRIVE_FAULT: AlarmEntry(
        "A drive reports a fault, lost its power, or can't be commanded.",
        "Read the fault on the drive, remove its cause, reset the drive.",
    ),
    AlarmKind.JOURNAL: AlarmEntry(
        "A document or a block of samples could not be written to the run folder.",
        "Make room on the disk or repair it, then repeat the run.",
    ),
    AlarmKind.AUDIT: AlarmEntry(
        "A line could not be written to the audit log.",
        "Make room on the disk or repair it before anything is moved.",
    ),
    AlarmKind.REGISTRY: AlarmEntry(
        "The registry's database does not answer. Measurement continues into the run folder.",
        "Check whether the registry's server runs and its disk has room. It catches up by itself.",
    ),
    AlarmKind.HEARTBEAT: AlarmEntry(
        "A part of the software that must report regularly did not.",
        "Wait until the computer is less busy. If it happens again, restart the panel.",
    ),
    AlarmKind.PRESENCE: AlarmEntry(
        "Nobody confirmed presence at the bench within `presence_s` while a drive had power.",
        "Come back to the bench and confirm that you are there.",
    ),
    AlarmKind.STALL: AlarmEntry(
        "The acquisition delivered no block in time.",
        "Look at the counter, its cable and its supply, then restart the panel.",
    ),
    AlarmKind.SUPERVISOR: AlarmEntry(
        "The safety supervisor itself failed; the bench was stopped.",
        "Restart the panel. If it happens again, report it with the audit log.",
    ),
    AlarmKind.DRIVER: AlarmEntry(
        "An instrument's driver failed, and the acquisition ended.",
        "Look at the instrument's supply and connection, then restart the panel.",
    ),
    AlarmKind.STOP: AlarmEntry(
        "A person or a program stopped the bench (panel, HTTP API, Ctrl-C).",
        "Ask why it was stopped. Acknowledge when the bench is safe to move.",
    ),
    AlarmKind.NOT_SAFE: AlarmEntry(
        "After a stop a drive's power or the torque is still read back.",
        "Press the emergency stop and keep away from the bench. Find out why the drive doesn't "
        "switch off; the alarm can be acknowledged when power and torque are read as gone.",
    ),
}
"""Cause and remedy of every kind of alarm."""


_ERRORS: dict[AlarmKind, type[TorquebenchError]] = {
    AlarmKind.TORQUE_LIMIT: LimitError,
    AlarmKind.SPEED_LIMIT: LimitError,
    AlarmKind.ANGLE_LIMIT: LimitError,
    AlarmKind.RATE_LIMIT: LimitError,
    AlarmKind.TEMPERATURE_LIMIT: LimitError,
    AlarmKind.SIGNAL_LOST: SignalFault,
    AlarmKind.DISAGREEMENT: SignalFault,
    AlarmKind.JOURNAL: RecordError,
    AlarmKind.AUDIT: RecordError,
    AlarmKind.REGISTRY: RecordError,
}


@dataclass(frozen=True)
class Violation:
    """A violated condition, with the fields of an alarm."""

    kind: AlarmKind
    source: str
    found: str
    allowed: str
    remedy: str

    def alarm(self, time_s: float, level: AlarmLevel = AlarmLevel.CRITICAL) -> Alarm:
        """Return the alarm for this violation."""
        return Alarm(self.kind, self.source, self.found, self.allowed, self.remedy, time_s, level)


@dataclass(frozen=True)
class Alarm:
    """Reason for the safe state, or a warning to the operator.

    Parameters
    ----------
    source : str
        Channel, side, probe, heartbeat or instrument.
    found, allowed, remedy : str
        The cause with value and unit, the limit, and what to do, as in every error of this
        project.
    time_s : float
        Bench time.
    number : int
        Number of the alarm since the bench was opened, from 1.
    raised : datetime.datetime
        Time of the event, UTC.
    """

    kind: AlarmKind
    source: str
    found: str
    allowed: str
    remedy: str
    time_s: float
    level: AlarmLevel = AlarmLevel.CRITICAL
    number: int = 0
    raised: datetime = field(default_factory=lambda: datetime.now(UTC))

    @property
    def name(self) -> str:
        """Kind and source, such as ``"torque limit: output_torque"``."""
        return f"{self.kind.value}: {self.source}"

    def error(self) -> TorquebenchError:
        """Error to be raised in the interrupted operation."""
        message = Message(
            "{kind}: {found} at {time:.3f} s of bench time",
            self.kind.value,
            self.found,
            self.time_s,
        )
        return _ERRORS.get(self.kind, BenchError)(message, self.allowed, self.remedy)


@dataclass(frozen=True)
class RaisedAlarm:
    """An alarm and its history.

    Parameters
    ----------
    cleared : datetime.datetime or None
        Time at which a warning's cause disappeared, UTC; None while it is active.
    acknowledged_by : str
        The person who has acknowledged it; empty before that.
    acknowledged : datetime.datetime or None
        Time of the acknowledgement, UTC.
    """

    alarm: Alarm
    cleared: datetime | None = None
    acknowledged_by: str = ""
    acknowledged: datetime | None = None

    @property
    def active(self) -> bool:
        """Whether the alarm still concerns the bench."""
        if self.alarm.level is AlarmLevel.CRITICAL:
            return self.acknowledged is None
        return self.cleared is None


class AlarmBook:
    """Every alarm since the bench was opened; safe to use from any thread.

    Listeners are called with each new alarm and again when it is cleared or acknowledged, in the
    calling thread; a listener's error is ignored, since the bench has priority.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._entries: list[RaisedAlarm] = []
        self._latched: Alarm | None = None
        self._listeners: tuple[Callable[[RaisedAlarm], None], ...] = ()

    def subscribe(self, listener: Callable[[RaisedAlarm], None]) -> None:
        """Call this function whenever an alarm is raised, cleared or acknowledged."""
        self._listeners = (*self._listeners, listener)

    @property
    def latched(self) -> Alarm | None:
        """The critical alarm that stopped the bench; None if there is none.

        An alarm that the bench isn't safe replaces the original one.
        """
        return self._latched

    @property
    def entries(self) -> tuple[RaisedAlarm, ...]:
        """Every alarm with its history, the oldest first."""
        return tuple(self._entries)

    @property
    def active(self) -> tuple[RaisedAlarm, ...]:
        """Alarms that still concern the bench: the worst first, then the oldest."""

        def urgency(entry: RaisedAlarm) -> tuple[bool, int, int]:
            alarm = entry.alarm
            return alarm.kind is not AlarmKind.NOT_SAFE, -alarm.level, alarm.number

        return tuple(sorted((entry for entry in self.entries if entry.active), key=urgency))

    def add(self, alarm: Alarm) -> Alarm:
        """Add an alarm with its number; the first critical one is latched.

        Listeners are called by `announce`, after the bench has been stopped.
        """
        with self._lock:
            numbered = replace(alarm, number=len(self._entries) + 1)
            self._entries.append(RaisedAlarm(numbered))
            urgent = self._latched is None or numbered.kind is AlarmKind.NOT_SAFE
            if urgent and numbered.level is AlarmLevel.CRITICAL:
                self._latched = numbered
        return numbered

    def restate(self, number: int, found: str) -> None:
        """Update an alarm's message after a change; listeners are called by `announce`."""
        with self._lock:
            entry = self._entries[number - 1]
            alarm = replace(entry.alarm, found=found)
            self._entries[number - 1] = replace(entry, alarm=alarm)
            if self._latched is not None and self._latched.number == number:
                self._latched = alarm

    def announce(self, *numbers: int) -> None:
        """Call the listeners with new or changed alarms."""
        self._tell([self._entries[number - 1] for number in numbers])

    def clear(self, number: int) -> None:
        """Clear a warning whose cause has disappeared."""
        with self._lock:
            entry = self._entries[number - 1]
            if not entry.active:
                return
            entry = self._entries[number - 1] = replace(entry, cleared=datetime.now(UTC))
        self._tell([entry])

    def acknowledge(self, who: str, seen: Collection[int] | None = None) -> tuple[int, ...]:
        """Acknowledge active alarms; return their numbers, for `announce`.

        Raises
        ------
        InterlockError
            A critical alarm isn't in `seen`.
        """
        with self._lock:
            for entry in self.active:
                alarm = entry.alarm
                if alarm.level is AlarmLevel.CRITICAL and not (
                    seen is None or alarm.number in seen
                ):
                    raise InterlockError(
                        Message("an alarm that was raised in the meantime: {found}", alarm.found),
                        "acknowledgement of the displayed alarms",
                        "look at the alarms again",
                    )
            self._latched = None
            moment = datetime.now(UTC)
            changed = []
            for number, entry in enumerate(self._entries):
                looked_at = seen is None or number + 1 in seen
                if entry.active and entry.acknowledged is None and looked_at:
                    entry = replace(entry, acknowledged_by=who, acknowledged=moment)
                    self._entries[number] = entry
                    changed.append(number + 1)
        return tuple(changed)

    def _tell(self, entries: list[RaisedAlarm]) -> None:
        """Pass alarms to all listeners, whose errors are ignored."""
        for entry in entries:
            for listener in self._listeners:
                try:
                    listener(entry)
                except Exception:  # a viewer's error must never block the bench
                    continue
