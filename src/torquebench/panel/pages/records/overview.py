"""The page of records: runs, calibrations, drift and certificates."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from nicegui import ui

from torquebench.campaign.drifting import DriftSeries
from torquebench.campaign.fitting import model_title
from torquebench.errors import TorquebenchError
from torquebench.panel.components.charts import COLOURS, Chart, Line, error_chart, limit_lines
from torquebench.panel.components.controls import Field, button, link_button
from torquebench.panel.components.elements import (
    box,
    dated,
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
from torquebench.panel.pages.records.run import compared_address, doubt_notes, run_title
from torquebench.panel.pages.records.samples import run_address
from torquebench.panel.pages.view import View, part, tabs
from torquebench.panel.pages.visitor import Visitor, profile_titles
from torquebench.panel.text import Text, Texts
from torquebench.records.signatures import how
from torquebench.units import minus_signs

ROWS = 25
OFFERED = 100
POINTS = ("calibrate", "verify", "check", "turning")
"""Beginnings of the kinds of runs with points against a standard."""
ACTS: Texts = {
    "checked": "Checked by {who}: {how}.",
    "used": "Put into use by {who}: {how}.",
    "authorised": "Authorised by {who}: {how}.",
}
TABS: Texts = {
    "runs": "Runs",
    "calibrations": "Calibrations",
    "drift": "Drift",
    "certificates": "Certificates",
}
KINDS: Texts = {
    "calibrat": "calibrations",
    "verify": "verifications",
    "check": "daily checks",
    "zero": "zeros",
    "test": "reducer tests",
    "record": "recordings",
}
"""Categories of runs by the beginning of their kinds; an external table is a calibration."""
STATES = ("completed", "aborted", "failed", "running")


class _Runs(View):
    """The view that searches runs and opens one."""

    _offset = 0

    def build(self) -> None:
        text = self._text
        kinds = {beginning: text(title) for beginning, title in KINDS.items()}
        states = {state: text(state) for state in STATES}
        either = {"": text("any")}
        unfinished_notes(self._visitor)
        with panel(text("Runs")), box("div", "stack"):
            with box("div", "columns narrow"):
                self._search = Field(
                    text("Search in number, kind, person, profile"),
                    kind="search",
                    on_change=self._first,
                )
                self._kind = Field(text("Kind"), options=either | kinds, on_change=self._first)
                self._status = Field(text("State"), options=either | states, on_change=self._first)
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
                empty(
                    text(
                        "Nothing matches. Use fewer search words."
                        if asked
                        else "No runs yet. A calibration or a test makes the first one."
                    )
                )
                return
            doubt_notes(text, (*page.doubts, *(doubt for run in page.runs for doubt in run.doubts)))
            rows = [
                (
                    run.started,
                    run_title(text, run.kind),
                    run.operator,
                    text(run.status),
                    run.run_id,
                )
                for run in page.runs
            ]
            table(
                text("Runs"),
                headings(text, "Started", "Kind", "By", "State", "Number"),
                rows,
                on_row=lambda place: ui.navigate.to(run_address(page.runs[place].run_id)),
                open_label=text("Open"),
            )
            self._pager(page.total)

    def _pager(self, total: int) -> None:
        text = self._text
        last = min(self._offset + ROWS, total)
        with box("div", "spread"):
            first = self._offset + 1
            said = text("{first} to {last} of {total}", first=first, last=last, total=total)
            words("span", said, "muted")
            with box("div", "line"):
                if self._offset:
                    button(text("Newer"), lambda: self._turn(-ROWS), "small")
                if last < total:
                    button(text("Older"), lambda: self._turn(ROWS), "small")

    def _turn(self, by: int) -> None:
        self._offset = max(0, self._offset + by)
        self._show()


class _Calibrations(View):
    """The view of calibrations with their models, and a chart of several calibrations' errors."""

    def build(self) -> None:
        text, named = self._text, self._visitor.query.get("with", "").split(",")
        self._chosen = [name for name in named if name][: len(COLOURS) - 1]
        with box("div", "spread"):
            Field(
                text("Overlay the points of a run"), "", options=self._offered(),
                on_change=self._add,
            )  # fmt: skip
            if self._visitor.has_role("metrologist"):
                link_button(text("Enter external calibration"), "/operations/records-import")
        self._compared = box("div")
        self._list = box("div")
        self._show()
        self._compare()

    def _offered(self) -> dict[str, str]:
        runs = self._visitor.service.records.runs(limit=OFFERED).runs
        measured = (run for run in runs if run.finished is not None and run.kind.startswith(POINTS))
        return {"": self._text("Choose a run")} | {run.run_id: run.run_id for run in measured}

    def _add(self, run_id: str) -> None:
        if run_id and run_id not in self._chosen:
            self._toggle(run_id)

    def _show(self) -> None:
        text = self._text
        calibrations = self._visitor.service.records.calibrations(limit=100)
        models = self._visitor.service.records.models()
        in_use = {
            model.calibration_id: text("in use: {kind}", kind=text(model_title(model.kind)))
            for model in models
            if model.active
        }
        with refilled(self._list), panel(text("Calibrations")):
            if not calibrations:
                empty(text("No calibrations yet."), "tune")
                return
            words(
                "p",
                text(
                    "Choose calibrations to compare their errors in one chart, or to continue "
                    "with one."
                ),
                "muted",
            )
            doubt_notes(text, (doubt for entry in calibrations for doubt in entry.doubts))
            profiles = profile_titles(self._visitor)
            rows = [
                (
                    str(entry.calibration_id),
                    entry.performed,
                    entry.transducer_serial,
                    profiles.get(entry.profile_name, entry.profile_name),
                    str(entry.points),
                    "—" if entry.due is None else entry.due,
                    in_use.get(entry.calibration_id, ""),
                )
                for entry in calibrations
            ]
            table(
                text("Calibrations"),
                headings(
                    text,
                    "No.",
                    "Performed",
                    "Transducer",
                    "Profile",
                    "Points",
                    "Valid until",
                    "In use",
                    numbers=("No.", "Points"),
                ),
                rows,
                on_row=lambda place: self._toggle(str(calibrations[place].calibration_id)),
                open_label=text("Compare"),
                selected=[
                    place
                    for place, entry in enumerate(calibrations)
                    if str(entry.calibration_id) in self._chosen
                ],
            )

    def _toggle(self, name: str) -> None:
        """Show a calibration or a run in the chart, or take it out."""
        others = [chosen for chosen in self._chosen if chosen != name]
        self._chosen = others if name in self._chosen else [*others[-4:], name]
        self._show()
        self._compare()
        ui.navigate.history.replace(compared_address(self._chosen))
        if self._chosen:
            with self._list:  # the selected row was removed
                to_the_top()

    def _compare(self) -> None:
        text = self._text
        self._compared.clear()
        if not self._chosen:
            return
        lines = []
        for colour, name in zip(COLOURS, self._chosen, strict=False):
            try:
                lines += self._errors(name, colour)
            except TorquebenchError as error:
                self._visitor.messages.problem(error)
        with self._compared, panel(text("Errors compared")):
            error_chart(
                text,
                "Error of the raw reading, and what every shown model takes off it, over "
                "the standard torque.",
                lines,
                tall=True,
            )
            with box("div", "line"):
                for name in self._chosen:
                    if name.isdecimal():
                        title = text("Open calibration {number} in the wizard", number=name)
                        address = calibration_address(int(name))
                    else:
                        title, address = text("Run {number}", number=name), run_address(name)
                    link_button(title, address)
                    remove = partial(self._toggle, name)
                    button(text("Remove {name}", name=name), remove, "small quiet", picture="close")

    def _errors(self, name: str, colour: str) -> list[Line]:
        """Return the errors of a calibration and its model, or of a run's points."""
        text, records = self._text, self._visitor.service.records
        if not name.isdecimal():
            return [Line(name, *records.run_errors(name), colour, points=True, symbol="triangle")]
        active = [model for model in records.calibration(int(name)).models if model.active]
        curve = records.error_curve(int(name), active[0].model_id if active else None)
        title = f"{text('No.')} {name}"
        lines = [
            Line(f"{title}, {text('Raw')}", curve.standard_nm, curve.raw_error_nm,
                 colour, points=True, hollow=True)
        ]  # fmt: skip
        if curve.model_error_nm:
            lines.append(
                Line(f"{title}, {text('Compensated')}", curve.standard_nm,
                     curve.model_error_nm, colour, points=True, symbol="rect")
            )  # fmt: skip
        return lines


