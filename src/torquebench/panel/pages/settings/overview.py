"""The settings: channels, limits, profiles, reducers, users; validated, logged, undone."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import chain, count
from typing import Any

from torquebench.errors import TorquebenchError
from torquebench.panel.components.controls import button
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import (
    box,
    empty,
    moment,
    note,
    panel,
    table,
    tag,
    to_the_top,
    words,
)
from torquebench.panel.components.tabs import Tabs
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.page import page
from torquebench.panel.pages.settings.editor import SettingEditor, change_lines
from torquebench.panel.pages.settings.log import LogView
from torquebench.panel.pages.settings.tokens import TokensView
from torquebench.panel.pages.users import UsersView
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import SECTIONS, SettingsChange, SettingsItem, read_upload

__all__ = ["settings_page"]

LARGEST_UPLOAD = 64 * 1024
READ_FILE = (
    "async (event) => { const file = event.target.files[0]; if (!file) return; "
    f"emit(file.size > {LARGEST_UPLOAD} ? null : await file.text()); event.target.value = ''; }}"
)


class _Bench:
    """Channels and limits of the open bench."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor = visitor

    def build(self) -> None:
        self._place = box("div", "stack")
        self._show()

    def _show(self) -> None:
        visitor, text = self._visitor, self._visitor.text
        item = visitor.service.settings.get("bench", "bench")
        self._place.clear()
        with self._place:
            if visitor.service.reopen_needed:
                with note(text("settings.reopen_explained"), "warn"):
                    button(text("settings.reopen"), self._reopen, "primary", picture="refresh")
            SettingEditor(visitor, item, self._show).build()

    def _reopen(self) -> None:
        visitor = self._visitor
        visitor.attempt(lambda: visitor.service.reopen(visitor.actor))
        self._show()


class _Documents:
    """Profiles or reducers: packaged ones and the user's."""

    def __init__(self, visitor: Visitor, section: str) -> None:
        self._visitor, self._text, self._section = visitor, visitor.text, section

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
                text.core(str(item.document.get("title") or item.document.get("name", ""))),
                text("settings.builtin" if item.builtin else "settings.own"),
            )
            for item in items
        ]
        self._list.clear()
        with self._list, panel(text(f"settings.{self._section}")), box("div", "stack"):
            table(
                text(f"settings.{self._section}"),
                [(text(f"settings.{key}"), False) for key in ("name", "what", "from")],
                rows,
                on_row=lambda place: self._open(items[place]),
                open_label=text("records.open"),
            )
            if visitor.has_role(SECTIONS[self._section].role):
                self._upload()

    def _upload(self) -> None:
        text = self._text
        with box("div", "field"):
            label = words("label", text("settings.upload"))
            entry = box("input", "control", type="file", accept=".toml")
            label.props["for"] = entry.html_id
            entry.on("change", lambda event: self._uploaded(event.args), js_handler=READ_FILE)

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
        """Return an unused name, based on the document's own."""
        plain = re.sub(r"[^a-z0-9.]+", "-", said.casefold()).strip("-.")[:60] or "own"
        taken = {item.name for item in self._visitor.service.settings.items(self._section)}
        numbered = (f"{plain}-{number}" for number in count(2))
        return next(name for name in chain([plain], numbered) if name not in taken)

    def _new(self, name: str, document: Mapping[str, Any]) -> SettingsItem:
        if self._section == "profiles":  # a profile's name is the one under which it is stored
            document = {**document, "name": name}
        return SettingsItem(self._section, name, False, document, 0)

    def _open(self, item: SettingsItem, *, new: bool = False) -> None:
        self._editor.clear()
        with self._editor:
            SettingEditor(self._visitor, item, self._changed, new=new, on_copy=self._copy).build()
        to_the_top()

    def _copy(self, item: SettingsItem) -> None:
        text = self._text

        def act(name: str) -> None:
            self._open(self._new(name, item.document), new=True)

        ask(
            text,
            text("settings.copy"),
            text("settings.copy_explained", name=item.name),
            act,
            field=text("settings.new_name"),
        )

    def _changed(self) -> None:
        self._editor.clear()
        self._show()


class _History:
    """All changes, each with an undo button."""

    def __init__(self, visitor: Visitor) -> None:
        self._visitor, self._text = visitor, visitor.text

    def build(self) -> None:
        self._place = box("div")
        self._show()

    def _show(self) -> None:
        text = self._text
        found = self._visitor.service.settings.history(limit=50)
        self._place.clear()
        with self._place, panel(text("settings.history")):
            if not found:
                empty(text("settings.no_history"), "history")
            with box("ul", "stack"):
                for change in found:
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
                        tag(text("settings.undone_by", number=change.undone_by))
                    if change.undoes is not None:
                        tag(text("settings.undoes", number=change.undoes))
                role = SECTIONS[change.section].role
                if change.undone_by is None and self._visitor.has_role(role):
                    button(
                        text("settings.undo"),
                        lambda: self._undo(change.number),
                        "small",
                        picture="undo",
                        aria_label=text("settings.undo_label", number=change.number),
                    )
            if change.reason:
                words("p", change.reason)
            change_lines(text, change.differences)

    def _undo(self, number: int) -> None:
        visitor = self._visitor
        settings = visitor.service.settings
        visitor.attempt(lambda: settings.undo(visitor.actor, number), self._text("settings.undone"))
        self._show()


@page("settings", "/settings", picture="build", place=5)
def settings_page(visitor: Visitor) -> None:
    """Build the page of the settings."""
    text = visitor.text
    views: Mapping[str, Any] = {
        "bench": lambda: _Bench(visitor).build(),
        "profiles": lambda: _Documents(visitor, "profiles").build(),
        "reducers": lambda: _Documents(visitor, "reducers").build(),
        "users": lambda: UsersView(visitor).build(),
        **(
            {"tokens": lambda: TokensView(visitor).build()}
            if visitor.has_role("administrator")
            else {}
        ),
        **({"log": lambda: LogView(visitor).build()} if visitor.has_role("metrologist") else {}),
        "history": lambda: _History(visitor).build(),
    }
    with frame(visitor, "settings"):
        titles = {name: text(f"settings.{name}") for name in views}
        Tabs(text("settings.title"), titles, views, visitor.query.get("part", ""))
