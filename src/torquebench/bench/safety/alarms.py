"""Alarms: what they are, which of them stand, and who has acknowledged them."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from enum import Enum, IntEnum

from torquebench.errors import (
    BenchError,
    LimitError,
    RecordError,
    SignalFault,
    TorquebenchError,
)

__all__ = ["Alarm", "AlarmBook", "AlarmKind", "AlarmLevel", "StandingAlarm", "Violation"]


class AlarmKind(Enum):
    """What is wrong."""

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
    """How bad it is: a warning is only said, a critical alarm stops the bench and latches."""

    WARNING = 1
    CRITICAL = 2


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
    """What is wrong, in the words of an alarm."""

    kind: AlarmKind
    source: str
    found: str
    allowed: str
    remedy: str


@dataclass(frozen=True)
class Alarm:
    """Why the bench was brought to its safe state, or what its operator should know.

    Parameters
    ----------
    kind : AlarmKind
    source : str
        Channel, side, probe, heartbeat or instrument.
    found, allowed, remedy : str
        The cause with value and unit, the limit, and what to do, as in every error of this
        project.
    time_s : float
        Bench time.
    level : AlarmLevel
    number : int
        Counts the alarms of an open bench from 1.
    raised : datetime.datetime
        When it came, UTC.
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
        """Error to raise in whatever was going on."""
        found = f"{self.kind.value}: {self.found} at {self.time_s:.3f} s of bench time"
        return _ERRORS.get(self.kind, BenchError)(found, self.allowed, self.remedy)


@dataclass(frozen=True)
class StandingAlarm:
    """An alarm and what has become of it.

    Parameters
    ----------
    alarm : Alarm
    cleared : datetime.datetime or None
        When a warning's cause went away by itself, UTC; None while it stands.
    acknowledged_by : str
        Who has acknowledged it; empty while nobody has.
    acknowledged : datetime.datetime or None
        When, UTC.
    """

    alarm: Alarm
    cleared: datetime | None = None
    acknowledged_by: str = ""
    acknowledged: datetime | None = None

    @property
    def stands(self) -> bool:
        """Whether it still concerns the bench."""
        if self.alarm.level is AlarmLevel.CRITICAL:
            return self.acknowledged is None
        return self.cleared is None


class AlarmBook:
    """Every alarm since the bench was opened; safe to use from any thread.

    Listeners are called with each new alarm and again when it is cleared or acknowledged, in the
    thread that notes it; one that raises is left out silently, since the bench comes first.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._entries: list[StandingAlarm] = []
        self._latched: Alarm | None = None
        self._listeners: tuple[Callable[[StandingAlarm], None], ...] = ()

    def subscribe(self, listener: Callable[[StandingAlarm], None]) -> None:
        """Call this whenever an alarm comes, is cleared or is acknowledged."""
        self._listeners = (*self._listeners, listener)

    @property
    def latched(self) -> Alarm | None:
        """The critical alarm that stopped the bench, None when there is none.

        One that says that the bench isn't safe takes the place of what it began with.
        """
        return self._latched

    @property
    def entries(self) -> tuple[StandingAlarm, ...]:
        """Every alarm with what has become of it, the oldest first."""
        return tuple(self._entries)

    @property
    def standing(self) -> tuple[StandingAlarm, ...]:
        """Those that still concern the bench: the worst first, then the oldest."""

        def urgency(entry: StandingAlarm) -> tuple[bool, int, int]:
            alarm = entry.alarm
            return alarm.kind is not AlarmKind.NOT_SAFE, -alarm.level, alarm.number

        return tuple(sorted((entry for entry in self.entries if entry.stands), key=urgency))

    def add(self, alarm: Alarm) -> Alarm:
        """Note an alarm under its number; the first critical one is the one that latches.

        Listeners hear of it by `announce`: the bench is stopped before anybody is told.
        """
        with self._lock:
            numbered = replace(alarm, number=len(self._entries) + 1)
            self._entries.append(StandingAlarm(numbered))
            urgent = self._latched is None or numbered.kind is AlarmKind.NOT_SAFE
            if urgent and numbered.level is AlarmLevel.CRITICAL:
                self._latched = numbered
        return numbered

    def restate(self, number: int, found: str) -> None:
        """Say anew what an alarm has found, as it has changed meanwhile; see `announce`."""
        with self._lock:
            entry = self._entries[number - 1]
            alarm = replace(entry.alarm, found=found)
            self._entries[number - 1] = replace(entry, alarm=alarm)
            if self._latched is not None and self._latched.number == number:
                self._latched = alarm

    def announce(self, *numbers: int) -> None:
        """Tell the listeners of alarms, or of what has become of them."""
        self._tell([self._entries[number - 1] for number in numbers])

    def clear(self, number: int) -> None:
        """Note that a warning's cause has gone."""
        with self._lock:
            entry = self._entries[number - 1]
            if not entry.stands:
                return
            entry = self._entries[number - 1] = replace(entry, cleared=datetime.now(UTC))
        self._tell([entry])

    def acknowledge(self, who: str) -> tuple[int, ...]:
        """Acknowledge every alarm that stands; return their numbers, for `announce`."""
        with self._lock:
            self._latched = None
            moment = datetime.now(UTC)
            changed = []
            for place, entry in enumerate(self._entries):
                if entry.stands and entry.acknowledged is None:
                    entry = replace(entry, acknowledged_by=who, acknowledged=moment)
                    self._entries[place] = entry
                    changed.append(place + 1)
        return tuple(changed)

    def _tell(self, entries: list[StandingAlarm]) -> None:
        for entry in entries:
            for listener in self._listeners:
                try:
                    listener(entry)
                except Exception:  # a viewer's fault must never keep the bench busy
                    continue
