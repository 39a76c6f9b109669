"""The page that starts a calibration and shows its points until it is registered."""

from __future__ import annotations

from functools import partial
from typing import Any

from nicegui import ui

from torquebench.message import Message
from torquebench.operations import find_operation
from torquebench.operations.calibrating import CalibrationResult
from torquebench.panel.components.charts import Chart, Line, error_chart
from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import (
    box,
    headings,
    panel,
    refilled,
    table,
    tag,
    words,
)
from torquebench.panel.pages.calibrate.resume import interrupted_note
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.jobs.panel import JobPanel
from torquebench.panel.pages.jobs.preview import Preview
from torquebench.panel.pages.operations.form import OperationForm
from torquebench.panel.pages.operations.page import begin, operation_buttons
from torquebench.panel.pages.page import page
from torquebench.panel.pages.view import part
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import JobView
from torquebench.units import minus_signs

MEASURING = ("calibrate", "resume")
READINGS, NO_ALARM, COMMAND, IDLE, PRESENCE = (
    Message("Readings come in"),
    Message("No alarm stops the bench"),
    Message("Nobody else is in command"),
    Message("Bench is free"),
    Message("Somebody is in command and has confirmed presence at the bench"),
)
QUICK = ("zero", "check")
SHOWN = 8
"""Number of calibrations that are listed."""


def calibration_address(number: int) -> str:
    """Return the address of a calibration's page."""
    return f"/calibrations/{number}"


