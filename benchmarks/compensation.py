"""Accuracy, coverage and speed of compensation models, on chains with a known truth.

The default model of ``torquebench fit`` is compared with every kind of model of this package alone,
with other libraries, and with a bound: the best possible fit. ``--out`` writes all tables into a
Markdown file. ``--quick`` takes fewer chains and ends within a minute on two quiet cores; the whole
run takes some ten minutes.

Fits are timed on the first chains of every family. Slow contenders are fitted to the first two
chains of every family only (``--slow-chains``), with ``--quick`` to one chain of every third
family, at 50 points. With ``--quick``, a figure misses its aim if it lies outside the limits by
more than twice its standard error; in the whole run, if it lies outside at all.

Errors are over the whole range, both directions and both branches, against the noise-free truth.
The bound is the fit that is told the chain's exact form and every constant in it but the
amplitudes (`tests.support.chains.known_form`). Where the form can't be fitted because its terms and
the drift have nearly the same shape (`UNBOUND`), the bound is the best of all fitted forms.
Coverage is that of the curve, and that of single readings with new noise.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy starts its threads

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from tests.support.chain_shapes import FloatArray
from tests.support.chains import FAMILIES, REPORTED_SEED, make_chain

from benchmarks.compensation_contenders import Contender, contenders
from benchmarks.compensation_results import (
    Figures,
    Result,
    accuracy_figures,
    comparison_rows,
    family_rows,
    interval_figures,
    speed_figures,
)
from benchmarks.reporting import judge, show

TENTHS = 10
COVERAGE_95 = 1.959964
TIMED_CHAINS = 2  # of every family
FULL_CHAINS = 40
SLOW_CHAINS = 2
QUICK_CHAINS, QUICK_CHAINS_200 = 4, 2
QUICK_SLOW_CHAINS = 1
QUICK_SLOW_FAMILIES = 3  # every third
TOO_SLOW = "known form, constants unknown"  # seconds a fit: not in --quick


def measure(
    contender: Contender, family: str, seed: int, points: int, timed: bool = False
) -> Result:
    """Calibrate a chain, fit, and compare with the truth."""
    chain = make_chain(family, seed)
    data, dense = chain.calibration(points), chain.dense()
    begin = time.perf_counter()
    predict = contender.fit(chain, data)
    fitted = time.perf_counter()
    start = time.perf_counter()
    curve = predict(dense.X)
    predicted = time.perf_counter()
    error = curve.torque_nm - dense.torque_nm
    percent = 100.0 / chain.range_nm
    of_curve, of_readings, half_width = np.full(TENTHS, np.nan), np.full(TENTHS, np.nan), np.nan
    if curve.curve_std_nm is not None:
        share = dense.torque_nm / chain.range_nm
        tenth = np.minimum((TENTHS * (share + 1) / 2).astype(int), TENTHS - 1)
        of_curve = _covered(error, curve.curve_std_nm, tenth)
        single = predict(chain.noisy(dense))
        assert single.curve_std_nm is not None
        assert single.scatter_nm is not None
        std = np.hypot(single.curve_std_nm, single.scatter_nm)
        of_readings = _covered(single.torque_nm - dense.torque_nm, std, tenth)
        half_width = percent * COVERAGE_95 * float(np.mean(std))
    return Result(
        family,
        seed,
        percent * float(np.max(np.abs(error))),
        percent * float(np.sqrt(np.mean(error**2))),
        of_curve,
        of_readings,
        half_width,
        fitted - begin if timed else np.nan,
        (predicted - start) / dense.X.shape[0],
    )


def _covered(error: FloatArray, std: FloatArray, tenth: NDArray[np.int64]) -> FloatArray:
    """Return the share of 95 % intervals that contain the truth, by tenth of the range."""
    covered = np.abs(error) <= COVERAGE_95 * std
    return np.asarray(np.bincount(tenth, covered, TENTHS) / np.bincount(tenth, minlength=TENTHS))


@dataclass(frozen=True)
class Task:
    """One chain, and the contenders that are fitted to it."""

    family: str
    seed: int
    points: int
    names: tuple[str, ...]
    timed: bool


def run_task(task: Task) -> dict[str, Result]:
    """Fit all of a task's contenders one after the other, so that other load slows all alike."""
    field = {contender.name: contender for contender in contenders()}
    if task.timed:
        for name in task.names:  # compiles functions and fills the caches
            if not field[name].slow:
                measure(field[name], task.family, task.seed, task.points)
    return {
        name: measure(field[name], task.family, task.seed, task.points, task.timed)
        for name in task.names
    }


