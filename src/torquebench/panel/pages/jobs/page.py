"""The page of one job: request, progress and result, also after a restart of the server."""

from __future__ import annotations

from datetime import datetime

from torquebench.errors import TorquebenchError
from torquebench.operations import find_operation, parameters
from torquebench.operations.result import stated
from torquebench.panel.components.elements import box, empty, pairs, panel, refilled, words
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.jobs.panel import JobPanel
from torquebench.panel.pages.operations.page import show_description
from torquebench.panel.pages.page import page
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import JobView


class _JobPage:
    """Shows a job: progress while it is open, then its result."""

    def __init__(self, visitor: Visitor, job: JobView) -> None:
        self._visitor, self._text, self._job = visitor, visitor.text, job

    def build(self) -> None:
        """Make the page's elements."""
        with box("div", "stack"):
            self._panel = JobPanel(self._visitor)
            self._result = box("div", "stack")
            with panel(self._text("Request")):
                self._show_request()
        self._show_result()
        self._panel.refresh(self._job)

    def refresh(self) -> None:
        """Show the progress of an open job, and its result when it has ended."""
        if self._job.open:
            self._job = self._visitor.service.jobs.get(self._job.job_id)
            self._show_result()
        self._panel.refresh(self._job)

    def _show_result(self) -> None:
        if (result := self._job.result) is None:
            return
        with refilled(self._result):
            show_description(self._visitor, result)
            with box("div", "line"):
                for run in result.run_ids:
                    words("a", run, href=f"/runs/{run}")

    def _show_request(self) -> None:
        job, text = self._job, self._text
        operation = find_operation(job.kind)
        facts: list[tuple[str, str | datetime]] = [
            (text(each.title), text(stated(job.request[each.name], each.unit)))
            for each in parameters(operation.request)
            if each.record is None and job.request.get(each.name) not in (None, "", [], {})
        ]
        times = [("started", job.started), ("ended", job.finished)]
        facts += [(text(name), when) for name, when in times if when is not None]
        pairs([*facts, (text("started by"), job.started_by)])
        words("a", text(operation.summary), href=f"/operations/{operation.key}")


@page("job", "/jobs/{job_id}")
def job_page(visitor: Visitor) -> None:
    """Build the page of a job."""
    try:
        job = visitor.service.jobs.get(visitor.query["job_id"])
    except TorquebenchError as error:
        with frame(visitor, "operations"):
            empty(visitor.text(error.found), "search_off")
        return
    shown = _JobPage(visitor, job)
    with frame(visitor, "operations", shown.refresh, visitor.text(job.title)):
        shown.build()
