"""Standard output, endings and folders of every command that writes files."""

import csv
import io
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tests.system.command_line import run

EXAMPLES = Path(__file__).parents[2] / "examples"
STANDARD = ("--reference-uncertainty", "0.02 of torque", "--resolution", "0.01")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fitted")
    for name in ("calibration", "verification", "readings"):
        shutil.copy(EXAMPLES / f"{name}-output.csv", folder / f"{name}.csv")
    words = ("fit", "calibration.csv", "--model", "polynomial-2", "--out", "model.json")
    done = run(*words, "--report", "fit.pdf", cwd=folder)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def tables(fitted: Path, tmp_path: Path) -> Path:
    shutil.copytree(fitted, tmp_path, dirs_exist_ok=True)
    return tmp_path


def test_a_fit_report_is_what_its_name_says(tables: Path) -> None:
    assert (tables / "fit.pdf").read_bytes().startswith(b"%PDF-")


def test_standard_input_to_standard_output(tables: Path) -> None:
    words = [sys.executable, "-m", "torquebench", "apply", "model.json", "-", "--out", "-"]
    with (tables / "readings.csv").open("rb") as readings:
        applied = subprocess.run(words, stdin=readings, capture_output=True, cwd=tables, check=True)
    rows = [line for line in applied.stdout.decode().splitlines() if not line.startswith("#")]
    assert len(list(csv.DictReader(io.StringIO("\n".join(rows))))) == 24
    words = [sys.executable, "-m", "torquebench", "fit", "-", "--model", "polynomial-1"]
    with (tables / "calibration.csv").open("rb") as points:
        fitted = subprocess.run(
            [*words, "--out", "-"], stdin=points, capture_output=True, cwd=tables, check=True
        )
    assert json.loads(fitted.stdout)["format"] == "torquebench-model"
    assert not (tables / "-").exists()


def test_a_table_for_other_programs_goes_to_standard_output(tables: Path) -> None:
    exported = run("export", "model.json", "--out", "-", cwd=tables)
    assert exported.returncode == 0, exported.stderr
    assert "reading" in exported.stdout
    assert "intervals" not in exported.stdout
    assert "intervals" in exported.stderr


@pytest.mark.parametrize(
    "words",
    [
        ("fit", "calibration.csv", "--out", "model.parquet"),
        ("fit", "calibration.csv", "--out", "m.json", "--report", "report.csv"),
        ("evaluate", "static", "calibration.csv", *STANDARD, "--out", "result.csv"),
        ("turn", "output", "--out", "run.parquet"),
        ("records", "compare", "1", "2", "--out", "steps.parquet"),
        ("records", "export-data", "latest", "--out", "samples.xlsx"),
    ],
)
def test_an_ending_that_promises_another_format_is_refused(
    words: tuple[str, ...], tables: Path
) -> None:
    before = sorted(tables.iterdir())
    refused = run(*words, cwd=tables)
    assert refused.returncode == 2, refused.stdout
    assert words[-1] in refused.stderr
    assert "ends in" in refused.stderr or "ending" in refused.stderr
    assert sorted(tables.iterdir()) == before


@pytest.mark.parametrize(
    "words",
    [
        ("fit", "calibration.csv", "--out", "-", "--report", "-"),
        ("evaluate", "static", "calibration.csv", *STANDARD, "--out", "-", "--report", "-"),
        ("verify", "model.json", "verification.csv", "--report", "-", "--report", "/dev/stdout"),
        ("verify", "model.json", "verification.csv", "--report", "a.html", "--report", "./a.html"),
    ],
)
def test_two_files_in_one_place_are_refused(words: tuple[str, ...], tables: Path) -> None:
    refused = run(*words, cwd=tables)
    assert refused.returncode == 2, refused.stdout
    assert "two different files" in refused.stderr or "two files" in refused.stderr
    assert refused.stdout == ""
    assert not (tables / "a.html").exists()


@pytest.mark.parametrize(
    "words",
    [
        ("records", "export", "latest", "--out", "-"),
        ("certificate", "latest", "--out", "-"),
        ("papers-tables", "--out", "-"),
    ],
)
def test_a_folder_is_no_standard_output(words: tuple[str, ...], tables: Path) -> None:
    refused = run(*words, cwd=tables)
    assert refused.returncode == 2, refused.stdout
    assert "a folder" in refused.stderr
    assert not (tables / "-").exists()


def test_a_table_that_is_kept_is_no_pipe(tables: Path) -> None:
    refused = run("records", "import", "-", *STANDARD, cwd=tables)
    assert refused.returncode == 2
    assert "a file: it is kept" in refused.stderr


def test_a_static_report_without_a_model_speaks_of_no_compensation(tables: Path) -> None:
    words = ("evaluate", "static", "calibration.csv", *STANDARD, "--report")
    assert run(*words, "plain.html", cwd=tables).returncode in (0, 1)
    page = (tables / "plain.html").read_text("utf-8")
    assert "Error of every point against the standard." in page
    run(*words, "both.html", "--model", "model.json", cwd=tables)
    both = (tables / "both.html").read_text("utf-8")
    assert "against the standard, before and after compensation." in both


def test_the_standards_uncertainty_is_stated_in_every_way_of_the_program(tables: Path) -> None:
    (tables / "standard.csv").write_text(
        "torque_nm,expanded_uncertainty_nm\n40,0.4\n2000,0.4\n", encoding="utf-8"
    )
    found = []
    for stated in ("0.02 of range", "standard.csv"):
        words = ("evaluate", "static", "calibration.csv", "--range", "2000", "--resolution", "0.01")
        done = run(*words, "--reference-uncertainty", stated, "--out", "all.json", cwd=tables)
        assert done.returncode in (0, 1), done.stderr
        found.append(json.loads((tables / "all.json").read_text("utf-8"))["results"])
    assert found[0] == found[1]
    points = (tables / "calibration.csv").read_text("utf-8")
    (tables / "own.csv").write_text(f"# reference_uncertainty = 0.02\n{points}", "utf-8")
    own = ("evaluate", "static", "own.csv", *words[3:], "--out", "all.json")
    done = run(*own, cwd=tables)
    assert done.returncode in (0, 1), done.stderr
    assert json.loads((tables / "all.json").read_text("utf-8"))["results"] == found[0]
    done = run(*own, "--reference-uncertainty", "0.05 % of torque", cwd=tables)
    assert "the U that was entered" in " ".join(done.stderr.split())
    done = run(*words, cwd=tables)
    assert done.returncode == 2
    assert "give --reference-uncertainty" in done.stderr
    done = run(*words, "--reference-uncertainty", "11 of torque", cwd=tables)
    assert done.returncode == 2
    assert "0 to 10 % of the torque" in done.stderr


def test_a_percentage_says_what_it_refers_to(tables: Path) -> None:
    """A bare number meant % of the torque in one command and % of range in the others."""
    evaluate = ("evaluate", "static", "calibration.csv", "--resolution", "0.01")
    for option, words in (
        ("--reference-uncertainty", evaluate),
        ("--reference", ("fit", "calibration.csv", "--out", "bare.json")),
        ("--reference", ("budget", "model.json", "--reading", "100")),
    ):
        for bare in ("0.02", "0.02 %"):
            done = run(*words, option, bare, cwd=tables)
            said = " ".join(done.stderr.split())
            assert done.returncode == 2, said
            assert f"{option}: U of a standard '{bare}': % of what isn't stated" in said
            assert "'0.02 of torque' or '0.02 of range'" in said
    assert not (tables / "bare.json").exists()
