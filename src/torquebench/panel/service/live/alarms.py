"""Alarms as pages and clients show them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from torquebench.bench.safety import RaisedAlarm
from torquebench.errors import TorquebenchError

__all__ = ["AlarmView", "StopReport", "alarm_view"]


@dataclass(frozen=True)
class AlarmView:
    """An alarm: cause, remedy and history.

    Parameters
    ----------
    alarm_id : str
        Means this alarm for ever, also once the bench was opened again.
    number : int
        Counts from 1 since the bench was opened.
    level : str
        "warning" or "critical": the latter has stopped the bench.
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
        """Cause, limit and remedy in one line, as an error has them."""
        return str(TorquebenchError(self.found, self.allowed, self.remedy))


@dataclass(frozen=True)
class StopReport:
    """Result of a stop.

    Parameters
    ----------
    alarm_number : int
        Of the alarm that it latched, or added to the one that is.
    seconds : float
        From the request to both drives' zero command, s of wall time.
    """

    alarm_number: int
    seconds: float


def alarm_view(entry: RaisedAlarm) -> AlarmView:
    """Return an alarm as a value without behaviour."""
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
