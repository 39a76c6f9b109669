"""What a dry run prints of a staircase."""

import io
import re
from pathlib import Path

import pytest
from rich.console import Console

from torquebench.bench.description import default_bench
from torquebench.calibration import available_profiles, load_profile
from torquebench.campaign.measuring import rehearse_calibration
from torquebench.cli.staircase import staircase_tables
from torquebench.station import Station

PROFILES = [name for name in available_profiles() if name != "verification"]


@pytest.mark.parametrize("name", PROFILES)
def test_every_profile_fits_80_columns_and_counts_its_points(name: str, tmp_path: Path) -> None:
    profile = load_profile(name)
    with Station.open(None, tmp_path) as station:
        rehearsal = rehearse_calibration(station, "output", profile)
    console = Console(file=io.StringIO(), width=80)
    for part in staircase_tables(default_bench(), "output", profile, rehearsal):
        console.print(part)
    text = console.file.getvalue()
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 80
    points = sum(step.recorded for step in profile.staircase(2000.0))
    assert f"{points} points" in text
    assert "simulated" in text
    listed = [
        re.search(r" points (?:up|down) +(?:(\d+) × )?(\d+) ", line) for line in text.splitlines()
    ]
    assert sum(int(each[1] or 1) * int(each[2]) for each in listed if each) == points
    assert ("rotation to 120°" in text) == (name == "staircase")


def test_series_that_repeat_each_other_are_one_line_each(tmp_path: Path) -> None:
    profile = load_profile("small-torques").with_options(repeats=40)
    with Station.open(None, tmp_path) as station:
        rehearsal = rehearse_calibration(station, "input", profile)
    console = Console(file=io.StringIO(), width=80)
    for part in staircase_tables(default_bench(), "input", profile, rehearsal):
        console.print(part)
    lines = console.file.getvalue().splitlines()
    assert len(lines) < 25
    assert sum("1–40" in line for line in lines) == 4
