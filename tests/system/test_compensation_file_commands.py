"""Export a model's table, budget a reading, and treat outliers as chosen: by command."""

from pathlib import Path

import numpy as np
import pytest
from tests.system.command_line import run, widest_line

from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import store_model
from torquebench.compensation import load_model, make_model
from torquebench.tables.formats import endings, format_of, format_of_content

RANGE = 2000.0


def points(*, outlier_nm: float = 0.0) -> CalibrationData:
    """Points of a chain with a loop, up and down in both directions."""
    share = np.linspace(0.05, 1.0, 12)
    share = np.concatenate([share, share[::-1], -share, -share[::-1]])
    branch = np.repeat([1, -1, 1, -1], 12)
    noise = 1e-4 * np.random.default_rng(4).standard_normal(share.size)
    loop = 3e-4 * np.sign(share) * branch * (1.0 - np.abs(share))
    reading = RANGE * (0.997 * share + 1e-3 * share**2 + loop + noise)
    reading[7] += outlier_nm
    return CalibrationData(reading, RANGE * share, np.repeat([1, 2], 24), branch, RANGE)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    data = points()
    fitted = make_model("hybrid", range_nm=RANGE).fit(data.features(2), data.standard_nm)
    path = tmp_path_factory.mktemp("model") / "model.json"
    store_model(path, fitted, data, {"noise_nm": float(fitted.noise_nm_)})
    return path


@pytest.mark.nightly
def test_readings_are_compensated_into_every_written_format(model: Path, tmp_path: Path) -> None:
    (tmp_path / "readings.csv").write_text("reading_nm\n100\n-250.5\n")
    for ending in endings(written=True):
        done = run("apply", model, "readings.csv", "--out", f"t{ending}", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        file = tmp_path / f"t{ending}"
        assert format_of_content(file, file.read_bytes()[:64]) is format_of(file)


def test_a_model_is_exported_by_the_ending_of_the_file(model: Path, tmp_path: Path) -> None:
    result = run("export", model, "--out", "table.csv", "--decimal-comma", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "at most" in " ".join(result.stdout.split())
    assert widest_line(result.stdout) <= 80
    lines = (tmp_path / "table.csv").read_text("ascii").splitlines()
    rows = [line.replace(",", ".").split(";") for line in lines[int(lines[0].split()[1]) + 1 :]]
    table = np.array(rows, dtype=float)
    estimator = load_model(model).model
    reading = np.linspace(-1900.0, 1900.0, 78)  # not 0 itself, where it may step
    X = np.column_stack([reading, np.ones_like(reading)])
    read_back = np.interp(reading, table[:, 0], table[:, 1])
    np.testing.assert_allclose(read_back, estimator.predict(X), atol=2e-6 * RANGE)


def test_exports_that_cannot_be_are_refused(model: Path, tmp_path: Path) -> None:
    edited = tmp_path / "edited.json"
    edited.write_text(model.read_text().replace('"side": ""', '"side": "input"'))
    for arguments, word in (
        ((model, "--out", "table.xlsx"), ".csv or .h or .st or .onnx"),
        ((model, "--out", "table.h", "--decimal-comma"), "decimal comma"),
        ((edited, "--out", "table.h"), "changed after it was written"),
    ):
        result = run("export", *arguments, cwd=tmp_path)
        assert result.returncode == 2
        assert word in " ".join(result.stderr.split())
    assert [path.name for path in tmp_path.iterdir()] == ["edited.json"]


def test_a_budget_says_what_contributes_and_whether_monte_carlo_agrees(
    model: Path, tmp_path: Path
) -> None:
    arguments = ("--reading", 1500, "--reading", -20, "--branch", "up", "--span-limit", 0.05)
    stated = (
        "--temperature",
        28,
        "--reference",
        "0.02 of range",
        "--zero",
        0.01,
        "--drift",
        0.02,
    )
    result = run("budget", model, *arguments, *stated, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    text = " ".join(result.stdout.split())
    for word in (
        "scatter", "static curve", "reference standard", "temperature of span", "zero", "drift",
        "k = 2.00", "U = ", "degrees of freedom", "not in U, because no record exists: creep",
    ):  # fmt: skip
        assert word in text
    assert text.count("GUM and Monte Carlo") == 2
    assert widest_line(result.stdout) <= 80
    outside = run("budget", model, "--reading", 2500, cwd=tmp_path)
    assert outside.returncode == 2
    assert "outside the calibrated range" in " ".join(outside.stderr.split())


def test_an_outlier_is_named_or_refused_by_choice(tmp_path: Path) -> None:
    data = points(outlier_nm=25.0)
    cells = zip(data.reading_nm, data.standard_nm, data.branch, data.series, strict=True)
    names = {1: "up", -1: "down"}
    lines = [f"{r:.4f},{s:.4f},{names[int(b)]},{n}" for r, s, b, n in cells]
    (tmp_path / "data.csv").write_text(
        "\n".join(["reading_nm,standard_nm,branch,series", *lines]) + "\n"
    )
    arguments = ("fit", "data.csv", "--range", 2000, "--out", "model.json")
    refused = run(*arguments, "--outliers", "refuse", cwd=tmp_path)
    assert refused.returncode == 2
    assert "rows that agree with the others" in refused.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["data.csv"]
    kept = run(*arguments, cwd=tmp_path)
    assert kept.returncode == 0
    words = " ".join(kept.stderr.split())
    assert "outlier, left out: row 9: reading" in words
    assert f"reading {data.reading_nm[7]:.6g} N·m" in words
    assert (tmp_path / "model.json").exists()
