"""Break the bench on purpose and look what is left: ``python -m benchmarks.faults [--quick]``.

Seeded faults come at random moments of all procedures, in parts (``--parts``):

simulated    instruments, drives, disk and process, on the simulated bench in simulated time
sockets      every kind of wrong answer and disobedience of every instrument over real sockets
real         the same in real time
phases       a kill, a full disk, a lost database while a calibration is measured, sealed, fitted,
             registered and certified
postgresql   a registry in PostgreSQL restarts for 2 s at every phase, where it is installed
undisturbed  nothing is broken, in real time over sockets, for ``--minutes`` (none by default)

After each one both drives have to be off or an alarm has to stay that says so, the alarm or error
has to have a name, the record has to be sealed and readable with every acknowledged point in it,
and no point and no result may be wrong: readings and standard are compared with the true torque,
results with an undisturbed run. Then the bench has to work again. Exits with 1 on any failure.

With ``--into FILE`` outcomes are kept, and a campaign that was interrupted goes on; a fault is
repeated alone by its part and number (``--only real:12``). ``--docs`` writes the report into
docs/benchmarks.md.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from tests import postgresql_server

from benchmarks.fault_bench import KINDS, TRIES, FaultyBench, Kind, on_thread
from benchmarks.fault_judging import (
    Outcome,
    checked,
    differing,
    ended_badly,
    line_of,
    record_of,
    slipped,
    status_of,
    unsafe_end,
)
from benchmarks.fault_procedures import PROCEDURES, Procedure
from benchmarks.fault_report import Kept, Start, section, summary
from benchmarks.network_faults import numbered_real, numbered_wire, wire_faults
from benchmarks.phase_faults import PHASE_FAULTS, numbered_phase
from benchmarks.record_faults import RECORD_FAULTS, numbered_record
from benchmarks.reporting import BENCHMARKS, write_section
from benchmarks.restarts import RESTARTS, numbered_restart
from benchmarks.undisturbed import TITLE, undisturbed
from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.drivers import open_drivers
from torquebench.bench.drivers.base import SIDES
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
QUICK_WIRE, QUICK_REAL, QUICK_PHASES, QUICK_RECORDS, QUICK_RESTARTS = 3, 1, 2, 2, 1
AT_ONCE = 3
"""Of the quick campaign: one that waits for a time-out over sockets beside two that compute."""
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
                station.supervisor.expect("campaign", 0.1)

        moment_s = float(draw.uniform(0.05, 0.95)) * procedure.lasts_s(station)
        due_s = station.clock.now() + moment_s
        faulty.plan(due_s, breaking, procedure.side, powered=kind.needs_power)
        error: BaseException | None = None
        result: object = None
        try:
            result = procedure.go(station)
        except Exception as raised:
            error = raised
    station.supervisor.release("campaign")
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
    return replace(outcome, index=index, seed=seed)


def gone_through(begun: Sequence[Callable[[], Outcome]], *, tell: bool) -> list[Outcome]:
    """Return what became of faults, in order."""
    outcomes = []
    for outcome in begun:
        outcomes.append(outcome())
        if tell:
            print(line_of(outcomes[-1]), flush=True)
    return outcomes


@contextlib.contextmanager
def starting(at_once: int) -> Iterator[Start]:
    """Have so many faults gone through at once, in processes of their own where it is several."""
    if at_once == 1:
        yield partial
        return
    with ProcessPoolExecutor(at_once, mp_context=get_context("fork")) as others:
        yield lambda *fault: others.submit(*fault).result


def computing_s() -> float:
    """Return what this process and those that it has ended have computed, s."""
    return sum(os.times()[:4])


def main() -> int:
    """Go through the campaign; 1 where a fault wasn't survived."""
    parts = _parts()
    arguments = parsed(parts)
    logging.getLogger("torquebench").addHandler(logging.NullHandler())  # it breaks on purpose
    seed = arguments.seed
    if arguments.only is not None:
        name, _, index = arguments.only.partition(":")
        print(outcome := parts[name].fault(int(index), seed))
        return int(bool(outcome.problems))
    chosen = {name: part for name, part in parts.items() if name in arguments.parts}
    tell = arguments.verbose or arguments.quick
    kept, began = Kept(arguments.into), time.monotonic()
    outcomes: dict[str, Sequence[Outcome]] = {}
    with starting(arguments.at_once or (AT_ONCE if arguments.quick else 1)) as start:
        begun = {
            # What waits for time-outs comes first, so that the others compute meanwhile.
            name: kept.begin(
                name, part.fault, part.number(arguments), seed, partial if part.alone else start
            )
            for name, part in reversed(chosen.items())
        }
        for name, part in chosen.items():
            outcomes[part.title] = gone_through(begun[name], tell=tell)
            print("\n".join(summary(outcomes[part.title], part.title)), flush=True)
    if arguments.minutes:
        outcomes[TITLE] = undisturbed(arguments.minutes, seed, kept, tell=tell)
        print("\n".join(summary(outcomes[TITLE], TITLE)), flush=True)
    print(f"\n{time.monotonic() - began:.0f} s, of which {computing_s():.0f} s computing")
    if arguments.docs:
        write_section(BENCHMARKS, "faults", section(outcomes, arguments.docs))
    return int(any(outcome.problems for part in outcomes.values() for outcome in part))


