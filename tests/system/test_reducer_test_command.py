"""`torquebench test` on the simulated bench: real processes, a report, a comparison, bad input."""

import json
import re
from pathlib import Path

import pytest
from tests.system.command_line import run, widest_line

PARTS = (
    "starting",
    "back-driving",
    "transmission-error",
    "hysteresis",
    "no-load",
    "efficiency",
)


def test_a_full_test_is_rehearsed_without_leaving_anything(tmp_path: Path) -> None:
    found = run("test", "full", "--reducer", "rv-40e", "--dry-run", cwd=tmp_path)
    assert found.returncode == 0, found.stderr
    assert re.search(r"Efficiency +\d+–\d+ .* 412 ", found.stdout)
    assert "1029 N·m" in found.stdout
    assert " - simulated" in found.stdout
    assert "nothing was moved" in found.stdout
    assert widest_line(found.stdout) <= 80
    assert not list(tmp_path.iterdir())


@pytest.mark.nightly
def test_a_full_test_is_measured_judged_kept_and_reported(tmp_path: Path) -> None:
    found = run(
        "test", "full", "--short", "--reducer", "rv-40e", "--serial", "A1", "--data", "data",
        "--report", "report.html", "--report", "report.pdf", cwd=tmp_path,
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    assert "Short reducer test: RV-40E class, specimen A1 - simulated" in found.stdout
    assert "is not compensated" in " ".join(found.stdout.split())
    assert "conditional pass: RV-40E class" in found.stdout
    assert "short test: a first impression" in found.stdout
    assert widest_line(found.stdout) <= 80
    kept = {
        path.parent.name.split("-test-")[1][:-5]: json.loads(path.read_text(encoding="utf-8"))
        for path in (tmp_path / "data" / "runs").glob("*-test-*/results.json")
    }
    assert set(kept) == {f"{name}-short" for name in PARTS}
    assert {each["serial"] for each in kept.values()} == {"A1"}
    assert all(each["simulated"] and each["quantities"] for each in kept.values())
    efficiency = {each["key"] for each in kept["efficiency-short"]["quantities"]}
    assert "efficiency_input_412_nm_+900_rpm" in efficiency

    assert (tmp_path / "report.pdf").read_bytes().startswith(b"%PDF")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("<svg") == len(PARTS) + 1  # the transmission error as a polar plot too
    assert "simulated" in page
    assert not re.search(r"(src|href)=\"(?!#|data:)", page)
    listed = run("records", "list", "--data", "data", cwd=tmp_path)
    assert all(f"test-{name}" in listed.stdout for name in PARTS)


@pytest.mark.nightly
def test_more_repeats_are_rehearsed_and_refused_for_a_first_look(tmp_path: Path) -> None:
    test = ("test", "no-load", "--reducer", "harmonic-20", "--dry-run")
    usual, more = (run(*test, *options, cwd=tmp_path) for options in ((), ("--repeats", 60)))
    assert usual.returncode == more.returncode == 0, more.stderr
    (usual_min, more_min) = (
        int(re.search(r"No-load running torque +\d+–(\d+) ", found.stdout)[1])
        for found in (usual, more)
    )
    assert more_min > 4 * usual_min
    look = run(*test, "--short", "--repeats", 5, cwd=tmp_path)
    assert look.returncode == 2
    assert "5 in a short test" in look.stderr


@pytest.mark.nightly
def test_specimens_and_changes_are_compared(tmp_path: Path) -> None:
    options = ("--short", "--reducer", "rv-40e", "--data", "data")
    for serial in ("A1", "A2", "A1"):
        tested = run("test", "transmission-error", *options, "--serial", serial, cwd=tmp_path)
        assert tested.returncode in (0, 1), tested.stderr  # 1: beyond the data sheet's limit
        assert ("fail" in tested.stdout) == bool(tested.returncode)
    first, second, third = sorted(path.name for path in (tmp_path / "data" / "runs").iterdir())
    compare = ("records", "compare-tests", "--data", "data")
    reports = ("--report", "page.html", "--report", "page.pdf")
    specimens = run(*compare, first, second, *reports, cwd=tmp_path)
    assert specimens.returncode == 0, specimens.stderr
    assert (tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert page.count("<svg") == 2  # values, and orders as differences
    assert "simulated" in page
    assert "A2" in page
    assert "2 specimens: RV-40E class" in specimens.stdout
    assert re.search(r"^A1 .*^A2 ", specimens.stdout, re.DOTALL | re.MULTILINE)
    assert widest_line(specimens.stdout) <= 80
    change = run(*compare, first, third, "--change", "--report", "page.html", cwd=tmp_path)
    assert change.returncode == 0, change.stderr
    assert "Before and after" in (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "common errors of both runs cancel" in " ".join(change.stdout.split())
    assert widest_line(change.stdout) <= 80
    for wrong in ((first,), (first, first), (first, third), (first, second, "--change")):
        assert run(*compare, *wrong, cwd=tmp_path).returncode == 2
    lost = run(*compare, first, second, "--report", "page.docx", cwd=tmp_path)
    assert lost.returncode == 2
    assert ".html or .pdf" in lost.stderr


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("stiffness",), "hysteresis"),
        (("hysteresis", "--reducer", "missing.toml"), "missing.toml"),
        (("hysteresis", "--twist", "0.01", "--no-subtract-twist"), "0.01, not to be subtracted"),
        (("hysteresis", "--report", "nowhere/report.html"), "no folder"),
        (("hysteresis", "--report", "report.docx"), ".html or .pdf"),
    ],
)
def test_bad_input_is_named_and_nothing_moves(
    tmp_path: Path, arguments: tuple[str, ...], named: str
) -> None:
    found = run("test", *arguments, "--data", "data", cwd=tmp_path)
    assert found.returncode == 2
    assert named in found.stderr
    assert "Traceback" not in found.stderr
    assert not (tmp_path / "data").exists()
