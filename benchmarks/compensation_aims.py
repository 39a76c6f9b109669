"""What the comparison of compensation models has to reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tests.support.chain_shapes import FloatArray
from tests.support.chains import ASIDE_FAMILIES

from benchmarks.compensation_contenders import DEFAULT
from benchmarks.compensation_results import Result, best_other, coverage, ratios

EXTREME_OF_TEN = 1.4
"""Two standard errors of one tenth are 2.8 of the one that is off most: 95 % of the extremes."""


FAMILY_LIMITS = {
    "quadratic": (1.1, 1.3),
    "plain": (1.1, 1.3),
    "realistic": (1.35, 1.4),
    "hard": (1.6, 1.7),
    "misspecified": (1.75, 1.6),
}
"""RMS error over the bound's, at 50 and 200 points."""


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


def accuracy_aims(
    results: dict[str, list[Result]],
    families: Sequence[str],
    points: int,
    errors_allowed: float = 0.0,
) -> list[Aim]:
    """Return the aims for the default's errors; medians may miss by `errors_allowed` errors."""
    column = 0 if points <= 50 else 1
    groups: dict[str, tuple[Sequence[str], float]] = {
        "all families": (families, (1.35, 1.5)[column]),
        "families not developed on": (ASIDE_FAMILIES, (1.35, 1.5)[column]),
        **{family: ((family,), limits[column]) for family, limits in FAMILY_LIMITS.items()},
    }
    aims = []
    for title, (members, highest) in groups.items():
        found = ratios(results, DEFAULT, [f for f in families if f in members])
        if found.size:
            allowance = errors_allowed * _median_error(found)
            name = f"default, RMS / bound, {title}, {points} points"
            aims.append(Aim(name, float(np.median(found)), 0.0, highest, allowance))
    for family in families:
        default, (best, other) = ratios(results, DEFAULT, [family]), best_other(results, family)
        allowance = errors_allowed * _median_error(default) / other
        name = f"default / {best}, {family}, {points} points"
        aims.append(Aim(name, float(np.median(default)) / other, 0.0, 1.05, allowance))
    return aims


def _median_error(values: FloatArray) -> float:
    """Return a median's standard error, from the median absolute deviation."""
    spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
    return 1.2533 * spread / float(np.sqrt(values.size))


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
        new = [r.inside.mean() for r in results[name] if r.family in ASIDE_FAMILIES]
        if new:
            allowance = errors_allowed * spread / np.sqrt(len(new))
            title = f"{name}, coverage, families not developed on, {points} points"
            aims.append(Aim(title, float(np.mean(new)), 0.93, 0.97, allowance))
    widths = {name: np.median([r.half_width for r in results[name]]) for name in own}
    calibrated = [
        widths[name]
        for name in own
        if name not in (DEFAULT, "hybrid") and coverage(results[name]).mean() >= 0.93
    ]
    shortest = float(widths[DEFAULT] / min(calibrated, default=np.inf))
    name = f"default's intervals / shortest calibrated other's, {points} points"
    return [*aims, Aim(name, shortest, 0.0, 1.0)]


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
