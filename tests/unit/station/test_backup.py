"""A backup is a whole second copy, made at any moment; the way back overwrites nothing."""

import hashlib
import json
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from tests.unit.station.data_directories import filled_directory

from torquebench.bench.audit.chain import AUDIT_FILE
from torquebench.bench.audit.entries import AUDIT_FOLDER
from torquebench.errors import InputError, RecordError
from torquebench.records import Equipment, Registry, RunFolder
from torquebench.records.registry.database import REGISTRY_FILE
from torquebench.station import recover_unfinished
from torquebench.station.backup import back_up, restore
from torquebench.station.data_check import check_data_directory


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("made")
    data = filled_directory(folder / "data")
    (data / "laboratory.toml").write_text("name = 'L'\n", encoding="utf-8")
    back_up(data, folder / "backup")
    return data, folder / "backup"


@pytest.fixture
def places(made: tuple[Path, Path], tmp_path: Path) -> tuple[Path, Path]:
    for source, name in zip(made, ("data", "backup"), strict=True):
        shutil.copytree(source, tmp_path / name)
    return tmp_path / "data", tmp_path / "backup"


def content(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != "bench.lock" and not path.name.endswith(("-wal", "-shm"))
    }


def test_a_backup_is_a_data_directory_and_is_brought_up_to_date(
    places: tuple[Path, Path],
) -> None:
    data, backup = places
    report = check_data_directory(backup)
    assert report.intact
    assert report.runs == 3
    assert (backup / "laboratory.toml").exists()
    with Registry.open(data) as registry:
        registry.add_equipment(Equipment("reducer", "R-1"))
        again = back_up(data, backup)
        assert (again.runs, again.known_runs, again.files) == (0, 3, 0)
        assert again.head == registry.head()
    with Registry.open(backup) as registry:
        assert "R-1" in {each.serial for each in registry.equipment()}
    assert check_data_directory(backup).intact


WORKING = """
import sys
from pathlib import Path
from datetime import UTC, datetime
import numpy as np
from torquebench.bench.audit.entries import AuditLog
from torquebench.records import Registry, RunFolder, RunSummary
data = Path(sys.argv[1])
log = AuditLog(data / "audit", bench="b", largest_bytes=20000)
with Registry.open(data) as registry:
    for number in range(100000):
        head = str(registry.head())
        writer = RunFolder.create(data / "runs", {"registry_head": head}, kind="zero",
                                  run_id=f"run-{number:05}")
        now = datetime.now(UTC)
        registry.add_run(RunSummary(
            run_id=writer.run_id, kind="zero", started=now, simulated=True,
            software_version="0", folder=writer.path))
        log.begin_run(writer.run_id, "Ana", writer.path)
        for point in range(5):
            log.write("command", torque_nm=1.0 * point)
            writer("event", {"descriptor": "d", "seq_num": point})
            writer.samples({"time_s": np.arange(50.0)})
        log.end_run()
        registry.end_run(writer.seal())
        registry.add_audit_end(log.path.parent, log.end.line, log.end.sha256)
        print(number, flush=True)
"""


def test_a_backup_of_a_bench_at_work_is_consistent(tmp_path: Path) -> None:
    data = tmp_path / "data"
    bench = subprocess.Popen(
        [sys.executable, "-c", WORKING, str(data)], stdout=subprocess.PIPE, text=True
    )
    assert bench.stdout is not None
    try:
        for number in range(4):
            before = int(bench.stdout.readline())
            done = back_up(data, tmp_path / "backup")
            assert done.problems == []
            after = tmp_path / f"restored-{number}"
            restored = restore(tmp_path / "backup", after)
            assert restored.replaced == []
            with Registry.open(after) as registry:
                recover_unfinished(registry)
                runs = registry.runs(limit=10000)
                assert len(runs) > before
                assert {run.status for run in runs} <= {"completed", "interrupted"}
            report = check_data_directory(after)
            strangers = [each for each in report.findings if each.kind != "orphan"]
            assert strangers == [], "a run that began after the registry was copied may be there"
        assert bench.poll() is None
    finally:
        bench.send_signal(signal.SIGKILL)
        bench.communicate()


def lose_run(data: Path) -> None:
    shutil.rmtree(data / "runs" / "run-2")


