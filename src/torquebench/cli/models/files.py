"""`torquebench export` and `budget`: export a model's table, and compute budgets."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from torquebench.cli.answers import BUDGETED_READING, EXPORTED_MODEL
from torquebench.cli.models.commands import LimitsOption, chain_of
from torquebench.cli.options import ReferenceOption, check_output, stated_reference
from torquebench.cli.terminal.console import answer, narrow_table, out, say, warn
from torquebench.units import DEGREE, HOURS_PER_DAY

if TYPE_CHECKING:
    from torquebench.uncertainty import Budget

__all__ = ["budget", "export"]

ModelArgument = Annotated[Path, typer.Argument(help="A model file that `fit` wrote.")]


class Branch(StrEnum):
    """Branch of a reading."""

    UP = "up"
    DOWN = "down"
    UNKNOWN = "unknown"


_SIGNS = {Branch.UP: 1, Branch.DOWN: -1, Branch.UNKNOWN: 0}


def export(
    model: ModelArgument,
    result: Annotated[
        Path, typer.Option("--out", help="The file to write: NAME.csv, .h, .st or .onnx.")
    ],
    decimal_comma: Annotated[
        bool, typer.Option("--decimal-comma", help="CSV with decimal commas and semicolons.")
    ] = False,
    no_uncertainty: Annotated[
        bool, typer.Option("--no-uncertainty", help="Leave the uncertainty out.")
    ] = False,
) -> None:
    """Compile a model to a table for other programs: CSV, C header, Structured Text or ONNX.

    The file states its largest deviation from the model, on the calibrated loop and over partial
    loops. C header and Structured Text (IEC 61131-3, for PLCs) have a function for the branch.
    """
    from torquebench.compensation import load_model
    from torquebench.compensation.export.formats import check_export

    check_output(result, model)
    check_export(result, decimal_comma=decimal_comma)
    stored = load_model(model)

    from torquebench.chain import MeasuringChain
    from torquebench.compensation import compile_table, export_table
    from torquebench.compensation.export.branches import partial_loop_deviation

    if MeasuringChain.of(stored).turns:
        warn("the table contains only the static curve, without temperature, rotation and inertia")

    table = compile_table(stored.model, uncertainty=not no_uncertainty)
    export_table(result, table, stored.provenance, decimal_comma=decimal_comma)
    degree = {1: "linear", 3: "cubic"}[table.curve.degree]
    branches = "each branch" if table.curve.branch_aware else "any branch"
    say(
        f"{escape(str(result))}: {table.curve.intervals} {degree} intervals for {branches}, "
        f"{table.reading_low_nm:g} to {table.reading_high_nm:g} N·m"
    )
    partial_nm = partial_loop_deviation(table)
    answer(**EXPORTED_MODEL.of(table, files=[str(result)], partial_loops_deviation_nm=partial_nm))
    percent = 100.0 * table.bound_nm / table.full_scale_nm
    say(f"table's deviation from the model: at most {table.bound_nm:.2g} N·m ({percent:.1g} % FS)")
    if not table.curve.branch_aware:
        return
    say(f"after reversals in mid-range, with the branch alone: at most {partial_nm:.2g} N·m")
    say("branch: +1 if the magnitude of the torque increases, -1 if it decreases, 0 if unknown")


def budget(
    model: ModelArgument,
    reading: Annotated[list[float], typer.Option(help="A reading in N·m; may be repeated.")],
    branch: Annotated[Branch, typer.Option(help="Branch of the reading.")] = Branch.UNKNOWN,
    steady: Annotated[
        bool, typer.Option("--steady", help="A steady mean, as the points of a calibration.")
    ] = False,
    standard_error: Annotated[
        float | None, typer.Option(min=0, help="Standard error of the reading, N·m.")
    ] = None,
    speed: Annotated[float | None, typer.Option(help="Speed of the shaft, 1/min.")] = None,
    acceleration: Annotated[
        float | None, typer.Option(help="Acceleration of the shaft, rad/s².")
    ] = None,
    angle: Annotated[float | None, typer.Option(help="Angle of the shaft, °.")] = None,
    window: Annotated[
        float | None, typer.Option(min=0, help="Length of the reading's window, s.")
    ] = None,
    temperature: Annotated[
        float | None, typer.Option(help="Temperature of the transducer, °C.")
    ] = None,
    zero_temperature: Annotated[
        float | None, typer.Option(help="Temperature of the transducer at zeroing, °C.")
    ] = None,
    zero_age: Annotated[
        float | None, typer.Option(min=0, help="Hours since the zero was taken.")
    ] = None,
    age_days: Annotated[
        float | None, typer.Option(min=0, help="Days since the calibration.")
    ] = None,
    averaged: Annotated[
        float, typer.Option(min=1, help="Number of separate loadings in the mean.")
    ] = 1.0,
    reference: ReferenceOption = None,
    span_limit: Annotated[
        float | None, typer.Option(min=0, help="Limit of the span's change, % of torque per 10 K.")
    ] = None,
    zero_limit: Annotated[
        float | None, typer.Option(min=0, help="Limit of the zero's change, % of range per 10 K.")
    ] = None,
    drift: Annotated[
        float | None, typer.Option(min=0, help="Limit of the span's drift, % of torque a year.")
    ] = None,
    zero: Annotated[
        float | None, typer.Option(min=0, help="Standard uncertainty of the zero, N·m.")
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the Monte Carlo check.")] = 0,
    bench: LimitsOption = None,
) -> None:
    """Compute the uncertainty budget of readings by the GUM, checked by Monte Carlo.

    U is the one that `apply`, `measure`, the panel and certificates state for the same reading
    under the same conditions. A condition that isn't given contributes with its possible range.
    Limits given as options replace those in the model's file. Both methods are compared by the
    criterion of JCGM 101, clause 8. If they differ, state the larger of the two intervals.
    """
    import numpy as np

    from torquebench.compensation import load_model

    stored = load_model(model)

    from torquebench.campaign.chains import stated_effects
    from torquebench.chain import readings_of_rows
    from torquebench.cli.chain_words import tell_missing

    chain = chain_of(stored, bench)
    chain = chain.with_effects(
        stated_effects(
            chain,
            stored.provenance.range_nm,
            reference=stated_reference(reference, stored.provenance.range_nm),
            span_percent_per_10k=span_limit,
            zero_percent_per_10k=zero_limit,
            drift_percent_per_year=drift,
            zero_nm=zero,
        )
    )
    rows = {
        "reading_nm": np.array(reading),
        "branch": np.full(len(reading), _SIGNS[branch]),
        "standard_error_nm": standard_error,
        "speed_rpm": speed,
        "acceleration_rad_s2": acceleration,
        "angle_rad": None if angle is None else angle * DEGREE,
        "temperature_c": temperature,
    }
    known = readings_of_rows(
        rows,
        steady=steady,
        window_s=window,
        zero_age_h=zero_age,
        zero_temperature_c=zero_temperature,
    )
    age_h = None if age_days is None else HOURS_PER_DAY * age_days
    torque = chain.torque(replace(known, zero_nm=zero, calibration_age_h=age_h, loadings=averaged))
    freedom = stored.model.scatter_freedom
    for row, value in enumerate(reading):
        checked = torque.check(row, generator=np.random.default_rng(seed))
        say(f"[bold]reading {value:g} N·m, branch {branch.value}[/bold]")
        _print_budget(checked.budget)
        facts = {"reading_nm": value, "branch": branch, "student_degrees_of_freedom": freedom}
        answer(readings=[BUDGETED_READING.of(checked, **facts)])
        (say if checked.agrees else warn)(checked.sentence())
        if not checked.agrees:
            found = checked.monte_carlo
            percent = 100.0 * found.coverage_probability
            say(f"Monte Carlo, {percent:.4g} %: {found.low:.7g} to {found.high:.7g} N·m")
    say(f"k = 2: curve and scatter contain Student's factor for {freedom:.3g} degrees of freedom")
    tell_missing(chain.missing())


def _print_budget(found: Budget) -> None:
    """Print the contributions, the largest first, and the result."""
    table = narrow_table(columns=("|quantity", ">|u N·m", ">|distribution", ">|share"))
    for line in sorted(found.lines, key=lambda each: -each.contribution):
        if line.contribution == 0.0:
            continue
        table.add_row(
            line.name,
            f"{line.contribution:.3g}",
            str(line.distribution),
            f"{100.0 * line.share:.1f} %",
        )
    out().print(table)
    say(
        f"torque {found.value:.7g} N·m, u = {found.standard_uncertainty:.3g} N·m, "
        f"k = {found.coverage_factor():.2f}, "
        f"[bold]U = {found.expanded_uncertainty():.2g} N·m[/bold]"
    )
