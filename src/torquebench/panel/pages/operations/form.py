"""The form of an operation: one field for each parameter of its request."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

from nicegui import ui
from pydantic import BaseModel

from torquebench.campaign.fitting import model_title
from torquebench.compensation.kinds import MODEL_NAMES, MODELS, NETWORKS
from torquebench.operations import Operation, Parameter, parameters
from torquebench.panel.components.controls import Choice, Field, typed_number
from torquebench.panel.components.elements import box, words
from torquebench.panel.pages.operations.files import FileField
from torquebench.panel.pages.records.column_titles import column_title
from torquebench.panel.pages.settings.editor import shown
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.text import Text
from torquebench.units import unit_of_name
from torquebench.validation import faults_of

TYPING_S = 0.4
"""Pause after which typing counts as finished, s."""
RADIO = 7
"""Largest number of choices shown as visible options instead of a list."""


def choice_words(text: Text, name: str) -> str:
    """Return the label of a choice: a model, a signal or another value."""
    if name in MODEL_NAMES:
        return text(model_title(name))
    return column_title(text, name) if unit_of_name(name) else text(name)


def unquoted(said: str) -> str:
    """Return a text for a page without the backquotes that mark names in a docstring."""
    return said.replace("`", "")


class BenchClear:
    """On a real bench, asks for confirmation that it may be loaded."""

    def __init__(self, visitor: Visitor) -> None:
        self._choice: Choice | None = None
        if not visitor.service.snapshot().simulated:
            text = visitor.text
            options = {"clear": text("Nobody is at the moving parts; the bench may be loaded.")}
            self._choice = Choice(text("Safety"), options, several=True)

    @property
    def confirmed(self) -> bool:
        """Whether the person has confirmed; True for a simulated bench."""
        return self._choice is None or "clear" in self._choice.values


class OperationForm:
    """Fields of an operation's request, with their errors beside them.

    Parameters
    ----------
    visitor : Visitor
    operation : Operation
    given : mapping
        Initial values by parameter name.
    hidden : collection of str
        Parameters without a field, which keep their given values.
    on_change : callable, optional
        Called after a change, once a person has stopped typing.
    """

    def __init__(
        self,
        visitor: Visitor,
        operation: Operation,
        given: Mapping[str, Any] | None = None,
        hidden: Collection[str] = (),
        on_change: Callable[[], Any] = lambda: None,
    ) -> None:
        self._visitor, self._text, self._operation = visitor, visitor.text, operation
        self._given = dict(given or {})
        self._on_change = on_change
        self._readers: dict[str, Callable[[], Any]] = {}
        self._fields: dict[str, Field] = {}
        self._waiting: ui.timer | None = None
        asked = [
            each
            for each in parameters(operation.request)
            if each.name not in hidden and not each.local and visitor.has_role(each.role)
        ]
        with box("div", "stack operation-form"):
            with box("div", "columns narrow"):
                for each in asked:
                    if not each.expert:
                        self._add(each)
            if expert := [each for each in asked if each.expert]:
                self._expert(expert)
            self._clock = box("div")
        self.clear = BenchClear(visitor) if operation.loads else None

    def _expert(self, asked: list[Parameter]) -> None:
        text = self._text
        plain = [each for each in asked if each.record is None]
        for each in asked:
            if each.record is not None:
                self._record(each, each.record)
        if plain:
            with box("details"):
                words("summary", text("Expert"))
                with box("div", "columns narrow"):
                    for each in plain:
                        self._add(each)

    def _record(self, asked: Parameter, record: type[BaseModel]) -> None:
        """Add a collapsible group with the fields of a record; empty fields are left out."""
        before = self._given.get(asked.name) or {}
        readers: dict[str, Callable[[], Any]] = {}
        with box("details"):
            words("summary", self._text(asked.title))
            with box("div", "stack"):
                words("p", self._text(asked.help), "small muted")
                with box("div", "columns narrow"):
                    for part in parameters(record):
                        value = before.get(part.name) if isinstance(before, Mapping) else None
                        readers[part.name] = self._reader(part, value, f"{asked.name}.{part.name}")

        def read() -> dict[str, Any]:
            values = {name: reader() for name, reader in readers.items()}
            return {name: value for name, value in values.items() if value not in (None, "", ())}

        self._readers[asked.name] = read

    def _add(self, asked: Parameter) -> None:
        value = self._given.get(asked.name, asked.default)
        self._readers[asked.name] = self._reader(asked, value, asked.name)

    def _reader(self, asked: Parameter, value: Any, key: str) -> Callable[[], Any]:
        """Add the control of a parameter; return a function that reads its value."""
        text = self._text
        title, hint = text(asked.title), unquoted(text(asked.help))
        options = self._options(asked)
        if asked.kind == "flag" and not asked.optional:
            chosen = ("on",) if value else ()
            flag = Choice(title, {"on": hint}, chosen, several=True, on_change=self._changed)
            return lambda: "on" in flag.values
        if asked.kind == "flag":
            options = {"": "–", "yes": text("yes"), "no": text("no")}
            value = "" if value is None else "yes" if value else "no"
        if options is not None and asked.several:
            several = Choice(
                title, options, tuple(value or ()), several=True, on_change=self._changed
            )
            names = tuple(options)
            return lambda: tuple(name for name in names if name in several.values)
        if options is not None and len(options) <= RADIO and asked.required:
            first = str(value) if value is not None else next(iter(options))
            radio = Choice(title, options, first, on_change=self._changed)
            return lambda: radio.value
        if options is not None and asked.optional:
            options = {"": "–"} | options
        limits = text(asked.limits)
        hint = f"{hint} ({limits})" if limits and hint else hint or limits
        if (asked.kind == "path" and not asked.output) or asked.file:
            self._fields[key] = chosen_file = FileField(
                self._visitor,
                title,
                field_text(asked, value),
                hint,
                several=asked.several,
                typed=asked.file,
                on_change=lambda _: self._changed(),
            )
            return lambda: field_value(asked, chosen_file.value)
        field = Field(
            title,
            field_text(asked, value),
            kind="date" if asked.kind == "day" else "text",
            unit=text(asked.unit),
            hint=hint,
            options=options,
            on_change=lambda _: self._changed(),
            autocomplete=None if asked.kind == "day" else "off",
            inputmode="decimal" if asked.kind in ("number", "whole") else None,
        )
        self._fields[key] = field
        return lambda: field_value(asked, field.value)

    def _options(self, asked: Parameter) -> dict[str, str] | None:
        """Return the choices with their labels; None for a free value."""
        text, settings = self._text, self._visitor.service.settings
        if asked.names == "models":
            kinds = (
                [*dict.fromkeys([*map(str, asked.default or ()), *MODELS, *NETWORKS])]
                if asked.several
                else [*MODELS, *NETWORKS]
            )
            return {
                name: text(model_title(name))
                for name in kinds
                if name not in ("polynomial", "network")
            }
        if asked.names:
            section = asked.names.partition(":")[0]
            return {
                name: settings_title(text, settings.get(section, name).document, name)
                for name in settings.names(asked.names)
            }
        titles = asked.titles
        return {
            each: text(titles[each]) if each in titles else choice_words(text, each)
            for each in asked.choices
        } or None

    def _changed(self) -> None:
        """After a pause in typing, check the fields and report the change."""
        if self._waiting is not None:
            self._waiting.cancel()
        with self._clock:
            self._waiting = ui.timer(TYPING_S, self._settled, once=True)

    def _settled(self) -> None:
        self._waiting = None
        self.check()
        self._on_change()

    def request(self) -> dict[str, Any]:
        """Return the entered values without empty fields."""
        read = {name: reader() for name, reader in self._readers.items()}
        return {
            name: value
            for name, value in (self._given | read).items()
            if value is not None and value not in ("", {})
        }

    def check(self) -> bool:
        """Show each field's error; return whether there are none."""
        return fields_suit(self._text, self._operation.request, self.request(), self._fields)


