"""Break the bench on purpose and look what is left: ``python -m benchmarks.faults [--quick]``.

Seeded faults of many kinds come at random moments of all procedures on the simulated bench. After
each one both drives have to be off, the alarm or error has to have a name, the record has to be
sealed and readable with every acknowledged point in it, and no point and no result may be wrong:
readings and standard are compared with the twin's true torque. The bench of separate instruments
over real sockets gets faults of its own (`benchmarks.network_faults`). Exits with 1 on any failure.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchmarks.fault_bench import KINDS, FaultyBench, Kind, on_thread
from torquebench.bench.audit import AUDIT_FILE, read_audit
from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.drivers import open_drivers
from torquebench.bench.drivers.base import Side
from torquebench.bench.safety import Alarm
from torquebench.calibration import load_profile
from torquebench.errors import RecordError, TorquebenchError
from torquebench.procedures import (
    FrictionSettings,
    calibrate,
    friction_sweep,
    rehearse,
    verify,
    zero_modules,
)
from torquebench.procedures.reducer_breakaway import BreakawaySettings, breakaway
from torquebench.procedures.reducer_loop import HysteresisSettings, hysteresis_loops
from torquebench.procedures.reducer_running import NoLoadSettings, no_load_running
from torquebench.procedures.reducer_setup import ReducerLimits, WarmUp
from torquebench.procedures.reducer_turning import (
    TransmissionRecording,
    TransmissionSettings,
    transmission_error,
)
from torquebench.records import RunFolder, RunWriter
from torquebench.station import Station, recover_unfinished

READING_PERCENT = 2.0
"""How far a reading may be from the truth without compensation, % of range (a drift of the zero
before it was measured included)."""
STANDARD_PERCENT = 0.15
ANGLE_DEG = 0.1
"""How far both angles of a reducer may be apart over a revolution, degrees of the output."""
SAFE_S = 1.0
"""Longest time until both drives are off, s of bench time, of a fault that stops the bench."""
QUICK, FULL = 25, 225
QUICK_WIRE, FULL_WIRE = 5, 49
TRIES = 5
MET_LATER = ("drive refuses commands", "disk full for documents", "wild reading")
"""Met with the next command or point, or where it exceeds a limit: counted from the alarm."""
Side_ = Literal["input", "output"]
Plan = Generator[Any, Any, Any]


@dataclass(frozen=True)
class Procedure:
    """A procedure with settings that are quick, the side it loads, whether a standard is used."""

    name: str
    plan: Callable[[Station], Plan]
    side: Side
    standard: bool = False


REDUCER = ReducerLimits(80.0, 784.0, 1960.0, 1300.0)
FRICTION = FrictionSettings(speeds_rpm=(200.0, 600.0), repeats=1, zero_s=0.5)


def _staircase(side: Side_) -> Callable[[Station], Plan]:
    profile = load_profile("rapid-in-situ").with_options(step_percent=25.0)
    return lambda station: calibrate(station.devices, side, profile)


def _verification(side: Side_) -> Callable[[Station], Plan]:
    profile = load_profile("verification").with_options(groups=1, points=8)
    steps = profile.staircase(50.0 if side == "input" else 2000.0, np.random.default_rng(3))
    return lambda station: verify(station.devices, side, profile, steps)


PROCEDURES = (
    Procedure("zero", lambda s: zero_modules(s.devices), "output"),
    Procedure("calibrate input", _staircase("input"), "input", standard=True),
    Procedure("calibrate output", _staircase("output"), "output", standard=True),
    Procedure("verify input", _verification("input"), "input", standard=True),
    Procedure("verify output", _verification("output"), "output", standard=True),
    Procedure("friction sweep", lambda s: friction_sweep(s.devices, FRICTION), "input"),
    Procedure(
        "no-load running",
        lambda s: no_load_running(
            s.devices, REDUCER, NoLoadSettings(sweep=FRICTION, warm_up=WarmUp(longest_s=0.0))
        ),
        "input",
    ),
    Procedure(
        "hysteresis loops",
        lambda s: hysteresis_loops(
            s.devices, REDUCER, HysteresisSettings(1, (0.0,), 0.5, 6.0, zero_s=0.5)
        ),
        "output",
    ),
    Procedure(
        "starting torque",
        lambda s: breakaway(
            s.devices, REDUCER, "input", BreakawaySettings(1, ramp_s=3.0, zero_s=0.5)
        ),
        "input",
    ),
    Procedure(
        "transmission error",
        lambda s: transmission_error(
            s.devices, REDUCER, TransmissionSettings(output_rpm=10.0, settle_s=0.5)
        ),
        "input",
    ),
)


@dataclass(frozen=True)
class Outcome:
    """What became of one fault.

    Parameters
    ----------
    kind, procedure : str
    status : {"stopped", "refused", "harmless", "recovered", "too late"}
        By an alarm, by the procedure itself, or nobody noticed, as nothing was wrong; found at
        the next start; or it never came, since the procedure had ended.
    alarm : str
        Name of the alarm, or of the error.
    safe_s : float
        Bench time from the fault to both drives off, s; NaN where none was on.
    points : int
        Points that were acknowledged and kept.
    problems : tuple of str
        What went wrong; empty when the fault was survived.
    """

    kind: str
    procedure: str
    status: str
    alarm: str
    safe_s: float
    points: int
    problems: tuple[str, ...]


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
    faulty.heal()
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

        lasts_s = rehearse(station.devices, procedure.plan(station)).duration_s
        moment_s = float(draw.uniform(0.05, 0.95)) * lasts_s
        due_s = station.clock.now() + moment_s
        faulty.plan(due_s, breaking, procedure.side, powered=kind.needs_power)
        error: BaseException | None = None
        result: object = None
        alarms_before = len(station.supervisor.history)
        try:
            result = station.run(procedure.plan(station), kind="fault").result
        except Exception as raised:
            error = raised
    station.supervisor.release("campaign")
    station.supervisor.wait_safe(20.0)
    alarms = station.supervisor.history[alarms_before:]
    outcome = judged(station, faulty, kind, procedure, error, alarms, result)
    faulty.heal()
    for _ in range(4):  # until what was injected is over and nothing coasts any more
        with contextlib.suppress(TorquebenchError):
            station.clock.wait(1.5)
        station.supervisor.wait_safe(20.0)
        station.acknowledge_alarm("fault campaign")
    return outcome


def judged(
    station: Station,
    faulty: FaultyBench,
    kind: Kind,
    procedure: Procedure,
    error: BaseException | None,
    alarms: Sequence[Alarm],
    result: object,
) -> Outcome:
    """Hold what is left against what must be."""
    problems = []
    if not faulty.at_rest():
        problems.append("a drive isn't off")
    if error is not None and not isinstance(error, TorquebenchError):
        problems.append(f"unforeseen {type(error).__name__}: {error}")
    if faulty.broken_s is None:
        return Outcome(kind.name, procedure.name, "too late", "", float("nan"), 0, ())
    if kind.needs_power and error is None and kind.name not in MET_LATER:
        lasted_s = (faulty.safe_s or station.clock.now()) - faulty.broken_s
        if lasted_s < SAFE_S:  # the procedure was over before it could matter
            return Outcome(kind.name, procedure.name, "too late", "", float("nan"), 0, ())
        if not (kind.name == "encoder slips" and isinstance(result, TransmissionRecording)):
            problems.append("nobody noticed it")
    if isinstance(result, TransmissionRecording):
        problems += slipped(result)
    safe_s = float("nan")
    if alarms and faulty.powered:
        if faulty.safe_s is None:
            faulty.tick()
        begun_s = alarms[0].time_s if kind.name in MET_LATER else faulty.broken_s
        safe_s = (faulty.safe_s or float("inf")) - begun_s
        if safe_s > SAFE_S:
            problems.append(f"safe only after {safe_s:.2f} s")
    run = station.registry.runs(limit=1)[0]
    folder = RunFolder.open(run.folder)
    points, wrong = checked(folder, station.description, stopped=error is not None)
    problems += wrong
    if error is not None and run.status != "failed":
        problems.append(f"the run is {run.status}")
    status = "harmless" if error is None else "stopped" if alarms else "refused"
    named = alarms[0].name if alarms else type(error).__name__ if error is not None else ""
    return Outcome(kind.name, procedure.name, status, named, safe_s, points, tuple(problems))


def slipped(recording: TransmissionRecording) -> Iterator[str]:
    """Say in which direction the angles are further apart than the twin's reducer has them."""
    for each in recording.directions:
        apart = np.ptp(each.output_angle_rad - each.input_angle_rad / REDUCER.ratio)
        if apart > np.radians(ANGLE_DEG):
            yield f"direction {each.direction}: angles {np.degrees(apart):.2f}° apart"


