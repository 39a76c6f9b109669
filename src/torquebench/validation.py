"""Validation of documents and requests by pydantic models: TOML files, options, API bodies.

Errors of pydantic become an `InputError`: source, key, value, what is allowed, what to do.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from datetime import UTC, date, datetime, time, timedelta
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin

import annotated_types
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = [
    "ConflictError",
    "allowed_at",
    "as_input_error",
    "choices_at",
    "faults_of",
    "parse_toml",
    "past_moment",
    "refuse_future",
    "validated",
    "words_of",
]

Model = TypeVar("Model", bound=BaseModel)

CLOCK_TOLERANCE = timedelta(minutes=5)
"""Largest difference of two computers' clocks; a time later than that is in the future."""


class ConflictError(PydanticCustomError):
    """A value that is valid by itself but contradicts another value, or physics."""

    def __new__(cls, key: str, found: str, allowed: str, remedy: str = "") -> ConflictError:
        """Return the error with key, value, what is allowed and what to do."""
        return super().__new__(
            cls,
            "conflict",
            "{found}; allowed: {allowed}",
            {"key": key, "found": found, "allowed": allowed, "remedy": remedy},
        )


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse TOML; raises `InputError` with the line."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            Message("{source}: {error}", source, error), "valid TOML", "correct the line named"
        ) from error
    except RecursionError as error:
        raise InputError(
            Message("{source} is nested too deep", source), "TOML of a few levels"
        ) from error


def validated(model: type[Model], values: Mapping[str, Any], source: str) -> Model:
    """Create a model from parsed values.

    Raises
    ------
    InputError
        If keys are wrong; with the first one in detail, and the names of the others.
    """
    try:
        return model.model_validate(dict(values))
    except ValidationError as error:
        raise as_input_error(error.errors(include_url=False), source, model) from error


def faults_of(
    model: type[BaseModel], values: Mapping[str, Any], source: str
) -> dict[str, InputError]:
    """Return an error for every wrong value, by its dotted key; empty if all are right."""
    try:
        model.model_validate(dict(values))
    except ValidationError as error:
        found = {}
        for detail in error.errors(include_url=False):
            key, said, allowed, remedy = _explain(model, detail)
            found[key] = InputError(Message("{source}: {said}", source, said), allowed, remedy)
        return found
    return {}


def allowed_at(model: type[BaseModel], key: str, unit: str = "") -> str:
    """Return the allowed range of numbers at a dotted key of a document; empty for other values.

    `unit` is used for a field that doesn't state its unit.
    """
    field = _field_at(model, key.split("."))
    return _interval(*_constraints(field), unit) if field else ""


def choices_at(model: type[BaseModel], key: str) -> tuple[Any, ...]:
    """Return the choices at a dotted key of a document; empty for other values."""
    field = _field_at(model, key.split("."))
    annotation = _constraints(field)[0] if field else None
    return get_args(annotation) if get_origin(annotation) is Literal else ()


def as_input_error(
    details: Sequence[ErrorDetails], source: str, model: type[BaseModel] | None
) -> InputError:
    """Convert pydantic's errors: the first wrong key, and the names of further ones.

    Parameters
    ----------
    details : sequence of ErrorDetails
        Errors as listed by pydantic or FastAPI.
    source : str
        A file, or the part of a request.
    model : type of BaseModel, optional
        Model of the values; without it, pydantic's own texts are used.
    """
    # A misspelt key explains a missing one, so it comes first.
    order = {"extra_forbidden": 0, "conflict": 2}
    details = sorted(details, key=lambda item: order.get(item["type"], 1))
    first = details[0]
    _, found, allowed, remedy = _explain(model, first)
    others = [_dotted(item["loc"], item) for item in details[1:]]
    if others:
        shown = ", ".join(others[:5]) + (" …" if len(others) > 5 else "")
        remedy = (
            Message("{remedy}; also wrong: {shown}", remedy, shown)
            if remedy
            else Message("also wrong: {list}", shown)
        )
    return InputError(Message("{source}: {found}", source, found), allowed, remedy)


