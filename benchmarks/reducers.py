"""Accuracy of reducer tests, on simulated specimens on a calibrated bench.

python -m benchmarks.reducers [--quick] [--specimens N] [--reducer NAME] [--profile NAME]
    [--up-to INPUT,OUTPUT] [--series N] [--tests NAME,NAME] [--loops N] [--repeats N] [--workers N]
    [--first-seed N] [--into FOLDER]

For each simulated bench (a seed of its own) both modules are calibrated and compensated; then a
specimen undergoes all tests with the plans, the data path and the evaluation of a real bench. The
results are compared with the specimen's true properties. With ``--into``, the results of each bench
are kept, and an interrupted run can be continued. The exit code is 1 where an aim is missed.
"""

import argparse
import json
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import Progress
from tests.support.reducer_truth import (
    true_back_driving_nm,
    true_efficiency,
    true_loop,
    true_loop_values,
    true_starting_nm,
    true_transmission_error,
)

from benchmarks.reporting import AIMS, Aim, show
from torquebench.bench.description import BenchDescription, default_bench
from torquebench.bench.drivers.simulated.driver import SimulatedOptions
from torquebench.bench.roles import SIDES, Side
from torquebench.calibration import Profile, load_profile
from torquebench.campaign.calibrating import CALIBRATION, measure_calibration
from torquebench.campaign.fitting import ModelChoice
from torquebench.campaign.reducers.results import ReducerTestOutcome
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.tests import run_reducer_test
from torquebench.campaign.registering import registers_calibration
from torquebench.compensation import RECOMMENDED
from torquebench.errors import TorquebenchError
from torquebench.procedures.reducers.first_motion import BreakawaySettings
from torquebench.procedures.reducers.friction import FrictionSettings
from torquebench.procedures.reducers.loop import BenchTwistSettings, HysteresisSettings
from torquebench.procedures.reducers.running import EfficiencySettings, NoLoadSettings
from torquebench.procedures.reducers.setup import WarmUp
from torquebench.reducers import LOST_MOTION_RULES, ReducerDescription, load_reducer
from torquebench.station import Station
from torquebench.twin.reducer import ReducerConstants
from torquebench.units import ARCSEC

MODELS = (ModelChoice(RECOMMENDED),)
COLD = WarmUp(longest_s=0.0)
BLOCK_S = 0.05
"""Bench time of one block: short enough for the supervision of the drives to follow a ramp."""
TESTS = (
    "starting",
    "back-driving",
    "transmission-error",
    "hysteresis",
    "no-load",
    "efficiency",
)
SETTINGS = ReducerTestSettings(bench_twist=BenchTwistSettings(cycles=1)).with_plans(
    {
        "no-load": NoLoadSettings(
            FrictionSettings(speeds_rpm=(100.0, 400.0, 1000.0), settle_s=1.0, window_s=1.0), COLD
        ),
        "starting": BreakawaySettings(positions=3),
        "back-driving": BreakawaySettings(positions=3),
        "efficiency": EfficiencySettings(
            torque_shares=(0.2, 1.0),
            speeds_rpm=(300.0, 900.0),
            counter_clockwise=True,
            warm_up=COLD,
        ),
    }
)


@dataclass(frozen=True)
class Deviation:
    """One reported value and its true value."""

    test: str
    key: str
    found: float
    truth: float
    expanded: float

    @property
    def covered(self) -> bool:
        """Whether the reported interval contains the truth."""
        return abs(self.found - self.truth) <= self.expanded


def described(reducer: str, bench_seed: int, specimen: int) -> BenchDescription:
    """Describe a simulated bench with a specimen mounted."""
    bench = default_bench()
    driver = {**bench.driver, "seed": bench_seed, "reducer": reducer, "reducer_seed": specimen}
    ratio = load_reducer(reducer).ratio
    return bench.model_copy(
        update={
            "driver": driver,
            "bench": bench.bench.model_copy(update={"reducer_ratio": ratio}),
            "counter": bench.counter.model_copy(update={"block_s": BLOCK_S}),
        }
    )


def calibrated(station: Station, side: Side, profile: Profile) -> None:
    """Calibrate a side as ``calibrate`` does, and activate the compensation."""
    registers = registers_calibration(MODELS, RECOMMENDED)
    measured = measure_calibration(station, side, profile, metadata=registers)
    CALIBRATION.evaluate_and_register(station.registry, measured)
    station.activate_compensation(side)


def sides_of(tests: Sequence[str]) -> tuple[Side, ...]:
    """Return the sides whose torque is used by any of the tests."""
    if set(tests) <= {"hysteresis", "transmission-error"}:
        return ("output",)
    return ("input",) if set(tests) <= {"no-load", "starting"} else SIDES


