"""The panel's log of actions, the newest first."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from torquebench.compensation import MODEL_NAMES
from torquebench.operations import OPERATIONS, Parameter, parameters
from torquebench.panel.components.controls import button, set_disabled
from torquebench.panel.components.elements import box, headings, panel, refilled, table
from torquebench.panel.pages.operations.form import choice_words
from torquebench.panel.pages.view import View
from torquebench.panel.text import JOB_STATES, Text, Texts

AT_ONCE = 50
LABELS: Texts = {
    "keys": "changed",
    "job_id": "job",
    "bench_time_s": "bench time, s",
    "side": "module",
    "off": "switched off",
    "users": "computer users",
    "waiting": "waiting operations",
    "place": "place in the queue",
}
SENTENCES = ("found", "reason", "direction", "role", "side", "summary")
"""Details that may be messages of the software, which are translated; typed text isn't."""


def details_said(text: Text, details: Mapping[str, Any]) -> str:
    """Return an event's details as text, without empty ones.

    Examples
    --------
    >>> request = {"repeats": None, "models": ["hybrid"], "mounting": {"by": ""}}
    >>> details_said(Text("en"), {"kind": "calibrate", "request": request, "accepted": True})
    'kind: calibrate; Models: physics + Gaussian process; accepted: yes'
    """
    kind = details.get("kind")
    operation = next((each for each in OPERATIONS.values() if each.key == kind), None)
    said: list[str] = []
    for key, value in details.items():
        if key == "request" and operation is not None:
            said += _asked(text, operation.request, value)
        elif not (value is None or value in ("", [])):
            label = text(LABELS.get(key, key.replace("_", " ")))
            said.append(f"{label}: {_said(text, key, value)}")
    return "; ".join(said)


def _asked(text: Text, request: type[BaseModel], given: Mapping[str, Any]) -> Iterator[str]:
    """Yield title and value of a request's fields that differ from the defaults."""
    for asked in parameters(request):
        value = given.get(asked.name)
        if asked.record is not None:
            yield from _asked(text, asked.record, value or {})
        elif not (value is None or value in ("", [], {}) or (value is False and not asked.default)):
            unit = f", {text(asked.unit)}" if asked.unit else ""
            yield f"{text(asked.title)}{unit}: {_value(text, asked, value)}"


def _value(text: Text, asked: Parameter, value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_value(text, asked, each) for each in value)
    named = value in MODEL_NAMES or value in asked.choices
    return choice_words(text, value) if named else _said(text, "", value)


def _said(text: Text, key: str, value: Any) -> str:
    if isinstance(value, bool):
        return text("yes" if value else "no")
    if isinstance(value, list):
        return ", ".join(_said(text, key, item) for item in value)
    if isinstance(value, int | float):
        return f"{value:g}" if isinstance(value, float) else str(value)
    if key == "state":
        return text(JOB_STATES.get(value, value))
    return text(value) if key in SENTENCES else str(value)


class LogView(View):
    """The view of the log, fifty events at a time, for metrologists."""

    _older: int | None = None

    def build(self) -> None:
        """Make the view's elements."""
        text = self._text
        with panel(text("Log")), box("div", "stack"):
            self._place = box("div")
            with box("div", "line"):
                button(text("Newest"), lambda: self._show(None), picture="first_page")
                self._further = button(
                    text("Older"), lambda: self._show(self._older), picture="chevron_right"
                )
        self._show(None)

    def _show(self, before: int | None) -> None:
        text = self._text
        events = self._visitor.service.log(AT_ONCE, before)
        self._older = events[-1].number if events else before
        set_disabled(self._further, len(events) < AT_ONCE)
        rows = [
            (event.at, event.who, text(event.what), details_said(text, event.details))
            for event in events
        ]
        columns = headings(text, "When", "Who", "What", "Details")
        with refilled(self._place):
            table(text("Log"), columns, rows)
