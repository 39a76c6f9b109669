"""Reducer tests: choose, see what would happen, watch, read the verdict, compare specimens."""

from __future__ import annotations

from typing import Any

from torquebench.errors import TorquebenchError
from torquebench.panel.components.charts import COLOURS, Chart, Line
from torquebench.panel.components.controls import Choice, Field, button
from torquebench.panel.components.elements import box, empty, note, panel, words
from torquebench.panel.pages.calibrate_measure import preview_panel
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.job_panel import JobPanel
from torquebench.panel.pages.quick import clear_choice
from torquebench.panel.pages.reducer_result import comparison, outcomes
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import JobPoint, JobView, Problem

__all__ = ["reducer_page"]

TESTS = (
    "no-load",
    "starting",
    "back-driving",
    "hysteresis",
    "transmission-error",
    "efficiency",
    "full",
)
AXES = {
    "x": ("input_speed_rpm", "speed_rpm", "output_angle_deg", "angle_deg", "output_angle_rad",
          "angle_rad", "input_angle_rad", "time_s"),
    "y": ("output_torque_nm", "input_torque_nm", "torque_nm", "output_reading_nm",
          "input_reading_nm", "reading_nm"),
}  # fmt: skip
"""Fields of a point to draw, the first ones that it has."""


class _ReducerPage:
    def __init__(self, visitor: Visitor) -> None:
        self.visitor, self.text = visitor, visitor.text
        self._job: JobView | None = None
        self._shown: tuple[Any, ...] | None = None
        self._count = -1
        self._drawn: tuple[str, str] = ("", "")

    def build(self) -> None:
        with box("div", "stack"):
            self._panel = JobPanel(self.visitor)
            self._live = box("div", "stack")
            self._form = box("div", "stack")
        self._choose()

    def _choose(self) -> None:
        text, visitor = self.text, self.visitor
        with self._form:
            with panel(text("reducer.what")), box("div", "stack"):
                with box("div", "columns"):
                    names = {
                        item.name: f"{item.document.get('name', item.name)}"
                        for item in visitor.service.settings.items("reducers")
                    }
                    self._reducer = Field(
                        text("reducer.type"),
                        next(iter(names)),
                        options=names,
                        on_change=lambda _: self._preview(),
                    )
                    self._serial = Field(
                        text("reducer.serial"), maxlength="64", autocomplete="off",
                        hint=text("reducer.serial_hint"),
                    )  # fmt: skip
                tests = {name: text(f"test.{name}") for name in TESTS}
                self._test = Choice(
                    text("reducer.test"), tests, "hysteresis", on_change=self._preview
                )
                self._clear = clear_choice(visitor)
                with box("div", "line"):
                    button(text("reducer.start"), self._start, "primary", picture="play_arrow")
            self._plan = box("div")
        self._preview()

    def _request(self) -> dict[str, Any]:
        request: dict[str, Any] = {
            "reducer": self._reducer.value,
            "serial": self._serial.value.strip(),
            "test": self._test.value,
        }
        if self._clear is not None:
            request["bench_clear"] = "clear" in self._clear.values
        return request

    def _preview(self) -> None:
        text = self.text
        self._plan.clear()
        with self._plan, panel(text("preview.title")):
            try:
                preview = self.visitor.service.jobs.preview("reducer-test", self._request())
            except TorquebenchError as error:
                problem = Problem.of(error)
                note(" ".join((problem.found, problem.allowed, problem.remedy)), "warn")
                return
            preview_panel(text, preview)

    def _start(self) -> None:
        visitor = self.visitor
        visitor.attempt(
            lambda: visitor.service.jobs.start(visitor.actor, "reducer-test", self._request())
        )
        self.refresh()

    def refresh(self) -> None:
        jobs = self.visitor.service.jobs.recent()
        job = next((each for each in jobs if each.kind == "reducer-test"), None)
        self._panel.refresh(job)
        known = None if job is None else (job.job_id, job.open)
        if known != self._shown:
            self._shown, self._job, self._count = known, job, -1
            self._form.set_visibility(job is None or not job.open)
            self._show(job)
        if job is not None and job.open and job.points != self._count:
            self._count = job.points
            self._grow(job)

    def _show(self, job: JobView | None) -> None:
        text = self.text
        self._live.clear()
        self._chart: Chart | None = None
        if job is None:
            return
        with self._live:
            if job.open:
                with panel(text("reducer.live")):
                    self._place = box("div")
                    with self._place:
                        empty(text("reducer.waiting"), "hourglass_empty")
            elif job.result is not None:
                outcomes(text, job.result.details)
                with panel(text("reducer.compare")):
                    comparison(self.visitor, job.result)

    def _grow(self, job: JobView) -> None:
        """Draw the points of the newest stream."""
        points = self.visitor.service.jobs.points(job.job_id)
        if not points:
            return
        stream = [point for point in points if point.stream == points[-1].stream]
        axes = _axes(stream[-1])
        if axes is None:
            return
        x, y = axes
        chosen = [point for point in stream if x in point.values and y in point.values]
        lines = [
            Line(points[-1].stream, [point.values[x] for point in chosen],
                 [point.values[y] for point in chosen], COLOURS[1], points=True)
        ]  # fmt: skip
        key = (x, y)
        if self._chart is None or self._drawn != key:
            self._drawn = key
            self._place.clear()
            with self._place:
                self._chart = Chart(self.text("reducer.live_label"), x, y, lines, tall=True)
        else:
            self._chart.show(lines)


def _axes(point: JobPoint) -> tuple[str, str] | None:
    x = next((name for name in AXES["x"] if name in point.values), "")
    y = next((name for name in AXES["y"] if name in point.values), "")
    return (x, y) if x and y else None


def reducer_page(visitor: Visitor) -> None:
    """Build the page of the reducer tests."""
    page = _ReducerPage(visitor)
    with frame(visitor, "reducer", page.refresh):
        words("p", visitor.text("reducer.explained"), "muted")
        page.build()
