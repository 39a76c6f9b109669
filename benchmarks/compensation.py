"""Accuracy, honesty and speed of compensation models, on chains with a known truth.

``python -m benchmarks.compensation`` compares every kind of model of this package with other
libraries and with the best that could be done, prints the tables, and exits with 1 where an aim is
missed. ``--write`` puts the tables into ``docs/benchmarks.md`` between the section's markers.
``--quick`` takes fewer chains and ends within a minute on two quiet cores; the whole run takes some
ten minutes. Chains are shared out between two processes (``--workers``).

Models of this package share the posterior that their uncertainty is judged by; times of fits are
taken without that, on the first chains of every family. Slow contenders meet the first two chains
of every family (``--slow-chains``); in ``--quick`` one chain of every third family, at 50 points
only, and a figure from so few chains counts as missed
where it lies beyond its limits by more than twice its own standard error; the whole run allows
nothing.

Errors are over the whole range, both directions and both branches, against the noise-free truth.
The bound is the fit that is told the chain's exact form and every constant in it but the
amplitudes (`benchmarks.chains.known_form`).
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
from rich.console import Console
from rich.table import Table

from benchmarks.chain_shapes import FloatArray
from benchmarks.chains import (
    FAMILIES,
    REPORTED_SEED,
    UNSEEN_FAMILIES,
    make_chain,
)
from benchmarks.compensation_contenders import Contender, contenders
from benchmarks.section import BENCHMARKS as DOCUMENT
from benchmarks.section import write_section as write_between_markers
from torquebench.compensation.judging import forget_posteriors

BEGIN, END = "<!-- compensation: begin -->", "<!-- compensation: end -->"
TENTHS = 10
COVERAGE_95 = 1.959964
TIMED_CHAINS = 2  # of every family
FULL_CHAINS = 40
SLOW_CHAINS = 2
QUICK_CHAINS, QUICK_CHAINS_200 = 4, 2
QUICK_SLOW_CHAINS = 1
QUICK_SLOW_FAMILIES = 3  # every third
TOO_SLOW = "known form, constants unknown"  # seconds a fit: not in --quick


@dataclass(frozen=True)
class Result:
    """One contender on one calibration of one chain.

    Attributes
    ----------
    family : str
    seed : int
    worst, rms : float
        Error in % of full scale.
    inside : float64 array of shape (10,)
        Share of dense readings whose 95 % interval holds the truth, by tenth of the range; NaN
        where the contender gives no uncertainty.
    half_width : float
        Mean half-width of the 95 % intervals in % of full scale.
    fit_seconds, predict_seconds : float
        Time of the fit (NaN where it wasn't taken), and of one reading in a prediction of many.
    """

    family: str
    seed: int
    worst: float
    rms: float
    inside: FloatArray
    half_width: float
    fit_seconds: float
    predict_seconds: float


@dataclass(frozen=True)
class Aim:
    """A figure with the interval that it must lie in, and what may be missing by chance."""

    name: str
    value: float
    low: float
    high: float
    allowance: float = 0.0

    @property
    def met(self) -> bool:
        """Whether the figure lies in its interval."""
        return self.low - self.allowance <= self.value <= self.high + self.allowance


def measure(
    contender: Contender, family: str, seed: int, points: int, timed: bool = False
) -> Result:
    """Calibrate a chain, fit, and compare with the truth."""
    chain = make_chain(family, seed)
    data, dense = chain.calibration(points), chain.dense()
    if timed:
        forget_posteriors()
    begin = time.perf_counter()
    predict = contender.fit(chain, data)
    fitted = time.perf_counter()
    start = time.perf_counter()
    torque, std = predict(dense.X)
    predicted = time.perf_counter()
    error = torque - dense.torque_nm
    percent = 100.0 / chain.range_nm
    inside, half_width = np.full(TENTHS, np.nan), np.nan
    if std is not None:
        tenth = np.minimum(
            (TENTHS * (dense.torque_nm / chain.range_nm + 1) / 2).astype(int), TENTHS - 1
        )
        covered = np.abs(error) <= COVERAGE_95 * std
        inside = np.bincount(tenth, covered, TENTHS) / np.bincount(tenth, minlength=TENTHS)
        half_width = percent * COVERAGE_95 * float(np.mean(std))
    return Result(
        family,
        seed,
        percent * float(np.max(np.abs(error))),
        percent * float(np.sqrt(np.mean(error**2))),
        inside,
        half_width,
        fitted - begin if timed else np.nan,
        (predicted - start) / dense.X.shape[0],
    )


@dataclass(frozen=True)
class Task:
    """One chain, and who meets it."""

    family: str
    seed: int
    points: int
    names: tuple[str, ...]
    timed: bool


def run_task(task: Task) -> dict[str, Result]:
    """Let everyone take part on one chain, taking turns, so that a busy machine slows all."""
    field = {contender.name: contender for contender in contenders()}
    if task.timed:
        for name in task.names:  # compiles what needs compiling, and warms up the caches
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
    """Let everyone take part on every chain; slow contenders on the first ones of every family."""
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


def ratios(results: dict[str, list[Result]], name: str, families: Sequence[str]) -> FloatArray:
    """Return RMS error over the bound's, chain by chain."""
    bounds = {(bound.family, bound.seed): bound.rms for bound in results["known form"]}
    return np.array(
        [own.rms / bounds[own.family, own.seed] for own in results[name] if own.family in families]
    )


def coverage(results: Sequence[Result]) -> FloatArray:
    """Return the coverage by tenth of the range, over all chains."""
    return np.asarray(np.mean([result.inside for result in results], axis=0))


def comparison_rows(results: dict[str, list[Result]]) -> tuple[list[str], list[list[str]]]:
    """Return headings and cells of the comparison."""
    headings = [
        "model",
        "worst, % FS",
        "RMS, % FS",
        "RMS / bound",
        "95 % intervals hold",
        "by tenth",
        "± % FS",
        "fit, ms",
        "a reading, µs",
        "chains",
    ]
    rows = []
    families = sorted({result.family for result in results["known form"]})
    for name, own in results.items():
        inside = coverage(own)
        given = bool(np.all(np.isfinite(inside)))
        rows.append(
            [
                name,
                f"{np.median([r.worst for r in own]):.4f}",
                f"{np.median([r.rms for r in own]):.4f}",
                f"{np.median(ratios(results, name, families)):.2f}",
                f"{100 * inside.mean():.1f} %" if given else "–",
                f"{100 * inside.min():.0f}–{100 * inside.max():.0f} %" if given else "–",
                f"{np.median([r.half_width for r in own]):.4f}" if given else "–",
                _milliseconds([r.fit_seconds for r in own]),
                f"{1e6 * np.median([r.predict_seconds for r in own]):.2f}",
                str(len(own)),
            ]
        )
    return headings, rows


def _milliseconds(seconds: list[float]) -> str:
    taken = [value for value in seconds if np.isfinite(value)]
    return f"{1e3 * np.median(taken):.1f}" if taken else "–"


def family_rows(
    outcomes: dict[int, dict[str, list[Result]]], families: Sequence[str]
) -> tuple[list[str], list[list[str]]]:
    """Return headings and cells of the hybrid by family."""
    headings = ["family"]
    for points in outcomes:
        headings += [f"RMS / bound, {points} points", "worst / bound", "95 % intervals hold"]
    groups = {f + (" (not developed on)" if f in UNSEEN_FAMILIES else ""): [f] for f in families}
    unseen = [family for family in families if family in UNSEEN_FAMILIES]
    if unseen:
        groups["all families developed on"] = [f for f in families if f not in unseen]
        groups["all families not developed on"] = unseen
    rows = []
    for title, members in groups.items():
        row = [title]
        for results in outcomes.values():
            own = [r for r in results["hybrid"] if r.family in members]
            bound = [r for r in results["known form"] if r.family in members]
            worst = [a.worst / b.worst for a, b in zip(own, bound, strict=True)]
            row += [
                f"{np.median(ratios(results, 'hybrid', members)):.2f}",
                f"{np.median(worst):.2f}",
                f"{100 * coverage(own).mean():.1f} %",
            ]
        rows.append(row)
    return headings, rows


def accuracy_aims(
    results: dict[str, list[Result]],
    families: Sequence[str],
    points: int,
    errors_allowed: float = 0.0,
) -> list[Aim]:
    """Return the aims for the hybrid's errors; medians may miss by `errors_allowed` errors."""
    limit = 1.35 if points <= 50 else 1.5
    groups = {
        "RMS / bound": (families, limit),
        "RMS / bound on families not developed on": (UNSEEN_FAMILIES, limit),
        "RMS / bound on plain quadratics": (("quadratic",), 1.3),
    }
    aims = []
    for title, (members, highest) in groups.items():
        found = ratios(results, "hybrid", [f for f in families if f in members])
        if found.size:
            allowance = errors_allowed * _median_error(found)
            name = f"hybrid, {title}, {points} points"
            aims.append(Aim(name, float(np.median(found)), 0.0, highest, allowance))
    return aims


def _median_error(values: FloatArray) -> float:
    """Return a median's standard error, from the median absolute deviation."""
    spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
    return 1.2533 * spread / float(np.sqrt(values.size))


EXTREME_OF_TEN = 1.4
"""Two standard errors of one tenth are 2.8 of the one that is off most: 95 % of the extremes."""


def interval_aims(
    results: dict[str, list[Result]], own: Sequence[str], points: int, errors_allowed: float = 0.0
) -> list[Aim]:
    """Return the aims for the intervals of every model offered, over all and by tenth.

    ``errors_allowed`` standard errors over the chains may be missing by chance.
    """
    aims = []
    own = [name for name in own if results[name]]
    for name in own:
        rows = np.array([result.inside for result in results[name]])
        tenths = rows.mean(axis=0)
        extreme = EXTREME_OF_TEN * np.sqrt(np.mean(np.var(rows, axis=0)) / len(rows))
        spread = float(np.std(rows.mean(axis=1)))
        for what, value, its_error in (
            ("coverage", tenths.mean(), spread / np.sqrt(len(rows))),
            ("least coverage of a tenth", tenths.min(), extreme),
            ("largest coverage of a tenth", tenths.max(), extreme),
        ):
            allowance = errors_allowed * float(its_error)
            title = f"{name}, {what}, {points} points"
            aims.append(Aim(title, float(value), 0.93, 0.97, allowance))
        new = [r.inside.mean() for r in results[name] if r.family in UNSEEN_FAMILIES]
        if new:
            allowance = errors_allowed * spread / np.sqrt(len(new))
            title = f"{name}, coverage, families not developed on, {points} points"
            aims.append(Aim(title, float(np.mean(new)), 0.93, 0.97, allowance))
    widths = {name: np.median([r.half_width for r in results[name]]) for name in own}
    honest = [
        widths[name] for name in own if name != "hybrid" and coverage(results[name]).mean() >= 0.93
    ]
    shortest = float(widths["hybrid"] / min(honest, default=np.inf))
    aims.append(
        Aim(f"hybrid's intervals / shortest honest other's, {points} points", shortest, 0.0, 1.0)
    )
    return aims


def speed_aims(results: dict[str, list[Result]]) -> list[Aim]:
    """Return the aims for the time of fits to 50 points, against scikit-learn's network."""
    seconds = {
        name: float(np.nanmedian([r.fit_seconds for r in results[name]]))
        for name in ("hybrid", "bayesian-network", "scikit-learn MLPRegressor")
        if name in results
    }
    reference = seconds["scikit-learn MLPRegressor"]
    return [
        Aim("hybrid's fit / scikit-learn network's", seconds["hybrid"] / reference, 0.0, 1 / 3),
        Aim(
            "bayesian-network's fit / scikit-learn network's",
            seconds["bayesian-network"] / reference,
            0.0,
            2.0,
        ),
    ]


def show(
    console: Console, title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]
) -> str:
    """Print a table and return it as Markdown."""
    table = Table(title=title)
    for position, heading in enumerate(headings):
        table.add_column(heading, justify="right" if position else "left")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    lines = [f"**{title}**", "", f"| {' | '.join(headings)} |", "| --- " * len(headings) + "|"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join(lines) + "\n"


def write_section(document: Path, text: str) -> None:
    """Replace what stands between the markers; begin the document or the section if need be."""
    write_between_markers(document, "compensation", text)


def parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="end within a minute")
    parser.add_argument("--chains", type=int, help="of every family (default 40, quick fewer)")
    few = "chains of every family for slow contenders (default 2)"
    parser.add_argument("--slow-chains", type=int, default=SLOW_CHAINS, help=few)
    parser.add_argument("--write", action="store_true", help=f"put the tables into {DOCUMENT.name}")
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
    aims: list[Aim] = []
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
        aims += interval_aims(results, own, points, 2.0 if options.quick else 0.0)
        if points == min(options.points):
            aims += speed_aims(results)
        outcomes[points] = results
        allowed = 2.0 if options.quick else 0.0
        aims += accuracy_aims(results, options.families, points, allowed)
    parts.append(show(console, "Hybrid by family", *family_rows(outcomes, options.families)))
    cells = [
        [
            aim.name,
            f"{aim.value:.3f}",
            f"{aim.low:g} to {aim.high:.3g}",
            "met" if aim.met else "MISSED",
        ]
        for aim in aims
    ]
    parts.append(show(console, "Aims", ["", "measured", "aim", ""], cells))
    if options.write:
        write_section(DOCUMENT, "\n".join(parts))
    return 0 if all(aim.met for aim in aims) else 1


INTRODUCTION = """Synthetic chains with a known truth (`benchmarks/chains.py`), independent of the
simulated bench. The models were developed on the other families; those marked "not developed on"
were written down when the models were finished, and nothing was changed after their results. All
seeds are new to the models. Noise 0.02 % FS of every reading, the given number of points on 0 →
+FS → 0 → −FS → 0. Errors over the whole range, both directions and both branches, against the
noise-free truth. The bound ("known form") is a fit that is told the chain's exact form and all
constants but the amplitudes. Times depend on the machine; compare them with each other.
"""


if __name__ == "__main__":
    sys.exit(main())
