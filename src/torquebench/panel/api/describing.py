"""The API's OpenAPI description, derived from docstrings, with units, roles and examples."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from torquebench.columns import column_of
from torquebench.operations import OPERATIONS, Role, json_schemas, parameters
from torquebench.panel.api.problems import ProblemDetails
from torquebench.panel.service.settings.store import SettingsStore
from torquebench.units import unit_of_name

ROLES: dict[str, Role] = {
    "switch_off": "metrologist",
    "reopen": "administrator",
    "users": "administrator",
    "add_user": "administrator",
    "change_user": "administrator",
    "clients": "administrator",
    "add_client": "administrator",
    "revoke_client": "administrator",
    "log": "metrologist",
    "change": "metrologist",
    "delete": "metrologist",
    "undo": "metrologist",
    **{each.key.replace("-", "_"): each.role for each in OPERATIONS.values() if each.served},
}
"""Minimum role of some operations; the others are open to every signed-in caller."""
WORDS = {
    "active": "Whether it is in use.",
    "allowed": "What would have been allowed, with its limit and unit.",
    "bench": "Name of the bench.",
    "bench_clear": "Confirms that nobody is at the bench and that it may be loaded.",
    "calibration_id": "Number of a registered calibration.",
    "certificate": "Number of a certificate.",
    "counter_identity": "Identity of the counter that measured the chain's frequency.",
    "created": "When, UTC.",
    "detail": "Value found and value allowed, or the quantity that wasn't measured.",
    "due": "Last day of the certificate's validity.",
    "finished": "When it ended, UTC; null before its end.",
    "found": "What was found, with its value and unit.",
    "high": "Highest value within each row, by signal.",
    "job_id": "Identifier of a job.",
    "kind": "Kind, for programs.",
    "languages": "Languages of the certificate.",
    "low": "Lowest value within each row, by signal.",
    "measured_by": "Who measured it.",
    "doubts": "Reasons for doubt: an expired standard, a wrong clock, impossible times.",
    "metrics": "Quality of the fit, stored when it was fitted.",
    "model_id": "Number of a registered model.",
    "model_ids": "Numbers of the models by their names.",
    "models": "Kinds of models, such as hybrid, radial-basis or polynomial-2.",
    "operator": "Who did it.",
    "password": "Password of the person; only its argon2id hash is stored.",
    "performed": "When it was measured.",
    "points": "How many points.",
    "profile": "Name of a calibration profile.",
    "quick": (
        "Whether it has fewer points, for a first impression without verdicts against a data sheet."
    ),
    "reason": "Reason, as text; it is stored.",
    "reducer": "Name of a reducer's description.",
    "remark": "As text; it is stored.",
    "remarks": "Further information, as text.",
    "remedy": "What to do about it.",
    "repeats": "Repeats of the staircase, or largest number of repeats of a running test.",
    "rising_only": "Whether only rising torque is measured.",
    "role": "operator, metrologist or administrator; each has the rights of those before it.",
    "run_id": "Identifier of a run.",
    "run_ids": "Identifiers of runs.",
    "serial": "Serial number of the specimen.",
    "side": "Which module of the bench: input or output.",
    "sides": "Which modules of the bench.",
    "simulated": "Whether the values come from a simulated bench; label them simulated then.",
    "off": "Which corrections are left out.",
    "record": "Source of its values.",
    "started": "When, UTC.",
    "started_by": "Who started it.",
    "summary": "Its main figures.",
    "title": "Title as text.",
    "token": "A secret, shown only once.",
    "transducer_serial": "Serial number of the transducer.",
    "unit": "Unit of the values.",
    "unlock": "Ends the pause after wrong passwords.",
    "version": "Version of the edited document; refused if it was changed in the meantime.",
}
"""Meanings of field names without a more specific docstring."""
COLUMNS = (
    "branch",
    "error_nm",
    "expanded_uncertainty_nm",
    "group",
    "reading_nm",
    "series",
    "standard_nm",
    "time_s",
    "zero_nm",
)
"""Field names that always mean a column of a table."""

WITH_PASSWORD = frozenset(
    {
        *("set_up", "sign_in", "change_password"),
        *(each.key.replace("-", "_") for each in OPERATIONS.values() if each.signable),
    }
)
OPEN = frozenset({"set_up", "sign_in"})

EXAMPLES: dict[str, dict[str, Any]] = {
    "SwitchBody": {"off": ["hysteresis"], "reason": "a comparison without it"},
    "StopBody": {"reason": "a noise from the clamp"},
    "AbortBody": {"reason": "the wrong reducer is mounted"},
    "LeaseBody": {"force": False},
    "QueuedRequest": {"name": "zero", "request": {"sides": ["input"]}},
    "QueuePlaceBody": {"place": 0},
    "QueueStartBody": {"bench_clear": False, "keep_going": False},
    "AnswerBody": {"done": True},
    "ClientBody": {"name": "plant-historian", "role": "operator"},
    "UserBody": {"name": "Ana Kim", "role": "metrologist", "password": "three long words"},
    "DocumentBody": {
        "document": {"output": {"limits": {"torque_nm": 2100.0}}},
        "reason": "a stiffer coupling",
        "version": 3,
    },
}

_SECTION = re.compile(r"\n\s*(Parameters|Attributes)\n\s*-+\n")
_NEXT = re.compile(r"\n\s*(Parameters|Attributes|Returns|Raises|Examples|Notes)\n\s*-+\n")


def describe(api: FastAPI) -> dict[str, Any]:
    """Return the OpenAPI description of the API."""
    found = get_openapi(
        title=api.title,
        version=api.version,
        description=api.description,
        routes=api.routes,
        servers=api.servers,
    )
    schemas: dict[str, Any] = found["components"]["schemas"]
    schemas["ProblemDetails"] = ProblemDetails.model_json_schema()
    results = {each.key: each.result for each in OPERATIONS.values() if each.served}
    references, of_results = json_schemas(list(dict.fromkeys(results.values())))
    for name, schema in of_results.items():
        schemas.setdefault(name, schema)
    schemas["JobView"]["properties"]["result"] = {
        "description": "Result of its operation, once it is done.",
        "anyOf": [*references.values(), {"type": "null"}],
    }
    for each in OPERATIONS.values():
        if each.quick and each.served:
            answers = found["paths"][f"/operations/{each.key}"]["post"]["responses"]
            answers["200"]["content"]["application/json"]["schema"] = references[each.result]
    for name, schema in schemas.items():
        _describe_schema(schema)
        if name in EXAMPLES:
            schema["examples"] = [EXAMPLES[name]]
    for path in found["paths"].values():
        for operation in path.values():
            _describe_operation(operation)
    return found


def name_choices(described: dict[str, Any], settings: SettingsStore) -> None:
    """Add the names of the present profiles and reducers to a description."""
    schemas = described["components"]["schemas"]
    for each in OPERATIONS.values():
        for parameter in parameters(each.request):
            schema = schemas.get(each.request.__name__)
            if parameter.names not in ("", "models") and schema is not None:
                field = schema["properties"][parameter.name]
                text = field.get("anyOf", [field])[0]  # the alternative is null
                text["enum"] = list(settings.names(parameter.names))


def _describe_operation(operation: dict[str, Any]) -> None:
    name = operation["operationId"]
    words = operation.get("description", "")
    if name not in OPEN:
        role = ROLES.get(name, "operator")
        operation["x-role"] = role
        operation["description"] = f"{words}\n\nRole: {role} or above.".strip()
    answers = operation["responses"]
    if name not in WITH_PASSWORD:
        del answers["429"]
    if "requestBody" not in operation:
        del answers["400"], answers["413"]


def _describe_schema(schema: dict[str, Any]) -> None:
    words = schema.get("description", "")
    said = dict(_said(words))
    if words:
        schema["description"] = _SECTION.split(words)[0].strip()
    for name, value in schema.get("properties", {}).items():
        if value.get("default") == math.inf:  # which JSON doesn't have
            del value["default"]
        if name in said and "description" not in value:
            value["description"] = said[name]
        if name in WORDS:
            value.setdefault("description", WORDS[name])
        if name in COLUMNS:
            value.setdefault("description", column_of(name).sentence)
        unit = unit_of_name(name)
        if unit:
            value["x-unit"] = unit
            value.setdefault("description", f"In {unit}.")


def _said(words: str) -> Iterator[tuple[str, str]]:
    """Yield the description of each parameter in a docstring.

    Examples
    --------
    >>> words = '''One.
    ...
    ... Parameters
    ... ----------
    ... first, second : float
    ...     What they are, N·m;
    ...     and why.
    ... '''
    >>> dict(_said(words))
    {'first': 'What they are, N·m; and why.', 'second': 'What they are, N·m; and why.'}
    """
    parts = _SECTION.split(words)
    for section in parts[2::2]:
        names: list[str] = []
        lines: list[str] = []
        for line in [*_NEXT.split(section)[0].splitlines(), "end :"]:
            head = re.fullmatch(r"\s*([a-z_]+(?:, [a-z_]+)*) :.*", line)
            if head is None:
                lines.append(line.strip())
                continue
            text = " ".join(each for each in lines if each)
            yield from ((name, text) for name in names if text)
            names, lines = head[1].split(", "), []
