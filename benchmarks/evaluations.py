"""Accuracy and coverage of the evaluations of recordings: ``python -m benchmarks.evaluations``.

Every quantity of every reducer test is evaluated from recordings with one disturbance each and a
known truth (`tests.support.recordings`, written from the quantities' definitions alone). The table
has bias (median), root mean square error and U (median) in % of a scale - the true value, for
widths of loops the twist at the rated torque - and the empirical coverage of the 95 % intervals.

Where a quantity is covered by less than 90 %, its disturbance is repeated with five times as many
recordings. The exit code is 1 where a coverage is significantly below 90 %: where fewer than 31 of
40 intervals, or 170 of 200, contain the truth, which has a probability below 1 % for a coverage of
90 %.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.stats import binom
from tests.support import recordings

from benchmarks.reporting import AIMS
from torquebench.errors import InputError
from torquebench.reducers import (
    LoopSettings,
    evaluate_breakaway,
    evaluate_efficiency,
    evaluate_hysteresis,
    evaluate_no_load,
    evaluate_swings,
    evaluate_transmission_error,
    unwrapped,
)
from torquebench.uncertainty import Budget
from torquebench.units import ARCMIN, RAD_S_PER_RPM

SEEDS = 40
LEAST = AIMS["evaluations"]["coverage"].low
"""Smallest coverage that meets the aim."""
CHANCE = 0.01
"""Smallest probability with which a low coverage is still put down to chance."""
AGAIN = 5
"""Factor on the number of recordings when a disturbance with low coverage is repeated."""

Options = Mapping[str, Any]
Value = tuple[str, Budget, float, float]
"""Name of a quantity, its estimate, its true value, and the value that its errors are divided
by."""


def hysteresis(rng: np.random.Generator, seed: int, options: Options) -> Iterator[Value]:
    """Evaluate the loops of a recording; the seed selects one of six shapes."""
    loop = recordings.loop(recordings.SHAPES[seed % len(recordings.SHAPES)], rng)
    record, truth = recordings.loop_record(loop, rng, **options), loop.truth()
    angle = record.angle * ARCMIN
    for quantity in evaluate_hysteresis(
        record.torque, angle, LoopSettings(loop.rated)
    ).quantities():
        true = truth[quantity.key]
        twist = quantity.key in ("backlash", "lost_motion")
        scale = loop.rated / truth["stiffness"] if twist else true
        yield quantity.key.replace("_", " "), quantity.estimate, true, scale


def breakaway(rng: np.random.Generator, _seed: int, options: Options) -> Iterator[Value]:
    """Evaluate torque ramps up to the breakaway."""
    record = recordings.ramp_record(rng, **options)
    found = evaluate_breakaway(record.time, record.angle * ARCMIN, record.torque, run=record.run)
    yield "torque", found.torque, record.truth, record.truth


def no_load(rng: np.random.Generator, _seed: int, options: Options) -> Iterator[Value]:
    """Evaluate no-load torques at several speeds, and the components of the friction."""
    record = recordings.speed_record(rng, **options)
    truth, found = record.truth, evaluate_no_load(record.speed, record.torque)
    for name, points in (("torque", found.points), ("mean of directions", found.means)):
        for point in points:
            true = float(truth.at(np.array(point.speed_rpm)))
            yield name, point.torque, true, truth.coulomb
    parts = {
        "coulomb": (truth.coulomb, truth.coulomb),
        "viscous": (truth.viscous / RAD_S_PER_RPM,) * 2,
        "stribeck_speed": (truth.creep_rpm, truth.creep_rpm),
        "stribeck": (truth.stribeck, truth.coulomb),
    }
    for quantity in found.friction.quantities():
        name = next(each for each in parts if quantity.key.startswith(each))
        yield name.replace("_", " "), quantity.estimate, *parts[name]


def efficiency(rng: np.random.Generator, _seed: int, options: Options) -> Iterator[Value]:
    """Evaluate efficiencies; for an offset of the torque, only means of both directions."""
    record = recordings.efficiency_record(rng, **options)
    found = evaluate_efficiency(record.drive, record.load, record.speed, record.ratio)
    for point in found.means if options.get("offset") else found.points:
        true = record.truth(point.torque_nm, point.speed_rpm)
        yield "efficiency", point.efficiency, true, true


def transmission_error(rng: np.random.Generator, _seed: int, options: Options) -> Iterator[Value]:
    """Evaluate the transmission error in whole turns of two encoders."""
    record = recordings.angle_record(rng, **options)
    given, taken = np.radians(record.driving), np.radians(record.driven)
    if options.get("wrapped"):
        given, taken = unwrapped(given), unwrapped(taken)
    highest = options.get("highest", 60.0)
    found = evaluate_transmission_error(given, taken, record.ratio, highest_order=highest)
    for direction in found.directions:
        yield "peak to peak", direction.peak_to_peak, record.peak_to_peak, record.peak_to_peak
        for order in direction.orders:
            true = record.orders.get(round(order.order))
            if true:
                yield "orders", order.amplitude, true, true


def swings(rng: np.random.Generator, _seed: int, options: Options) -> Iterator[Value]:
    """Evaluate lost motion and backlash in strokes of two encoders."""
    record = recordings.swing_record(rng, **options)
    given, taken = np.radians(record.driving), np.radians(record.driven)
    found = evaluate_swings(given, taken, record.ratio)
    scale = record.lost_motion or 1.0
    yield "lost motion", found.lost_motion, record.lost_motion, scale
    yield "backlash", found.backlash, record.backlash, scale


STRONG: Options = {"strongest": 4.0, "highest": 30.0}

CASES: Mapping[Callable[..., Iterator[Value]], Mapping[str, Options]] = {
    hysteresis: {
        "noise": {"noise": 0.01},
        "noise of the torque": {"torque_noise": 0.003, "samples": 2000},
        "coarse encoder": {"step": 0.05},
        "coarse encoder and noise": {"step": 0.05, "noise": 0.01},
        "coarse torque": {"torque_step": 0.02, "noise": 0.003, "samples": 1000},
        "one loop": {"loops": 1, "noise": 0.01},
        "two loops": {"loops": 2, "noise": 0.01},
        "five loops": {"loops": 5, "noise": 0.01},
        "drift": {"drift": 0.05, "noise": 0.003},
        "drift that dies out": {"drift": 0.05, "noise": 0.003, "bending": 0.3},
        "one loop, drift": {"loops": 1, "drift": 0.04, "noise": 0.003},
        "one bad torque": {"bad": "torque", "noise": 0.003},
        "one bad angle": {"bad": "angle", "noise": 0.003},
        "levels of torque": {"levels": 20, "noise": 0.005},
        "few samples": {"samples": 40},
        "single cycle": {"single": True, "noise": 0.003, "samples": 400},
    },
    breakaway: {
        "no drop": {},
        "drop of 5 %": {"drop": 0.05},
        "drop of 25 %": {"drop": 0.25},
        "drop of 25 %, noise": {"drop": 0.25, "noise": 0.01},
        "coarse encoder": {"drop": 0.1, "step": 5.0, "angle_noise": 0.05},
        "few samples": {"samples": 60, "drop": 0.1},
        "wind-up": {"windup": 20.0},
        "staircase of 8": {"levels": 8},
        "staircase of 30": {"levels": 30},
        "spread, 5 ramps": {"spread": 0.03, "drop": 0.1, "runs": 5},
        "one ramp": {"runs": 1, "drop": 0.1},
        "one bad torque": {"bad": "torque", "drop": 0.1},
        "one bad angle": {"bad": "angle", "drop": 0.1},
    },
    no_load: {
        "points": {},
        "noise": {"noise": 0.03},
        "one run": {"repeats": 1},
        "offset": {"offset": 0.3},
        "one direction": {"both": False},
        "one bad point": {"bad": "y"},
        "coarse torque": {"noise": 0.0001, "places": 3},
        "log": {"log": 100, "repeats": 2, "noise": 0.05},
        "log, offset": {"log": 100, "repeats": 2, "noise": 0.05, "offset": 0.5},
        "ramp": {"ramp": True},
        "ramp, offset": {"ramp": True, "offset": 0.2},
        "ramp, one direction": {"ramp": True, "both": False},
    },
    efficiency: {
        "points": {},
        "two repeats": {"repeats": 2},
        "no repeats": {"repeats": 1},
        "offset, both directions": {"both": True, "offset": 0.01},
        "one bad point": {"bad": True},
        "coarse torque": {"noise": 1e-6, "places": 2, "wander": 0.0},
        "log": {"log": 150, "repeats": 1, "noise": 0.01},
        "set points not held": {"wander": 0.004},
    },
    transmission_error: {
        "one turn": {"turns": 1.0},
        "three turns": {"turns": 3.02},
        "noise": {"noise": 3.0},
        "strong order 4": STRONG,
        "strong order 1, one turn": {"strongest": 1.0, "turns": 1.0, "highest": 30.0},
        "coarse encoder": {"step": 20.0, "samples": 20_000},
        "coarse encoder, fast": {"step": 20.0},
        "one bad sample": {"bad": True},
        "one bad sample, strong order": {**STRONG, "bad": True},
        "wrapped, one bad sample": {"wrapped": True, "bad": True},
    },
    swings: {
        "strokes": {},
        "noise": {"noise": 0.5},
        "coarse encoder": {"step": 1.3},
        "elastic lost motion": {"soft": 2.0},
        "no play": {"play": 0.0},
        "three strokes": {"strokes": 3},
        "wrong ratio": {"wrong": 0.05},
        "strong error": {"size": 20.0},
        "short strokes": {"reach": 2.0},
        "one bad sample": {"bad": True},
    },
}


@dataclass(frozen=True)
class Line:
    """One quantity under one disturbance: errors and expanded uncertainties in shares of a scale.

    U is infinite where it is unknown.
    """

    test: str
    disturbance: str
    quantity: str
    errors: np.ndarray[tuple[int], np.dtype[np.float64]]
    expanded: np.ndarray[tuple[int], np.dtype[np.float64]]

    @property
    def coverage(self) -> float:
        """Share of the known intervals that contain the truth; NaN without any."""
        known = np.isfinite(self.expanded)
        if not known.any():
            return float("nan")
        return float(np.mean(np.abs(self.errors[known]) <= self.expanded[known] + 1e-9))

    def improbable(self, seeds: int) -> bool:
        """Return whether so low a coverage would be improbable if the true coverage were 90 %.

        Values of one recording share errors: each recording counts once.
        """
        count = min(seeds, int(np.isfinite(self.expanded).sum()))
        return bool(count and self.coverage * count < binom.ppf(CHANCE, count, LEAST))

    def cells(self) -> tuple[str, ...]:
        """Return the cells of the table's row."""
        known = np.isfinite(self.expanded)
        largest = f"{100.0 * np.median(self.expanded[known]):.2g}" if known.any() else "unknown"
        return (
            self.quantity,
            str(self.errors.size),
            f"{100.0 * np.median(self.errors):+.2g}",
            f"{100.0 * np.sqrt(np.mean(self.errors**2)):.2g}",
            largest,
            "–" if not known.any() else f"{100.0 * self.coverage:.0f} %",
        )


