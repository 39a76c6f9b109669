"""Results of operations: their values, JSON, and one description for all interfaces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, TypeAlias

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.reports.page import Facts, Page, Section
from torquebench.units import title_of_name, unit_of_name

__all__ = [
    "HIDDEN",
    "ArrayOf",
    "Decision",
    "ExplainedError",
    "Integers",
    "Numbers",
    "Result",
    "stated",
]

HIDDEN = {"hidden": True}
"""Metadata of a result's field that isn't part of its JSON."""


@dataclass(frozen=True)
class ArrayOf:
    """Marks a field, of any kind of sequence, that is an array of numbers in JSON."""

    kind: str

    def __get_pydantic_json_schema__(self, _schema: Any, _handler: Any) -> dict[str, Any]:
        items: dict[str, Any] = {"type": self.kind}
        if self.kind == "number":
            items = {"anyOf": [items, {"type": "null"}]}
        return {"type": "array", "items": items}


Numbers: TypeAlias = Annotated[Any, ArrayOf("number")]
"""An array or a sequence of numbers; null marks a missing number."""
Integers: TypeAlias = Annotated[Any, ArrayOf("integer")]


@dataclass(frozen=True, kw_only=True)
class Result:
    """Result of an operation.

    Parameters
    ----------
    headline : str
        One sentence.
    verdict : str
        "pass", "conditionalPass", "conditionalFail", "fail", or empty without a tolerance.
    simulated : bool
        Whether the bench was simulated, which must be stated everywhere.
    run_ids : tuple of str
        Runs that the operation recorded, or on which the result is based.
    remarks : tuple of str
        Warnings that the reader has to know.
    files : tuple of str
        Files that were written by the request.
    """

    headline: str
    verdict: str = ""
    simulated: bool = False
    run_ids: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    files: tuple[str, ...] = ()

    def plain(self) -> dict[str, Any]:
        """Return all fields that aren't hidden as plain JSON."""
        from torquebench.records.files import plain_json

        stated = [each.name for each in fields(self) if not each.metadata.get("hidden")]
        return {name: plain_json(getattr(self, name)) for name in stated}

    @property
    def failed(self) -> bool:
        """Whether a check failed, so that the command's exit code is 1."""
        if not self.verdict:
            return False
        from torquebench.uncertainty import Verdict

        return Verdict(self.verdict).failed

    def page(self) -> Page:
        """Return its description for terminal, panel, HTML and PDF: by default its values."""
        common = {each.name for each in fields(Result)}
        facts = [
            (title_of_name(each.name), stated(getattr(self, each.name), unit_of_name(each.name)))
            for each in fields(self)
            if each.name not in common
        ]
        blocks = [Facts([(name, value) for name, value in facts if value])]
        return Page(self.headline, "", [Section("", "", blocks)], simulated=self.simulated)


@dataclass(frozen=True, kw_only=True)
class Decision(Result):
    """A person's registered decision, and how the person was authenticated."""

    signature: str


class ExplainedError(InputError):
    """An input error that is explained by a page, which `page` returns."""

    def __init__(self, found: str, allowed: str, remedy: str, page: Callable[[], Page]) -> None:
        super().__init__(found, allowed, remedy)
        self.page = page

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return (type(self), (self.found, self.allowed, self.remedy, self.page))


def stated(value: Any, unit: str = "") -> str:
    """Return a value as text with its unit; empty if there is none."""
    if value is None or value == "":
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return Message("{value:.6g} {unit}", value, unit) if unit else f"{value:.6g}"
    if isinstance(value, list | tuple):
        return Message.joined(stated(each, unit) for each in value)
    if isinstance(value, Mapping):
        return Message.joined(f"{name} = {each}" for name, each in value.items())
    return value if isinstance(value, str) else str(value)
