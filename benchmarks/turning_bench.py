"""Errors of single readings while the simulated bench turns, calculated as the commands do.

This calibrates both modules of nominal benches at standstill at
three temperatures (`calibrate`) and against the turning calibrator (`turn --profile
turning-calibration`), records empty runs (`turn --profile empty-run`), reads their files as ``fit``
does and fits. Then the modules follow random torques and speeds at five temperatures, and every
window of the counter is compensated as ``apply`` does and compared with the twin's true torque.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import tempfile
import warnings
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy starts its threads

import bluesky.plan_stubs as bps
import bluesky.preprocessors as bpp
import numpy as np
from bluesky.utils import Msg
from rich.console import Console
from tests.support.chain_shapes import FloatArray

from benchmarks.reporting import BENCHMARKS, judge, show, write_section
from torquebench.bench.description import default_bench
from torquebench.bench.devices import RampTo
from torquebench.bench.roles import SIDES, Side
from torquebench.calibration import load_profile
from torquebench.campaign.bench_chains import referenced
from torquebench.campaign.calibrating import measure_calibration
from torquebench.campaign.chains import reference_effect
from torquebench.campaign.fitting import fit_table
from torquebench.campaign.turning import identify_turning, joined_tables
from torquebench.campaign.turning_runs import measure_turning
from torquebench.campaign.verifying import measure_verification
from torquebench.chain import MeasuringChain, Readings, RecordedStream
from torquebench.procedures.reducers.setup import temperature_c
from torquebench.procedures.setup import Setup, power_off, set_up
from torquebench.procedures.turning.profile import load_turning_profile
from torquebench.procedures.zeroing import zero
from torquebench.station import Station
from torquebench.tables import read_calibration, read_empty_run, write_calibration
from torquebench.units import RAD_S_PER_RPM

SEEDS = 10
CALIBRATED_C = (23.0, 12.0, 35.0, 48.0)
USED_C = (10.0, 20.0, 30.0, 40.0, 50.0)
BEHIND_K = 3.0
"""Difference by which the shafts are colder than their transducers in the last stretch, K."""
AVERAGED = 10
SLICES = 20
"""Number of parts of a window for the weighted mean of the true torque."""
LEGS = 5
SETTLED_S = 0.2
LARGEST_RPM: dict[Side, float] = {"input": 1200.0, "output": 15.0}
STEEPEST_RPM_PER_S: dict[Side, float] = {"input": 300.0, "output": 3.75}

_VERIFICATION = load_profile("verification")
_FEW = _VERIFICATION.model_copy(
    update={"loading": _VERIFICATION.loading.model_copy(update={"groups": 1})}
)

_TURNING = load_turning_profile("turning-calibration").model_copy(
    update={"speed_shares": [1.0], "torque_shares": [0.5, 1.0]}
)

Soak = Callable[..., None]
Plan = Generator[Any, Any, None]


@dataclass(frozen=True)
class Result:
    """One module of one bench; errors in % of full scale."""

    seed: int
    side: Side
    worst: float
    rms: float
    raw_worst: float
    static_worst: float
    expanded: float
    coverage: float
    window_worst: float
    readings: int


def bench_of(seed: int) -> Any:
    """Return the packaged simulated bench with another seed, for the benchmark's temperatures."""
    bench = default_bench()
    conditions = bench.conditions.model_copy(
        update={"temperature_low_c": min(USED_C), "temperature_high_c": max(USED_C)}
    )
    driver = {**bench.driver, "seed": seed}
    return bench.model_copy(update={"driver": driver, "conditions": conditions})


def calibrated_chain(station: Station, side: Side, soak: Soak, folder: Path) -> MeasuringChain:
    """Calibrate a module and fit its chain from the files."""
    tables, runs = [], []
    for celsius in CALIBRATED_C:
        soak(celsius)
        if celsius == CALIBRATED_C[0]:
            measured = measure_calibration(station, side, load_profile("rapid-in-situ"))
        else:  # the calibrator's span depends on temperature, the standard's hardly does
            measured = measure_verification(station, side, _FEW, seed=round(celsius))
        tables.append(folder / f"{side}-static-{celsius:g}.csv")
        found = measured.result  # as `records export` writes it
        stated = referenced(found.data, measured.record.metadata, found.standard_serial)
        write_calibration(tables[-1], stated)
        runs.append(folder / f"{side}-empty-{celsius:g}.csv")
        measure_turning(station, side, load_turning_profile("empty-run"), runs[-1])
    soak(CALIBRATED_C[0])
    tables.append(folder / f"{side}-turning.csv")
    measure_turning(station, side, _TURNING, tables[-1])
    return fitted_chain(tables, runs, side)


