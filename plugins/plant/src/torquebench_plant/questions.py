"""Questions to a plant, each answered by a table with conclusions."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime
from math import sqrt
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from sqlalchemy import bindparam, text

from torquebench.calibration import individuals_chart
from torquebench.campaign.drifting import DriftSeries, drift_of, next_due
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records import CalibrationEntry, CheckEntry, Equipment, EquipmentKind, Zeroing
from torquebench.records.registry import entry_of
from torquebench.tables import write_table
from torquebench.units import DAY, DAYS_PER_YEAR
from torquebench_plant import statistics
from torquebench_plant.database import Plant
from torquebench_plant.folders import FolderStore

# -- answers -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Answer:
    """A table and its conclusions.

    Parameters
    ----------
    title : str
        The question, in words.
    columns : mapping of str to sequence
        Columns of one length; a name ends with its unit.
    facts : mapping of str to value
        Single values derived from the columns, by their names with units.
    notes : tuple of str
        Remarks, in sentences.
    simulated : bool
        Whether any value comes from a simulated bench.

    Examples
    --------
    >>> answer = Answer("Two", {"name": ["a", "b"], "value_nm": [1.0, None]})
    >>> len(answer), answer.rows()[1]
    (2, {'name': 'b', 'value_nm': None})
    """

    title: str
    columns: Mapping[str, Sequence[Any]]
    facts: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    simulated: bool = False

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def shown(self, most: int) -> list[dict[str, Any]]:
        """Return the rows to show if not all fit.

        Of values over time these are the last rows, otherwise the first rows, such as the most
        urgent due dates.
        """
        return self.rows()[-most:] if self.in_time else self.rows()[:most]

    @property
    def in_time(self) -> bool:
        """Whether the rows are values over time, the oldest first."""
        return "when" in self.columns

    def rows(self) -> list[dict[str, Any]]:
        """Return the table row by row."""
        names = tuple(self.columns)
        return [
            dict(zip(names, row, strict=True)) for row in zip(*self.columns.values(), strict=True)
        ]

    def write(self, path: Path) -> None:
        """Write the table in the format that the ending of the file's name states.

        Raises
        ------
        InputError
            The ending names no format, or the file can't be written.
        """
        write_table(path, self.columns)


# -- transducers and standards -------------------------------------------------------------------

TOLERANCE_PERCENT = 0.1
"""Tolerance of a span's drift, in %."""
LONGEST_DAYS = 365
"""Between calibrations without a last day."""
Entry = TypeVar("Entry", CalibrationEntry, Zeroing, CheckEntry)

# Valid rows: of benches that weren't replaced, runs not withdrawn, nothing rejected.
_COUNTS = """
  JOIN plant.benches b ON b.bench_key = c.bench_key AND b.replaced_by IS NULL
  LEFT JOIN plant.runs r ON r.bench_key = c.bench_key AND r.id = c.run_key
"""
_ACCEPTED = """r.withdrawn IS NULL AND NOT EXISTS (
  SELECT 1 FROM plant.reviews v WHERE v.bench_key = c.bench_key AND v.subject = '{table}'
    AND v.subject_key = c.id AND NOT v.accepted)
"""
_DUE_TRANSDUCERS = f"""
SELECT e.serial, 'transducer' AS kind, latest.bench_key, latest.name, latest.place,
  latest.performed::date AS performed, latest.due, coalesce(latest.simulated, false) AS simulated
FROM (SELECT DISTINCT serial FROM plant.equipment JOIN plant.benches USING (bench_key)
  WHERE kind = 'transducer' AND replaced_by IS NULL) AS e
LEFT JOIN LATERAL (
  SELECT c.bench_key, b.name, b.place, c.performed, c.due, c.simulated
  FROM plant.equipment own
  JOIN plant.calibrations c ON c.bench_key = own.bench_key AND c.transducer_key = own.id {_COUNTS}
  WHERE own.kind = 'transducer' AND own.serial = e.serial
    AND {_ACCEPTED.format(table="calibrations")}
  ORDER BY c.performed DESC LIMIT 1) AS latest ON true
"""
_DUE_STANDARDS = """
SELECT DISTINCT ON (e.kind, e.serial) e.serial, e.kind, b.bench_key, b.name, b.place,
  p.performed, p.due, false AS simulated
FROM plant.equipment e
JOIN plant.reports p ON p.bench_key = e.bench_key AND p.equipment_key = e.id
JOIN plant.benches b ON b.bench_key = e.bench_key AND b.replaced_by IS NULL
ORDER BY e.kind, e.serial, p.due DESC NULLS LAST, p.recorded DESC
"""
_OF_TRANSDUCER = f"""
SELECT c.*, e.serial, r.run_id, b.name{{more}} FROM plant.equipment e
JOIN plant.{{table}} c ON c.bench_key = e.bench_key AND c.transducer_key = e.id {_COUNTS}
WHERE e.kind = 'transducer' AND (CAST(:serial AS text) IS NULL OR e.serial = :serial)
  AND {_ACCEPTED}
ORDER BY c.performed
"""
_COUNTER = """, (SELECT serial FROM plant.equipment k
  WHERE k.bench_key = c.bench_key AND k.id = c.counter_key) AS counter_identity"""
