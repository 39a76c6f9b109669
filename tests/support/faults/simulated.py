"""Faults of instruments, drives, disk and process on the simulated bench, in simulated time.

After each one both drives have to be off or an alarm has to stay that says so, the alarm or error
has to have a name, the record has to be sealed and readable with every acknowledged point in it,
and no point and no result may be wrong: readings and standard are compared with the true torque,
results with an undisturbed run. Then the bench has to work again.
"""

from __future__ import annotations

import contextlib
import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tests.support.faults.bench import KINDS, TRIES, FaultyBench, Kind, on_thread
from tests.support.faults.judging import (
    Outcome,
    checked,
    differing,
    ended_badly,
    record_of,
    slipped,
    status_of,
    unsafe_end,
)
from tests.support.faults.procedures import PROCEDURES, Procedure

from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.drivers import open_drivers
from torquebench.bench.roles import SIDES
from torquebench.bench.safety import Alarm
from torquebench.campaign.reducers.results import ReducerTestRecord
from torquebench.errors import RecordError, TorquebenchError
from torquebench.procedures import zero_modules
from torquebench.procedures.reducers.turning import TransmissionRecording
from torquebench.records import Registry, RunFolder, RunWriter
from torquebench.station import Station, recover_unfinished

SAFE_S = 1.0
"""Longest time until both drives are off, s of bench time, of a fault that stops the bench."""
FULL = 300
KEPT_POWER_S = 2.0
"""How long to wait for a drive that doesn't go off whatever it is told, s of wall time."""
MET_LATER = (
    "drive refuses commands",
    "drive keeps what it does",
    "drive does the opposite",
    "disk full for documents",
    "outlier reading",
)
"""Met with the next command or point, or where it exceeds a limit: counted from the alarm."""
ENDS_ACQUISITION = ("counter lost", "probes fail")
NOT_ITS_KIND = ("encoder slips",)
"""May go unnoticed in a test of angles, where these are compared with the truth."""
KILLED_WITHIN_S = 60.0
LASTING_S = 3.5
"""Until what was injected is over, s of bench time."""
COASTING_S = 60.0
"""How long a reducer may coast without power, s of bench time."""
STANDING_RAD_S = 0.02


def described(seed: int) -> BenchDescription:
    """Describe a simulated bench of a seed."""
    text = default_bench().model_dump()
    text["driver"]["seed"] = seed
    return BenchDescription.model_validate(text)


@contextlib.contextmanager
def opened(seed: int, data: Path) -> Iterator[tuple[Station, FaultyBench]]:
    """Open a station on instruments that fail on command."""
    description = described(seed)
    faulty = FaultyBench(open_drivers(description))
    with Station.open(description, data, drivers=faulty.faulty) as station:
        yield station, faulty


class _Disk:
    """A disk that gets full for one kind of writing."""

    def __init__(self, method: str) -> None:
        self._method = method
        self._original = getattr(RunWriter, method)
        self.full = False

    def __enter__(self) -> _Disk:
        disk, original = self, self._original

        def write(writer: RunWriter, *arguments: Any) -> Any:
            if disk.full:
                raise RecordError("No space left on device", "", "make room")
            return original(writer, *arguments)

        setattr(RunWriter, self._method, write)
        return self

    def __exit__(self, *_: object) -> None:
        setattr(RunWriter, self._method, self._original)


def one_fault(
    station: Station,
    faulty: FaultyBench,
    kind: Kind,
    procedure: Procedure,
    draw: np.random.Generator,
) -> Outcome:
    """Run a procedure, break something meanwhile, and look what is left."""
    method = "samples" if kind.name == "disk full for samples" else "document"
    with _Disk(method) as disk:

        def breaking() -> None:
            kind.breaking(faulty, procedure.side, draw)
            if kind.name == "stop from another thread":
                on_thread(lambda: station.emergency_stop("fault campaign"))
            elif kind.name.startswith("disk full"):
                disk.full = True
            elif kind.name == "heartbeat missing":
                station.supervisor.heartbeats.expect("campaign", 0.1)

        moment_s = float(draw.uniform(0.05, 0.95)) * procedure.lasts_s(station)
        due_s = station.clock.now() + moment_s
        faulty.plan(due_s, breaking, procedure.side, powered=kind.needs_power)
        error: BaseException | None = None
        result: object = None
        try:
            result = procedure.go(station)
        except Exception as raised:
            error = raised
    station.supervisor.heartbeats.release("campaign")
    station.supervisor.wait_safe(KEPT_POWER_S if faulty.keeps_power else 20.0)
    outcome = judged(station, faulty, kind, procedure, error, result)
    problems = [*outcome.problems, *works_again(station, faulty, kind)]
    if isinstance(result, ReducerTestRecord) and not problems:
        again = procedure.go(station)
        assert isinstance(again, ReducerTestRecord)
        problems += differing(result, again)
    return replace(outcome, problems=tuple(problems))


def works_again(station: Station, faulty: FaultyBench, kind: Kind) -> Iterator[str]:
    """Mend everything, acknowledge, and say why the bench doesn't measure a zero then."""
    faulty.heal()
    if kind.name in ENDS_ACQUISITION:
        return  # the bench has to be opened again
    mended_s = station.clock.now()
    while (lasts_s := station.clock.now() - mended_s) < LASTING_S or (
        lasts_s < COASTING_S and turns(station)
    ):  # a cause that is still there raises its alarm again
        with contextlib.suppress(TorquebenchError):
            station.clock.wait(max(LASTING_S - lasts_s, 0.5))
        station.supervisor.wait_safe(20.0)
        station.acknowledge_alarm("fault campaign")
    try:
        station.run(zero_modules(station.devices), kind="zero")
    except Exception as error:
        yield f"other: the bench doesn't go on: {type(error).__name__}: {error}"


