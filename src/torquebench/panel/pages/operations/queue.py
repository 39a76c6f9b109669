"""The queue on the page of operations: order, start, pause; and the history of operations."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from nicegui import ui

from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import (
    box,
    headings,
    icon,
    note,
    panel,
    refilled,
    table,
    words,
)
from torquebench.panel.pages.operations.form import BenchClear
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import QueueItem, QueueView
from torquebench.panel.text import JOB_STATES

SHOWN = 20
"""Number of operations listed in the history."""


class QueuePanel:
    """Shows the queue, and lets the holder of the command lease change it."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text, self._queue = visitor, visitor.text, visitor.service.queue
        self._shown: tuple[QueueView, int] | None = None

    def build(self) -> None:
        """Make the panel's elements."""
        with panel(self._text("Queue")), box("div", "stack"):
            self._state = box("div", "stack")
            self._clear = BenchClear(self._visitor)
            self._items = box("div")
            with box("details"):
                words("summary", self._text("History"))
                self._history = box("div")

    def refresh(self) -> None:
        """Show the queue's present state if it has changed."""
        view, ended = self._queue.view(), self._visitor.service.jobs.ended
        if (view, ended) == self._shown:
            return
        self._shown = view, ended
        with refilled(self._state):
            self._show_state(view)
        with refilled(self._items):
            if view.items:
                with box("ol", "stack operations"):
                    waiting = [each for each in view.items if each.state == "waiting"]
                    for item in view.items:
                        self._show_item(item, waiting)
            else:
                words("p", self._text("Nothing waits. Every operation can be added."), "muted")
        with refilled(self._history):
            self._show_history()

    def _show_state(self, view: QueueView) -> None:
        text = self._text
        if view.reason:
            note(text.sentence(view.reason), "warn", title=text("The queue has stopped"))
        with box("div", "line"):
            if view.running:
                button(text("Begin no further"), self._pause, picture="pause")
                icon("autorenew")
                words("span", text(view.started_by), "muted")
            elif view.items:
                button(text("Start the queue"), self._start, "primary", picture="play_arrow")

    def _show_item(self, item: QueueItem, waiting: list[QueueItem]) -> None:
        text = self._text
        with box("li"), box("div", "spread"):
            with box("div"):
                words("div", text(item.title))
                words("div", f"{text(item.state)} · {item.added_by}", "small muted")
            if item not in waiting:
                return
            place = waiting.index(item)
            with box("div", "line"):
                for words_, picture, to, last in (
                    ("Move up", "arrow_upward", place - 1, place == 0),
                    ("Move down", "arrow_downward", place + 1, place == len(waiting) - 1),
                ):
                    move = partial(self._change, self._queue.move, item.number, to)
                    button(text(words_), move, "quiet small", picture=picture, disabled=last)
                remove = partial(self._change, self._queue.remove, item.number)
                button(text("Remove"), remove, "quiet small", picture="close")

    def _show_history(self) -> None:
        """List the last operations, from the queue or not; each opens its result."""
        text, jobs = self._text, self._visitor.service.jobs.log.newest(SHOWN)
        rows = [
            (
                each.started,
                text(each.title),
                text.verdict(each.verdict) or text(JOB_STATES[each.state]),
                text(each.headline),
            )
            for each in jobs
        ]
        columns = headings(text, "Started", "Operation", "State", "Result")
        table(
            text("History"),
            columns,
            rows,
            on_row=lambda row: ui.navigate.to(f"/jobs/{jobs[row].job_id}"),
            open_label=text("Open"),
        )

    def _change(self, action: Callable[..., None], *arguments: int) -> None:
        self._visitor.act(action, *arguments)
        self.refresh()

    def _start(self) -> None:
        self._visitor.act(self._queue.start, bench_clear=self._clear.confirmed)
        self.refresh()

    def _pause(self) -> None:
        self._visitor.act(self._queue.pause)
        self.refresh()
