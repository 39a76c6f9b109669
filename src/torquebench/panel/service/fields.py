"""Kinds of fields that requests have: a number is no text, and a yes is no number."""

from __future__ import annotations

import re
from typing import Annotated, Any, TypeAlias

from pydantic import AwareDatetime, BeforeValidator, Field, Strict, ValidationError

__all__ = ["WHOLE", "Flag", "Identifier", "Moment", "Number", "ProfileName", "words_of"]


def _whole(value: Any) -> Any:
    """Let 20.0 pass for 20, as JSON does, but neither text nor true."""
    if isinstance(value, bool | str | bytes):
        raise ValueError("a whole number")  # noqa: TRY004 - pydantic passes TypeErrors on
    return value


def _in_words(moment: Any) -> Any:
    """Refuse seconds since 1970, which nobody can tell from a typing mistake."""
    if not re.match(r"\d{4}-\d{2}-\d{2}[T ]", str(moment)):
        raise ValueError("a moment as in 2026-01-31T12:00:00Z")
    return moment


Flag: TypeAlias = Annotated[bool, Strict()]
Number: TypeAlias = Annotated[float, Strict()]
WHOLE = BeforeValidator(_whole)
"""Put it last: constraints before it stay in the schema."""
Identifier: TypeAlias = Annotated[int, Field(ge=1, le=2**53), WHOLE]
"""Number of a record."""
Moment: TypeAlias = Annotated[AwareDatetime, BeforeValidator(_in_words)]
"""With its time zone, in words."""
ProfileName: TypeAlias = Annotated[
    str, Field(min_length=1, max_length=64, pattern=r"^[a-z0-9][a-z0-9.-]*$")
]
"""Of a profile or a kind of model: never a path."""


def words_of(error: ValidationError) -> str:
    """Say in words what is wrong with a request: its first complaint."""
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"]) or "the request"
    return f"{place}: {first['msg']}"
