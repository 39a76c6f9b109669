"""The wizard's first steps: a preview of the run, and its steps while they are measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nicegui import ui

from torquebench.bench.roles import SIDES
from torquebench.campaign.fitting import model_title
from torquebench.compensation import RECOMMENDED
from torquebench.panel.components.charts import Chart, Line, error_chart
from torquebench.panel.components.controls import Choice, Field, button
from torquebench.panel.components.elements import box, panel, refilled, tag, words
from torquebench.panel.pages.calibrate.page import CalibratePage, StepView
from torquebench.panel.pages.calibrate.resume import interrupted_note
from torquebench.panel.pages.jobs.preview import Preview
from torquebench.panel.pages.mounting_form import MountingForm
from torquebench.panel.pages.records.table_import import profile_titles
from torquebench.panel.pages.settings.editor import shown
from torquebench.units import minus_signs

__all__ = ["MeasureStep", "PrepareStep"]

FIRST_PROFILE = "rapid-in-situ"
MODELS = (RECOMMENDED, "polynomial-2", "bayesian-network", "published-network")
"""Kinds offered before a calibration; the others and the network's parameters follow after it."""
TYPING_S = 0.4
"""Longest pause between two digits of a number, s."""


class PrepareStep(StepView):
    """Choose module and profile, preview, start."""

    def __init__(self, page: CalibratePage) -> None:
        super().__init__(page)
        self._checked: tuple[Any, ...] = ()
        self._waiting: ui.timer | None = None

    def build(self) -> None:
        """Make the step's elements."""
        text, visitor = self._text, self._page.visitor
        interrupted_note(visitor)
        job = self._page.workflow.calibrate
        before: Mapping[str, Any] = {} if job is None else job.request
        with box("div", "columns"):
            with panel(text("prepare.what")), box("div", "stack"):
                ranges = visitor.service.snapshot().sides
                sides: dict[str, tuple[str, str]] = {
                    side: (text(f"side.{side}"), f"±{ranges[side].range_nm:g} N·m")
                    for side in reversed(SIDES)
                }
                self._side = Choice(
                    text("prepare.side"),
                    sides,
                    before.get("side", "output"),
                    on_change=self._preview,
                )
                profiles = profile_titles(visitor)
                profile = before.get("profile", FIRST_PROFILE)
                self._profile = Field(
                    text("prepare.profile"),
                    profile if profile in profiles else FIRST_PROFILE,
                    options=profiles,
                    on_change=lambda _: self._preview(),
                )
                with box("p", "small"):
                    words("a", text("prepare.own_profiles"), href="/settings?part=profiles")
                step = {"": text("prepare.as_profile"), "5": "5 %", "10": "10 %", "20": "20 %"}
                self._step = Field(
                    text("prepare.step"),
                    _as_before(before.get("step_percent"), step),
                    options=step,
                    on_change=lambda _: self._preview(),
                )
                self._up_to = Field(
                    text("prepare.up_to"),
                    shown(before.get("up_to_nm")),
                    kind="number",
                    unit="N·m",
                    hint=text("prepare.up_to_hint"),
                    on_change=lambda _: self._preview_soon(),
                    min="0",
                    step="any",
                )
                repeats = {"": text("prepare.as_profile"), "1": "1", "2": "2", "3": "3", "10": "10"}
                self._repeats = Field(
                    text("prepare.repeats"),
                    _as_before(before.get("repeats"), repeats),
                    options=repeats,
                    on_change=lambda _: self._preview(),
                )
                rising = {"": text("prepare.as_profile"), "rising": text("prepare.rising_only")}
                self._rising = Field(
                    text("prepare.branches"),
                    "rising" if before.get("rising_only") else "",
                    options=rising,
                    on_change=lambda _: self._preview(),
                )
                kinds = {name: text.core(model_title(name)) for name in MODELS}
                fitted = tuple(name for name in before.get("models") or () if name in MODELS)
                self._models = Choice(
                    text("prepare.models"), kinds, fitted or MODELS[:2], several=True
                )
                self._mounting = MountingForm(visitor)
            with panel(text("prepare.checks")), box("div", "stack"):
                self._checks = box("ul", "stack")
                self._start = button(
                    text("prepare.start"), self._begin, "primary", picture="play_arrow"
                )
                self._plan = Preview(visitor, "calibrate")
                self._clock = box("div")
        self._preview()

    def refresh(self) -> None:
        """Check the bench again."""
        snapshot = self._page.visitor.service.snapshot()
        holder = snapshot.commanded_by
        mine = self._page.visitor.commands
        checks: tuple[tuple[bool, str], ...] = (
            (snapshot.connection == "live", "readings"),
            (not snapshot.stopped, "alarm"),
            (mine or holder is None, "command"),
            (snapshot.job_id is None, "idle"),
        )
        service = self._page.visitor.service
        if service.presence_wanted:
            checks += ((mine and service.presence_left_s > 0.0, "presence"),)
        if checks == self._checked:
            return
        self._checked = checks
        with refilled(self._checks):
            for good, key in checks:
                with box("li", "line"):
                    kind = "good" if good else "bad"
                    tag(self._text(f"prepare.{kind}"), kind, "check" if good else "close")
                    words("span", self._text(f"prepare.check_{key}"))

    def _request(self) -> dict[str, Any]:
        request: dict[str, Any] = {"side": self._side.value, "profile": self._profile.value}
        request |= self._mounting.request()
        if self._step.value:
            request["step_percent"] = float(self._step.value)
        if self._up_to.value:
            request["up_to_nm"] = float(self._up_to.value)
        if self._repeats.value:
            request["repeats"] = int(self._repeats.value)
        if self._rising.value:
            request["rising_only"] = True
        if self._models.values:
            request["models"] = [name for name in MODELS if name in self._models.values]
        return request

    def _preview_soon(self) -> None:
        """Show the preview after a pause in typing."""
        if self._waiting is not None:
            self._waiting.cancel()
        with self._clock:
            self._waiting = ui.timer(TYPING_S, self._preview, once=True)

    def _preview(self) -> None:
        self._waiting = None
        self._plan.show(self._request())

    def _begin(self) -> None:
        self._page.start("calibrate", self._request())