def drift_lines(text: Text, series: DriftSeries) -> list[Line]:
    """Return the values over time, and the lines of the control chart, if there is one."""
    moments = [moment.timestamp() for moment in series.moments]
    lines = [Line(text("values"), moments, series.values, "--series-1", points=True)]
    chart = series.chart
    if chart is not None:
        ends = (moments[0], moments[-1])
        lines += [
            Line(text("centre"), ends, [chart.centre] * 2, "--series-3"),
            limit_lines(text("control limits"), *ends, chart.lower, chart.upper),
        ]
    return lines


class _Drift(View):
    """The view of each transducer's drift."""

    def build(self) -> None:
        records = self._visitor.service.records
        drifts = [(serial, records.drift(serial)) for serial in records.transducers()]
        alone = []
        for serial, quantities in drifts:
            for series in quantities:
                if len(series.moments) == 1:  # not worth a chart
                    alone.append((serial, series))
                    continue
                with part(self._text):
                    self._series(serial, series)
        if alone:
            with part(self._text):
                self._alone(alone)
        if not any(quantities for _, quantities in drifts):
            with panel():
                empty(
                    self._text(
                        "No data yet. Drift charts are made from zeros, checks and calibrations."
                    ),
                    "show_chart",
                )

    def _series(self, serial: str, series: DriftSeries) -> None:
        text, title = self._text, self._text(series.title)
        with panel(f"{serial}: {title}"):
            Chart(
                text("{title} over time with control limits.", title=title),
                text("time"),
                title + text(", ") + series.unit,
                drift_lines(text, series),
                moments=True,
            )
            if series.chart is None:
                words("p", text("Fewer than three values: no control limits yet."), "muted")
            self._remarks(series)

    def _remarks(self, series: DriftSeries) -> None:
        remarks = {series.remark(place) for place in range(len(series.values))} - {""}
        for remark in sorted(remarks):
            note(self._text(remark), "warn")

    def _alone(self, alone: Sequence[tuple[str, DriftSeries]]) -> None:
        """List the quantities that have one value so far."""
        text = self._text
        rows = [
            (
                serial,
                text(series.title),
                minus_signs(f"{series.values[0]:.4g} {series.unit}"),
                series.moments[0],
            )
            for serial, series in alone
        ]
        with panel(text("One value so far")):
            columns = headings(text, "Transducer", "Quantity", "Value", "When", numbers=("Value",))
            table(text("One value so far"), columns, rows)
            for _, series in alone:
                self._remarks(series)