_TRANSDUCERS = """
SELECT DISTINCT ON (e.serial) e.serial, d.manufacturer, d.model, d.range_nm, d.details
FROM plant.equipment e
JOIN plant.equipment_descriptions d ON d.bench_key = e.bench_key AND d.equipment_key = e.id
JOIN plant.benches b ON b.bench_key = e.bench_key AND b.replaced_by IS NULL
WHERE e.kind = 'transducer' ORDER BY e.serial, d.recorded DESC
"""
_POINTS = f"""
SELECT f.points_url, e.serial, c.performed, b.bench_key || ' ' || b.name AS bench, r.simulated
FROM plant.equipment e
JOIN plant.calibrations c ON c.bench_key = e.bench_key AND c.transducer_key = e.id
JOIN plant.benches b ON b.bench_key = c.bench_key AND b.replaced_by IS NULL
JOIN plant.runs r ON r.bench_key = c.bench_key AND r.id = c.run_key
JOIN plant.folders f ON f.bench_key = r.bench_key AND f.run_id = r.run_id
WHERE e.kind = 'transducer' AND e.serial IN :serials AND f.points_url IS NOT NULL
  AND {_ACCEPTED.format(table="calibrations")}
ORDER BY f.points_url
"""


def due(
    plant: Plant,
    within_days: int = 30,
    *,
    tolerance_percent: float = TOLERANCE_PERCENT,
    today: date | None = None,
) -> Answer:
    """Return due transducers with their bench, and standards by their certificates.

    A transducer is due on the last day of its calibration, or before its drift leaves the tolerance
    as `drift` predicts it.

    Parameters
    ----------
    plant : Plant
    within_days : int, default 30
        Days ahead; overdue and never calibrated transducers are always listed.
    tolerance_percent : float
        Tolerance of the span's drift.
    today : datetime.date, optional

    Returns
    -------
    Answer
        The most urgent first.
    """
    day = today or datetime.now(UTC).date()
    with plant.transaction() as connection:
        rows: list[Any] = [
            *connection.execute(text(_DUE_TRANSDUCERS)),
            *connection.execute(text(_DUE_STANDARDS)),
        ]
        calibrated = _calibrations(connection)
    listed = []
    for row in rows:
        last, remark = row.due, ""
        if row.kind == "transducer":
            last = _again_by(row.serial, calibrated[row.serial], tolerance_percent)
            remark = "by its drift" if row.due is not None and last != row.due else ""
        left = None if last is None else (last - day).days
        if left is not None and left > within_days:
            continue
        if left is not None:
            state = "overdue" if left < 0 else "due"
        else:
            never = row.kind == "transducer" and row.performed is None
            state = "never calibrated" if never else "no due date"
        bench = "" if row.bench_key is None else f"{row.bench_key} {row.name}"
        listed.append((row.kind, row.serial, bench, row.place or "", last, left, state, remark))
    urgency = {"overdue": 0, "due": 1, "never calibrated": 2, "no due date": 3}
    listed.sort(key=lambda each: (urgency[each[6]], each[5] or 0, each[:2]))
    names = ("kind", "serial", "bench", "place", "due", "days_left", "state", "remark")
    counts = {state: sum(each[6] == state for each in listed) for state in urgency}
    return Answer(
        Message("Due within {days} days of {date}", within_days, day.isoformat()),
        {name: [each[k] for each in listed] for k, name in enumerate(names)},
        facts={state: count for state, count in counts.items() if count},
    )