def change_run(data: Path) -> None:
    (data / "runs" / "run-2" / "events.jsonl").write_text("{}\n", encoding="utf-8")


def lose_registry(data: Path) -> None:
    (data / REGISTRY_FILE).unlink()


def break_registry(data: Path) -> None:
    (data / REGISTRY_FILE).write_bytes(b"SQLite format 3\0" + bytes(9000))


def lose_audit(data: Path) -> None:
    shutil.rmtree(data / AUDIT_FOLDER)


def change_audit(data: Path) -> None:
    log = data / AUDIT_FOLDER / AUDIT_FILE
    log.write_bytes(log.read_bytes().replace(b"800.0", b"700.0"))


def change_model(data: Path) -> None:
    (data / "models" / "run-2-polynomial.json").write_text("{ }", encoding="utf-8")


def lose_everything(data: Path) -> None:
    shutil.rmtree(data)


@pytest.mark.parametrize(
    ("damage", "differs"),
    [
        (lose_run, ""),
        (lose_registry, ""),
        (lose_audit, ""),
        (lose_everything, ""),
        (change_run, "runs/run-2"),
        (break_registry, REGISTRY_FILE),
        (change_audit, AUDIT_FOLDER),
        (change_model, "models/run-2-polynomial.json"),
    ],
)
def test_the_way_back_from_every_damage(
    places: tuple[Path, Path], damage: Callable[[Path], None], differs: str
) -> None:
    data, backup = places
    damage(data)
    if differs:
        before = content(data)
        with pytest.raises(InputError, match=f"1 in .* differ from the backup: {differs}"):
            restore(backup, data)
        assert content(data) == before, "nothing was changed"
    done = restore(backup, data, replace=bool(differs))
    assert done.replaced == ([differs] if differs else [])
    assert check_data_directory(data).intact
    if differs:
        assert done.aside is not None
        kept = done.aside / differs
        found = content(kept) if kept.is_dir() else kept.read_bytes()
        inside = {name.removeprefix(f"{differs}/"): each for name, each in before.items()}
        assert found == (
            {name: each for name, each in inside.items() if f"{differs}/{name}" in before}
            if kept.is_dir()
            else before[differs]
        )
    assert restore(backup, data).restored == [], "nothing is left to do"


def test_what_is_newer_than_the_backup_stays(places: tuple[Path, Path]) -> None:
    data, backup = places
    with Registry.open(data) as registry:
        registry.add_equipment(Equipment("reducer", "R-NEW"))
    (data / "laboratory.toml").write_text("name = 'New'\n", encoding="utf-8")
    lose_run(data)
    done = restore(backup, data, replace=True)
    assert done.restored == ["runs/run-2"]
    assert done.kept == [REGISTRY_FILE, "laboratory.toml"]
    assert done.replaced == []
    with Registry.open(data) as registry:
        assert "R-NEW" in {each.serial for each in registry.equipment()}
    assert check_data_directory(data).intact


def test_a_damaged_registry_costs_no_earlier_backup(places: tuple[Path, Path]) -> None:
    data, backup = places
    before = content(backup)
    break_registry(data)
    with pytest.raises(RecordError, match="is not a database"):
        back_up(data, backup)
    assert content(backup) == before


def test_a_damaged_run_is_named_and_not_copied_over_a_good_one(places: tuple[Path, Path]) -> None:
    data, backup = places
    change_run(data)
    shutil.rmtree(backup / "runs" / "run-3")
    (data / "runs" / "run-3" / "events.jsonl").write_text("{}\n", encoding="utf-8")
    done = back_up(data, backup)
    (problem,) = done.problems
    assert "run-3" in problem
    assert "was changed after sealing" in problem
    assert not (backup / "runs" / "run-3").exists()
    RunFolder.open(backup / "runs" / "run-2").verify()


def test_other_folders_are_refused(places: tuple[Path, Path], tmp_path: Path) -> None:
    data, backup = places
    with pytest.raises(InputError, match="contains the other"):
        back_up(data, data / "backup")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "holiday.jpg").write_bytes(b"")
    with pytest.raises(InputError, match="contains other files"):
        back_up(data, tmp_path / "photos")
    other = filled_directory(tmp_path / "other")
    with pytest.raises(InputError, match="doesn't pass through the end of the chain"):
        back_up(other, backup)
    with pytest.raises(InputError, match="isn't a backup"):
        restore(tmp_path / "photos", data)


