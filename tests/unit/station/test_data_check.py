"""`records verify` finds what is wrong with a data directory, and says each defect once."""

import os
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import pytest
from tests.unit.station.data_directories import filled_directory

from torquebench.bench.audit.chain import AUDIT_FILE
from torquebench.bench.audit.entries import AUDIT_FOLDER, AuditLog
from torquebench.errors import RecordError
from torquebench.records import Registry, Report, RunFolder, RunSummary
from torquebench.records.registry.database import REGISTRY_FILE
from torquebench.records.runs.time_check import clock_behind
from torquebench.station.data_check import check_data_directory


@pytest.fixture(scope="module")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return filled_directory(tmp_path_factory.mktemp("filled") / "data")


@pytest.fixture
def data(filled: Path, tmp_path: Path) -> Path:
    shutil.copytree(filled, tmp_path / "data")
    return tmp_path / "data"


def found(data: Path) -> list[str]:
    return [f"{each}; {each.way_back}" for each in check_data_directory(data).findings]


def test_an_intact_directory_is_intact(data: Path) -> None:
    report = check_data_directory(data)
    assert report.findings == ()
    assert report.remarks == ()
    assert (report.runs, report.audit_lines) == (3, 12)


def in_database(data: Path, *statements: str) -> None:
    with closing(sqlite3.connect(data / REGISTRY_FILE)) as connection, connection:
        for statement in statements:
            connection.execute(statement)


def remove_audit(data: Path) -> None:
    shutil.rmtree(data / AUDIT_FOLDER)


def change_audit(data: Path) -> None:
    log = data / AUDIT_FOLDER / AUDIT_FILE
    log.write_bytes(log.read_bytes().replace(b"800.0", b"700.0"))


def cut_audit(data: Path) -> None:
    log = data / AUDIT_FOLDER / AUDIT_FILE
    log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[:-1]))


def remove_registry(data: Path) -> None:
    (data / REGISTRY_FILE).unlink()


def empty_registry(data: Path) -> None:
    (data / REGISTRY_FILE).write_bytes(b"")


def begin_anew(data: Path) -> None:
    (data / REGISTRY_FILE).unlink()
    (data / "runs").rename(data / "elsewhere")
    Registry.open(data).close()
    (data / "elsewhere").rename(data / "runs")


def overwrite_registry(data: Path) -> None:
    content = bytearray((data / REGISTRY_FILE).read_bytes())
    content[4096:20000] = os.urandom(20000 - 4096)
    (data / REGISTRY_FILE).write_bytes(content)


def add_run(data: Path) -> None:
    RunFolder.create(data / "runs", {}, kind="zero", run_id="stranger").seal()


def add_own_run(data: Path) -> None:
    with Registry.open(data) as registry:
        known = {"registry_head": str(registry.head())}
    RunFolder.create(data / "runs", known, kind="zero", run_id="own").seal()


def add_folder(data: Path) -> None:
    (data / "runs" / "holiday-photos").mkdir()


def add_certificate(data: Path) -> None:
    (data / "certificates" / "TB-77").mkdir(parents=True)


def remove_run(data: Path) -> None:
    shutil.rmtree(data / "runs" / "run-2")


def remove_file(data: Path) -> None:
    (data / "runs" / "run-2" / "events.jsonl").unlink()


RESTORE_OR_REBUILD = "records restore BACKUP`, or without a backup `torquebench records rebuild`"


@pytest.mark.parametrize(
    ("damage", "words", "way_back"),
    [
        (remove_audit, "line 12 is noted in the registry, there is no log", "records restore"),
        (change_audit, "was changed after it was written", "records restore"),
        (cut_audit, "line 12 is noted in the registry, the log ends with 11", "records restore"),
        (remove_registry, "is missing beside 3 run folders", RESTORE_OR_REBUILD),
        (empty_registry, "is empty beside 3 run folders", RESTORE_OR_REBUILD),
        (overwrite_registry, "registry.sqlite: ", RESTORE_OR_REBUILD),
        (
            lambda data: in_database(data, "DROP TRIGGER keep_runs_update"),
            "trigger keep_runs_update: is missing",
            RESTORE_OR_REBUILD,
        ),
        (
            lambda data: in_database(
                data,
                "DROP TRIGGER keep_runs_update",
                "CREATE TRIGGER keep_runs_update BEFORE UPDATE ON runs BEGIN SELECT 1; END",
            ),
            "trigger keep_runs_update: differs from what was made",
            RESTORE_OR_REBUILD,
        ),
        (
            lambda data: in_database(data, "DROP INDEX ix_runs_started"),
            "index ix_runs_started: is missing",
            RESTORE_OR_REBUILD,
        ),
        (
            lambda data: in_database(data, "CREATE TABLE more (id INTEGER)"),
            "table more: doesn't belong to the registry",
            RESTORE_OR_REBUILD,
        ),
        (add_run, "stranger: a sealed run that isn't in the registry", "records rebuild` enters"),
        (add_own_run, "own: a sealed run that isn't in the registry", "records finish own` enters"),
        (add_folder, "holiday-photos: isn't a run", "remove it"),
        (add_certificate, "TB-77: no certificate of this number is registered", "records rebuild"),
        (remove_run, "no run in", "records restore"),
        (remove_file, "events.jsonl was removed after sealing", "records restore"),
    ],
)
def test_every_defect_is_named_once_with_the_way_back(
    data: Path, damage: Callable[[Path], None], words: str, way_back: str
) -> None:
    damage(data)
    (line,) = found(data)
    assert words in line
    assert way_back in line


