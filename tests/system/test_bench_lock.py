import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from torquebench.bench.description import BenchDescription, default_bench, load_bench
from torquebench.errors import InputError
from torquebench.records import Registry
from torquebench.station import Station
from torquebench.station.bench_lock import LOCK_FILE, BenchLock

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
HOLDER = """
import sys, time
from pathlib import Path
from torquebench.bench.description import default_bench
from torquebench.station.bench_lock import BenchLock
lock = BenchLock(default_bench(), Path(sys.argv[1]))
print("held", flush=True)
time.sleep(600)
"""


def networked(port: int) -> BenchDescription:
    values = load_bench(EXAMPLES / "networked.toml").model_dump()
    values["driver"] = json.loads(json.dumps(values["driver"]))
    values["driver"]["input_drive"]["address"] = f"127.0.0.1:{port}"
    values["driver"]["output_drive"]["bus"]["port"] = port + 1
    return BenchDescription.model_validate(values)


def test_a_bench_is_opened_once_and_again_when_it_was_closed(tmp_path: Path) -> None:
    with Station.open(None, tmp_path) as station:
        with pytest.raises(InputError, match="are in use by") as refused:
            Station.open(None, tmp_path)
        assert f"process {os.getpid()}" in refused.value.found
        assert "records can be listed" in refused.value.remedy
        with Registry.open(tmp_path) as registry:  # reading needs no lock
            assert registry.runs() == []
        assert station.registry.runs() == []
    with Station.open(None, tmp_path):
        pass


def test_a_killed_process_holds_nothing_and_a_living_one_is_named(tmp_path: Path) -> None:
    holder = subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(InputError, match=f"process {holder.pid} on "):
            BenchLock(default_bench(), tmp_path)
    finally:
        holder.send_signal(signal.SIGKILL)
        holder.communicate()
    lock = BenchLock(default_bench(), tmp_path)
    assert json.loads((tmp_path / LOCK_FILE).read_text())["pid"] == str(os.getpid())
    lock.release()
    lock.release()
    assert (tmp_path / LOCK_FILE).read_text() == ""


def test_drives_have_one_commander_whatever_the_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    first = BenchLock(networked(40_001), tmp_path / "a")
    with pytest.raises(InputError, match="the commands of input_drive are in use by"):
        BenchLock(networked(40_001), tmp_path / "b")
    other = BenchLock(networked(40_003), tmp_path / "b")  # let go of when it was refused
    first.release()
    other.release()
    BenchLock(networked(40_001), tmp_path / "b").release()


def test_what_stands_in_a_lock_file_is_shown_as_plain_text(tmp_path: Path) -> None:
    held = BenchLock(default_bench(), tmp_path)
    for text in ("", "no JSON", "[1]", '{"command": "x"}'):
        (tmp_path / LOCK_FILE).write_text(text)
        with pytest.raises(InputError, match="by another process"):
            BenchLock(default_bench(), tmp_path)
    told = {"command": "a\x1b[2Jb", "pid": "1", "host": "h", "since": "now"}
    (tmp_path / LOCK_FILE).write_text(json.dumps(told))
    with pytest.raises(InputError) as refused:
        BenchLock(default_bench(), tmp_path)
    assert "a[2Jb" in refused.value.found
    held.release()


def test_a_lock_file_of_another_person_locks_too(tmp_path: Path) -> None:
    (tmp_path / LOCK_FILE).write_text("")
    (tmp_path / LOCK_FILE).chmod(0o444)
    held = BenchLock(default_bench(), tmp_path)
    with pytest.raises(InputError, match="in use"):
        BenchLock(default_bench(), tmp_path)
    held.release()
