"""Panel of the running job: progress, question to the operator, pause and abort."""

from __future__ import annotations

from typing import Any

from torquebench.errors import TorquebenchError
from torquebench.operations import duration_words
from torquebench.panel.components.controls import button
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import box, note, panel, refilled, tag, words
from torquebench.panel.components.verdicts import verdict_kind
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import JobView, Problem
from torquebench.panel.text import JOB_STATES, Text

STATES = {
    "running": ("", "play_circle"),
    "pausing": ("warn", "pause_circle"),
    "paused": ("warn", "pause_circle"),
    "aborting": ("bad", "cancel"),
    "done": ("good", "check_circle"),
    "failed": ("bad", "error"),
    "aborted": ("bad", "cancel"),
    "interrupted": ("bad", "error"),
}


def problem_note(
    text: Text, problem: Problem | TorquebenchError, kind: str = "bad", *, title: str = ""
) -> None:
    """Show the reason of a refusal or failure, and the remedy."""
    found, more = text.refusal(problem)
    with note(found, kind, title=title, live=True):
        if more:
            words("p", more, "small")


def stage_words(text: Text, job: JobView) -> str:
    """Return the text of a job's progress."""
    stage = text(job.stage)
    if stage and job.total:
        stage = text("{stage}: step {done} of {total}", stage=stage, done=job.done, total=job.total)
    left = job.remaining_s
    remaining = "" if left is None else text("about {time} left", time=duration_words(left))
    said = (part for part in (stage, text(job.detail), remaining) if part)
    return " · ".join(said) if job.open else ""


class JobProgress:
    """The bar of a job's progress.

    Parameters
    ----------
    text : Text
    """

    def __init__(self, text: Text) -> None:
        self._bar = box("progress", max="1", aria_label=text("Progress of the work"))

    def refresh(self, job: JobView) -> None:
        """Show the finished share of the stage, or just activity if the total is unknown."""
        self._bar.set_visibility(job.open)
        if job.total:
            self._bar.props["value"] = f"{job.done / job.total:.3f}"
        else:
            self._bar.props.pop("value", None)
        self._bar.update()


class JobControls:
    """The buttons that pause, finish and abort a job, for whoever may press them.

    For a job of the bench that is the holder of the command lease, for a recording any operator.
    """

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._shown: tuple[Any, ...] = ()
        self._frame = box("div", "line")

    def refresh(self, job: JobView) -> None:
        """Update the buttons to the possible actions."""
        may = self._visitor.has_role("operator") if job.beside else self._visitor.commands
        shown = (job.job_id, job.state, job.can_finish, may)
        if shown == self._shown:
            return
        self._shown = shown
        text, number = self._text, job.job_id
        self._frame.clear()
        if not (job.open and may):
            return
        explained = text(
            "The recording ends and is kept as aborted. The bench isn't affected."
            if job.beside
            else "The torque goes to zero and the record is closed as aborted. Points taken "
            "so far are kept."
        )
        with self._frame:
            if job.can_pause and job.state == "running":
                button(text("Pause"), lambda: self._ask("pause", number), picture="pause")
            if job.state in ("paused", "pausing"):
                button(
                    text("Go on"),
                    lambda: self._ask("resume", number),
                    "primary",
                    picture="play_arrow",
                )
            if job.can_finish and job.state == "running":
                button(
                    text("Finish"),
                    lambda: self._ask("finish", number),
                    "primary",
                    picture="stop_circle",
                )
            if job.state != "aborting":
                button(
                    text("Abort"),
                    lambda: self._abort(number, explained),
                    "danger",
                    picture="close",
                )

    def _ask(self, what: str, number: str) -> None:
        self._visitor.act(getattr(self._visitor.service.jobs, what), number)

    def _abort(self, number: str, explained: str) -> None:
        visitor, text = self._visitor, self._text

        def abort(_: str) -> bool:
            return visitor.act(visitor.service.jobs.abort, number)

        ask(text, text("Abort"), explained, abort, danger=True)


class JobPanel:
    """One job; refreshed twice a second by the page that shows it.

    Parameters
    ----------
    visitor : Visitor
    """

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._job_id = ""
        self._shown: tuple[Any, ...] = ()
        self._parts: tuple[Any, ...] = ()
        with panel() as self.frame, box("div", "stack"):
            with box("div", "spread"):
                self._head = box("div", "line")
                self._controls = JobControls(visitor)
            with box("div", "said", role="status"):
                self._stage = words("div", "")
            self._progress = JobProgress(self._text)
            self._prompt = box("div")
            self._stages = box("ul", "small muted")
            self._end = box("div")
        self.frame.set_visibility(False)

    def refresh(self, job: JobView | None) -> None:
        """Show the job's present state; None hides the panel."""
        self.frame.set_visibility(job is not None)
        self._visitor.shown_jobs.discard(self._job_id)
        if job is None:
            self._shown = self._parts = ()
            self._job_id = ""
            return
        self._job_id = job.job_id
        self._visitor.shown_jobs.add(job.job_id)
        self._controls.refresh(job)
        prompt = self._visitor.service.jobs.prompt if job.open else None
        parts = (job.job_id, job.state, self._visitor.commands, prompt)
        if parts != self._parts:
            self._parts = parts
            self._render_head(job)
            self._render_prompt(prompt)
            self._render_end(job)
        shown = (job.stage, job.done, job.total, job.detail, len(job.stages), job.open)
        if shown != self._shown:
            self._shown = shown
            self._render_progress(job)

    def _render_head(self, job: JobView) -> None:
        text = self._text
        with refilled(self._head):
            with box("h2"):
                words("a", text(job.title), href=f"/jobs/{job.job_id}")
            kind, picture = STATES[job.state]
            tag(text(JOB_STATES[job.state]), kind, picture)

    def _render_progress(self, job: JobView) -> None:
        text = self._text
        self._stage.set_text(stage_words(text, job))
        self._progress.refresh(job)
        with refilled(self._stages):
            for stage in job.stages:
                said = f"{text(stage.title)} ({duration_words(stage.seconds)})"
                detail = text(stage.detail)
                words("li", f"{said}: {detail}" if detail else said)

    def _render_prompt(self, prompt: Any) -> None:
        text = self._text
        self._prompt.clear()
        if prompt is None:
            return
        with (
            self._prompt,
            note(text(prompt.text), "warn", title=text("To do at the bench"), live=True),
        ):
            if self._visitor.commands:
                with box("div", "line"):
                    button(text("Done"), lambda: self._answer(prompt.number, True),
                           "primary", picture="check")  # fmt: skip
                    button(text("Not possible"), lambda: self._answer(prompt.number, False))

    def _render_end(self, job: JobView) -> None:
        with refilled(self._end):
            if job.problem is not None:
                problem_note(self._text, job.problem, title=self._text(JOB_STATES[job.state]))
            elif job.result is not None:
                kind = verdict_kind(job.result.verdict)
                verdict = self._text.verdict(job.result.verdict)
                note(self._text(job.result.headline), kind, title=verdict)

    def _answer(self, number: int, done: bool) -> None:
        self._visitor.act(self._visitor.service.jobs.answer, number, done=done)
