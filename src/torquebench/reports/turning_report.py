"""Section of a verification's report on speed, temperature and torque of a rotating chain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration import CalibrationData, cell_rows
from torquebench.chain import Effect, Torque
from torquebench.figures import Curve
from torquebench.message import Message
from torquebench.reports.curve_figures import Panel
from torquebench.reports.errors_table import number
from torquebench.reports.page import Diagram, Facts, Section, Table

MOST_POINTS = 1500
"""Largest number of points in a diagram; longer records are thinned out except the worst points."""
WORST_POINTS = 50


def identified_section(
    effects: Sequence[Effect], remarks: Sequence[str], range_nm: float
) -> Section:
    """Return the section on the effects of temperature, rotation and inertia that a fit identified.

    Parameters
    ----------
    effects : sequence of Effect
    remarks : sequence of str
        Effects that weren't identified, and the measurement that would identify them.
    range_nm : float
    """
    rows = [
        (
            part.name,
            number(part.percent),
            number(part.u_percent, 2),
            part.measured,
        )
        for effect in effects
        for part in effect.identified(range_nm)
    ]
    header = ("effect", "value, % FS", "U (k = 2), % FS", "measured")
    table = Table(header, rows, "Largest value and largest U where each effect was measured.")
    missing = [Facts(tuple(("Remark", each) for each in remarks))] if remarks else []
    return Section("Temperature, rotation and inertia", "", (table, *missing))


def turning_section(data: CalibrationData, torque: Torque, tolerance_percent: float) -> Section:
    """Return the section with errors over speed, temperature and torque, coverage, and budget.

    Parameters
    ----------
    data : CalibrationData
        Points with speed and temperature; if the true torque is known, errors refer to it.
    torque : Torque
        Torque of the points by the measuring chain.
    tolerance_percent : float
        Tolerance in % FS, marked in the figures.
    """
    truth = data.true_torque_nm
    reference = data.standard_nm if truth is None else truth
    against = "the standard" if truth is None else "the true torque"
    error = torque.value_nm - reference
    inside = float(np.mean(np.abs(error) <= torque.expanded_uncertainty_nm))
    shown = _shown(error)
    limit = tolerance_percent / 100.0 * data.range_nm
    quantities = (
        (data.speed_rpm, "speed in 1/min"),
        (data.temperature_c, "temperature in °C"),
        (reference, "torque in N·m"),
    )
    panels = [
        Panel(
            [Curve("error", values[shown], error[shown])],
            label,
            "error in N·m",
            markers=True,
            limits=(-limit, limit),
            range_nm=data.range_nm,
        )
        for values, label in quantities
        if values is not None
    ]
    drawn = Message(
        "Errors against {against} over speed, temperature and torque. Dashed: ±{tolerance:g} % FS.",
        against,
        tolerance_percent,
    )
    figure = Diagram(panels, drawn)
    header = ("1/min", "°C", "% of range", "points", "RMS, % FS", "worst, % FS", "covered")
    caption = Message(
        "Errors against {against} and share of points whose error lies within U (k = 2), by cells "
        "of speed, temperature and torque; {inside:.1f} % of all {count} points.",
        against,
        100 * inside,
        len(data),
    )
    return Section(
        "Speed, temperature and torque",
        "",
        (figure, Table(header, cell_rows(data, torque), caption), _budget(torque)),
    )


def _budget(torque: Torque) -> Table:
    """Return a table of the uncertainty's components, averaged over all points."""
    names = dict.fromkeys(each.name for each in torque.components)
    size = {name: torque.component(name) for name in names}
    variance = float(np.mean(torque.standard_uncertainty_nm**2))
    rows = [
        [
            name,
            number(float(np.max(np.abs(torque.added(name))))),
            number(float(np.sqrt(np.mean(u**2)))),
            number(float(np.max(u))),
            f"{100.0 * float(np.mean(u**2)) / variance:.1f} %" if variance else "–",
        ]
        for name, u in sorted(size.items(), key=lambda item: -float(np.mean(item[1] ** 2)))
        if np.any(u > 0.0) or np.any(torque.added(name) != 0.0)
    ]
    header = ("effect", "total, N·m", "u, RMS, N·m", "u, largest, N·m", "share of variance")
    return Table(header, rows, "Uncertainty budget over all points.")


def _shown(error: NDArray[np.float64]) -> NDArray[np.intp]:
    step = max(1, -(-error.size // MOST_POINTS))
    worst = np.argsort(-np.abs(error))[:WORST_POINTS]
    return np.union1d(np.arange(0, error.size, step), worst)
