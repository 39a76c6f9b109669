"""Recorded runs evaluated again: the same bits on every scheduler, and resumable."""

import json
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from plugins.plant.tests.plant_bench import add_run, backlash_results, calibration_results
from sqlalchemy import text
from tests import postgresql_server
from tests.support.draws import nightly
from tests.system.command_line import run, widest_line

from torquebench.campaign.reducers.results import plain_budget
from torquebench.errors import InputError
from torquebench.progress import NoProgress
from torquebench.records import RECORDING, Registry
from torquebench.uncertainty import Budget
from torquebench_plant import Plant, differences, forward, reevaluate


def add_reducer_test(registry: Registry) -> None:
    results = backlash_results("S-1", 0.8)
    estimate = Budget(0.8, 0.025, float("inf"), (), "arcmin")
    results["quantities"][0] |= {"budget": plain_budget(estimate), "limit": "≤ 1 arcmin"}
    results["quantities"][0]["expanded_uncertainty"] = estimate.expanded_uncertainty()
    results["quantities"][0]["verdict"] = "pass"
    add_run(registry, "20260105T000000Z-test-hysteresis-0000", "test-hysteresis", results)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory, plant_socket: Path) -> Iterator[Plant]:
    """A calibration, a check and a verification of the simulated bench, and a reducer test."""
    place = tmp_path_factory.mktemp("recorded")
    (place / "share").mkdir()
    steps: tuple[tuple[object, ...], ...] = (
        ("calibrate", "output", "--step", 25, "--model", "polynomial"),
        ("check", "output", "--tolerance", 0.5),
        ("verification", "output", "--groups", 2, "--points", 8, "--tolerance", 1),
    )
    for step in steps:
        done = run(*step, "--data", place / "data", cwd=place)
        assert done.returncode == 0, done.stderr
    with Registry.open(place / "data") as registry:
        add_reducer_test(registry)
        url = postgresql_server.create_database(plant_socket, "recorded")
        with Plant.create(url, f"file://{place}/share") as plant:
            _, link = plant.register_bench("Bench 1")
            assert forward(registry, link).problems == []
            yield plant


def kept(plant: Plant, label: str) -> list[tuple[str, str, str]]:
    query = 'SELECT run_id, "values", problem FROM plant.reevaluations WHERE label = :label'
    with plant.transaction() as connection:
        rows = connection.execute(text(f"{query} ORDER BY run_id"), {"label": label})
        return [(row.run_id, row[1], row.problem) for row in rows]


@contextmanager
def cluster(folder: Path) -> Iterator[str]:
    """Start a scheduler and a worker."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    python = [sys.executable, "-m"]
    commands = (
        ["distributed.cli.dask_scheduler", "--no-dashboard", "--host", "127.0.0.1"],
        ["distributed.cli.dask_worker", "--no-dashboard", "--no-nanny", address],
    )
    commands[0].extend(["--port", str(port)])
    with ExitStack() as started:
        for command in commands:
            process = started.enter_context(
                subprocess.Popen([*python, *command], cwd=folder, stderr=subprocess.DEVNULL)
            )
            started.callback(process.terminate)
        yield address


def test_the_same_version_finds_the_same_again(recorded: Plant) -> None:
    done = reevaluate(recorded, "serial", label="serial")
    assert (done.done, done.problems) == (4, 0), kept(recorded, "serial")
    found = differences(recorded, "serial")
    assert found.rows() == []
    # Spans and figures of the fit; worst of the check; both of the verification; value, U, verdict.
    assert found.facts["values compared"] >= 4 + 2 + 1 + 4 + 3
    values = {run_id: json.loads(values) for run_id, values, _ in kept(recorded, "serial")}
    assert any("polynomial fit_rms_percent_fs" in each for each in values.values())


@pytest.mark.nightly
def test_every_scheduler_gives_the_same_bits(recorded: Plant, tmp_path: Path) -> None:
    """Evaluate by the command in this process, in several processes, and on an existing cluster."""
    plant = ("--plant", recorded.url.render_as_string(hide_password=False))
    with cluster(tmp_path) as address:
        reevaluate(recorded, "serial", label="one")
        for label, scheduler in (
            ("two", "processes"),
            ("three", address),
        ):
            options = ("--scheduler", scheduler, "--label", label)
            done = run("plant", "reevaluate", *options, *plant, cwd=tmp_path)
            assert done.returncode == 0, done.stderr
            assert widest_line(done.stdout) <= 80
            assert "runs with a change: 0" in done.stdout
    one, two, three = (kept(recorded, label) for label in ("one", "two", "three"))
    assert len(one) == 4
    assert one == two == three
    options = ("--scheduler", "tcp://127.0.0.1:1", "--label", "four")
    done = run("plant", "reevaluate", *options, *plant, cwd=tmp_path)
    assert done.returncode == 2
    assert "address of a Dask cluster" in " ".join(done.stderr.split())


def test_what_was_broken_off_goes_on_where_it_was(recorded: Plant) -> None:
    class Stopped(NoProgress):
        def reach(self, _done: int, _detail: str = "") -> None:
            raise KeyboardInterrupt

    first = reevaluate(recorded, "serial", label="again", limit=3)
    assert (first.done, first.known) == (3, 0)
    with pytest.raises(KeyboardInterrupt):
        reevaluate(recorded, "serial", label="again", progress=Stopped())
    last = reevaluate(recorded, "serial", label="again")
    assert (last.done, last.known) == (0, 4)


DEADLY = """
import os
import time

