"""The panel's log of actions, the newest first."""

from __future__ import annotations

from torquebench.panel.components.controls import button, set_disabled
from torquebench.panel.components.elements import box, panel, table
from torquebench.panel.pages.visitor import Visitor

__all__ = ["LogView"]

AT_ONCE = 50


class LogView:
    """Fifty events at a time; a metrologist's."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text
        self._older: int | None = None

    def build(self) -> None:
        """Make the view's elements."""
        text = self._text
        with panel(text("settings.log")), box("div", "stack"):
            self._place = box("div")
            with box("div", "line"):
                button(text("log.newest"), lambda: self._show(None), picture="first_page")
                self._further = button(
                    text("log.older"), lambda: self._show(self._older), picture="chevron_right"
                )
        self._show(None)

    def _show(self, before: int | None) -> None:
        text = self._text
        found = self._visitor.service.log(AT_ONCE, before)
        self._older = found[-1].number if found else before
        set_disabled(self._further, len(found) < AT_ONCE)
        rows = [
            (
                event.at,
                event.who,
                text.core(event.what),
                ", ".join(f"{key}: {value}" for key, value in event.details.items()),
            )
            for event in found
        ]
        columns = [(text(f"log.{key}"), False) for key in ("when", "who", "what", "details")]
        self._place.clear()
        with self._place:
            table(text("settings.log"), columns, rows)
