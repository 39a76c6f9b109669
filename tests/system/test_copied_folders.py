"""A run is its sealed identifier: a copy of its folder is named, never entered, never in use."""

import json
import shutil
from pathlib import Path

import pytest
from tests.system.command_line import run

from torquebench.calibration import CalibrationData
from torquebench.campaign.finishing import discard_run, find_unfinished, finish_recorded_run
from torquebench.campaign.rebuilding import rebuild
from torquebench.errors import InputError, RecordError
from torquebench.records import CalibrationEntry, Registry, RunFolder, unfinished_runs
from torquebench.station import enter_run, recover_unfinished
from torquebench.station.data_check import check_data_directory


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = tmp_path_factory.mktemp("calibrated")
    arguments = ("--step", "25", "--model", "polynomial", "--yes", "--data", str(data))
    result = run("calibrate", "output", *arguments, cwd=data)
    assert result.returncode == 0, result.stderr
    return data


@pytest.fixture
def data(calibrated: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(calibrated, tmp_path / "data"))


def original(data: Path) -> Path:
    (folder,) = (data / "runs").iterdir()
    return folder


def entered(data: Path) -> tuple[int, int, int | None]:
    """Return the numbers of runs and calibrations, and of the model in use."""
    with Registry.open(data) as registry:
        (model,) = (each.model_id for each in registry.models() if each.active)
        return registry.number_of_runs(), len(registry.calibrations()), model


@pytest.mark.parametrize("name", ["{} (copy)", "{}-2", "copy-of-{}", "20990101T000000Z-calibrate"])
@pytest.mark.parametrize("sealed", [True, False])
def test_a_copy_is_named_and_nothing_of_it_is_entered(data: Path, name: str, sealed: bool) -> None:
    first = original(data)
    copy = Path(shutil.copytree(first, first.with_name(name.format(first.name))))
    if not sealed:  # as it was before it ended
        (copy / "manifest.json").unlink()
    before = entered(data)

    with Registry.open(data) as registry:
        recover_unfinished(registry)
        (found,) = unfinished_runs(registry)
        assert str(found.found) == f"folder {copy.name} is a copy of run {first.name}"
        for refused in (
            lambda: finish_recorded_run(registry, found),
            lambda: discard_run(registry, found, by="Kim", reason="a copy"),
            lambda: enter_run(registry, RunFolder(copy)),
        ):
            with pytest.raises((InputError, RecordError), match=rf"{first.name}"):
                refused()
        with pytest.raises(InputError, match="no unfinished run"):
            find_unfinished(registry, "latest")
        named = [str(each) for each in check_data_directory(data).findings]
    assert named == [f"{copy}: folder {copy.name} is a copy of run {first.name}"]
    assert [each for each in rebuild(data, "Kim").problems if copy.name in each]
    assert entered(data) == before


def test_a_lost_registry_is_rebuilt_from_the_run_alone(data: Path) -> None:
    first = original(data)
    shutil.copytree(first, first.with_name(f"0-{first.name}"))
    for file in data.glob("registry.sqlite*"):
        file.unlink()
    done = rebuild(data, "Kim")
    assert done.runs == [first.name]
    assert len(done.calibrations) == 1
    (problem,) = done.problems
    assert problem.startswith(f"0-{first.name}: folder 0-{first.name} holds run {first.name}")


def test_a_renamed_folder_is_told_its_name(data: Path) -> None:
    first = original(data)
    renamed = first.rename(first.with_name("renamed"))
    with Registry.open(data) as registry:
        (found,) = unfinished_runs(registry)
    assert str(found.found) == f"folder renamed holds run {first.name} under another name"
    assert str(found.remedy) == f"nothing of it is entered; rename it to {first.name}"
    renamed.rename(first)
    assert check_data_directory(data).intact


def test_commands_name_a_copy_at_every_start(data: Path) -> None:
    first = original(data)
    copy = Path(shutil.copytree(first, first.with_name(f"{first.name}-copy")))
    said = f"folder {copy.name} is a copy of run {first.name}"
    for command, code in (
        (("records", "finish"), 0),
        (("records", "finish", copy.name), 2),
        (("records", "verify", "--json"), 1),
        (("records", "list", "runs"), 0),
        (("records", "rebuild"), 1),
        (("check", "output", "--yes"), 0),
    ):
        result = run(*command, "--data", str(data), cwd=data.parent)
        text = " ".join((result.stdout + result.stderr).split())
        assert result.returncode == code, text
        assert said in text or f"{copy.name} holds run {first.name}" in text, (command, text)


def test_points_of_a_real_bench_are_registered_once(data: Path) -> None:
    """A copy whose identifier was changed too still has the points of its original."""
    results = json.loads((original(data) / "results.json").read_text(encoding="utf-8"))
    real = {"simulated": False, "true_torque_nm": None}
    points = CalibrationData(**{**results["data"], **real})
    with Registry.open(data) as registry:
        performed = registry.calibrations()[0].performed
        registry.add_calibration(CalibrationEntry.of_points(points, performed=performed))
        with pytest.raises(RecordError, match=r"are those of calibration-2"):
            registry.add_calibration(CalibrationEntry.of_points(points, performed=performed))