def checked(
    folder: RunFolder, description: BenchDescription, *, stopped: bool
) -> tuple[int, list[str]]:
    """Count the points of a record, and say what is wrong with it.

    The last point of a run that was stopped doesn't count: what stopped it may have begun while
    it was taken, and a calibration that goes on takes it again.
    """
    problems = []
    try:
        folder.verify()
    except RecordError as changed:
        problems.append(f"record: {changed}")
    if not any(read_audit(folder.path / AUDIT_FILE)):
        problems.append("no audit log")
    streams = {d["uid"]: str(d["name"]) for _, d in folder.documents("descriptor")}
    events = [(streams[event["descriptor"]], event) for _, event in folder.documents("event")]
    points = [event for stream, event in events if stream == "points"]
    zeros = [event for stream, event in events if stream.startswith("zero_")]
    for event in [*zeros, *(points[:-1] if stopped else points)]:
        for side in ("input", "output"):
            found = {
                key.removeprefix(f"{side}-steady-"): value
                for key, value in event["data"].items()
                if key.startswith(f"{side}-steady-")
            }
            problems += wrong_values(side, found, description)
    return len(points), problems


def wrong_values(
    side: Side_, found: dict[str, Any], description: BenchDescription
) -> Iterator[str]:
    """Say which values of a point are too far from the truth."""
    true = found.get("true_torque_nm")
    if true is None:
        return
    range_nm = description.module(side).range_nm
    for field, allowed in (("reading_nm", READING_PERCENT), ("standard_nm", STANDARD_PERCENT)):
        value = found.get(field)
        if value is not None and not abs(value - true) <= allowed / 100.0 * range_nm:
            yield f"{side} {field} {value:.6g} N·m, true {true:.6g} N·m"


