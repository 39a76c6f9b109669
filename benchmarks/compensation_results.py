"""What a contender reached on a chain, and the tables that are made of many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tests.support.chain_shapes import FloatArray
from tests.support.chains import ASIDE_FAMILIES

from benchmarks.compensation_contenders import DEFAULT, MODEL_NAMES


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


def ratios(results: dict[str, list[Result]], name: str, families: Sequence[str]) -> FloatArray:
    """Return RMS error over the bound's, chain by chain."""
    bounds = {(bound.family, bound.seed): bound.rms for bound in results["known form"]}
    return np.array(
        [own.rms / bounds[own.family, own.seed] for own in results[name] if own.family in families]
    )


def best_other(results: dict[str, list[Result]], family: str) -> tuple[str, float]:
    """Return the single kind with the least median of RMS error over the bound's, and that."""
    names = [name for name in MODEL_NAMES if len(results.get(name, []))]
    medians = {name: ratios(results, name, [family]) for name in names}
    found = {name: float(np.median(values)) for name, values in medians.items() if values.size}
    best = min(found, key=found.__getitem__)
    return best, found[best]


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
        "coverage of 95 % intervals",
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
    """Return headings and cells of the default by family."""
    headings = ["family"]
    for points in outcomes:
        headings += [
            f"RMS / bound, {points} points",
            "worst / bound",
            "coverage of 95 % intervals",
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
            row += [
                f"{np.median(ratios(results, DEFAULT, members)):.2f}",
                f"{np.median(worst):.2f}",
                f"{100 * coverage(own).mean():.1f} %",
                "{} {:.2f}".format(*best_other(results, members[0])) if len(members) == 1 else "",
            ]
        rows.append(row)
    return headings, rows
