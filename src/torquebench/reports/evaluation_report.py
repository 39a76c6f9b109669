"""Reports of evaluated tables from other benches: reducer tests and static calibrations."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration import (
    PERCENT_DIGITS,
    CalibrationResults,
    Deviation,
    DirectionResults,
    Profile,
    SideBySide,
    StaticEvaluation,
)
from torquebench.campaign.reducers.quantities import ReducerTestQuantity
from torquebench.figures import (
    COLOURS,
    Curve,
    error_figure,
    legend_above,
    new_figure,
    styled,
    svg_text,
)
from torquebench.message import Message
from torquebench.reducers import (
    FrictionResult,
    LoopFeatures,
    ReducerDescription,
    ReducerResult,
)
from torquebench.reports.page import Drawings, Facts, Figure, Page, Section, Table
from torquebench.reports.reducers.report import judged_table, tables_of
from torquebench.units import ARCMIN

QUANTITIES = (
    "f_q: deviation of the indication, b′: repeatability, b: reproducibility, f_a: deviation from "
    "the interpolated curve, h: reversibility, r: resolution, W: expanded uncertainty (k = 2), "
    "f₀: residual zero."
)
"""Meaning of the columns of `static_quantities`, by EURAMET cg-14 and DIN 51309."""


def evaluation_page(
    test: str,
    source: str,
    result: ReducerResult | FrictionResult,
    quantities: Sequence[ReducerTestQuantity],
    reducer: ReducerDescription | None,
    figures: Callable[[], Sequence[tuple[str, str]]],
    *,
    conversions: str = "",
) -> Page:
    """Return the report of a reducer test that was evaluated from a table.

    Parameters
    ----------
    test : str
        Title of the test.
    source : str
        Name of the table.
    result : ReducerResult or FrictionResult
    quantities : sequence of ReducerTestQuantity
    reducer : ReducerDescription or None
    figures : callable
        Draws the figures of the result: ``<svg>`` element and caption of each.
    conversions : str
        How columns with foreign names or units were converted.
    """
    facts = [("Table", source), *[("Columns", conversions)] * bool(conversions)]
    if reducer is not None:
        rating = Message(
            "{name}: ratio {ratio:g}, rated {rated:g} N·m",
            reducer.name,
            reducer.ratio,
            reducer.rated_torque_nm,
        )
        facts.append(("Reducer", rating))
    findings = [(each.name, each.sentence) for each in getattr(result, "findings", ())]
    return Page(
        title=Message("Evaluation: {test}", test),
        subtitle=source,
        sections=[
            Section("Summary", "", (Facts(facts), *judged_table(quantities))),
            *[Section("Findings", "", (Facts(findings),))] * bool(findings),
            Section("Result", "", (Drawings(figures), *tables_of(result, quantities))),
        ],
    )


def open_loop_page(source: str, loop: LoopFeatures, why: str) -> Page:
    """Return the report of a torque-angle loop that doesn't close, with a figure of the gap."""
    figure = Figure(
        _open_loop_figure(loop),
        "The recorded loop about its mean angle; the arrow is the gap between its start "
        "and its end at the same torque.",
    )
    return Page(
        title="Evaluation: hysteresis, no result",
        subtitle=source,
        sections=[Section("The loop doesn't close", why, (figure,))],
    )


def _open_loop_figure(loop: LoopFeatures) -> str:
    """Draw a loop that doesn't close, with the gap between its start and its end.

    Parameters
    ----------
    loop : LoopFeatures
    """
    curve = loop.curve
    middle = 0.5 * float(curve.rising_rad.mean() + curve.falling_rad.mean())
    with styled():
        figure, (axes,) = new_figure(3.6)
        for name, branch, line in (
            ("rising", curve.rising_rad, "-"),
            ("falling", curve.falling_rad, "--"),
        ):
            shown = (branch - middle) / ARCMIN
            axes.plot(curve.torque_nm, shown, line, color=COLOURS[0], lw=1.1, label=name)
        start = (curve.rising_rad[0] - middle) / ARCMIN
        end = start + loop.closure_rad / ARCMIN
        lowest = float(curve.torque_nm[0])
        axes.annotate(
            "", (lowest, end), (lowest, start), arrowprops={"arrowstyle": "->", "color": "#9A3412"}
        )
        axes.annotate(
            f"gap {loop.closure_rad / ARCMIN:+.3g} arcmin",
            (lowest, 0.5 * (start + end)),
            xytext=(10, 0),
            textcoords="offset points",
            color="#9A3412",
            va="center",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5},
        )
        axes.set_xlabel("output torque in N·m")
        axes.set_ylabel("output angle in arcmin")
        legend_above(axes)
        return svg_text(figure)


