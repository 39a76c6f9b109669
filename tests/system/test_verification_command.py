"""A verification on the bench from the command line: groups, models beside each other, report."""

from pathlib import Path

from tests.system.command_line import run, widest_line


def test_two_models_on_the_same_points(tmp_path: Path) -> None:
    quick = ("--step", 20, "--data", "data")
    for model in ("polynomial-2", "hybrid"):
        calibrated = run("calibrate", "output", "--model", model, *quick, cwd=tmp_path)
        assert calibrated.returncode == 0, calibrated.stderr
    command = ("verification", "output", "--groups", 2, "--points", 8, "--same-points")
    result = run(
        *(*command, "--model", "model-2", "--model", "model-1", "--seed", 3, "--tolerance", 0.5),
        *("--report", "v.html", "--data", "data"),
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert widest_line(result.stdout) <= 80
    for text in (
        "16 readings in 2 groups",
        "- simulated",
        "model-1: ",
        "model-2: ",
        "repeatability",
    ):
        assert text in result.stdout, text
    page = (tmp_path / "v.html").read_text()
    assert "the same in every group" in page
    assert page.count("<svg") == 2
    shown = run("records", "show", "model-1", "--data", "data", cwd=tmp_path)
    assert "Verified" in shown.stdout

    unknown = run(*command, "--model", "model-7", "--data", "data", cwd=tmp_path)
    assert unknown.returncode == 2
    assert "model 7" in unknown.stderr


def test_without_records_nothing_is_verified(tmp_path: Path) -> None:
    result = run("verification", "output", "--data", "none", cwd=tmp_path)
    assert result.returncode == 2
    assert "no model in use" in result.stderr
    assert not [*(tmp_path / "none").glob("runs/*")]
