"""Aims of all benchmarks, and functions that print verdicts and tables and write the page."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

__all__ = ["AIMS", "BENCHMARKS", "Aim", "aim", "judge", "least_seconds", "show", "write_section"]

BENCHMARKS = Path(__file__).resolve().parents[1] / "docs" / "benchmarks.md"


@dataclass(frozen=True)
class Aim:
    """Limits of a figure: at least `low`, at most `high`."""

    low: float = -np.inf
    high: float = np.inf

    def met(self, value: float, allowed: float = 0.0) -> bool:
        """Return whether a value lies between the limits, which it may miss by `allowed`."""
        return self.low - allowed <= value <= self.high + allowed

    @property
    def largest_chance(self) -> float:
        """Largest allowance for chance with which a figure can be judged."""
        if np.isfinite(self.low) and np.isfinite(self.high):
            return 0.5 * (self.high - self.low)
        return 0.1 * abs(self.high if np.isinf(self.low) else self.low)

    def __str__(self) -> str:
        if np.isinf(self.low):
            return f"≤ {self.high:.3g}"
        return f"≥ {self.low:.3g}" if np.isinf(self.high) else f"{self.low:g} to {self.high:g}"


COVERAGE = Aim(0.93, 0.97)
"""Aim for the coverage of 95 % intervals."""

AIMS: Mapping[str, Mapping[str, Aim]] = {
    "compensation": {
        "RMS / bound, all families, 50 points": Aim(high=1.35),
        "RMS / bound, all families, 200 points": Aim(high=1.5),
        "RMS / bound, families not developed on, 50 points": Aim(high=1.35),
        "RMS / bound, families not developed on, 200 points": Aim(high=1.5),
        "RMS / bound, quadratic, 50 points": Aim(high=1.1),
        "RMS / bound, quadratic, 200 points": Aim(high=1.3),
        "RMS / bound, plain, 50 points": Aim(high=1.1),
        "RMS / bound, plain, 200 points": Aim(high=1.3),
        "RMS / bound, realistic, 50 points": Aim(high=1.25),
        "RMS / bound, realistic, 200 points": Aim(high=1.4),
        "RMS / bound, hard, 50 points": Aim(high=1.4),
        "RMS / bound, hard, 200 points": Aim(high=1.45),
        "RMS / bound, misspecified, 50 points": Aim(high=1.65),
        "RMS / bound, misspecified, 200 points": Aim(high=1.65),
        "default / best other kind": Aim(high=1.05),
        "coverage": COVERAGE,
        "coverage of readings": COVERAGE,
        "default's intervals / shortest calibrated other's": Aim(high=1.0),
        "hybrid's fit / scikit-learn network's": Aim(high=1.0 / 3.0),
        "bayesian-network's fit / scikit-learn network's": Aim(high=2.0),
    },
    "contradictions": {"healthy tables refused": Aim(high=0)},
    "design": {"points that do what 200 even ones do": Aim(high=199)},
    "evaluations": {"coverage": Aim(low=0.90)},
    "rotating": {
        "RMS / known form, smooth": Aim(high=2.0),
        "RMS / known form, power-law drag": Aim(high=2.0),
        "RMS / known form, load and span": Aim(high=2.0),
        "RMS / known form": Aim(high=3.0),
        "worst error, median chain, % FS": Aim(high=0.05),
        "coverage": COVERAGE,
    },
    "turning_bench": {"worst error of a reading, % FS": Aim(high=0.1)},
    "reducers": {
        "stiffness, %": Aim(high=1.0),
        "backlash, arcmin beyond U": Aim(high=0.02),
        "lost_motion, arcmin beyond U": Aim(high=0.02),
        "transmission_error, arcsec": Aim(high=1.0),
        "no_load, %": Aim(high=1.0),
        "efficiency, percentage points": Aim(high=0.3),
    },
    "efficiency": {
        "U below half the rated torque, %": Aim(high=0.30),
        "U from half the rated torque on, %": Aim(high=0.15),
        "coverage": COVERAGE,
    },
    "safety": {"zero command, 99 %, ms": Aim(high=20.0)},
    "signals": {
        "a day of four channels on two cores, s": Aim(high=60.0),
        "noise, of theory": Aim(high=1.05),
    },
    "live_path": {"block of 10 ms, 99 %, ms": Aim(high=2.0)},
    "table": {
        "table / network in NumPy, speed": Aim(low=100.0),
        "table.at / numpy.interp, time": Aim(high=0.5),
    },
    "apply": {
        "csv, wall time / PyArrow's": Aim(high=3.0),
        "parquet, wall time / PyArrow's": Aim(high=2.0),
        "memory, MB": Aim(high=500.0),
    },
    "dynamics": {
        "PyDynamic / filter, time": Aim(low=10.0),
        "bandwidth, filtered / raw": Aim(low=3.0),
        "overshoot, filtered": Aim(high=0.05),
    },
    "panel_browser": {
        "painted updates a second, eight lines": Aim(low=25.0),
        "what the page adds, cores": Aim(high=0.20),
        "stop, ms": Aim(high=100.0),
        "growth of memory": Aim(high=0.10),
    },
}
"""Aims of each benchmark. A figure's name may have further words after a comma."""


def aim(benchmark: str, figure: str) -> Aim:
    """Return the aim of a figure, whose name may have further words after the aim's name."""
    aims = AIMS[benchmark]
    parts = figure.split(", ")
    names = (", ".join(parts[:length]) for length in range(len(parts), 0, -1))
    return aims[next(name for name in names if name in aims)]


def judge(
    console: Console,
    benchmark: str,
    figures: Mapping[str, float],
    allowed: Mapping[str, float] | None = None,
) -> tuple[str, bool]:
    """Print figures with their aims; return the table as Markdown, and whether all aims are met.

    A figure may miss its aim by its value in `allowed`, because of chance; the table shows both.
    Figures with too large an allowance for that (`Aim.largest_chance`) aren't judged.
    """
    rows, all_met, unjudged = [], True, 0
    for name, value in figures.items():
        wanted, chance = aim(benchmark, name), (allowed or {}).get(name, 0.0)
        if chance > wanted.largest_chance:
            unjudged += 1
            continue
        met = wanted.met(value, chance)
        all_met &= met
        by_chance = f" ± {chance:.2g}" if chance else ""
        rows.append([name, f"{value:.3g}", f"{wanted}{by_chance}", "met" if met else "MISSED"])
    title = f"Aims ({unjudged} not judged: too few chains)" if unjudged else "Aims"
    return show(console, title, ["", "measured", "aim", ""], rows), all_met


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


def least_seconds(contenders: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Return the least processor time of each contender over rounds in which all take turns."""
    least = dict.fromkeys(contenders, np.inf)
    for run in contenders.values():  # compiles functions
        run()
    for _ in range(rounds):
        for name, run in contenders.items():
            begin = time.process_time()
            run()
            least[name] = min(least[name], time.process_time() - begin)
    return least


def write_section(document: Path, name: str, text: str) -> None:
    """Replace the Markdown between a section's markers; create document or section if missing."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    before = document.read_text(encoding="utf-8") if document.exists() else "# Benchmarks\n"
    if begin not in before:
        before = before.rstrip() + f"\n\n{begin}\n{end}\n"
    head, rest = before.split(begin, 1)
    tail = rest.split(end, 1)[1]
    document.parent.mkdir(exist_ok=True)
    document.write_text(f"{head}{begin}\n{text.strip()}\n{end}{tail}", encoding="utf-8")