class _Start:
    """The form of a calibration, or the running calibration."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._operation = find_operation("calibrate")
        self._shown: tuple[Any, ...] | None = None
        self._checked: tuple[Any, ...] = ()
        self._followed = ""
        self._measuring: _Measuring | None = None
        self._checks: Any = None

    def build(self) -> None:
        with box("div", "stack"):
            self._quick = JobPanel(self._visitor)
            self._job = JobPanel(self._visitor)
            self._content = box("div", "stack")

    def refresh(self) -> None:
        """Follow the jobs."""
        jobs = self._visitor.service.jobs.recent()
        newest = jobs[0] if jobs else None
        self._quick.refresh(newest if newest is not None and newest.kind in QUICK else None)
        job = next((each for each in jobs if each.kind in MEASURING), None)
        if job is not None and isinstance(job.result, CalibrationResult):
            if job.job_id == self._followed:
                ui.navigate.to(calibration_address(job.result.modules[-1].calibration_id))
                self._followed = ""
            job = None
        elif job is not None:
            self._followed = job.job_id
        self._job.refresh(job)
        shown = (None if job is None else job.job_id, job is not None and job.open)
        if shown != self._shown:
            self._shown = shown
            with refilled(self._content), part(self._text):
                self._build_content(job)
        if self._measuring is not None and job is not None:
            self._measuring.refresh(job)
        if self._checks is not None:
            self._check()

    def _build_content(self, job: JobView | None) -> None:
        self._measuring, self._checks, self._checked = None, None, ()
        if job is not None and job.open:
            self._measuring = _Measuring(self._visitor)
            return
        self._prepare({} if job is None else job.request)
        if job is not None:
            self._measuring = _Measuring(self._visitor)
        self._list()

    def _prepare(self, before: Any) -> None:
        text, visitor = self._text, self._visitor
        interrupted_note(visitor)
        given = before if "side" in before else {"side": "output"}
        with box("div", "columns"):
            with panel(text("What is calibrated")), box("div", "stack"):
                self._form = OperationForm(visitor, self._operation, given, on_change=self._preview)
                with box("p", "small"):
                    words("a", text("Upload or edit own profiles"), href="/settings?part=profiles")
            with panel(text("Before it begins")), box("div", "stack"):
                self._checks = box("ul", "stack")
                button(
                    text("Start calibration"),
                    partial(begin, visitor, self._operation, self._form),
                    "primary",
                    picture="play_arrow",
                )
                self._plan = Preview(visitor, "calibrate")
        self._preview()

    def _preview(self) -> None:
        if self._form.check():
            self._plan.show(self._form.request())

    def _check(self) -> None:
        """Show whether the bench is ready."""
        service = self._visitor.service
        snapshot, mine = service.snapshot(), self._visitor.commands
        checks: tuple[tuple[bool, str], ...] = (
            (snapshot.connection == "live", READINGS),
            (not snapshot.stopped, NO_ALARM),
            (mine or snapshot.commanded_by is None, COMMAND),
            (snapshot.job_id is None, IDLE),
        )
        if service.presence_wanted:
            checks += ((mine and service.presence_left_s > 0.0, PRESENCE),)
        if checks == self._checked:
            return
        self._checked = checks
        with refilled(self._checks):
            for good, title in checks:
                with box("li", "line"):
                    kind = "good" if good else "bad"
                    tag(
                        self._text("ready" if good else "not ready"),
                        kind,
                        "check" if good else "close",
                    )
                    words("span", self._text(title))

    def _list(self) -> None:
        """List the newest calibrations with links to their pages."""
        text = self._text
        entries = self._visitor.service.records.calibrations(limit=SHOWN)
        if not entries:
            return
        rows = [
            (
                str(entry.calibration_id),
                entry.performed,
                entry.transducer_serial,
                str(entry.points),
                entry.measured_by,
            )
            for entry in entries
        ]
        with panel(text("Calibrations")):
            table(
                text("Calibrations"),
                headings(
                    text,
                    "No.",
                    "Performed",
                    "Transducer",
                    "Points",
                    "By",
                    numbers=("No.", "Points"),
                ),
                rows,
                on_row=lambda row: ui.navigate.to(calibration_address(entries[row].calibration_id)),
                open_label=text("Open"),
            )


class _Measuring:
    """Charts of the loading steps and the errors of a running calibration."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._count = -1
        text = visitor.text
        with box("div", "columns"):
            with panel(text("Staircase")):
                self._staircase = Chart(
                    text("Standard torque of every point so far."),
                    text("point"),
                    text("standard, N·m"),
                )
            with panel(text("Error of the raw reading")):
                self._errors = error_chart(text, "Error in N·m over the standard torque.")
                self._said = words("p", "", "muted number", role="status")
                words("p", text("Zeros and preloads are steps without a point."), "muted small")

    def refresh(self, job: JobView) -> None:
        """Draw the points measured so far."""
        if job.points == self._count:
            return
        self._count, text = job.points, self._text
        points = [
            point.values
            for point in self._visitor.service.jobs.points(job.job_id)
            if point.stream == "points" and "error_nm" in point.values
        ]
        standard = [point["standard_nm"] for point in points]
        numbers = list(range(1, len(points) + 1))
        self._staircase.show([Line(text("Standard"), numbers, standard, "--series-3")])
        self._errors.show(
            [
                _branch(text(word), [p for p in points if (p.get("branch", 1) >= 0) == up], up)
                for word, up in (("rising", True), ("falling", False))
            ]
        )
        if points:
            last = {
                key: minus_signs(f"{points[-1][f'{key}_nm']:.3f}")
                for key in ("reading", "standard", "error")
            }
            self._said.set_text(
                text(
                    "Point {number}: reading {reading}, standard {standard}, error {error} N·m",
                    number=len(points),
                    **last,
                )
            )


def _branch(title: str, points: list[Any], rising: bool) -> Line:
    return Line(
        title,
        [point["standard_nm"] for point in points],
        [point["error_nm"] for point in points],
        "--series-1" if rising else "--series-2",
        points=True,
        symbol="triangle" if rising else "circle",
    )


@page("calibrate", "/calibrate", "Calibrate", picture="tune", place=2)
def calibrate_page(visitor: Visitor) -> None:
    """Build the page that begins a calibration."""
    shown = _Start(visitor)
    with frame(visitor, "calibrate", shown.refresh) as content:
        with content.title_line:
            operation_buttons(visitor)
        shown.build()
