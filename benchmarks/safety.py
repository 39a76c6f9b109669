"""Time from a violation to the drives' command to zero.

A whole station runs in real time on the simulated bench: acquisition, run engine, journal. While
its output is loaded a violation happens at a random moment, and the wall clock measures the time
until both drives have been told to go to zero. This is measured with the station alone, beside busy
programs of usual priority, and beside a thread of the same process that computes in Python without
pause. The aim applies to the station alone, and beside busy programs where the system grants
real-time priority.

==============  =================================================================================
overload        the drive pulls beyond the limit; counted from the true torque's crossing it
outlier reading    the transducer's frequency jumps beyond the limit; from the jump
drive fault     the drive reports a fault and goes off; from then
stop asked for  somebody calls `Station.emergency_stop`; from the call
lost signal     the transducer falls silent; from the end of the tolerated `signal_loss_s`
==============  =================================================================================
"""

from __future__ import annotations

import argparse
import contextlib
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast
from unittest.mock import patch

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
import numpy as np
from bluesky.utils import Msg

from benchmarks.reporting import AIMS, BENCHMARKS, write_section
from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.drivers.simulated.driver import SimulatedBench, SimulatedDrive
from torquebench.bench.safety.priority import Priority, available_priority
from torquebench.errors import TorquebenchError
from torquebench.station import Station

LIMIT_MS = AIMS["safety"]["zero command, 99 %, ms"].high
LIMIT_NM = 1000.0
LOADED_NM = 800.0
PATIENCE_S = 10.0
PERCENTILES = (50.0, 90.0, 99.0, 100.0)
FAST_CHECKS_S = (0.0025, 0.005, 0.01, 0.05)
CAUSES = ("overload", "outlier reading", "drive fault", "stop asked for", "lost signal")
TRIALS, QUICK_TRIALS = 60, 5
USUAL_LOAD = 4
FAULT_S = 0.15


@dataclass(frozen=True)
class Situation:
    """Other load on the processors: busy programs, and busy threads of the same process."""

    programs: int = 0
    threads: int = 0

    @property
    def title(self) -> str:
        """The situation in words."""
        if self.threads:
            return "beside a thread that computes in Python"
        return f"beside {self.programs} busy programs" if self.programs else "alone"

    def aimed_at(self, granted: Priority) -> bool:
        """Return whether the aim applies: alone, or beside programs of lower priority."""
        return not self.threads and (not self.programs or granted is Priority.REAL_TIME)


def described(fast_check_s: float) -> BenchDescription:
    """Describe the simulated bench with a low limit on its output and quick ramps."""
    text = default_bench().model_dump()
    text["output"]["range_nm"] = 900.0
    text["output"]["limits"]["torque_nm"] = LIMIT_NM
    text["output"]["drive"]["torque_rate_nm_per_s"] = 20_000.0
    text["safety"] |= {"ramp_to_zero_s": 0.05, "fast_check_s": fast_check_s}
    return BenchDescription.model_validate(text)


@dataclass
class Timed:
    """Record of the moments at which simulated drives were told to go to zero."""

    told: list[float] = field(default_factory=list)

    @contextlib.contextmanager
    def watching(self) -> Iterator[None]:
        """Record every command to zero of the simulated drives."""
        ramp = SimulatedDrive.ramp_to_zero

        def noted(drive: SimulatedDrive, duration_s: float) -> None:
            ramp(drive, duration_s)
            self.told.append(time.monotonic())

        with patch.object(SimulatedDrive, "ramp_to_zero", noted):
            yield


def wall_of(station: Station, bench_s: float) -> float:
    """Return the wall time (`time.monotonic`) at which a moment of bench time was due."""
    return station.acquisition._wall_start + bench_s


def overload(station: Station, draw: np.random.Generator) -> Callable[[], float]:
    """Exceed the torque limit; return a function for the moment when the torque crosses it."""
    del draw
    bench = cast(SimulatedBench, station.drivers.counter)
    started_s = station.clock.now()
    bench.drives["output"].command_torque(1600.0, 40_000.0)

    def moment() -> float:
        truth = bench._truth.window(started_s, started_s + 1.0)
        assert truth is not None
        beyond = int(np.argmax(np.abs(truth["output"]) > LIMIT_NM))
        return wall_of(station, float(truth.time_s[beyond]))

    return moment


def outlier_reading(station: Station, draw: np.random.Generator) -> Callable[[], float]:
    """Let the reading jump at a random moment between two checks."""
    bench = cast(SimulatedBench, station.drivers.counter)
    start_s = station.clock.now() + 0.1 + float(draw.uniform(0.0, 0.05))
    bench.twin.inject_fault("output_torque", "outlier", start_s=start_s, duration_s=FAULT_S)
    return lambda: wall_of(station, start_s)


