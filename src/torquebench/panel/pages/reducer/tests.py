"""The page of reducer tests: choice, preview, progress, verdict, comparison of specimens."""

from __future__ import annotations

from typing import Any

from torquebench.campaign.reducers.catalogue import TESTS
from torquebench.operations import Operation, find_operation
from torquebench.operations.reducers import STANDARD_TITLE, ReducerTestResult
from torquebench.panel.components.charts import COLOURS, Chart, Line
from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import box, empty, panel, refilled, words
from torquebench.panel.components.page_view import show_page
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.jobs.panel import JobPanel
from torquebench.panel.pages.jobs.preview import Preview
from torquebench.panel.pages.operations.form import OperationForm
from torquebench.panel.pages.operations.page import begin, unsuccessful
from torquebench.panel.pages.page import page
from torquebench.panel.pages.reducer.results import comparison, test_result
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import SIGNALS, JobView

PAST_S = 600.0
POINTS = 800
STANDARD = "standard-reducer"
KINDS = ("test", STANDARD)


class _ReducerPage:
    def __init__(self, visitor: Visitor) -> None:
        self.visitor, self.text = visitor, visitor.text
        self._shown: tuple[Any, ...] | None = None
        self._drawn = ""
        self._began: float | None = None
        self._stage = ""

    def build(self) -> None:
        with box("div", "stack"):
            self._panel = JobPanel(self.visitor)
            self._live = box("div", "stack")
            self._entry = box("div", "stack")
        text, visitor = self.text, self.visitor
        test, standard = find_operation("test"), find_operation("standard-reducer")
        with self._entry:
            with panel(text("What is tested")), box("div", "stack"):
                given = {"test": "hysteresis"} | unsuccessful(visitor, "test")
                self._form = OperationForm(visitor, test, given, on_change=self._preview)
                with box("div", "line"):
                    button(
                        text("Start test"),
                        lambda: self._begin(test, self._form),
                        "primary",
                        picture="play_arrow",
                    )
            with panel():
                self._plan = Preview(visitor, "test")
            with panel(), box("details"):
                words("summary", text(STANDARD_TITLE))
                with box("div", "stack"):
                    words(
                        "p",
                        text(
                            "A standard reducer with certified friction is driven in steps of "
                            "speed with its output free. The measured friction is compared with "
                            "the certified one."
                        ),
                        "muted",
                    )
                    form = OperationForm(visitor, standard, unsuccessful(visitor, STANDARD))
                    with box("div", "line"):
                        button(
                            text("Start measurement"),
                            lambda: self._begin(standard, form),
                            picture="play_arrow",
                        )
        self._preview()

    def _preview(self) -> None:
        if self._form.check():
            self._plan.show(self._form.request())

    async def _begin(self, operation: Operation, form: OperationForm) -> None:
        await begin(self.visitor, operation, form)
        self.refresh()

    def refresh(self) -> None:
        jobs = self.visitor.service.jobs.recent()
        job = next((job for job in jobs if job.kind in KINDS), None)
        self._panel.refresh(job)
        known = None if job is None else (job.job_id, job.open)
        if known != self._shown:
            self._shown, self._began = known, None
            self._entry.set_visibility(job is None or not job.open)
            self._show(job)
        if job is not None and job.open:
            self._grow(job)

    def _show(self, job: JobView | None) -> None:
        text = self.text
        self._chart: Chart | None = None
        with refilled(self._live):
            if job is None:
                return
            if job.open:
                with panel(text("Live points")):
                    self._place = box("div")
                    with self._place:
                        empty(text("No point yet."), "hourglass_empty")
            elif isinstance(job.result, ReducerTestResult):
                test_result(self.visitor, job.result)
                with panel(text("Compared with earlier specimens")):
                    comparison(self.visitor, job.result)
            elif job.result is not None:
                show_page(text, job.result.page())

    def _grow(self, job: JobView) -> None:
        """Draw the readings since this part of the test began, at most the last ten minutes."""
        live = self.visitor.service.live
        if self._began is None or self._stage != job.stage:
            self._stage, self._began = job.stage, live.bench_time_s
        part = self._runs_of(job)
        x, y = (self._read(name) for name in TESTS[part].axes)
        past = live.trend(min(PAST_S, live.bench_time_s - self._began), (x, y), POINTS)
        names = {signal.name: f"{self.text(signal.title)}, {signal.unit}" for signal in SIGNALS}
        title = self.text(TESTS[part].title)
        lines = [Line(title, past.values[x].tolist(), past.values[y].tolist(), COLOURS[0])]
        if self._chart is None or self._drawn != part:
            self._drawn = part
            with refilled(self._place):
                label = self.text("Points of the test so far.")
                self._chart = Chart(label, names[x], names[y], lines, tall=True)
        else:
            self._chart.show(lines)

    def _read(self, signal: str) -> str:
        """Return the compensated torque's signal, or the raw torque's without compensation."""
        for side, snapshot in self.visitor.service.snapshot().sides.items():
            if signal == f"{side}_torque_nm" and snapshot.compensation is None:
                return f"{side}_raw_nm"
        return signal

    @staticmethod
    def _runs_of(job: JobView) -> str:
        """Return the running part of a test."""
        if job.kind == STANDARD:
            return "no-load"
        asked = str(job.request["test"])
        parts = [test.name for test in TESTS.values() if test.title == job.stage]
        return asked if asked in TESTS and asked != "full" else next(iter(parts), "hysteresis")


@page("reducer", "/reducer", "Reducer tests", picture="settings_suggest", place=3)
def reducer_page(visitor: Visitor) -> None:
    """Build the page of the reducer tests."""
    page = _ReducerPage(visitor)
    with frame(visitor, "reducer", page.refresh):
        words(
            "p",
            visitor.text(
                "Quantities of a reducer, with uncertainty and a verdict against its data sheet."
            ),
            "muted",
        )
        page.build()
