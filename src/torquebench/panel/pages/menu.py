"""The menu: command lease, language, theme, keyboard shortcuts, sign-out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import ui

from torquebench.panel.components.controls import button
from torquebench.panel.components.dialogs import foot, sheet
from torquebench.panel.components.elements import box, words
from torquebench.panel.pages.visitor import LANGUAGE_COOKIE, LOOK_COOKIE, LOOKS, Visitor
from torquebench.panel.text import LANGUAGES, Texts

LOOK_TITLES: Texts = {"auto": "As the device", "light": "Light", "dark": "Dark"}


class Menu:
    """The dialog of the menu, built when it is opened."""

    def __init__(self, visitor: Visitor, take: Callable[[], Any], give: Callable[[], Any]) -> None:
        self._visitor = visitor
        self._take, self._give = take, give

    def open(self) -> None:
        """Show the menu."""
        visitor, text = self._visitor, self._visitor.text
        actor = visitor.actor
        with ui.context.client.content, sheet(text("Menu")) as dialog:
            role = text(actor.role)
            words("p", text("Signed in as {who}, {role}", who=actor.name, role=role))
            with box("div", "line"):
                if visitor.commands:
                    button(text("Give up command"), self._and_close(self._give, dialog))
                else:
                    button(text("Take command"), self._and_close(self._take, dialog))
                with box("form", method="post", action="/panel/sign-out"):
                    words("button", text("Sign out"), "control", type="submit")
            words("h3", text("Language"))
            with box("div", "line"):
                for language, said in LANGUAGES.items():
                    chosen = language == text.language
                    _choice(said, LANGUAGE_COOKIE, language, chosen=chosen, lang=language)
            words("h3", text("Theme"))
            with box("div", "line"):
                for look in ("auto", *LOOKS):
                    chosen = look == (visitor.look or "auto")
                    _choice(text(LOOK_TITLES[look]), LOOK_COOKIE, look, chosen=chosen)
            words("h3", text("Notifications"))
            words(
                "p",
                text(
                    "A sound and a notification of this browser for each new alarm, and at the "
                    "end of your jobs."
                ),
                "muted small",
            )
            with box("div", "line"):
                for value, said in (("on", text("On")), ("off", text("Off"))):
                    words("button", said, "control", type="button", data_notices=value)
            words("h3", text("Keys"))
            with box("ul"):
                for said in (
                    text("F8: stop the bench"),
                    text("Alt+1, Alt+2 and so on: the pages, in their order"),
                    text("?: this menu"),
                    text("Tab, Shift+Tab, Enter, Space: move and press"),
                ):
                    words("li", said)
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
