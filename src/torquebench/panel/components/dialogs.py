"""Dialogs that keep the focus inside, close on Escape and are removed after closing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from nicegui import ui

from torquebench.panel.components.controls import Field, button
from torquebench.panel.components.elements import box, words
from torquebench.panel.text import Text


@contextmanager
def sheet(title: str) -> Iterator[Any]:
    """Open a dialog with the elements created in the block; it is removed when it closes.

    It opens without an animation, so that its buttons can be pressed at once. It belongs to the
    whole page, because the element that opened it may be rebuilt meanwhile.
    """
    with ui.context.client.content:
        dialog = ui.dialog()
    dialog.props["aria-label"] = title
    dialog.props["transition-show"] = dialog.props["transition-hide"] = "none"
    dialog.props["transition-duration"] = 0
    dialog.on_value_change(lambda event: None if event.value else dialog.delete())
    with dialog, box("div", "sheet"):
        words("h2", title)
        yield dialog
    dialog.open()


@contextmanager
def foot(text: Text, dialog: Any) -> Iterator[None]:
    """Add the buttons below a dialog; the first one closes it."""
    with box("div", "line end"):
        button(text("Close"), dialog.close, "quiet")
        yield


def ask(
    text: Text,
    title: str,
    said: str,
    on_confirm: Callable[[str], Any],
    *,
    confirm: str = "",
    field: str = "",
    kind: str = "text",
    value: str = "",
    danger: bool = False,
) -> Any:
    """Ask for confirmation of an action, and for one value if the action needs it.

    `on_confirm` gets the value; if it returns False, the dialog stays open. The confirming button
    is labelled with the title, or with `confirm`.
    """

    def act() -> None:
        if on_confirm(entry.value if entry is not None else "") is not False:
            dialog.close()

    with sheet(title) as dialog:
        words("p", said)
        entry = None
        if field:
            entry = Field(field, value, kind=kind, on_enter=act, autocomplete="off")
        with foot(text, dialog):
            button(confirm or title, act, "danger" if danger else "primary")
    return dialog
