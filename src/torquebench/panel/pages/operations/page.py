"""The list of all operations, and the page of one operation: form, preview, result."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial
from typing import Any

from nicegui import ui

from torquebench.errors import TorquebenchError
from torquebench.operations import OPERATIONS, Operation, find_operation
from torquebench.panel.components.controls import Field, button
from torquebench.panel.components.dialogs import foot, sheet
from torquebench.panel.components.elements import box, empty, note, panel, refilled, words
from torquebench.panel.components.page_view import remarks, show_page
from torquebench.panel.components.verdicts import verdict_kind
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.jobs.panel import JobPanel
from torquebench.panel.pages.jobs.preview import Preview
from torquebench.panel.pages.operations.files import file_buttons
from torquebench.panel.pages.operations.form import OperationForm, unquoted
from torquebench.panel.pages.operations.queue import QueuePanel
from torquebench.panel.pages.page import page
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import JobView
from torquebench.panel.text import Text

GROUPS = {
    "At the bench": ("bench",),
    "With the records": ("records", "folder"),
    "With files": ("files",),
}
"""Headings of the list, and what the operations below them need."""


def offered(visitor: Visitor, places: Collection[str]) -> list[Operation]:
    """Return the operations of some places that the person may perform on the panel."""
    return [
        each
        for each in OPERATIONS.values()
        if each.served and each.where in places and visitor.has_role(each.role)
    ]


def show_result(visitor: Visitor, result: Any) -> None:
    """Show a result: headline with verdict, warnings, description."""
    text = visitor.text
    verdict = text.verdict(result.verdict)
    note(text(result.headline), verdict_kind(result.verdict), title=verdict)
    show_description(visitor, result)


def show_description(visitor: Visitor, result: Any) -> None:
    """Show a result's warnings, files, and description."""
    remarks(visitor.text, result.remarks)
    file_buttons(visitor, result.files)
    show_page(visitor.text, result.page())


def describe(text: Text, operation: Operation) -> None:
    """Show an operation's description without its summary, which is the page's heading."""
    for paragraph in operation.paragraphs[1:]:
        if isinstance(paragraph, str):
            words("p", unquoted(text(paragraph)), "muted")
            continue
        with box("ul", "muted"):
            for item in paragraph:
                words("li", unquoted(text(item)))


class OperationPanel:
    """An operation's form, preview, job, and result.

    Parameters
    ----------
    visitor : Visitor
    operation : Operation
    given : mapping
        Initial values by parameter name.
    """

    def __init__(self, visitor: Visitor, operation: Operation, given: Mapping[str, Any]) -> None:
        self._given = given
        self._visitor, self._text, self._operation = visitor, visitor.text, operation
        self._shown: tuple[Any, ...] | None = None
        self._plan: Preview | None = None
        self._password: Field | None = None

    def build(self) -> None:
        """Make the page's elements."""
        text, operation = self._text, self._operation
        with box("div", "stack"):
            self._job = JobPanel(self._visitor)
            self._result = box("div", "stack")
            with box("div", "columns") as self._entry:
                with panel(), box("div", "stack"):
                    describe(text, operation)
                    self._form = OperationForm(
                        self._visitor,
                        operation,
                        unsuccessful(self._visitor, operation.key) | dict(self._given),
                        on_change=self._preview,
                    )
                    if operation.signed:
                        self._password = Field(text("Your password"), kind="password")
                    with box("div", "line"):
                        button(text("Start"), self._begin, "primary", picture="play_arrow")
                        if operation.trial:
                            button(text("Check first"), self._try, picture="search")
                        if not operation.signed:
                            button(text("Add to the queue"), self._add, picture="playlist_add")
                if operation.preview is not None:
                    with panel():
                        self._plan = Preview(self._visitor, operation.key)
        self._preview()

    def _preview(self) -> None:
        if self._plan is not None and self._form.check():
            self._plan.show(self._form.request())

    async def _begin(self) -> None:
        await begin(self._visitor, self._operation, self._form, self._password, self._done)
        self.refresh()

    async def _try(self) -> None:
        """Show what the operation would enter, by its trial."""
        trial = find_operation(self._operation.trial)
        if self._form.check():
            request = self._form.request()
            asked = {name: request[name] for name in trial.request.model_fields if name in request}
            visitor = self._visitor
            perform = partial(visitor.service.perform, visitor.actor, trial.name, asked)
            if (result := await visitor.attempt_aside(perform)) is not None:
                self._done(result)

    def _add(self) -> None:
        if self._form.check():
            self._visitor.act(
                self._visitor.service.queue.add,
                self._operation.name,
                self._form.request(),
                success=self._text("It waits in the queue, on the page of operations."),
            )

    def _done(self, result: Any) -> None:
        if result is not None:  # a job shows its own when it has ended
            with refilled(self._result):
                show_result(self._visitor, result)

    def refresh(self) -> None:
        """Show the newest job of this operation."""
        if self._operation.quick:
            return
        jobs = self._visitor.service.jobs.recent()
        job = next((each for each in jobs if each.kind == self._operation.key), None)
        self._job.refresh(job)
        shown = None if job is None else (job.job_id, job.open)
        if shown != self._shown:
            self._shown = shown
            self._show(job)

    def _show(self, job: JobView | None) -> None:
        self._entry.set_visibility(job is None or not job.open)
        with refilled(self._result):
            if job is not None and job.result is not None:
                show_description(self._visitor, job.result)


