"""`evaluate dynamics` and `apply --dynamics` on tables of a simulated chain."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from tests.system.command_line import run
from tests.unit.dynamics.simulated_chain import SimulatedChain, sines, slow, steps
from tests.unit.dynamics.test_identification import empty_run

CHAIN = SimulatedChain(interval_s=1e-4, noise_nm=0.005)


def write(path: Path, names: str, *columns: np.ndarray) -> None:
    rows = "\n".join(
        ",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)
    )
    path.write_text(f"# simulated = true\n{names}\n{rows}\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("dynamics")
    for name, torque, duration_s in (("steps", steps, 0.09), ("sines", sines, 0.25)):
        write(
            folder / f"{name}.csv", "time_s,reading_nm,standard_nm", *CHAIN.run(torque, duration_s)
        )
    write(folder / "empty.csv", "time_s,reading_nm,speed_rpm", *empty_run())
    write(folder / "slow.csv", "time_s,reading_nm,standard_nm", *CHAIN.run(slow, 0.3))
    standard = np.linspace(-50.0, 50.0, 41)
    write(folder / "calibration.csv", "reading_nm,standard_nm", standard * 0.998, standard)
    assert run("fit", "calibration.csv", "--model", "polynomial", cwd=folder).returncode == 0
    found = run(
        "evaluate", "dynamics", "steps.csv", "sines.csv", "--empty", "empty.csv",
        "--out", "dynamics.json", cwd=folder,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    text = " ".join(found.stdout.split())
    for word in ("simulated", "resonance 510", "stiffness", "inertia", "overshoot of a step"):
        assert word in text, text
    return folder


def test_dynamics_are_identified_and_stored_with_what_they_are_from(folder: Path) -> None:
    content = json.loads((folder / "dynamics.json").read_text())
    assert content["simulated"] is True
    assert set(content["tables_sha256"]) == {"steps.csv", "sines.csv", "empty.csv"}
    assert content["shaft"]["stiffness_nm_rad"] == pytest.approx(25_700.0, rel=0.02)
    step = content["step"]
    assert step["compensated"]["bandwidth_hz"] > 3.0 * step["raw"]["bandwidth_hz"]
    assert step["compensated"]["overshoot"] <= 0.05


def test_quick_torques_come_back_by_apply(folder: Path) -> None:
    plain = ("apply", "model.json", "steps.csv", "--out")
    assert run(*plain, "plain.csv", cwd=folder).returncode == 0
    found = run(*plain, "quick.csv", "--dynamics", "dynamics.json", cwd=folder)
    assert found.returncode == 0, found.stderr
    assert "up to 0.4 ms later" in " ".join(found.stdout.split())
    truth = CHAIN.run(steps, 0.09)[2]
    errors = {}
    for name in ("plain", "quick"):
        lines = (folder / f"{name}.csv").read_text().splitlines()[1:]
        torque = np.array([float(row["torque_nm"]) for row in csv.DictReader(lines)])
        errors[name] = np.sqrt(np.mean((torque[100:-4] - truth[100:-4]) ** 2))
    assert errors["quick"] < 0.35 * errors["plain"]


def test_dynamics_become_part_of_a_chain_by_fit(folder: Path, tmp_path: Path) -> None:
    whole = tmp_path / "whole.json"
    made = run("fit", "calibration.csv", "--model", "polynomial", "--dynamics", "dynamics.json",
               "--out", str(whole), cwd=folder)  # fmt: skip
    assert made.returncode == 0, made.stderr
    tables = []
    for arguments in ((str(whole),), ("model.json", "--dynamics", "dynamics.json")):
        table = tmp_path / f"{len(tables)}.csv"
        found = run("apply", arguments[0], "steps.csv", *arguments[1:], "--out", str(table),
                    cwd=folder)  # fmt: skip
        assert found.returncode == 0, found.stderr
        lines = table.read_text().splitlines()[1:]
        tables.append([float(row["torque_nm"]) for row in csv.DictReader(lines)])
    np.testing.assert_allclose(tables[0], tables[1], rtol=1e-9, atol=1e-9)


def test_what_cannot_be_used_is_refused_and_nothing_is_written(folder: Path) -> None:
    before = sorted(path.name for path in folder.iterdir())
    for arguments, word in (
        (("evaluate", "dynamics", "slow.csv", "--out", "no.json"), "sines to beyond the resonance"),
        (("evaluate", "dynamics", "empty.csv", "--out", "no.json"), "standard_nm"),
        (
            ("apply", "model.json", "empty.csv", "--out", "no.csv", "--dynamics", "dynamics.json"),
            "at the rate of the readings",
        ),
        (
            ("apply", "model.json", "steps.csv", "--out", "no.csv", "--dynamics", "model.json"),
            "holds no dynamics",
        ),
    ):
        refused = run(*arguments, cwd=folder)
        assert refused.returncode == 2, refused.stdout
        assert word in " ".join(refused.stderr.split())
    assert sorted(path.name for path in folder.iterdir()) == before


def test_an_inertia_by_uncompensated_readings_says_how_wrong_it_may_be(folder: Path) -> None:
    content = json.loads((folder / "dynamics.json").read_text())
    inertia = content["inertia"]
    assert inertia["standard_uncertainty_kgm2"] >= 0.1 * inertia["inertia_kgm2"]
