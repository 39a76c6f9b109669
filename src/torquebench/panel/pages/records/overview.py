"""The records: runs, calibrations, drift and certificates; search, open, compare, plot, export."""

from __future__ import annotations

from functools import partial
from typing import Any

from torquebench.campaign.drifting import DriftSeries
from torquebench.campaign.fitting import model_title
from torquebench.errors import TorquebenchError
from torquebench.panel.components.charts import COLOURS, Chart, Line, error_chart, limit_lines
from torquebench.panel.components.controls import Field, button
from torquebench.panel.components.elements import (
    box,
    empty,
    note,
    panel,
    table,
    to_the_top,
    words,
)
from torquebench.panel.components.tabs import Tabs
from torquebench.panel.pages.calibrate.resume import take_up, unfinished_notes
from torquebench.panel.pages.downloads import certificate_buttons
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.page import page
from torquebench.panel.pages.records.run import RunPanel, doubt_notes, run_title
from torquebench.panel.pages.records.table_import import TableEntry, all_profile_titles
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.text import Text
from torquebench.units import minus_signs

__all__ = ["drift_lines", "records_page"]

ROWS = 25
KINDS = {
    "calibrate": "calibrat",
    "verify": "verify",
    "check": "check",
    "zero": "zero",
    "test": "test",
    "record": "record",
}
"""What the kinds of a run's identifier begin with; an external table is a calibration, too."""
TABS = ("runs", "calibrations", "drift", "certificates")


class _Runs:
    """Search the runs and open one."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._offset = 0

    def build(self) -> None:
        text = self._text
        kinds = {"": text("records.any")} | {
            beginning: text(f"records.kind_{kind}") for kind, beginning in KINDS.items()
        }
        states = {"": text("records.any")} | {
            state: text.core(state) for state in ("completed", "aborted", "failed", "running")
        }
        unfinished_notes(self._visitor)
        self._opened = box("div", "stack")
        with panel(text("records.runs")), box("div", "stack"):
            with box("div", "columns narrow"):
                self._search = Field(
                    text("records.search"), kind="search", on_change=lambda _: self._first()
                )
                self._kind = Field(
                    text("records.kind"), options=kinds, on_change=lambda _: self._first()
                )
                self._status = Field(
                    text("records.status"), options=states, on_change=lambda _: self._first()
                )
            self._found = box("div", "stack")
        self._show()

    def _first(self) -> None:
        self._offset = 0
        self._show()

    def _show(self) -> None:
        text = self._text
        page = self._visitor.service.records.runs(
            self._search.value,
            kind=self._kind.value or None,
            status=self._status.value or None,
            limit=ROWS,
            offset=self._offset,
        )
        self._found.clear()
        with self._found:
            if not page.runs:
                asked = self._search.value or self._kind.value or self._status.value
                empty(text("records.nothing_found" if asked else "records.no_runs"))
                return
            doubt_notes(text, (*page.doubts, *(each for run in page.runs for each in run.doubts)))
            rows = [
                (
                    run.started,
                    run_title(text, run.kind),
                    run.operator,
                    text.core(run.status),
                    run.run_id,
                )
                for run in page.runs
            ]
            headings = ("started", "kind", "operator", "status", "number")
            table(
                text("records.runs"),
                [(text(f"records.{key}"), False) for key in headings],
                rows,
                on_row=lambda place: self._open(page.runs[place].run_id),
                open_label=text("records.open"),
            )
            self._pager(page.total)

    def _pager(self, total: int) -> None:
        text = self._text
        last = min(self._offset + ROWS, total)
        with box("div", "spread"):
            words("span", text("records.shown", first=self._offset + 1, last=last, total=total),
                  "muted")  # fmt: skip
            with box("div", "line"):
                if self._offset:
                    button(text("records.newer"), lambda: self._turn(-ROWS), "small")
                if last < total:
                    button(text("records.older"), lambda: self._turn(ROWS), "small")

    def _turn(self, by: int) -> None:
        self._offset = max(0, self._offset + by)
        self._show()

    async def _open(self, run_id: str) -> None:
        await RunPanel(self._visitor, run_id, self._opened.clear).build(self._opened)


class _Calibrations:
    """Calibrations with their models; the errors of several in one chart."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._chosen: list[int] = []

    def build(self) -> None:
        if self._visitor.has_role("metrologist"):
            with box("div", "line end"):
                button(self._text("external.open"), self._enter, picture="upload_file")
        self._entry = box("div")
        self._compared = box("div")
        self._list = box("div")
        self._show()

    def _enter(self) -> None:
        self._entry.clear()
        with self._entry:
            TableEntry(self._visitor, self._entered).build()
        to_the_top()

    def _entered(self, number: int) -> None:
        self._entry.clear()
        self._chosen = [number]
        self._show()
        self._compare()

    def _show(self) -> None:
        text = self._text
        found = self._visitor.service.records.calibrations(limit=100)
        models = self._visitor.service.records.models()
        active = {model.calibration_id: model for model in models if model.active}
        self._list.clear()
        with self._list, panel(text("records.calibrations")):
            if not found:
                empty(text("records.no_calibrations"), "tune")
                return
            words("p", text("records.compare_explained"), "muted")
            doubt_notes(text, (doubt for each in found for doubt in each.doubts))
            profiles = all_profile_titles(self._visitor)
            rows = [
                (
                    str(each.calibration_id),
                    each.performed,
                    each.transducer_serial,
                    profiles.get(each.profile_name, each.profile_name),
                    str(each.points),
                    "—" if each.due is None else each.due.isoformat(),
                    text(
                        "records.in_use",
                        kind=text.core(model_title(active[each.calibration_id].kind)),
                    )
                    if each.calibration_id in active
                    else "",
                )
                for each in found
            ]
            headings = (("calibration", True), ("performed", False), ("transducer", False),
                        ("profile", False), ("points", True), ("due", False),
                        ("state", False))  # fmt: skip
            table(
                text("records.calibrations"),
                [(text(f"records.{key}"), number) for key, number in headings],
                rows,
                on_row=lambda place: self._toggle(found[place].calibration_id),
                open_label=text("records.compare"),
                selected=[
                    place for place, each in enumerate(found) if each.calibration_id in self._chosen
                ],
            )

    def _toggle(self, number: int) -> None:
        if number in self._chosen:
            self._chosen.remove(number)
        else:
            self._chosen = [*self._chosen[-4:], number]
        self._show()
        self._compare()
        if self._chosen:
            with self._list:  # the selected row no longer exists
                to_the_top()

    def _compare(self) -> None:
        text, records = self._text, self._visitor.service.records
        self._compared.clear()
        if not self._chosen:
            return
        lines = []
        for colour, number in zip(COLOURS, self._chosen, strict=False):
            try:
                active = [model for model in records.calibration(number).models if model.active]
                curve = records.error_curve(number, active[0].model_id if active else None)
            except TorquebenchError as error:
                self._visitor.messages.problem(error)
                continue
            title = f"{text('records.calibration')} {number}"
            lines.append(
                Line(f"{title}, {text('live.raw')}", curve.standard_nm, curve.raw_error_nm,
                     colour, points=True, symbol="emptyCircle")
            )  # fmt: skip
            if curve.model_error_nm:
                lines.append(
                    Line(f"{title}, {text('live.line_compensated')}", curve.standard_nm,
                         curve.model_error_nm, colour, points=True, symbol="rect")
                )  # fmt: skip
        with self._compared, panel(text("records.compared")):
            error_chart(text, "models.curves_label", lines, tall=True)
            with box("div", "line"):
                for number in self._chosen:
                    button(
                        text("records.take_up", number=number),
                        partial(take_up, self._visitor, number),
                        picture="tune",
                    )


