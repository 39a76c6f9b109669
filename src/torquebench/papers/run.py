"""From benches or recorded folders to the page."""

from __future__ import annotations

import os
from collections.abc import Sequence

from torquebench.bench.description import BenchDescription
from torquebench.papers.models import fit_module
from torquebench.papers.page import BenchResult
from torquebench.papers.study import CHAINS, FAMILIES, Row, Series, contenders, run_study
from torquebench.papers.tables import BenchTables
from torquebench.progress import NO_PROGRESS, Part, Progress

__all__ = ["page_study", "results_of", "seeded"]

STUDY_WORKERS = 2


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


def page_study(progress: Progress = NO_PROGRESS, *, quick: bool = False) -> tuple[list[Row], int]:
    """Run the part of the study that the page shows; returns rows, and chains of each family.

    All families with the papers' 50 rising points, and one family loaded up and down as well, with
    50 points and with 200.
    """
    seeds: Sequence[int] = range(2) if quick else range(CHAINS)
    wanted = contenders((2_000,), (1.0,)) if quick else contenders((10_000, 50_000), (1.0, 0.5))
    parts: list[tuple[Sequence[str], Series]] = [
        (tuple(FAMILIES), "50 rising"),
        (("reversing",), "50 up and down"),
        (("reversing",), "200 up and down"),
    ]
    total = len(seeds) * sum(len(families) for families, _ in parts)
    progress.start("Studying when BP beats the polynomial", total)
    rows: list[Row] = []
    workers = 1 if quick else min(STUDY_WORKERS, os.cpu_count() or 1)
    done = 0
    for families, series in parts:
        part = Part(progress, done)
        rows += run_study(seeds, families, (series,), wanted, part, workers=workers)
        done += len(seeds) * len(families)
    progress.finish()
    return rows, len(seeds)
