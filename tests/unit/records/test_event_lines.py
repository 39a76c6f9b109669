"""Damage to a run that isn't sealed yet costs what it lies in, and nothing wrong is read."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.errors import RecordError
from torquebench.records import RunFolder
from torquebench.records.runs.event_lines import checked_line, read_lines

POINTS = 12


def torque(number: int) -> float:
    return 1192.0 + number / 7.0


@pytest.fixture(scope="module")
def open_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that was killed after its last point: metadata, start, descriptor, points, samples."""
    runs = tmp_path_factory.mktemp("open") / "runs"
    bench = {"name": "Bench 1", "range_nm": 2000.0}
    writer = RunFolder.create(runs, {"operator": "Änne", "bench": bench}, kind="calibrate-output")
    writer("start", {"uid": "s", "range_nm": 2000.0, "time": 1.0})
    writer("descriptor", {"uid": "d", "name": "points"})
    for number in range(POINTS):
        data = {"point-series": 1, "point-step": number, "reading_nm": torque(number)}
        writer("event", {"descriptor": "d", "data": data})
        writer.samples({"time_s": np.arange(4) + 4.0 * number})
        writer._raw.flush()
    writer.close()
    return writer.path


def points(folder: RunFolder) -> dict[int, float]:
    streams = {each["uid"] for _, each in folder.documents("descriptor")}
    events = [each for _, each in folder.documents("event") if each["descriptor"] in streams]
    return {each["data"]["point-step"]: each["data"]["reading_nm"] for each in events}


def lines_with_a_byte(content: bytes, offset: int) -> set[int]:
    """Return the number of the line that a byte lies in; none of a line feed."""
    if content[offset : offset + 1] == b"\n":
        return set()
    return {content[:offset].count(b"\n") + 1}


def damaged_copy(source: Path, to: Path, name: str, content: bytes) -> RunFolder:
    folder = to / source.name
    shutil.copytree(source, folder)
    (folder / name).write_bytes(content)
    return RunFolder.open(folder)


FIRST_POINT_LINE = 4  # metadata, start, descriptor before it


@settings(max_examples=20)
@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
@pytest.mark.parametrize("name", ["run.json", "events.jsonl", "copies.jsonl", "raw.arrow"])
def test_a_flipped_bit_costs_the_point_that_it_lies_in(
    open_run: Path, tmp_path_factory: pytest.TempPathFactory, name: str, place: float, bit: int
) -> None:
    content = bytearray((open_run / name).read_bytes())
    offset = int(place * len(content))
    hit = lines_with_a_byte(bytes(content), offset) if name == "events.jsonl" else set()
    content[offset] ^= 1 << bit
    folder = damaged_copy(open_run, tmp_path_factory.mktemp("bit"), name, bytes(content))
    whole = {
        number: torque(number) for number in range(POINTS) if number + FIRST_POINT_LINE not in hit
    }
    for _ in ("as it was found", "recovered"):
        assert points(folder) == whole
        assert folder.metadata["bench"]["range_nm"] == 2000.0
        assert folder.metadata["operator"] == "Änne"
        start = next(each for _, each in folder.documents("start"))
        assert start["range_nm"] == 2000.0
        lost = {
            line for each in folder.damages for line in range(each.first_line, each.last_line + 1)
        }
        assert lost == {line for line in hit if line >= FIRST_POINT_LINE}
        if not folder.sealed:
            folder.recover()
            folder.verify()
    time_s = folder.raw().columns.get("time_s", np.zeros(0))
    if name != "raw.arrow":
        np.testing.assert_array_equal(time_s, np.arange(4.0 * POINTS))


@settings(max_examples=12)
@given(kept=st.floats(0.0, 1.0), zeros=st.sampled_from([0, 0, 1, 600]))
@pytest.mark.parametrize("name", ["run.json", "events.jsonl", "copies.jsonl", "raw.arrow"])
def test_a_cut_file_costs_what_was_behind_the_cut(
    open_run: Path, tmp_path_factory: pytest.TempPathFactory, name: str, kept: float, zeros: int
) -> None:
    whole = (open_run / name).read_bytes()
    content = whole[: int(kept * len(whole))]
    folder = damaged_copy(open_run, tmp_path_factory.mktemp("cut"), name, content + bytes(zeros))
    folder.recover()
    folder.verify()
    assert folder.metadata["bench"]["range_nm"] == 2000.0
    expected = {number: torque(number) for number in range(POINTS)}
    if name == "events.jsonl":
        ends = content.count(b"\n") + (whole[len(content) : len(content) + 1] == b"\n")
        expected = {n: torque(n) for n in range(POINTS) if n + FIRST_POINT_LINE <= ends}
    assert points(folder) == expected


