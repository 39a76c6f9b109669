"""Attacks on records and interfaces while a bench calibrates, in simulated and in real time.

Hostile files are uploaded, acts of others are typed, folders of runs are copied. Each is refused
with a message or named, nothing of it is entered, the calibration goes on undisturbed, and a stop
after it acts at once.
"""

from __future__ import annotations

import shutil
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

from tests.hostile_files import FILES
from tests.support.faults.judging import Outcome
from tests.support.uploads import evaluated

from torquebench.calibration import load_profile
from torquebench.campaign.calibrating import CALIBRATION, measure_calibration
from torquebench.campaign.finishing import finish_recorded_run
from torquebench.campaign.fitting import ModelChoice
from torquebench.campaign.registering import registers_calibration
from torquebench.errors import TorquebenchError
from torquebench.panel.service.files import LARGEST_FILE
from torquebench.progress import NoProgress
from torquebench.records import RunFolder, unfinished_runs
from torquebench.reports.certificate import Issue, build_record
from torquebench.station import Station, enter_run
from torquebench.testing.accounts import people_of

__all__ = ["ACTS", "attacked"]

PROFILE = load_profile("rapid-in-situ").with_options(step_percent=25.0)
POINTS = 16
KIND = "polynomial-2"
PERSON = "Sommer"
REFUSED_S = 60.0
"""Longest time until a hostile file is refused, s of wall time: its reader has 30 s."""
Act = Callable[[Station], str]
"""Does it and returns what was said; empty where it was taken."""


def _refusal(action: Callable[[], object]) -> str:
    try:
        action()
    except TorquebenchError as error:
        return str(error)
    return ""


@cache
def _hostile(name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        FILES[name](path)
        with path.open("rb") as file:
            return file.read(LARGEST_FILE + 1)


def _upload(name: str) -> Act:
    return lambda _station: _refusal(lambda: evaluated(_hostile(name), name))


def _typed_review(station: Station) -> str:
    registry = station.registry
    number = registry.calibrations()[-1].calibration_id
    return _refusal(lambda: registry.review("calibrations", number, checked_by=PERSON))


def _typed_use(station: Station) -> str:
    registry = station.registry
    model = registry.models()[-1].model_id
    return _refusal(lambda: registry.activate(model, operator=PERSON, reason="because"))


def _typed_authorisation(station: Station) -> str:
    registry = station.registry
    entry, issue = registry.calibrations()[-1], Issue([PERSON], require_signatures=True)
    return _refusal(lambda: build_record(registry, entry, issue))


def _copy(name: str, *, sealed: bool) -> Act:
    """Copy a run's folder, and have it finished and entered as another one."""

    def act(station: Station) -> str:
        registry = station.registry
        first = RunFolder.open(registry.runs()[-1].folder).path
        copy = Path(shutil.copytree(first, first.with_name(name.format(first.name))))
        if not sealed:
            (copy / "manifest.json").unlink()
        copies = [each for each in unfinished_runs(registry) if copy.name in str(each.found)]
        if len(copies) != 1 or "copy of run" not in str(copies[0].found):
            return ""
        said = [
            _refusal(lambda: finish_recorded_run(registry, copies[0])),
            _refusal(lambda: enter_run(registry, RunFolder(copy))),
        ]
        return "; ".join(said) if all(said) else ""

    return act


ACTS: dict[str, Act] = {
    **{f"upload {name}": _upload(name) for name in FILES},
    "review typed in another's name": _typed_review,
    "use typed in another's name": _typed_use,
    "authorisation typed in another's name": _typed_authorisation,
    "run copied": _copy("{}-copy", sealed=True),
    "run copied before it was sealed": _copy("copy-of-{}", sealed=False),
}


@dataclass
class _Meanwhile(NoProgress):
    """Does something at a point of a calibration."""

    act: Callable[[], None]
    point: int
    done: bool = field(default=False)

    def reach(self, done: int, detail: str = "") -> None:
        super().reach(done, detail)
        if done >= self.point and not self.done:
            self.done = True
            self.act()


def attacked(name: str, seed: int, *, real: bool) -> Outcome:
    """Attack once, in simulated or in real time, and look what is left."""
    problems: list[str] = []
    said, took_s = "", 0.0
    if name.startswith("upload "):
        _hostile(name.removeprefix("upload "))  # written before the time counts
    with tempfile.TemporaryDirectory() as scratch:
        with people_of(Path(scratch), PERSON):
            pass
        with Station.open(None, Path(scratch), real_time=real) as station:
            registry = station.registry
            known = registers_calibration([ModelChoice(KIND)], KIND)

            def calibrate(progress: NoProgress) -> int:
                measured = measure_calibration(
                    station, "output", PROFILE, metadata=known, progress=progress
                )
                CALIBRATION.evaluate_and_register(registry, measured)
                return len(measured.result.data)

            def attack() -> None:
                nonlocal said, took_s
                began = time.monotonic()
                said = ACTS[name](station)
                took_s = time.monotonic() - began

            calibrate(NoProgress())
            attacker = threading.Thread(target=attack)
            points = calibrate(_Meanwhile(attacker.start, 3 + seed % 5))
            attacker.join()
            if not said:
                problems.append(f"wrong: {name} was taken")
            if took_s > REFUSED_S:
                problems.append(f"other: it took {took_s:.0f} s")
            if points != POINTS:
                problems.append(f"stranded: {points} of {POINTS} points")
            problems += [f"false alarm: {each.found}" for each in station.supervisor.history]
            numbers = [each.calibration_id for each in registry.calibrations()]
            uses = registry.activations("SIM-T2000")
            if registry.number_of_runs() != 2 or len(numbers) != 2:
                problems.append("wrong: something of it was entered")
            if any(each.operator == PERSON for each in uses):
                problems.append("wrong: a record was changed")
            if any(registry.reviews("calibrations", number) for number in numbers):
                problems.append("wrong: a review was entered")
    return Outcome(
        f"records: {name}",
        "calibrate output in real time" if real else "calibrate output",
        "refused",
        said.partition(";")[0][:60],
        float("nan"),
        points,
        tuple(problems),
    )
