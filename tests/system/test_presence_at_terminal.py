"""A bench that asks for the operator's presence: keys at the terminal, nothing without one."""

import re
from pathlib import Path

import pytest
from tests.system.command_line import at_terminal, patient_bench, run

PERIOD_S = 9
OPTIONS = ("calibrate", "input", "--step", 50, "--data", "data", "--bench", "bench.toml")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    patient_bench(tmp_path, f"presence_s = {PERIOD_S}")
    return tmp_path


@pytest.mark.nightly
def test_keys_keep_the_run_going_and_are_not_echoed(folder: Path) -> None:
    dialogue = [("Press a key to begin.", "x")] + [("Are you there?", "y")] * 99
    code, shown = at_terminal(*OPTIONS, "--real-time", cwd=folder, dialogue=dialogue)
    assert code == 0, shown
    assert re.search("In use.*model-1", shown)
    assert not {"x", "y"} & set(shown.replace("\r", "").split("\n"))


def test_whoever_goes_away_finds_the_bench_without_power(folder: Path) -> None:
    dialogue = [("Press a key to begin.", "x")]
    code, shown = at_terminal(*OPTIONS, "--real-time", cwd=folder, dialogue=dialogue)
    assert code == 1, shown
    assert f"no confirmation of presence at the bench for {PERIOD_S} s" in " ".join(shown.split())
    log = run("records", "audit", "latest", "--alarms", "--data", "data", cwd=folder)
    assert "operator missing" in log.stdout


def test_without_a_terminal_nobody_is_there(folder: Path) -> None:
    refused = run(*OPTIONS, cwd=folder)
    assert refused.returncode == 2
    words = " ".join(refused.stderr.split())
    assert f"presence every {PERIOD_S} s and there is no terminal" in words
    assert "set safety.presence_s = 0" in words
