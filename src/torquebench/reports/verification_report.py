"""The report of a verification: errors of several models in each group of readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.roles import SIDE_TITLES
from torquebench.calibration import CalibrationData, repeatability
from torquebench.figures import Curve
from torquebench.message import Message
from torquebench.reports.curve_figures import Panel
from torquebench.reports.errors_table import number
from torquebench.reports.page import Diagram, Facts, Page, Section, Table

VERIFICATION_TITLES = {
    "input": "Verification of the input module",
    "output": "Verification of the output module",
}


@dataclass(frozen=True, eq=False)
class Verified:
    """Torque of one model for the readings of a verification.

    Attributes
    ----------
    title : str
    torque_nm : float64[n]
    """

    title: str
    torque_nm: NDArray[np.float64]


def verification_tables(
    data: CalibrationData,
    verified: Sequence[Verified],
    what: str,
    tolerance_percent: float = 0.1,
) -> list[Table]:
    """Return tables of each group's errors, and of error and repeatability over all groups.

    Parameters
    ----------
    data : CalibrationData
        Points of the verification; each series is a group.
    verified : sequence of Verified
        The raw reading first.
    what : str
        Name of the points in the captions.
    tolerance_percent : float
        Tolerance of error and repeatability, % FS.
    """
    errors = [each.torque_nm - data.standard_nm for each in verified]
    groups = np.unique(data.series)
    rows = []
    for group in groups:
        chosen = data.series == group
        amounts = [np.abs(error[chosen]) for error in errors]
        cells = [f"{number(each.max())} / {number(each.mean())}" for each in amounts]
        rows.append([str(int(group)), *cells])
    verdicts, rule = [], ""
    for each, error in zip(verified, errors, strict=True):
        worst_nm = float(np.max(np.abs(error)))
        worst, spread = 100.0 * worst_nm / data.range_nm, repeatability(error, data)
        rule = "" if spread is None else Message(": {rule}", spread.rule)
        verdicts.append(
            [
                each.title,
                number(worst_nm),
                number(worst),
                kept_words(worst, tolerance_percent),
                number(None if spread is None else spread.worst_nm),
                number(None if spread is None else spread.worst_percent_fs),
                "–" if spread is None else kept_words(spread.worst_percent_fs, tolerance_percent),
            ]
        )
    limit = f"≤ {tolerance_percent:g} %"
    size = len(data) // len(groups)
    return [
        Table(
            ("group", *(Message("{title}, N·m", each.title) for each in verified)),
            rows,
            Message(
                "{what}: worst / mean amount of the error in each group of {size} readings, "
                "against the standard.",
                what,
                size,
            ),
        ),
        Table(
            (
                "",
                "worst, N·m",
                "% FS",
                Message("error {limit}", limit),
                "repeatability, N·m",
                "% FS",
                Message("repeatability {limit}", limit),
            ),
            verdicts,
            Message(
                "{what}: worst single reading of all groups, and the largest standard deviation "
                "at one place{rule}.",
                what,
                rule,
            ),
        ),
    ]


def kept_words(percent: float, tolerance_percent: float) -> str:
    """Return "met" if the largest error is within its tolerance, else "not met"."""
    return "met" if percent <= tolerance_percent else "not met"


def before_after_diagram(
    data: CalibrationData, verified: Verified, tolerance_percent: float = 0.1
) -> Diagram:
    """Return the errors of the readings before and after compensation by a model."""
    limit = tolerance_percent / 100.0 * data.range_nm
    panel = Panel(
        [
            Curve(
                "before compensation",
                data.standard_nm,
                data.reading_nm - data.standard_nm,
                raw=True,
            ),
            Curve(
                Message("after: {title}", verified.title),
                data.standard_nm,
                verified.torque_nm - data.standard_nm,
            ),
        ],
        "torque in N·m",
        "error in N·m",
        markers=True,
        limits=(-limit, limit),
        range_nm=data.range_nm,
    )
    side = SIDE_TITLES.get(data.side, "Readings")
    caption = Message(
        "{side}: errors of {count} fresh readings before and after {title}, against the "
        "verification standard. Dashed: ±{tolerance:g} % FS.",
        side,
        len(data),
        verified.title,
        tolerance_percent,
    )
    return Diagram([panel], caption)


def verification_page(
    data: CalibrationData,
    verified: Sequence[Verified],
    facts: Sequence[tuple[str, str]],
    tolerance_percent: float = 0.1,
) -> Page:
    """Return the report of a verification.

    Parameters
    ----------
    data : CalibrationData
    verified : sequence of Verified
        The raw reading first, then each model.
    facts : sequence of (str, str)
        Origin of the points.
    tolerance_percent : float
    """
    groups = len(np.unique(data.series))
    what = Message("{count} groups", groups) if groups > 1 else "1 group"
    figures = [before_after_diagram(data, each, tolerance_percent) for each in verified[1:]]
    return Page(
        VERIFICATION_TITLES.get(data.side, "Verification"),
        Message("{count} readings in {what}, {range:g} N·m", len(data), what, data.range_nm),
        [
            Section(
                "Result",
                "",
                (
                    Facts(tuple(facts)),
                    *verification_tables(data, verified, what, tolerance_percent),
                ),
            ),
            Section("Before and after", "", tuple(figures)),
        ],
        simulated=data.simulated,
    )