def compare(
    console: Console,
    field: Sequence[Contender],
    families: Sequence[str],
    seeds: range,
    points: int,
    *,
    slow_chains: int | None = None,
    slow_families: Sequence[str] | None = None,
    timed_chains: int = TIMED_CHAINS,
    workers: int = 1,
) -> dict[str, list[Result]]:
    """Fit every contender to all chains, slow ones to the first chains of each family."""
    results: dict[str, list[Result]] = {contender.name: [] for contender in field}
    tasks = [
        Task(
            family,
            seed,
            points,
            tuple(
                c.name
                for c in field
                if not c.slow
                or (
                    _is_early(seeds, seed, slow_chains)
                    and (slow_families is None or family in slow_families)
                )
            ),
            seed - seeds.start < timed_chains,
        )
        for family in families
        for seed in seeds
    ]
    with console.status(f"{points} points") as status:
        for done, outcome in enumerate(_outcomes(tasks, workers)):
            status.update(f"{points} points: {done + 1} of {len(tasks)} chains")
            for name, result in outcome.items():
                results[name].append(result)
    return results


def _timed(quick: bool, points: int) -> int:
    return int(points <= 50) if quick else TIMED_CHAINS


def _left_out(contender: Contender, points: int) -> bool:
    return contender.name == TOO_SLOW or (contender.slow and points > 50)


def _is_early(seeds: range, seed: int, count: int | None) -> bool:
    return count is None or seed - seeds.start < count


def _outcomes(tasks: Sequence[Task], workers: int) -> Iterator[dict[str, Result]]:
    if workers == 1:
        yield from map(run_task, tasks)
        return
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=context) as pool:
        yield from pool.map(run_task, tasks)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="end within a minute")
    parser.add_argument("--chains", type=int, help="of every family (default 40, quick fewer)")
    few = "chains of every family for slow contenders (default 2)"
    parser.add_argument("--slow-chains", type=int, default=SLOW_CHAINS, help=few)
    parser.add_argument("--out", type=Path, help="write all tables as Markdown")
    parser.add_argument("--families", nargs="+", choices=sorted(FAMILIES), default=list(FAMILIES))
    parser.add_argument("--points", nargs="+", type=int, default=[50, 200])
    parser.add_argument(
        "--first-seed",
        type=int,
        default=REPORTED_SEED,
        help="default: the first of the seeds that nothing else uses",
    )
    parser.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    return parser.parse_args(arguments)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; return 1 where an aim is missed."""
    options = parse(arguments)
    console = Console()
    everyone = contenders()
    figures: Figures = {}
    parts = [INTRODUCTION]
    outcomes = {}
    for points in options.points:
        few = QUICK_CHAINS if points <= 50 else QUICK_CHAINS_200
        count = options.chains or (few if options.quick else FULL_CHAINS)
        field = [c for c in everyone if not (options.quick and _left_out(c, points))]
        results = compare(
            console,
            field,
            options.families,
            range(options.first_seed, options.first_seed + count),
            points,
            slow_chains=QUICK_SLOW_CHAINS if options.quick else options.slow_chains,
            slow_families=options.families[:: QUICK_SLOW_FAMILIES if options.quick else 1],
            timed_chains=_timed(options.quick, points),
            workers=options.workers,
        )
        title = f"{points} points, median of {len(results['hybrid'])} chains"
        parts.append(show(console, title, *comparison_rows(results)))
        own = [contender.name for contender in field if contender.own]
        figures |= interval_figures(results, own, points, 2.0 if options.quick else 0.0)
        if points == min(options.points):
            figures |= speed_figures(results)
        outcomes[points] = results
        errors_allowed = 2.0 if options.quick else 0.0
        figures |= accuracy_figures(results, options.families, points, errors_allowed)
    parts.append(show(console, "Default by family", *family_rows(outcomes, options.families)))
    values = {name: value for name, (value, _) in figures.items()}
    allowed = {name: allowance for name, (_, allowance) in figures.items()}
    verdict, met = judge(console, "compensation", values, allowed)
    parts.append(verdict)
    if options.out:
        options.out.write_text("\n".join(parts), encoding="utf-8")
    return 0 if met else 1


INTRODUCTION = """\
Synthetic chains with a known truth (`tests/support/chains.py`), independent of the simulated bench.
The models were developed on the other families; the results of those marked "not developed on"
changed nothing in the models' values and nothing in the hybrid's intervals. All seeds are new to
the models. Noise 0.02 % FS of every reading, the given number of points on 0 → +FS → 0 → −FS → 0.
Errors over the whole range, both directions and both branches, against the noise-free truth. The
bound ("known form") is a fit that is told the chain's exact form and all constants but the
amplitudes; for *misspecified*, whose form is nearly its drift, it is the best of all fitted forms.
Times depend on the machine; compare them with each other.
"""


if __name__ == "__main__":
    sys.exit(main())