def drift_lines(text: Text, series: DriftSeries) -> list[Line]:
    """Return the values over time, and the control chart's lines where there is one."""
    moments = [moment.timestamp() for moment in series.moments]
    lines = [Line(text("records.values"), moments, series.values, "--series-1", points=True)]
    chart = series.chart
    if chart is not None:
        ends = (moments[0], moments[-1])
        lines += [
            Line(text("records.centre"), ends, [chart.centre] * 2, "--series-3"),
            limit_lines(text("records.limits"), *ends, chart.lower, chart.upper),
        ]
    return lines


def _drift(visitor: Visitor) -> None:
    """Show the drift of each transducer."""
    text, records = visitor.text, visitor.service.records
    shown = 0
    for serial in records.transducers():
        for series in records.drift(serial):
            shown += 1
            title = text.core(series.title)
            with panel(f"{serial}: {title}"):
                chart = series.chart
                if len(series.moments) > 1:  # a chart of a single point says less than a sentence
                    Chart(
                        text("records.drift_label", title=title),
                        text("records.time"),
                        f"{title}, {series.unit}",
                        drift_lines(text, series),
                        moments=True,
                    )
                else:
                    said = minus_signs(f"{series.values[0]:.4g} {series.unit}")
                    when = f"{series.moments[0]:%Y-%m-%d}"
                    words("p", text("records.one_value", value=said, when=when))
                if chart is None:
                    words("p", text("records.too_few"), "muted")
                remarks = {series.remark(place) for place in range(len(series.values))} - {""}
                for remark in sorted(remarks):
                    note(text.core(remark), "warn")
    if not shown:
        with panel():
            empty(text("records.no_drift"), "show_chart")


def _certificates(visitor: Visitor) -> None:
    """List the certificates and offer their files."""
    text = visitor.text
    found = visitor.service.records.certificates()
    if not found:
        with panel():
            empty(text("records.no_certificates"), "workspace_premium")
    for each in found:
        with panel(text("records.certificate", number=each.number)), box("div", "stack"):
            said = text("records.issued", when=f"{each.issued:%Y-%m-%d}", who=each.authorised_by,
                        number=each.calibration_id)  # fmt: skip
            words("p", said)
            if each.superseded_by:
                note(text("records.superseded", number=each.superseded_by), "warn")
            certificate_buttons(visitor, each.number, tuple(each.files))


@page("records", "/records", picture="folder_open", place=4)
def records_page(visitor: Visitor) -> None:
    """Build the page of the records."""
    views: dict[str, Any] = {
        "runs": lambda: _Runs(visitor).build(),
        "calibrations": lambda: _Calibrations(visitor).build(),
        "drift": lambda: _drift(visitor),
        "certificates": lambda: _certificates(visitor),
    }
    with frame(visitor, "records"):
        titles = {name: visitor.text(f"records.{name}") for name in TABS}
        Tabs(visitor.text("records.title"), titles, views)
