"""A complete run in a small variant, as a user starts it."""

import re
from pathlib import Path

import pytest
from tests.system.command_line import run, widest_line

from torquebench.calibration import load_profile
from torquebench.campaign.demo import DemoSettings, run_demo
from torquebench.station import Station


def test_a_quick_demo(tmp_path: Path) -> None:
    result = run("demo", "--quick", "--seed", 3, "--data", "data", "--out", "x.html", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "\x1b" not in result.stdout + result.stderr
    assert widest_line(result.stdout) <= 80
    said = result.stdout.splitlines()
    sentence = r"{} module: [0-9.]+ → [0-9.]+ % FS, verified on 16 fresh points \(simulated\)"
    assert re.fullmatch(sentence.format("input"), said[0])
    assert re.fullmatch(sentence.format("output"), said[1])
    assert said[2].startswith("reducer: no-load friction ")
    assert said[3:] == ["Report: x.html"]
    report = (tmp_path / "x.html").read_text()
    assert report.count("<svg") >= 7
    shown = re.sub(r"<details>.*?</details>", "", report, flags=re.DOTALL)
    assert shown.count("<table") == shown.count("<svg") == 3  # modules and friction
    sentences = [line.removesuffix(" (simulated)")[1:] for line in said[:3]]
    assert [re.sub("^.", "", each) for each in re.findall("<h2>(.*?)</h2>", shown)] == sentences
    assert shown.index("</h2>") < shown.index("<svg") < shown.index("<table")
    for text in ("averaged over the groups", "Repeatability over the groups", "dense sweep"):
        assert text in report.replace("Averaged", "averaged"), text
    assert "imulated" in report

    listed = run("records", "list", "--data", "data", cwd=tmp_path)
    for text in ("verify-input", "verify-output", "no-load-friction", "model-8", "calibration-2"):
        assert text in listed.stdout
    model = run("records", "show", "model-1", "--data", "data", cwd=tmp_path)
    assert "Verified" in model.stdout
    assert "against the true torque" in model.stdout


@pytest.mark.nightly
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