def static_page(
    source: str,
    profile: Profile | None,
    deviations: Sequence[Deviation],
    results: CalibrationResults,
    *,
    with_regression: bool = False,
    conversions: Sequence[Facts] = (),
) -> Page:
    """Return the report of a static calibration in steps.

    Parameters
    ----------
    source : str
        Name of the table.
    profile : Profile or None
        Profile with which the calibration is compared.
    deviations : sequence of Deviation
        Deviations from the profile.
    results : CalibrationResults
    with_regression : bool
        Whether to include the regression lines.
    conversions : sequence of Facts
        How columns with foreign names or units were understood.
    """
    points, torque_nm = results.data, results.torque_nm
    facts = [
        ("Table", source),
        ("Points", f"{len(points)}, {points.range_nm:g} N·m"),
        ("Transducer", points.transducer_serial or "not stated"),
    ]
    if points.scale is not None:
        facts.append(("Readings", points.scale.formula))
    if profile is not None:
        told = Message("{name} (SHA-256 {hash}…)", profile.name, profile.sha256[:12])
        if not profile.verified:
            told = Message("{profile}, not checked against a licensed text", told)
        facts.append(("Profile", told))
    for title, zero in (
        ("Zero hysteresis before compensation", results.zero_before),
        ("Zero hysteresis after compensation", results.zero_after),
    ):
        if zero is not None:
            facts.append(
                (
                    title,
                    Message(
                        "{nm:.4g} N·m at worst ({percent:.3g} % FS) over {cycles} cycles",
                        zero.worst_nm,
                        zero.worst_percent_fs,
                        zero.cycles,
                    ),
                )
            )
    name = "reading" if torque_nm is None else "before"
    curves = [Curve(name, points.standard_nm, points.reading_nm - points.standard_nm, raw=True)]
    caption = "Error of every point against the standard."
    if torque_nm is not None:
        caption = "Error of every point against the standard, before and after compensation."
        curves.append(
            Curve("after compensation", points.standard_nm, torque_nm - points.standard_nm)
        )
    figure = Drawings(lambda: [(error_figure(curves, points.range_nm), caption)])
    sections = [Section("Calibration", "", (Facts(facts), *conversions, figure))]
    sections += [_direction(each) for each in results.directions]
    if with_regression:
        sections.append(Section("Straight lines", "", (Table(*regression_table(results)),)))
    if profile is not None:
        named = [
            fact
            for each in deviations
            for fact in (
                ("refused" if each.consequence == "refuse" else "stated", each.found),
                ("allowed", each.allowed),
                ("clause", each.clause),
            )
        ]
        text = "" if named else "no deviation from the profile"
        heading = "Deviations from the profile, and their consequence for the certificate"
        sections.append(Section(heading, text, [Facts(named)] * bool(named)))
    return Page("Static evaluation", source, sections, simulated=points.simulated)


DIRECTIONS = {"clockwise": "Clockwise", "counter-clockwise": "Counter-clockwise"}


def _direction(direction: DirectionResults) -> Section:
    blocks: list[Facts | Table] = []
    for word, side in (
        ("Before compensation", direction.before),
        ("After compensation", direction.after),
    ):
        if side is None:
            continue
        header, rows = static_quantities(side)
        curve = side.interpolation
        caption = Message(
            "{title}, % of reading; {zero}; {equation} (degree {degree}, N·m); {words}.",
            word,
            residual_zero(side.evaluation),
            curve.equation,
            curve.degree,
            side.class_words,
        )
        blocks.append(Table(header, rows, caption))
    return Section(DIRECTIONS[direction.name], QUANTITIES, blocks)


def residual_zero(evaluation: StaticEvaluation) -> str:
    """State the residual zero."""
    zero = evaluation.zero_residual_percent
    if zero is None:
        return "f₀ not measured"
    return Message("f₀ {percent} % of the span", f"{zero:.{PERCENT_DIGITS}f}")


def static_quantities(side: SideBySide) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of all quantities of a direction, one row per step."""
    columns = side.columns

    def cell(values: NDArray[np.float64] | None, row: int) -> str:
        if values is None or np.isnan(values[row]):
            return "-"
        return f"{round(float(values[row]), PERCENT_DIGITS) + 0.0:.{PERCENT_DIGITS}f}"

    rows = [
        (f"{torque:g}", *(cell(values, row) for values in columns.values()))
        for row, torque in enumerate(side.evaluation.torque_nm)
    ]
    return ("N·m", *columns), rows


def regression_table(
    results: CalibrationResults,
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings and rows of the regression lines X = slope · M + intercept."""
    rows: list[tuple[str, ...]] = [
        (
            name,
            f"{line.slope:.7g}",
            f"{line.intercept:.4g}",
            f"{line.see:.4g}",
            f"{line.r_squared:.8f}",
            str(line.points),
        )
        for name, line in results.regression.items()
    ]
    return ("", "slope", "intercept N·m", "SEE N·m", "r²", "points"), rows