def _calibrations(connection: Any) -> dict[str, list[CalibrationEntry]]:
    """Return the calibrations that count of every transducer, by its serial number."""
    calibrated: dict[str, list[CalibrationEntry]] = defaultdict(list)
    query = text(_OF_TRANSDUCER.format(table="calibrations", more=_COUNTER))
    for row in connection.execute(query, {"serial": None}):
        columns = {**row._mapping, "transducer_serial": row.serial, "calibration_id": row.id}
        calibrated[row.serial].append(entry_of(CalibrationEntry, columns))
    return calibrated


def _again_by(
    serial: str, calibrated: list[CalibrationEntry], tolerance_percent: float
) -> date | None:
    """Return when a transducer is to be calibrated again; None where it never was."""
    records = _Transducer(calibrated, [], [], [], {})
    return records.again_by(drift_of(records, serial, tolerance_percent=tolerance_percent))


@dataclass
class _Transducer:
    """One transducer with the results of all benches, as input of `drift_of`."""

    calibrated: list[CalibrationEntry]
    zeros: list[Zeroing]
    checked: list[CheckEntry]
    known: list[Equipment]
    benches: dict[datetime, str]

    def again_by(self, series: tuple[DriftSeries, ...]) -> date | None:
        """Return the earlier of the last calibration's last day and what its drift proposes."""
        if not self.calibrated:
            return None
        last = self.calibrated[-1]
        days = LONGEST_DAYS if last.due is None else (last.due - last.performed.date()).days
        return next_due(series, longest_days=max(days, 0)) or last.due

    def calibrations(self, _serial: str, /) -> list[CalibrationEntry]:
        return self.calibrated

    def zeroings(self, _serial: str, /) -> list[Zeroing]:
        return self.zeros

    def checks(self, _serial: str, /) -> list[CheckEntry]:
        return self.checked

    def equipment(self, _kind: EquipmentKind, /) -> list[Equipment]:
        return self.known


def _transducers(connection: Any) -> list[Equipment]:
    rows = connection.execute(text(_TRANSDUCERS))
    return [entry_of(Equipment, {**row._mapping, "kind": "transducer"}) for row in rows]


def _transducer(plant: Plant, serial: str) -> _Transducer:
    benches: dict[datetime, str] = {}

    def history(kind: type[Entry], table: str, more: str = "") -> list[Entry]:
        entries = []
        query = text(_OF_TRANSDUCER.format(table=table, more=more))
        for row in connection.execute(query, {"serial": serial}):
            benches[row.performed] = f"{row.bench_key} {row.name}"
            columns = {**row._mapping, "transducer_serial": serial, "calibration_id": row.id}
            columns["run_id"] = row.run_id and f"{row.bench_key}/{row.run_id}"
            entries.append(entry_of(kind, columns))
        return entries

    with plant.transaction() as connection:
        known = _transducers(connection)
        if serial not in {each.serial for each in known}:
            raise InputError(
                Message("transducer {serial!r}", serial),
                ", ".join(each.serial for each in known[:12]) or "a registered transducer",
            )
        return _Transducer(
            history(CalibrationEntry, "calibrations", _COUNTER),
            history(Zeroing, "zeroings"),
            history(CheckEntry, "checks"),
            known,
            benches,
        )