def lost_signal(station: Station, draw: np.random.Generator) -> Callable[[], float]:
    """Let the transducer's signal stop."""
    bench = cast(SimulatedBench, station.drivers.counter)
    start_s = station.clock.now() + 0.1 + float(draw.uniform(0.0, 0.05))
    bench.twin.inject_fault("output_torque", "silent", start_s=start_s, duration_s=FAULT_S)
    return lambda: wall_of(station, start_s + station.description.safety.signal_loss_s)


def drive_fault(station: Station, draw: np.random.Generator) -> Callable[[], float]:
    """Let the drive report a fault and switch off."""
    bench = cast(SimulatedBench, station.drivers.counter)
    time.sleep(float(draw.uniform(0.0, 0.05)))
    bench._axes["output"].fault = "overcurrent"
    now = time.monotonic()
    bench._set_enabled("output", False)
    return lambda: now


def stop_asked_for(station: Station, draw: np.random.Generator) -> Callable[[], float]:
    """Request an emergency stop."""
    time.sleep(float(draw.uniform(0.0, 0.05)))
    now = time.monotonic()
    station.emergency_stop("benchmark")
    return lambda: now


CAUSING = dict(
    zip(CAUSES, (overload, outlier_reading, drive_fault, stop_asked_for, lost_signal), strict=True)
)


def loaded(station: Station) -> Generator[Msg, Any, None]:
    """Load the output and keep it loaded."""
    devices = station.devices
    yield from bps.mv(devices.mounting, "calibrator")
    yield from bps.mv(devices.clamp, True)
    yield from bps.mv(devices.input.mode, "locked")
    yield from bps.mv(devices.output.mode, "driven")
    yield from bps.mv(devices.output.drive.power, True)
    yield from bps.mv(devices.output.drive.torque, LOADED_NM)
    yield from bps.sleep(60.0)


def one_trial(
    station: Station, timed: Timed, cause: str, draw: np.random.Generator
) -> float | None:
    """Return the time from a violation to the command to zero of the last drive, s.

    None where the bench wasn't loaded in time, because the computer is busy.
    """
    moments: list[Callable[[], float]] = []

    def break_it() -> None:
        drive, deadline = station.drivers.drives["output"], time.monotonic() + PATIENCE_S
        while (drive.state().torque_nm or 0.0) < LOADED_NM:
            if time.monotonic() > deadline:
                return
            time.sleep(0.01)
        time.sleep(0.05)
        timed.told.clear()
        moments.append(CAUSING[cause](station, draw))

    breaking = threading.Thread(target=break_it)
    breaking.start()
    with contextlib.suppress(TorquebenchError):
        station.run(bpp.run_wrapper(loaded(station)), kind="benchmark")
    breaking.join()
    station.supervisor.wait_safe(10.0)
    alarm = station.supervisor.alarm
    delay_s = timed.told[1] - moments[0]() if moments else None
    time.sleep(FAULT_S)  # until the injected fault is over
    station.acknowledge_alarm("benchmark")
    if delay_s is None:
        print(f"  a trial of {cause} was never loaded: {alarm.found if alarm else 'no alarm'}")
    return delay_s


@contextlib.contextmanager
def other_programs(count: int) -> Iterator[None]:
    """Run busy programs of usual priority."""
    running = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for each in running:
            each.kill()
            each.wait()


@contextlib.contextmanager
def busy(threads: int) -> Iterator[None]:
    """Run busy Python threads in this process."""
    ending = threading.Event()

    def compute() -> None:
        total = 0
        while not ending.is_set():
            for number in range(10_000):
                total += number * number

    computing = [threading.Thread(target=compute, daemon=True) for _ in range(threads)]
    for each in computing:
        each.start()
    try:
        yield
    finally:
        ending.set()
        for each in computing:
            each.join()


def delays(fast_check_s: float, trials: int, situation: Situation) -> dict[str, list[float]]:
    """Return the delays of every cause in ms; one seed determines their random moments."""
    draw = np.random.default_rng(1)
    found: dict[str, list[float]] = {cause: [] for cause in CAUSES}
    timed = Timed()
    with (
        other_programs(situation.programs),
        timed.watching(),
        tempfile.TemporaryDirectory() as folder,
        Station.open(described(fast_check_s), Path(folder), real_time=True) as station,
        busy(situation.threads),
    ):
        for _ in range(trials):
            for cause in CAUSES:
                delay_s = one_trial(station, timed, cause, draw)
                if delay_s is not None:
                    found[cause].append(1e3 * delay_s)
    return found


