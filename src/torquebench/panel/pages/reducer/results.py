"""Results of a reducer test: quantities with uncertainty, limit and verdict; earlier specimens."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from nicegui import ui

from torquebench.errors import TorquebenchError
from torquebench.panel.components.charts import Chart, Line, error_bars
from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import (
    box,
    empty,
    headings,
    note,
    panel,
    table,
    tag,
    words,
)
from torquebench.panel.components.verdicts import verdict_kind
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import JobResult
from torquebench.panel.text import Text
from torquebench.uncertainty import stated
from torquebench.units import minus_signs

__all__ = ["comparison", "outcomes"]

EARLIER = 20
NEAR = 0.06
"""Share of a loop's torque around zero that is drawn enlarged."""


def number(value: float) -> str:
    """Return a value with five significant digits.

    Examples
    --------
    >>> number(0.123456), number(-12.0), number(float("nan"))
    ('0.12346', '−12', '—')
    """
    return "—" if value != value else minus_signs(f"{value:.5g}")


def with_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Return a value and its expanded uncertainty, rounded to the same digit, as far as known.

    Examples
    --------
    >>> with_uncertainty(-0.51322, 0.00688), with_uncertainty(0.5, float("nan"))
    (('−0.5132', '0.0069'), ('0.5', '—'))
    """
    if not (math.isfinite(value) and math.isfinite(uncertainty)):
        return number(value), number(uncertainty)
    shown, expanded = stated(value, uncertainty)
    return minus_signs(shown), expanded


@dataclass(frozen=True)
class _Quantity:
    """Results of one specimen."""

    value: float
    expanded_uncertainty: float
    unit: str
    title: str

    def __str__(self) -> str:
        value, uncertainty = with_uncertainty(self.value, self.expanded_uncertainty)
        return f"{value} ± {uncertainty}" if self.expanded_uncertainty > 0.0 else value


def _fetch_report(visitor: Visitor, run_id: str) -> None:
    report = visitor.service.records.report_file
    visitor.attempt(lambda: ui.download(report(run_id), f"{run_id}.pdf", "application/pdf"))


def _whose(visitor: Visitor, details: Mapping[str, Any]) -> None:
    """Show the specimen, and offer the report."""
    text = visitor.text
    with panel(), box("div", "spread"):
        serial = details["serial"] or text("reducer.no_serial")
        words("h2", f"{text.core(details['reducer_name'])}, {text.title('specimen')} {serial}")
        if run_id := details.get("report"):
            button(
                text("reducer.report"), partial(_fetch_report, visitor, run_id), picture="download"
            )


def _beside(point: Mapping[str, Any]) -> str:
    """Return the side of a key point that has room for its label."""
    falling = "↓" in point["label"] or ("↑" not in point["label"] and point["torque_nm"] > 0.0)
    return "left" if falling else "right"


def loop_chart(text: Text, loop: Mapping[str, Any]) -> None:
    """Draw a torque-angle loop, and around zero once more, with key points; list them."""
    points = [each | {"said": text.core(each["label"])} for each in loop["points"]]
    near_nm = NEAR * max((abs(torque) for torque in loop["torque_nm"]), default=0.0)
    with box("div", "columns"):
        for title, near in (("reducer.loop_label", False), ("reducer.loop_near", True)):
            inside = [
                row for row, torque in enumerate(loop["torque_nm"])
                if not near or abs(torque) <= near_nm
            ]  # fmt: skip
            torque = [loop["torque_nm"][row] for row in inside]
            branches = (("rising", "--series-2"), ("falling", "--series-1"))
            lines = [
                Line(text.core(branch), torque,
                     [loop[f"{branch}_arcmin"][row] for row in inside], colour)
                for branch, colour in branches
            ]  # fmt: skip
            shown = [each for each in points if (abs(each["torque_nm"]) <= near_nm) == near]
            for side in ("left", "right"):
                mine = [each for each in shown if _beside(each) == side]
                lines.append(
                    Line(
                        text("reducer.key_points"),
                        [each["torque_nm"] for each in mine],
                        [each["angle_arcmin"] for each in mine],
                        "--ink",
                        points=True,
                        labels=[each["said"] for each in mine],
                        beside=side,
                    )
                )
            axes = (text("reducer.loop_torque"), text("reducer.loop_angle"))
            with box("div"):
                Chart(text(title), *axes, lines, tall=True)
    columns = headings(
        text, "reducer", "key_point loop_torque loop_angle", "loop_torque loop_angle"
    )
    rows = [
        (point["said"], number(point["torque_nm"]), number(point["angle_arcmin"]))
        for point in points
    ]
    table(text("reducer.key_points"), columns, rows)


def outcomes(visitor: Visitor, details: Mapping[str, Any]) -> None:
    """Show every outcome of a test."""
    text = visitor.text
    _whose(visitor, details)
    if details.get("short"):
        note(text("reducer.short"), "warn")
    for outcome in details["outcomes"]:
        title = text.core(outcome["title"])
        with panel(title), box("div", "stack"):
            if outcome["verdict"]:
                with box("div", "line"):
                    tag(text.verdict(outcome["verdict"]), verdict_kind(outcome["verdict"]))
            rows = [
                (
                    text.core(quantity["title"]),
                    *with_uncertainty(quantity["value"], quantity["expanded_uncertainty"]),
                    quantity["unit"],
                    quantity["limit"] or "—",
                    text.verdict(quantity["verdict"]) or "—",
                )
                for quantity in outcome["quantities"]
            ]
            keys = "quantity value uncertainty unit limit verdict"
            table(title, headings(text, "reducer", keys, "value uncertainty"), rows)
            if outcome.get("loop"):
                loop_chart(text, outcome["loop"])
            for remark in outcome["remarks"]:
                words("p", text.core(remark), "small muted")


def comparison(visitor: Visitor, result: JobResult) -> None:
    """Compare the results with earlier runs of the same test."""
    text, records = visitor.text, visitor.service.records
    found: list[tuple[str, dict[str, _Quantity]]] = []
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
    columns = [(text.title("specimen"), False)]
    columns += [
        (f"{text.core(found[0][1][key].title)}, {found[0][1][key].unit}", True) for key in keys[:6]
    ]
    rows = [
        (name, *(str(quantities[key]) if key in quantities else "—" for key in keys[:6]))
        for name, quantities in found
    ]
    table(text("reducer.compare"), columns, rows)
    words("p", text("reducer.compare_uncertainty"), "small muted")
    key = keys[0]
    names = [name for name, _ in reversed(found)]
    shown = [quantities[key] for _, quantities in reversed(found) if key in quantities]
    if len(shown) == len(names):
        values = [each.value for each in shown]
        title = text.core(found[0][1][key].title)
        Chart(
            text("reducer.compare_label", title=title),
            text.title("specimen"),
            f"{title}, {found[0][1][key].unit}",
            [
                Line(text("records.values"), [], values, "--series-1", points=True),
                error_bars("± U", values, [each.expanded_uncertainty for each in shown]),
            ],
            names=names,
        )


def _specimen(metadata: Mapping[str, Any], run_id: str) -> str:
    serial = str(metadata.get("serial") or metadata.get("specimen") or "")
    return serial or run_id


def _quantities(results: Any) -> dict[str, _Quantity]:
    """Return all quantities by key."""
    listed = results.get("quantities", []) if isinstance(results, Mapping) else []
    return {
        each["key"]: _Quantity(
            float(each["value"]),
            float(each.get("expanded_uncertainty") or 0.0),
            str(each["unit"]),
            str(each["title"]),
        )
        for each in listed
        if each.get("value") is not None
    }