import dask

from torquebench_plant.reevaluation import _pool
from torquebench_plant.reevaluation import RunTask, SealedFolder


class Deadly(str):
    def startswith(self, *_):
        time.sleep(5.0)  # a nanny whose worker dies before it has reported restarts none
        os._exit(1)


if __name__ == "__main__":
    kinds = ("verify-input", Deadly("verify-input"), "check-input")
    tasks = [
        RunTask(1, f"run-{number}", kind, "file:///nowhere", SealedFolder("runs/none", ""))
        for number, kind in enumerate(kinds)
    ]
    # A worker that starts on a busy machine now and then dies of itself, but not twice.
    dask.config.set({"distributed.scheduler.allowed-failures": 1})
    with _pool("processes", 1) as pool:
        for (each,) in pool.results(iter([tasks])):
            print(each.run_id, each.problem)
"""


@pytest.mark.nightly
def test_a_run_that_kills_its_worker_does_not_hold_up_the_others(tmp_path: Path) -> None:
    """Runs in a lost worker's chunk are evaluated alone; only the faulty run has a problem."""
    script = tmp_path / "deadly.py"
    script.write_text(DEADLY)
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, check=False, timeout=300
    )
    assert done.returncode == 0, done.stderr
    found = dict(line.split(" ", 1) for line in done.stdout.splitlines())
    assert found.keys() == {"run-0", "run-1", "run-2"}, done.stderr
    assert "its workers were killed, tcp://" in found.pop("run-1")
    for problem in found.values():
        assert problem
        assert "killed" not in problem


def test_what_changed_stands_beside_what_was_found(recorded: Plant) -> None:
    reevaluate(recorded, "serial", label="now", kinds=["test"])
    with recorded.transaction() as connection:
        connection.execute(
            text(
                "INSERT INTO plant.reevaluations (bench_key, run_id, label, software_version, "
                'manifest_sha256, earlier, "values", evaluated) SELECT bench_key, run_id, '
                "'other', '9', manifest_sha256, earlier, replace(\"values\", '0.8', '0.9'), now() "
                "FROM plant.reevaluations WHERE label = 'now'"
            )
        )
    (row,) = differences(recorded, "other").rows()
    assert (row["what"], row["earlier"], row["now"]) == ("backlash value", 0.8, 0.9)
    (row,) = differences(recorded, "other", against="now").rows()
    assert row["change"] == pytest.approx(0.1)


