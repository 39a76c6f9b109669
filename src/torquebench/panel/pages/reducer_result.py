"""What a reducer test found: quantities with uncertainty, limit and verdict; earlier specimens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from torquebench.errors import TorquebenchError
from torquebench.panel.components.charts import Chart, Line
from torquebench.panel.components.elements import box, empty, note, panel, table, tag, words
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import JobResult
from torquebench.panel.text import Text

__all__ = ["comparison", "outcomes"]

KINDS = {"pass": "good", "conditionalPass": "warn", "conditionalFail": "warn", "fail": "bad"}
EARLIER = 20


def number(value: float) -> str:
    """Return a value with five significant digits.

    Examples
    --------
    >>> number(0.123456), number(-12.0), number(float("nan"))
    ('0.12346', '−12', '—')
    """
    return "—" if value != value else f"{value:.5g}".replace("-", "−")


def outcomes(text: Text, details: Mapping[str, Any]) -> None:
    """Show every outcome of a test."""
    for outcome in details["outcomes"]:
        title = text.maybe(f"test.{outcome['name']}", outcome["title"])
        with panel(title), box("div", "stack"):
            if outcome["verdict"]:
                with box("div", "line"):
                    tag(text(f"verdict.{outcome['verdict']}"), KINDS[outcome["verdict"]])
            rows = [
                (
                    text.core(quantity["title"]),
                    number(quantity["value"]),
                    f"{quantity['expanded_uncertainty']:.2g}",
                    quantity["unit"],
                    quantity["limit"] or "—",
                    text.maybe(f"verdict.{quantity['verdict']}", "—"),
                )
                for quantity in outcome["quantities"]
            ]
            headings = (("quantity", False), ("value", True), ("uncertainty", True),
                        ("unit", False), ("limit", False), ("verdict", False))  # fmt: skip
            table(title, [(text(f"reducer.{key}"), numbers) for key, numbers in headings], rows)
            for remark in outcome["remarks"]:
                words("p", text.core(remark), "small muted")


def comparison(visitor: Visitor, result: JobResult) -> None:
    """Compare what was found with earlier runs of the same test."""
    text, records = visitor.text, visitor.service.records
    found: list[tuple[str, dict[str, tuple[float, str, str]]]] = []
    for run_id in result.run_ids:
        try:
            kind = records.run(run_id, check=False).run.kind
            for run in records.runs(kind=kind, status="completed", limit=EARLIER).runs:
                detail = records.run(run.run_id, check=False)
                found.append((_specimen(detail.metadata, run.run_id), _quantities(detail.results)))
        except TorquebenchError as error:
            note(text.core(error.found), "warn")
    found = [(name, quantities) for name, quantities in found if quantities]
    if len(found) < 2:
        empty(text("reducer.no_earlier"), "compare")
        return
    keys = list(found[0][1])
    columns = [(text("reducer.specimen"), False)]
    columns += [
        (f"{text.core(found[0][1][key][2])}, {found[0][1][key][1]}", True) for key in keys[:6]
    ]
    rows = [
        (name, *(number(quantities[key][0]) if key in quantities else "—" for key in keys[:6]))
        for name, quantities in found
    ]
    table(text("reducer.compare"), columns, rows)
    key = keys[0]
    names = [name for name, _ in reversed(found)]
    values = [quantities[key][0] for _, quantities in reversed(found) if key in quantities]
    if len(values) == len(names):
        title = text.core(found[0][1][key][2])
        Chart(
            text("reducer.compare_label", title=title),
            text("reducer.specimen"),
            f"{title}, {found[0][1][key][1]}",
            [Line(title, [], values, "--series-1", points=True)],
            names=names,
        )


def _specimen(metadata: Mapping[str, Any], run_id: str) -> str:
    serial = str(metadata.get("serial") or metadata.get("specimen") or "")
    return serial or run_id


def _quantities(results: Any) -> dict[str, tuple[float, str, str]]:
    """Return value, unit and title of every quantity by key."""
    listed = results.get("quantities", []) if isinstance(results, Mapping) else []
    return {
        each["key"]: (float(each["value"]), str(each["unit"]), str(each["title"]))
        for each in listed
        if each.get("value") is not None
    }
