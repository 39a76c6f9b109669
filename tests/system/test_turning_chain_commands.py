"""A chain that turns, by command and by files: fit with empty runs, apply, verify."""

import json
from pathlib import Path

import numpy as np
import pytest
from tests.system.command_line import run, widest_line
from tests.system.test_json_answers import misfits
from tests.unit.chain.test_turning_chains import (
    INERTIA,
    NOISE_NM,
    RANGE_NM,
    calibration,
    drag,
    empty_run,
    zero_shift,
)

from torquebench.chain import Reference, load_chain
from torquebench.operations.dynamics import EvaluatedLubrication
from torquebench.units import RAD_S_PER_RPM

RUNS = (12.0, 23.0, 38.0)


def write(path: Path, names: str, *columns: np.ndarray) -> None:
    table = np.column_stack(columns)
    np.savetxt(path, table, delimiter=",", header=names, comments="", fmt="%.9g")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of a calibration, three empty runs, and a record of all quantities with its truth."""
    path = tmp_path_factory.mktemp("turning")
    points = calibration()
    assert points.temperature_c is not None
    write(
        path / "calibration.csv",
        "reading_nm,standard_nm,branch,temperature_c",
        points.reading_nm,
        points.standard_nm,
        points.branch,
        points.temperature_c,
    )
    for number, celsius in enumerate(RUNS):
        each = empty_run(celsius, number)
        columns = (each.time_s, each.reading_nm, each.speed_rpm, each.temperature_c)
        write(path / f"{celsius:g}.csv", "time_s,reading_nm,speed_rpm,temperature_c", *columns)
    time_s = 0.05 * np.arange(2000)
    torque = 0.9 * RANGE_NM * np.sin(0.11 * time_s)
    speed, warm = 900.0 * np.sin(0.3 * time_s), 25.0 + 14.0 * np.sin(0.05 * time_s)
    reading = torque * (1 + 1e-4 * (warm - 23.0)) - 0.05 * (torque / RANGE_NM) ** 2
    reading = reading + zero_shift(warm) + drag(speed, warm)
    reading = reading + INERTIA * RAD_S_PER_RPM * np.gradient(speed, time_s)
    reading = reading + NOISE_NM * np.random.default_rng(5).standard_normal(time_s.size)
    branch = np.where(np.gradient(np.abs(torque)) >= 0, 1.0, -1.0)
    known = (time_s, reading, speed, warm, branch)
    write(path / "readings.csv", "time_s,reading_nm,speed_rpm,temperature_c,branch", *known)
    names = "time_s,reading_nm,speed_rpm,temperature_c,branch,standard_nm"
    write(path / "points.csv", names, *known, torque)
    return path


@pytest.fixture(scope="module")
def fitted(folder: Path) -> str:
    runs = [word for celsius in RUNS for word in ("--empty", f"{celsius:g}.csv")]
    result = run(
        "fit", "calibration.csv", *runs, "--range", RANGE_NM, "--out", "chain.json", cwd=folder
    )
    assert result.returncode == 0, result.stderr
    assert widest_line(result.stdout) <= 80
    assert "rotating reference would identify it" in " ".join(result.stderr.split())
    return result.stdout


def columns(path: Path) -> dict[str, np.ndarray]:
    table = np.genfromtxt(path, delimiter=",", names=True)
    return {name: table[name] for name in table.dtype.names}


def test_readings_become_torque_whatever_turns_and_warms(folder: Path, fitted: str) -> None:
    assert "inertia" in fitted
    assert "zero over temperature" in fitted
    result = run("apply", "chain.json", "readings.csv", "--out", "torque.csv", cwd=folder)
    assert result.returncode == 0, result.stderr
    found, truth = columns(folder / "torque.csv"), columns(folder / "points.csv")["standard_nm"]
    error = found["torque_nm"] - truth
    raw = found["reading_nm"] - truth
    assert np.sqrt(np.mean(error**2)) < 0.15 * np.sqrt(np.mean(raw**2))
    covered = np.mean(np.abs(error) <= found["expanded_uncertainty_nm"])
    assert covered > 0.9
    verified = run("verify", "chain.json", "points.csv", "--report", "v.html", cwd=folder)
    assert verified.returncode == 0, verified.stdout
    page = (folder / "v.html").read_text(encoding="utf-8")
    assert all(each in page for each in ("Speed, temperature and torque", "covered", "budget"))
    assert "whose error lies within U (k = 2)" in " ".join(verified.stdout.split())
    assert widest_line(verified.stdout) <= 80


def test_a_correction_is_switched_off_by_itself(folder: Path, fitted: str) -> None:
    assert fitted
    arguments = ("--without", "temperature", "--out", "off.csv")
    result = run("apply", "chain.json", "readings.csv", *arguments, cwd=folder)
    assert result.returncode == 0, result.stderr
    off, truth = columns(folder / "off.csv"), columns(folder / "points.csv")["standard_nm"]
    error = off["torque_nm"] - truth
    shift = zero_shift(off["temperature_c"]) + truth * 1e-4 * (off["temperature_c"] - 23.0)
    assert np.corrcoef(error, shift)[0, 1] > 0.9
    assert np.mean(np.abs(error) <= off["expanded_uncertainty_nm"]) > 0.9


def test_a_new_lubricant_is_a_factor_on_the_drag(folder: Path, fitted: str) -> None:
    assert fitted
    result = run(
        "evaluate", "lubrication", "23.csv", "--model", "chain.json", "--lubricant", "grease K",
        "--out", "renewed.json", "--json", cwd=folder,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    answer = json.loads(result.stdout)["answer"]
    assert misfits(answer, EvaluatedLubrication) == []
    factor = answer["factor"]
    assert abs(factor["value"] - 1.0) < factor["expanded_uncertainty"] < 0.3
    assert answer["record"].endswith("by 23.csv (grease K)")
    result = run("apply", "renewed.json", "readings.csv", "--out", "renewed.csv", cwd=folder)
    assert result.returncode == 0, result.stderr
    lines = (folder / "23.csv").read_text().splitlines()
    (folder / "short.csv").write_text("\n".join(lines[:60]) + "\n")
    refused = run("evaluate", "lubrication", "short.csv", "--model", "chain.json", "--out",
                  "no.json", cwd=folder)  # fmt: skip
    assert refused.returncode == 2
    assert "both directions" in " ".join(refused.stderr.split())
    assert not (folder / "no.json").exists()


def test_what_the_record_of_an_effect_does_not_cover_is_refused_by_line(
    folder: Path, fitted: str
) -> None:
    assert fitted
    (folder / "fast.csv").write_text(
        "time_s,reading_nm,speed_rpm,temperature_c\n0,1,500,23\n0.1,1,1500,23\n0.2,1,500,23\n"
    )
    result = run("apply", "chain.json", "fast.csv", "--out", "no.csv", cwd=folder)
    assert result.returncode == 2
    said = " ".join(result.stderr.split())
    assert "fast.csv, line 3" in said
    assert "rotation, measured: speed 1500 1/min" in said
    assert not (folder / "no.csv").exists()
    (folder / "still.csv").write_text("reading_nm\n1\n2\n")
    result = run("apply", "chain.json", "still.csv", "--out", "still-torque.csv", cwd=folder)
    assert result.returncode == 0, result.stderr
    assert "temperature_c" in result.stdout
    assert "acceleration_rad_s2" in result.stdout


def test_what_turn_writes_is_what_fit_and_apply_take(tmp_path: Path) -> None:
    """The bench's own tables, from the runs to the torque."""
    ramps = "speed_shares = [0.25, 0.5, 1.0]\nhold_s = 0.2\nsettle_s = 0.2\n"
    ends = "[largest_rpm]\ninput = 1200\n[ramps]\ngentle_s = 4\nsteep_s = 2\n"
    (tmp_path / "run.toml").write_text(ramps + ends)
    loads = 'kind = "calibration"\ntorque_shares = [0.25, 0.5, 0.75, 1.0]\n'
    (tmp_path / "load.toml").write_text(loads + ramps.replace("0.25, 0.5, 1.0", "1.0") + ends)
    (tmp_path / "random.toml").write_text(
        'kind = "verification"\ntorque_shares = [1.0]\nspeed_shares = [0.5, 1.0]\n'
        "hold_s = 0.2\nsettle_s = 0.5\n[random]\nspeeds = 2\ntorques = 3\n" + ends
    )
    runs = ("run.toml", "empty.csv"), ("load.toml", "points.csv"), ("random.toml", "fresh.csv")
    for profile, table in runs:
        words = ("turn", "input", "--profile", profile, "--out", table)
        turned = run(*words, cwd=tmp_path)
        assert turned.returncode == 0, turned.stderr
    words = ("fit", "points.csv", "--empty", "empty.csv", "--out", "m.json", "--report", "m.html")
    fitted = run(*words, cwd=tmp_path)
    assert fitted.returncode == 0, fitted.stderr
    kept = load_chain(tmp_path / "m.json").stored
    (standard,) = (each for each in kept if isinstance(each, Reference))
    assert standard.record == "certificate SIM-CERT-1 of SIM-CAL-1"
    page = (tmp_path / "m.html").read_text()
    assert "bearing drag" in page
    assert "not identified: zero over temperature" in page
    assert "inertia" in fitted.stdout
    verified = run("verify", "m.json", "fresh.csv", "--report", "fresh.html", cwd=tmp_path)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert "8 readings" in verified.stdout
    assert "Speed, temperature and torque" in (tmp_path / "fresh.html").read_text()
    applied = run("apply", "m.json", "empty.csv", "--out", "torque.csv", cwd=tmp_path)
    assert applied.returncode == 0, applied.stderr
    rows = [line for line in (tmp_path / "torque.csv").read_text().splitlines() if line[0] != "#"]
    at = rows[0].split(",")
    table = np.array([[float(cell) for cell in row.split(",")] for row in rows[1:]])
    torque, reading = table[:, at.index("torque_nm")], table[:, at.index("reading_nm")]
    assert np.std(torque) < 0.8 * np.std(reading)
    assert abs(np.mean(torque)) < 0.001 * RANGE_NM
