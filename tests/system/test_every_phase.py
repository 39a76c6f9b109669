"""Kills, full disks and restarts of the database at phases of a calibration and its certificate.

`tests/nightly` goes through the commands with more of them.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests import postgresql_server
from tests.support.draws import nightly
from tests.system.command_line import run
from tests.system.interrupted_phases import one_phase, stopped

from torquebench.records import Registry, RunState, unfinished_runs

SEED = 3


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("event", "phase", "named"),
    [
        ("killed", "register certificate", ""),
        nightly("disk full", "register", "measured"),
        nightly("disk full", "prepare", "interrupted"),
        nightly("killed", "sealed", "measured"),
        nightly("killed", "register model", "measured"),
        nightly("killed", "register check", "measured"),
        nightly("disk full", "seal", "measured"),
    ],
)
def test_what_something_has_come_between_is_found_and_finished(
    tmp_path: Path, event: str, phase: str, named: str
) -> None:
    outcome = one_phase(event, phase, tmp_path, SEED)
    assert outcome.problems == ()
    assert outcome.alarm == named


if postgresql_server.binaries() is not None or os.environ.get("CI"):

    @pytest.fixture
    def server() -> Iterator[postgresql_server.Server]:
        with postgresql_server.restartable() as found:
            yield found

    @pytest.mark.nightly
    @pytest.mark.parametrize("phase", [nightly("measure"), "register"])
    def test_a_restart_of_the_database_costs_nothing(
        tmp_path: Path, server: postgresql_server.Server, phase: str
    ) -> None:
        outcome = one_phase("database restarts", phase, tmp_path, SEED, server=server)
        assert outcome.problems == ()
        assert outcome.alarm == "", "nothing was left to be finished"


@pytest.fixture
def killed(tmp_path: Path) -> Path:
    """A calibration that was killed between sealing and registration."""
    assert stopped("killed", "sealed", tmp_path / "data", SEED, 0.0) == ""
    return tmp_path


def test_every_command_names_a_stranded_run_and_resume_finishes_it(killed: Path) -> None:
    (folder,) = (killed / "data" / "runs").iterdir()
    for command in (("records", "list", "runs"), ("records", "list"), ("doctor",)):
        said = run(*command, "--data", "data", cwd=killed)
        words = " ".join((said.stdout + said.stderr).split())
        assert "is measured and sealed, and not in the registry" in words, command
        assert f"torquebench records finish {folder.name}" in words
    events = (folder / "events.jsonl").read_bytes()
    for number in range(2):
        resumed = run("resume", "latest", "--data", "data", cwd=killed)
        if number:  # there is nothing to go on with, and nothing is measured again
            assert resumed.returncode == 2
            assert "'latest' names no run" in resumed.stderr
            continue
        assert resumed.returncode == 0, resumed.stderr
        said = " ".join(resumed.stderr.split())
        assert f"all points of {folder.name} were measured already" in said
        assert "In use model-1" in " ".join(resumed.stdout.split())
    assert [path.name for path in (killed / "data" / "runs").iterdir()] == [folder.name]
    assert (folder / "events.jsonl").read_bytes() == events
    with Registry.open(killed / "data") as registry:
        (entry,) = registry.calibrations()
        assert (entry.run_id, entry.points) == (folder.name, 16)
        assert registry.models()[0].kind == "polynomial", "as it was begun"
        assert registry.zeroings("SIM-T2000")[0].run_id == folder.name
        assert unfinished_runs(registry) == ()
    listed = run("records", "list", "runs", "--data", "data", cwd=killed)
    assert "records finish" not in listed.stderr


def test_a_stranded_run_is_discarded_on_the_record(killed: Path) -> None:
    (folder,) = (killed / "data" / "runs").iterdir()
    unexplained = run("records", "discard", "latest", "--reason", " ", "--data", "data", cwd=killed)
    assert unexplained.returncode == 2
    done = run(
        *("records", "discard", "latest", "--reason", "the clamp was loose", "--by", "Ana"),
        *("--data", "data"),
        cwd=killed,
    )
    assert done.returncode == 0, done.stderr
    with Registry.open(killed / "data") as registry:
        assert unfinished_runs(registry) == ()
        assert registry.calibrations() == []
        assert registry.discarded(folder.name)
        (amended,) = registry.amendments("run_ends", 1)
        assert (amended.amended_by, amended.reason) == ("Ana", "the clamp was loose")
        assert registry.run(folder.name).status == "completed", "the record stays as it was"
    finished = run("records", "finish", "--data", "data", cwd=killed)
    assert "Every run is finished" in finished.stdout
    assert folder.is_dir()


def test_a_calibration_that_ended_before_its_first_point_is_named_and_discarded(
    tmp_path: Path,
) -> None:
    assert stopped("disk full", "prepare", tmp_path / "data", SEED, 0.0) == ""
    (folder,) = (tmp_path / "data" / "runs").iterdir()
    entered = run("records", "finish", "--data", "data", cwd=tmp_path)
    assert entered.returncode == 0, entered.stderr
    for command in (("records", "list", "runs"), ("doctor",)):
        said = run(*command, "--data", "data", cwd=tmp_path)
        words = " ".join((said.stdout + said.stderr).split())
        assert f"resume it with `torquebench resume {folder.name}`" in words, command
        assert f"`records discard {folder.name}`" in words
    done = run(
        *("records", "discard", "latest", "--reason", "the disk was full", "--by", "Ana"),
        *("--data", "data"),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    with Registry.open(tmp_path / "data") as registry:
        assert registry.discarded(folder.name)
        assert unfinished_runs(registry) == ()


@pytest.mark.nightly
def test_finishing_puts_no_older_model_into_use_than_there_is(killed: Path) -> None:
    run("calibrate", "output", "--step", 50, "--data", "data", cwd=killed)
    with Registry.open(killed / "data") as registry:
        (left,) = unfinished_runs(registry)
        assert left.state is RunState.MEASURED
        used = registry.activations("SIM-T2000")
    done = run("records", "finish", "--data", "data", cwd=killed)
    assert done.returncode == 0, done.stderr
    with Registry.open(killed / "data") as registry:
        assert len(registry.calibrations()) == 2
        assert registry.activations("SIM-T2000") == used