def tree(folder: Path) -> dict[str, bytes | str]:
    """Return every file, folder and link."""
    return {
        path.relative_to(folder).as_posix(): (
            f"-> {path.readlink()}"
            if path.is_symlink()
            else path.read_bytes()
            if path.is_file()
            else "folder"
        )
        for path in folder.rglob("*")
        if path.name != "bench.lock" and not path.name.endswith(("-wal", "-shm"))
    }


def forge_manifest(backup: Path) -> None:
    """Change a run and seal it again: the folder agrees with itself, not with the registry."""
    folder = backup / "runs" / "run-2"
    events = folder / "events.jsonl"
    events.write_bytes(events.read_bytes() + b"\n")
    manifest = folder / "manifest.json"
    listed = json.loads(manifest.read_text(encoding="utf-8"))
    listed["files"]["events.jsonl"]["sha256"] = hashlib.sha256(events.read_bytes()).hexdigest()
    manifest.write_text(json.dumps(listed), encoding="utf-8")


def forge_row(backup: Path) -> None:
    with closing(sqlite3.connect(backup / REGISTRY_FILE)) as connection:
        connection.execute("DROP TRIGGER keep_calibrations_update")
        connection.execute("UPDATE calibrations SET measured_by = 'Eve'")
        connection.commit()


@pytest.mark.parametrize(
    "forge", [change_run, forge_manifest, change_model, change_audit, forge_row, break_registry]
)
def test_nothing_is_copied_from_a_backup_with_a_broken_seal(
    places: tuple[Path, Path], forge: Callable[[Path], None]
) -> None:
    data, backup = places
    forge(backup)
    for change, replace in ((change_run, True), (lose_run, False), (lose_everything, False)):
        if data.exists():
            change(data)
        before = tree(data)
        with pytest.raises(RecordError, match="damaged"):
            restore(backup, data, replace=replace)
        assert tree(data) == before


@pytest.mark.parametrize("where", ["models/more.json", "runs/run-9", "runs/run-2/more", "a/b/c"])
@pytest.mark.parametrize("target", ["/etc/passwd", "/etc", "nothing", "../backup"])
def test_a_backup_with_a_link_is_refused(
    places: tuple[Path, Path], where: str, target: str
) -> None:
    data, backup = places
    lose_everything(data)
    link = backup / where
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(target)
    with pytest.raises(RecordError, match=f"{where} is a link"):
        restore(backup, data)
    assert not data.exists()


def test_nothing_is_written_through_a_link_in_the_data(
    places: tuple[Path, Path], tmp_path: Path
) -> None:
    data, backup = places
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    shutil.rmtree(data / "runs")
    (data / "runs").symlink_to(elsewhere)
    with pytest.raises(RecordError, match="runs is a link"):
        restore(backup, data, replace=True)
    assert list(elsewhere.iterdir()) == []


def test_what_cannot_be_restored_wholly_is_not_restored(places: tuple[Path, Path]) -> None:
    """The last of several files has no place: those before it go back."""
    data, backup = places
    lose_run(data)
    change_audit(data)
    shutil.rmtree(data / "models")
    (data / "models").write_text("a file where the folder should be", encoding="utf-8")
    before = tree(data)
    with pytest.raises(RecordError, match="nothing was changed"):
        restore(backup, data, replace=True)
    assert tree(data) == before


def test_what_the_backup_lacks_is_named_and_the_rest_restored(places: tuple[Path, Path]) -> None:
    data, backup = places
    shutil.rmtree(backup / "runs" / "run-3")
    lose_everything(data)
    done = restore(backup, data)
    assert done.missing == [str(backup / "runs" / "run-3")]
    assert (data / "runs" / "run-2" / "manifest.json").exists()


def test_the_log_of_a_lost_registry_is_not_taken_for_the_restored_ones(
    places: tuple[Path, Path],
) -> None:
    data, backup = places
    lose_registry(data)
    for ending in ("-wal", "-shm"):
        (data / f"{REGISTRY_FILE}{ending}").write_bytes(b"of another database")
    done = restore(backup, data)
    assert done.aside is not None
    assert (done.aside / f"{REGISTRY_FILE}-wal").read_bytes() == b"of another database"
    assert check_data_directory(data).intact
