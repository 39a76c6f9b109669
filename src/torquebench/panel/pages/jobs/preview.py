"""A job's preview: steps, duration and limits, rehearsed on another thread."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nicegui import background_tasks

from torquebench.errors import TorquebenchError
from torquebench.operations import Preview as Plan
from torquebench.panel.components.charts import Chart, Line
from torquebench.panel.components.elements import box, in_thread, note, refilled, words
from torquebench.panel.components.page_view import show_blocks
from torquebench.panel.pages.jobs.panel import problem_note
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.text import Text
from torquebench.reports.page import Facts


class Preview:
    """Area for the preview of one operation.

    Rehearsing a full reducer test takes about a second, so it runs on another thread without
    delaying other people's pages. Only the last of several requests is shown.

    Parameters
    ----------
    visitor : Visitor
    kind : str
    """

    def __init__(self, visitor: Visitor, kind: str) -> None:
        self._visitor, self._kind = visitor, kind
        self._asked = 0
        self.place = box("div", "stack preview")
        with self.place:
            words("p", visitor.text("Rehearsing the steps …"), "muted")

    def show(self, request: Mapping[str, Any]) -> None:
        """Rehearse a request and show what would happen."""
        self._asked += 1
        self.place.props["aria-busy"] = "true"
        background_tasks.create(self._rehearsed(self._asked, request), name="preview")

    async def _rehearsed(self, asked: int, request: Mapping[str, Any]) -> None:
        text, problem = self._visitor.text, None
        try:
            preview = await in_thread(self._visitor.service.jobs.preview, self._kind, request)
        except TorquebenchError as error:
            preview, problem = None, error
        if asked != self._asked or self.place.is_deleted:
            return  # there is a newer request, or the page was left
        self.place.props["aria-busy"] = "false"
        with refilled(self.place):
            words("h2", text("Dry run"))
            if problem is not None:
                problem_note(text, problem, "warn")
            elif preview is not None:
                _show(text, preview)


def _show(text: Text, preview: Plan) -> None:
    """Show the preview of an operation: doubts, facts and steps, and the commanded torque."""
    for doubt in preview.doubts:
        note(text(doubt), "warn")
    page = preview.page()
    for section in page.sections:
        facts, *steps = section.blocks
        show_blocks(text, [facts])
        for remark in preview.remarks:
            words("p", text(remark), "small muted")
        steps = [each for each in steps if not isinstance(each, Facts)]  # the remarks again
        if preview.time_s:
            time, target = _steps(preview.time_s, preview.nominal_nm)
            Chart(
                text("Torque over time, as planned."),
                text("time, s"),
                text("torque, N·m"),
                [Line(text("planned torque"), time, target, "--series-3")],
            )
        if preview.parts:
            show_blocks(text, steps)
        elif steps:
            with box("details"):
                words("summary", text("Steps"))
                show_blocks(text, steps)


def _steps(time: tuple[float, ...], target: tuple[float, ...]) -> tuple[list[float], list[float]]:
    """Draw the steps of the loading sequence as a staircase."""
    x: list[float] = []
    y: list[float] = []
    before = 0.0
    for moment, value in zip(time, target, strict=True):
        x += [moment, moment]
        y += [before, value]
        before = value
    return x, y
