"""Find implausible times in the records: clocks that were set back, expired standards."""

from collections import defaultdict
from collections.abc import Collection, Iterator
from datetime import UTC, date, datetime
from typing import TYPE_CHECKING, Any

from sqlalchemy import select

from torquebench.message import Message
from torquebench.records.registry.database import Database
from torquebench.records.registry.entries import RunSummary, links, metadata
from torquebench.units import DAY, HOUR

if TYPE_CHECKING:
    from torquebench.records.registry.registry import Registry

calibrations, equipment, reports, run_ends, runs = (
    metadata.tables[name] for name in ("calibrations", "equipment", "reports", "run_ends", "runs")
)

TOLERANCE_S = 2.0
"""Largest clock correction by a time server that is accepted, s."""
SERVER_TOLERANCE_S = 60.0
"""Largest accepted difference between the clocks of benches that share a registry, s."""


def time_remarks(registry: Database) -> Iterator[str]:
    """Yield a message for every impossible or doubtful time in the records."""
    for _, said in _ends_before_beginnings(registry):
        yield said
    yield from _entries_before_earlier_ones(registry)
    for _, said in _expired_standards(registry):
        yield said


def doubts_of_runs(registry: Database, run_ids: Collection[str]) -> dict[str, tuple[str, ...]]:
    """Return messages about impossible times of these runs, by run."""
    found: defaultdict[str, list[str]] = defaultdict(list)
    for run_id, said in _ends_before_beginnings(registry, run_ids):
        found[run_id].append(said)
    query = (
        select(runs.c.id, run_ends.c.id, runs.c.run_id)
        .outerjoin(run_ends, run_ends.c.run_key == runs.c.id)
        .where(runs.c.run_id.in_(run_ids))
    )
    with registry.session() as session:
        rows = session.execute(query).all()
    begun = {begin: run_id for begin, _, run_id in rows}
    ended = {end: run_id for _, end, run_id in rows}
    for table, names in ((runs.name, begun), (run_ends.name, ended)):
        for key, said in _entries_back(registry, table, names):
            found[names[key]].append(said)
    return {run_id: tuple(said) for run_id, said in found.items()}


def doubts_of_calibrations(registry: Database, ids: Collection[int]) -> dict[int, tuple[str, ...]]:
    """Return messages about impossible or doubtful times of these calibrations, by number.

    The standard had expired, the clock was set back, or the run ended before it began.

    Parameters
    ----------
    ids : collection of int
        Numbers of calibrations.
    """
    found: defaultdict[int, list[str]] = defaultdict(list)
    for number, said in _expired_standards(registry, ids):
        found[number].append(said)
    for number, said in _entries_back(registry, calibrations.name, ids):
        found[number].append(said)
    query = (
        select(calibrations.c.id, runs.c.run_id)
        .join(runs, calibrations.c.run_key == runs.c.id)
        .where(calibrations.c.id.in_(ids))
    )
    with registry.session() as session:
        numbers = {run_id: number for number, run_id in session.execute(query)}
    for run_id, said_of_run in doubts_of_runs(registry, numbers).items():
        found[numbers[run_id]] += said_of_run
    return {number: tuple(said) for number, said in found.items()}


def clock_behind(registry: Database, now: datetime | None = None) -> str:
    """Return a message if this computer's clock is earlier than the newest record, or ""."""
    moment = now or datetime.now(UTC)
    with registry.session() as session:
        query = select(links.c.recorded).order_by(links.c.sequence.desc()).limit(1)
        newest = session.scalar(query)
    if newest is None:
        return ""
    recorded = datetime.fromisoformat(newest)
    behind_s = (recorded - moment).total_seconds()
    if behind_s <= _tolerance_s(registry):
        return ""
    return Message(
        "this computer's clock says {moment:%Y-%m-%d %H:%M:%S} UTC, {passed} "
        "before the newest record",
        moment,
        _duration(behind_s),
    )


def expired_on(day: date, due: date | None) -> bool:
    """Return whether a certificate has expired on a day; it is still valid on its last day.

    Examples
    --------
    >>> expired_on(date(2026, 1, 31), date(2026, 1, 31)), expired_on(date(2026, 2, 1), None)
    (False, False)
    """
    return due is not None and day > due


def expired_standard(
    registry: "Registry", what: str, serial: str, due: date | None, today: date | None = None
) -> str:
    """Return a message if all certificates of a standard have expired, otherwise "".

    Parameters
    ----------
    registry : Registry
        Registry with the entered certificates.
    what, serial : str
        Kind of standard, as shown in the message, and its serial number.
    due : datetime.date or None
        Last valid day of the certificate that the bench description names.
    """
    dues = [each for each in (due, *(report.due for report in registry.reports(serial))) if each]
    if not dues or not expired_on(today or datetime.now(UTC).date(), max(dues)):
        return ""
    return Message(
        "the certificate of the {what} {serial} expired on {dues}: have it "
        "calibrated, then enter its new certificate in the bench description or "
        "with `torquebench records add-certificate`",
        what,
        serial,
        max(dues),
    )