def measured(
    test: Callable[..., Iterator[Value]], disturbance: str, seeds: int = SEEDS
) -> tuple[list[Line], list[str]]:
    """Evaluate recordings with a disturbance; return their errors, and why some were refused."""
    options = CASES[test][disturbance]
    values: dict[str, list[Value]] = {}
    refused: list[str] = []
    name = test.__name__.replace("_", " ")
    for seed in range(seeds):
        rng = np.random.default_rng([seed, *map(ord, disturbance)])
        try:
            for value in test(rng, seed, options):
                values.setdefault(value[0], []).append(value)
        except InputError as problem:
            refused.append(str(problem))
    lines = []
    for quantity, of in values.items():
        scale = np.array([value[3] for value in of])
        errors = np.array([value[1].value - value[2] for value in of]) / scale
        expanded = np.array([value[1].expanded_uncertainty() for value in of]) / np.abs(scale)
        lines.append(Line(name, disturbance, quantity, errors, expanded))
    return lines, refused


def main(arguments: Sequence[str] | None = None) -> int:
    """Evaluate, print the table, and return 1 where a coverage is too low."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.evaluations", description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS, help="recordings of each disturbance")
    parser.add_argument("--test", action="append", help="only this test; may be repeated")
    options = parser.parse_args(arguments)
    console = Console()
    table = Table(box=None, pad_edge=False)
    for heading in ("disturbance", "quantity"):
        table.add_column(heading, no_wrap=True)
    for heading in ("n", "bias, %", "rms, %", "U, %", "coverage", "refused"):
        table.add_column(heading, justify="right", no_wrap=True)
    missed = []
    for test, cases in CASES.items():
        name = test.__name__.replace("_", "-")
        if options.test and name not in options.test:
            continue
        table.add_row(f"[bold]{name}[/bold]")
        for disturbance in cases:
            seeds = options.seeds
            lines, refused = measured(test, disturbance, seeds)
            if any(line.coverage < LEAST for line in lines):
                seeds *= AGAIN
                lines, refused = measured(test, disturbance, seeds)
            for number, line in enumerate(lines):
                first = (disturbance, str(len(refused) or "")) if number == 0 else ("", "")
                table.add_row(first[0], *line.cells(), first[1])
            missed += [line for line in lines if line.improbable(seeds)]
    console.print(table)
    for line in missed:
        console.print(
            f"MISSED: {line.test}, {line.disturbance}: {line.quantity} is covered by "
            f"{100.0 * line.coverage:.0f} % of the intervals"
        )
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
