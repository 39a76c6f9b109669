"""Results of operations: values, from which JSON and one description for all screens follow."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated, Any, TypeAlias

from pydantic import TypeAdapter, WithJsonSchema
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from torquebench.message import Message
from torquebench.reports.page import Facts, Page, Section
from torquebench.units import title_of_name, unit_of_name

__all__ = ["HIDDEN", "Decision", "Integers", "Numbers", "Result", "json_schemas"]

HIDDEN = {"hidden": True}
"""Metadata of a field of a result that JSON doesn't have."""

_NUMBER = {"anyOf": [{"type": "number"}, {"type": "null"}]}
Numbers: TypeAlias = Annotated[Any, WithJsonSchema({"type": "array", "items": _NUMBER})]
"""An array or a sequence of numbers; null where there is none."""
Integers: TypeAlias = Annotated[
    Any, WithJsonSchema({"type": "array", "items": {"type": "integer"}})
]


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
        Whether every figure has to say so.
    run_ids : tuple of str
        Runs that it has recorded or rests on.
    remarks : tuple of str
        Warnings: what else the reader has to know.
    """

    headline: str
    verdict: str = ""
    simulated: bool = False
    run_ids: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def plain(self) -> dict[str, Any]:
        """Return it as JSON holds it: all fields that aren't hidden."""
        from torquebench.records.files import plain_json

        stated = [each.name for each in fields(self) if not each.metadata.get("hidden")]
        return {name: plain_json(getattr(self, name)) for name in stated}

    @property
    def failed(self) -> bool:
        """Whether a check failed: the command's exit code is 1 then."""
        if not self.verdict:
            return False
        from torquebench.uncertainty import Verdict

        return Verdict(self.verdict).failed

    def page(self) -> Page:
        """Return its description for terminal, panel, HTML and PDF: by default its values."""
        common = {each.name for each in fields(Result)}
        facts = [
            (title_of_name(each.name), _stated(getattr(self, each.name), unit_of_name(each.name)))
            for each in fields(self)
            if each.name not in common
        ]
        stated = Facts([(name, value) for name, value in facts if value])
        return Page(self.headline, "", [Section("", "", [stated])], simulated=self.simulated)


@dataclass(frozen=True, kw_only=True)
class Decision(Result):
    """A person's decision that the records keep, and how that person was authenticated."""

    signature: str


def _stated(value: Any, unit: str) -> str:
    if value is None or value == "":
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return Message("{value:.6g} {unit}", value, unit) if unit else f"{value:.6g}"
    if isinstance(value, list | tuple):
        return Message.joined(_stated(each, unit) for each in value)
    return value if isinstance(value, str) else str(value)


class _NullWithoutNumber(GenerateJsonSchema):
    """JSON has null in place of a number that isn't finite."""

    def float_schema(self, schema: core_schema.FloatSchema) -> JsonSchemaValue:
        """Return the schema of a number or null."""
        return {"anyOf": [super().float_schema(schema), {"type": "null"}]}


def json_schemas(types: list[Any]) -> tuple[dict[Any, dict[str, str]], dict[str, Any]]:
    """Return a reference to the schema of each type of result, and all schemas by name."""
    _, schemas = TypeAdapter.json_schemas(
        [(each, "validation", TypeAdapter(each)) for each in types],
        ref_template="#/components/schemas/{model}",
        schema_generator=_NullWithoutNumber,
    )
    for each in types:
        schema = schemas["$defs"][each.__name__]
        for hidden in (part.name for part in fields(each) if part.metadata.get("hidden")):
            del schema["properties"][hidden]
            schema["required"] = [name for name in schema.get("required", ()) if name != hidden]
    references = {each: {"$ref": f"#/components/schemas/{each.__name__}"} for each in types}
    return references, schemas["$defs"]
