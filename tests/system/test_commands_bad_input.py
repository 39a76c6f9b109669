"""Bad input: one clear message, exit code 2, nothing half-written."""

from pathlib import Path

import numpy as np
import pytest
from tests.system.command_line import run, widest_line

from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import store_model
from torquebench.compensation import make_model

HEADER = "reading_nm,standard_nm\n"


def table(rows: list[str], header: str = HEADER) -> str:
    return header + "".join(f"{row}\n" for row in rows)


def ladder(low: int = -10, high: int = 10) -> list[str]:
    return [f"{198.0 * k},{200.0 * k}" for k in range(low, high + 1)]


BAD_TABLES = {
    "empty file": ("", "empty"),
    "missing column": (table(["1.0,2.0"], "reading_nm,reference\n"), "standard_nm"),
    "wrong unit": (table(["1.0,2.0"], "reading_nm,standard_lb\n"), "standard_lb"),
    "mixed decimal marks": (
        table(['"1,5",1.5', "2.5,2.5", *ladder()]),
        "decimal",
    ),
    "not a number": (table([*ladder(), "nan,100"]), "nan"),
    "text in a cell": (table([*ladder(), "abc,100"]), "abc"),
    "a spreadsheet's error": (table([*ladder(), "#DIV/0!,100"]), "#DIV/0!"),
    "duplicate points": (table([*ladder()[:13], *ladder()[12:]]), "repeats"),
    "one direction missing": (table(ladder(low=0)), "add --one-direction"),
    "range exceeded": (table([*ladder(), "2500.0,2500.0"]), "range"),
    "too few points": (table(["-198,-200", "198,200"]), "at least 5"),
}


def refused(result, *words: str) -> None:
    assert result.returncode == 2, result.stderr
    assert result.stderr.splitlines()[-1].startswith(("error", "allowed", "do", " "))
    assert "error" in result.stderr
    assert "Traceback" not in result.stderr
    assert widest_line(result.stderr) <= 80
    text = " ".join(result.stderr.split())
    for word in words:
        assert word in text, text


@pytest.mark.parametrize("case", BAD_TABLES)
def test_fit_refuses(case: str, tmp_path: Path) -> None:
    text, word = BAD_TABLES[case]
    (tmp_path / "data.csv").write_text(text)
    result = run("fit", "data.csv", "--range", 2000, "--out", "model.json", cwd=tmp_path)
    refused(result, word)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data.csv"]


def test_fit_refuses_before_it_works(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_text(table(ladder()))
    for arguments, word in (
        (("missing.csv",), "missing.csv"),
        (("data.csv", "--out", "no/folder/model.json"), "no/folder"),
        (("data.csv", "--out", "data.csv"), "ends in .json"),
        (("data.csv", "--model", "crystal-ball"), "crystal-ball"),
    ):
        refused(run("fit", *arguments, "--range", 2000, cwd=tmp_path), word)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data.csv"]


@pytest.fixture
def model(tmp_path: Path) -> Path:
    standard = np.linspace(-2000.0, 2000.0, 21)
    data = CalibrationData(
        0.99 * standard, standard, np.ones(21), np.zeros(21), 2000.0, transducer_serial="T-1"
    )
    fitted = make_model("polynomial-2", range_nm=2000.0).fit(data.features(1), data.standard_nm)
    path = tmp_path / "model.json"
    store_model(path, fitted, data, {})
    return path


def test_apply_refuses(model: Path, tmp_path: Path) -> None:
    readings = tmp_path / "readings.csv"
    for text, word in (
        ("reading_nm\n2500\n", "2500"),
        ("torque\n1\n", "reading_nm"),
        ("reading_nm,torque_nm\n1,2\n", "torque_nm"),
    ):
        readings.write_text(text)
        refused(run("apply", model, "readings.csv", "--out", "torque.csv", cwd=tmp_path), word)
        assert not (tmp_path / "torque.csv").exists()


def test_a_model_file_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "readings.csv").write_text("reading_nm\n1\n")
    (tmp_path / "model.json").write_text("{}")
    arguments = ("apply", "model.json", "readings.csv", "--out", "torque.csv")
    refused(run(*arguments, cwd=tmp_path), "model")
    assert not (tmp_path / "torque.csv").exists()


def test_points_of_another_transducer_are_refused(model: Path, tmp_path: Path) -> None:
    rows = "# transducer_serial = T-2\n" + table(ladder())
    (tmp_path / "data.csv").write_text(rows)
    refused(run("verify", model, "data.csv", cwd=tmp_path), "T-2", "T-1")


def test_a_wrong_bench_description_names_file_key_and_value(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text('[bench]\nname = "x"\ndriver = 7\n')
    result = run("calibrate", "output", "--bench", "bench.toml", "--yes", cwd=tmp_path)
    refused(result, "bench.toml", "driver")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bench.toml"]


def test_an_unknown_profile_and_records_that_are_not_there(tmp_path: Path) -> None:
    refused(run("calibrate", "output", "--profile", "nonsense", cwd=tmp_path), "rapid-in-situ")
    refused(run("records", "list", "--data", "nowhere", cwd=tmp_path), "nowhere")
    assert not list(tmp_path.iterdir())