def _as_before(value: Any, options: Mapping[str, str]) -> str:
    """Return the option with the requested value; the first one if there is none."""
    said = "" if value is None else f"{value:g}"
    return said if said in options else ""


class MeasureStep(StepView):
    """The staircase and the growing curve of errors."""

    def __init__(self, page: CalibratePage) -> None:
        super().__init__(page)
        self._count = -1

    def build(self) -> None:
        """Make the step's elements."""
        text, job = self._text, self._page.workflow.calibrate
        if job is not None and not job.open:
            interrupted_note(self._page.visitor)
        with box("div", "columns"):
            with panel(text("measure.staircase")):
                self._staircase = Chart(
                    text("measure.staircase_label"),
                    text("measure.point"),
                    text("measure.standard_axis"),
                )
            with panel(text("measure.errors")):
                self._errors = error_chart(text, "measure.errors_label")
                self._said = words("p", "", "muted number", role="status")
                words("p", text("measure.steps"), "muted small")

    def refresh(self) -> None:
        """Draw the points measured so far."""
        job = self._page.workflow.calibrate
        if job is None or job.points == self._count:
            return
        self._count = job.points
        recorded = self._page.visitor.service.jobs.points(job.job_id)
        points = [
            point.values
            for point in recorded
            if point.stream == "points" and "error_nm" in point.values
        ]
        text = self._text
        number = list(range(1, len(points) + 1))
        standard = [point["standard_nm"] for point in points]
        self._staircase.show([Line(text("live.reference"), number, standard, "--series-3")])
        lines = []
        for branch, key, symbol in ((1, "rising", "triangle"), (-1, "falling", "circle")):
            chosen = [point for point in points if (point.get("branch", 1) >= 0) == (branch > 0)]
            lines.append(
                Line(
                    text.core(key),
                    [point["standard_nm"] for point in chosen],
                    [point["error_nm"] for point in chosen],
                    "--series-2" if branch > 0 else "--series-1",
                    points=True,
                    symbol=symbol,
                )
            )
        self._errors.show(lines)
        if points:
            last = points[-1]
            said = {
                key: minus_signs(f"{last[f'{key}_nm']:.3f}")
                for key in ("reading", "standard", "error")
            }
            self._said.set_text(text("measure.last", number=len(points), **said))
