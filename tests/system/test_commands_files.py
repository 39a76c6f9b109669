"""Fit, apply and verify on a user's own files."""

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.system.command_line import run, widest_line


def write_table(path: Path, seed: int, groups: int = 1) -> None:
    """Write a chain with a quadratic error per direction, up and down, 2000 N·m."""
    rng = np.random.default_rng(seed)
    rising = np.linspace(100.0, 2000.0, 20) - (0.0 if groups == 1 else 30.0)
    loop = np.concatenate([rising, rising[-2::-1]])
    lines = ["reading_nm,standard_nm,series"]
    for group in range(1, groups + 1):
        for number, sign in enumerate((1.0, -1.0)):
            standard = sign * loop
            reading = 0.995 * standard + 1e-6 * np.abs(standard) * standard
            reading = reading + rng.normal(0.0, 0.2, standard.size)
            series = 2 * group - 1 + number if groups == 1 else group
            lines += [f"{r:.4f},{s:.4f},{series}" for r, s in zip(reading, standard, strict=True)]
    path.write_text("\n".join(lines) + "\n")


def test_fit_apply_verify(tmp_path: Path) -> None:
    write_table(tmp_path / "data.csv", seed=1)
    write_table(tmp_path / "fresh.csv", seed=2, groups=2)
    arguments = ("fit", "data.csv", "--range", 2000, "--out", "model.json")
    fitted = run(*arguments, "--report", "model.html", cwd=tmp_path)
    assert fitted.returncode == 0, fitted.stderr
    assert "data.csv: physics + Gaussian process" in fitted.stdout
    assert "bayesian-network" not in fitted.stdout
    assert widest_line(fitted.stdout) <= 80
    report = (tmp_path / "model.html").read_text()
    assert "<svg" in report
    assert "Before and after" in report

    (tmp_path / "readings.csv").write_text(
        "note;reading_nm\nfirst;-1500,5\nsecond;0\nthird;1990,25\n"
    )
    arguments = ("apply", "model.json", "readings.csv", "--out", "torque.csv")
    applied = run(*arguments, cwd=tmp_path)
    assert applied.returncode == 0, applied.stderr
    with (tmp_path / "torque.csv").open() as file:
        rows = list(csv.DictReader(file, delimiter=";"))
    assert [row["note"] for row in rows] == ["first", "second", "third"]
    for row in rows:
        reading, torque, additional, expanded = (
            float(row[name].replace(",", "."))
            for name in (
                "reading_nm",
                "torque_nm",
                "additional_torque_nm",
                "expanded_uncertainty_nm",
            )
        )
        assert abs(reading + additional - torque) < 1e-6
        assert 0.1 < expanded < 4.0

    verified = run("verify", "model.json", "fresh.csv", cwd=tmp_path)
    said = " ".join(verified.stdout.split())
    assert "not in U, because no record exists: " in said
    assert "drift since calibration" in said
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert "within the tolerance" in verified.stdout
    strict = run("verify", "model.json", "fresh.csv", "--tolerance", 0.0001, cwd=tmp_path)
    assert strict.returncode == 1
    assert "out of the tolerance" in strict.stdout
    shutil.copy(tmp_path / "model.json", tmp_path / "other.json")
    beside = run(
        *("verify", "model.json", "fresh.csv", "--other", "other.json", "--report", "v.html"),
        cwd=tmp_path,
    )
    assert beside.returncode == 0, beside.stderr
    assert "other: " in beside.stdout
    assert widest_line(beside.stdout) <= 80
    page = (tmp_path / "v.html").read_text()
    assert "repeatability ≤ 0.1 %" in page
    assert page.count("<svg") == 2
    own = run("verify", "model.json", "data.csv", cwd=tmp_path)
    assert "this isn't a verification" in " ".join(own.stderr.split())


@pytest.mark.nightly
def test_all_kinds_are_compared_on_demand(tmp_path: Path) -> None:
    write_table(tmp_path / "data.csv", seed=1)
    arguments = ("fit", "data.csv", "--model", "polynomial-2", "--compare")
    fitted = run(*arguments, "--out", "model.json", "--report", "fit.html", cwd=tmp_path)
    assert fitted.returncode == 0, fitted.stderr
    for text in (
        "bayesian-network",
        "published-network",
        "hybrid",
        "data.csv: polynomial, degree 2",
    ):
        assert text in fitted.stdout
    assert widest_line(fitted.stdout) <= 80
    assert "Comparison of models" in (tmp_path / "fit.html").read_text()


def test_parameters_of_the_network_and_its_training_curve(tmp_path: Path) -> None:
    write_table(tmp_path / "data.csv", seed=1)
    command = ("fit", "data.csv", "--model", "published-network", "--parameter", "epochs=700")
    others = ("--parameter", "start=small-uniform", "--report", "fit.html")
    fitted = run(*command, *others, cwd=tmp_path)
    assert fitted.returncode == 0, fitted.stderr
    report = (tmp_path / "fit.html").read_text()
    assert "700 epochs" in report
    assert "small-uniform" in report
    refused = run(*command, "--parameter", "epochs=800", cwd=tmp_path)
    assert refused.returncode == 2
    assert "parameter epochs twice" in refused.stderr


def test_a_named_model_and_one_direction(tmp_path: Path) -> None:
    standard = np.repeat(np.linspace(0.0, 360.0, 10), 2)
    reading = standard / 1.01 + np.random.default_rng(3).normal(0.0, 0.1, standard.size)
    rows = [
        f"{r:.4f},{s:.4f},{1 + k % 2}"
        for k, (r, s) in enumerate(zip(reading, standard, strict=True))
    ]
    (tmp_path / "arm.csv").write_text("reading_nm,standard_nm,series\n" + "\n".join(rows) + "\n")
    arguments = ("fit", "arm.csv", "--range", 360, "--one-direction", "--model", "polynomial-1")
    result = run(*arguments, "--out", "arm.json", "--report", "arm-report.html", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "arm.csv: polynomial, degree 1" in result.stdout
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["arm-report.html", "arm.csv", "arm.json"]