def truths(
    constants: ReducerConstants, reducer: ReducerDescription, outcome: ReducerTestOutcome
) -> dict[str, float]:
    """Return the true values of a test's results by their keys, without those that aren't known."""
    recording = outcome.recording
    if outcome.name == "hysteresis":
        known = true_loop_values(
            constants,
            reducer.rated_torque_nm,
            lost_motion_share=LOST_MOTION_RULES[reducer.lost_motion_rule].share,
            stiffness_interval=reducer.stiffness_interval,
        )
        # The loss depends on the driven loop, which never ends exactly at ±T_N.
        driven = float(np.mean([each.largest_torque_nm for each in outcome.result.loops]))
        torque, angle = true_loop(constants, driven)
        loss = abs(float(np.trapezoid(angle, torque)))
        return {**known, "hysteresis_loss": loss}
    if outcome.name == "transmission-error":
        angle = np.linspace(0.0, 2.0 * np.pi, 100_001)
        error = float(np.ptp(true_transmission_error(constants, angle)))
        return {"transmission_error": error / ARCSEC}
    if outcome.name == "starting":
        return {"starting_torque": true_starting_nm(constants, recording.temperature_c)}
    if outcome.name == "back-driving":
        return {"back_driving_torque": true_back_driving_nm(constants, recording.temperature_c)}
    # A cold reducer warms up during the test: each point has its own temperature.
    if outcome.name == "no-load":
        return no_load_truths(outcome)
    return {
        quantity.key: 100.0
        * float(
            true_efficiency(constants, point.speed_rpm, abs(point.torque_nm), point.temperature_c)
        )
        for quantity, point in zip(
            outcome.result.quantities(),
            (*outcome.result.means, *outcome.result.points),
            strict=True,
        )
    }


def no_load_truths(outcome: ReducerTestOutcome) -> dict[str, float]:
    """Return the mean true input torques in the windows of the test, by the results' keys.

    For an RV-40E class reducer they equal its friction at constant speed within 0.15 %. The
    transmission error of a harmonic reducer shakes the free output, which takes more torque.
    """
    recording = outcome.recording
    torque = recording.true_torque_nm["input"]

    def mean(speed_rpm: float) -> float:
        return float(np.mean(torque[np.isclose(recording.nominal_rpm, speed_rpm, rtol=0.02)]))

    result = outcome.result
    found = {each.key: mean(each.speed_rpm) for each in result.points}
    for each in result.means:
        found[each.key] = 0.5 * (mean(each.speed_rpm) - mean(-each.speed_rpm))
    return found


@dataclass(frozen=True)
class Work:
    """One bench with one specimen to test; the bench's errors affect all its results."""

    reducer: str
    seed: int
    profile: str
    tests: tuple[str, ...]
    loops: int
    repeats: int | None
    series: int | None
    up_to_nm: dict[Side, float] | None
    into: Path | None

    @property
    def kept(self) -> Path | None:
        """Path of the kept results, different for other tests or another calibration."""
        if self.into is None:
            return None
        name = [self.reducer, self.profile, *self.tests, f"{self.loops}-loops"]
        if self.repeats is not None:
            name.append(f"{self.repeats}-repeats")
        if self.series is not None:
            name.append(f"{self.series}-series")
        if self.up_to_nm is not None:
            name.append("to-" + "-".join(f"{each:g}" for each in self.up_to_nm.values()))
        return self.into / f"{'_'.join([*name, str(self.seed)])}.json"

    def settings(self) -> ReducerTestSettings:
        """Return the settings of the tests."""
        settings = SETTINGS.with_plans({"hysteresis": HysteresisSettings(loops=self.loops)})
        return settings if self.repeats is None else settings.with_repeats(self.repeats)

    def calibration(self, side: Side) -> Profile:
        """Return the calibration profile of a side."""
        profile = load_profile(self.profile).with_options(repeats=self.series)
        if self.up_to_nm is None:
            return profile
        range_nm = default_bench().module(side).range_nm
        return profile.with_options(up_to_percent=100.0 * self.up_to_nm[side] / range_nm)


Found = tuple[list[Deviation], list[str]]


def specimen_deviations(work: Work, data: Path) -> Found:
    """Test a bench's specimen; return the deviations, and the messages of refused tests."""
    specimen = 1000 * work.seed
    bench, kind = described(work.reducer, work.seed, specimen), load_reducer(work.reducer)
    constants = SimulatedOptions(**bench.driver).parameters().reducer
    deviations: list[Deviation] = []
    refused: list[str] = []
    with Station.open(bench, data) as station:
        for side in sides_of(work.tests):
            station.activate_compensation(side)
        for name in work.tests:
            try:
                record = run_reducer_test(
                    station, name, kind, work.settings(), serial=str(specimen)
                )
            except TorquebenchError as error:
                refused.append(f"bench {work.seed}, {name}: {error}")
                station.supervisor.acknowledge("benchmark")
                continue
            (outcome,) = record.outcomes
            known = truths(constants, kind, outcome)
            deviations += [
                Deviation(name, each.key, each.value, known[each.key], each.expanded_uncertainty)
                for each in outcome.quantities
                if each.key in known
            ]
    return deviations, refused