@settings(max_examples=20)
@given(
    place=st.floats(0.0, 0.9),
    garbage=st.one_of(st.binary(max_size=900), st.integers(1, 900).map(bytes)),
)
def test_overwritten_bytes_in_the_middle_cost_only_what_they_cover(
    open_run: Path, tmp_path_factory: pytest.TempPathFactory, place: float, garbage: bytes
) -> None:
    whole = (open_run / "events.jsonl").read_bytes()
    offset = int(place * len(whole))
    content = whole[:offset] + garbage + whole[offset + len(garbage) :]
    same = [number for number, line in enumerate(whole.splitlines(), start=1) if line in content]
    folder = damaged_copy(open_run, tmp_path_factory.mktemp("garbage"), "events.jsonl", content)
    folder.recover()
    expected = [number for number in range(POINTS) if number + FIRST_POINT_LINE in same]
    assert points(folder) == {number: torque(number) for number in expected}


@given(
    first=st.integers(min_value=0), bit=st.integers(0, 7), cut=st.integers(min_value=0) | st.none()
)
def test_no_flipped_bit_and_no_cut_gives_another_line_or_costs_a_whole_one(
    open_run: Path, first: int, bit: int, cut: int | None
) -> None:
    whole = (open_run / "events.jsonl").read_bytes()
    lines = {line.number: line for line in read_lines(whole, open_run.name).lines}
    content = bytearray(whole)
    offset = first % len(content)
    content[offset] ^= 1 << bit
    end = len(content) if cut is None else cut % len(content)
    hit = lines_with_a_byte(whole, offset)
    read = read_lines(bytes(content[:end]), open_run.name)
    ends = {number: whole.index(line.text) + len(line.text) for number, line in lines.items()}
    assert {line.number: line for line in read.lines} == {
        number: line for number, line in lines.items() if number not in hit and ends[number] <= end
    }


def test_a_changed_digit_is_refused_and_the_damage_is_named_and_kept(
    open_run: Path, tmp_path: Path
) -> None:
    content = (open_run / "events.jsonl").read_bytes().replace(b": 1192.0}", b": 1092.0}")
    folder = damaged_copy(open_run, tmp_path, "events.jsonl", content)
    assert sorted(points(folder)) == list(range(1, POINTS))
    assert [str(each)[:14] for each in folder.damages] == ["line 4 damaged"]
    recovery = folder.recover()
    assert recovery == folder.recovery
    assert recovery.damages == folder.damages
    assert recovery.damaged_files == ("events.jsonl",)
    assert (folder.path / "events.jsonl.damaged").read_bytes() == content
    assert set(folder.manifest["files"]) >= {"events.jsonl", "events.jsonl.damaged"}


def test_metadata_that_is_damaged_twice_is_named(open_run: Path, tmp_path: Path) -> None:
    folder = damaged_copy(open_run, tmp_path, "run.json", b"{}")
    for name in ("events.jsonl", "copies.jsonl"):
        file = folder.path / name
        file.write_bytes(file.read_bytes().replace(b"Bench 1", b"Bench 2"))
    with pytest.raises(RecordError, match=r"run\.json is damaged, and so is its copy"):
        _ = folder.metadata
    assert "run.json" in folder.recover().damaged_files
    assert len(points(folder)) == POINTS


def test_a_stream_that_cannot_be_read_keeps_no_run_open(open_run: Path, tmp_path: Path) -> None:
    folder = damaged_copy(open_run, tmp_path, "raw.arrow", b"no stream of samples at all")
    assert folder.recover().damaged_files == ("raw.arrow",)
    folder.verify()
    assert len(points(folder)) == POINTS
    assert (folder.path / "raw.arrow.damaged").read_bytes() == b"no stream of samples at all"


def test_a_recovery_that_was_interrupted_still_knows_the_damage(
    open_run: Path, tmp_path: Path
) -> None:
    content = (open_run / "events.jsonl").read_bytes().replace(b": 1192.0}", b": 1092.0}")
    first = damaged_copy(open_run, tmp_path / "a", "events.jsonl", content)
    first.recover()
    second = damaged_copy(open_run, tmp_path / "b", "events.jsonl.damaged", content)
    cleaned = (first.path / "events.jsonl").read_bytes()
    (second.path / "events.jsonl").write_bytes(cleaned)
    assert second.recover() == first.recovery


def test_a_line_of_another_run_is_not_taken_for_one_of_this() -> None:
    document: dict[str, Any] = {"data": {"reading_nm": 5.0}}
    own = [checked_line("run-1", number, "event", document) for number in (1, 2, 3)]
    other = checked_line("run-2", 2, "event", document)
    read = read_lines(own[0] + other + own[2], "run-1")
    assert [line.number for line in read.lines] == [1, 3]
    assert [str(each) for each in read.damages] == [
        f"line 2 damaged ({len(other) - 1} bytes from byte {len(own[0]) - 1} on)"
    ]
    assert "missing" in str(read_lines(own[0] + own[2], "run-1").damages[0])


def test_a_document_may_look_like_a_line() -> None:
    inner = checked_line("run-1", 1, "event", {}).decode()
    document = {"line": 7, "name": "event", "text": inner, "more": json.loads(inner)}
    content = checked_line("run-1", 1, "event", {"data": document})
    (line,) = read_lines(content, "run-1").lines
    assert line.document == {"data": document}