def unsuccessful(visitor: Visitor, kind: str) -> dict[str, Any]:
    """Return the newest request for an operation if nothing came of it: a form begins with it."""
    jobs = visitor.service.jobs.recent()
    job = next((each for each in jobs if each.kind == kind), None)
    return {} if job is None or job.open or job.result is not None else dict(job.request)


async def begin(
    visitor: Visitor,
    operation: Operation,
    form: OperationForm,
    password: Field | None = None,
    then: Any = lambda _result: None,
) -> bool:
    """Start or perform the operation of a form, or show the errors at its fields."""
    if not form.check():
        return False
    beside: dict[str, Any] = {} if password is None else {"password": password.value}
    service, request = visitor.service, form.request()
    if password is not None:
        password.set("")
    if form.clear is not None and not operation.quick:
        beside["bench_clear"] = form.clear.confirmed
    actor, act = visitor.actor, service.perform if operation.quick else service.start
    # Beside the event loop: checking a password and writing records takes seconds.
    done = await visitor.attempt_aside(partial(act, actor, operation.name, request, **beside))
    if done is not None:
        then(done if operation.quick else None)
    return done is not None


def operation_dialog(visitor: Visitor, name: str, given: Any = None, hidden: Any = ()) -> None:
    """Open a dialog with the form of an operation."""
    operation, text = find_operation(name), visitor.text
    password: Field | None = None

    async def start() -> None:
        await begin(visitor, operation, form, password, lambda _: dialog.close())

    with ui.context.client.content, sheet(text(operation.summary)) as dialog:
        form = OperationForm(visitor, operation, given, hidden)
        if operation.signed:
            password = Field(text("Your password"), kind="password")
        with foot(text, dialog):
            button(text("Start"), start, "primary", picture="play_arrow")


def operation_buttons(visitor: Visitor) -> None:
    """Add the buttons for zeroing and the daily check, which open a dialog."""
    text = visitor.text
    with box("div", "line"):
        button(text("Zeroing"), lambda: operation_dialog(visitor, "zero"), picture="exposure_zero")
        button(
            text("Daily check"), lambda: operation_dialog(visitor, "check"), picture="fact_check"
        )


@page("operations", "/operations", "Operations", picture="playlist_play", place=7)
def operations_page(visitor: Visitor) -> None:
    """Build the list of all operations."""
    text = visitor.text
    queue = QueuePanel(visitor)
    with frame(visitor, "operations", queue.refresh), box("div", "stack"):
        queue.build()
        with box("div", "columns narrow"):
            for title, places in GROUPS.items():
                with panel(text(title)), box("ul", "stack operations"):
                    for operation in offered(visitor, places):
                        with box("li"):
                            said = unquoted(text(operation.summary))
                            words("a", said, href=f"/operations/{operation.key}")
                            words("div", operation.name, "small muted")


@page("operation", "/operations/{key}")
def operation_page(visitor: Visitor) -> None:
    """Build the page of one operation."""
    text = visitor.text
    try:
        operation = find_operation(visitor.query["key"])
    except TorquebenchError as error:
        with frame(visitor, "operations"):
            empty(text(error.found), "search_off")
        return
    given = {name: value for name, value in visitor.query.items() if name != "key"}
    shown = OperationPanel(visitor, operation, given)
    with frame(visitor, "operations", shown.refresh, unquoted(text(operation.summary))):
        if not visitor.has_role(operation.role):
            visitor.not_allowed()
            return
        shown.build()