class _Certificates(View):
    """The view of certificates with their files."""

    def build(self) -> None:
        text = self._text
        certificates = self._visitor.service.records.certificates()
        if not certificates:
            with panel():
                empty(
                    text("No certificates yet. The last step of a calibration issues one."),
                    "workspace_premium",
                )
        for entry in certificates:
            number = entry.number
            with panel(text("Certificate {number}", number=number)), box("div", "stack"):
                said = text(
                    "Issued {when}, authorised by {who}, calibration {number}.",
                    when="#", who=entry.authorised_by, number=entry.calibration_id,
                )  # fmt: skip
                dated(said, entry.issued.date())
                for role, name, signature in entry.acts:
                    came_about = text(how(signature))
                    words("p", text(ACTS[role], who=name, how=came_about), "muted")
                if entry.superseded_by:
                    note(text("Superseded by {number}.", number=entry.superseded_by), "warn")
                certificate_buttons(self._visitor, number, tuple(entry.files))


@page("records", "/records", "Records", picture="folder_open", place=4)
def records_page(visitor: Visitor) -> None:
    """Build the page of the records."""
    views = {
        "runs": _Runs,
        "calibrations": _Calibrations,
        "drift": _Drift,
        "certificates": _Certificates,
    }
    with frame(visitor, "records"):
        tabs(visitor, "records", TABS, views)
