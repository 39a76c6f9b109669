"""Calibrate on the simulated bench, then measure with the model and look at the records."""

import json
import re
from html import unescape
from pathlib import Path

import pytest
from tests.system.command_line import run, widest_line


def test_a_dry_run_shows_the_staircase_and_leaves_nothing(tmp_path: Path) -> None:
    result = run("calibrate", "both", "--dry-run", "--data", "data", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert re.search(r"Points +400\b", result.stdout)
    assert "mount the calibrator" in " ".join(result.stdout.split())
    assert "2000 of 2400 N·m" in result.stdout
    assert "nothing was moved" in result.stdout
    assert widest_line(result.stdout) <= 80
    assert not list(tmp_path.iterdir())


def test_rising_only_halves_the_staircase(tmp_path: Path) -> None:
    result = run("calibrate", "output", "--rising-only", "--dry-run", cwd=tmp_path)
    assert re.search(r"Points +100\b", result.stdout)
    assert "points falling" not in result.stdout


def test_parameters_of_the_network_and_the_mounting_are_kept(
    tmp_path: Path,
) -> None:
    command = ("calibrate", "output", "--rising-only", "--step", 20, "--data", "data")
    parameters = ("--parameter", "epochs=120", "--parameter", "start=small-uniform")
    alone = run(*command, *parameters, cwd=tmp_path)
    assert alone.returncode == 2
    assert "name one model only" in alone.stderr
    wrong = run(*command, "--mounting", "coaxiality_mm=-1", cwd=tmp_path)
    assert wrong.returncode == 2
    assert "coaxiality_mm" in wrong.stderr
    mounted = ("coaxiality_mm=0.041", "clamp_pressure_bar=160", "duration_min=25")
    lubricated = ("lubricant=grease 2", "lubricant_hours=12")
    made = run(
        *(*command, "--model", "published-network", *parameters, "--report", "r.html"),
        *(part for each in (*mounted, *lubricated) for part in ("--mounting", each)),
        cwd=tmp_path,
    )
    assert made.returncode == 0, made.stderr
    assert "more than 0.03 mm" in made.stderr
    stated = ("0.041 mm (> 0.03 mm)", "160 bar", "25 min", "grease 2, 12 h")
    report = (tmp_path / "r.html").read_text()
    assert "Loading accuracy" in report
    policy = tmp_path / "data" / "laboratory.toml"
    policy.write_text('[policy]\nunreviewed = "state"\n')
    certified = run(
        *("certificate", "latest", "--authorised-by", "Ana", "--out", "out", "--data", "data"),
        cwd=tmp_path,
    )
    assert certified.returncode == 0, certified.stderr
    (certificate,) = (tmp_path / "out").glob("*.json")
    for words in stated:
        assert words in unescape(report), words
        assert words in certificate.read_text(), words
    (file,) = (tmp_path / "data" / "models").iterdir()
    parameters = json.loads(file.read_text())["model"]["parameters"]
    assert (parameters["epochs"], parameters["start"]) == (120, "small-uniform")


def test_calibrate_measure_records(tmp_path: Path) -> None:
    options = ("--step", 10, "--data", "data")
    calibrated = run("calibrate", "both", *options, cwd=tmp_path)
    assert calibrated.returncode == 0, calibrated.stderr
    assert re.findall(r"In use +model-(\d)", calibrated.stdout) == ["1", "3"]
    assert "modules - simulated" in calibrated.stdout
    assert widest_line(calibrated.stdout) <= 80
    assert "\x1b" not in calibrated.stdout + calibrated.stderr

    measured = run("measure", "--zero", "--count", 2, "--data", "data", cwd=tmp_path)
    assert measured.returncode == 0, measured.stderr
    lines = measured.stdout.splitlines()
    assert len(lines) == 2
    for line in lines:
        assert len(line) <= 80
        assert line.count("±") == 2, line
        torques = re.findall(r"(-?\d+\.\d+) ± +(\d+\.\d+)", line)
        assert abs(float(torques[0][0])) < 0.01  # 0.02 % of full scale, as the raw reading
        assert abs(float(torques[1][0])) < 0.4
    assert "compensated by model-" in measured.stderr
    assert "hysteresis" not in measured.stderr
    unzeroed = run("measure", "--count", 1, "--data", "data", cwd=tmp_path)
    assert "of it are hysteresis" in " ".join(unzeroed.stderr.split())

    listed = run("records", "list", "--data", "data", cwd=tmp_path)
    assert listed.returncode == 0
    for text in ("calibrate-input", "calibrate-output", "zero", "model-2", "calibration-2", "yes"):
        assert text in listed.stdout
    assert widest_line(listed.stdout) <= 80
    for name in ("latest", "model-1", "calibration-1"):
        shown = run("records", "show", name, "--data", "data", cwd=tmp_path)
        assert shown.returncode == 0, shown.stderr
        assert "NOT INTACT" not in shown.stdout
        assert widest_line(shown.stdout) <= 80
    missing = run("records", "show", "model-99", "--data", "data", cwd=tmp_path)
    assert missing.returncode == 2

    checked = run("doctor", "--data", "data", cwd=tmp_path)
    assert checked.returncode == 0, checked.stdout
    assert "model-1" in checked.stdout
    assert checked.stdout.rstrip().endswith("Ready.")


def test_a_changed_model_file_is_noticed(tmp_path: Path) -> None:
    run("calibrate", "input", "--step", 25, "--model", "hybrid", "--data", "data", cwd=tmp_path)
    (model,) = (tmp_path / "data" / "models").iterdir()
    model.write_text(model.read_text().replace("created", "forged"))
    shown = run("records", "show", "model-1", "--data", "data", cwd=tmp_path)
    assert "NOT INTACT" in shown.stdout


def test_doctor_without_records_is_ready_and_leaves_nothing(tmp_path: Path) -> None:
    result = run("doctor", "--data", "data", cwd=tmp_path)
    assert result.returncode == 0, result.stdout
    assert "none in data yet" in result.stdout
    assert "no active model" in " ".join(result.stdout.split())
    assert widest_line(result.stdout) <= 80
    assert not list(tmp_path.iterdir())


def test_doctor_names_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text('[bench]\nname = "x"\n')
    result = run("doctor", "--bench", "bench.toml", cwd=tmp_path)
    assert result.returncode == 1
    assert "problem" in result.stdout
    assert "Traceback" not in result.stdout + result.stderr


@pytest.mark.nightly
def test_a_part_of_the_range_is_calibrated_and_nothing_above_it_is_loaded(tmp_path: Path) -> None:
    part = ("calibrate", "output", "--profile", "small-torques", "--up-to", 60)
    shown = run(*part, "--dry-run", cwd=tmp_path)
    assert shown.returncode == 0, shown.stderr
    assert "60 of 2400 N·m" in shown.stdout
    quick = ("--repeats", 1, "--model", "polynomial", "--data", "data")
    calibrated = run(*part, *quick, "--report", "cal.html", cwd=tmp_path)
    assert calibrated.returncode == 0, calibrated.stderr
    assert re.search(r"In use +model-1", calibrated.stdout)
    assert "Loading accuracy" in calibrated.stdout
    report = (tmp_path / "cal.html").read_text()
    assert "Calibration of the output module" in report
    assert "Loading accuracy" in report
    assert report.count("<svg") >= 3
    checked = run("check", "output", "--data", "data", cwd=tmp_path)
    assert checked.returncode == 0, checked.stdout + checked.stderr
    loaded_nm = [float(each) for each in re.findall(r"(?m)^ *(-?\d+\.\d+)", checked.stdout)]
    assert 55.0 < max(loaded_nm) < 62.0
    loaded = run(
        "test", "hysteresis", "--reducer", "rv-40e", "--short", "--data", "data", cwd=tmp_path
    )
    assert loaded.returncode == 2
    assert "model-1, which was calibrated up to" in " ".join(loaded.stderr.split())
    for wrong in (("both", 60), ("output", 601), ("output", 0)):
        side, torque = wrong
        refused = run(
            "calibrate", side, "--profile", "small-torques", "--up-to", torque, cwd=tmp_path
        )
        assert refused.returncode == 2
        assert "allowed" in refused.stderr
