"""Kinds of fields that requests have: a number is no text, and a yes is no number."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

from pydantic import BeforeValidator, Field, Strict

__all__ = ["WHOLE", "Flag", "Identifier", "Number", "ProfileName"]


def _whole(value: Any) -> Any:
    """Let 20.0 pass for 20, as JSON does, but neither text nor true."""
    if isinstance(value, bool | str | bytes):
        raise ValueError("a whole number")  # noqa: TRY004 - pydantic passes TypeErrors on
    return value


Flag: TypeAlias = Annotated[bool, Strict()]
Number: TypeAlias = Annotated[float, Strict()]
WHOLE = BeforeValidator(_whole)
"""Put it last: constraints before it stay in the schema."""
Identifier: TypeAlias = Annotated[int, Field(ge=1, le=2**53), WHOLE]
"""Number of a record."""
ProfileName: TypeAlias = Annotated[
    str, Field(min_length=1, max_length=64, pattern=r"^[a-z0-9][a-z0-9.-]*$")
]
"""Of a profile or a kind of model: never a path."""