def drift(
    plant: Plant,
    serial: str,
    tolerance_percent: float = TOLERANCE_PERCENT,
    *,
    base: int | None = None,
) -> Answer:
    """Return how a transducer drifts over its life, whichever benches it was fitted to.

    Parameters
    ----------
    plant : Plant
    serial : str
        The transducer.
    tolerance_percent, base
        See `torquebench.campaign.drifting.drift_of`.

    Returns
    -------
    Answer
        One row for each value: time, bench, quantity, and the control chart's statement.

    Raises
    ------
    InputError
        The transducer isn't known.
    """
    known = _transducer(plant, serial)
    found = drift_of(known, serial, tolerance_percent=tolerance_percent, base=base)
    rows = [
        (
            series.title,
            series.unit,
            moment,
            known.benches.get(moment, ""),
            value,
            series.remark(row),
        )
        for series in found
        for row, (moment, value) in enumerate(zip(series.moments, series.values, strict=True))
    ]
    facts: dict[str, Any] = {}
    for series in found:
        if series.trend is not None:
            sure = "" if series.trend.significant else " (no trend)"
            facts[Message("{title}, {unit} a year", series.title, series.unit)] = (
                f"{series.trend.per_year:+.3g}{sure}"
            )
        if series.prediction is not None and series.prediction.expected is not None:
            leaves = series.prediction.expected.date().isoformat()
            facts[
                Message(
                    "{title} leaves ±{tolerance_percent:g} {unit}",
                    series.title,
                    tolerance_percent,
                    series.unit,
                )
            ] = leaves
    again = known.again_by(found)
    if again is not None:
        facts["calibrate again by"] = again.isoformat()
    names = ("quantity", "unit", "when", "bench", "value", "remark")
    many = len(set(known.benches.values()))
    return Answer(
        Message(
            "Transducer {serial} over {count} bench"
            if many == 1
            else "Transducer {serial} over {count} benches",
            serial,
            many,
        ),
        {name: [row[k] for row in rows] for k, name in enumerate(names)},
        facts=facts,
        notes=() if rows else ("no calibration, zero or check has arrived",),
        simulated=any(series.simulated for series in found),
    )


def drift_of_kind(plant: Plant, model: str) -> Answer:
    """Return the span of every transducer of one kind over time, from the points themselves.

    The points of all their calibrations are Parquet files beside the run folders; DuckDB reads
    those that the registry lists, and no others.

    Parameters
    ----------
    plant : Plant
    model : str
        Model in the transducers' descriptions, such as ``"T40B"``.

    Returns
    -------
    Answer
        One row for each calibration and direction: slope of reading over standard minus 1, in %.

    Raises
    ------
    InputError
        No transducer of this kind is known.
    """
    with plant.transaction() as connection:
        known = _transducers(connection)
        serials = [each.serial for each in known if each.model == model]
        if not serials:
            models = sorted({each.model for each in known if each.model})
            raise InputError(
                Message("transducers of the kind {model!r}", model),
                ", ".join(repr(each) for each in models) or "a described transducer",
            )
        query = text(_POINTS).bindparams(bindparam("serials", expanding=True))
        rows: Sequence[Any] = connection.execute(query, {"serials": serials}).all()
    known_of = {row.points_url: row for row in rows}
    spans = _spans(FolderStore(plant.folders_url), list(known_of)) if rows else []
    found = sorted(
        (row.serial, row.performed, direction, row.bench, error)
        for row, direction, error in ((known_of[url], *rest) for url, *rest in spans)
    )
    columns: dict[str, list[Any]] = {
        "serial": [serial for serial, *_ in found],
        "bench": [bench for *_, bench, _ in found],
        "when": [moment for _, moment, *_ in found],
        "direction": [
            "clockwise" if direction > 0 else "counter-clockwise" for _, _, direction, *_ in found
        ],
        "span_error_percent": [error for *_, error in found],
    }
    return Answer(
        Message(
            "Span of {count} transducers of the kind {model}, {calibrations} calibrations",
            len(serials),
            model,
            len(known_of),
        ),
        columns,
        facts=_pooled(columns),
        simulated=any(row.simulated for row in rows),
    )


