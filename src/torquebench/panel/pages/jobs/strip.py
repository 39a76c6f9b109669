"""The running job at the bottom of every page, and messages with results of the user's jobs."""

from __future__ import annotations

from typing import Any

from torquebench.panel.components.elements import box, words
from torquebench.panel.components.verdicts import verdict_kind
from torquebench.panel.pages.jobs.panel import JobControls, JobProgress, stage_words
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import EndedJob, JobView
from torquebench.panel.text import JOB_STATES


class _Row:
    """An open job in the strip."""

    def __init__(self, visitor: Visitor) -> None:
        self._text = visitor.text
        self._shown: tuple[Any, ...] = ()
        with box("div", "row") as self.frame:
            with box("div", "what"):
                self._title = words("strong", "")
                self._stage = words("div", "", "small number")
                self._progress = JobProgress(visitor.text)
            self._controls = JobControls(visitor)

    def refresh(self, job: JobView) -> None:
        """Show the job's present state."""
        text = self._text
        shown = (job.job_id, job.state, job.stage, job.done, job.total, job.detail)
        if shown == self._shown:
            return
        self._shown = shown
        state = text(JOB_STATES[job.state])
        self._title.set_text(f"{text(job.title)}: {state}")
        self._stage.set_text(stage_words(text, job))
        self._progress.refresh(job)
        self._controls.refresh(job)


class JobStrip:
    """Shows the open jobs that the page itself doesn't show; refreshed after the page."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._rows: dict[str, _Row] = {}
        self._told: set[str] = set()
        self._ended = -1
        self._frame = box("aside", "job-strip", aria_label=visitor.text("Work under way"))
        self._frame.set_visibility(False)

    def refresh(self) -> None:
        """Update the strip to the present jobs."""
        jobs = self._visitor.service.jobs
        current = jobs.current
        self._follow([*jobs.beside, *([] if current is None else [current])])
        # The server keeps a page for some seconds after it was left, and nobody reads its messages.
        if jobs.ended != self._ended and self._frame.client.has_socket_connection:
            self._ended = jobs.ended
            self._tell()

    def _follow(self, jobs: list[JobView]) -> None:
        shown = {job.job_id: job for job in jobs if job.job_id not in self._visitor.shown_jobs}
        for number in [*self._rows]:
            if number not in shown:
                self._rows.pop(number).frame.delete()
        for number, job in shown.items():
            if number not in self._rows:
                with self._frame:
                    self._rows[number] = _Row(self._visitor)
            self._rows[number].refresh(job)
        self._frame.set_visibility(bool(shown))

    def _tell(self) -> None:
        """Show results of the user's jobs until they are dismissed."""
        visitor, log = self._visitor, self._visitor.service.jobs.log
        reader = visitor.looker
        if reader.kind != "person":
            return
        for job in log.untold(reader.name):
            if job.job_id in self._told:
                continue
            self._told.add(job.job_id)
            if job.job_id in visitor.shown_jobs:  # the page itself shows the result
                log.told(job.job_id)
                continue
            self._say(job)

    def _say(self, job: EndedJob) -> None:
        text, log = self._text, self._visitor.service.jobs.log
        title = text(job.title)
        said = text("{title}: {state}", title=title, state=text(JOB_STATES[job.state]))
        more = text(job.headline)
        if job.state == "interrupted":
            more = text(
                "The server ended in the meantime. Measured points are kept; the page "
                "Records and the wizard offer to resume."
            )
        kind = (verdict_kind(job.verdict) or "good") if job.state == "done" else "bad"
        self._visitor.messages.tell(said, kind, more, lambda: log.told(job.job_id))