def turns(station: Station) -> bool:
    """Whether something still coasts."""
    return any(abs(station.acquisition.speed_rad_s(side)) > STANDING_RAD_S for side in SIDES)


def judged(
    station: Station,
    faulty: FaultyBench,
    kind: Kind,
    procedure: Procedure,
    error: BaseException | None,
    result: object,
) -> Outcome:
    """Hold what is left against what must be."""
    alarms = station.supervisor.history
    disk = kind.name.startswith("disk full")
    problems = list(ended_badly(error, alarms, disk=disk))
    problems += unsafe_end(station, faulty.at_rest())
    if faulty.broken_s is None:
        return Outcome(kind.name, procedure.name, "too late", "", float("nan"), 0)
    if kind.needs_power and error is None and kind.name not in MET_LATER and not kind.spoils:
        lasted_s = (faulty.safe_s or station.clock.now()) - faulty.broken_s
        if lasted_s < SAFE_S:  # the procedure was over before it could matter
            return Outcome(kind.name, procedure.name, "too late", "", float("nan"), 0)
        compared = isinstance(result, TransmissionRecording | ReducerTestRecord)
        if not (kind.name in NOT_ITS_KIND and compared):
            problems.append("unsafe: nobody noticed it")
    if isinstance(result, TransmissionRecording):
        problems += slipped(result)
    safe_s = time_to_rest(faulty, kind, alarms)
    if safe_s > SAFE_S and not faulty.keeps_power:
        problems.append(f"unsafe: safe only after {safe_s:.2f} s")
    points, wrong = record_of(station, error, spoilt=kind.spoils)
    status, named = status_of(error, alarms)
    return Outcome(kind.name, procedure.name, status, named, safe_s, points, (*problems, *wrong))


def time_to_rest(faulty: FaultyBench, kind: Kind, alarms: Sequence[Alarm]) -> float:
    """Return the time from a fault to both drives off, s of bench time; NaN where none was on."""
    if not (alarms and faulty.powered) or faulty.broken_s is None:
        return float("nan")
    faulty.tick()
    if kind.name in MET_LATER:  # the drives may have been off and on again before
        return (faulty.resting_s or float("inf")) - alarms[0].time_s
    return (faulty.safe_s or float("inf")) - faulty.broken_s


def acknowledged(data: Path) -> int:
    """Count the whole events of all runs, from outside."""
    count = 0
    for file in data.glob("runs/*/events.jsonl"):
        count += file.read_bytes().count(b'"name": "event", "doc"')
    return count


def killed(seed: int, procedure: Procedure, data: Path, draw: np.random.Generator) -> Outcome:
    """Kill a process in the middle of a procedure; look what the next start makes of it."""
    child = os.fork()
    if child == 0:  # pragma: no cover - it is killed
        with contextlib.suppress(BaseException), opened(seed, data) as (station, _):
            procedure.go(station)
        os._exit(0)
    deadline, events = time.monotonic() + KILLED_WITHIN_S, 0
    wanted = int(draw.integers(1, 8))
    while events < wanted and time.monotonic() < deadline:
        if os.waitpid(child, os.WNOHANG)[0]:
            child = 0
            break
        events = acknowledged(data)
        time.sleep(0.002)
    if child:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    problems: list[str] = []
    kept = points = 0
    with Registry.open(data) as registry:
        problems += [
            f"stranded: {each.problem}" for each in recover_unfinished(registry) if each.problem
        ]
        for run in registry.runs():
            if run.status not in ("interrupted", "completed"):
                problems.append(f"stranded: the run is {run.status}")
            folder = RunFolder.open(run.folder)
            found, wrong = checked(folder, described(seed), stopped=True)
            points, problems = points + found, [*problems, *wrong]
            kept += sum(1 for _ in folder.documents("event"))
    if kept < events:
        problems.append("stranded: an acknowledged point is lost")
    named = "found at the next start"
    return Outcome(
        "killed", procedure.name, "recovered", named, float("nan"), points, tuple(problems)
    )


def drawn(number: int, seed: int) -> list[tuple[Kind, Procedure]]:
    """Draw kinds in turn, each with one of the procedures that had the fewest so far."""
    draw = np.random.default_rng(seed)
    counts: Counter[str] = Counter()
    plan = []
    for index in range(number):
        kind = KINDS[index % len(KINDS)]
        fitting = [each for each in PROCEDURES if kind.fits(each)]
        fewest = min(counts[each.name] for each in fitting)
        rarest = [each for each in fitting if counts[each.name] == fewest]
        procedure = rarest[int(draw.integers(len(rarest)))]
        counts[procedure.name] += 1
        plan.append((kind, procedure))
    return plan


def numbered(index: int, seed: int) -> Outcome:
    """Go through one fault on a bench of its own; again where it came after the end."""
    kind, procedure = drawn(index + 1, seed)[-1]
    draw = np.random.default_rng([seed, index])
    with tempfile.TemporaryDirectory() as scratch:
        for attempt in range(TRIES):
            folder = Path(scratch, str(attempt))
            if kind.name == "killed":
                outcome = killed(seed + index, procedure, folder, draw)
            else:
                with opened(seed + index, folder) as (station, faulty):
                    outcome = one_fault(station, faulty, kind, procedure, draw)
            if outcome.status != "too late":
                break
    return outcome
