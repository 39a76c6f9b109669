"""File contents: JSON of values, and hashes."""

import hashlib
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from datetime import date, datetime
from enum import Enum
from pathlib import Path
from typing import Any

from torquebench.errors import RecordError

__all__ = ["EDGE_STREAM", "json_text", "read_json", "sha256_of_file"]


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
        Where a value has no place in JSON.

    Examples
    --------
    >>> import numpy as np
    >>> json_text({"torque_nm": np.array([1.5, np.nan]), "settled": np.True_})
    '{"torque_nm": [1.5, null], "settled": true}'
    """
    return json.dumps(_plain(value), indent=indent, ensure_ascii=False, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return _plain(value.value)
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if _is_of("numpy", ("generic", "ndarray"), value):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [_plain(item) for item in value]
    if isinstance(value, datetime | date):
        return value.isoformat()
    if _is_of("pydantic", ("BaseModel",), value):
        return _plain(value.model_dump(mode="python"))
    if is_dataclass(value) and not isinstance(value, type):
        return _plain(asdict(value))
    if isinstance(value, Path):
        return str(value)
    raise RecordError(
        f"a value of type {type(value).__name__} in a record",
        "numbers, text, dates, arrays, dataclasses, and lists and mappings of them",
    )


def _is_of(library: str, names: tuple[str, ...], value: Any) -> bool:
    """Return whether a value has a library's types, without importing the library."""
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
        raise RecordError(f"{path} is missing", "a complete run folder") from error
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise RecordError(f"{path} can't be read: {error}", "a JSON file in UTF-8") from error
