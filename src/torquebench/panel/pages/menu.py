"""The menu: command lease, language, theme, keyboard shortcuts, sign-out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from torquebench.panel.components.controls import button
from torquebench.panel.components.dialogs import foot, sheet
from torquebench.panel.components.elements import box, words
from torquebench.panel.pages.visitor import LANGUAGE_COOKIE, LOOK_COOKIE, LOOKS, Visitor
from torquebench.panel.text import LANGUAGES, Text

__all__ = ["Menu"]


class Menu:
    """The dialog of the menu, built when it is opened."""

    def __init__(self, visitor: Visitor, take: Callable[[], Any], give: Callable[[], Any]) -> None:
        self._visitor = visitor
        self._take, self._give = take, give

    def open(self) -> None:
        """Show the menu."""
        visitor, text = self._visitor, self._visitor.text
        actor = visitor.actor
        with ui.context.client.content, sheet(text("menu.title")) as dialog:
            role = text.core(actor.role)
            words("p", text("menu.signed_in", who=actor.name, role=role))
            with box("div", "line"):
                if visitor.commands:
                    button(text("frame.give_command"), self._and_close(self._give, dialog))
                else:
                    button(text("frame.take_command"), self._and_close(self._take, dialog))
                with box("form", method="post", action="/panel/sign-out"):
                    words("button", text("menu.sign_out"), "control", type="submit")
            words("h3", text("menu.language"))
            with box("div", "line"):
                for language in LANGUAGES:
                    said = Text(language)("name.language")
                    chosen = language == text.language
                    _choice(said, LANGUAGE_COOKIE, language, chosen=chosen, lang=language)
            words("h3", text("menu.look"))
            with box("div", "line"):
                for look in ("auto", *LOOKS):
                    chosen = look == (visitor.look or "auto")
                    _choice(text(f"menu.look_{look}"), LOOK_COOKIE, look, chosen=chosen)
            words("h3", text("menu.notices"))
            words("p", text("menu.notices_explained"), "muted small")
            with box("div", "line"):
                for value in ("on", "off"):
                    said = text(f"menu.notices_{value}")
                    words("button", said, "control", type="button", data_notices=value)
            words("h3", text("menu.shortcuts"))
            with box("ul"):
                for key in ("key_stop", "key_pages", "key_help", "key_tab"):
                    words("li", text(f"menu.{key}"))
            with foot(text, dialog):
                pass

    def _and_close(self, action: Callable[[], Any], dialog: Any) -> Callable[[], None]:
        def act() -> None:
            action()
            dialog.close()

        return act


def _choice(said: str, cookie: str, value: str, *, chosen: bool, **attributes: str) -> None:
    """Add a button that stores a choice in a cookie and reloads the page."""
    words(
        "button",
        said,
        "control",
        type="button",
        data_choose=cookie,
        data_value=value,
        aria_pressed="true" if chosen else "false",
        **attributes,
    )
