"""JSON schemas of results."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema


class _NullWithoutNumber(GenerateJsonSchema):
    """Generates schemas in which a number may be null, as JSON can't express NaN or infinity."""

    def float_schema(self, schema: core_schema.FloatSchema) -> JsonSchemaValue:
        """Return the schema of a number or null."""
        return {"anyOf": [super().float_schema(schema), {"type": "null"}]}


def json_schemas(types: list[Any]) -> tuple[dict[Any, dict[str, str]], dict[str, Any]]:
    """Return a reference to each type's schema, and all schemas by name."""
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