_SPANS = """
SELECT filename, sign(standard_nm) AS direction,
  100.0 * (sum(reading_nm * standard_nm) / sum(standard_nm * standard_nm) - 1.0)
FROM read_parquet($files, filename = true)
WHERE standard_nm <> 0.0 GROUP BY filename, direction
"""


def _spans(store: FolderStore, urls: list[str]) -> list[tuple[Any, ...]]:
    import duckdb

    paths = {store.duckdb_path(url): url for url in urls}
    with duckdb.connect() as connection:
        store.offer_to(connection)
        found = connection.execute(_SPANS, {"files": list(paths)}).fetchall()
    return [(paths[path], *rest) for path, *rest in found]


def _pooled(columns: dict[str, list[Any]]) -> dict[str, Any]:
    """Return the drift per year common to all transducers, each about its own mean."""
    import numpy as np

    if len(columns["serial"]) < 3:
        return {}
    error = np.array(columns["span_error_percent"], dtype=float)
    years = np.array([moment.timestamp() for moment in columns["when"]]) / (DAYS_PER_YEAR * DAY)
    names = [
        f"{serial}/{side}"
        for serial, side in zip(columns["serial"], columns["direction"], strict=True)
    ]
    _, group = np.unique(names, return_inverse=True)
    counts = np.bincount(group)
    for values in (error, years):
        values -= (np.bincount(group, values) / counts)[group]
    spread = float(years @ years)
    freedom = error.size - counts.size - 1
    if spread <= 0.0 or freedom < 1:
        return {}
    slope = float(years @ error) / spread
    rest = error - slope * years
    scatter = float(np.sqrt(rest @ rest / freedom))
    return {
        "span drift, % a year": slope,
        "its standard error, % a year": scatter / spread**0.5,
        "scatter about each transducer's line, %": scatter,
    }


# -- tested specimens ----------------------------------------------------------------------------

_RESULTS = """
SELECT r.started AS "when", b.bench_key || ' ' || b.name AS bench, r.serial, r.batch, r.run_id,
  q.value, q.expanded_uncertainty, q.title, q.unit, q."limit", r.simulated
FROM plant.runs r
JOIN plant.results q ON q.bench_key = r.bench_key AND q.run_id = r.run_id
JOIN plant.benches b ON b.bench_key = r.bench_key AND b.replaced_by IS NULL
WHERE q.quantity = :quantity AND r.withdrawn IS NULL AND r.status = 'completed'
  AND r.kind NOT LIKE '%-short'
  AND CAST(:specimen_type AS text) IN ('', r.specimen_type)
  AND (CAST(:serial AS text) IS NULL OR r.serial = :serial)
  AND (CAST(:bench AS integer) IS NULL OR r.bench_key = :bench)
  AND (CAST(:batch AS text) IS NULL OR r.batch = :batch)
  AND (CAST(:since AS timestamptz) IS NULL OR r.started >= :since)
  AND (CAST(:until AS timestamptz) IS NULL OR r.started < :until)
ORDER BY r.started, r.bench_key, r.id
"""
_QUANTITIES = """
SELECT DISTINCT q.quantity FROM plant.runs r
JOIN plant.results q ON q.bench_key = r.bench_key AND q.run_id = r.run_id
WHERE CAST(:specimen_type AS text) IN ('', r.specimen_type)
  AND (CAST(:serial AS text) IS NULL OR r.serial = :serial)
  AND r.kind NOT LIKE '%-short' LIMIT 40
"""


@dataclass(frozen=True)
class SpecimenFilter:
    """Filter of tested specimens.

    Parameters
    ----------
    specimen_type, quantity : str
        Type as the reducer's description names it (empty for any), and key of a value, such as
        ``"backlash"``.
    bench : int, optional
        Number of a bench.
    batch : str, optional
    since, until : datetime, optional
        With time zone.
    serial : str, optional
        Serial number of one specimen.
    """

    specimen_type: str
    quantity: str
    bench: int | None = None
    batch: str | None = None
    since: datetime | None = None
    until: datetime | None = None
    serial: str | None = None