def one_bench(work: Work) -> Found:
    """Calibrate the sides that the tests use, test a specimen, and return its deviations."""
    kept = work.kept
    if kept is not None and kept.exists():
        deviations, refused = json.loads(kept.read_text())
        return [Deviation(**each) for each in deviations], refused
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder)
        with Station.open(described(work.reducer, work.seed, 0), data) as station:
            for side in sides_of(work.tests):
                calibrated(station, side, work.calibration(side))
        found = specimen_deviations(work, data)
    if kept is not None:
        part = kept.with_suffix(".part")
        part.write_text(json.dumps([[asdict(each) for each in found[0]], found[1]]))
        part.replace(kept)
    return found


def family(each: Deviation) -> str:
    """Return the row of the report to which a value belongs."""
    if each.test not in ("no-load", "efficiency"):
        return each.key
    one_direction = "+" in each.key or "-" in each.key
    return each.test.replace("-", "_") + (", one direction" if one_direction else "")


def misses(name: str, group: list[Deviation]) -> np.ndarray:
    """Return the deviation of each value in the unit of its aim."""
    off: np.ndarray = np.array([abs(each.found - each.truth) for each in group])
    if name in ("backlash", "lost_motion"):
        beyond: np.ndarray = np.maximum(off - np.array([each.expanded for each in group]), 0.0)
        return beyond
    if name == "stiffness" or name.startswith("no_load"):
        off = 100.0 * off / np.array([abs(each.truth) for each in group])
    return off


def report(
    console: Console, deviations: list[Deviation], refused: list[str], specimens: int
) -> bool:
    """Print a row for each kind of value; return whether all aims are met."""
    groups: dict[str, list[Deviation]] = defaultdict(list)
    for each in deviations:
        groups[family(each)].append(each)
    rows, all_met = [], not refused
    for name, group in groups.items():
        share = float(np.mean([each.covered for each in group]))
        off = misses(name, group)
        aims = (each for each in AIMS["reducers"].items() if each[0].startswith(name.split(",")[0]))
        title, wanted = next(aims, (", ", Aim()))
        # Random variation of the coverage over this many specimens.
        slack = 2.0 * np.sqrt(0.95 * 0.05 / specimens)
        met = share >= 0.95 - slack and wanted.met(float(np.quantile(off, 0.95)))
        all_met &= met
        rows.append(
            [
                name.replace("_", " "),
                f"{len(group)}",
                f"{100 * share:.1f} %",
                f"{np.median(off):.3g}, {np.quantile(off, 0.95):.3g}, {off.max():.3g} "
                + title.partition(", ")[2],
                f"{wanted if np.isfinite(wanted.high) else '–'}{'' if met else ' MISSED'}",
            ]
        )
    headings = ["value", "values", "coverage", "error: median, 95 %, worst", "aim at 95 %"]
    show(console, "Errors", headings, rows)
    for line in refused:
        console.print(f"refused: {line}")
    return all_met


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and report; 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two benches")
    parser.add_argument("--specimens", type=int, default=200, help="each on a bench of its own")
    parser.add_argument("--reducer", default="rv-40e")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--profile", default="small-torques", help="of both calibrations")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--tests", default=",".join(TESTS), help="some of them, with commas")
    parser.add_argument("--loops", type=int, default=1, help="torque-angle loops a position")
    parser.add_argument("--repeats", type=int, help="of running tests at most, and empty runs")
    parser.add_argument("--series", type=int, help="of both calibrations; the profile's without")
    parser.add_argument(
        "--up-to", help="largest torque of both calibrations, N·m: INPUT,OUTPUT; profile's without"
    )
    parser.add_argument("--into", type=Path, help="folder to keep benches in, and to go on from")
    options = parser.parse_args(arguments)
    if options.into is not None:
        options.into.mkdir(parents=True, exist_ok=True)
    count = 2 if options.quick else options.specimens
    tests = tuple(options.tests.split(","))
    torques = [float(each) for each in options.up_to.split(",")] if options.up_to else []
    up_to_nm = dict(zip(SIDES, torques, strict=True)) if torques else None
    work = [
        Work(
            reducer=options.reducer,
            seed=seed,
            profile=options.profile,
            tests=tests,
            loops=options.loops,
            repeats=options.repeats,
            series=options.series,
            up_to_nm=up_to_nm,
            into=options.into,
        )
        for seed in range(options.first_seed, options.first_seed + count)
    ]
    began = time.perf_counter()
    found = []
    with (
        ProcessPoolExecutor(options.workers, get_context("spawn")) as pool,
        Progress(console=Console(stderr=True)) as progress,
    ):
        task = progress.add_task(f"{options.reducer}, benches", total=count)
        for each in pool.map(one_bench, work):
            found.append(each)
            progress.advance(task)
    deviations = [each for some, _ in found for each in some]
    refused = [each for _, some in found for each in some]
    print(
        f"simulated {options.reducer}, {count} benches with a specimen each, "
        f"{time.perf_counter() - began:.0f} s; aims hold for 95 % of the values"
    )
    return int(not report(Console(), deviations, refused, count))
