"""The report of a reducer test: figures, values, limits and verdicts of every part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from torquebench.bench.mounting_record import MountingRecord, mounting_facts
from torquebench.campaign.reducers.catalogue import TESTS
from torquebench.campaign.reducers.quantities import ReducerTestQuantity
from torquebench.campaign.reducers.results import (
    SHORT_TEST,
    ReducerTestFailure,
    ReducerTestOutcome,
    ReducerTestRecord,
)
from torquebench.message import Message
from torquebench.reducers import EfficiencyMap, NoLoadPoint, NoLoadResult
from torquebench.reducers.preparation import grouped
from torquebench.reports.page import Drawings, Facts, Page, Section, Table
from torquebench.uncertainty import stated


def reducer_page(record: ReducerTestRecord) -> Page:
    """Return the report of a reducer test.

    Parameters
    ----------
    record : ReducerTestRecord
        Results of `run_reducer_test`.

    Returns
    -------
    Page
        Ready for `torquebench.reports.page.write_page`.
    """
    kind = "Short reducer test" if record.short else "Reducer test"
    title = Message("{kind}: {reducer}", kind, record.reducer_name)
    if record.serial:
        title = Message("{title}, specimen {serial}", title, record.serial)
    return Page(
        title=title,
        subtitle=Message(
            "{bench} · {moment:%Y-%m-%d %H:%M} UTC", record.bench_name, record.started
        ),
        sections=[
            _summary(record),
            *(_failure(each) for each in record.failures),
            *(_section(each) for each in record.outcomes),
        ],
        simulated=record.simulated,
    )


def _summary(record: ReducerTestRecord) -> Section:
    reducer = record.reducer
    rating = (
        f"ratio {reducer['ratio']:g}, rated {reducer['rated_torque_nm']:g} N·m, acceleration "
        f"{reducer['acceleration_torque_nm']:g} N·m, up to {reducer['max_input_speed_rpm']:g} rpm"
    )
    facts = Facts(
        (
            ("Reducer", f"{record.reducer_name}: {rating}"),
            ("Specimen", record.serial or "no serial number"),
            ("Bench", record.bench_name),
            ("Operator", record.operator),
            ("Duration", Message("{seconds:.0f} s of bench time", record.bench_seconds)),
            ("Software", f"torquebench {record.software_version}"),
            *mounting_facts(
                MountingRecord.of_run(record.outcomes[-1].run.metadata) if record.outcomes else None
            ),
            ("Verdict", _verdict(record)),
        )
    )
    quantities = [each for outcome in record.outcomes for each in outcome.quantities]
    return Section("Summary", "", (facts, *judged_table(quantities)))


def judged_table(quantities: Sequence[ReducerTestQuantity]) -> tuple[Table, ...]:
    """Return a table of the quantities that the data sheet limits; no table if there are none."""
    rows = [
        (
            each.title,
            *stated(each.value, each.expanded_uncertainty),
            each.limit,
            each.verdict.label,
        )
        for each in quantities
        if each.verdict
    ]
    caption = "Against the data sheet, with a guard band of U (95.45 % coverage)."
    header = ("quantity", "value", "U", "limit", "verdict")
    return (Table(header, rows, caption),) if rows else ()


def _verdict(record: ReducerTestRecord) -> str:
    words = [record.verdict.label if record.verdict else "nothing was judged"]
    if record.short:
        words.append(SHORT_TEST)
    if record.failures:
        failed = Message.joined(each.title for each in record.failures)
        words.append(Message("without result: {tests}", failed))
    severe = [each.title for each in record.outcomes if each.severe]
    if severe:
        words.append(Message("not to be used for a verdict: {tests}", Message.joined(severe)))
    return Message.joined(words, "; ")


def _failure(failure: ReducerTestFailure) -> Section:
    what = Facts((("Failure", failure.message),))
    return Section(Message("{title}: no result", failure.title), "", (what,))


def _section(outcome: ReducerTestOutcome) -> Section:
    remarks = tuple(("Remark", remark) for remark in outcome.remarks)
    findings = tuple(
        (Message("Finding: {name}", each.name), each.sentence) for each in outcome.findings
    )
    facts = Facts((*findings, *remarks, ("Record", outcome.run.run_id)))
    figures = Drawings(lambda: TESTS[outcome.name].work().figures(outcome.result))
    return Section(
        outcome.title,
        "",
        (figures, *tables_of(outcome.result, outcome.quantities), facts),
    )


NO_LOAD_POINT = "no_load_"
"""Prefix of the keys of no-load torques at a speed."""


def tables_of(result: Any, quantities: Sequence[ReducerTestQuantity]) -> tuple[Table, ...]:
    """Return tables of a result's quantities; efficiency and no-load torque are arranged by speed.

    Parameters
    ----------
    result : ReducerResult
    quantities : sequence of ReducerTestQuantity
        Quantities with their uncertainties.
    """
    expanded = {each.key: (each.value, each.expanded_uncertainty) for each in quantities}
    if isinstance(result, EfficiencyMap):
        return tuple(
            Table(header, rows, caption)
            for header, rows, caption in efficiency_tables(result, expanded)
        )
    if isinstance(result, NoLoadResult):
        rest = [each for each in quantities if not each.key.startswith(NO_LOAD_POINT)]
        return (Table(*no_load_table(result, expanded)), *((_list(rest),) if rest else ()))
    return (_list(quantities),)


def _list(quantities: Sequence[ReducerTestQuantity]) -> Table:
    rows = [
        (
            each.title,
            *stated(each.value, each.expanded_uncertainty),
            f"{each.coverage_factor:.2f}",
            each.unit,
            each.rule,
        )
        for each in quantities
        if not (each.key.startswith("order_") and each.value < each.expanded_uncertainty)
    ]
    header: tuple[str, ...] = ("quantity", "value", "U", "k", "unit", "rule")
    cells: list[tuple[str, ...]] = list(rows)
    if not any(row[-1] for row in rows):
        header, cells = header[:-1], [row[:-1] for row in rows]
    return Table(header, cells, "U: expanded uncertainty, 95.45 % coverage.")


def no_load_table(
    result: NoLoadResult, stated_of: Mapping[str, tuple[float, float]]
) -> tuple[tuple[str, ...], list[tuple[str, ...]], str]:
    """Return no-load torques as a table with one row per speed and one column per direction.

    Parameters
    ----------
    result : NoLoadResult
    stated_of : mapping of str to pair of float
        Value and expanded uncertainty of each point by its key, in N·m.

    Returns
    -------
    header, rows, caption
        A direction with repeats also has a column with their range; the last column is the mean of
        both directions.
    """
    means, points = _by_speed(result.means, result), _by_speed(result.points, result)
    columns: list[tuple[str, Mapping[int, NoLoadPoint], bool]] = []
    for name, sign in (("clockwise", 1.0), ("counter-clockwise", -1.0)):
        side = {at: each for (at, way), each in points.items() if way == sign}
        if side:
            columns.append((Message("{direction}, N·m", name), side, False))
            if any(result.repeat_range_nm(each) is not None for each in side.values()):
                columns.append(("range of repeats, N·m", side, True))
    if means:
        columns.append(("mean of both, N·m", {at: each for (at, _), each in means.items()}, False))
    rows = []
    for at in sorted({speed for _, shown, _ in columns for speed in shown}):
        cells = []
        for _, shown, of_repeats in columns:
            if at not in shown:
                cells.append("–")
            elif of_repeats:
                width = result.repeat_range_nm(shown[at])
                cells.append("–" if width is None else stated(width, width)[0])
            else:
                value, whole = stated(*stated_of[shown[at].key])
                cells.append(f"{value} ± {whole}")
        rows.append((f"{at:g}", *cells))
    caption = (
        "No-load torque with the sign of its direction ± U (expanded uncertainty, 95.45 % "
        "coverage), by input speed."
    )
    return ("rpm", *(name for name, _, _ in columns)), rows, caption


def _by_speed(
    points: Sequence[NoLoadPoint], result: NoLoadResult
) -> dict[tuple[int, float], NoLoadPoint]:
    """Return points by |speed| in rpm and direction.

    A counter-clockwise speed within 2 % (or 1 rpm) of a clockwise one shares its row.
    """
    clockwise = sorted({round(each.nominal_rpm) for each in result.points if each.nominal_rpm > 0})
    found = {}
    for each in points:
        at, way = round(abs(each.nominal_rpm)), 1.0 if each.nominal_rpm > 0 else -1.0
        near = min(clockwise, key=lambda speed: abs(speed - at), default=at)
        if abs(near - at) <= max(1, 0.02 * at) and (near, way) not in found:
            at = near
        found[at, way] = each
    return found


def efficiency_tables(
    result: EfficiencyMap, stated_of: Mapping[str, tuple[float, float]]
) -> list[tuple[tuple[str, ...], list[tuple[str, ...]], str]]:
    """Return an efficiency map as tables with one row per torque and one column per speed.

    If both directions were driven, their means are listed. Each row states the largest U of its
    points; the run's ``results.json`` has the U of every point.

    Parameters
    ----------
    result : EfficiencyMap
    stated_of : mapping of str to pair of float
        Value and expanded uncertainty of each point by its key, in %.

    Returns
    -------
    list of (header, rows, caption)
        One table per driving side.
    """
    found: list[tuple[tuple[str, ...], list[tuple[str, ...]], str]] = []
    for driving in ("input", "output"):
        means = [each for each in result.means if each.driving == driving]
        points = means or [each for each in result.points if each.driving == driving]
        if not points:
            continue
        columns = _steps([each.nominal_speed_rpm for each in points])
        torques = [each.nominal_torque_nm for each in points]
        lines = _steps(torques)
        if len(set(zip(columns, lines, strict=True))) < len(points):
            lines = torques  # torques at one speed that are too close to merge
        rows = []
        for line in sorted(set(lines)):
            here = {
                column: stated_of[each.quantity.key]
                for each, column, of in zip(points, columns, lines, strict=True)
                if of == line
            }
            largest = max(whole for _, whole in here.values())
            cells = [
                stated(here[speed][0], largest)[0] if speed in here else "–"
                for speed in sorted(set(columns))
            ]
            rows.append((f"{line:.4g}", *cells, stated(0.0, largest)[1]))
        caption = Message(
            "Efficiency in %, {side} drives, mean of both directions, by output torque (rows, N·m) "
            "and input speed (columns, rpm). U: the largest of the row, 95.45 % coverage."
            if means
            else "Efficiency in %, {side} drives, by output torque (rows, N·m) and input speed "
            "(columns, rpm). U: the largest of the row, 95.45 % coverage.",
            driving,
        )
        speeds = [f"{speed:.4g} rpm" for speed in sorted(set(columns))]
        found.append((("N·m", *speeds, "U, %"), rows, caption))
    return found


def _steps(values: Sequence[float]) -> list[float]:
    """Replace each value by the mean of its group of values within 1 % of the largest value."""
    ordered = np.asarray(values, dtype=np.float64)
    number = grouped(ordered, 0.01 * float(np.max(np.abs(ordered))))
    means = np.bincount(number, weights=ordered) / np.bincount(number)
    return [float(each) for each in means[number]]
