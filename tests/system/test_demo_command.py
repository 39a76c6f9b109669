"""A complete run in a small variant, as a user starts it."""

from pathlib import Path

from tests.system.command_line import run, widest_line

from torquebench.calibration import load_profile
from torquebench.campaign.demo import DemoSettings, run_demo
from torquebench.station import Station


def test_a_quick_demo(tmp_path: Path) -> None:
    result = run("demo", "--quick", "--seed", 3, "--data", "data", "--out", "x.html", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "\x1b" not in result.stdout + result.stderr
    assert widest_line(result.stdout) <= 80
    assert result.stdout.count("- simulated") == 3
    for text in (
        "Input module, 50 N·m",
        "Output module, 2000 N·m",
        "raw reading",
        "network, Bayesian",
        "network, gradient descent",
        "polynomial, degree 2",
        "against the standard",
        "against the true torque",
        "dense noise-free sweep",
        "repeatability over the groups",
        "No-load friction",
        "% rdg",
    ):
        assert text in result.stdout, text
    report = (tmp_path / "x.html").read_text()
    assert report.count("<svg") >= 7
    assert "imulated" in report

    listed = run("records", "list", "--data", "data", cwd=tmp_path)
    for text in ("verify-input", "verify-output", "no-load-friction", "model-8", "calibration-2"):
        assert text in listed.stdout
    model = run("records", "show", "model-1", "--data", "data", cwd=tmp_path)
    assert "Verified" in model.stdout
    assert "against the true torque" in model.stdout


def test_the_same_seed_gives_the_same_readings(tmp_path: Path) -> None:
    profile = load_profile("rapid-in-situ").with_options(step_percent=50.0)
    groups = load_profile("verification").with_options(groups=2, points=4)
    settings = DemoSettings(profile, groups, friction=None, models=(), seed=5)
    readings = []
    for folder in ("first", "second"):
        with Station.open(None, tmp_path / folder) as station:
            readings.append(
                [m.verification.reading_nm for m in run_demo(station, settings).modules]
            )
    for first, second in zip(*readings, strict=True):
        assert first.tolist() == second.tolist()


def test_a_report_that_cannot_be_written_is_refused_first(tmp_path: Path) -> None:
    result = run("demo", "--out", "no/folder/x.html", cwd=tmp_path)
    assert result.returncode == 2
    assert not list(tmp_path.iterdir())
