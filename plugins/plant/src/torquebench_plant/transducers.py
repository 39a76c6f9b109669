"""Transducers and standards of a plant: due dates and drift."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import Any, TypeVar

from sqlalchemy import bindparam, text

from torquebench.campaign.drifting import drift_of, next_due
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records import CalibrationEntry, CheckEntry, Equipment, EquipmentKind, Zeroing
from torquebench.records.registry import entry_of
from torquebench.units import DAY, DAYS_PER_YEAR
from torquebench_plant.answer import Answer
from torquebench_plant.database import Plant
from torquebench_plant.folders import FolderStore

__all__ = ["drift", "drift_of_kind", "due"]

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
SELECT c.*, r.run_id, b.name{{more}} FROM plant.equipment e
JOIN plant.{{table}} c ON c.bench_key = e.bench_key AND c.transducer_key = e.id {_COUNTS}
WHERE e.kind = 'transducer' AND e.serial = :serial AND {_ACCEPTED}
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


def due(plant: Plant, within_days: int = 30, *, today: date | None = None) -> Answer:
    """Return due transducers with their bench, and standards by their certificates.

    Parameters
    ----------
    plant : Plant
    within_days : int, default 30
        Days ahead; overdue and never calibrated transducers are always listed.
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
    listed = []
    for row in rows:
        left = None if row.due is None else (row.due - day).days
        if left is not None and left > within_days:
            continue
        if left is None:
            state = "never calibrated" if row.performed is None else "no due date"
            if row.kind != "transducer":
                state = "no due date"
        else:
            state = "overdue" if left < 0 else "due"
        bench = "" if row.bench_key is None else f"{row.bench_key} {row.name}"
        listed.append((left, row.kind, row.serial, bench, row.place or "", row.due, state))
    urgency = {"overdue": 0, "due": 1, "never calibrated": 2, "no due date": 3}
    listed.sort(key=lambda each: (urgency[each[6]], each[0] or 0, each[1], each[2]))
    names = ("kind", "serial", "bench", "place", "due", "days_left", "state")
    order = (1, 2, 3, 4, 5, 0, 6)
    counts = {state: sum(each[6] == state for each in listed) for state in urgency}
    return Answer(
        Message("Due within {days} days of {date}", within_days, day.isoformat()),
        {name: [each[k] for each in listed] for name, k in zip(names, order, strict=True)},
        facts={state: count for state, count in counts.items() if count},
    )


@dataclass
class _Transducer:
    """One transducer with the results of all benches, as input of `drift_of`."""

    calibrated: list[CalibrationEntry]
    zeros: list[Zeroing]
    checked: list[CheckEntry]
    known: list[Equipment]
    benches: dict[datetime, str]

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
    tolerance_percent: float = 0.1,
    *,
    base: int | None = None,
    longest_days: int = 365,
) -> Answer:
    """Return how a transducer drifts over its life, whichever benches it was fitted to.

    Parameters
    ----------
    plant : Plant
    serial : str
        The transducer.
    tolerance_percent, base, longest_days
        See `torquebench.campaign.drifting.drift_of` and `next_due`.

    Returns
    -------
    Answer
        One row a value: time, bench, quantity, and the control chart's statement.

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
    again = next_due(found, longest_days=longest_days)
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
        As the transducers are described, such as ``"T40B"``.

    Returns
    -------
    Answer
        One row a calibration and direction: slope of reading over standard less 1, in %.

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
