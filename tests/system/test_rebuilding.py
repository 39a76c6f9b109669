"""A registry that was lost is made anew from the folders beside it, and says what it lacks."""

import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from tests.system.command_line import laboratory, run
from tests.unit.station.data_directories import filled_directory

from torquebench.campaign.rebuilding import rebuild
from torquebench.errors import InputError
from torquebench.records import Registry, RunFolder
from torquebench.records.registry.database import REGISTRY_FILE, REGISTRY_URL
from torquebench.station.backup import back_up, restore
from torquebench.station.data_check import check_data_directory


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration of the simulated bench with its model and certificate."""
    folder = tmp_path_factory.mktemp("calibrated")
    data = folder / "data"
    done = run(
        *("calibrate", "output", "--step", 25, "--model", "polynomial"),
        *("--data", data),
        cwd=folder,
        TORQUEBENCH_OPERATOR="Ana",
    )
    assert done.returncode == 0, done.stderr
    laboratory(data)
    issued = run("certificate", "latest", "--out", folder / "out", "--data", data, cwd=folder)
    assert issued.returncode == 0, issued.stderr
    return data


@pytest.fixture
def data(calibrated: Path, tmp_path: Path) -> Path:
    shutil.copytree(calibrated, tmp_path / "data")
    return tmp_path / "data"


def lose(data: Path) -> None:
    (data / REGISTRY_FILE).unlink()


def empty(data: Path) -> None:
    (data / REGISTRY_FILE).write_bytes(b"")


def destroy(data: Path) -> None:
    content = bytearray((data / REGISTRY_FILE).read_bytes())
    content[4096:] = bytes(len(content) - 4096)
    (data / REGISTRY_FILE).write_bytes(content)


@pytest.mark.parametrize("damage", [lose, empty, destroy])
def test_a_lost_registry_is_made_anew(data: Path, damage: Callable[[Path], None]) -> None:
    with Registry.open(data) as registry:
        runs, zeroings = registry.runs(), registry.zeroings("SIM-T2000")
        (calibration,) = registry.calibrations()
        (model,) = registry.models()
        (certificate,) = registry.certificates()
        equipment = registry.equipment()
    broken = (damage(data), (data / REGISTRY_FILE).exists())[1] and (
        data / REGISTRY_FILE
    ).read_bytes()
    done = rebuild(data, "Ana")
    assert done.anew
    assert done.problems == []
    if broken:
        assert done.aside is not None
        assert done.aside.read_bytes() == broken
    with Registry.open(data) as registry:
        again = registry.runs()
        assert [(each.run_id, each.status, each.manifest_sha256) for each in again] == [
            (each.run_id, each.status, each.manifest_sha256) for each in runs
        ]
        assert [each.zero_hz for each in registry.zeroings("SIM-T2000")] == [
            each.zero_hz for each in zeroings
        ]
        assert registry.equipment() == equipment
        (entered,) = registry.calibrations()
        assert entered.data_sha256 == calibration.data_sha256
        assert (entered.run_id, entered.measured_by) == (calibration.run_id, "Ana")
        assert (entered.standard_serial, entered.due) == ("SIM-CAL-1", calibration.due)
        (fitted,) = registry.models()
        assert fitted.file_sha256 == model.file_sha256
        assert fitted.check_file().name == model.file.name
        assert registry.activations("SIM-T2000") == []
        (issued,) = registry.certificates()
        assert (issued.number, issued.files) == (certificate.number, certificate.files)
        rebuilt = {"rebuilt": "entered again from its record"}
        assert issued.summary == {**certificate.summary, **rebuilt}
        assert issued.archive == certificate.archive
    report = check_data_directory(data)
    assert [str(each) for each in report.findings] == []
    assert report.remarks[0].startswith("the registry was rebuilt from run folders by Ana on")
    assert rebuild(data, "Ana").runs == [], "nothing is left to do"


def test_the_command_says_what_it_cannot_rebuild(data: Path) -> None:
    lose(data)
    refused = run("records", "list", "--data", data, cwd=data.parent)
    assert refused.returncode == 2
    assert "records rebuild" in refused.stderr
    done = run("records", "rebuild", "--data", data, cwd=data.parent)
    assert done.returncode == 0, done.stderr
    said = " ".join(done.stdout.split())
    assert "1 runs, 1 calibrations, 1 models and 1 certificates entered" in said
    for lost in ("which model is in use", "reviews and amendments", "passwords"):
        assert lost in said


def test_a_calibration_without_a_model_is_left_to_be_finished(data: Path) -> None:
    lose(data)
    shutil.rmtree(data / "models")
    shutil.rmtree(data / "certificates")
    done = rebuild(data, "Ana")
    assert (done.calibrations, done.unfitted) == ([], done.runs)
    finished = run("records", "finish", "--data", data, cwd=data.parent)
    assert finished.returncode == 0, finished.stderr
    with Registry.open(data) as registry:
        assert len(registry.calibrations()) == len(registry.models()) == 1


def test_a_sound_registry_is_completed_after_an_older_one_was_restored(
    data: Path, tmp_path: Path
) -> None:
    back_up(data, tmp_path / "backup")
    with Registry.open(data) as registry:
        before = registry.head()
        known = {"registry_head": str(registry.head())}
    RunFolder.create(data / "runs", known, kind="zero", run_id="since").seal()
    lose(data)
    restore(tmp_path / "backup", data)
    done = rebuild(data, "Ana")
    assert (done.anew, done.runs, done.aside) == (False, ["since"], None)
    assert check_data_directory(data, anchors=(before,)).findings == ()


@pytest.mark.parametrize("how", ["trigger", "index", "flipped index"])
def test_only_what_is_damaged_of_the_database_is_made_again(data: Path, how: str) -> None:
    file = data / REGISTRY_FILE
    if how == "flipped index":
        content, mark = file.read_bytes(), b"driveSIM-DRIVE-IN"
        place = content.find(mark)
        while place >= 0:
            changed = bytearray(content)
            changed[place + len(mark) - 1] ^= 1  # the serial of a drive
            file.write_bytes(changed)
            (finding,) = check_data_directory(data).findings
            if finding.kind == "database":  # else the row itself, whose index is as it was
                break
            place = content.find(mark, place + 1)
        assert place >= 0
    else:
        name = "keep_runs_update" if how == "trigger" else "ix_runs_started"
        with closing(sqlite3.connect(file)) as connection, connection:
            connection.execute(f"DROP {how} {name}")
    with Registry.open(data) as registry:
        head = registry.head()
    assert len(check_data_directory(data).findings) == 1
    done = rebuild(data, "Ana")
    assert not done.anew
    assert done.mended
    assert done.aside is not None
    assert check_data_directory(data).findings == ()
    with Registry.open(data) as registry:
        assert registry.head() == head, "reviews, models in use and all else is as it was"


def test_a_damaged_run_is_named_and_the_others_are_entered(tmp_path: Path) -> None:
    data = filled_directory(tmp_path / "data")
    lose(data)
    (data / "runs" / "run-1" / "events.jsonl").write_text("{}\n", encoding="utf-8")
    done = rebuild(data, "Ana")
    assert done.runs[:1] == ["run-2"]
    assert any("run-1" in each and "changed after sealing" in each for each in done.problems)


def test_a_registry_on_a_server_is_left_alone(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(REGISTRY_URL, "postgresql://nobody@localhost/none")
    for action in (lambda: rebuild(data, "Ana"), lambda: back_up(data, data.parent / "b")):
        with pytest.raises(InputError, match="on a server"):
            action()
