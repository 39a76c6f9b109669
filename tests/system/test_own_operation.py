"""An operation of one's own, from a file: command, plan, API, and what is wrong with a file."""

import json
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from tests.system.command_line import run, widest_line
from tests.system.panel_api import SLOW, administrator, program, serving

from torquebench.records import RunFolder

pytestmark = SLOW
CREEP = Path(__file__).parents[2] / "examples" / "operations" / "creep.py"
SHORT = {"side": "output", "torque_percent_fs": 50.0, "duration_s": 40.0, "interval_s": 10.0}
RESULT = {"headline", "verdict", "simulated", "run_ids", "remarks", "files", "torque_nm", "time_s",
          "creep_nm"}  # fmt: skip


def creep(*options: object, cwd: Path, path: object = CREEP) -> tuple[int, str, str]:
    done = run("creep", *options, cwd=cwd, TORQUEBENCH_OPERATIONS=str(path))
    return done.returncode, done.stdout, done.stderr


def test_its_command_rehearses_runs_and_records(tmp_path: Path) -> None:
    code, shown, _ = creep("output", "--torque", 75, "--dry-run", cwd=tmp_path)
    assert code == 0
    assert "1500 of 2400 N·m" in shown
    assert "calibrator" in shown
    assert not list(tmp_path.iterdir())

    code, refused, problem = creep("output", "--torque", 101, "--dry-run", cwd=tmp_path)
    assert (code, refused) == (2, "")
    assert "torque" in problem
    assert "100" in problem

    short = ("--duration", 40, "--interval", 10, "--data", "data")
    code, printed, problem = creep("output", *short, "--json", cwd=tmp_path)
    assert code == 0, problem
    answer = json.loads(printed)["answer"]
    assert set(answer) == RESULT
    assert len(answer["creep_nm"]) == len(answer["time_s"]) == 5
    assert answer["creep_nm"][0] == 0.0
    assert 0.0 < abs(answer["creep_nm"][-1]) < 0.5
    (folder,) = (tmp_path / "data" / "runs").iterdir()
    run_folder = RunFolder.open(folder)
    assert run_folder.run_id == answer["run_ids"][0]
    assert "creep-output" in run_folder.run_id
    code, printed, _ = creep("--help", cwd=tmp_path)
    assert "10 to 7200 s" in printed
    assert widest_line(printed) <= 80


@pytest.mark.nightly
def test_the_api_has_it_with_preview_and_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TORQUEBENCH_OPERATIONS", str(CREEP))
    with serving(tmp_path, "--fast", fresh=True) as server, administrator(server) as admin:
        assert "creep" in admin.get("/operations").text
        schemas = admin.get("/openapi.json").json()
        assert "/operations/creep" in {path.removeprefix("/api/v1") for path in schemas["paths"]}
        assert set(schemas["components"]["schemas"]["CreepResult"]["properties"]) == RESULT
        with program(server, admin, "tester", "operator") as tester:
            assert tester.post("/command", json={}).status_code == 200
            shown = tester.post("/operations/creep/preview", json=SHORT)
            assert shown.status_code == 200, shown.text
            assert shown.json()["largest_torque_nm"] == {"output": 1000.0}
            started = tester.post("/operations/creep", json=SHORT)
            assert started.status_code == 202, started.text
            job = started.json()
            deadline = time.monotonic() + 200.0
            while not job["finished"]:
                assert time.monotonic() < deadline, job
                time.sleep(0.1)
                job = tester.get(f"/jobs/{job['job_id']}").json()
        assert job["problem"] is None, job
        assert set(job["result"]) == RESULT
        assert len(job["result"]["creep_nm"]) == 5


@pytest.mark.parametrize(
    ("text", "found"),
    [
        (None, "no such file"),
        ("x = 1\n", "no operation"),
        ("x = 1\n1 / 0\n", "line 2: ZeroDivisionError"),
        ("x = (\n", "line 1: SyntaxError"),
        ("from torquebench.operations import Operation\n", "no operation"),
        (CREEP.read_text("utf-8").replace('"creep",', '"zero",'), "an operation 'zero'"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path: Path, text: str | None, found: str) -> None:
    path = tmp_path / "own.py"
    if text is not None:
        path.write_text(text, encoding="utf-8")
    code, shown, problem = creep("output", cwd=tmp_path, path=path)
    assert (code, shown) == (2, "")
    assert found in " ".join(problem.split())
    assert "Traceback" not in problem


@pytest.mark.nightly
def test_it_keeps_the_contract_of_operations() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", CREEP.parent],
        env=os.environ | {"TORQUEBENCH_OPERATIONS": str(CREEP)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout
