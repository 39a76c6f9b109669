"""The report of a check with a standard reducer: certified and measured friction."""

from __future__ import annotations

import numpy as np

from torquebench.figures import Curve
from torquebench.message import Message
from torquebench.reducers import FrictionCheck
from torquebench.reports.curve_figures import Panel
from torquebench.reports.errors_table import number
from torquebench.reports.page import Diagram, Facts, Page, Section, Table

_MARKERS = ("o", "^", "s", "D", "v")


def friction_check_table(check: FrictionCheck) -> Table:
    """Return a table of certified torque, repeats, error and repeatability at each speed."""
    repeats = max(len(point.measured_nm) for point in check.points)
    rows = []
    for point in check.points:
        measured = [number(value, 4) for value in point.measured_nm]
        rows.append(
            [
                f"{point.speed_rpm:g}",
                number(point.known_nm, 4),
                number(point.known_u_nm, 2),
                *measured,
                *["–"] * (repeats - len(measured)),
                number(point.error_nm, 2),
                number(point.error_percent, 2),
                number(point.spread_percent, 2),
            ]
        )
    return Table(
        (
            "rpm",
            "known, N·m",
            "U, N·m",
            *(Message("repeat {number}, N·m", k + 1) for k in range(repeats)),
            "error, N·m",
            "% FS",
            "repeatability, % FS",
        ),
        rows,
        Message(
            "Mean over rising and falling speed of each repeat; repeatability is largest minus "
            "smallest of the repeats; full scale {range_nm:g} N·m.",
            check.range_nm,
        ),
    )


def friction_diagram(check: FrictionCheck) -> Diagram:
    """Return diagrams of certified friction and repeats over speed, and of their differences."""
    speed = np.array([point.speed_rpm for point in check.points])
    known = np.array([point.known_nm for point in check.points])
    known_u = np.array([point.known_u_nm for point in check.points])
    friction = [Curve("known", speed, known, raw=True, style="-")]
    errors = [
        Curve("U of the certified value", speed, 0.0 * speed, raw=True, band=known_u, style="-")
    ]
    repeats = max(len(point.measured_nm) for point in check.points)
    for k in range(repeats):
        rows = [(p.speed_rpm, p.measured_nm[k], p.known_nm)
                for p in check.points if len(p.measured_nm) > k]  # fmt: skip
        rpm, torque, certified = np.array(rows).T
        marker = _MARKERS[k % len(_MARKERS)]
        name = Message("repeat {number}", k + 1)
        friction.append(Curve(name, rpm, torque, style=marker))
        errors.append(Curve(name, rpm, torque - certified, style=marker))
    limit = check.tolerance_percent / 100.0 * check.range_nm
    panels = [
        Panel(friction, "input speed in rpm", "no-load torque in N·m", title="friction"),
        Panel(
            errors,
            "input speed in rpm",
            "error in N·m",
            limits=(-limit, limit),
            range_nm=check.range_nm,
            title="measured minus known",
        ),
    ]
    caption = Message(
        "No-load torque at the input, output free: as certified and as measured, and the "
        "difference. Dashed: ±{limit:g} % FS.",
        check.tolerance_percent,
    )
    return Diagram(panels, caption)


def standard_reducer_page(
    check: FrictionCheck,
    *,
    name: str,
    certificate: str,
    compensation: str,
    run_id: str,
    simulated: bool,
) -> Page:
    """Return the report of a bench checked by a standard reducer.

    Parameters
    ----------
    check : FrictionCheck
    name, certificate : str
        Name of the reducer, and number of its certificate.
    compensation : str
        Title of the input module's compensation model.
    run_id : str
        Run with the raw data.
    simulated : bool
    """

    def judged(percent: float, kept: bool) -> Message:
        return Message(
            "{value} % FS: within {limit:g} % FS"
            if kept
            else "{value} % FS: out of {limit:g} % FS",
            number(percent),
            check.tolerance_percent,
        )

    facts = Facts(
        (
            ("Standard reducer", name),
            ("Certificate", certificate or "not stated"),
            ("Input module", compensation),
            ("Error", judged(check.error_percent, check.error_kept)),
            ("Repeatability", judged(check.repeatability_percent, check.repeatability_kept)),
            ("Record", run_id),
        )
    )
    return Page(
        "Standard reducer: known against measured friction",
        f"{name}, {'passed' if check.kept else 'failed'}",
        [Section("Result", "", (facts, friction_check_table(check), friction_diagram(check)))],
        simulated=simulated,
    )
