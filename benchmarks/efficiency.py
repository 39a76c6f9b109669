"""Uncertainty of a reducer's efficiency on the simulated bench, and the coverage of its intervals.

Both modules of nominal benches are calibrated against the calibrator, as ``calibrate both`` does;
then the efficiency of a specimen is tested, as ``test efficiency`` does: warmed up, in both
directions, with at least three repeats, less an empty run. U (k = 2) of each efficiency is compared
with the aims, and the error with the true efficiency of the twin.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy starts its threads

import numpy as np
from rich.console import Console

from benchmarks.reducers import calibrated, described, truths
from benchmarks.reporting import AIMS, BENCHMARKS, show, write_section
from torquebench.bench.drivers.simulated.driver import SimulatedOptions
from torquebench.bench.roles import SIDES
from torquebench.calibration import load_profile
from torquebench.campaign.reducers.settings import ReducerTestSettings
from torquebench.campaign.reducers.tests import run_reducer_test
from torquebench.procedures.reducers.running import EfficiencySettings
from torquebench.reducers import load_reducer
from torquebench.station import Station

BENCHES = 24
QUICK = 2
SHARES = (0.2, 0.3, 0.5, 0.75, 1.0)
SPEEDS_RPM = (300.0, 900.0)
HALF = 0.5
_AIMS = AIMS["efficiency"]
LOW = _AIMS["U below half the rated torque, %"].high
HIGH = _AIMS["U from half the rated torque on, %"].high
COVERAGE = (100.0 * _AIMS["coverage"].low, 100.0 * _AIMS["coverage"].high)
SHOWN = 0.0005
"""Smallest contribution that the table lists, % of the efficiency."""
PROFILES = {"standard": "rapid-in-situ", "rv-40e": "small-torques"}
"""Calibration profile of both modules for each reducer, chosen for the torques of its tests."""


@dataclass(frozen=True)
class Point:
    """One efficiency of one bench.

    Parameters
    ----------
    seed : int
    share : float
        Torque as a share of the rated torque.
    both : bool
        Whether it is the mean of both directions.
    found, truth, expanded : float
        Measured and true efficiency, and U (k = 2), in %.
    parts : mapping of str to float
        Contributions to u, in % of the efficiency.
    """

    seed: int
    share: float
    both: bool
    found: float
    truth: float
    expanded: float
    parts: dict[str, float]

    @property
    def error(self) -> float:
        """Error in % of the efficiency."""
        return 100.0 * (self.found - self.truth) / self.truth

    @property
    def relative(self) -> float:
        """U in % of the efficiency."""
        return 100.0 * self.expanded / self.found

    @property
    def aim(self) -> float:
        """Largest U allowed, % of the efficiency."""
        return HIGH if self.share >= HALF else LOW


def one_bench(reducer: str, folder: Path | None, seed: int) -> list[Point]:
    """Calibrate a bench, test the efficiency of its specimen, and return every efficiency."""
    kept = None if folder is None else folder / f"{reducer}-{seed}.json"
    if kept is not None and kept.exists():
        return [Point(**each) for each in json.loads(kept.read_text())]
    kind, profile = load_reducer(reducer), load_profile(PROFILES[reducer])
    described_bench = described(reducer, seed, 1000 * seed)
    constants = SimulatedOptions(**described_bench.driver).parameters().reducer
    plan = EfficiencySettings(torque_shares=SHARES, speeds_rpm=SPEEDS_RPM)
    settings = ReducerTestSettings().with_plans({"efficiency": plan})
    with (
        tempfile.TemporaryDirectory() as data,
        Station.open(described_bench, Path(data)) as station,
    ):
        for side in SIDES:
            calibrated(station, side, profile)
        record = run_reducer_test(station, "efficiency", kind, settings, serial=str(seed))
    (outcome,) = record.outcomes
    known = truths(constants, kind, outcome)
    points = [
        Point(
            seed,
            round(each.nominal_torque_nm / kind.rated_torque_nm, 6),
            each.both,
            each.efficiency.value,
            known[each.quantity.key],
            each.efficiency.expanded_uncertainty(),
            {
                line.name: 100.0 * line.contribution / each.efficiency.value
                for line in each.efficiency.lines
            },
        )
        for each in (*outcome.result.means, *outcome.result.points)
    ]
    if kept is not None:
        part = kept.with_suffix(".part")
        part.write_text(json.dumps([asdict(each) for each in points]))
        part.replace(kept)
    return points


def coverage(points: Sequence[Point]) -> float:
    """Return the share of the intervals that contain the truth, %."""
    return 100.0 * float(np.mean([abs(each.error) <= each.relative for each in points]))


def rows_of(points: Sequence[Point]) -> list[tuple[str, ...]]:
    """Return a row for each torque, for single directions and for the mean of both."""
    rows: list[tuple[str, ...]] = []
    for both in (True, False):
        for share in sorted({each.share for each in points}):
            here = [each for each in points if each.share == share and each.both == both]
            u = [each.relative for each in here]
            error = np.abs([each.error for each in here])
            rows.append(
                (
                    f"{100 * share:.0f} %" + (", mean of both directions" if both else ""),
                    f"{len(here)}",
                    f"{np.median(u):.3f}, {max(u):.3f} %",
                    f"{here[0].aim:.2f} %",
                    f"{np.median(error):.3f}, {np.quantile(error, 0.95):.3f}, {error.max():.3f} %",
                    f"{coverage(here):.0f} %",
                )
            )
    return rows


HEADINGS = (
    "torque, of rated",
    "values",
    "U: median, largest",
    "aim",
    "error: median, 95 %, worst",
    "coverage",
)


def budget_of(points: Sequence[Point]) -> list[tuple[str, ...]]:
    """Return the contributions to u of the mean of both directions, smallest and largest torque."""
    both = [each for each in points if each.both]
    ends = (min(SHARES), HALF, max(SHARES))
    sizes = {
        name: [
            float(np.median([each.parts.get(name, 0.0) for each in both if each.share == share]))
            for share in ends
        ]
        for name in dict.fromkeys(name for each in both for name in each.parts)
    }
    ordered = sorted(sizes.items(), key=lambda each: -each[1][0])
    return [
        (name, *(f"{value:.3f} %" for value in found))
        for name, found in ordered
        if max(found) >= SHOWN
    ]


def missed(points: Sequence[Point]) -> list[str]:
    """Return a sentence for each aim that the means of both directions miss."""
    said = []
    for low, high, largest in ((0.0, HALF, LOW), (HALF, 2.0, HIGH)):
        worst = max(each.relative for each in points if each.both and low <= each.share < high)
        if worst > largest:
            said.append(f"U up to {worst:.3f} % of the efficiency, allowed {largest:g} %")
    return said


def report(console: Console, reducer: str, points: Sequence[Point]) -> tuple[list[str], bool]:
    """Print the tables of one reducer; return them as Markdown, and whether all aims are met."""
    kind, benches = load_reducer(reducer), len({each.seed for each in points})
    title = f"{kind.name}, {kind.rated_torque_nm:g} N·m: {benches} benches, simulated"
    found = coverage(points)
    late = missed(points)
    # Efficiencies of one bench share its errors: with few benches the coverage may leave the band
    # by chance.
    slack = 200.0 * float(np.sqrt(0.95 * 0.05 / benches))
    if not COVERAGE[0] - slack <= found <= COVERAGE[1] + slack:
        late.append(f"coverage {found:.1f} %")
    verdict = "Aims met." if not late else f"MISSED: {'; '.join(late)}."
    if not late and not COVERAGE[0] <= found <= COVERAGE[1]:
        verdict = f"Aims of U met; {benches} benches don't decide whether the coverage is kept."
    ends = [f"{100 * share:.0f} %" for share in (min(SHARES), HALF, max(SHARES))]
    parts = [
        show(console, title, HEADINGS, rows_of(points)),
        show(
            console,
            "contributions to u, mean of both directions, % of the efficiency, medians",
            ("contribution", *ends),
            budget_of(points),
        ),
        f"All values together: coverage {found:.1f} %. {verdict}\n",
    ]
    console.print(parts[-1])
    return parts, not late


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and report; 1 where an aim is missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help=f"{QUICK} benches")
    parser.add_argument("--benches", type=int, default=BENCHES, help=f"default {BENCHES}")
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--reducer", choices=PROFILES, default="standard")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--into", type=Path, help="folder to keep benches in, and to go on from")
    parser.add_argument("--write", action="store_true", help=f"put the tables into {BENCHMARKS}")
    options = parser.parse_args(arguments)
    if options.into is not None:
        options.into.mkdir(parents=True, exist_ok=True)
    count = QUICK if options.quick else options.benches
    seeds = range(options.first_seed, options.first_seed + count)
    measure: Callable[[int], list[Point]] = partial(one_bench, options.reducer, options.into)
    with ProcessPoolExecutor(options.workers, get_context("spawn")) as pool:
        points = [point for found in pool.map(measure, seeds) for point in found]
    parts, met = report(Console(), options.reducer, points)
    if options.write:
        write_section(BENCHMARKS, f"efficiency-{options.reducer}", "\n".join(parts))
    return 0 if met else 1
