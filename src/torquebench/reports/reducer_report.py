"""The report of a reducer test: every part with its figures, values, limits and verdicts."""

from __future__ import annotations

from torquebench.campaign.reducers.catalogue import TESTS
from torquebench.campaign.reducers.results import (
    SHORT_TEST,
    ReducerTestFailure,
    ReducerTestOutcome,
    ReducerTestRecord,
)
from torquebench.reports.page import Facts, Figure, Page, Section, Table
from torquebench.uncertainty import stated

__all__ = ["reducer_page"]


def reducer_page(record: ReducerTestRecord) -> Page:
    """Return the report of a reducer test.

    Parameters
    ----------
    record : ReducerTestRecord
        What `run_reducer_test` found.

    Returns
    -------
    Page
        Ready for `torquebench.reports.page.write_page`.
    """
    specimen = f", specimen {record.serial}" if record.serial else ""
    kind = "Short reducer test" if record.short else "Reducer test"
    return Page(
        title=f"{kind}: {record.reducer_name}{specimen}",
        subtitle=f"{record.bench_name} · {record.started:%Y-%m-%d %H:%M} UTC",
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
            ("Duration", f"{record.bench_seconds:.0f} s of bench time"),
            ("Software", f"torquebench {record.software_version}"),
            ("Verdict", _verdict(record)),
        )
    )
    judged = [
        (
            each.title,
            *stated(each.value, each.expanded_uncertainty),
            each.limit,
            each.verdict.label,
        )
        for outcome in record.outcomes
        for each in outcome.quantities
        if each.verdict
    ]
    blocks: list[Facts | Table] = [facts]
    if judged:
        caption = "Against the data sheet, with a guard band of U (95.45 % coverage)."
        blocks.append(Table(("quantity", "value", "U", "limit", "verdict"), judged, caption))
    return Section("Summary", "", blocks)


def _verdict(record: ReducerTestRecord) -> str:
    words = [record.verdict.label if record.verdict else "nothing was judged"]
    if record.short:
        words.append(SHORT_TEST)
    if record.failures:
        words.append("without result: " + ", ".join(each.title for each in record.failures))
    severe = [each.title for each in record.outcomes if each.severe]
    if severe:
        words.append("not to be used for a verdict: " + ", ".join(severe))
    return "; ".join(words)


def _failure(failure: ReducerTestFailure) -> Section:
    what = Facts((("Failure", failure.message),))
    return Section(f"{failure.title}: no result", "", (what,))


def _section(outcome: ReducerTestOutcome) -> Section:
    rows = [
        (
            each.title,
            *stated(each.value, each.expanded_uncertainty),
            each.unit,
            each.rule,
        )
        for each in outcome.quantities
        if not (each.key.startswith("order_") and each.value < each.expanded_uncertainty)
    ]
    table = Table(
        ("quantity", "value", "U", "unit", "rule"),
        rows,
        "U: expanded uncertainty, 95.45 % coverage.",
    )
    remarks = tuple(("Remark", remark) for remark in outcome.remarks)
    findings = tuple((f"Finding: {each.name}", each.sentence) for each in outcome.findings)
    facts = Facts((*findings, *remarks, ("Record", outcome.run.run_id)))
    figures = TESTS[outcome.name].work().figures(outcome.result)
    return Section(outcome.title, "", (*(Figure(*each) for each in figures), table, facts))