def fitted_chain(tables: Sequence[Path], runs: Sequence[Path], side: Side) -> MeasuringChain:
    """Fit a chain to its files, as ``fit`` does; the tables state the standards' U."""
    points = joined_tables({path.name: read_calibration(path) for path in tables})
    turning = identify_turning(points, [read_empty_run(path) for path in runs])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        fitted = fit_table(turning.points, side)
    standard = reference_effect(points, None, side, str)
    return MeasuringChain(fitted.model, (*turning.effects, *standard))


@dataclass
class Stretch:
    """Readings at one temperature, and the true torques."""

    readings: Readings
    true_nm: Any


def weighted_truth(
    true_means: Callable[[FloatArray], FloatArray], time_s: FloatArray, window_s: float
) -> FloatArray:
    """Return true torques in windows, weighted over each window as by the regression counter.

    A straight line's slope through the edges' phases weights the frequency with a parabola. For a
    torque at the shaft's resonance, this mean differs from that with equal weights.
    """
    borders = np.linspace(-0.5, 0.5, SLICES + 1)
    edges = np.unique(np.round((time_s[:, None] + window_s * borders[None, :]).ravel(), 9))
    means = true_means(edges)
    weight = np.diff(1.5 * borders - 2.0 * borders**3)
    first = np.searchsorted(edges, time_s - 0.5 * window_s - 1e-7)
    return np.asarray(means[first[:, None] + np.arange(SLICES)] @ weight)


def used(station: Station, side: Side, soak: Soak, seed: int) -> list[Stretch]:
    """Record random torques and speeds at several temperatures, after a single zeroing."""
    devices, stretches = station.devices, list[Stretch]()
    module, range_nm = devices.module(side), station.description.module(side).range_nm
    probe = station.description.module(side).temperature_probe or ""
    generator = np.random.default_rng([seed, SIDES.index(side), 7])
    top, steepest = LARGEST_RPM[side], STEEPEST_RPM_PER_S[side]
    window_s = station.description.counter.window_s
    truth: Any = station.drivers.counter  # the simulated bench

    def stretch(zeroed_c: float) -> Plan:
        yield from bps.sleep(SETTLED_S)  # no window spans two temperatures
        yield from bps.abs_set(devices.recorder, "mark", wait=True)
        for _ in range(LEGS):
            speed = generator.uniform(-1, 1) * top * RAD_S_PER_RPM
            rate = generator.uniform(0.1, 1.0) * steepest * RAD_S_PER_RPM
            torque = generator.uniform(-1, 1) * range_nm
            yield from bps.abs_set(module.drive.speed, RampTo(speed, rate), group="leg")
            slope = generator.uniform(0.2, 1.0) * range_nm
            yield from bps.abs_set(module.drive.torque, RampTo(torque, slope), group="leg")
            yield from bps.wait("leg")
            yield from bps.sleep(generator.uniform(0.2, 1.5))
            before = yield from temperature_c(devices, probe)
            yield from bps.trigger(devices.recorder, wait=True)
            yield Msg("read", devices.recorder)  # starts the next stretch's recording
            found = devices.recorder.modules[side]
            true_nm = weighted_truth(partial(truth.true_means, side), found.time_s, window_s)
            known = Readings(
                found["reading_nm"],
                time_s=found.time_s,
                speed_rpm=found["speed_rpm"],
                angle_rad=found["angle_rad"],
                temperature_c=np.full(len(found), before),
                zero_temperature_c=zeroed_c,
            )
            stretches.append(Stretch(known, true_nm))

    def body() -> Plan:
        soak(25.0)
        yield from zero(devices, side, standard=True)
        zeroed_c = yield from temperature_c(devices, probe)
        for celsius in USED_C:
            soak(celsius)
            yield from stretch(zeroed_c)
        soak(USED_C[2], shafts_behind_k=BEHIND_K)
        yield from stretch(zeroed_c)
        yield from bps.abs_set(module.drive.torque, 0.0, wait=True)
        yield from bps.abs_set(module.drive.speed, 0.0, wait=True)

    def in_bench() -> Plan:
        yield from set_up(devices, Setup("calibration", side, "calibrator", "locked"))
        yield from bpp.run_wrapper(body())

    plan = bpp.finalize_wrapper(in_bench(), lambda: power_off(devices))
    record = station.run(plan, kind="turning-bench")
    if record.exit_status != "success":
        raise RuntimeError(record.reason)
    return stretches


def measure(task: tuple[int, Side]) -> Result:
    """Calibrate and fit a module's chain, and return its errors while the bench turns."""
    seed, side = task
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        with Station.open(bench_of(seed), folder / "data") as station:
            # Only the simulated counter has a twin; drivers in general have none.
            soak = station.drivers.counter.twin.soak  # type: ignore[attr-defined]
            chain = calibrated_chain(station, side, soak, folder)
            stretches = used(station, side, soak, seed)
            range_nm = station.description.module(side).range_nm
    return judged(seed, side, chain, stretches, range_nm)