def _rows(plant: Plant, wanted: SpecimenFilter) -> list[Any]:
    given = vars(wanted)
    with plant.transaction() as connection:
        rows: list[Any] = list(connection.execute(text(_RESULTS), given))
        if not rows:
            known = sorted(connection.scalars(text(_QUANTITIES), given))
            asked = wanted.serial or wanted.specimen_type
            raise InputError(
                Message("no {quantity} of {type}", wanted.quantity, asked),
                Message("one of {list}", ", ".join(known))
                if known
                else "a tested specimen or type",
                "torquebench plant runs lists what was tested; folders must have arrived; short "
                "tests don't count",
            )
    return rows


def _latest(rows: Sequence[Any]) -> list[Any]:
    """Return the latest run of each specimen, so that repeated tests count once."""
    last = {row.serial: k for k, row in enumerate(rows) if row.serial}
    return [row for k, row in enumerate(rows) if not row.serial or last[row.serial] == k]


_SHOWN = ("when", "bench", "serial", "batch", "value", "expanded_uncertainty")


def _columns(rows: Sequence[Any]) -> dict[str, list[Any]]:
    return {name: [getattr(row, name) for row in rows] for name in _SHOWN}


def _title(rows: Sequence[Any], asked: str) -> str:
    quantity = Message.joined((rows[-1].title, rows[-1].unit))  # wholly English if it isn't known
    return Message("{quantity}, of {asked}", quantity, asked)


def specimens(plant: Plant, wanted: SpecimenFilter) -> Answer:
    """Return the results of every specimen of a type, over time.

    Returns
    -------
    Answer
        One row for each specimen, the oldest first; the latest run of a specimen counts.

    Raises
    ------
    InputError
        No such specimen was tested.
    """
    rows = _latest(_rows(plant, wanted))
    values = np.array([row.value for row in rows])
    return Answer(
        _title(rows, wanted.specimen_type),
        _columns(rows),
        facts={
            "specimens": len(rows),
            "mean": float(values.mean()),
            "standard deviation": float(values.std(ddof=1)) if len(rows) > 1 else None,
            "lowest": float(values.min()),
            "highest": float(values.max()),
        },
        simulated=any(row.simulated for row in rows),
    )


def capability(
    plant: Plant,
    wanted: SpecimenFilter,
    *,
    lower: float | None = None,
    upper: float | None = None,
    level: float = 0.95,
) -> Answer:
    """Return Cp and Cpk of a type with their intervals, over all and bench by bench.

    The tests' uncertainty is treated as common to all tests, which is the worst case for the mean
    and therefore for Cpk.

    Parameters
    ----------
    plant : Plant
    wanted : SpecimenFilter
    lower, upper : float, optional
        Limits in the quantity's unit; by default those of the data sheet that the latest test was
        judged by.
    level : float, default 0.95
        Confidence level of the intervals.

    Raises
    ------
    InputError
        Nothing was tested, there are fewer than 3 specimens, or no limit is known.
    """
    rows = _latest(_rows(plant, wanted))
    if lower is None and upper is None:
        stated = next((row.limit for row in reversed(rows) if row.limit), "")
        lower, upper = statistics.limits_in_words(stated)
    if lower is None and upper is None:
        raise InputError(
            Message(
                "no limit of {quantity} in the data sheet of {type}",
                wanted.quantity,
                wanted.specimen_type,
            ),
            "a lower limit, an upper limit, or both",
            "give --lower or --upper",
        )
    u = [0.5 * row.expanded_uncertainty for row in rows if row.expanded_uncertainty]
    u_common = float(np.median(u)) if u else 0.0

    def found(part: Sequence[Any]) -> statistics.Capability:
        values = [row.value for row in part]
        return statistics.capability(
            values, lower=lower, upper=upper, u_value=u_common, u_common=u_common, level=level
        )

    every = found(rows)
    parts = [("all benches", every)]
    benches = {row.bench for row in rows}  # number and name
    for bench in sorted(benches, key=lambda each: int(each.partition(" ")[0])):
        own = [row for row in rows if row.bench == bench]
        if len(own) >= 10 and len(own) < len(rows):
            parts.append((bench, found(own)))
    columns: dict[str, list[Any]] = {
        "bench": [name for name, _ in parts],
        "specimens": [each.count for _, each in parts],
        "mean": [each.mean for _, each in parts],
        "standard_deviation": [each.standard_deviation for _, each in parts],
        "cp": [each.cp for _, each in parts],
        "cp_low": [each.cp_interval and each.cp_interval[0] for _, each in parts],
        "cp_high": [each.cp_interval and each.cp_interval[1] for _, each in parts],
        "cpk": [each.cpk for _, each in parts],
        "cpk_low": [each.cpk_interval[0] for _, each in parts],
        "cpk_high": [each.cpk_interval[1] for _, each in parts],
    }
    facts: dict[str, Any] = {
        "lower limit": lower,
        "upper limit": upper,
        "confidence, %": 100.0 * level,
        "share of measuring in the variance, at most %": 100.0 * every.measurement_share,
    }
    return Answer(
        Message("Capability: {rows}", _title(rows, wanted.specimen_type)),
        columns,
        facts={name: value for name, value in facts.items() if value is not None},
        notes=_doubts(rows),
        simulated=any(row.simulated for row in rows),
    )