_NAME = "letters, digits, `.`, `_` and `-`, beginning with a letter or a digit"
_COUNTRY = "a country's two capital letters (ISO 3166)"
_OF_PATTERNS: Mapping[str, str] = {
    r"^[A-Za-z0-9][A-Za-z0-9._-]*$": _NAME,
    r"^([A-Za-z0-9][A-Za-z0-9._-]*)?$": _NAME,
    "^[A-Z]{2}$": _COUNTRY,
    "^([A-Z]{2})?$": _COUNTRY,
    "^([0-9a-f]{64})?$": "a SHA-256 of 64 hexadecimal digits",
}
"""What a text must be that doesn't match a pattern."""
_OF_TYPES: Mapping[str, str] = {
    "bool": "true or false",
    "dict": "names with values",
    "finite": "a number",
    "float": "a number",
    "int": "a whole number",
    "path": "a path of a file",
    "string": "text",
    "tuple": "a list",
}
"""What a value must be, by the beginning of pydantic's name of an error."""


def _explain(model: type[BaseModel] | None, detail: ErrorDetails) -> tuple[str, str, str, str]:
    location = detail["loc"]
    key = _dotted(location, detail)
    kind = detail["type"]
    if kind == "conflict":
        context = detail.get("ctx", {})
        said = Message("{key} = {found}", key, context["found"])
        return key, said, context["allowed"], context["remedy"]
    if kind == "extra_forbidden":
        section = _model_at(model, location[:-1])
        known = ", ".join(section.model_fields) if section else ""
        said = Message("{key} is not a key of this section", key)
        return key, said, known, "correct the spelling or remove the line"
    field = _field_at(model, location)
    message = words_of(detail)
    described = _allowed(field) if field and kind != "value_error" else ""
    if kind == "string_pattern_mismatch":
        described = _OF_PATTERNS.get(detail["ctx"]["pattern"], described)
    if kind.endswith(("_type", "_parsing", "_number", "_from_float")):
        described = described or _OF_TYPES.get(kind.partition("_")[0], "")
    if kind == "missing":
        return key, Message("{key} is missing", key), described, "add the key"
    if not key:
        return "", message, "", "correct the values"
    said = Message("{key} = {value}", key, _shown(detail["input"]))
    return key, said, described or message, "correct the value"


def words_of(detail: ErrorDetails) -> str:
    """Return the text of pydantic, or of a validator's ValueError, about a value."""
    error = detail.get("ctx", {}).get("error")
    if isinstance(error, ValueError) and error.args:
        return error.args[0] if isinstance(error.args[0], str) else str(error)
    return detail["msg"].removeprefix("Value error, ")


def _dotted(location: Sequence[int | str], detail: ErrorDetails) -> str:
    parts = [str(part) for part in location if not _is_union_branch(part)]
    if detail["type"] == "conflict" and detail.get("ctx", {}).get("key"):
        parts.append(str(detail["ctx"]["key"]))
    return ".".join(parts)


def _is_union_branch(part: int | str) -> bool:
    return isinstance(part, str) and ("[" in part or part in ("float", "none", "str", "int"))


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "…"


def _model_at(
    model: type[BaseModel] | None, location: Sequence[int | str]
) -> type[BaseModel] | None:
    present = model
    for part in location:
        if present is None or not isinstance(part, str) or part not in present.model_fields:
            return None
        annotation = _without_none(present.model_fields[part].annotation)
        present = (
            annotation
            if isinstance(annotation, type) and issubclass(annotation, BaseModel)
            else None
        )
    return present


def _field_at(model: type[BaseModel] | None, location: Sequence[int | str]) -> FieldInfo | None:
    names = [part for part in location if isinstance(part, str) and not _is_union_branch(part)]
    section = _model_at(model, names[:-1])
    return section.model_fields.get(names[-1]) if section and names else None


def _allowed(field: FieldInfo) -> str:
    """Describe a field's allowed values; empty if pydantic's text is better."""
    annotation, metadata, unit = _constraints(field)
    if get_origin(annotation) is Literal:
        return Message("one of {names}", ", ".join(repr(each) for each in get_args(annotation)))
    if interval := _interval(annotation, metadata, unit):
        return interval
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        required = [n for n, f in annotation.model_fields.items() if f.is_required()]
        return Message("a section with {names}", ", ".join(required))
    return ""