def test_a_folder_that_no_evaluation_expects_holds_up_no_other(
    plant: Plant, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There are more runs than in a page or chunk; one has a recording without numbers."""
    columns = {
        "name": pa.array(["a"]),
        "shape": pa.array([[1]]),
        "numbers": pa.array([None], pa.list_(pa.float64())),
        "integers": pa.array([None], pa.list_(pa.int64())),
    }
    header = {"format": 1, "software_version": "0.2.0", "content": {"array": "a"}}
    empty = pa.table(columns).replace_schema_metadata({"torquebench.recording": json.dumps(header)})
    pq.write_table(empty, tmp_path / "empty.parquet")
    files = {RECORDING: (tmp_path / "empty.parquet").read_bytes()}
    monkeypatch.setattr("torquebench_plant.reevaluation.PAGE", 3)
    monkeypatch.setattr("torquebench_plant.reevaluation.CHUNK", 2)
    _, link = plant.register_bench("Bench 1")
    with Registry.open(tmp_path / "data") as registry:
        for number in range(7):
            results = backlash_results("S-1", 0.8)
            estimate = Budget(0.8, 0.025, float("inf"), (), "arcmin")
            results["quantities"][0]["budget"] = plain_budget(estimate)
            run_id = f"2026010{number + 1}T000000Z-test-hysteresis-000{number}"
            given = files if number == 3 else None
            add_run(registry, run_id, "test-hysteresis", results, hours=number, files=given)
        assert forward(registry, link).problems == []
    first = reevaluate(plant, "serial", label="odd", limit=5)
    assert (first.done, first.known, first.problems) == (5, 0, 1)
    rest = reevaluate(plant, "serial", label="odd", limit=2)  # before the one that was tried
    assert (rest.done, rest.known, rest.problems) == (2, 4, 0)
    last = reevaluate(plant, "serial", label="odd")
    assert (last.done, last.known, last.problems) == (1, 6, 1)
    facts = differences(plant, "odd").facts
    assert (facts["runs"], facts["runs that can't be evaluated"]) == (7, 1)
    assert {run for run, _, problem in kept(plant, "odd") if problem} == {
        "20260104T000000Z-test-hysteresis-0003"
    }


@pytest.mark.parametrize(
    ("kind", "results", "said"),
    [
        ("test-hysteresis", backlash_results("S-1"), "no budget of backlash"),
        nightly("test-hysteresis", {"quantities": [{}]}, "a value key is missing; reevaluation.py"),
        nightly("test-hysteresis", None, "has no quantities"),
        ("calibrate-output", calibration_results(), "has no document of its start"),
        nightly("calibrate-output", {"data": {}}, "has other columns"),
        ("verify-output", {"serial": "S-1"}, "holds no points"),
    ],
)
def test_what_lacks_something_says_what(
    kind: str, results: Any, said: str, plant: Plant, tmp_path: Path
) -> None:
    """Version 0.2.0 gave the messages "KeyError: 'budget'" and "StopIteration: "."""
    _, link = plant.register_bench("Bench 1")
    with Registry.open(tmp_path / "data") as registry:
        add_run(registry, f"20260105T000000Z-{kind}-0000", kind, results)
        assert forward(registry, link).problems == []
    assert reevaluate(plant, "serial", label="lacking").problems == 1
    (row,) = differences(plant, "lacking").rows()
    assert said in row["what"]


def test_a_changed_file_and_a_withdrawn_run_are_left_out(plant: Plant, tmp_path: Path) -> None:
    _, link = plant.register_bench("Bench 1")
    with Registry.open(tmp_path / "data") as registry:
        add_reducer_test(registry)
        assert forward(registry, link).problems == []
    run_id = "20260105T000000Z-test-hysteresis-0000"
    file = Path(plant.run(run_id).url.removeprefix("file://")) / "results.json"
    content = file.read_bytes()
    file.write_bytes(content.replace(b"0.8", b"0.7"))
    done = reevaluate(plant, "serial", label="changed", kinds=["test"])
    file.write_bytes(content)
    assert done.problems == 1
    (row,) = differences(plant, "changed").rows()
    assert "was changed after sealing" in row["what"]
    # Whatever kept a run from being evaluated, such as a share that was away: it is tried again.
    again = reevaluate(plant, "serial", label="changed", kinds=["test"])
    assert (again.done, again.known, again.problems) == (1, 0, 0)
    found = differences(plant, "changed")
    assert found.rows() == []
    assert (found.facts["runs"], found.facts["runs that can't be evaluated"]) == (1, 0)
    assert differences(plant, "changed", against="changed").facts["values compared"] == 3
    with pytest.raises(InputError, match="calibrate, check, verify, test"):
        reevaluate(plant, kinds=["zero"])
    plant.withdraw(plant.run(run_id), by="Boss", reason="slipped")
    assert reevaluate(plant, "serial", label="left", kinds=["test"]).done == 0