def _doubts(rows: Sequence[Any]) -> tuple[str, ...]:
    """Return reasons why capability isn't meaningful, such as a process out of control."""
    values = [row.value for row in rows]
    if len(values) < 8 or individuals_chart(values).in_control:
        return ()
    return ("the values aren't in control (see charts): capability doesn't predict future values",)


def charts(
    plant: Plant,
    wanted: SpecimenFilter,
    *,
    base: int | None = None,
    weight: float = 0.2,
    width: float = 2.9,
) -> Answer:
    """Return Shewhart's chart of single values and the EWMA chart of a type.

    Parameters
    ----------
    plant : Plant
    wanted : SpecimenFilter
    base : int, optional
        Number of first values from which limits are computed; all by default.
    weight, width : float
        Weight and width of the EWMA chart; see `torquebench_plant.statistics.ewma_chart`.

    Raises
    ------
    InputError
        Fewer than 3 specimens were tested.
    """
    rows = _latest(_rows(plant, wanted))
    values = [row.value for row in rows]
    single = individuals_chart(values, base)
    moving = statistics.ewma_chart(values, weight=weight, width=width, base=base)
    signals_of = (
        ("outside", frozenset(single.outside)),
        ("jump", frozenset(single.jumps)),
        ("8 on a side", frozenset(single.runs)),
        ("EWMA", frozenset(moving.outside)),
    )
    remarks = [
        ", ".join(word for word, places in signals_of if k in places) for k in range(len(rows))
    ]
    columns = {name: values for name, values in _columns(rows).items() if name != _SHOWN[-1]}
    columns["ewma"] = moving.average.tolist()
    columns["ewma_lower"] = moving.lower.tolist()
    columns["ewma_upper"] = moving.upper.tolist()
    columns["remark"] = remarks
    signals = sum(bool(each) for each in remarks)
    return Answer(
        Message("Control charts: {rows}", _title(rows, wanted.specimen_type)),
        columns,
        facts={
            "specimens": len(rows),
            "centre": single.centre,
            "lower limit of single values": single.lower,
            "upper limit of single values": single.upper,
            "mean moving range": single.moving_range_mean,
            "values with a signal": signals,
        },
        notes=() if not signals else ("not in control: look for the reason of each signal",),
        simulated=any(row.simulated for row in rows),
    )


