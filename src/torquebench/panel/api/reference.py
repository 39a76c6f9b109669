"""The API's description as one page for people: every operation with its fields, folded."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from torquebench.reports.page import Page, Section, Table, render_page

Schema = Mapping[str, Any]


def reference_page(described: Schema) -> str:
    """Return the OpenAPI description of the API as HTML that needs no other file.

    Parameters
    ----------
    described : mapping
        As of ``/api/v1/openapi.json``.
    """
    schemas = described["components"]["schemas"]
    base = described["servers"][0]["url"]
    groups: dict[str, list[Section]] = {}
    for path, methods in described["paths"].items():
        for method, operation in methods.items():
            section = _operation(f"{method.upper()} {base}{path}", operation, schemas)
            groups.setdefault(operation["tags"][0], []).append(section)
    sections = [Section("", described["info"]["description"])]
    for tag, operations in groups.items():
        sections += [Section(tag.capitalize()), *operations]
    sections.append(Section("Values"))
    sections += [_values(name, each, schemas) for name, each in schemas.items()]
    subtitle = f"torquebench {described['info']['version']} · for programs: {base}/openapi.json"
    return render_page(Page("HTTP API", subtitle, sections))


def _operation(title: str, operation: Schema, schemas: Schema) -> Section:
    """Return an operation with its parameters, its body and its result."""
    rows = [
        _row(each["name"], each["schema"] | each, each["required"])
        for each in operation.get("parameters", ())
    ]
    body = _content(operation.get("requestBody", {}))
    rows += _fields(_resolved(body, schemas)) if body else []
    answers = [
        (status, _type(_content(answer)) or answer["description"])
        for status, answer in operation["responses"].items()
    ]
    blocks = [Table(("answer", "content"), answers, words=True)]
    if rows:
        blocks.insert(0, Table(("parameter", "type", "unit", "meaning"), rows, words=True))
    return Section(title, operation["description"], blocks, detail=True)


def _values(name: str, schema: Schema, schemas: Schema) -> Section:
    """Return a named type with its fields."""
    fields = _fields(_resolved(schema, schemas))
    table = Table(("field", "type", "unit", "meaning"), fields, words=True)
    return Section(name, schema.get("description", ""), (table,) if fields else (), detail=True)


def _fields(schema: Schema) -> list[tuple[str, str, str, str]]:
    required = schema.get("required", ())
    properties = schema.get("properties", {})
    return [_row(name, field, name in required) for name, field in properties.items()]


def _row(name: str, field: Schema, required: bool) -> tuple[str, str, str, str]:
    default = (
        "" if required or "default" not in field else f" Default: {json.dumps(field['default'])}."
    )
    meaning = f"{field.get('description', '')}{default}{'' if required else ' Optional.'}"
    return name, _type(field), str(field.get("x-unit") or field.get("unit", "")), meaning.strip()


def _content(message: Schema) -> Schema:
    return next((each.get("schema", {}) for each in message.get("content", {}).values()), {})


def _resolved(schema: Schema, schemas: Schema) -> Schema:
    name = schema.get("$ref", "").rpartition("/")[2]
    return schemas[name] if name else schema


def _type(schema: Schema) -> str:
    """Return a type in words, with its limits."""
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    for key in ("anyOf", "oneOf", "allOf"):
        if key in schema:
            return " or ".join(dict.fromkeys(map(_type, schema[key])))
    if "enum" in schema:
        return ", ".join(map(str, schema["enum"]))
    if "const" in schema:
        return str(schema["const"])
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {})) or 'values'}"
    return " ".join((str(schema.get("format", schema.get("type", ""))), *_limits(schema))).strip()


def _limits(schema: Schema) -> Iterator[str]:
    signs = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
    for key, sign in signs.items():
        if key in schema:
            yield f"{sign} {schema[key]:g}"
