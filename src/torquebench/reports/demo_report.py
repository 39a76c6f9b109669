"""The report of a demonstration: both modules and a reducer's no-load friction."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from torquebench.campaign.results import DemoResult
from torquebench.figures import Curve, friction_figure
from torquebench.procedures import FrictionSweep
from torquebench.reports.errors_table import number
from torquebench.reports.module_report import module_sections
from torquebench.reports.page import Facts, Figure, Page, Section, Table


def demo_page(result: DemoResult, drawn: Iterable[Sequence[Section]] = ()) -> Page:
    """Return the report of a demonstration.

    Parameters
    ----------
    result : DemoResult
        Results of the campaign.
    drawn : iterable of sequences of Section
        Sections that `module_sections` has already made for the modules.

    Returns
    -------
    Page
        Ready for `torquebench.reports.page.write_page`.
    """
    parts = list(drawn or map(module_sections, result.modules))
    sections = [section for part in parts for section in part if not section.detail]
    if result.friction is not None:
        sections.append(_friction_section(result.friction, result.friction_run_id))
    sections += [section for part in parts for section in part if section.detail]
    sections.append(_run(result))
    return Page(
        title="Torque bench: calibration, compensation, verification",
        subtitle=f"{result.bench_name} · {result.started:%Y-%m-%d %H:%M} UTC",
        sections=sections,
        simulated=result.simulated,
    )


def _run(result: DemoResult) -> Section:
    facts = Facts(
        (
            ("Bench", f"{result.bench_name}, preset {result.preset}, seed {result.seed}"),
            (
                "Duration",
                f"{result.bench_seconds:.0f} s of bench time in {result.elapsed_seconds:.0f} s",
            ),
            ("Software", f"torquebench {result.software_version}"),
        )
    )
    return Section("This run", "", (facts,), detail=True)


def friction_range(friction: FrictionSweep) -> str:
    """Return the measured no-load friction in one sentence."""
    torque, speed = 1e3 * np.abs(friction.torque_nm), np.abs(friction.nominal_rpm)
    return (
        f"reducer: no-load friction {number(float(torque.min()))} to {number(float(torque.max()))} "
        f"mN·m, {speed.min():.0f} to {speed.max():.0f} rpm"
    )


def _friction_section(friction: FrictionSweep, run_id: str) -> Section:
    truth = None
    if friction.true_torque_nm is not None:
        order = np.argsort(friction.speed_rpm)
        truth = Curve(
            "true torque (simulated)",
            friction.speed_rpm[order],
            friction.true_torque_nm[order],
        )
    figure = Figure(
        friction_figure(friction.speed_rpm, friction.torque_nm, friction.repeat, truth=truth),
        "No-load running torque at the input against input speed, output free; each point is the "
        "mean over whole revolutions of a settled window.",
    )
    compensated = "with" if friction.compensated else "without"
    unsettled = (
        f" {friction.unsettled} points still drifted at the end of their waiting time."
        if friction.unsettled
        else ""
    )
    repeats = len(np.unique(friction.repeat))
    sweeps = "One sweep" if repeats == 1 else f"{repeats} repeats"
    said = friction_range(friction)
    return Section(
        f"{said[0].upper()}{said[1:]}",
        f"{sweeps}, {len(friction.speed_rpm)} points, "
        f"{compensated} the active compensation of the input module.{unsettled}",
        (figure, _friction_table(friction), Facts((("Record", run_id),))),
    )


def _friction_table(friction: FrictionSweep) -> Table:
    speeds = friction.nominal_rpm
    rows = []
    for speed in np.unique(speeds):
        chosen = speeds == speed
        torque = friction.torque_nm[chosen]
        spread = float(np.ptp(torque))
        cells = [
            f"{speed:.0f}",
            number(1e3 * float(np.mean(torque)), 4),
            number(1e3 * spread, 2),
            number(1e3 * float(np.mean(friction.standard_error_nm[chosen])), 2),
        ]
        if friction.true_torque_nm is not None:
            cells.append(number(1e3 * float(np.mean(friction.true_torque_nm[chosen])), 4))
        rows.append(cells)
    header = ["speed, rpm", "torque, mN·m", "spread, mN·m", "standard error, mN·m"]
    if friction.true_torque_nm is not None:
        header.append("true torque, mN·m")
    return Table(
        header,
        rows,
        "Mean over repeats and over rising and falling speed; spread is largest minus smallest.",
    )
