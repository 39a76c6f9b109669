"""Previews: what a calibration would do, within 80 columns, with every step counted."""

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from torquebench.calibration import available_profiles, load_profile
from torquebench.cli.terminal import page as terminal
from torquebench.operations import PackagedLibrary, Place, Preview, find_operation
from torquebench.station import Station

PROFILES = [name for name in available_profiles() if name != "verification"]


def preview(folder: Path, **request: object) -> Preview:
    calibrate = find_operation("calibrate")
    assert calibrate.preview is not None
    with Station.open(None, folder) as station:
        place = Place("", PackagedLibrary(), station.registry, station)
        return calibrate.preview(place, calibrate.request(**request))


def printed(shown: Preview, monkeypatch: pytest.MonkeyPatch) -> str:
    console = Console(file=io.StringIO(), width=80)
    monkeypatch.setattr(terminal, "out", lambda: console)
    terminal.print_page(shown.page())
    return console.file.getvalue()


@pytest.mark.parametrize("name", PROFILES)
def test_every_profile_fits_80_columns_and_counts_its_points(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = preview(tmp_path, side="output", profile=name)
    text = printed(shown, monkeypatch)
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 80
    profile = load_profile(name)
    points = sum(step.recorded for step in profile.staircase(2000.0))
    assert shown.points == points or profile.adaptive
    assert re.search(rf"Points +{shown.points}", text)
    listed = [each for each in shown.series if "points" in each.what]
    assert sum(each.times * each.steps for each in listed) == points
    assert ("rotation to 120°" in text) == (name == "staircase")


def test_series_that_repeat_each_other_are_one_line_each(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = preview(tmp_path, side="input", profile="small-torques", repeats=40)
    lines = printed(shown, monkeypatch).splitlines()
    assert len(lines) < 25
    assert sum("1–40" in line for line in lines) == 4
