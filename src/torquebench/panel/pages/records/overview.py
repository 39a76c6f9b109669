"""The page of records: runs, calibrations, drift and certificates."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from torquebench.campaign.drifting import DriftSeries
from torquebench.campaign.fitting import model_title
from torquebench.errors import TorquebenchError
from torquebench.panel.components.charts import COLOURS, Chart, Line, error_chart, limit_lines
from torquebench.panel.components.controls import Field, button, link_button
from torquebench.panel.components.elements import (
    box,
    empty,
    headings,
    note,
    panel,
    refilled,
    table,
    to_the_top,
    words,
)
from torquebench.panel.pages.calibrate.resume import unfinished_notes
from torquebench.panel.pages.calibrate.start import calibration_address
from torquebench.panel.pages.downloads import certificate_buttons
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.page import page
from torquebench.panel.pages.records.run import doubt_notes, run_title
from torquebench.panel.pages.records.samples import run_address
from torquebench.panel.pages.view import View, part, tabs
from torquebench.panel.pages.visitor import Visitor, profile_titles
from torquebench.panel.text import Text
from torquebench.records.signatures import how
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
"""Prefix of the kinds of runs in each category; an external table counts as a calibration."""
STATES = ("completed", "aborted", "failed", "running")


class _Runs(View):
    """The view that searches runs and opens one."""

    _offset = 0

    def build(self) -> None:
        text = self._text
        kinds = {beginning: text(f"records.kind_{kind}") for kind, beginning in KINDS.items()}
        states = {state: text.core(state) for state in STATES}
        either = {"": text("records.any")}
        unfinished_notes(self._visitor)
        with panel(text("records.runs")), box("div", "stack"):
            with box("div", "columns narrow"):
                self._search = Field(text("records.search"), kind="search", on_change=self._first)
                self._kind = Field(
                    text("records.kind"), options=either | kinds, on_change=self._first
                )
                self._status = Field(
                    text("records.status"), options=either | states, on_change=self._first
                )
            self._list = box("div", "stack")
        self._show()

    def _first(self, _value: str) -> None:
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
        with refilled(self._list):
            if not page.runs:
                asked = self._search.value or self._kind.value or self._status.value
                empty(text("records.nothing_found" if asked else "records.no_runs"))
                return
            doubt_notes(text, (*page.doubts, *(doubt for run in page.runs for doubt in run.doubts)))
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
            table(
                text("records.runs"),
                headings(text, "records", "started kind operator status number"),
                rows,
                on_row=lambda place: ui.navigate.to(run_address(page.runs[place].run_id)),
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


class _Calibrations(View):
    """The view of calibrations with their models, and a chart of several calibrations' errors."""

    def build(self) -> None:
        named = self._visitor.query.get("with", "").split(",")
        self._chosen = [int(number) for number in named if number.isdecimal()][: len(COLOURS) - 1]
        if self._visitor.has_role("metrologist"):
            with box("div", "line end"):
                link_button(self._text("external.open"), "/operations/records-import")
        self._compared = box("div")
        self._list = box("div")
        self._show()
        self._compare()

    def _show(self) -> None:
        text = self._text
        calibrations = self._visitor.service.records.calibrations(limit=100)
        models = self._visitor.service.records.models()
        in_use = {
            model.calibration_id: text("records.in_use", kind=text.core(model_title(model.kind)))
            for model in models
            if model.active
        }
        with refilled(self._list), panel(text("records.calibrations")):
            if not calibrations:
                empty(text("records.no_calibrations"), "tune")
                return
            words("p", text("records.compare_explained"), "muted")
            doubt_notes(text, (doubt for entry in calibrations for doubt in entry.doubts))
            profiles = profile_titles(self._visitor)
            rows = [
                (
                    str(entry.calibration_id),
                    entry.performed,
                    entry.transducer_serial,
                    profiles.get(entry.profile_name, entry.profile_name),
                    str(entry.points),
                    "—" if entry.due is None else entry.due.isoformat(),
                    in_use.get(entry.calibration_id, ""),
                )
                for entry in calibrations
            ]
            keys = "calibration performed transducer profile points due state"
            table(
                text("records.calibrations"),
                headings(text, "records", keys, "calibration points"),
                rows,
                on_row=lambda place: self._toggle(calibrations[place].calibration_id),
                open_label=text("records.compare"),
                selected=[
                    place
                    for place, entry in enumerate(calibrations)
                    if entry.calibration_id in self._chosen
                ],
            )

    def _toggle(self, number: int) -> None:
        others = [chosen for chosen in self._chosen if chosen != number]
        self._chosen = others if number in self._chosen else [*others[-4:], number]
        self._show()
        self._compare()
        named = ",".join(map(str, self._chosen))
        ui.navigate.history.replace(f"/records?part=calibrations{'&with=' if named else ''}{named}")
        if self._chosen:
            with self._list:  # the selected row was removed
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
                        partial(ui.navigate.to, calibration_address(number)),
                        picture="tune",
                    )


def drift_lines(text: Text, series: DriftSeries) -> list[Line]:
    """Return the values over time, and the lines of the control chart, if there is one."""
    moments = [moment.timestamp() for moment in series.moments]
    lines = [Line(text("records.values"), moments, series.values, "--series-1", points=True)]
    chart = series.chart
    if chart is not None:
        ends = (moments[0], moments[-1])
        lines += [
            Line(text.core("centre"), ends, [chart.centre] * 2, "--series-3"),
            limit_lines(text("records.limits"), *ends, chart.lower, chart.upper),
        ]
    return lines


class _Drift(View):
    """The view of each transducer's drift."""

    def build(self) -> None:
        records = self._visitor.service.records
        drifts = [(serial, records.drift(serial)) for serial in records.transducers()]
        for serial, quantities in drifts:
            for series in quantities:
                with part(self._text):
                    self._series(serial, series)
        if not any(quantities for _, quantities in drifts):
            with panel():
                empty(self._text("records.no_drift"), "show_chart")

    def _series(self, serial: str, series: DriftSeries) -> None:
        text, title = self._text, self._text.core(series.title)
        with panel(f"{serial}: {title}"):
            if len(series.moments) > 1:  # a single point isn't worth a chart
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
            if series.chart is None:
                words("p", text("records.too_few"), "muted")
            remarks = {series.remark(place) for place in range(len(series.values))} - {""}
            for remark in sorted(remarks):
                note(text.core(remark), "warn")


class _Certificates(View):
    """The view of certificates with their files."""

    def build(self) -> None:
        text = self._text
        certificates = self._visitor.service.records.certificates()
        if not certificates:
            with panel():
                empty(text("records.no_certificates"), "workspace_premium")
        for entry in certificates:
            number, issued = entry.number, f"{entry.issued:%Y-%m-%d}"
            with panel(text("records.certificate", number=number)), box("div", "stack"):
                words("p", text("records.issued", when=issued, who=entry.authorised_by,
                                number=entry.calibration_id))  # fmt: skip
                for role, name, signature in entry.acts:
                    came_about = text.core(how(signature))
                    words("p", text(f"records.{role}", who=name, how=came_about), "muted")
                if entry.superseded_by:
                    note(text("records.superseded", number=entry.superseded_by), "warn")
                certificate_buttons(self._visitor, number, tuple(entry.files))


@page("records", "/records", picture="folder_open", place=4)
def records_page(visitor: Visitor) -> None:
    """Build the page of the records."""
    views = {
        "runs": _Runs,
        "calibrations": _Calibrations,
        "drift": _Drift,
        "certificates": _Certificates,
    }
    with frame(visitor, "records"):
        tabs(visitor, "records", views)