def test_a_new_registry_beside_old_runs_is_one_defect(data: Path) -> None:
    begin_anew(data)
    lines = found(data)
    assert "holds no run beside 3 run folders" in lines[0]
    assert len([line for line in lines if "run" in line and "audit" not in line]) == 1


def test_no_new_registry_is_begun_beside_runs(data: Path) -> None:
    remove_registry(data)
    with pytest.raises(RecordError, match=r"is missing beside 3 run folders.*records rebuild"):
        Registry.open(data)
    assert not (data / REGISTRY_FILE).exists()


def test_a_flipped_bit_in_an_index_is_found(data: Path, tmp_path: Path) -> None:
    """A lookup by the index says that the drive is unknown; the row itself is as it was."""
    whole = (data / REGISTRY_FILE).read_bytes()
    mark, hidden = b"driveDRIVE-1", 0
    place = whole.find(mark)
    while place >= 0:
        content = bytearray(whole)
        content[place + len(mark) - 1] ^= 1
        (data / REGISTRY_FILE).write_bytes(content)
        with closing(sqlite3.connect(data / REGISTRY_FILE)) as connection:
            rows = connection.execute("SELECT serial FROM equipment NOT INDEXED").fetchall()
            query = "SELECT id FROM equipment WHERE kind = 'drive' AND serial = 'DRIVE-1'"
            known = connection.execute(query).fetchall()
        if ("DRIVE-1",) in rows and not known:
            hidden += 1
            (line,) = found(data)
            assert "missing from index ix_equipment_identity" in line
            assert "only an index is damaged: `torquebench records rebuild`" in line
        place = whole.find(mark, place + 1)
    assert hidden == 1


@pytest.mark.parametrize("page", range(1, 12))
def test_zeroed_pages_of_the_database_are_found(data: Path, page: int) -> None:
    content = bytearray((data / REGISTRY_FILE).read_bytes())
    content[page * 4096 : (page + 1) * 4096] = bytes(4096)
    (data / REGISTRY_FILE).write_bytes(content)
    assert found(data)


def test_impossible_times_are_named_and_change_nothing(data: Path) -> None:
    now = datetime.now(UTC)
    with Registry.open(data) as registry:
        with RunFolder.create(data / "runs", {}, kind="zero", run_id="run-9") as writer:
            registry.add_run(
                RunSummary(
                    run_id="run-9",
                    kind="zero",
                    started=now,
                    simulated=True,
                    software_version="0.2.0",
                    folder=writer.path,
                )
            )
        registry.end_run(writer.folder, now - timedelta(hours=3))
        assert clock_behind(registry) == ""
        behind = clock_behind(registry, now - timedelta(hours=5))
        assert "5.0 h before the newest record" in behind
        calibration = registry.calibrations()[0]
        day = calibration.performed.date()
        expired = Report("calibrator", "TC-1", "K-1", due=day - timedelta(days=1))
        registry.add_report(expired)
    report = check_data_directory(data)
    assert report.intact
    before, standard = report.remarks
    assert before.startswith("run run-9 ended (")
    assert "before it began" in before
    assert standard.startswith(f"calibration-1 was made on {day} against TC-1")
    assert f"certificate K-1 had expired on {date.fromisoformat(str(day)) - timedelta(days=1)}" in (
        standard
    )


CLOCK = """
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
import torquebench.records.registry.database as database
class Behind(datetime):
    @classmethod
    def now(cls, tz=None):
        return datetime.now(tz) - timedelta(days=2)
database.datetime = Behind
from torquebench.records import Equipment, Registry
with Registry.open(Path(sys.argv[1])) as registry:
    registry.add_equipment(Equipment("reducer", "R-1"))
"""


def test_a_clock_that_ran_backwards_is_named(data: Path) -> None:
    subprocess.run([sys.executable, "-c", CLOCK, str(data)], check=True)
    with Registry.open(data) as registry:
        registry.head()
    (remark,) = check_data_directory(data).remarks
    assert "was recorded 48.0 h before the entry before it: the clock ran backwards" in remark


def test_a_log_of_a_bench_that_is_open_now_is_intact(data: Path) -> None:
    log = AuditLog(data / AUDIT_FOLDER, bench="Bench 1")
    log.write("bench opens")
    report = check_data_directory(data)
    assert report.intact
    assert report.audit_lines == 13
    log.close()
