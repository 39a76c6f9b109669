"""Sparkplug payloads are decoded as they were encoded, also by an independent description."""

import contextlib
import struct
from typing import Any

import pytest
from esio_spb_builder.core import sparkplug_b_pb2 as foreign
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench_sparkplug.payload import DataType, Metric, Payload, decode, encode

NUMBERS = st.integers(0, 2**64 - 1)
TEXTS = st.text(st.characters(codec="utf-8"), max_size=30)


def _single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


def _whole(bits: int, signed: bool) -> st.SearchStrategy[int]:
    low = -(2 ** (bits - 1)) if signed else 0
    return st.integers(low, low + 2**bits - 1)


VALUES: dict[DataType, st.SearchStrategy[Any]] = {
    **{DataType[f"INT{bits}"]: _whole(bits, True) for bits in (8, 16, 32, 64)},
    **{DataType[f"UINT{bits}"]: _whole(bits, False) for bits in (8, 16, 32, 64)},
    DataType.FLOAT: st.floats(width=32, allow_nan=False).map(_single),
    DataType.DOUBLE: st.floats(allow_nan=False),
    DataType.BOOLEAN: st.booleans(),
    DataType.DATE_TIME: NUMBERS,
    **dict.fromkeys((DataType.STRING, DataType.TEXT, DataType.UUID), TEXTS),
}
PROPERTIES = st.dictionaries(
    TEXTS, st.booleans() | _whole(32, True) | st.floats(allow_nan=False) | TEXTS, max_size=3
)


@st.composite
def metrics(draw: st.DrawFn) -> Metric:
    datatype = draw(st.sampled_from(list(DataType)))
    return Metric(
        draw(TEXTS),
        draw(st.none() | NUMBERS),
        draw(st.none() | NUMBERS),
        datatype,
        draw(st.none() | VALUES[datatype]),
        draw(st.booleans()),
        draw(PROPERTIES),
    )


PAYLOADS = st.builds(
    Payload, st.lists(metrics(), max_size=4).map(tuple), st.none() | NUMBERS, st.none() | NUMBERS
)


@settings(max_examples=50, deadline=None)
@given(PAYLOADS)
def test_a_payload_comes_back(payload: Payload) -> None:
    assert decode(encode(payload)) == payload


@settings(max_examples=50, deadline=None)
@given(PAYLOADS)
def test_a_foreign_library_reads_the_same(payload: Payload) -> None:
    data = encode(payload)
    found = foreign.Payload()
    found.ParseFromString(data)
    assert found.HasField("seq") == (payload.seq is not None)
    for metric, own in zip(found.metrics, payload.metrics, strict=True):
        assert (metric.name, metric.datatype) == (own.name, own.datatype)
        assert metric.is_null == (own.value is None)
        assert metric.is_historical == own.historical
        assert list(metric.properties.keys) == list(own.properties)
        if own.value is not None:
            sent = getattr(metric, metric.WhichOneof("value"))
            bits = 64 if metric.WhichOneof("value") == "long_value" else 32
            assert sent == (own.value % 2**bits if type(own.value) is int else own.value)
    assert decode(found.SerializeToString()) == payload


@settings(deadline=None)
@given(st.binary(max_size=200))
def test_any_bytes_are_a_payload_or_an_error(data: bytes) -> None:
    with contextlib.suppress(InputError):
        assert isinstance(decode(data), Payload)


def test_kinds_of_values_that_are_not_read_are_none() -> None:
    sent = foreign.Payload()
    sent.metrics.add(name="table", datatype=foreign.DataSet).dataset_value.num_of_columns = 2
    sent.metrics.add(name="file", datatype=foreign.File, bytes_value=b"abc")
    found = decode(sent.SerializeToString()).metrics
    assert [(metric.name, metric.value) for metric in found] == [("table", None), ("file", None)]


@pytest.mark.parametrize(
    ("datatype", "value"),
    [(DataType.INT8, 128), (DataType.UINT32, -1), (DataType.DOUBLE, "x"), (DataType.STRING, 3)],
)
def test_a_value_that_does_not_fit_is_refused(datatype: DataType, value: Any) -> None:
    with pytest.raises(InputError, match="metric a"):
        encode(Payload((Metric("a", datatype=datatype, value=value),)))


def test_a_value_without_a_known_type_is_refused() -> None:
    with pytest.raises(InputError, match="without a type"):
        encode(Payload((Metric(alias=3, value=1.0),)), {4: DataType.DOUBLE})