def killed(seed: int, procedure: Procedure, data: Path, draw: np.random.Generator) -> Outcome:
    """Kill a process in the middle of a procedure; look what the next start makes of it."""
    child = os.fork()
    if child == 0:  # pragma: no cover - it is killed
        with contextlib.suppress(BaseException), opened(seed, data) as (station, _):
            station.run(procedure.plan(station), kind="calibrate-output")
        os._exit(0)
    deadline, events = time.monotonic() + 30.0, 0
    wanted = int(draw.integers(1, 8))
    while events < wanted and time.monotonic() < deadline:
        if os.waitpid(child, os.WNOHANG)[0]:
            child = 0
            break
        files = list(data.glob("runs/*/events.jsonl"))
        events = files[0].read_bytes().count(b'\n{"name": "event"') if files else 0
        time.sleep(0.002)
    if child:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    problems: list[str] = []
    from torquebench.records import Registry

    with Registry.open(data) as registry:
        recovered = recover_unfinished(registry)
        run = registry.runs(limit=1)[0]
        problems += [each.problem for each in recovered if each.problem]
        if run.status not in ("interrupted", "completed"):
            problems.append(f"the run is {run.status}")
        folder = RunFolder.open(run.folder)
        points, wrong = checked(folder, described(seed), stopped=True)
        if sum(1 for _ in folder.documents("event")) < events:
            problems.append("an acknowledged point is lost")
    return Outcome(
        "killed",
        procedure.name,
        "recovered",
        "found at the next start",
        float("nan"),
        points,
        (*problems, *wrong),
    )


