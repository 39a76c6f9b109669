"""Contradictions in calibration tables: false alarms, and detected injected faults.

    python -m benchmarks contradictions --seeds 20

Tables and faults are those of `tests.support.contradicting_tables`. Besides all faults, those are
counted separately of which at least 3 U remain after fitting zero, span, curvature and loop of each
direction, and drift: a smaller remainder can't be distinguished from a property of the chain by one
table.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from rich.console import Console
from tests.support.chains import FAMILIES
from tests.support.contradicting_tables import (
    FAULTS,
    LARGEST,
    POINTS,
    STRANGERS,
    Trial,
    chain_table,
    stranger,
    trial,
)

from benchmarks.reporting import judge
from torquebench.calibration import examine_table


def _tasks(seeds: int) -> Iterator[tuple[str, str, int, int]]:
    for seed in range(seeds):
        for family in FAMILIES:
            yield "chains, one loop", family, seed, POINTS[seed % len(POINTS)]
            yield "chains, two loops", family, seed, POINTS[0]
        for family in STRANGERS:
            yield "other laboratories", family, seed, 0


def _measured(task: tuple[str, str, int, int]) -> tuple[str, list[Trial]]:
    plan, family, seed, points = task
    loops = 2 if plan == "chains, two loops" else 1
    data = chain_table(family, seed, points, loops) if points else stranger(family, seed)
    healthy = examine_table(data)
    trials = (trial(data, healthy, family, fault, seed) for fault in ("", *FAULTS))
    return plan, [each for each in trials if each is not None]


def _shares(trials: Sequence[Trial]) -> str:
    """Return the shares of faults named, found at the right rows, and refused, as text."""
    values = {
        title: float(np.mean([getattr(each, name) for each in trials]))
        for title, name in (("named", "named"), ("right rows", "placed"), ("refused", "refused"))
    }
    return f"{len(trials):5}  " + "  ".join(f"{title} {v:.3f}" for title, v in values.items())


def main(arguments: Sequence[str] | None = None) -> int:
    """Print how many healthy tables are refused, and how many faults are detected."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed")
    parser.add_argument("--processes", type=int, default=2)
    settings = parser.parse_args(arguments)
    results: dict[str, list[Trial]] = {}
    tasks = [task for task in _tasks(settings.first + settings.seeds) if task[2] >= settings.first]
    with ProcessPoolExecutor(settings.processes) as pool:
        for plan, trials in pool.map(_measured, tasks, chunksize=4):
            results.setdefault(plan, []).extend(trials)
    wrong = 0
    for plan, mine in results.items():
        healthy = [each for each in mine if not each.fault]
        refused = [each.family for each in healthy if each.refused]
        wrong += len(refused)
        print(
            f"{plan}: {len(healthy)} healthy tables, {len(refused)} refused {refused or ''}, "
            f"{sum(each.named for each in healthy)} doubted, "
            f"{sum(each.rows_left_out for each in healthy)} rows left out"
        )
        for fault in FAULTS:
            for name, low, high in (
                ("3 to 30 U", 3, LARGEST),
                ("3 to 5 U", 3, 5),
                ("5 to 30 U", 5, LARGEST),
            ):
                of_size = [e for e in mine if e.fault == fault and low <= e.size < high]
                for which, least in (("all", 0.0), ("at least 3 U apparent", 3.0)):
                    chosen = [each for each in of_size if each.apparent >= least]
                    if chosen:
                        print(f"  {fault:15} {name:9} {which:22} {_shares(chosen)}")
    figures = {"healthy tables refused": float(wrong)}
    return int(not judge(Console(), "contradictions", figures)[1])


if __name__ == "__main__":
    sys.exit(main())
