"""Ctrl-C and other ends: no torque, a readable record, a clean exit."""

import signal
from pathlib import Path

import numpy as np
import pytest
from tests.support.draws import nightly
from tests.system.command_line import at_terminal, patient_bench, run, started, wait_until

from torquebench.records import RunFolder


def points_of(folder: Path) -> int:
    events = list(folder.glob("data/runs/*/events.jsonl"))
    return events[0].read_text().count('"name": "event"') if events else 0


@pytest.mark.parametrize(
    ("sent", "code", "reason"),
    [(signal.SIGINT, 130, "keyboard"), nightly(signal.SIGTERM, 1, "SIGTERM")],
)
def test_an_interrupted_calibration(
    sent: signal.Signals, code: int, reason: str, tmp_path: Path
) -> None:
    bench = patient_bench(tmp_path)
    options = ("--real-time", "--step", 10, "--data", "data", "--bench", bench)
    with started("calibrate", "output", *options, cwd=tmp_path) as process:
        wait_until(lambda: points_of(tmp_path) >= 2, "the first point")
        process.send_signal(sent)
        output, messages = process.communicate(timeout=240)
    assert process.returncode == code, messages
    assert "Traceback" not in output + messages
    assert "without torque" in messages

    (path,) = (tmp_path / "data" / "runs").iterdir()
    folder = RunFolder.open(path)
    folder.verify()
    assert folder.manifest["status"] == "aborted"
    assert reason in folder.manifest["reason"]
    frequency = folder.raw().columns["output_torque_hz"]
    highest, last = np.nanmax(np.abs(frequency - 60e3)), np.abs(frequency[-1] - 60e3)
    assert highest > 20e3  # the preload reached 2000 N·m, 30 kHz
    assert last < 0.01 * 30e3

    listed = run("records", "list", "--data", "data", cwd=tmp_path)
    assert "aborted" in listed.stdout
    assert "none yet" in listed.stdout  # neither a calibration nor a model


def test_measuring_ends_cleanly(tmp_path: Path) -> None:
    with started("measure", "--interval", 0.2, "--data", "data", cwd=tmp_path) as process:
        assert process.stdout is not None
        first = process.stdout.readline()
        process.send_signal(signal.SIGINT)
        _, messages = process.communicate(timeout=240)
    assert "rpm" in first
    assert process.returncode == 0, messages
    assert "measuring ended" in messages
    assert "Traceback" not in messages


@pytest.mark.nightly
def test_ctrl_c_at_a_terminal_ends_a_demo(tmp_path: Path) -> None:
    bench = patient_bench(tmp_path)
    options = ("--quick", "--real-time", "--data", "data", "--out", "x.html", "--bench", bench)
    code, shown = at_terminal("demo", *options, cwd=tmp_path, dialogue=[("3/45", "\x03")])
    assert code == 130, shown
    assert "without torque" in shown
    assert "Traceback" not in shown
    assert not (tmp_path / "x.html").exists()


@pytest.mark.parametrize(
    ("sent", "code", "status"), [(signal.SIGINT, 0, "completed"), (signal.SIGTERM, 1, "aborted")]
)
def test_a_recording_without_an_end(
    sent: signal.Signals, code: int, status: str, tmp_path: Path
) -> None:
    with started("record", "--name", "idle", "--real-time", "--data", "data", cwd=tmp_path) as run:
        wait_until(lambda: any(tmp_path.glob("data/runs/*/raw.arrow")), "the first samples")
        run.send_signal(sent)
        output, messages = run.communicate(timeout=240)
    assert run.returncode == code, messages
    assert "Traceback" not in output + messages
    (path,) = (tmp_path / "data" / "runs").iterdir()
    folder = RunFolder.open(path)
    folder.verify()
    assert folder.manifest["status"] == status
    assert folder.raw().rows > 0
