"""Results of the contenders on single chains, and tables over many chains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tests.support.chain_shapes import FloatArray
from tests.support.chains import ASIDE_FAMILIES

from benchmarks.compensation_contenders import DEFAULT, MODEL_NAMES
from benchmarks.reporting import AIMS
from torquebench.compensation import RECOMMENDED

EXTREME_OF_TEN = 1.4
"""Factor on two standard errors: within 2.8, 95 % of the largest of ten deviations lie."""

UNBOUND = ("misspecified",)
"""Families whose known form is no bound, because its terms and the drift are nearly alike."""

Figures = dict[str, tuple[float, float]]
"""For each name of an aim, the value and the allowance by which it may miss the aim by chance."""


@dataclass(frozen=True)
class Result:
    """One contender on one calibration of one chain.

    Attributes
    ----------
    family : str
    seed : int
    worst, rms : float
        Error in % of full scale.
    of_curve, of_readings : float64 array of shape (10,)
        Share of 95 % intervals that contain the truth, by tenth of the range: of the curve, and of
        single readings; NaN where the contender gives no uncertainty.
    half_width : float
        Mean half-width of the 95 % intervals of single readings in % of full scale.
    fit_seconds, predict_seconds : float
        Time of the fit (NaN where it wasn't taken), and of one reading in a prediction of many.
    """

    family: str
    seed: int
    worst: float
    rms: float
    of_curve: FloatArray
    of_readings: FloatArray
    half_width: float
    fit_seconds: float
    predict_seconds: float


def ratios(results: dict[str, list[Result]], name: str, families: Sequence[str]) -> FloatArray:
    """Return the ratio of a contender's RMS error to the bound's, for each chain."""
    bounds = {(bound.family, bound.seed): bound.rms for bound in results["known form"]}
    for form in {*results} - {DEFAULT, RECOMMENDED}:
        for fitted in results[form]:
            if fitted.family in UNBOUND:
                chain = fitted.family, fitted.seed
                bounds[chain] = min(bounds[chain], fitted.rms)
    return np.array(
        [own.rms / bounds[own.family, own.seed] for own in results[name] if own.family in families]
    )


def best_other(results: dict[str, list[Result]], family: str) -> tuple[str, float]:
    """Return the single kind of model with the least median error ratio, and this median."""
    names = [name for name in MODEL_NAMES if len(results.get(name, []))]
    medians = {name: ratios(results, name, [family]) for name in names}
    found = {name: float(np.median(values)) for name, values in medians.items() if values.size}
    best = min(found, key=found.__getitem__)
    return best, found[best]


def coverage(results: Sequence[Result]) -> FloatArray:
    """Return the coverage of single readings by tenth of the range, over all chains."""
    return np.asarray(np.mean([result.of_readings for result in results], axis=0))


def comparison_rows(results: dict[str, list[Result]]) -> tuple[list[str], list[list[str]]]:
    """Return headings and cells of the comparison."""
    headings = [
        "model",
        "worst, % FS",
        "RMS, % FS",
        "RMS / bound",
        "coverage of the curve",
        "of readings",
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
        of_curve = 100 * np.mean([result.of_curve for result in own])
        rows.append(
            [
                name,
                f"{np.median([r.worst for r in own]):.4f}",
                f"{np.median([r.rms for r in own]):.4f}",
                f"{np.median(ratios(results, name, families)):.2f}",
                f"{of_curve:.1f} %" if given else "–",
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
    """Return headings and cells of the default model's results by family."""
    headings = ["family"]
    for points in outcomes:
        headings += [
            f"RMS / bound, {points} points",
            "worst / bound",
            "coverage of readings",
            "by tenth",
            "best other kind",
        ]
    groups = {f + (" (not developed on)" if f in ASIDE_FAMILIES else ""): [f] for f in families}
    unseen = [family for family in families if family in ASIDE_FAMILIES]
    if unseen:
        groups["all families developed on"] = [f for f in families if f not in unseen]
        groups["all families not developed on"] = unseen
    rows = []
    for title, members in groups.items():
        row = [title]
        for results in outcomes.values():
            own = [r for r in results[DEFAULT] if r.family in members]
            bound = [r for r in results["known form"] if r.family in members]
            worst = [a.worst / b.worst for a, b in zip(own, bound, strict=True)]
            inside = coverage(own)
            row += [
                f"{np.median(ratios(results, DEFAULT, members)):.2f}",
                f"{np.median(worst):.2f}",
                f"{100 * inside.mean():.1f} %",
                f"{100 * inside.min():.0f}–{100 * inside.max():.0f} %",
                "{} {:.2f}".format(*best_other(results, members[0])) if len(members) == 1 else "",
            ]
        rows.append(row)
    return headings, rows


def accuracy_figures(
    results: dict[str, list[Result]],
    families: Sequence[str],
    points: int,
    errors_allowed: float = 0.0,
) -> Figures:
    """Return errors of the default model; their allowance is `errors_allowed` standard errors."""
    groups: dict[str, Sequence[str]] = {
        "all families": families,
        "families not developed on": ASIDE_FAMILIES,
        **{family: (family,) for family in families},
    }
    figures: Figures = {}
    for title, members in groups.items():
        name = f"RMS / bound, {title}, {points} points"
        found = ratios(results, DEFAULT, [f for f in families if f in members])
        if found.size and name in AIMS["compensation"]:
            figures[name] = float(np.median(found)), errors_allowed * _median_error(found)
    for family in families:
        default, (best, other) = ratios(results, DEFAULT, [family]), best_other(results, family)
        allowance = errors_allowed * _median_error(default) / other
        name = f"default / best other kind, {family}, {points} points, {best}"
        figures[name] = float(np.median(default)) / other, allowance
    return figures


def _median_error(values: FloatArray) -> float:
    """Return a median's standard error, from the median absolute deviation."""
    spread = 1.4826 * float(np.median(np.abs(values - np.median(values))))
    return 1.2533 * spread / float(np.sqrt(values.size))


def interval_figures(
    results: dict[str, list[Result]], own: Sequence[str], points: int, errors_allowed: float = 0.0
) -> Figures:
    """Return the coverage of every model that `fit` offers, over all readings and by tenth.

    A coverage may miss its aim by ``errors_allowed`` of its standard errors over the chains.
    """
    figures: Figures = {}
    own = [name for name in own if results[name]]
    for name in own:
        for title, by_chain in (
            ("coverage", [result.of_curve for result in results[name]]),
            ("coverage of readings", [result.of_readings for result in results[name]]),
        ):
            rows = np.array(by_chain)
            tenths = rows.mean(axis=0)
            extreme = EXTREME_OF_TEN * np.sqrt(np.mean(np.var(rows, axis=0)) / len(rows))
            spread = float(np.std(rows.mean(axis=1)))
            parts = {
                "all": (tenths.mean(), spread / np.sqrt(len(rows))),
                "least of a tenth": (tenths.min(), extreme),
                "largest of a tenth": (tenths.max(), extreme),
            }
            new = [result.family in ASIDE_FAMILIES for result in results[name]]
            if any(new):
                aside = rows[new].mean(axis=1)
                parts["families not developed on"] = aside.mean(), spread / np.sqrt(aside.size)
            for what, (value, its_error) in parts.items():
                figure = f"{title}, {name}, {what}, {points} points"
                figures[figure] = float(value), errors_allowed * float(its_error)
    widths = {name: np.median([r.half_width for r in results[name]]) for name in own}
    calibrated = [
        widths[name]
        for name in own
        if name not in (DEFAULT, "hybrid") and coverage(results[name]).mean() >= 0.93
    ]
    shortest = float(widths[DEFAULT] / min(calibrated, default=np.inf))
    name = f"default's intervals / shortest calibrated other's, {points} points"
    return figures | {name: (shortest, 0.0)}


def speed_figures(results: dict[str, list[Result]]) -> Figures:
    """Return the time of a fit to 50 points, and its ratio to that of scikit-learn's network."""
    seconds = {
        name: float(np.nanmedian([r.fit_seconds for r in results[name]]))
        for name in ("hybrid", "bayesian-network", "scikit-learn MLPRegressor")
        if name in results
    }
    reference = seconds["scikit-learn MLPRegressor"]
    return {
        f"{name}'s fit / scikit-learn network's": (seconds[name] / reference, 0.0)
        for name in ("hybrid", "bayesian-network")
        if name in seconds
    }