def _interval(annotation: Any, metadata: Sequence[Any], unit: str, otherwise: str = "") -> str:
    """Describe a range of numbers; empty without bounds."""
    if annotation not in (int, float):
        return ""
    above = low = high = ""
    for item in metadata:
        if isinstance(item, annotated_types.Gt):
            above = Message("above {low}", plain_number(item.gt))
        elif isinstance(item, annotated_types.Ge):
            low = plain_number(item.ge)
        elif isinstance(item, annotated_types.Le):
            high = plain_number(item.le)
    if not (above or low or high):
        return ""
    interval = Message.joined((bound for bound in (above or low, high) if bound), " to ")
    if not high and low and not above:
        interval = Message("at least {low}", low)
    elif not (above or low):
        interval = Message("at most {high}", high)
    if unit or otherwise:
        interval = Message("{interval} {unit}", interval, unit or otherwise)
    whole = annotation is int
    return Message("a whole number, {interval}" if whole else "a number, {interval}", interval)


def plain_number(value: Any) -> str:
    """Return a number with separators, without exponent where possible.

    Examples
    --------
    >>> plain_number(1e9), plain_number(2**31), plain_number(1e-06), plain_number(0.5)
    ('1,000,000,000', '2,147,483,648', '0.000001', '0.5')
    >>> plain_number(1e300), plain_number(0)
    ('1e+300', '0')
    """
    number = float(value)
    if number != 0.0 and not 1e-9 <= abs(number) < 1e15:
        return f"{number:g}"
    return f"{number:,.9f}".rstrip("0").rstrip(".")


def _without_none(annotation: Any) -> Any:
    """Return the type of a field that may be None."""
    if get_origin(annotation) not in (Union, UnionType):
        return annotation
    return next(part for part in get_args(annotation) if part is not type(None))


def _constraints(field: FieldInfo) -> tuple[Any, list[Any], str]:
    metadata = list(field.metadata)
    unit = _unit(field)
    annotation = _without_none(field.annotation)
    if get_origin(annotation) is Annotated:
        inner = get_args(annotation)
        annotation = inner[0]
        for item in inner[1:]:
            if isinstance(item, FieldInfo):
                metadata += item.metadata
                unit = unit or _unit(item)
            else:
                metadata.append(item)
    return annotation, metadata, unit


def _unit(field: FieldInfo) -> str:
    """Return the unit of a field; without a separate unit, its description is the unit."""
    extra = field.json_schema_extra
    if isinstance(extra, dict) and "unit" in extra:
        return str(extra["unit"])
    return field.description or ""


def refuse_future(performed: date) -> None:
    """Refuse a day or a time in the future.

    Parameters
    ----------
    performed : datetime.date or datetime.datetime
        Day in the local time zone, or time; without a zone, the time is local.

    Raises
    ------
    InputError
        The day or time is in the future; the message states the present time.

    Examples
    --------
    >>> refuse_future(date(2025, 3, 2))
    >>> refuse_future(datetime(2200, 1, 1, 12, tzinfo=UTC))
    Traceback (most recent call last):
    torquebench.errors.InputError: performed on 2200-01-01 12:00 UTC, in the future; ...
    """
    now = datetime.now().astimezone()
    if isinstance(performed, datetime):
        if performed.astimezone(UTC) <= now + CLOCK_TOLERANCE:
            return
        named, until = _minute(performed), _minute(now)
    else:
        if performed <= now.date():
            return
        named, until = str(performed), str(now.date())
    raise InputError(
        Message("performed on {performed}, in the future", named),
        Message("up to now, {now}", until),
        "correct the day or the time",
    )


def past_moment(performed: date) -> datetime:
    """Return a past day or time as a time in UTC.

    Parameters
    ----------
    performed : datetime.date or datetime.datetime
        A day becomes the same date in UTC, if that day has already begun there; a time without a
        zone is local.

    Raises
    ------
    InputError
        The time is in the future.

    Examples
    --------
    >>> past_moment(date(2025, 3, 2)).isoformat()
    '2025-03-02T00:00:00+00:00'
    """
    refuse_future(performed)
    if isinstance(performed, datetime):
        return performed.astimezone(UTC)
    return min(datetime.combine(performed, time(), UTC), datetime.now(UTC))


def _minute(moment: datetime) -> str:
    zone = moment.astimezone() if moment.tzinfo is None else moment
    return f"{zone:%Y-%m-%d %H:%M %Z}"
