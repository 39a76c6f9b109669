"""Recorded data of a run as one Parquet file: arrays as columns, other values as JSON metadata."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from torquebench import __version__
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.uncertainty import Distribution
from torquebench.validation import words_of

RECORDING = "recording.parquet"
"""Name of the file in a run's folder."""
FORMAT = 1
"""Format number; increased when an older version couldn't read the file correctly."""

_HEADER = b"torquebench.recording"
_ARRAY, _SHAPES = "array", "distributions"
"""Keys that mark the JSON placeholder of an array: the name of its column, or its distributions."""
Kind = TypeVar("Kind")


def recording_file(value: Any) -> bytes:
    """Return a value as the content of a Parquet file, with all numbers bit for bit.

    Parameters
    ----------
    value : object
        Built of dataclasses, pydantic models, mappings, sequences, numbers, text, enumerations, and
        arrays of float64 and int64.

    Raises
    ------
    RecordError
        Where a value can't be stored in the file.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    arrays: dict[str, np.ndarray[Any, Any]] = {}
    plain = _plain(value, "", arrays)
    header = {"format": FORMAT, "software_version": __version__, "content": plain}
    columns = {
        "name": pa.array(list(arrays), pa.string()),
        "shape": pa.array([each.shape for each in arrays.values()], pa.list_(pa.int64())),
        "numbers": _column(arrays, np.dtype(np.float64), pa.float64()),
        "integers": _column(arrays, np.dtype(np.int64), pa.int64()),
    }
    table = pa.table(columns).replace_schema_metadata(
        {_HEADER: json.dumps(header, ensure_ascii=False, allow_nan=False)}
    )
    sink = io.BytesIO()
    pq.write_table(
        table,
        sink,
        compression="zstd",
        use_dictionary=False,
        column_encoding={
            "name": "PLAIN",
            "shape.list.element": "PLAIN",
            # This encoding stores bytes of equal significance together, which saves a third of the
            # size.
            "numbers.list.element": "BYTE_STREAM_SPLIT",
            "integers.list.element": "DELTA_BINARY_PACKED",
        },
    )
    return sink.getvalue()


def recording_content(content: bytes, origin: str) -> Any:
    """Read the content written by `recording_file`: mappings, lists, numbers, text and arrays.

    Numbers that aren't finite are text (``"nan"``), because JSON can't express them; `from_plain`
    converts them.

    Parameters
    ----------
    origin : str
        Name of the file in messages.

    Raises
    ------
    RecordError
        Where the content isn't a recording, or has a later format.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(io.BytesIO(content))
        header = json.loads((table.schema.metadata or {})[_HEADER])
        written, number = header["software_version"], header["format"]
    except (pa.ArrowException, KeyError, TypeError, ValueError) as error:
        raise RecordError(
            Message("{origin} isn't a recording: {error}", origin, error),
            "the file as it was sealed",
        ) from error
    if number != FORMAT:
        raise RecordError(
            Message(
                "{origin} has format {number}, written by torquebench {written}",
                origin,
                number,
                written,
            ),
            Message("format {format}", FORMAT),
            Message("use torquebench {written} or newer", written),
        )
    arrays = {}
    for row, name in enumerate(table["name"].to_pylist()):
        column = "numbers" if table["numbers"][row].is_valid else "integers"
        values = table[column][row].values.to_numpy(zero_copy_only=False)
        arrays[name] = values.reshape(table["shape"][row].as_py())
    return _filled(header["content"], arrays)


def from_plain(kind: type[Kind] | Any, plain: Any, origin: str) -> Kind:
    """Convert a part of `recording_content` to a value of a type.

    Parameters
    ----------
    kind : type
        A dataclass with type hints, or another type that pydantic supports.
    origin : str
        Name of the file in messages.

    Raises
    ------
    RecordError
        Where the content doesn't match the type.
    """
    model = create_model(
        "Recorded", __config__=ConfigDict(arbitrary_types_allowed=True), value=(kind, ...)
    )
    try:
        found: Kind = dict(model(value=plain))["value"]
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"][1:])
        raise RecordError(
            Message("{origin}, {place}: {msg}", origin, place, words_of(first)),
            "the values that this version evaluates",
            "evaluate it with the version that recorded it",
        ) from error
    return found


def _plain(value: Any, name: str, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    if isinstance(value, np.ndarray):
        if value.dtype == object and all(isinstance(each, Distribution) for each in value.flat):
            return {_SHAPES: value.tolist()}
        if value.dtype not in (np.float64, np.int64):
            raise RecordError(
                Message("an array of {dtype} in {name}", value.dtype, name), "float64 or int64"
            )
        arrays[name] = value
        return {_ARRAY: name}
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Enum):
        value = value.value
    if isinstance(value, float) and not math.isfinite(value):
        return str(float(value))
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if is_dataclass(value) and not isinstance(value, type):
        value = {each.name: getattr(value, each.name) for each in fields(value)}
    below = f"{name}/" if name else ""
    if isinstance(value, Mapping):
        return {str(key): _plain(each, f"{below}{key}", arrays) for key, each in value.items()}
    if isinstance(value, Sequence):
        return [_plain(each, f"{below}{place}", arrays) for place, each in enumerate(value)]
    raise RecordError(
        Message("a value of type {kind} in {name}", type(value).__name__, name),
        "numbers, text, arrays",
    )


def _column(arrays: Mapping[str, Any], kind: np.dtype[Any], arrow: Any) -> Any:
    import pyarrow as pa

    values = [each.ravel() if each.dtype == kind else None for each in arrays.values()]
    return pa.array(values, pa.list_(arrow))


def _filled(plain: Any, arrays: Mapping[str, Any]) -> Any:
    if isinstance(plain, dict):
        if plain.keys() == {_ARRAY}:
            return arrays[plain[_ARRAY]]
        if plain.keys() == {_SHAPES}:
            return np.array([Distribution(each) for each in plain[_SHAPES]], dtype=object)
        return {key: _filled(each, arrays) for key, each in plain.items()}
    if isinstance(plain, list):
        return [_filled(each, arrays) for each in plain]
    return plain