@dataclass(frozen=True)
class Part:
    """A part of the campaign: its title, how one fault goes, how many there are."""

    title: str
    fault: Callable[[int, int], Outcome]
    full: int
    quick: int
    alone: bool = False
    """Whether one goes at a time, since it measures by the wall's clock."""

    def number(self, arguments: argparse.Namespace) -> int:
        """Return how many are gone through."""
        most = self.quick if arguments.quick else self.full
        return most if arguments.faults is None else min(most, int(arguments.faults))


def _parts() -> dict[str, Part]:
    wires = len(wire_faults())
    parts = {
        "simulated": Part("simulated bench", numbered, FULL, len(KINDS)),
        "phases": Part("phases of a calibration", numbered_phase, PHASE_FAULTS, QUICK_PHASES),
        "records": Part("records", numbered_record, RECORD_FAULTS, QUICK_RECORDS),
        "sockets": Part("simulated instruments over sockets", numbered_wire, wires, QUICK_WIRE),
        "real": Part("the same in real time", numbered_real, wires, QUICK_REAL, alone=True),
    }
    if postgresql_server.binaries() is not None:
        title = "PostgreSQL restarts"
        parts["postgresql"] = Part(title, numbered_restart, RESTARTS, QUICK_RESTARTS)
    return parts


def parsed(parts: Collection[str]) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="one fault of each kind, a few others")
    parser.add_argument("--parts", type=lambda text: text.split(","), default=list(parts),
                        help="some of " + ",".join(parts))  # fmt: skip
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--faults", type=int, help="of each part at most so many")
    parser.add_argument("--minutes", type=float, default=0.0,
                        help="of undisturbed work in real time over sockets")  # fmt: skip
    parser.add_argument(
        "--at-once", type=int, help=f"faults at a time: {AT_ONCE} of --quick, else 1 by default"
    )
    parser.add_argument("--into", type=Path, help="keep outcomes here, and go on from there")
    parser.add_argument("--only", help="one fault, such as simulated:12")
    parser.add_argument("--docs", default="", help="write the report, with this remark on it")
    parser.add_argument("--verbose", action="store_true", help="say each fault, as --quick does")
    arguments = parser.parse_args()
    asked = [arguments.only.partition(":")[0]] if arguments.only else arguments.parts
    for name in filter(None, asked):
        if name not in parts:
            parser.error(f"part {name!r}; one of {', '.join(parts)}")
    return arguments


if __name__ == "__main__":
    sys.exit(main())
