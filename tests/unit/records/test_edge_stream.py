import json
import subprocess
import sys
import textwrap
import tracemalloc
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from torquebench.errors import RecordError
from torquebench.records import RunFolder
from torquebench.records.edges.archive import read_edges, seal_edges
from torquebench.records.edges.codec import EncodedEdges, decode_edges, encode_edges
from torquebench.records.edges.stream import _SCHEMA, EdgeStream, damage_to, stream_edges
from torquebench.records.files import EDGE_STREAM
from torquebench.signals import EdgeBlock

TIMEBASE_HZ = 100e6
int64 = st.integers(np.iinfo(np.int64).min, np.iinfo(np.int64).max)


def pulse_train(duration_s: float, seed: int = 1, frequency_hz: float = 60e3) -> np.ndarray:
    """Edges with 5 ns of jitter whose frequency follows a torque that swings by half its range."""
    draw = np.random.default_rng(seed)
    number = np.arange(round(1.5 * duration_s * frequency_hz))
    swing = 0.25 * np.sin(2.0 * np.pi * 0.3 * number / frequency_hz + seed)
    time_s = np.cumsum(1.0 / (frequency_hz * (1.0 + swing)))
    time_s = time_s[time_s < duration_s] + draw.normal(0.0, 5e-9, np.sum(time_s < duration_s))
    return np.floor(time_s * TIMEBASE_HZ).astype(np.int64)


def cut(ticks: np.ndarray, start: int, stop: int) -> EdgeBlock:
    inside = slice(*np.searchsorted(ticks, (start, stop)))
    return EdgeBlock(ticks[inside], start, stop, TIMEBASE_HZ)


@st.composite
def damaged_trains(draw: st.DrawFn) -> np.ndarray:
    """Pulse trains with pulses missing, doubled, a silence, a jump of the clock."""
    count = draw(st.integers(0, 300))
    period = draw(st.integers(2, 7000))
    jitter = draw(hnp.arrays(np.int64, count, elements=st.integers(-3, 3)))
    ticks = draw(st.integers(0, 2**62)) + period * np.arange(count) + jitter
    for fault in draw(st.lists(st.sampled_from(["missing", "doubled", "gap", "jump"]), max_size=4)):
        if ticks.size < 2:
            break
        place = draw(st.integers(0, ticks.size - 2))
        if fault == "missing":
            ticks = np.delete(ticks, slice(place, place + draw(st.integers(1, 20))))
        elif fault == "doubled":
            ticks = np.insert(ticks, place + 1, ticks[place] + 1)
        else:
            jump = draw(st.integers(1, 2**60 if fault == "jump" else 2**32))
            ticks = np.concatenate((ticks[:place], ticks[place:] + jump))
    return ticks


@given(damaged_trains())
def test_trains_with_faults_come_back_to_the_tick(ticks: np.ndarray) -> None:
    np.testing.assert_array_equal(decode_edges(encode_edges(ticks)), ticks)


@given(hnp.arrays(np.int64, st.integers(0, 40), elements=int64))
def test_any_integers_come_back(ticks: np.ndarray) -> None:
    np.testing.assert_array_equal(decode_edges(encode_edges(ticks)), ticks)


@pytest.mark.parametrize(("count", "escaped"), [(4, []), (3, [5])])
def test_parts_that_do_not_fit_together_are_refused(count: int, escaped: list[int]) -> None:
    parts = EncodedEdges(
        count, 1, 1, np.zeros(1, dtype=np.int8), np.asarray(escaped, dtype=np.int64)
    )
    with pytest.raises(RecordError, match="escapes"):
        decode_edges(parts)


@settings(max_examples=20)
@given(
    train=damaged_trains().filter(
        lambda ticks: ticks.size > 0 and bool((np.diff(ticks) > 0).all())
    ),
    cuts=st.lists(st.floats(0.0, 1.0), max_size=5),
)
def test_streams_and_archives_keep_trains_however_they_are_cut(
    tmp_path_factory: pytest.TempPathFactory, train: np.ndarray, cuts: list[float]
) -> None:
    folder = tmp_path_factory.mktemp("edges")
    first, end = int(train[0]), int(train[-1]) + 1
    borders = [first, *sorted(first + int(place * (end - first)) for place in cuts), end]
    stream = EdgeStream(folder / EDGE_STREAM)
    for start, stop in pairwise(borders):
        stream.append({"a": cut(train, start, stop)})
        stream.flush()
    stream.close()
    assert stream.acknowledged_tick == borders[-1]
    for _ in range(2):
        recorded = list(read_edges(folder))
        assert [each.block.stop_tick for each in recorded] == borders[1:]
        np.testing.assert_array_equal(np.concatenate([e.block.ticks for e in recorded]), train)
        seal_edges(folder)