def fitting_procedure(kind: Kind, draw: np.random.Generator) -> Procedure:
    """Draw a procedure in which a kind of fault can happen."""
    fitting = [each for each in PROCEDURES if kind.fits(each.name, each.standard)]
    return fitting[int(draw.integers(len(fitting)))]


def campaign(
    number: int, seed: int, *, told: Callable[[str], None] = lambda _line: None
) -> list[Outcome]:
    """Draw faults and go through them; a broken instrument gets a station of its own."""
    draw = np.random.default_rng(seed)
    plan = []
    for index in range(number):
        kind = KINDS[index % len(KINDS)]
        plan.append((kind, fitting_procedure(kind, draw)))
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as scratch, contextlib.ExitStack() as stack:
        current: tuple[Station, FaultyBench] | None = None
        for index, (kind, procedure) in enumerate(plan):
            folder = Path(scratch, str(index))
            if kind.name == "killed":
                stack.close()  # a fork takes no threads along
                current = None
                outcome = killed(seed, procedure, folder, draw)
            else:
                if current is None:
                    current = stack.enter_context(opened(seed + index, folder))
                for _ in range(TRIES):  # until it comes before the procedure's end
                    outcome = one_fault(*current, kind, procedure, draw)
                    if outcome.status != "too late" or ended(current[0]):
                        break
                    procedure = fitting_procedure(kind, draw)
            outcomes.append(outcome)
            told(line_of(outcome))
            if current is not None and (outcome.problems or ended(current[0])):
                stack.close()  # the bench is opened again
                current = None
    return outcomes


def ended(station: Station) -> bool:
    """Whether acquisition has ended, as it does where an instrument is lost."""
    try:
        station.clock.wait(0.1)
    except TorquebenchError:
        return True
    return False


def line_of(outcome: Outcome) -> str:
    """Return an outcome in one line."""
    mark = "FAILED " + "; ".join(outcome.problems) if outcome.problems else outcome.status
    return f"{outcome.kind:27s} {outcome.procedure:19s} {mark} {outcome.alarm}"


def report(outcomes: list[Outcome], name: str) -> int:
    """Print what was survived; return how many weren't."""
    failed = [outcome for outcome in outcomes if outcome.problems]
    status = Counter(outcome.status for outcome in outcomes)
    times = np.array([each.safe_s for each in outcomes if np.isfinite(each.safe_s)])
    survived = len(outcomes) - len(failed)
    kinds = len({outcome.kind for outcome in outcomes})
    print(f"\nfaults survived {survived} of {len(outcomes)}, {kinds} kinds, {name}")
    print("  " + ", ".join(f"{count} {name}" for name, count in status.most_common()))
    if times.size:
        middle, high = np.percentile(times, (50.0, 99.0))
        print(
            f"  from fault to both drives off: p50 {middle:.2f} s, p99 {high:.2f} s, "
            f"max {times.max():.2f} s ({times.size} faults with power on)"
        )
    print(f"  acknowledged points kept: {sum(each.points for each in outcomes)}")
    print("  alarms: " + ", ".join(sorted({each.alarm for each in outcomes if each.alarm})))
    for each in failed:
        print("  " + line_of(each))
    return len(failed)


def main() -> int:
    """Go through the campaign; 1 where a fault wasn't survived."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} faults instead of {FULL}")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--verbose", action="store_true", help="say each fault")
    arguments = parser.parse_args()
    from benchmarks.network_faults import network_campaign  # which imports this module

    number, wires = (QUICK, QUICK_WIRE) if arguments.quick else (FULL, FULL_WIRE)
    told = print if arguments.verbose else lambda _line: None
    failures = 0
    for name, go, count in (
        ("simulated bench, bench time", campaign, number),
        ("simulated instruments over sockets, wall time", network_campaign, wires),
    ):
        began, began_cpu = time.monotonic(), time.process_time()
        failures += report(go(count, arguments.seed, told=told), name)
        cpu_s = time.process_time() - began_cpu
        print(f"  {time.monotonic() - began:.0f} s, of which {cpu_s:.0f} s computing")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
