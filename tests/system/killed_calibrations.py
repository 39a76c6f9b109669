"""Kills calibrations in child processes after so many acknowledged points.

Imports once, then forks a child for every moment. What the child had acknowledged is counted
from outside, in its events, right before SIGKILL.
"""

import json
import os
import random
import resource
import signal
import sys
import time
from pathlib import Path

from torquebench.bench.description import BenchDescription, default_bench
from torquebench.calibration import load_profile
from torquebench.campaign.calibrating import measure_calibration
from torquebench.errors import TorquebenchError
from torquebench.station import Station

KILLED = "from tests.system.killed_calibrations import main; main()"
"""Code for `run_python` with the arguments of `main`."""
STEP_PERCENT = 20.0
"""Ten points a series, falling ones included."""
ADAPTIVE = load_profile("adaptive").with_options(points=48)
"""Two series of 12 points, and 24 that are placed."""


def calibrate(data: Path, room: int, *, adaptively: bool = False) -> None:
    """Calibrate the output; with room, a disk that is full after so many bytes."""
    rapid = load_profile("rapid-in-situ").with_options(step_percent=STEP_PERCENT)
    profile = ADAPTIVE if adaptively else rapid
    recording = {"recording": {"edges": bool(room)}}  # large files, for a disk that gets full
    description = BenchDescription.model_validate(default_bench().model_dump() | recording)
    with Station.open(description, data) as station:
        if room:
            largest = max(file.stat().st_size for file in data.iterdir())  # the registry
            resource.setrlimit(resource.RLIMIT_FSIZE, (largest + room, resource.RLIM_INFINITY))
        try:
            measure_calibration(station, "output", profile)
        except (TorquebenchError, OSError) as error:
            print(type(error).__name__, error, file=sys.stderr)


def acknowledged(data: Path) -> int:
    """Count the whole events of the only run."""
    found = list(data.glob("runs/*/events.jsonl"))
    if not found:
        return 0
    whole = found[0].read_bytes().rpartition(b"\n")[0]
    return sum(b'"name": "event", "doc"' in line for line in whole.split(b"\n"))


def main() -> None:
    """Arguments: folder, and for each calibration the events to wait for, or bytes of a disk."""
    folder, draw = Path(sys.argv[1]), random.Random(1)
    for name in sys.argv[2:]:
        kind, _, number = name.partition("-")
        data = folder / name
        child = os.fork()
        if child == 0:
            room = int(number) if kind == "room" else 0
            calibrate(data, room, adaptively=kind == "adaptive")
            os._exit(0)
        seen = 0
        if kind != "room":
            deadline = time.monotonic() + 600.0
            while acknowledged(data) < int(number) and time.monotonic() < deadline:
                time.sleep(0.001)
            time.sleep(draw.uniform(0.0, 0.02))
            seen = acknowledged(data)
            os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        print(json.dumps([name, seen]), flush=True)
