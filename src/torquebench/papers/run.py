"""Compute the page's results from benches or recorded folders."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

from torquebench.bench.description import BenchDescription
from torquebench.papers.factors import Measurement, factor_errors
from torquebench.papers.models import RECOMMENDED_NAME, fit_module
from torquebench.papers.page import BenchResult
from torquebench.papers.study import CHAINS, FAMILIES, Study, contenders, study_tasks
from torquebench.papers.tables import BenchTables
from torquebench.processes import end_with_parent
from torquebench.progress import NO_PROGRESS, Progress

WORKERS = 2


def seeded(description: BenchDescription, seed: int) -> BenchDescription:
    """Return a simulated bench's description with another seed."""
    driver = {**description.driver, "seed": seed}
    return description.model_copy(update={"driver": driver})


def results_of(
    tables: Sequence[BenchTables], progress: Progress = NO_PROGRESS
) -> list[BenchResult]:
    """Fit all models to all modules of all benches."""
    progress.start("Fitting the models", sum(len(each.modules) for each in tables))
    results: list[BenchResult] = []
    done = 0
    for bench in tables:
        modules = {}
        for side, module in bench.modules.items():
            modules[side] = fit_module(module, trials=not results)
            done += 1
            progress.reach(done, side)
        results.append(BenchResult(bench, modules))
    progress.finish()
    return results


@contextlib.contextmanager
def workers() -> Iterator[Executor]:
    """Open processes that compute during a measurement, at lower priority."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(
        min(WORKERS, os.cpu_count() or 1), mp_context=context, initializer=_begin
    )
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    end_with_parent()
    if hasattr(os, "nice"):
        os.nice(5)


def page_study(pool: Executor, file: Path | None, *, quick: bool = False) -> tuple[Study, int]:
    """Start the page's part of the study; return it and the number of chains per family.

    It covers all families with the papers' 50 rising points, and one family also loaded up and
    down, with 50 and with 200 points.
    """
    seeds = range(2) if quick else range(CHAINS)
    wanted = contenders((2_000,), (1.0,)) if quick else contenders((10_000, 50_000), (1.0, 0.5))
    tasks = study_tasks(
        seeds,
        ("50 rising", FAMILIES),
        ("50 up and down", ("reversing",)),
        ("200 up and down", ("reversing",)),
    )
    return Study(tasks, wanted, pool, file), len(seeds)


def with_factors(results: list[BenchResult], measured: Iterable[dict[str, Measurement]]) -> None:
    """Add the errors at all temperatures and speeds and with all lubricants to the first bench."""
    first = results[0]
    every = {name: found for each in measured for name, found in each.items()}
    errors = factor_errors(
        {side: each.tables.calibration for side, each in first.modules.items()},
        {side: each.models[RECOMMENDED_NAME].model for side, each in first.modules.items()},
        every,
    )
    results[0] = replace(first, tables=replace(first.tables, factors=errors))
