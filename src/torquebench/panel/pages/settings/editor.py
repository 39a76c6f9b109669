"""Editor of one document of the settings: a field per value, and a preview of the changes."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from torquebench.errors import TorquebenchError
from torquebench.panel.components.controls import Field, button, set_disabled
from torquebench.panel.components.dialogs import ask
from torquebench.panel.components.elements import box, note, panel, refilled, words
from torquebench.panel.pages.jobs.panel import problem_note
from torquebench.panel.pages.settings.names import choice_title, group_title, setting_title
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import SECTIONS, Difference, SettingsItem
from torquebench.panel.service.settings.differences import flat, nested
from torquebench.panel.text import Text
from torquebench.units import unit_of_name

LARGEST_WHOLE = 1e15
OPEN_GROUPS = ("input.limits", "output.limits")


def shown(value: Any) -> str:
    """Return a value as the text of a field.

    Examples
    --------
    >>> shown(None), shown("a"), shown(2.5), shown(2400.0), shown(True), shown([10.0, 25.5])
    ('', 'a', '2.5', '2400', 'true', '[10, 25.5]')
    """
    if value is None:
        return ""
    return value if isinstance(value, str) else json.dumps(_plain(value), ensure_ascii=False)


def _plain(value: Any) -> Any:
    """Convert whole numbers to integers, in lists, too."""
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    whole = isinstance(value, float) and value.is_integer() and abs(value) < LARGEST_WHOLE
    return int(value) if whole else value


def parsed(text: str, before: Any) -> Any:
    """Convert a field's text to the type of the previous value.

    Unsuitable text is returned unchanged; the document's validation then reports the error.

    Examples
    --------
    >>> parsed("2,5", 1.0), parsed("", None), parsed("x", 1), parsed("true", False)
    (2.5, None, 'x', True)
    """
    said = text.strip()
    if isinstance(before, str):
        return text
    if said == "":
        return None
    if isinstance(before, int | float) and not isinstance(before, bool):
        said = said.replace(",", ".")
    try:
        return json.loads(said)
    except ValueError:
        return text


def change_lines(text: Text, differences: Sequence[Difference]) -> None:
    """List the differences: name and key, old and new value."""
    with box("ul", "stack change"):
        for difference in differences:
            with box("li", "line"):
                key = difference.key
                group = group_title(text, key.rpartition(".")[0])
                words("span", f"{group}: {setting_title(text, key)}", "name", title=key)
                if difference.before is not None:
                    words("del", shown(difference.before), "old")
                if difference.after is not None:
                    words("ins", shown(difference.after), "new")
                if unit := unit_of_name(key):
                    words("span", unit, "muted")


class SettingEditor:
    """The fields of one document.

    Parameters
    ----------
    visitor : Visitor
    item : SettingsItem
    on_change : callable
        Called after a change.
    new : bool
        Whether the document isn't stored yet.
    on_copy : callable, optional
        Called with an item to copy it under a new name.
    """

    def __init__(
        self,
        visitor: Visitor,
        item: SettingsItem,
        on_change: Callable[[], Any],
        *,
        new: bool = False,
        on_copy: Callable[[SettingsItem], Any] | None = None,
    ) -> None:
        self._visitor, self._text, self._item = visitor, visitor.text, item
        self._on_change, self._on_copy, self._new = on_change, on_copy, new
        self._before = flat(item.document)
        self._fields: dict[str, Field] = {}
        self._leaves = dict(self._before)
        role = SECTIONS[item.section].role
        self._editable = visitor.has_role(role) and not item.builtin

    def build(self) -> None:
        """Make the editor's elements."""
        text, item = self._text, self._item
        title = item.name if item.section != "bench" else text("Channels and limits")
        with panel(title), box("div", "stack"):
            self._remarks()
            if self._new:
                Field(
                    text("Kept under the name"),
                    item.name,
                    hint=text("2 to 64 of a-z, 0-9, dots and hyphens; it stays as it is."),
                    on_change=self._renamed,
                    maxlength="64",
                )
            with box("div", "groups"):
                for group, keys in self._groups().items():
                    with box("details", open_=group in OPEN_GROUPS or item.section != "bench"):
                        words("summary", group_title(text, group))
                        with box("div", "columns settings-fields"):
                            for key in keys:
                                self._field(key)
            if self._editable:
                self._foot = box("div", "stack settings-foot")
                with self._foot:
                    self._pending = box("div", "stack", role="status")
                    self._reason = Field(text("Why it is changed"), maxlength="500")
                    with box("div", "line"):
                        self._apply = button(
                            text("Apply these changes"), self._change, "primary", picture="save"
                        )
                        if item.section != "bench" and not self._new:
                            button(text("Delete"), self._ask_delete, "danger")
                self._preview()

    def _remarks(self) -> None:
        text, item = self._text, self._item
        if item.builtin:
            note(
                text(
                    "This comes with the software and can't be changed. Copy it under a name "
                    "of your own to change it."
                )
            )
            if self._on_copy is not None and self._visitor.has_role(SECTIONS[item.section].role):
                copy = self._on_copy
                button(text("Copy under a new name"), lambda: copy(item), picture="content_copy")
        elif not self._editable:
            self._visitor.not_allowed()

    def _groups(self) -> dict[str, list[str]]:
        groups: dict[str, list[str]] = {}
        for key in self._before:
            if self._new and key == "name" and self._item.section == "profiles":
                continue  # this is the name under which the profile is stored
            groups.setdefault(key.rpartition(".")[0], []).append(key)
        return dict(sorted(groups.items(), key=lambda pair: pair[0] not in OPEN_GROUPS))

    def _field(self, key: str) -> None:
        value, section, text = self._before[key], self._item.section, self._text
        settings = self._visitor.service.settings
        fixed = settings.fixed(section, key)
        named = section == "profiles" and key == "name"
        self._fields[key] = Field(
            setting_title(text, key),
            shown(value),
            unit=text(unit_of_name(key)),
            hint=text("Only in the bench's own file.") if fixed else self._hint(key),
            options=self._options(key),
            disabled=not self._editable or fixed or named,
            on_change=lambda said: self._typed(key, said),
            autocomplete="off",
            data_key=key,
            title=key,
        )

    def _hint(self, key: str) -> str:
        """Return a hint on a field's allowed values and how to write a list."""
        settings = self._visitor.service.settings
        if isinstance(self._before[key], list):
            return self._text("A list in square brackets, with commas between its values.")
        return self._text(settings.allowed(self._item.section, key, unit_of_name(key)))

    def _options(self, key: str) -> dict[str, str] | None:
        """Return the values to choose from with their words; None where a value is free."""
        text, value = self._text, self._before[key]
        choices = self._visitor.service.settings.choices(self._item.section, key)
        if isinstance(value, bool):
            choices = (True, False)
        if not choices:
            return None
        empty = {"": "–"} if value is None else {}
        return empty | {shown(choice): choice_title(text, shown(choice)) for choice in choices}

    def _renamed(self, said: str) -> None:
        self._item = replace(self._item, name=said.strip())
        if self._item.section == "profiles":
            self._leaves["name"] = self._item.name
        self._preview()

    def _typed(self, key: str, said: str) -> None:
        self._leaves[key] = parsed(said, self._before[key])
        self._preview()

    def _preview(self) -> None:
        """Show the changes, or the errors."""
        item = self._item
        settings = self._visitor.service.settings
        good = False
        beside = self._answer_beside()
        with refilled(self._pending):
            try:
                change = settings.preview(item.section, item.name, nested(self._leaves))
            except TorquebenchError as error:
                if beside:
                    note(
                        self._text(
                            "Values that can't be: {count}. Each says so beside its field.",
                            count=beside,
                        ),
                        "bad",
                        live=True,
                    )
                else:
                    problem_note(self._text, error)
            else:
                good = bool(change.differences)
                if good:
                    words("h3", self._text("What would change"))
                    change_lines(self._text, change.differences)
        set_disabled(self._apply, not good)
        if good or beside:  # keep it visible until it is applied
            self._foot.classes(add="changed")
        else:
            self._foot.classes(remove="changed")

    def _answer_beside(self) -> int:
        """Show the error of each value beside its field; return their number."""
        item, text = self._item, self._text
        faults = self._visitor.service.settings.faults(
            item.section, item.name, nested(self._leaves)
        )
        wrong = 0
        for key, field in self._fields.items():
            fault = next(
                (said for at, said in faults.items() if at == key or at.startswith(f"{key}.")), None
            )
            wrong += fault is not None
            allowed = text(fault.allowed) if fault is not None else ""
            said = text("Allowed: {allowed}", allowed=allowed) if allowed else ""
            field.wrong("" if fault is None else said or text(fault.found))
        return wrong

    def _change(self) -> None:
        said, version = self._text("Changed and logged."), self._item.version
        self._enter(nested(self._leaves), success=said, version=version)

    def _enter(self, document: Mapping[str, Any] | None, **options: Any) -> bool:
        settings, item = self._visitor.service.settings, self._item
        options |= {"reason": self._reason.value, "then": self._on_change}
        return self._visitor.act(settings.change, item.section, item.name, document, **options)

    def _ask_delete(self) -> None:
        text = self._text
        ask(
            text,
            text("Delete"),
            text("{name} is deleted. The list of changes can bring it back.", name=self._item.name),
            lambda _: self._enter(None),
            danger=True,
        )