def processor_share(fast_check_s: float, wall_s: float) -> float:
    """Return the share of one processor that this process uses while the bench is loaded, %."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Station.open(described(fast_check_s), Path(folder), real_time=True) as station,
    ):
        used: list[float] = []

        def plan() -> Generator[Msg, Any, None]:
            yield from _ready(station)
            begun = time.process_time()
            yield from bps.sleep(wall_s)
            used.append(time.process_time() - begun)

        station.run(bpp.run_wrapper(plan()), kind="benchmark")
    return 100.0 * used[0] / wall_s


def _ready(station: Station) -> Generator[Msg, Any, None]:
    for message in loaded(station):
        if message.command == "sleep":
            return
        yield message


def report(situation: Situation, found: dict[str, list[float]]) -> float:
    """Print percentiles in ms; return the worst 99th percentile."""
    print(f"\n{situation.title}")
    heads = [f"p{p:g}" if p < 100 else "max" for p in PERCENTILES]
    print(f"  {'cause':16s}{'trials':>7s}" + "".join(f"{head:>9s}" for head in heads))
    for cause, values in found.items():
        line = "".join(f"{value:9.2f}" for value in np.percentile(values, PERCENTILES))
        print(f"  {cause:16s}{len(values):7d}{line}")
    return max(float(np.percentile(values, 99.0)) for values in found.values())


def markdown(measured: Mapping[Situation, Mapping[str, list[float]]]) -> str:
    """Return the page's table: median, 99th percentile and worst delay in each situation."""
    heads = [f"{each.title}: median, 99 %, worst" for each in measured]
    lines = [f"| cause | {' | '.join(heads)} |", "| --- " * (len(heads) + 1) + "|"]
    for cause in CAUSES:
        cells = []
        for found in measured.values():
            figures = np.percentile(found[cause], (50.0, 99.0, 100.0))
            cells.append(", ".join(f"{value:.2g}" for value in figures))
        lines.append(f"| {cause} | {' | '.join(cells)} |")
    counts = {len(values) for found in measured.values() for values in found.values()}
    trials = "-".join(str(count) for count in sorted({min(counts), max(counts)}))
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    about = (
        f"Simulated bench in real time, {os.cpu_count()} processors, {trials} trials a cause and "
        f"situation, {available_priority().description} priority, "
        f"load average at the end {load:.1f}; ms from a violation to the zero command of both "
        "drives, a fast check every "
        f"{1e3 * default_bench().safety.fast_check_s:g} ms. A lost signal counts from the end of "
        f"its tolerated {1e3 * default_bench().safety.signal_loss_s:g} ms."
    )
    return about + "\n\n" + "\n".join(lines)


def print_costs() -> None:
    """Print the processor time that shorter and longer intervals between fast checks cost."""
    print("\nlooks and what they cost, loaded bench, % of one processor")
    for fast_check_s in FAST_CHECKS_S:
        print(f"  {1e3 * fast_check_s:5g} ms  {processor_share(fast_check_s, 10.0):5.1f} %")


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and report; 1 where the aim is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few trials alone only")
    parser.add_argument("--trials", type=int, help=f"trials of each cause (default {TRIALS})")
    parser.add_argument(
        "--load", type=int, metavar="N", help="alone and beside N busy programs, nothing else"
    )
    parser.add_argument("--costs", action="store_true", help="what looks cost, nothing else")
    parser.add_argument("--write", action="store_true", help="put the table into the documents")
    options = parser.parse_args(arguments)
    if options.costs:
        print_costs()
        return 0
    trials = options.trials or (QUICK_TRIALS if options.quick else TRIALS)
    situations = [Situation()]
    if options.load is not None:
        situations.append(Situation(programs=options.load))
    elif not options.quick:
        situations += [Situation(programs=USUAL_LOAD), Situation(threads=1)]
    fast_check_s = default_bench().safety.fast_check_s
    granted = available_priority()
    print(
        f"simulated bench in real time, {os.cpu_count()} processors, priority: "
        f"{granted.description}; ms from a violation to the zero command, "
        f"a fast check every {1e3 * fast_check_s:g} ms"
    )
    measured: dict[Situation, dict[str, list[float]]] = {}
    worst: dict[Situation, float] = {}
    for situation in situations:
        fewer = trials if situation == Situation() else max(1, trials // 2)
        measured[situation] = delays(fast_check_s, fewer, situation)
        worst[situation] = report(situation, measured[situation])
    if options.write:
        write_section(BENCHMARKS, "safety", markdown(measured))
    print(f"\nworst 99th percentiles, aim {LIMIT_MS:g} ms:")
    for situation, value in worst.items():
        print(f"  {situation.title:50s} {value:6.1f} ms {'' if value <= LIMIT_MS else 'MISSED'}")
    held_to = [value for each, value in worst.items() if each.aimed_at(granted)]
    return int(max(held_to) > LIMIT_MS)