def fields_suit(
    text: Text, model: type[BaseModel], request: Mapping[str, Any], fields: Mapping[str, Any]
) -> bool:
    """Show the error of each field, by its dotted key; return whether there are none.

    What is wrong elsewhere is left to the service, which refuses it in words.
    """
    faults = {
        key if key in fields else key.rpartition(".")[0]: fault  # of a list's entry
        for key, fault in faults_of(model, request, "").items()
    }
    for key, field in fields.items():
        fault = faults.get(key)
        allowed = "" if fault is None else text(fault.allowed)
        wrong = text("Allowed: {allowed}", allowed=allowed) if allowed else ""
        if fault is not None and "." not in key and key not in request:
            wrong = text("Fill in this field.")
        field.wrong("" if fault is None else wrong or text(fault.found))
    return not faults.keys() & fields.keys()


def settings_title(text: Text, document: Mapping[str, Any], name: str) -> str:
    """Return a profile's or a reducer's title."""
    title = document.get("title") or document.get("name")
    return text(str(title)) if title else name


def field_text(asked: Parameter, value: Any) -> str:
    """Return a parameter's value as the text of its field, which `field_value` reads."""
    if asked.kind == "values":
        return ", ".join(f"{name}={shown(part)}" for name, part in (value or {}).items())
    if asked.several or asked.pair:
        return ", ".join(map(_single_text, value or ()))
    return _single_text(value)


def field_value(asked: Parameter, said: str) -> Any:
    """Convert a field's text to its type; unsuitable text is left for the request's validation."""
    said = said.strip()
    if not said:
        return None if asked.kind != "text" or asked.optional else ""
    if asked.kind == "flag":
        return said == "yes"
    if asked.kind == "values":
        pairs = (part.partition("=") for part in said.split(","))
        return {name.strip(): value.strip() for name, _, value in pairs}
    if asked.several or asked.pair:
        parts = (part.strip() for part in said.split(","))
        return tuple(_single(asked, part) for part in parts if part)
    return _single(asked, said)


def _single_text(value: Any) -> str:
    return str(value) if isinstance(value, Path) else shown(value)


def _single(asked: Parameter, said: str) -> Any:
    if asked.kind not in ("number", "whole") or asked.numbered:
        return said
    try:
        number = typed_number(said)
    except ValueError:
        return said
    return int(number) if asked.kind == "whole" and number.is_integer() else number
