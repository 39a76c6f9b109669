import json
import signal
import stat
import subprocess
import sys
import time
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError, RecordError
from torquebench.records import RunFolder, new_run_id
from torquebench.records.edges import archive
from torquebench.records.streams import raw_stream
from torquebench.records.streams.raw_stream import RawStream, read_raw
from torquebench.signals import EdgeBlock


@pytest.fixture
def runs(tmp_path):
    return tmp_path / "runs"


def block(start, n=5):
    time_s = 0.01 * np.arange(start, start + n)
    return {
        "time_s": time_s,
        "input_torque_nm": np.sin(time_s),
        "input_fault": np.zeros(n, dtype=np.uint8),
        "calibrating": True,
    }


def written(runs, **options):
    writer = RunFolder.create(runs, {"operator": "Ana"}, kind="calibrate-output", **options)
    writer("start", {"uid": "1", "time": 1.0})
    for number in range(3):
        writer("event", {"seq_num": number, "data": {"reading_nm": np.float64(number)}})
        writer.samples(block(5 * number))
    writer("stop", {"exit_status": "success"})
    return writer


def test_a_sealed_run_locks_what_was_written(runs):
    writer = written(runs)
    writer.write_results({"worst_nm": np.float64(0.5), "points": np.arange(3)})
    folder = writer.seal()
    assert folder.sealed
    folder.verify()
    again = RunFolder.open(folder.path)
    assert again.run_id == folder.path.name
    assert again.metadata["operator"] == "Ana"
    assert again.metadata["kind"] == "calibrate-output"
    assert again.metadata["software_version"]
    assert [name for name, _ in again.documents()] == ["start", "event", "event", "event", "stop"]
    events = [document["data"]["reading_nm"] for _, document in again.documents("event")]
    assert events == [0.0, 1.0, 2.0]
    assert again.results == {"worst_nm": 0.5, "points": [0, 1, 2]}
    raw = again.raw()
    assert (raw.rows, raw.torn_bytes) == (15, 0)
    np.testing.assert_array_equal(raw.columns["time_s"], 0.01 * np.arange(15))
    assert raw.columns["input_fault"].dtype == np.uint8
    assert raw.columns["calibrating"].all()
    assert again.manifest["status"] == "completed"
    assert set(again.manifest["files"]) == {
        "run.json",
        "events.jsonl",
        "raw.parquet",
        "results.json",
    }


def test_a_running_folder_can_be_read(runs):
    writer = written(runs)
    folder = RunFolder.open(writer.path)
    assert not folder.sealed
    assert len(list(folder.documents())) == 5
    assert folder.results is None
    with pytest.raises(RecordError, match="isn't sealed"):
        folder.verify()
    writer.close()
    assert folder.raw().rows == 15


def test_a_run_without_samples_or_results(runs):
    folder = RunFolder.create(runs, {}, kind="zero").seal("aborted", "operator")
    folder.verify()
    assert folder.raw().rows == 0
    assert (folder.manifest["status"], folder.manifest["reason"]) == ("aborted", "operator")


def test_leaving_the_block_seals_with_what_happened(runs):
    with RunFolder.create(runs, {}, kind="zero", run_id="good") as writer:
        writer("start", {})
    assert writer.folder.manifest["status"] == "completed"
    with (
        pytest.raises(RuntimeError),
        RunFolder.create(runs, {}, kind="zero", run_id="bad") as writer,
    ):
        raise RuntimeError("drive tripped")
    manifest = writer.folder.manifest
    assert (manifest["status"], manifest["reason"]) == ("failed", "RuntimeError: drive tripped")


def test_nothing_is_written_after_sealing(runs):
    writer = written(runs)
    writer.seal()
    with pytest.raises(RecordError, match="is closed"):
        writer("event", {})
    with pytest.raises(RecordError, match="is closed"):
        writer.samples(block(0))
    with pytest.raises(RecordError, match="is closed"):
        writer.write_results({})
    with pytest.raises(RecordError, match="is sealed"):
        writer.seal()
    with pytest.raises(RecordError, match="is sealed"):
        writer.folder.recover()


def test_runs_are_never_overwritten(runs):
    written(runs, run_id="one").seal()
    with pytest.raises(RecordError, match="one exists"):
        RunFolder.create(runs, {}, kind="zero", run_id="one")


def test_a_changed_removed_or_added_file_is_named(runs):
    folder = written(runs).seal()
    events = folder.path / "events.jsonl"
    content = events.read_bytes()
    events.write_bytes(content.replace(b'"reading_nm": 1.0', b'"reading_nm": 1.5'))
    with pytest.raises(RecordError, match=r"events\.jsonl was changed after sealing"):
        folder.verify()
    events.unlink()
    with pytest.raises(RecordError, match=r"events\.jsonl was removed after sealing"):
        folder.verify()
    events.write_bytes(content)
    folder.verify()
    (folder.path / "notes.txt").write_text("nothing", encoding="utf-8")
    with pytest.raises(RecordError, match=r"notes\.txt was added after sealing"):
        folder.verify()


