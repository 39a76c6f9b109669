"""Contents of record files: values as JSON, and hashes of files."""

import hashlib
import json
import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, is_dataclass
from datetime import date, datetime
from enum import Enum
from pathlib import Path
from typing import Any

from torquebench.errors import RecordError
from torquebench.message import Message

UNREADABLE = (
    *(ValueError, TypeError, KeyError, IndexError, AttributeError, OverflowError),
    RecursionError,
)
"""Exceptions that damaged content causes: wrong types, missing keys, JSON nested too deeply."""
EDGE_STREAM = "edges.arrow"
"""Recorded edges of an open run."""


def sha256_of_file(path: Path) -> str:
    """Return the SHA-256 of a file's content as 64 hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def json_text(value: Any, *, indent: int | None = None) -> str:
    """Return a value as strict JSON: arrays as lists, dataclasses as objects, NaN as null.

    Parameters
    ----------
    value : object
        Built of mappings, sequences, numbers, text, NumPy values, dates, paths, enumerations,
        dataclasses and pydantic models.
    indent : int, optional
        Indentation; by default everything on one line.

    Raises
    ------
    RecordError
        Where a value can't be written as JSON.

    Examples
    --------
    >>> import numpy as np
    >>> json_text({"torque_nm": np.array([1.5, np.nan]), "settled": np.True_})
    '{"torque_nm": [1.5, null], "settled": true}'
    """
    return json.dumps(plain_json(value), indent=indent, ensure_ascii=False, allow_nan=False)


def with_messages(content: Any) -> Any:
    """Return content as plain JSON, with the template and values of each `Message` in it.

    They are stored in a table ``messages`` by the message's text; the content itself holds the
    text.
    """
    plain = plain_json(content)
    found = {str(each): each.as_plain() for each in _messages(plain)}
    return {**plain, "messages": found} if found and isinstance(plain, dict) else plain


def _messages(plain: Any) -> Iterator[Message]:
    if isinstance(plain, Message):
        yield plain
    elif isinstance(plain, dict | list):
        for each in plain.values() if isinstance(plain, dict) else plain:
            yield from _messages(each)


def revived(content: Any) -> Any:
    """Return a document with its texts turned back into `Message` objects; see `with_messages`."""
    if not isinstance(content, dict) or "messages" not in content:
        return content
    found = {text: Message.restored(each) for text, each in content["messages"].items()}

    def inside(plain: Any) -> Any:
        if isinstance(plain, str):
            return found.get(plain, plain)
        if isinstance(plain, list):
            return [inside(each) for each in plain]
        if isinstance(plain, dict):
            return {name: inside(each) for name, each in plain.items() if name != "messages"}
        return plain

    return inside(content)


def plain_json(value: Any) -> Any:
    """Convert a value to plain lists, mappings, numbers and text, as JSON has them."""
    if isinstance(value, Enum):
        return plain_json(value.value)
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if _is_of("numpy", ("generic", "ndarray"), value):
        return plain_json(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): plain_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain_json(item) for item in value]
    if isinstance(value, datetime | date):
        return value.isoformat()
    if _is_of("pydantic", ("BaseModel",), value):
        return plain_json(value.model_dump(mode="python"))
    if is_dataclass(value) and not isinstance(value, type):
        return plain_json(asdict(value))
    if isinstance(value, Path):
        return str(value)
    raise RecordError(
        Message("a value of type {name} in a record", type(value).__name__),
        "numbers, text, dates, arrays, dataclasses, and lists and mappings of them",
    )


def _is_of(library: str, names: tuple[str, ...], value: Any) -> bool:
    """Return whether a value has one of a library's types, without importing the library."""
    module = sys.modules.get(library)
    return module is not None and isinstance(value, tuple(getattr(module, name) for name in names))


def read_json(path: Path) -> Any:
    """Return the content of a JSON file of a record.

    Raises
    ------
    RecordError
        Where the file is missing or isn't JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise RecordError(Message("{place} is missing", path), "a complete run folder") from error
    except (OSError, ValueError, RecursionError) as error:
        raise RecordError(
            Message("{path} can't be read: {problem}", path, error), "a JSON file in UTF-8"
        ) from error


def read_object(path: Path) -> dict[str, Any]:
    """Return the content of a JSON file that holds an object.

    Raises
    ------
    RecordError
        Where the file is missing or contains something else.
    """
    content = read_json(path)
    if not isinstance(content, dict):
        raise RecordError(
            Message("{path} can't be read: {problem}", path, f"a {type(content).__name__}"),
            "a JSON object",
        )
    return content
