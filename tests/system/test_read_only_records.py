"""Records are read where nothing can be written: archives, backups, other people's data."""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests import read_only
from tests.support.draws import nightly
from tests.system.command_line import COMMAND, environment
from tests.unit.station.data_directories import filled_directory

KILLED = """
import os, sys
from pathlib import Path
from torquebench.records import Equipment, Registry
registry = Registry.open(Path(sys.argv[1]))
registry.add_equipment(Equipment("reducer", "R-KILLED"))
os._exit(9)
"""


@pytest.fixture
def data() -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp())  # pytest's own folders are closed to everybody else
    folder.chmod(0o755)
    yield filled_directory(folder / "data")
    shutil.rmtree(folder)


def reading(data: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [COMMAND, *map(str, arguments), "--data", str(data)]
    return subprocess.run(
        [sys.executable, read_only.__file__, str(data), *command],
        env=environment(TORQUEBENCH_OPERATOR="Ana"),
        cwd="/",
        capture_output=True,
        text=True,
        check=False,
        timeout=240,
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("records", "list"), "DRIVE-1"),
        (("records", "verify"), "are unchanged"),
        nightly(("records", "list", "runs"), "run-2"),
        nightly(("records", "show", "run-2"), "intact"),
        nightly(("records", "show", "calibration-1"), "model-1"),
        nightly(("records", "audit"), "torque_nm=800"),
    ],
)
def test_records_are_read_from_a_read_only_file_system(
    data: Path, arguments: tuple[str, ...], words: str
) -> None:
    done = reading(data, *arguments)
    assert done.returncode == 0, done.stderr
    assert words in " ".join(done.stdout.split())


@pytest.mark.parametrize("index", [nightly("its index"), "no index"])
def test_what_a_killed_bench_left_in_its_log_is_read_too(data: Path, index: str) -> None:
    killed = subprocess.run([sys.executable, "-c", KILLED, str(data)], check=False)
    assert killed.returncode == 9
    assert (data / "registry.sqlite-wal").stat().st_size > 0
    if index == "no index":
        (data / "registry.sqlite-shm").unlink()
    done = reading(data, "records", "list", "equipment")
    assert done.returncode == 0, done.stderr
    assert "R-KILLED" in done.stdout


def test_what_would_write_says_so(data: Path) -> None:
    done = reading(data, "records", "review", "calibration-1", "--by", "Ben")
    assert done.returncode == 1
    assert "can only be read" in done.stderr
    assert "Traceback" not in done.stderr
