"""The open wizard of a calibration: its present step and the navigation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from nicegui import ui

from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import box, panel, refilled, to_the_top, words
from torquebench.panel.pages.calibrate.workflow import (
    STEPS,
    CalibrationWorkflow,
    Step,
    find_workflow,
)
from torquebench.panel.pages.jobs.panel import JobPanel
from torquebench.panel.pages.quick import quick_buttons
from torquebench.panel.pages.view import part
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import JobView

__all__ = ["CalibratePage", "StepView"]


class StepView:
    """One step of the wizard on the screen."""

    def __init__(self, page: CalibratePage) -> None:
        self._page, self._text = page, page.text

    def build(self) -> None:
        """Make the step's elements."""

    def refresh(self) -> None:
        """Follow the jobs, where something of the step grows with them."""


class CalibratePage:
    """An open wizard: which step it shows, and the workflow it shows it of."""

    def __init__(
        self,
        visitor: Visitor,
        views: Mapping[Step, type[StepView]],
        asked: str = "",
    ) -> None:
        self.visitor, self.text, self._views = visitor, visitor.text, views
        self._asked = asked
        self.step: Step = "prepare"
        self.workflow = CalibrationWorkflow()
        self._shown: tuple[Any, ...] | None = None
        self._view: StepView | None = None
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
        self.workflow = workflow = find_workflow(jobs, self.visitor.dismissed)
        if workflow.reached != self._reached:
            if self._reached is not None:
                to_the_top()
            self._reached = workflow.reached
            self.step = self._first_step(workflow.reached)
        known = (self.step, workflow.reached, _state(workflow))
        if known != self._shown:
            self._shown = known
            self._render()
        quick = next((job for job in jobs if job.kind in ("zero", "check")), None)
        newest = jobs[0] if jobs else None
        self._quick.refresh(quick if quick is not None and quick == newest else None)
        self._job.refresh(self._job_of_step())
        if self._view is not None:
            self._view.refresh()

    def _first_step(self, reached: Step) -> Step:
        """Return the step of the page's address on the first call, later the furthest one."""
        asked, self._asked = self._asked, ""
        step = next((step for step in STEPS if step == asked), reached)
        return step if STEPS.index(step) <= STEPS.index(reached) + 1 else reached

    def _job_of_step(self) -> Any:
        workflow = self.workflow
        by_step: Mapping[Step, Any] = {
            "prepare": None,
            "measure": workflow.calibrate,
            "models": _unfinished((*workflow.fits[:1], workflow.compare)),
            "verify": workflow.verify,
            "sign": None,
            "certificate": _unfinished((workflow.certificate,)),
        }
        return by_step[self.step]

    def show(self, step: Step) -> None:
        """Go to a step; the browser's own "back" then leads to the one before."""
        if step != self.step:
            ui.navigate.history.replace(f"/calibrate?step={self.step}")
            ui.navigate.history.push(f"/calibrate?step={step}")
        self.step = step
        self.refresh()

    def again(self) -> None:
        """Put this calibration aside and begin another one."""
        if not self.visitor.act(self.visitor.service.jobs.command):
            return  # the wizard is shared by all users
        if self.workflow.calibrate is not None:
            self.visitor.dismissed.job_ids.add(self.workflow.calibrate.job_id)
        self.step = "prepare"
        self.refresh()

    def start(self, kind: str, request: Mapping[str, Any]) -> bool:
        """Start a job of the workflow."""
        started = self.visitor.start(kind, request)
        self.refresh()
        return started

    def _render(self) -> None:
        text = self.text
        reached = max(STEPS.index(self.workflow.reached), STEPS.index(self.step))
        with refilled(self._steps):
            for place, step in enumerate(STEPS):
                passed = place < reached and self.workflow.done(step, signed=self._signed())
                done = "done" if passed else ""
                current = "step" if step == self.step else None
                with box("li", done, aria_current=current):
                    words("span", text(f"calibrate.step_{step}"))
        with refilled(self._content):
            self._view = self._views[self.step](self)
            with part(text):
                self._view.build()
            self._navigation()

    def _navigation(self) -> None:
        """Navigate back to finished steps and forward to available ones."""
        place, calibrated = STEPS.index(self.step), self.workflow.calibration_id is not None
        with box("div", "spread"):
            with box("div", "line"):
                if place > 1 or (place == 1 and not self._measuring()):
                    button(self.text("calibrate.back"), lambda: self.show(STEPS[place - 1]),
                           picture="arrow_back")  # fmt: skip
                if self.workflow.calibrate is not None and not self.workflow.calibrate.open:
                    button(self.text("calibrate.again"), self.again, "quiet", picture="restart_alt")
            if calibrated and place + 1 < len(STEPS):
                kind = "primary" if self._next_is_due() else ""
                button(self.text("calibrate.next"), lambda: self.show(STEPS[place + 1]), kind,
                       picture="arrow_forward")  # fmt: skip

    def _signed(self) -> bool:
        number = self.workflow.calibration_id
        if number is None:
            return False
        reviews = self.visitor.service.station.registry.reviews("calibrations", number)
        return any(
            review.accepted and review.signature is not None and review.signature.signed
            for review in reviews
        )

    def _measuring(self) -> bool:
        calibrate = self.workflow.calibrate
        return calibrate is not None and calibrate.open

    def _next_is_due(self) -> bool:
        workflow = self.workflow
        if self.step == "models":
            return workflow.compare is not None and not workflow.compare.open
        if self.step == "verify":
            return workflow.verify is not None and workflow.verify.result is not None
        return self.step != "sign"  # signing leads there by itself


def _unfinished(jobs: Sequence[JobView | None]) -> JobView | None:
    """Return the first job without a result."""
    return next((job for job in jobs if job is not None and job.result is None), None)


def _state(workflow: CalibrationWorkflow) -> tuple[Any, ...]:
    jobs = (
        workflow.calibrate,
        workflow.compare,
        *workflow.fits,
        workflow.verify,
        workflow.certificate,
    )
    return tuple((job.job_id, job.open, job.state) for job in jobs if job is not None)