def kept(into: Path | None, task: tuple[int, Side]) -> Result:
    """Return the result, read from its file if an interrupted run has already measured it."""
    if into is None:
        return measure(task)
    into.mkdir(parents=True, exist_ok=True)
    file = into / f"{task[0]}-{task[1]}.json"
    if not file.exists():
        file.write_text(json.dumps(asdict(measure(task))), encoding="utf-8")
    return Result(**json.loads(file.read_text(encoding="utf-8")))


def judged(
    seed: int, side: Side, chain: MeasuringChain, stretches: Sequence[Stretch], range_nm: float
) -> Result:
    """Return the errors of readings compensated as ``apply`` does."""
    stream, static = RecordedStream(chain), RecordedStream(MeasuringChain(chain.model))
    errors, raw, alone, expanded = [], [], [], []
    for number, each in enumerate(stretches):
        following = stretches[number + 1].readings if number + 1 < len(stretches) else None
        torque = stream.torque(each.readings, following)
        errors.append(torque.value_nm - each.true_nm)
        expanded.append(torque.expanded_uncertainty_nm)
        raw.append(each.readings.reading_nm - each.true_nm)
        alone.append(static.torque(each.readings, None).value_nm - each.true_nm)
    single, u = np.concatenate(errors), np.concatenate(expanded)
    error = np.concatenate([_means(each) for each in errors])
    percent = 100.0 / range_nm
    return Result(
        seed,
        side,
        percent * float(np.max(np.abs(error))),
        percent * float(np.sqrt(np.mean(error**2))),
        percent * float(np.max(np.abs(np.concatenate([_means(each) for each in raw])))),
        percent * float(np.nanmax(np.abs(np.concatenate([_means(each) for each in alone])))),
        percent * float(np.mean(u)),
        float(np.mean(np.abs(single) <= u)),
        percent * float(np.max(np.abs(single))),
        single.size,
    )


def _means(values: FloatArray) -> FloatArray:
    """Return means over `AVERAGED` windows each of one stretch."""
    count = values.size // AVERAGED
    return np.asarray(values[: count * AVERAGED].reshape(count, AVERAGED).mean(axis=1))


def module_rows(results: Sequence[Result]) -> tuple[list[str], list[list[str]]]:
    """Return headings and cells of the table by bench and module."""
    headings = ["bench", "raw worst % FS", "static only", "worst % FS", "RMS % FS",
                "10 ms: worst", "U % FS", "coverage"]  # fmt: skip
    rows = [
        [
            f"{each.seed}, {each.side}",
            f"{each.raw_worst:.2f}",
            f"{each.static_worst:.2f}",
            f"{each.worst:.3f}",
            f"{each.rms:.3f}",
            f"{each.window_worst:.3f}",
            f"{each.expanded:.3f}",
            f"{100 * each.coverage:.1f} %",
        ]
        for each in results
    ]
    return headings, rows


INTRODUCTION = """Simulated benches (preset nominal), both modules, by the files of the commands:
`calibrate` at 23 °C; `verification` at 12, 35 and 48 °C; `turn` against the turning calibrator;
empty runs at the four temperatures; `fit` with all of them. Then random torques and speeds over the
whole range, ramps up to 300 1/min per s (output 3.75), at five temperatures from 10 to 50 °C and
with shafts 3 K behind their transducers, all with one zero. A reading is the mean over 0.1 s; U and
coverage are of single windows of 10 ms. One scatter is common to each of the 30 torques of a module
and one zero to all, so single modules' coverage varies. "Static only" is without temperature,
rotation, inertia and ripple.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; return 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=SEEDS, help=f"benches (default {SEEDS})")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--sides", nargs="+", choices=SIDES, default=list(SIDES))
    parser.add_argument(
        "--into", type=Path, help="keep each result here, and go on with the others"
    )
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    parser.add_argument("--write", action="store_true", help=f"put the table into {BENCHMARKS}")
    options = parser.parse_args(arguments)
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    tasks = list(product(seeds, options.sides))
    if options.workers == 1:
        results = [kept(options.into, task) for task in tasks]
    else:
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(options.workers, mp_context=context) as pool:
            results = list(pool.map(partial(kept, options.into), tasks))
    console = Console()
    windows = sum(each.readings for each in results)
    title = f"{len(seeds)} benches, {windows} windows"
    parts = [INTRODUCTION, show(console, title, *module_rows(results))]
    figures = {"worst error of a reading, % FS": max(each.worst for each in results)}
    verdict, met = judge(console, "turning_bench", figures)
    held = sum(each.coverage * each.readings for each in results) / windows
    parts += [verdict, f"Coverage of all windows {100 * held:.1f} %, aim 93 to 97 %.\n"]
    console.print(parts[-1])
    if options.write:
        write_section(BENCHMARKS, "turning-bench", "\n".join(parts))
    return 0 if met else 1
