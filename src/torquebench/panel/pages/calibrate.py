"""The calibration wizard: from mounting the calibrator to the certificate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import box, panel, to_the_top, words
from torquebench.panel.pages.calibrate_end import CertificateStep, SignStep
from torquebench.panel.pages.calibrate_measure import MeasureStep, PrepareStep
from torquebench.panel.pages.calibrate_models import ModelsStep
from torquebench.panel.pages.calibrate_verify import VerifyStep
from torquebench.panel.pages.course import STEPS, Course, Step, find_course
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.job_panel import JobPanel
from torquebench.panel.pages.quick import quick_buttons
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import JobView

__all__ = ["CalibratePage", "calibrate_page"]


class CalibratePage:
    """An open wizard: which step it shows, and the course it shows it of."""

    def __init__(self, visitor: Visitor) -> None:
        self.visitor, self.text = visitor, visitor.text
        self.step: Step = "prepare"
        self.course = Course()
        self._shown: tuple[Any, ...] | None = None
        self._view: Any = None
        self._reached: Step | None = None

    def build(self) -> None:
        """Make the page's elements."""
        with box("div", "stack"):
            with panel(classes="spread"):
                words("p", self.text("calibrate.quick_explained"), "muted")
                quick_buttons(self.visitor)
            self._quick = JobPanel(self.visitor)
            self._steps = box("ol", "steps", aria_label=self.text("calibrate.steps"))
            self._job = JobPanel(self.visitor)
            self._content = box("div", "stack")

    def refresh(self) -> None:
        """Follow the jobs."""
        jobs = self.visitor.service.jobs.recent()
        self.course = course = find_course(jobs, self.visitor.dismissed)
        if course.reached != self._reached:
            if self._reached is not None:
                to_the_top()
            self._reached = course.reached
            self.step = course.reached
        known = (self.step, course.reached, _state(course))
        if known != self._shown:
            self._shown = known
            self._render()
        quick = next((job for job in jobs if job.kind in ("zero", "check")), None)
        newest = jobs[0] if jobs else None
        self._quick.refresh(quick if quick is not None and quick == newest else None)
        self._job.refresh(self._job_of_step())
        if self._view is not None:
            self._view.refresh()

    def _job_of_step(self) -> Any:
        course = self.course
        by_step: Mapping[Step, Any] = {
            "prepare": None,
            "measure": course.calibrate,
            "models": _unfinished((*course.fits[:1], course.compare)),
            "verify": course.verify,
            "sign": None,
            "certificate": _unfinished((course.certificate,)),
        }
        return by_step[self.step]

    def show(self, step: Step) -> None:
        """Go to a step."""
        self.step = step
        self.refresh()

    def again(self) -> None:
        """Put this calibration aside and begin another one."""
        if self.course.calibrate is not None:
            self.visitor.dismissed.job_ids.add(self.course.calibrate.job_id)
        self.step = "prepare"
        self.refresh()

    def start(self, kind: str, request: Mapping[str, Any]) -> bool:
        """Start a job of the course."""
        visitor = self.visitor
        started = visitor.attempt(lambda: visitor.service.jobs.start(visitor.actor, kind, request))
        self.refresh()
        return started

    def _render(self) -> None:
        text = self.text
        self._steps.clear()
        reached = max(STEPS.index(self.course.reached), STEPS.index(self.step))
        with self._steps:
            for place, step in enumerate(STEPS):
                done = "done" if place < reached else ""
                current = "step" if step == self.step else None
                with box("li", done, aria_current=current):
                    words("span", text(f"calibrate.step_{step}"))
        self._content.clear()
        views = {
            "prepare": PrepareStep,
            "measure": MeasureStep,
            "models": ModelsStep,
            "verify": VerifyStep,
            "sign": SignStep,
            "certificate": CertificateStep,
        }
        with self._content:
            self._view = views[self.step](self)
            self._view.build()
            self._navigation()

    def _navigation(self) -> None:
        """Go back to what is over and forward to what is possible."""
        place, calibrated = STEPS.index(self.step), self.course.calibration_id is not None
        with box("div", "spread"):
            with box("div", "line"):
                if place > 1:
                    button(self.text("calibrate.back"), lambda: self.show(STEPS[place - 1]),
                           picture="arrow_back")  # fmt: skip
                if self.course.calibrate is not None and not self.course.calibrate.open:
                    button(self.text("calibrate.again"), self.again, "quiet", picture="restart_alt")
            if calibrated and place + 1 < len(STEPS):
                kind = "primary" if self._next_is_due() else ""
                button(self.text("calibrate.next"), lambda: self.show(STEPS[place + 1]), kind,
                       picture="arrow_forward")  # fmt: skip

    def _next_is_due(self) -> bool:
        course = self.course
        if self.step == "models":
            return course.compare is not None and not course.compare.open
        if self.step == "verify":
            return course.verify is not None and course.verify.result is not None
        return True


def _unfinished(jobs: Sequence[JobView | None]) -> JobView | None:
    """Return the first job whose panel says something that the page doesn't."""
    return next((job for job in jobs if job is not None and job.result is None), None)


def _state(course: Course) -> tuple[Any, ...]:
    jobs = (course.calibrate, course.compare, *course.fits, course.verify, course.certificate)
    return tuple((job.job_id, job.open, job.state) for job in jobs if job is not None)


def calibrate_page(visitor: Visitor) -> None:
    """Build the wizard's page."""
    page = CalibratePage(visitor)
    with frame(visitor, "calibrate", page.refresh):
        page.build()
