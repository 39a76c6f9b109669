"""Conversion of fitted values to JSON-ready values and back without loss."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np

from torquebench.errors import InputError
from torquebench.message import Message

_STORABLE: dict[str, type] = {}
_Class = TypeVar("_Class", bound=type)


def storable(cls: _Class) -> _Class:
    """Let a dataclass be part of a model's state.

    Parameters
    ----------
    cls : type
        Dataclass whose fields are themselves values that `encode_value` takes.

    Returns
    -------
    cls : type
        Unchanged.
    """
    _STORABLE[cls.__name__] = cls
    return cls


def encode_value(value: Any) -> Any:
    """Convert a fitted value to one that JSON stores without loss.

    Parameters
    ----------
    value : None, bool, int, float, str, array, list, tuple, dict or storable dataclass
        Value to be stored. Floats keep all their bits: JSON's shortest form reads back to the same
        double.

    Raises
    ------
    TypeError
        When a value of another type is part of a model: a defect of that model.

    Examples
    --------
    >>> encode_value(np.array([0.1, 0.2]))
    {'array': 'float64', 'shape': [2], 'values': [0.1, 0.2]}
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else {"float": repr(value)}
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "fiub":
            raise TypeError(f"array of type {value.dtype} in a model's state")
        values = [encode_value(item) for item in value.ravel().tolist()]
        return {"array": str(value.dtype), "shape": list(value.shape), "values": values}
    if isinstance(value, list):
        return [encode_value(item) for item in value]
    if isinstance(value, tuple):
        return {"tuple": [encode_value(item) for item in value]}
    if isinstance(value, Mapping):
        return {"dict": {str(key): encode_value(item) for key, item in value.items()}}
    if is_dataclass(value) and type(value).__name__ in _STORABLE:
        content = {field.name: encode_value(getattr(value, field.name)) for field in fields(value)}
        return {"record": type(value).__name__, "content": content}
    raise TypeError(f"value of type {type(value).__name__} in a model's state")


def decode_value(encoded: Any) -> Any:
    """Convert the result of `encode_value` back.

    Parameters
    ----------
    encoded : None, bool, int, float, str, list or dict
        As from `encode_value`.

    Raises
    ------
    InputError
        When the content isn't of a known form.

    Examples
    --------
    >>> decode_value(encode_value((1.5, "up", float("inf"))))
    (1.5, 'up', inf)
    """
    if isinstance(encoded, list):
        return [decode_value(item) for item in encoded]
    if not isinstance(encoded, dict):
        return encoded
    if "array" in encoded:
        values = [decode_value(item) for item in encoded["values"]]
        return np.array(values, dtype=encoded["array"]).reshape(encoded["shape"])
    if "float" in encoded:
        return float(encoded["float"])
    if "tuple" in encoded:
        return tuple(decode_value(item) for item in encoded["tuple"])
    if "dict" in encoded:
        return {key: decode_value(item) for key, item in encoded["dict"].items()}
    if encoded.get("record") in _STORABLE:
        content = {key: decode_value(item) for key, item in encoded["content"].items()}
        return _STORABLE[encoded["record"]](**content)
    raise InputError(
        Message("model content with keys {encoded}", sorted(encoded)),
        "the forms that this version of torquebench writes",
        "fit the model again",
    )
