"""The page of two calibrations of one transducer: both curves, their difference, E_n."""

from __future__ import annotations

import numpy as np

from torquebench.campaign.calibration_comparison import CalibrationComparison, CalibrationStep
from torquebench.figures import COLOURS, legend_above, new_figure, percent_axis, styled, svg_text
from torquebench.message import Message
from torquebench.reports.page import Drawings, Facts, Page, Section, Table
from torquebench.uncertainty import stated

BRANCHES = {1: "rising", -1: "falling", 0: ""}


def calibration_comparison_page(found: CalibrationComparison) -> Page:
    """Return the page of a comparison, ready for `write_report`."""
    facts: list[tuple[str, str]] = [
        (
            word,
            Message(
                "{calibration} of {day}, {points} points, {low:g} to {high:g} N·m, model-{number} "
                "({kind})",
                each.name,
                f"{each.entry.performed:%Y-%m-%d}",
                each.entry.points,
                *each.entry.valid_nm,
                each.model.model_id,
                each.model.kind,
            ),
        )
        for word, each in (("Before", found.before), ("After", found.after))
    ]
    compared = Message("{low:.4g} to {high:.4g} N·m", found.low_nm, found.high_nm)
    facts += [("Compared", compared)]
    facts += [("Result", found.verdict())]
    caption = (
        "Above: additional torque by both calibrations. Below: its change with U (k = 2); a change "
        "beyond its bar is significant."
    )
    table = Table(
        ("reading, N·m", "branch", "before, N·m", "after, N·m", "change, N·m", "U, N·m", "E_n"),
        [_row(each) for each in found.steps],
        "E_n = change/U; beyond ±1 the change is significant. U contains what belongs to the "
        "calibrations: curve, mounting, and the reference standards where they differ.",
    )
    return Page(
        title=Message("Transducer {serial}: two calibrations", found.after.entry.transducer_serial),
        subtitle=Message("{before} and {after}", found.before.name, found.after.name),
        sections=[
            Section(
                "Summary", "", (Facts(facts), Drawings(lambda: [(change_figure(found), caption)]))
            ),
            Section("Steps", "", (table,)),
        ],
        simulated=found.simulated,
    )


def _row(step: CalibrationStep) -> tuple[str, ...]:
    before, after = (
        stated(torque, step.expanded_uncertainty_nm)[0]
        for torque in (step.before_nm, step.after_nm)
    )
    mark = " *" if step.significant else ""
    return (
        f"{step.reading_nm:.5g}",
        BRANCHES[step.branch] or "–",
        before,
        after,
        *stated(step.change_nm, step.expanded_uncertainty_nm),
        f"{step.normalised_error:+.2f}{mark}",
    )


def change_figure(found: CalibrationComparison) -> str:
    """Draw both curves and their difference as SVG text."""
    with styled():
        figure, (above, below) = new_figure(5.4, 2)
        for side in sorted({step.branch for step in found.steps}, reverse=True):
            steps = [step for step in found.steps if step.branch == side]
            reading = np.array([step.reading_nm for step in steps])
            word = f", {BRANCHES[side]}" if side else ""
            line = "--" if side < 0 else "-"
            for colour, name, values in (
                (COLOURS[0], found.before.name, [step.before_nm for step in steps]),
                (COLOURS[1], found.after.name, [step.after_nm for step in steps]),
            ):
                above.plot(reading, values, line, color=colour, lw=1.2, label=f"{name}{word}")
            below.errorbar(
                reading,
                [step.change_nm for step in steps],
                yerr=[step.expanded_uncertainty_nm for step in steps],
                fmt="v" if side < 0 else "^" if side > 0 else "o",
                color=COLOURS[2],
                fillstyle="none" if side < 0 else "full",
                markersize=4.0,
                capsize=2.0,
                linewidth=0.9,
                label=f"change{word}",
            )
        below.axhline(0.0, color="#5F666E", linewidth=0.8)
        above.set_ylabel("additional torque in N·m")
        below.set_ylabel("change in N·m")
        below.set_xlabel("reading in N·m")
        for axes in (above, below):
            percent_axis(axes, found.range_nm)
            legend_above(axes)
        return svg_text(figure)