def test_a_broken_document_inside_a_sealed_run_is_named(runs):
    writer = written(runs)
    writer.seal()
    events = writer.path / "events.jsonl"
    lines = events.read_bytes().split(b"\n")
    events.write_bytes(b"\n".join([lines[0], b"{broken", *lines[1:]]))
    with pytest.raises(RecordError, match=r"events\.jsonl, line 2 isn't a document"):
        list(RunFolder.open(writer.path).documents())


def test_no_run_and_no_manifest_are_named(tmp_path):
    with pytest.raises(RecordError, match="no run in"):
        RunFolder.open(tmp_path)
    with pytest.raises(RecordError, match=r"manifest\.json is missing"):
        _ = RunFolder(tmp_path).manifest


@pytest.mark.parametrize("cut", [1, 7, 30])
def test_a_torn_last_document_is_left_out_and_reported(runs, cut):
    writer = written(runs)
    writer.close()
    events = writer.path / "events.jsonl"
    content = events.read_bytes()
    last = len(content.split(b"\n")[-2]) + 1
    events.write_bytes(content[:-cut])
    folder = RunFolder.open(writer.path)
    complete = 5 if cut == 1 else 4
    assert len(list(folder.documents())) == complete
    recovery = folder.recover()
    assert (recovery.documents, recovery.raw_rows) == (complete, 15)
    assert recovery.torn_document_bytes == (0 if cut == 1 else last - cut)
    folder.verify()
    assert folder.manifest["status"] == "interrupted"
    assert len(list(folder.documents())) == complete


def test_a_torn_last_block_of_samples_is_left_out_and_reported(runs):
    writer = RunFolder.create(runs, {}, kind="measure")
    stream = RawStream(writer.path / "raw.arrow")
    for number in range(4):
        stream.append(block(5 * number))
        stream.flush()
    file = writer.path / "raw.arrow"
    whole = file.read_bytes()
    writer.close()
    file.write_bytes(whole[:-20])
    raw = RunFolder.open(writer.path).raw()
    assert raw.rows == 15
    assert raw.torn_bytes > 0
    recovery = RunFolder.open(writer.path).recover()
    assert recovery.raw_rows == 15
    assert recovery.torn_raw_bytes == raw.torn_bytes
    assert RunFolder.open(writer.path).raw().rows == 15
    stream.close()


@given(cut=st.integers(0, 3000))
def test_a_stream_cut_anywhere_gives_whole_blocks(tmp_path_factory, cut):
    folder = tmp_path_factory.mktemp("cut")
    stream = RawStream(folder / "raw.arrow")
    for number in range(3):
        stream.append(block(5 * number))
        stream.flush()
    stream.close()
    content = (folder / "raw.arrow").read_bytes()
    (folder / "raw.arrow").write_bytes(content[:cut])
    raw = read_raw(folder)
    assert raw.rows in (0, 5, 10, 15)
    if raw.rows:
        np.testing.assert_array_equal(raw.columns["time_s"], 0.01 * np.arange(raw.rows))


def test_a_file_that_is_no_stream_is_named(tmp_path):
    (tmp_path / "raw.arrow").write_bytes(b"this is no stream of samples")
    with pytest.raises(RecordError, match="can't be read"):
        read_raw(tmp_path)


def test_samples_of_a_channel_with_a_fault_are_sealed_as_they_are(runs):
    writer = RunFolder.create(runs, {}, kind="measure")
    writer.samples({"frequency_hz": np.array([60000.0, np.nan]), "fault": np.array([0, 1])})
    folder = writer.seal()
    folder.verify()
    np.testing.assert_array_equal(folder.raw().columns["frequency_hz"], [60000.0, np.nan])


@pytest.mark.parametrize("module", [raw_stream, archive])
def test_a_sealing_that_fails_leaves_the_stream_and_no_part(runs, monkeypatch, module):
    writer = written(runs)
    writer.edges({"a": EdgeBlock(np.array([5, 9, 20]), 0, 30, 100e6)})
    writer.close()
    before = sorted(path.name for path in writer.path.iterdir())
    seal, compare = {
        raw_stream: (raw_stream.seal_raw, "_same"),
        archive: (archive.seal_edges, "_same_blocks"),
    }[module]
    with monkeypatch.context() as patched:
        patched.setattr(module, compare, lambda *_tables: False)
        with pytest.raises(RecordError, match="differs from"):
            seal(writer.path)
    assert sorted(path.name for path in writer.path.iterdir()) == before
    seal(writer.path)
    sealed = next(writer.path.glob("*.parquet"))
    assert stat.S_IMODE(sealed.stat().st_mode) == 0o600


def test_samples_keep_their_columns(runs):
    writer = RunFolder.create(runs, {}, kind="measure")
    writer.samples(block(0))
    with pytest.raises(RecordError, match="as at the start of the run"):
        writer.samples({"time_s": np.zeros(2)})
    with pytest.raises(RecordError, match="as at the start of the run"):
        writer.samples({**block(0), "input_torque_nm": np.zeros(5, dtype=np.int64)})
    with pytest.raises(RecordError, match="lengths"):
        writer.samples({**block(0), "input_torque_nm": np.zeros(4)})
    writer.close()


