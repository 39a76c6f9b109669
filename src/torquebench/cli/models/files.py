"""`torquebench export` and `budget`: export a model's table, and compute budgets."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from dataclasses import field as data_field
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from torquebench import uncertainty
from torquebench.cli.models.commands import LimitsOption, chain_of
from torquebench.cli.options import ReferenceOption, check_output, stated_reference
from torquebench.message import Message
from torquebench.operations.result import HIDDEN, Result
from torquebench.reports.page import Facts, Page, Section, Table
from torquebench.units import DEGREE, HOURS_PER_DAY

__all__ = ["budget", "export"]

ModelArgument = Annotated[Path, typer.Argument(help="A model file that `fit` wrote.")]


class Branch(StrEnum):
    """Branch of a reading."""

    UP = "up"
    DOWN = "down"
    UNKNOWN = "unknown"


_SIGNS = {Branch.UP: 1, Branch.DOWN: -1, Branch.UNKNOWN: 0}


@dataclass(frozen=True, kw_only=True)
class ExportedModel(Result):
    """A model's table for other programs; branch: +1 rising, -1 falling magnitude, 0 unknown."""

    intervals: int
    degree: int
    branch_aware: bool
    low_nm: float
    high_nm: float
    largest_deviation_nm: float
    partial_loops_deviation_nm: float


@dataclass(frozen=True)
class BudgetedReading:
    """The budget of one compensated reading, and the interval of Monte Carlo.

    k is 2: u of curve and scatter contains Student's factor for `student_degrees_of_freedom`.
    """

    reading_nm: float
    branch: str
    student_degrees_of_freedom: float
    torque_nm: float
    standard_uncertainty_nm: float
    coverage_factor: float
    expanded_uncertainty_nm: float
    lines: Sequence[uncertainty.BudgetLine]
    monte_carlo_low_nm: float
    monte_carlo_high_nm: float
    agrees: bool


@dataclass(frozen=True, kw_only=True)
class Budgets(Result):
    """One budget a reading."""

    readings: Sequence[BudgetedReading]
    not_in_u: str
    checks: Sequence[str] = data_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        sections = [_contributions(*each) for each in zip(self.readings, self.checks, strict=True)]
        return Page("Uncertainty budget", self.not_in_u, sections)


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
) -> ExportedModel:
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

    table = compile_table(stored.model, uncertainty=not no_uncertainty)
    export_table(result, table, stored.provenance, decimal_comma=decimal_comma)
    percent = 100.0 * table.bound_nm / table.full_scale_nm
    return ExportedModel(
        headline=Message(
            "{count} {degree} intervals for {branches}; the table deviates from the model by at "
            "most {bound:.2g} N·m ({percent:.1g} % FS).",
            table.curve.intervals,
            {1: "linear", 3: "cubic"}[table.curve.degree],
            "each branch" if table.curve.branch_aware else "any branch",
            table.bound_nm,
            percent,
        ),
        remarks=(
            *("the table is the static curve: temperature, rotation and inertia aren't in it",)
            * MeasuringChain.of(stored).turns,
        ),
        files=(str(result),),
        intervals=table.curve.intervals,
        degree=table.curve.degree,
        branch_aware=table.curve.branch_aware,
        low_nm=table.reading_low_nm,
        high_nm=table.reading_high_nm,
        largest_deviation_nm=table.bound_nm,
        partial_loops_deviation_nm=partial_loop_deviation(table),
    )


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
) -> Budgets:
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
    from torquebench.chain import not_in_u, readings_of_rows

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
    found = [
        torque.check(row, generator=np.random.default_rng(seed)) for row in range(len(reading))
    ]
    return Budgets(
        headline=Message(
            "k = 2: curve and scatter contain Student's factor for {freedom:.3g} degrees of "
            "freedom.",
            freedom,
        ),
        remarks=tuple(each.sentence() for each in found if not each.agrees),
        readings=[
            BudgetedReading(
                reading_nm=value,
                branch=branch.value,
                student_degrees_of_freedom=freedom,
                torque_nm=each.budget.value,
                standard_uncertainty_nm=each.budget.standard_uncertainty,
                coverage_factor=each.budget.coverage_factor(),
                expanded_uncertainty_nm=each.budget.expanded_uncertainty(),
                lines=each.budget.lines,
                monte_carlo_low_nm=each.monte_carlo.low,
                monte_carlo_high_nm=each.monte_carlo.high,
                agrees=each.agrees,
            )
            for value, each in zip(reading, found, strict=True)
        ],
        not_in_u=not_in_u(chain.missing()) or "",
        checks=[each.sentence() for each in found],
    )


def _contributions(reading: BudgetedReading, sentence: str) -> Section:
    """Describe the contributions, the largest first, and the result."""
    rows = [
        (line.name, f"{line.contribution:.3g}", str(line.distribution), f"{100 * line.share:.1f} %")
        for line in sorted(reading.lines, key=lambda each: -each.contribution)
        if line.contribution != 0.0
    ]
    facts = [
        (
            "torque",
            f"{reading.torque_nm:.7g} N·m, u = {reading.standard_uncertainty_nm:.3g} N·m, "
            f"k = {reading.coverage_factor:.2f}, U = {reading.expanded_uncertainty_nm:.2g} N·m",
        ),
        ("check", sentence),
        (
            "Monte Carlo",
            f"{reading.monte_carlo_low_nm:.7g} to {reading.monte_carlo_high_nm:.7g} N·m",
        ),
    ]
    title = f"reading {reading.reading_nm:g} N·m, branch {reading.branch}"
    table = Table(("quantity", "u N·m", "distribution", "share"), rows)
    return Section(title, "", [table, Facts(facts)])
