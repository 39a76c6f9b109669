"""List what is due for calibration: standards by certificates, transducers by calibrations."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import Annotated

from torquebench.message import Message
from torquebench.operations.operation import WHOLE, Operation, Request, field
from torquebench.operations.place import Place
from torquebench.operations.result import Result
from torquebench.progress import Progress
from torquebench.records import Registry
from torquebench.reports.page import Page, Section, Table


class DueRequest(Request):
    """List which standards and transducers are due for calibration; overdue ones fail the check."""

    within_days: Annotated[int, field("How far to look ahead.", ge=0, le=36_500), WHOLE] = 30


@dataclass(frozen=True)
class DueEquipment:
    """A standard or transducer, and the last day of its certificate or calibration."""

    kind: str
    serial: str
    record: str
    due: date
    days_left: int


@dataclass(frozen=True, kw_only=True)
class DueRecords(Result):
    """Equipment that is due, the most urgent first."""

    equipment: Sequence[DueEquipment]

    @property
    def failed(self) -> bool:
        """Whether something is overdue."""
        return any(row.days_left < 0 for row in self.equipment)

    def page(self) -> Page:
        """Return a table."""
        header = ("kind", "serial number", "record", "due", "days left")
        rows = [
            (row.kind, row.serial, row.record, row.due.isoformat(), str(row.days_left))
            for row in self.equipment
        ]
        tables = [Table(header, rows)] if rows else []
        return Page("Due for calibration", "", [Section("", "", tables)])


def run_due(place: Place, request: DueRequest, _progress: Progress) -> DueRecords:
    """Compare the last day of each standard and transducer with today (UTC)."""
    today = datetime.now(UTC).date()
    equipment = [
        DueEquipment(kind, serial, record, due, (due - today).days)
        for kind, serial, record, due in _last_days(place.registry)
        if (due - today).days <= request.within_days
    ]
    return DueRecords(
        headline=Message(
            "{count} due within {days} days, {overdue} of them overdue.",
            len(equipment),
            request.within_days,
            sum(row.days_left < 0 for row in equipment),
        ),
        equipment=sorted(equipment, key=lambda row: (row.due, row.kind, row.serial)),
    )


def _last_days(registry: Registry) -> Iterator[tuple[str, str, str, date]]:
    """Yield kind, serial number, record and its last day, where one is stated.

    Of certificates, the one that is valid longest counts; of calibrations, the one performed last.
    """
    for item in registry.equipment():
        reports = [report for report in registry.reports(item.serial) if report.kind == item.kind]
        days = [(report.due, report.number) for report in reports if report.due is not None]
        if days:
            due, number = max(days)
            yield item.kind, item.serial, number, due
        entries = registry.calibrations(item.serial) if item.kind == "transducer" else []
        if entries:
            latest = max(entries, key=lambda entry: entry.performed)
            if latest.due is not None:
                record = f"calibration-{latest.calibration_id}"
                yield item.kind, item.serial, record, latest.due


DUE = Operation(
    "records due", DueRequest, run_due, lambda _request: "Due for calibration", quick=True
)
