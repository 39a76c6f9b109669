"""At a terminal Ctrl-C pauses at the next point and asks."""

import re
from pathlib import Path

import pytest
from tests.system.command_line import at_terminal, patient_bench, run

OPTIONS = ("calibrate", "input", "--real-time", "--step", 50, "--data", "data")
CTRL_C = "\x03"


def test_pause_and_resume(tmp_path: Path) -> None:
    dialogue = [("2/13", CTRL_C), ("[r]esume or [a]bort?", "r\n")]
    options = (*OPTIONS, "--bench", patient_bench(tmp_path))
    code, shown = at_terminal(*options, cwd=tmp_path, dialogue=dialogue)
    assert code == 0, shown
    assert "Pausing at the next point" in shown
    assert "13/13" in shown
    assert re.search("In use.*model-1", shown)
    listed = run("records", "list", "runs", "--data", "data", cwd=tmp_path)
    assert "completed" in listed.stdout


@pytest.mark.nightly
def test_pause_and_abort(tmp_path: Path) -> None:
    dialogue = [("2/13", CTRL_C), ("[r]esume or [a]bort?", "what?\n"), ("[a]bort?", "a\n")]
    options = (*OPTIONS, "--bench", patient_bench(tmp_path))
    code, shown = at_terminal(*options, cwd=tmp_path, dialogue=dialogue)
    assert code == 130, shown
    assert "without torque" in shown
    assert "In use" not in shown


@pytest.mark.nightly
def test_a_second_interrupt_aborts(tmp_path: Path) -> None:
    dialogue = [("2/13", CTRL_C), ("[r]esume or [a]bort?", CTRL_C)]
    options = (*OPTIONS, "--bench", patient_bench(tmp_path))
    code, shown = at_terminal(*options, cwd=tmp_path, dialogue=dialogue)
    assert code == 130, shown
    assert "Traceback" not in shown
    listed = run("records", "list", "runs", "--data", "data", cwd=tmp_path)
    assert "aborted" in listed.stdout
