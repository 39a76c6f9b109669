"""Messages at the page's edge, announced to screen readers; errors stay until dismissed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from torquebench.errors import TorquebenchError
from torquebench.panel.components.elements import NOTE_ICONS, box, icon, on_press, words
from torquebench.panel.text import Text

SHOWN_S = 6.0
AT_MOST = 4


class Messages:
    """A page's messages about the results of actions."""

    def __init__(self, text: Text) -> None:
        self._text = text
        self._shown: list[Any] = []
        self._region = box("aside", "messages", aria_live="polite", aria_label=text("Messages"))

    def good(self, said: str) -> None:
        """Show a success for a while."""
        shown = self._show(said, "good")
        with self._region:
            ui.timer(SHOWN_S, lambda: self._take(shown), once=True)

    def problem(self, error: TorquebenchError) -> None:
        """Show found, allowed and remedy of an error until it is dismissed."""
        found, more = self._text.refusal(error)
        self._show(found, "bad", more)

    def tell(self, said: str, kind: str, more: str, on_dismiss: Callable[[], Any]) -> None:
        """Show a message until it is dismissed; then call `on_dismiss`."""
        self._show(said, kind, more, on_dismiss)

    def _show(
        self, said: str, kind: str, more: str = "", on_dismiss: Callable[[], Any] | None = None
    ) -> Any:
        while len(self._shown) >= AT_MOST:
            self._take(self._shown[0])
        with self._region:
            shown = box("div", f"note {kind}")
            with shown:
                icon(NOTE_ICONS[kind])
                with box("div"):
                    words("div", said)
                    if more:
                        words("div", more, "small muted")
                close = box("button", type="button", aria_label=self._text("Dismiss this message"))
                with close:
                    icon("close")
                on_press(close, lambda: self._dismiss(shown, on_dismiss))
        self._shown.append(shown)
        return shown

    def _dismiss(self, shown: Any, on_dismiss: Callable[[], Any] | None) -> None:
        if on_dismiss is not None:
            on_dismiss()
        self._take(shown)

    def _take(self, shown: Any) -> None:
        if shown in self._shown:
            self._shown.remove(shown)
            shown.delete()
