"""Sparkplug B payloads: metrics with type, time, quality and properties, encoded as bytes.

The field numbers are those of the Sparkplug 3.0.0 specification, chapter 6. Data sets, templates
and arrays are neither written nor read: a payload with them is decoded without their values.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["DataType", "Metric", "Payload", "Quality", "Value", "decode", "encode"]

Value = bool | int | float | str | None


class DataType(IntEnum):
    """Types of a value, with their numbers on the wire."""

    INT8 = 1
    INT16 = 2
    INT32 = 3
    INT64 = 4
    UINT8 = 5
    UINT16 = 6
    UINT32 = 7
    UINT64 = 8
    FLOAT = 9
    DOUBLE = 10
    BOOLEAN = 11
    STRING = 12
    DATE_TIME = 13
    TEXT = 14
    UUID = 15


class Quality(IntEnum):
    """Values of the property `Quality`: whether a metric's value can be used."""

    BAD = 0
    GOOD = 192
    STALE = 500


@dataclass(frozen=True)
class Metric:
    """A metric: one value with name, time and properties.

    Parameters
    ----------
    name : str
        Empty in data messages, which use the alias.
    alias : int or None
    timestamp : int or None
        When the value was measured, ms since 1970, UTC.
    datatype : DataType or None
        Type, sent in births only.
    value : bool, int, float, str or None
        None is sent as null.
    historical : bool
        Whether the value was stored while there was no connection.
    properties : mapping of str to value
        Such as ``{"Quality": 192, "engUnit": "N·m"}``.
    """

    name: str = ""
    alias: int | None = None
    timestamp: int | None = None
    datatype: DataType | None = None
    value: Value = None
    historical: bool = False
    properties: Mapping[str, bool | int | float | str] = field(default_factory=dict)


@dataclass(frozen=True)
class Payload:
    """Content of one message.

    Parameters
    ----------
    metrics : tuple of Metric
    timestamp : int or None
        When it was sent, ms since 1970, UTC.
    seq : int or None
        Number of the message in its session, 0 to 255; None in the node's death.
    """

    metrics: tuple[Metric, ...]
    timestamp: int | None = None
    seq: int | None = None


_PROTO = descriptor_pb2.FieldDescriptorProto
_TYPES = {
    "uint32": _PROTO.TYPE_UINT32,
    "uint64": _PROTO.TYPE_UINT64,
    "float": _PROTO.TYPE_FLOAT,
    "double": _PROTO.TYPE_DOUBLE,
    "bool": _PROTO.TYPE_BOOL,
    "string": _PROTO.TYPE_STRING,
    "bytes": _PROTO.TYPE_BYTES,
}
_VALUES = (
    *("int_value uint32", "long_value uint64", "float_value float", "double_value double"),
    *("boolean_value bool", "string_value string"),
)


def _numbered(first: int, *fields: str) -> dict[int, str]:
    return dict(enumerate(fields, first))


_MESSAGES: dict[str, tuple[dict[int, str], dict[int, str]]] = {  # fields, and fields of the value
    "Payload": (
        _numbered(1, "timestamp uint64", "metrics Metric*", "seq uint64", "uuid string")
        | {5: "body bytes"},
        {},
    ),
    "Metric": (
        _numbered(1, "name string", "alias uint64", "timestamp uint64", "datatype uint32")
        | _numbered(5, "is_historical bool", "is_transient bool", "is_null bool")
        | {9: "properties PropertySet"},
        _numbered(10, *_VALUES) | {16: "bytes_value bytes"},
    ),
    "PropertySet": (_numbered(1, "keys string*", "values PropertyValue*"), {}),
    "PropertyValue": (_numbered(1, "type uint32", "is_null bool"), _numbered(3, *_VALUES)),
}


@functools.cache
def _payload_class() -> Any:
    """Return the class of encoded payloads; its pool is separate from other libraries'."""
    file = descriptor_pb2.FileDescriptorProto(
        name="torquebench/sparkplug.proto", package="torquebench.sparkplug", syntax="proto2"
    )
    for name, (fields, values) in _MESSAGES.items():
        message = file.message_type.add(name=name)
        if values:
            message.oneof_decl.add(name="value")
        for number, text in sorted((fields | values).items()):
            key, kind = text.split()
            repeated, kind = kind.endswith("*"), kind.rstrip("*")
            label = _PROTO.LABEL_REPEATED if repeated else _PROTO.LABEL_OPTIONAL
            added = message.field.add(name=key, number=number, label=label)
            if kind in _TYPES:
                added.type = _TYPES[kind]
            else:
                added.type = _PROTO.TYPE_MESSAGE
                added.type_name = f".{file.package}.{kind}"
            if number in values:
                added.oneof_index = 0
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    found = pool.FindMessageTypeByName(f"{file.package}.Payload")
    return message_factory.GetMessageClass(found)


_BITS = {DataType.INT8: 8, DataType.INT16: 16, DataType.INT32: 32, DataType.INT64: 64}
_UNSIGNED = {
    DataType.UINT8: 8,
    DataType.UINT16: 16,
    DataType.UINT32: 32,
    DataType.UINT64: 64,
    DataType.DATE_TIME: 64,
}
_FIELDS = {
    DataType.FLOAT: "float_value",
    DataType.DOUBLE: "double_value",
    DataType.BOOLEAN: "boolean_value",
}


