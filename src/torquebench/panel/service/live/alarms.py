"""Alarms in the form for pages and clients."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from torquebench.bench.safety import RaisedAlarm
from torquebench.errors import TorquebenchError


@dataclass(frozen=True)
class AlarmView:
    """An alarm: cause, remedy and history.

    Parameters
    ----------
    alarm_id : str
        Permanent identifier, which stays unique when the bench is reopened.
    number : int
        Number since the bench was opened, from 1.
    level : str
        "warning" or "critical"; a critical alarm has stopped the bench.
    kind, source : str
    found, allowed, remedy : str
        Cause with value and unit, limit, and remedy.
    bench_time_s : float
    raised : datetime.datetime
    active : bool
        Whether it is still active.
    cleared : datetime.datetime or None
    acknowledged : datetime.datetime or None
    acknowledged_by : str
    """

    alarm_id: str
    number: int
    level: str
    kind: str
    source: str
    found: str
    allowed: str
    remedy: str
    bench_time_s: float
    raised: datetime
    active: bool
    cleared: datetime | None
    acknowledged: datetime | None
    acknowledged_by: str

    @property
    def message(self) -> str:
        """Cause, limit and remedy in one line, as in an error."""
        return str(TorquebenchError(self.found, self.allowed, self.remedy))


@dataclass(frozen=True)
class StopReport:
    """Result of a stop.

    Parameters
    ----------
    alarm_number : int
        Number of the alarm that the stop raised.
    seconds : float
        Time from the request to the zero command of both drives, s of wall time.
    """

    alarm_number: int
    seconds: float


def alarm_view(entry: RaisedAlarm) -> AlarmView:
    """Convert a raised alarm to a plain value."""
    alarm = entry.alarm
    return AlarmView(
        alarm_id=f"{alarm.raised:%Y%m%dT%H%M%S.%fZ}-{alarm.number}",
        number=alarm.number,
        level=alarm.level.name.lower(),
        kind=alarm.kind.value,
        source=alarm.source,
        found=alarm.found,
        allowed=alarm.allowed,
        remedy=alarm.remedy,
        bench_time_s=alarm.time_s,
        raised=alarm.raised,
        active=entry.active,
        cleared=entry.cleared,
        acknowledged=entry.acknowledged,
        acknowledged_by=entry.acknowledged_by,
    )
