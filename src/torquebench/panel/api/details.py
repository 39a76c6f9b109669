"""Schemas of `details` of a job's result, by the kind of the job."""

from __future__ import annotations

from typing import Any, get_args

from pydantic import TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from torquebench.panel.service.jobs.details import Details

__all__ = ["details_schemas"]


class _NullWithoutNumber(GenerateJsonSchema):
    """JSON has null in place of a number that isn't finite."""

    def float_schema(self, schema: core_schema.FloatSchema) -> JsonSchemaValue:
        """Return the schema of a number or null."""
        return {"anyOf": [super().float_schema(schema), {"type": "null"}]}


def details_schemas() -> tuple[list[dict[str, str]], dict[str, Any]]:
    """Return references to the schemas of details, and the schemas with what they refer to."""
    types = get_args(Details)
    _, schemas = TypeAdapter.json_schemas(
        [(details, "validation", TypeAdapter(details)) for details in types],
        ref_template="#/components/schemas/{model}",
        schema_generator=_NullWithoutNumber,
    )
    references = [{"$ref": f"#/components/schemas/{details.__name__}"} for details in types]
    return references, schemas["$defs"]
