"""The page of settings: bench, profiles, reducers, users, tokens, history and log."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from itertools import chain, count
from typing import Any

from torquebench.errors import TorquebenchError
from torquebench.panel.components.controls import button, file_entry
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import (
    box,
    empty,
    headings,
    moment,
    note,
    panel,
    refilled,
    table,
    tag,
    to_the_top,
    words,
)
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.page import page
from torquebench.panel.pages.settings.editor import SettingEditor, change_lines
from torquebench.panel.pages.settings.log import LogView
from torquebench.panel.pages.settings.tokens import TokensView
from torquebench.panel.pages.users import UsersView
from torquebench.panel.pages.view import View, tabs
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import SECTIONS, SettingsChange, SettingsItem, read_upload
from torquebench.panel.service.settings.documents import LARGEST_UPLOAD
from torquebench.panel.text import Texts

READ_FILE = (
    "async (event) => { const file = event.target.files[0]; if (!file) return; "
    f"emit(file.size > {LARGEST_UPLOAD} ? null : await file.text()); event.target.value = ''; }}"
)


class _Bench(View):
    """Channels and limits of the open bench."""

    def build(self) -> None:
        self._place = box("div", "stack")
        self._show()

    def _show(self) -> None:
        visitor, text = self._visitor, self._visitor.text
        item = visitor.service.settings.get("bench", "bench")
        with refilled(self._place):
            if visitor.service.reopen_needed:
                with note(
                    text(
                        "Changes of the bench take effect when it is opened again. That takes some "
                        "seconds; no work may be running."
                    ),
                    "warn",
                ):
                    button(
                        text.title("open the bench again"),
                        self._reopen,
                        "primary",
                        picture="refresh",
                    )
            SettingEditor(visitor, item, self._show).build()

    def _reopen(self) -> None:
        self._visitor.act(self._visitor.service.reopen)
        self._show()


class _Documents(View):
    """Profiles or reducers: packaged ones and the user's."""

    def __init__(self, visitor: Visitor, section: str) -> None:
        super().__init__(visitor)
        self._section = section

    def build(self) -> None:
        self._editor = box("div", "stack")
        self._list = box("div")
        self._show()

    def _show(self) -> None:
        text, visitor = self._text, self._visitor
        items = visitor.service.settings.items(self._section)
        rows = [
            (
                item.name,
                text(str(item.document.get("title") or item.document.get("name", ""))),
                text("the software" if item.builtin else "this laboratory"),
            )
            for item in items
        ]
        with refilled(self._list), panel(text(TABS[self._section])), box("div", "stack"):
            table(
                text(TABS[self._section]),
                headings(text, "Name", "What it is", "From"),
                rows,
                on_row=lambda place: self._open(items[place]),
                open_label=text("Open"),
            )
            if visitor.has_role(SECTIONS[self._section].role):
                self._upload()

    def _upload(self) -> None:
        with box("div", "field"):
            file_entry(
                self._text("Add one from a TOML file (at most 64 KB)"),
                ".toml",
                READ_FILE,
                self._uploaded,
            )

    def _uploaded(self, content: str | None) -> None:
        try:
            document = read_upload(b" " * (LARGEST_UPLOAD + 1) if content is None
                                   else content.encode())  # fmt: skip
        except TorquebenchError as error:
            self._visitor.messages.problem(error)
            return
        name = self._free_name(str(document.get("name", "")))
        self._open(self._new(name, document), new=True)

    def _free_name(self, said: str) -> str:
        """Return an unused name that is based on the given one."""
        plain = re.sub(r"[^a-z0-9.]+", "-", said.casefold()).strip("-.")[:60] or "own"
        taken = {item.name for item in self._visitor.service.settings.items(self._section)}
        numbered = (f"{plain}-{number}" for number in count(2))
        return next(name for name in chain([plain], numbered) if name not in taken)

    def _new(self, name: str, document: Mapping[str, Any]) -> SettingsItem:
        if self._section == "profiles":  # a profile's name is the one under which it is stored
            document = {**document, "name": name}
        return SettingsItem(self._section, name, False, document, 0)

    def _open(self, item: SettingsItem, *, new: bool = False) -> None:
        with refilled(self._editor):
            SettingEditor(self._visitor, item, self._changed, new=new, on_copy=self._copy).build()
        to_the_top()

    def _copy(self, item: SettingsItem) -> None:
        text = self._text

        def act(name: str) -> None:
            self._open(self._new(name, item.document), new=True)

        ask(
            text,
            text("Copy under a new name"),
            text("A copy of {name} to change.", name=item.name),
            act,
            field=text("New name (a-z, 0-9, dots and hyphens)"),
        )

    def _changed(self) -> None:
        self._editor.clear()
        self._show()


class _History(View):
    """All changes, each with an undo button."""

    def build(self) -> None:
        self._place = box("div")
        self._show()

    def _show(self) -> None:
        text = self._text
        changes = self._visitor.service.settings.history(limit=50)
        with refilled(self._place), panel(text("Changes")):
            if not changes:
                empty(text("Nothing was changed yet."), "history")
            with box("ul", "stack"):
                for change in changes:
                    self._line(change)

    def _line(self, change: SettingsChange) -> None:
        text = self._text
        with box("li", "panel stack"):
            with box("div", "spread"):
                with box("div", "line"):
                    words("h3", f"{change.number}. {change.section}: {change.name}")
                    words("span", change.who, "muted")
                    if change.at is not None:
                        moment(change.at)
                    if change.undone_by is not None:
                        tag(text("undone by change {number}", number=change.undone_by))
                    if change.undoes is not None:
                        tag(text("undoes change {number}", number=change.undoes))
                role = SECTIONS[change.section].role
                if change.undone_by is None and self._visitor.has_role(role):
                    button(
                        text("Undo"),
                        lambda: self._undo(change.number),
                        "small",
                        picture="undo",
                        aria_label=text("Undo change {number}", number=change.number),
                    )
            if change.reason:
                words("p", change.reason)
            change_lines(text, change.differences)

    def _undo(self, number: int) -> None:
        undo = self._visitor.service.settings.undo
        self._visitor.act(undo, number, success=self._text("Undone, as a further change."))
        self._show()


TABS: Texts = {
    "bench": "Channels and limits",
    "profiles": "Profiles",
    "reducers": "Reducers",
    "users": "Users",
    "tokens": "Tokens",
    "log": "Log",
    "history": "Changes",
}


@page("settings", "/settings", "Settings", picture="build", place=5)
def settings_page(visitor: Visitor) -> None:
    """Build the page of the settings."""
    views: dict[str, Callable[[Visitor], View]] = {
        "bench": _Bench,
        "profiles": partial(_Documents, section="profiles"),
        "reducers": partial(_Documents, section="reducers"),
        "users": UsersView,
    }
    if visitor.has_role("administrator"):
        views["tokens"] = TokensView
    if visitor.has_role("metrologist"):
        views["log"] = LogView
    views["history"] = _History
    with frame(visitor, "settings"):
        tabs(visitor, "settings", TABS, views)