def times_of_run(run: RunSummary) -> str:
    """Return a message if a run ended before it began, otherwise ""."""
    if run.finished is None or run.finished >= run.started:
        return ""
    return _end_before_beginning(run.run_id, run.started, run.finished)


def _end_before_beginning(run_id: str, started: datetime, finished: datetime) -> str:
    return Message(
        "run {run} ended ({end:%Y-%m-%d %H:%M:%S}) before it began "
        "({beginning:%Y-%m-%d %H:%M:%S}): the clock was set back in the meantime",
        run_id,
        finished,
        started,
    )


def _ends_before_beginnings(
    registry: Database, run_ids: Collection[str] | None = None
) -> Iterator[tuple[str, str]]:
    """Yield identifier and message of every run, or of those named, that ended before it began."""
    query = (
        select(runs.c.run_id, runs.c.started, run_ends.c.finished)
        .join(run_ends, run_ends.c.run_key == runs.c.id)
        .where(run_ends.c.finished < runs.c.started)
        .order_by(runs.c.id)
    )
    if run_ids is not None:
        query = query.where(runs.c.run_id.in_(run_ids))
    with registry.session() as session:
        for run_id, started, finished in session.execute(query):
            yield run_id, _end_before_beginning(run_id, started, finished)


def _entries_before_earlier_ones(registry: Database) -> Iterator[str]:
    query = select(links.c.sequence, links.c.table, links.c.key, links.c.recorded)
    tolerance_s, latest = _tolerance_s(registry), None
    with registry.session() as session:
        rows = session.execute(query.order_by(links.c.sequence).execution_options(yield_per=1000))
        for sequence, table, key, text in rows:
            try:
                recorded = datetime.fromisoformat(text)
            except ValueError:  # a changed chain, which `records verify` reports
                continue
            if latest is not None:
                back_s = (latest - recorded).total_seconds()
                if back_s > tolerance_s:
                    yield _recorded_back(sequence, table, key, back_s)
            latest = recorded


def _recorded_back(sequence: int, table: str, key: int, back_s: float) -> str:
    return Message(
        "entry {sequence} ({table} {key}) was recorded {back_s} before the entry "
        "before it: the clock ran backwards",
        sequence,
        table,
        key,
        _duration(back_s),
    )


def _entries_back(
    registry: Database, table: str, keys: Collection[int]
) -> Iterator[tuple[int, str]]:
    """Yield number and message of these rows if they are dated before the preceding entry."""
    before, tolerance_s = links.alias(), _tolerance_s(registry)
    query = (
        select(links.c.sequence, links.c.key, links.c.recorded, before.c.recorded)
        .join(before, before.c.sequence == links.c.sequence - 1)
        .where(links.c.table == table, links.c.key.in_(keys))
        .order_by(links.c.sequence)
    )
    with registry.session() as session:
        for sequence, key, recorded, earlier in session.execute(query):
            try:
                passed = datetime.fromisoformat(recorded) - datetime.fromisoformat(earlier)
            except ValueError:  # a changed chain, which `records verify` reports
                continue
            if -passed.total_seconds() > tolerance_s:
                yield key, _recorded_back(sequence, table, key, -passed.total_seconds())


def _expired_standards(
    registry: Database, ids: Collection[int] | None = None
) -> Iterator[tuple[int, str]]:
    """Yield number and message of calibrations made against an expired standard."""
    query = select(
        calibrations.c.id, calibrations.c.performed, equipment.c.id.label("key"), equipment.c.serial
    ).join(equipment, equipment.c.id == calibrations.c.standard_key)
    if ids is not None:
        query = query.where(calibrations.c.id.in_(ids))
    with registry.session() as session:
        reports_of: defaultdict[int, list[Any]] = defaultdict(list)
        for report in session.execute(select(reports).order_by(reports.c.id)):
            reports_of[report.equipment_key].append(report)
        for row in session.execute(query.order_by(calibrations.c.id)):
            day = row.performed.date()
            known = [
                report
                for report in reports_of[row.key]
                if report.performed is None or report.performed <= day
            ]
            if known and expired_on(day, known[-1].due):
                said = Message(
                    "calibration-{number} was made on {day} against {serial}, whose "
                    "certificate {certificate} had expired on {due}",
                    row.id,
                    day,
                    row.serial,
                    known[-1].number,
                    known[-1].due,
                )
                yield row.id, said


def _tolerance_s(registry: Database) -> float:
    return TOLERANCE_S if registry.dialect == "sqlite" else SERVER_TOLERANCE_S


def _duration(seconds: float) -> str:
    """Return a duration as text with a suitable unit.

    Examples
    --------
    >>> _duration(90.0), _duration(5400.0), _duration(200000.0)
    ('90 s', '1.5 h', '2.3 days')
    """
    if seconds < 600.0:
        return Message("{seconds:.0f} s", seconds)
    return (
        Message("{seconds:.1f} h", seconds / HOUR)
        if seconds < 172800.0
        else Message("{count:.1f} days", seconds / DAY)
    )