def test_other_files_of_a_run_have_plain_names(runs):
    writer = RunFolder.create(runs, {}, kind="measure")
    assert writer.write_file("calibration.csv", "reading_nm\n").read_text() == "reading_nm\n"
    for name in ("../x", "run.json", "events.jsonl", "manifest.json"):
        with pytest.raises(InputError, match="file name"):
            writer.write_file(name, "")
    folder = writer.seal()
    assert "calibration.csv" in folder.manifest["files"]


def test_values_without_a_place_in_json_are_named(runs):
    writer = RunFolder.create(runs, {}, kind="measure")
    with pytest.raises(RecordError, match="type object"):
        writer("event", {"data": object()})
    writer("event", {"data": {"reading_nm": float("nan")}})
    assert list(writer.folder.documents()) == [("event", {"data": {"reading_nm": None}})]
    writer.close()


def test_identifiers_sort_by_time_and_differ():
    moment = datetime(2025, 1, 31, 12, 0, tzinfo=UTC)
    one, two = new_run_id("verify", moment), new_run_id("zero", moment.replace(hour=13))
    assert one.startswith("20250131T120000Z-verify-")
    assert one < two
    with pytest.raises(InputError, match="kind of run"):
        new_run_id("../verify")


WRITER = """
import sys, time, pathlib
import numpy as np
from torquebench.records import RunFolder
writer = RunFolder.create(pathlib.Path(sys.argv[1]), {}, kind="measure", run_id="killed")
number = 0
while True:
    writer.samples({"time_s": np.arange(5) + 5.0 * number, "torque_nm": np.full(5, 1.5)})
    writer("event", {"seq_num": number})
    print(number, flush=True)
    number += 1
    time.sleep(0.001)
"""


def test_a_killed_process_loses_no_acknowledged_point_and_less_than_a_second_of_samples(runs):
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(runs)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    acknowledged, times = -1, []
    end = None
    for line in process.stdout:
        acknowledged = int(line)
        times.append(time.monotonic())
        end = end or time.monotonic() + 1.5
        if time.monotonic() > end:
            break
    killed = time.monotonic()
    process.send_signal(signal.SIGKILL)
    rest = process.stdout.read().split("\n")
    process.stdout.close()
    assert process.wait() == -signal.SIGKILL
    acknowledged = max([acknowledged, *(int(line) for line in rest[:-1])])

    folder = RunFolder.open(runs / "killed")
    assert not folder.sealed
    numbers = [document["seq_num"] for _, document in folder.documents("event")]
    assert numbers[: acknowledged + 1] == list(range(acknowledged + 1))
    raw = folder.raw()
    np.testing.assert_array_equal(raw.columns["time_s"], np.arange(float(raw.rows)))
    lost_blocks = len(times) - raw.rows // 5
    # A process that a busy machine doesn't let run can't flush: its longest pause is allowed for.
    pause = float(np.max(np.diff([*times, killed])))
    assert lost_blocks <= sum(moment > killed - 1.0 - pause for moment in times)

    recovery = folder.recover()
    assert recovery.documents == len(numbers)
    assert recovery.raw_rows == raw.rows
    folder.verify()
    assert folder.manifest["status"] == "interrupted"
    assert json.loads((folder.path / "recovery.json").read_text())["documents"] == len(numbers)


def test_a_stream_of_blocks_that_were_never_written_is_torn_and_empty(tmp_path: Path) -> None:
    (tmp_path / "raw.arrow").write_bytes(b"\xff\xff" + b"\0" * 17)
    found = read_raw(tmp_path)
    assert (found.rows, found.torn_bytes) == (0, 19)


def test_a_folder_that_cannot_be_begun_is_not_left_behind(runs):
    RunFolder.create(runs, {}, kind="zero").seal()
    script = (
        "import resource, sys; from pathlib import Path; from torquebench.records import RunFolder;"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (10, 10));"  # no room for run.json
        "RunFolder.create(Path(sys.argv[1]), {'operator': 'Ana'}, kind='calibrate-output')"
    )
    before = sorted(runs.iterdir())
    child = subprocess.run(
        [sys.executable, "-c", script, str(runs)], capture_output=True, text=True, check=False
    )
    assert "RecordError: can't create" in child.stderr
    assert "make room on the disk" in child.stderr
    assert sorted(runs.iterdir()) == before


def test_keeping_and_sealing_samples_imports_no_pandas(tmp_path):
    """PyArrow imports it for its own arrays of NumPy's: half a second of every run."""
    code = f"""
import sys
import numpy as np
from pathlib import Path
from torquebench.records import RunFolder
writer = RunFolder.create(Path({str(tmp_path)!r}), {{}}, kind="calibrate-output")
writer.samples({{"time_s": np.arange(3.0), "fault": np.zeros(3, np.uint8), "on": True}})
raw = writer.seal().raw().columns
assert raw["time_s"].tolist() == [0.0, 1.0, 2.0] and raw["fault"].dtype == np.uint8
print("pandas" in sys.modules)
"""
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "False"