def test_an_hour_of_four_transducers_takes_well_under_two_gigabytes(tmp_path: Path) -> None:
    trains = {f"channel {seed}": pulse_train(1.0, seed) for seed in range(4)}
    step = round(0.05 * TIMEBASE_HZ)
    with RunFolder.create(tmp_path, {}, kind="size") as writer:
        for start in range(0, round(TIMEBASE_HZ), step):
            writer.edges({name: cut(train, start, start + step) for name, train in trains.items()})
        writer.close()
        edges = sum(train.size for train in trains.values())
        hour = 4 * 60e3 * 3600
        assert (writer.path / EDGE_STREAM).stat().st_size / edges * hour < 0.4e9
    folder = writer.folder
    folder.verify()
    assert set(folder.manifest["files"]) >= {"edges.parquet"}
    assert (writer.path / "edges.parquet").stat().st_size / edges * hour < 0.5e9
    for name, train in trains.items():
        found = [each.block.ticks for each in folder.edges() if each.channel == name]
        np.testing.assert_array_equal(np.concatenate(found), train)


def test_any_tool_reads_the_ticks_of_a_sealed_run(tmp_path: Path) -> None:
    with RunFolder.create(tmp_path, {}, kind="plain") as writer:
        writer.edges({"a": EdgeBlock(np.array([5, 9, 20]), 0, 30, TIMEBASE_HZ)})
        writer.edges({"a": EdgeBlock(np.array([], dtype=np.int64), 30, 60, TIMEBASE_HZ)})
    rows = pq.read_table(writer.path / "edges.parquet").to_pylist()
    assert [row["rising_ticks"] for row in rows] == [[5, 9, 20], []]
    assert [row["stop_tick"] for row in rows] == [30, 60]


def test_a_stream_of_edges_cut_anywhere_gives_whole_blocks(tmp_path: Path) -> None:
    stream = EdgeStream(tmp_path / "whole.arrow")
    sizes, header = [], _SCHEMA.serialize().size
    for number in range(3):
        ticks = np.arange(10, dtype=np.int64) * 7 + number * 100
        stream.append({"a": EdgeBlock(ticks, number * 100, (number + 1) * 100, TIMEBASE_HZ)})
        stream.flush()
        sizes.append((tmp_path / "whole.arrow").stat().st_size)
    content = (tmp_path / "whole.arrow").read_bytes()
    cut_file = tmp_path / "cut.arrow"
    for size in range(0, len(content), 97):
        cut_file.write_bytes(content[:size])
        blocks = sum(size >= each for each in sizes)
        assert len(list(stream_edges(cut_file))) == blocks
        assert (damage_to(cut_file)[0] > 0) == (size not in (0, header, *sizes))
    stream.close()


def test_memory_stays_bounded_over_many_blocks(tmp_path: Path) -> None:
    train = pulse_train(0.5)
    step = round(0.05 * TIMEBASE_HZ)
    stream = EdgeStream(tmp_path / EDGE_STREAM)
    block = cut(train, 0, step)

    def record(blocks: int) -> None:
        for _ in range(blocks):
            stream.append(dict.fromkeys("abcd", block))

    record(400)
    tracemalloc.start()
    record(100)
    early = tracemalloc.get_traced_memory()[1]
    tracemalloc.reset_peak()
    record(900)
    late = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    stream.close()
    waiting = 1_000_000  # edges of one byte: the most that waits for the disk
    assert late < early + 2 * waiting


FULL_DISK = """
    import json, resource, sys
    import numpy as np
    from pathlib import Path
    from torquebench.errors import RecordError
    from torquebench.records import RunFolder
    from torquebench.signals import EdgeBlock

    writer = RunFolder.create(Path(sys.argv[1]), {}, kind="full", run_id="full")
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
    draw = np.random.default_rng(1)
    failed = None
    for index in range(10_000):
        start = index * 10_000
        ticks = np.sort(draw.choice(10_000, 2000, replace=False)) + start
        rows = {"x": draw.normal(size=500), "index": np.full(500, index)}
        try:
            if sys.argv[2] == "edges":
                writer.edges({"a": EdgeBlock(ticks, start, start + 10_000, 1e8)})
                writer._edges.flush()
            else:
                writer.samples(rows)
                writer._raw.flush()
        except RecordError as error:
            failed = str(error)
            break
    try:
        writer.edges({}) if sys.argv[2] == "edges" else writer.samples(rows)
    except RecordError as error:
        after = str(error)
    print(json.dumps([failed, after, writer.acknowledged_tick, writer.acknowledged_rows]))
"""


@pytest.mark.parametrize("kind", ["edges", "samples"])
def test_a_full_disk_is_an_error_and_leaves_only_whole_blocks(tmp_path: Path, kind: str) -> None:
    script = textwrap.dedent(FULL_DISK)
    arguments = [sys.executable, "-c", script, str(tmp_path), kind]
    child = subprocess.run(arguments, capture_output=True, text=True, check=True)
    failed, after, tick, rows = json.loads(child.stdout)
    assert "can't be written" in failed
    assert "make room on the disk" in failed
    assert "is closed" in after
    folder = RunFolder.open(tmp_path / "full")
    report = folder.recover()
    assert report.torn_edge_bytes == report.torn_raw_bytes == 0
    if kind == "edges":
        blocks = [each.block for each in folder.edges()]
        assert [block.start_tick for block in blocks] == list(range(0, tick, 10_000))
        assert tick > 0
    else:
        assert folder.raw().rows == rows > 0
