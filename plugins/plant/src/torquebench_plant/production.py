"""Results of the specimens that a plant's benches have tested."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import sqrt
from typing import Any

import numpy as np
from sqlalchemy import text

from torquebench.calibration import individuals_chart
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench_plant import statistics
from torquebench_plant.answer import Answer
from torquebench_plant.database import Plant

__all__ = [
    "SpecimenFilter",
    "capability",
    "charts",
    "compare",
    "outliers",
    "specimens",
]

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
        Of one specimen.
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
        One row a specimen, the oldest first; of one that was tested again, the latest run.

    Raises
    ------
    InputError
        Nothing of this was tested.
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

    The uncertainty of the tests is treated as one that all of them share, which is the worst case
    for the mean and so for Cpk.

    Parameters
    ----------
    plant : Plant
    wanted : SpecimenFilter
    lower, upper : float, optional
        Limits in the quantity's unit; by default those of the data sheet that the latest test was
        judged by.
    level : float, default 0.95
        Of the intervals.

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
        Of the EWMA chart; see `torquebench_plant.statistics.ewma_chart`.

    Raises
    ------
    InputError
        Nothing was tested, or fewer than 3 specimens.
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

    Specimens by their modified z-score; benches and batches by Welch's test against all others,
    corrected for the number of groups and without single ones, which would hide them.

    Raises
    ------
    InputError
        Nothing of this was tested.
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

    A bench's value is the mean of its runs; its U holds the U of a run and the scatter of the mean.

    Parameters
    ----------
    plant : Plant
    serial, quantity : str
        The specimen, and key of the value.
    reference : int, optional
        Number of the bench that the others are held against; by default each is held against the
        weighted mean of all others.

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
