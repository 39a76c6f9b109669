"""Show a reducer test's quantities with uncertainty, limit and verdict, and other specimens."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from nicegui import ui

from torquebench.campaign import ReducerTestQuantity
from torquebench.chain import not_in_u
from torquebench.errors import TorquebenchError
from torquebench.operations import Result
from torquebench.operations.reducers import LoopKeyPoint, ReducerTestResult, TorqueAngleLoop
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
from torquebench.panel.text import Text
from torquebench.uncertainty import stated
from torquebench.units import minus_signs

EARLIER = 20
NEAR = 0.06
"""Share of a loop's torque range around zero that is also drawn enlarged."""


def number(value: float) -> str:
    """Return a value with five significant digits.

    Examples
    --------
    >>> number(0.123456), number(-12.0), number(float("nan"))
    ('0.12346', '−12', '—')
    """
    return "—" if value != value else minus_signs(f"{value:.5g}")


def with_uncertainty(value: float, uncertainty: float) -> tuple[str, str]:
    """Return a value and its expanded uncertainty, rounded to the same digit if both are known.

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
    """A quantity of one specimen."""

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


def _beside(point: LoopKeyPoint) -> str:
    """Return the side of a key point with space for its label."""
    falling = "↓" in point.label or ("↑" not in point.label and point.torque_nm > 0.0)
    return "left" if falling else "right"


def loop_chart(text: Text, loop: TorqueAngleLoop) -> None:
    """Draw a torque-angle loop with key points, also enlarged around zero; list the key points."""
    torque_nm = np.asarray(loop.torque_nm)
    axes = ("Output torque, N·m", "Output angle, arcmin")
    near_nm = NEAR * float(np.max(np.abs(torque_nm), initial=0.0))
    with box("div", "columns"):
        for title, near in (
            (
                "Hysteresis loop: output angle over output torque, both branches, with key points.",
                False,
            ),
            ("Around zero", True),
        ):
            inside = np.abs(torque_nm) <= (near_nm if near else np.inf)
            lines = [
                Line(text(word), torque_nm[inside].tolist(), angle[inside].tolist(), colour)
                for word, angle, colour in (
                    ("rising", np.asarray(loop.rising_arcmin), "--series-1"),
                    ("falling", np.asarray(loop.falling_arcmin), "--series-2"),
                )
            ]
            shown = [each for each in loop.points if (abs(each.torque_nm) <= near_nm) == near]
            for side in ("left", "right"):
                mine = [each for each in shown if _beside(each) == side]
                lines.append(
                    Line(
                        text("Key points"),
                        [each.torque_nm for each in mine],
                        [each.angle_arcmin for each in mine],
                        "--ink",
                        points=True,
                        labels=[text(each.label) for each in mine],
                        beside=side,
                    )
                )
            with box("div"):
                Chart(text(title), text(axes[0]), text(axes[1]), lines, tall=True)
    columns = headings(text, "Key point", *axes, numbers=axes)
    rows = [
        (text(point.label), number(point.torque_nm), number(point.angle_arcmin))
        for point in loop.points
    ]
    table(text("Key points"), columns, rows)


def test_result(visitor: Visitor, result: ReducerTestResult) -> None:
    """Show every part of a test: quantities with U, limit and verdict, the loop, the report."""
    text = visitor.text
    with panel(), box("div", "spread"):
        serial = result.serial or text("without a serial number")
        words("h2", f"{text(result.reducer)}, {text.title('specimen')} {serial}")
        run_id = result.run_ids[0] if result.run_ids else ""
        if visitor.service.records.has_report(run_id):
            fetch = partial(_fetch_report, visitor, run_id)
            button(text("Report (PDF)"), fetch, picture="download")
    if result.short:
        note(
            text(
                "Short test: a first impression, not for comparison with a data sheet. U "
                "contains what it omits."
            ),
            "warn",
        )
    for side, missing in result.not_in_u.items():
        words("p", f"{text.title(side)}: {text(result.compensation[side])}", "small muted")
        if lacking := not_in_u(missing):
            note(text.sentence(lacking), "warn")
    for failure in result.failures:
        note(text(failure.message), "bad", title=text(failure.title))
    for part in result.parts:
        with panel(text(part.title)), box("div", "stack"):
            if part.verdict:
                with box("div", "line"):
                    tag(text.verdict(part.verdict), verdict_kind(part.verdict))
            columns = headings(
                text,
                "Quantity",
                "Value",
                "± U (k = 2)",
                "Unit",
                "Data sheet",
                "Verdict",
                numbers=("Value", "± U (k = 2)"),
            )
            table(text(part.title), columns, [_row(text, each) for each in part.quantities])
            if part.loop is not None:
                loop_chart(text, part.loop)
            for remark in (*part.remarks, *map(str, part.findings)):
                words("p", text(remark), "small muted")


def _row(text: Text, quantity: ReducerTestQuantity) -> tuple[str, ...]:
    return (
        text(quantity.title),
        *with_uncertainty(quantity.value, quantity.expanded_uncertainty),
        quantity.unit,
        quantity.limit or "—",
        text.verdict(quantity.verdict) or "—",
    )


def comparison(visitor: Visitor, result: Result) -> None:
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
            note(text(error.found), "warn")
    found = [(name, quantities) for name, quantities in found if quantities]
    if len(found) < 2:
        empty(text("No earlier result of this test to compare with."), "compare")
        return
    keys = list(found[0][1])
    columns = [(text.title("specimen"), False)]
    columns += [
        (f"{text(found[0][1][key].title)}, {found[0][1][key].unit}", True) for key in keys[:6]
    ]
    rows = [
        (name, *(str(quantities[key]) if key in quantities else "—" for key in keys[:6]))
        for name, quantities in found
    ]
    table(text("Compared with earlier specimens"), columns, rows)
    words("p", text("± expanded uncertainty, k = 2."), "small muted")
    key = keys[0]
    names = [name for name, _ in reversed(found)]
    shown = [quantities[key] for _, quantities in reversed(found) if key in quantities]
    if len(shown) == len(names):
        values = [each.value for each in shown]
        title = text(found[0][1][key].title)
        Chart(
            text("{title} of every specimen.", title=title),
            text.title("specimen"),
            title + text(", ") + found[0][1][key].unit,
            [
                Line(text("values"), [], values, "--series-1", points=True),
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
