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

__all__ = ["demo_page"]


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
    sections = [_summary(result)]
    for each in drawn or map(module_sections, result.modules):
        sections += each
    if result.friction is not None:
        sections.append(_friction_section(result.friction, result.friction_run_id))
    return Page(
        title="Torque bench: calibration, compensation, verification",
        subtitle=f"{result.bench_name} · {result.started:%Y-%m-%d %H:%M} UTC",
        sections=sections,
        simulated=result.simulated,
    )


def _summary(result: DemoResult) -> Section:
    rows = []
    for module in result.modules:
        for compensation in (module.raw, module.recommended):
            found = compensation.verification
            errors = found.against_standard if found.against_truth is None else found.against_truth
            rows.append(
                (
                    f"{module.side}, ±{module.range_nm:g} N·m: {compensation.title}",
                    number(errors.worst_nm),
                    number(errors.worst_percent_fs),
                    number(errors.rms_percent_fs),
                    "–"
                    if compensation.dense is None
                    else number(compensation.dense.worst_percent_fs),
                )
            )
    reference = "the true torque" if result.simulated else "the standard"
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
    table = Table(
        (
            "module and compensation",
            "worst reading, N·m",
            "worst reading, % FS",
            "RMS, % FS",
            "model alone, worst, % FS",
        ),
        rows,
        f"Single verification readings against {reference}, and the model alone along a dense "
        "sweep without noise.",
    )
    return Section("Summary", "", (facts, table))


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
    return Section(
        "No-load friction of the reducer",
        f"{sweeps}, {len(friction.speed_rpm)} points, "
        f"{compensated} the active compensation of the input module.{unsettled}",
        (_friction_table(friction), figure, Facts((("Record", run_id),))),
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
