"""Figures of a calibration: its error curves and its loading."""

from __future__ import annotations

import numpy as np

from torquebench.calibration import CalibrationData
from torquebench.figures import Curve
from torquebench.message import Message
from torquebench.reports.curve_figures import Panel
from torquebench.reports.page import Diagram

LOADING_LIMIT_PERCENT = 0.1
"""Loading accuracy of the source papers, % of range."""


def error_curves(data: CalibrationData, title: str = "") -> Panel:
    """Return curves of reading minus standard over |torque|, one per direction and branch."""
    curves = []
    for sign, direction in ((1, "clockwise"), (-1, "counter-clockwise")):
        for branch, word in ((1, "rising"), (-1, "falling")):
            rows = np.flatnonzero((np.sign(data.standard_nm) == sign) & (data.branch == branch))
            if rows.size:
                part = data.subset(rows[np.argsort(np.abs(data.standard_nm[rows]), kind="stable")])
                error = part.reading_nm - part.standard_nm
                curves.append(
                    Curve(Message.joined((direction, word)), np.abs(part.standard_nm), error)
                )
    return Panel(curves, "|torque| in N·m", "error in N·m", range_nm=data.range_nm, title=title)


def loading_figures(data: CalibrationData) -> list[Diagram]:
    """Return the deviation of each step from its nominal torque; empty without nominal torques."""
    error = data.loading_error_percent
    if error is None:
        return []
    panel = Panel(
        [Curve("", np.arange(1.0, error.size + 1.0), error)],
        "step",
        "loading error in % of range",
        markers=True,
        limits=(-LOADING_LIMIT_PERCENT, LOADING_LIMIT_PERCENT),
    )
    caption = Message(
        "Loading: standard minus the requested torque, at every step. Dashed: ±{limit:g} % of "
        "range.",
        LOADING_LIMIT_PERCENT,
    )
    return [Diagram([panel], caption, height=2.0)]