def outliers(plant: Plant, wanted: SpecimenFilter, *, level: float = 0.01) -> Answer:
    """Return the outliers of a type: single specimens, and whole benches and batches.

    Specimens are found by their modified z-score; benches and batches by Welch's test against all
    others, corrected for the number of groups. Outlying specimens are left out of Welch's test,
    because they would hide outlying groups.

    Raises
    ------
    InputError
        No such specimen was tested.
    """
    rows = _latest(_rows(plant, wanted))
    values = [row.value for row in rows]
    middle = float(np.median(values))
    single = frozenset(statistics.outlying_values(values))
    names = ("what", "name", "specimens", "mean", "difference", "p_value")
    found: list[tuple[Any, ...]] = []
    kinds: tuple[tuple[str, Callable[[Any], str]], ...] = (
        ("bench", lambda row: str(row.bench)),
        ("batch", lambda row: str(row.batch)),
    )
    for what, group in kinds:
        known = [k for k, row in enumerate(rows) if group(row) and k not in single]
        part = [values[k] for k in known]
        groups = [group(rows[k]) for k in known]
        found += [
            (what, each.group, each.count, each.mean, each.difference, each.p_value)
            for each in statistics.outlying_groups(part, groups, level=level)
            if each.outlying
        ]
    found += [
        ("specimen", rows[k].serial or rows[k].run_id, 1, values[k], values[k] - middle, None)
        for k in sorted(single)
    ]
    return Answer(
        Message("Outliers: {rows}", _title(rows, wanted.specimen_type)),
        {name: [row[k] for row in found] for k, name in enumerate(names)},
        facts={"specimens": len(rows), "median": middle},
        notes=() if found else ("nothing stands out",),
        simulated=any(row.simulated for row in rows),
    )


def compare(plant: Plant, serial: str, quantity: str, *, reference: int | None = None) -> Answer:
    """Compare benches by a specimen that travelled between them.

    A bench's value is the mean of its runs; its U combines the U of a run and the scatter of the
    mean.

    Parameters
    ----------
    plant : Plant
    serial, quantity : str
        The specimen, and key of the value.
    reference : int, optional
        Number of the bench with which the others are compared; by default each bench is compared
        with the weighted mean of all others.

    Raises
    ------
    InputError
        Fewer than two benches tested it, or a test stated no uncertainty.
    """
    rows = _rows(plant, SpecimenFilter("", quantity, serial=serial))
    results = []
    for bench in dict.fromkeys(row.bench for row in rows):
        own = [row for row in rows if row.bench == bench]
        values = np.array([row.value for row in own])
        stated = np.mean([row.expanded_uncertainty or 0.0 for row in own])
        scatter = float(values.var(ddof=1)) / values.size if values.size > 1 else 0.0
        expanded = 2.0 * sqrt((0.5 * float(stated)) ** 2 + scatter)
        results.append(
            statistics.BenchResult(bench, float(values.mean()), expanded, int(values.size))
        )
    named = None
    if reference is not None:
        named = next(
            (each.bench for each in results if each.bench.startswith(f"{reference} ")),
            str(reference),
        )
    found = statistics.compare_benches(results, named)
    columns: dict[str, list[Any]] = {
        "bench": [each.result.bench for each in found.benches],
        "runs": [each.result.runs for each in found.benches],
        "value": [each.result.value for each in found.benches],
        "expanded_uncertainty": [each.result.expanded_uncertainty for each in found.benches],
        "difference": [each.difference for each in found.benches],
        "en": [each.en for each in found.benches],
        "verdict": ["agrees" if each.agrees else "differs" for each in found.benches],
    }
    notes = []
    if found.p_value < 0.05:
        notes.append("the benches scatter more than their uncertainties explain (χ² test)")
    return Answer(
        Message(
            "Benches by specimen {serial}: {joined}",
            serial,
            Message.joined((rows[-1].title, rows[-1].unit)),
        ),
        columns,
        facts={
            "held against": named or "the weighted mean of all others",
            "weighted mean": found.mean,
            "its U (k = 2)": found.expanded_uncertainty,
            "p of χ²": found.p_value,
        },
        notes=tuple(notes),
        simulated=any(row.simulated for row in rows),
    )
