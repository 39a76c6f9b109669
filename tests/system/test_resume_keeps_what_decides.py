"""A calibration killed at any stage, with any options, ends as the uninterrupted one does."""

import random
import signal
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from tests.system.command_line import run, run_python

from torquebench.compensation import load_model
from torquebench.records import Registry, RunFolder

KILLED = """
import os, signal, sys
import torquebench.campaign.calibrating as calibrating
from torquebench.cli import app
from torquebench.records.runs.folder import RunWriter

stage, *arguments = sys.argv[1:]

def die(*_arguments, **_options):
    os.kill(os.getpid(), signal.SIGKILL)

write, seal, events = RunWriter.document, RunWriter.seal, 0

def document(writer, name, content):
    global events
    write(writer, name, content)
    events += name == "event"
    if stage == f"{name}" or stage == f"event {events}":
        die()

RunWriter.document = document
if stage == "seal":
    RunWriter.seal = die
if stage == "sealed":
    RunWriter.seal = lambda *arguments, **options: (seal(*arguments, **options), die())
if stage == "fit":
    calibrating.fit_models = die
if stage == "register":
    calibrating.register_calibration = die
app(arguments)
"""
STAGES = ["start", "event 1", "event 4", "event 7", "stop", "seal", "sealed", "fit", "register"]
MODELS = [
    ("--model", "polynomial"),
    ("--model", "polynomial", "--parameter", "degree=3"),
    ("--model", "hybrid"),
    (),
]
CHOICES: list[list[tuple[str, ...]]] = [
    MODELS,
    [(), ("--rising-only",)],
    [(), ("--repeats", "2")],
    [("--step", "25"), ("--step", "20"), ("--up-to", "1000")],
    [(), ("--mounting", "coaxiality_mm=0.012", "--mounting", "lubricant=grease 2")],
]


def drawn(stage: str) -> list[str]:
    """Return options of the command, others for each stage."""
    draw = random.Random(f"{stage} 99")  # the day's: a parameter, a mounting, few points
    return [each for choices in CHOICES for each in draw.choice(choices)]


def outcome(data: Path) -> dict[str, Any]:
    """Return what was decided by the command's options, and what came of it."""
    with Registry.open(data) as registry:
        (calibration,) = registry.calibrations()
        models = registry.models()
        run_id = str(calibration.run_id)
        metadata = RunFolder.open(registry.run(run_id).folder).metadata
        used = [(each.reason, each.operator) for each in registry.activations("SIM-T2000")]
    loaded = [load_model(each.file) for each in models]
    assert calibration.due is not None
    return {
        "profile": (calibration.profile_name, calibration.profile_sha256),
        "standard": (calibration.standard_serial, metadata["bench"]["calibrator"]),
        "points": (calibration.points, tuple(round(each) for each in calibration.valid_nm)),
        "valid": calibration.due - calibration.performed.date() >= timedelta(days=300),
        "models": [(each.model.kind, each.model.kind_parameters) for each in loaded],
        "active": [each.active for each in models],
        "used": used,
        "mounting": metadata.get("mounting_record"),
        "registers": metadata["registers"],
    }


@pytest.mark.parametrize("stage", STAGES)
@pytest.mark.nightly
def test_a_killed_calibration_ends_as_the_uninterrupted_one(stage: str, tmp_path: Path) -> None:
    killed, whole, options = tmp_path / "killed", tmp_path / "whole", drawn(stage)
    command = ["calibrate", "output", *options, "--yes"]
    child = run_python(KILLED, stage, *command, "--data", killed, cwd=tmp_path)
    assert child.returncode == -signal.SIGKILL, child.stderr
    for arguments in (
        [*command, "--data", str(whole)],
        ["resume", "latest", "--yes", "--data", str(killed)],
    ):
        result = run(*arguments, cwd=tmp_path)
        assert result.returncode == 0, result.stdout + result.stderr
    assert outcome(killed) == outcome(whole)
