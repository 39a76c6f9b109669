"""Files that expand without end are refused with a message, in the memory of another process."""

import os
import resource
import signal
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from tests.hostile_files import FILES
from tests.support.draws import nightly, some
from tests.support.uploads import evaluated

from torquebench.errors import InputError
from torquebench.panel.service.files import LARGEST_FILE
from torquebench.tables import compensate_file, read_calibration, read_table
from torquebench.tables.isolated import Limits

MOST_MB = 400
WORDS = r"cells|rows|MB|NUL|too large|bytes"

BY_DAY = {"far-cell.xlsx", "long-line.csv", "fill-values.h5", "many-rows.parquet"}
"""One of each format."""


@pytest.fixture(scope="module")
def hostile(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    folder = tmp_path_factory.mktemp("hostile")

    def written(name: str) -> Path:
        path = folder / name
        if not path.exists():
            FILES[name](path)
        return path

    return written


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def _compensated(source: Path, folder: Path) -> None:
    compensate_file(source, folder / "out.csv", lambda block: (block.reading_nm,) * 3)


def _uploaded(source: Path, _: Path) -> None:
    with source.open("rb") as file:
        evaluated(file.read(LARGEST_FILE + 1), source.name)


def _calibrated(source: Path, _: Path) -> None:
    read_calibration(source)


@pytest.mark.parametrize("name", [name if name in BY_DAY else nightly(name) for name in FILES])
@pytest.mark.parametrize("read", [_uploaded, *map(nightly, (_compensated, _calibrated))])
def test_what_expands_is_refused_and_nothing_is_written(
    hostile: Callable[[str], Path], name: str, read: Callable[[Path, Path], None], tmp_path: Path
) -> None:
    path, before = hostile(name), peak_mb()
    with pytest.raises(InputError, match=WORDS):
        read(path, tmp_path)
    assert not list(tmp_path.iterdir())
    assert peak_mb() - before < MOST_MB


@pytest.mark.nightly
@pytest.mark.timeout(1200)
def test_an_upload_whose_result_would_fill_the_memory_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    steps = np.tile(np.r_[0.0, 100.0, 200.0, 300.0], 250_000)
    table = pa.table({"reading_nm": steps, "standard_nm": steps})
    pq.write_table(table, path, compression="zstd")
    assert path.stat().st_size < LARGEST_FILE
    with pytest.raises(InputError, match="a result of"):
        evaluated(path.read_bytes(), "t.parquet")


@pytest.mark.parametrize(
    "line", some([b"1.0,1.0\n", b"x", b"\0", b"# a comment\n", b"\n"], by_day=3)
)
def test_a_pipe_without_an_end_is_bounded(tmp_path: Path, line: bytes) -> None:
    pipe = tmp_path / "pipe.csv"
    os.mkfifo(pipe)

    def write() -> None:
        with suppress(BrokenPipeError), pipe.open("wb") as file:
            file.write(b"reading_nm,standard_nm\n1.0,1.0\n")
            while True:
                file.write(line * (1 << 16))

    writer = threading.Thread(target=write)
    writer.start()
    with pytest.raises(InputError, match=r"MB|NUL"):
        read_table(pipe, limits=Limits(mb=32))
    writer.join()


@pytest.mark.parametrize("device", ["/dev/zero", "/dev/full", "/dev/urandom", "/dev/null"])
def test_a_device_is_no_table(device: str) -> None:
    with pytest.raises(InputError, match=r"MB|NUL|text|empty"):
        read_table(device)


def test_a_whole_table_has_a_largest_size(tmp_path: Path) -> None:
    path = tmp_path / "t.csv"
    path.write_text("reading_nm,standard_nm\n" + "1.5,1.5\n" * 60_000)
    with pytest.raises(InputError, match="at most 100000 cells"):
        read_table(path, limits=Limits(cells=100_000))
    wide = tmp_path / "wide.csv"
    wide.write_text(",".join(f"c{n}" for n in range(2000)) + "\n" + ("1," * 1999 + "1\n") * 60)
    with pytest.raises(InputError, match="at most 100000 cells"):
        read_table(wide, limits=Limits(cells=100_000))


def test_the_end_of_the_process_is_a_message(tmp_path: Path) -> None:
    path = tmp_path / "t.parquet"
    pq.write_table(pa.table({"reading_nm": np.random.default_rng(1).normal(size=3_000_000)}), path)
    with pytest.raises(InputError, match=r"not read in 0\.001 s"):
        read_table(path, limits=Limits(seconds=0.001))
    with pytest.raises(InputError, match="more than 16 MB when it is read"):
        read_table(path, limits=Limits(memory_mb=16))


@pytest.mark.parametrize("how", [signal.SIGSEGV, signal.SIGKILL])
def test_a_reader_that_dies_by_a_signal_is_a_message(tmp_path: Path, how: signal.Signals) -> None:
    path, ended = tmp_path / "t.parquet", threading.Event()
    pq.write_table(pa.table({"reading_nm": np.zeros(3)}), path)

    def kill() -> None:
        while not ended.wait(0.001):
            for child in psutil.Process().children():
                with suppress(psutil.NoSuchProcess):
                    if "torquebench.tables.isolated" in child.cmdline():
                        child.send_signal(how)
                        return

    killer = threading.Thread(target=kill)
    killer.start()
    try:
        with pytest.raises(InputError, match=rf"its reader has failed \(signal {int(how)}\)"):
            read_table(path)
    finally:
        ended.set()
        killer.join()
    assert len(read_table(path)) == 3


def test_a_library_that_aborts_when_all_is_read_spoils_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text("import atexit, os\natexit.register(os.abort)\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    pq.write_table(pa.table({"reading_nm": [1.0, 2.0]}), tmp_path / "a.parquet")
    assert len(read_table(tmp_path / "a.parquet")) == 2
