"""Recorded data as one file: every bit comes back, and what can't be read is named."""

import json
import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from torquebench.chain.torque import Component, by_row
from torquebench.errors import RecordError
from torquebench.records import from_plain, recording_content, recording_file
from torquebench.uncertainty import Distribution


class Kind(StrEnum):
    RAMP = "ramp"


@dataclass(frozen=True, eq=False)
class Part:
    kind: Kind
    torque_nm: NDArray[np.float64]
    number: NDArray[np.int64]
    limit: NDArray[np.float64] | float = math.inf


@dataclass(frozen=True, eq=False)
class Recorded:
    parts: tuple[Part, ...]
    compensated: dict[str, bool]
    temperature_c: float
    serial: str | None = None


@settings(max_examples=30)
@given(
    torque=arrays.arrays(np.float64, arrays.array_shapes(max_dims=2, min_side=0)),
    number=arrays.arrays(np.int64, st.integers(0, 20)),
    temperature=st.floats(),
)
def test_every_bit_comes_back(torque, number, temperature):
    parts = (Part(Kind.RAMP, torque, number), Part(Kind.RAMP, -torque, number, torque))
    content = recording_file(Recorded(parts, {"input": True}, temperature))
    read = from_plain(Recorded, recording_content(content, "recording"), "recording")
    for each, other in zip(parts, read.parts, strict=True):
        assert each.torque_nm.tobytes() == other.torque_nm.tobytes()
        assert each.torque_nm.shape == other.torque_nm.shape
        assert each.number.tobytes() == other.number.tobytes()
        assert other.number.dtype == np.int64
    assert (read.parts[0].limit, read.parts[0].kind) == (math.inf, Kind.RAMP)
    assert read.temperature_c == temperature or math.isnan(temperature)
    assert (read.compensated, read.serial) == ({"input": True}, None)


def test_distributions_by_row_come_back():
    shapes = by_row(np.array([True, False]), Distribution.RECTANGULAR, Distribution.NORMAL)
    component = Component("span over temperature", "loading", np.ones(2), distribution=shapes)
    content = recording_file({"it": component})
    found = from_plain(dict[str, Component], recording_content(content, "x"), "x")["it"]
    assert found.distribution.tolist() == [Distribution.RECTANGULAR, Distribution.NORMAL]
    assert all(isinstance(each, Distribution) for each in found.distribution)


def test_other_programs_read_the_arrays_by_name():
    part = Part(Kind.RAMP, np.array([1.0, np.nan]), np.array([3]))
    table = pq.read_table(pa.BufferReader(recording_file({"ramps": [part]})))
    assert table["name"].to_pylist() == ["ramps/0/torque_nm", "ramps/0/number"]
    assert table["integers"].to_pylist() == [None, [3]]
    assert table["numbers"][0].as_py()[0] == 1.0


@pytest.mark.parametrize("content", [b"", b"PAR1", b"\x00" * 100])
def test_what_is_no_recording_is_named(content):
    with pytest.raises(RecordError, match=r"S-1 isn't a recording"):
        recording_content(content, "S-1")


def test_a_table_of_something_else_and_a_later_format_are_named():
    content = recording_file({"a": 1.0})
    table = pq.read_table(pa.BufferReader(content))
    header = json.loads(table.schema.metadata[b"torquebench.recording"])
    later = {**header, "format": 2, "software_version": "9.0"}
    for said, metadata in (
        ("format 2, written by torquebench 9.0", {"torquebench.recording": json.dumps(later)}),
        ("isn't a recording", {}),
    ):
        sink = pa.BufferOutputStream()
        pq.write_table(table.replace_schema_metadata(metadata), sink)
        with pytest.raises(RecordError, match=said):
            recording_content(sink.getvalue().to_pybytes(), "S-1")


def test_a_value_that_does_not_fit_is_named_with_its_place():
    plain = recording_content(recording_file({"parts": [], "temperature_c": 20.0}), "S-1")
    with pytest.raises(RecordError, match="S-1, compensated: Field required"):
        from_plain(Recorded, plain, "S-1")


@pytest.mark.parametrize("value", [np.zeros(2, dtype=np.float32), object(), {1j}])
def test_what_has_no_place_in_the_file_is_refused(value):
    with pytest.raises(RecordError, match="in torque"):
        recording_file({"torque": value})