def encode(payload: Payload, types: Mapping[int, DataType] | None = None) -> bytes:
    """Return the bytes of a payload.

    Parameters
    ----------
    payload : Payload
    types : mapping of alias to DataType, optional
        Types of metrics without a type of their own.

    Raises
    ------
    InputError
        A value doesn't fit its type, or its type isn't known.

    Examples
    --------
    >>> rpm = Metric(alias=3, timestamp=1_700_000_000_000, value=-2.5)
    >>> sent = encode(Payload((rpm,), seq=7), {3: DataType.DOUBLE})
    >>> received = decode(sent)
    >>> received.seq, received.metrics[0].alias, received.metrics[0].value
    (7, 3, -2.5)
    """
    known = types or {}
    message = _payload_class()()
    if payload.timestamp is not None:
        message.timestamp = payload.timestamp
    if payload.seq is not None:
        message.seq = payload.seq
    for metric in payload.metrics:
        _encode_metric(message.metrics.add(), metric, known)
    return bytes(message.SerializeToString())


def _encode_metric(found: Any, metric: Metric, types: Mapping[int, DataType]) -> None:
    if metric.name:
        found.name = metric.name
    if metric.alias is not None:
        found.alias = metric.alias
    if metric.timestamp is not None:
        found.timestamp = metric.timestamp
    if metric.datatype is not None:
        found.datatype = metric.datatype
    if metric.historical:
        found.is_historical = True
    for key, value in metric.properties.items():
        found.properties.keys.append(key)
        part = found.properties.values.add()
        kind = _property_type(value)
        part.type = kind
        _put(part, kind, value, f"property {key}")
    if metric.value is None:
        found.is_null = True
        return
    datatype = metric.datatype
    if datatype is None and metric.alias is not None:
        datatype = types.get(metric.alias)
    if datatype is None:
        raise InputError(
            Message("metric {name} without a type", metric.name or metric.alias), "a data type"
        )
    _put(found, datatype, metric.value, f"metric {metric.name or metric.alias}")


def _property_type(value: bool | int | float | str) -> DataType:
    if isinstance(value, bool):
        return DataType.BOOLEAN
    if isinstance(value, int):
        return DataType.INT32
    return DataType.DOUBLE if isinstance(value, float) else DataType.STRING


def _put(place: Any, datatype: DataType, value: Value, what: str) -> None:
    try:
        if datatype in _FIELDS:
            setattr(place, _FIELDS[datatype], value)
            return
        if datatype not in _BITS and datatype not in _UNSIGNED:
            place.string_value = value
            return
        bits = _BITS.get(datatype) or _UNSIGNED[datatype]
        lowest = -(1 << (bits - 1)) if datatype in _BITS else 0
        if not isinstance(value, int) or not lowest <= value < lowest + (1 << bits):
            raise ValueError(f"{value!r} is no {datatype.name}")
        # A negative number is sent as its two's complement, short types in 32 bits.
        if bits == 64:
            place.long_value = value % (1 << 64)
        else:
            place.int_value = value % (1 << 32)
    except (TypeError, ValueError) as error:
        raise InputError(
            Message("{what}: {error}", what, error),
            Message("a value of type {name}", datatype.name),
        ) from error


def decode(data: bytes, types: Mapping[int, DataType] | None = None) -> Payload:
    """Return the decoded payload; values of unsupported kinds are None.

    Parameters
    ----------
    data : bytes
    types : mapping of alias to DataType, optional
        Types from the birth, which tell signed from unsigned numbers of metrics without a type.

    Raises
    ------
    InputError
        The bytes aren't a payload.
    """
    message = _payload_class()()
    try:
        message.ParseFromString(data)
    except DecodeError as error:
        raise InputError(
            Message("{count} bytes: {error}", len(data), error), "a Sparkplug B payload"
        ) from error
    return Payload(
        tuple(_decode_metric(found, types or {}) for found in message.metrics),
        message.timestamp if message.HasField("timestamp") else None,
        message.seq if message.HasField("seq") else None,
    )


def _decode_metric(found: Any, types: Mapping[int, DataType]) -> Metric:
    alias = found.alias if found.HasField("alias") else None
    stated = _datatype(found.datatype) if found.HasField("datatype") else None
    datatype = stated or (types.get(alias) if alias is not None else None)
    parts = zip(found.properties.keys, found.properties.values, strict=False)
    taken = ((key, _take(part, _datatype(part.type))) for key, part in parts)
    return Metric(
        found.name,
        alias,
        found.timestamp if found.HasField("timestamp") else None,
        stated,
        None if found.is_null else _take(found, datatype),
        found.is_historical,
        {key: value for key, value in taken if value is not None},
    )


def _datatype(number: int) -> DataType | None:
    try:
        return DataType(number)
    except ValueError:
        return None


def _take(place: Any, datatype: DataType | None) -> Value:
    key = place.WhichOneof("value")
    if key is None or key == "bytes_value":
        return None
    value: Value = getattr(place, key)
    if datatype in _BITS and isinstance(value, int):
        bits = _BITS[datatype]
        value = (value + (1 << (bits - 1))) % (1 << bits) - (1 << (bits - 1))
    return value
