"""Types of request fields: strict about numbers, text and booleans."""

from __future__ import annotations

import re
from datetime import date, datetime
from typing import Annotated, Any, TypeAlias

from pydantic import (
    AfterValidator,
    AwareDatetime,
    BeforeValidator,
    Field,
    Strict,
    WithJsonSchema,
)

from torquebench.compensation.kinds import MODEL_NAMES, MODELS, NETWORKS

__all__ = [
    "WHOLE",
    "Day",
    "Flag",
    "Identifier",
    "ModelName",
    "Moment",
    "Number",
    "ProfileName",
    "RunId",
    "plain",
]


def _whole(value: Any) -> Any:
    """Accept 20.0 as 20, as JSON does, but neither text nor booleans."""
    if isinstance(value, bool | str | bytes):
        raise ValueError("a whole number")  # noqa: TRY004 - pydantic passes TypeErrors on
    return value


def _in_words(moment: Any) -> Any:
    """Refuse seconds since 1970, which look like a typing mistake."""
    if not re.match(r"\d{4}-\d{2}-\d{2}[T ]", str(moment)):
        raise ValueError("a time such as 2026-01-31T12:00:00Z")
    return moment


def _day_in_words(day: Any) -> Any:
    """Refuse seconds since 1970 for a day, too."""
    if not re.fullmatch(r"\d{4}-\d{2}-\d{2}", str(day)):
        raise ValueError("a day such as 2026-01-31")
    return day


def _of_our_time(moment: datetime) -> datetime:
    """Refuse years that databases can't convert to another time zone."""
    if not 1900 <= moment.year <= 2900:
        raise ValueError("a moment between 1900 and 2900")
    return moment


def _known_model(name: str) -> str:
    if name not in MODEL_NAMES:
        raise ValueError(
            "one of " + ", ".join((*MODELS, *NETWORKS, "polynomial-1 to polynomial-30"))
        )
    return name


Flag: TypeAlias = Annotated[bool, Strict()]
Number: TypeAlias = Annotated[float, Strict()]
WHOLE = BeforeValidator(_whole)
"""Put it last: constraints before it stay in the schema."""
Identifier: TypeAlias = Annotated[int, Field(ge=1, le=2**53), WHOLE]
"""Number of a record."""
Moment: TypeAlias = Annotated[
    AwareDatetime, BeforeValidator(_in_words), AfterValidator(_of_our_time)
]
"""Time with its time zone, as text."""
Day: TypeAlias = Annotated[date, BeforeValidator(_day_in_words)]
"""Day as text."""
ProfileName: TypeAlias = Annotated[
    str, Field(min_length=1, max_length=64, pattern=r"^[a-z0-9][a-z0-9.-]*$")
]
"""Name of a profile or a reducer: never a path."""
ModelName: TypeAlias = Annotated[
    str,
    Field(max_length=64),
    AfterValidator(_known_model),
    WithJsonSchema({"type": "string", "enum": list(MODEL_NAMES)}),
]
"""Kind of a model."""
RunId: TypeAlias = Annotated[str, Field(max_length=100, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
"""Identifier of a run: never a path."""


def plain(text: str, longest: int) -> str:
    r"""Return a text of one line without control characters.

    Examples
    --------
    >>> plain("smoke\x1b[2J\nand fire", 200)
    'smoke [2J and fire'
    """
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:longest]
