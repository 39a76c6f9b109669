"""Compare two registered calibrations, and evaluate a transducer's drift over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from datetime import date, datetime
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from torquebench import campaign
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.operation import WHOLE, Calibration, Number, Operation, Request, field
from torquebench.operations.place import Place
from torquebench.operations.records import find_calibration
from torquebench.operations.result import HIDDEN, Numbers, Result
from torquebench.progress import Progress
from torquebench.reports.page import Block, Diagram, Facts, Page, Section, Table
from torquebench.units import DAY

# -- compare --------------------------------------------------------------------------------


class CompareRequest(Request):
    """Compare two calibrations of one transducer, step by step.

    A change is significant if it exceeds the uncertainties of both calibrations (E_n beyond ±1).
    Only the common range of torques is compared.
    """

    first: Calibration
    second: Calibration
    out: Annotated[
        Path | None, field("Write the steps as CSV.", local=True, output=(".csv", ".txt", ".tsv"))
    ] = None


@dataclass(frozen=True, kw_only=True)
class ComparedCalibrations(Result):
    """Comparison of two calibrations of one transducer, in order of time."""

    before: str
    after: str
    transducer_serial: str
    low_nm: float
    high_nm: float
    steps: Sequence[campaign.CalibrationStep]
    comparison: Any = dataclass_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        from torquebench.reports.calibration_comparison import calibration_comparison_page

        return calibration_comparison_page(self.comparison)


def run_compare(place: Place, request: CompareRequest, _progress: Progress) -> ComparedCalibrations:
    """Compare the calibrations, and write the steps if a file is named."""
    from torquebench.campaign.calibration_comparison import compare_calibrations

    names = (request.first, request.second)
    entries = [find_calibration(place.registry, name) for name in names]
    found = compare_calibrations(place.registry, *(each.calibration_id for each in entries))
    if request.out is not None:
        _write_steps(found, request.out)
    return ComparedCalibrations(
        headline=Message("{verdict}.", found.verdict()),
        simulated=found.simulated,
        run_ids=tuple(
            str(each.entry.run_id) for each in (found.before, found.after) if each.entry.run_id
        ),
        remarks=found.remarks,
        before=found.before.name,
        after=found.after.name,
        transducer_serial=found.after.entry.transducer_serial,
        low_nm=found.low_nm,
        high_nm=found.high_nm,
        steps=found.steps,
        comparison=found,
    )


def _write_steps(found: campaign.CalibrationComparison, path: Path) -> None:
    from dataclasses import astuple

    from torquebench.atomic_write import atomic_write

    lines = [f"# before = {found.before.name}", f"# after = {found.after.name}"]
    lines += ["# simulated = true"] * found.simulated
    lines.append("reading_nm,branch,before_nm,after_nm,change_nm,expanded_uncertainty_nm,e_n")
    lines += [",".join(map(repr, astuple(step))) for step in found.steps]
    atomic_write(path, ("\n".join(lines) + "\n").encode())


COMPARE = Operation(
    "records compare",
    CompareRequest,
    run_compare,
    lambda request: Message("Compare {first} with {second}", request.first, request.second),
    quick=True,
)


# -- drift ----------------------------------------------------------------------------------


class DriftRequest(Request):
    """Show the drift of a transducer over calibrations, zeroings and checks, and its due date.

    Control chart of single values with the limits of the moving range, Mann-Kendall trend test, and
    a line with its prediction interval up to the tolerance.
    """

    basic = ("serial", "tolerance_percent", "longest_days")

    serial: Annotated[str, field("Serial number of the transducer.", argument=True, max_length=200)]
    tolerance_percent: Annotated[
        Number, field("Tolerance of the span's drift (zero: % of range).", ge=1e-6, le=100)
    ] = 0.1
    base: Annotated[
        Annotated[int, Field(ge=3, le=100_000), WHOLE] | None,
        field("Number of first values from which the limits are computed."),
    ] = None
    longest_days: Annotated[
        int, field("Longest time between two calibrations, days.", ge=1, le=100_000), WHOLE
    ] = 365


@dataclass(frozen=True)
class DriftChart:
    """One quantity of a transducer over time; statistics are null if there are too few values."""

    title: str
    unit: str
    simulated: bool
    moments: Sequence[datetime]
    values: Numbers
    remarks: Sequence[str]
    tolerance: float
    mean: float | None
    lower: float | None
    upper: float | None
    in_control: bool | None
    per_year: float | None
    significant: bool | None
    leaves_tolerance: datetime | None


@dataclass(frozen=True, kw_only=True)
class DriftResult(Result):
    """Control charts of one transducer, and the day by which it is due for calibration."""

    transducer_serial: str
    due: date | None
    charts: Sequence[DriftChart]
    series: Any = dataclass_field(metadata=HIDDEN)

    def page(self) -> Page:
        """Return its description."""
        title = Message("Drift of transducer {serial}", self.transducer_serial)
        sections = [
            Section(Message("{title}, {unit}", each.title, each.unit), "", _drift_blocks(each))
            for each in self.series
        ]
        return Page(title, "", sections, simulated=self.simulated)


def _drift_blocks(series: campaign.DriftSeries) -> list[Block]:
    import numpy as np

    from torquebench.figures import Curve
    from torquebench.reports.curve_figures import Panel

    chart, trend, prediction = series.chart, series.trend, series.prediction
    rows = [
        (
            f"{moment:%Y-%m-%d %H:%M}",
            f"{value:+.4f}",
            f"{abs(value - series.values[row - 1]):.4f}" if row else "",
            series.remark(row),
        )
        for row, (moment, value) in enumerate(zip(series.moments, series.values, strict=True))
    ]
    blocks: list[Block] = [Table(("when (UTC)", "value", "moving range", ""), rows)]
    if chart is None:
        return [*blocks, Facts([("Control chart", "fewer than 3 values: none yet")])]
    limits = Message(
        "mean {mean:+.4f}, limits {lower:+.4f} to {upper:+.4f}, moving range up to {moving:.4f}",
        chart.centre,
        chart.lower,
        chart.upper,
        chart.moving_range_upper,
    )
    facts = [("Control chart", limits)]
    if trend is not None:
        words = Message(
            "{what}: {slope:+.3g} {unit} a year (Mann-Kendall τ = {tau:.2f}, p = {p:.2g})",
            "a trend" if trend.significant else "no trend",
            trend.per_year,
            series.unit,
            trend.tau,
            trend.p_value,
        )
        facts.append(("Trend", words))
    if prediction is not None:
        words = Message(
            "leaves ±{tolerance:g} {unit}: expected {expected}, earliest {earliest}, latest "
            "{latest} ({level:.0f} % interval)",
            series.tolerance,
            series.unit,
            _day(prediction.expected),
            _day(prediction.earliest),
            _day(prediction.latest),
            100 * prediction.level,
        )
        facts.append(("Prediction", words))
    days = [(each - series.moments[0]).total_seconds() / DAY for each in series.moments]
    panel = Panel(
        [Curve("", np.array(days), np.array(series.values))],
        Message("days since {day:%Y-%m-%d}", series.moments[0]),
        series.unit,
        markers=True,
        limits=(chart.lower, chart.upper),
    )
    return [*blocks, Facts(facts), Diagram([panel], series.title, height=2.2)]


def _day(moment: datetime | None) -> str:
    return "not within ten years" if moment is None else f"{moment:%Y-%m-%d}"


def run_drift(place: Place, request: DriftRequest, _progress: Progress) -> DriftResult:
    """Evaluate all values of a transducer over time."""
    from torquebench.campaign.drifting import drift_of, next_due

    registry, serial = place.registry, request.serial
    known = [each.serial for each in registry.equipment("transducer")]
    if serial not in known:
        raise InputError(
            Message("transducer {serial!r}", serial),
            ", ".join(known) or "a registered transducer",
        )
    found = drift_of(
        registry,
        serial,
        tolerance_percent=request.tolerance_percent,
        base=request.base,
        models=registry.models(serial),
    )
    if not found:
        raise InputError(
            Message("no calibration and no zeroing of transducer {serial}", serial),
            "at least one",
            "torquebench calibrate",
        )
    due = next_due(found, longest_days=request.longest_days)
    outside = [each for each in found if each.chart is not None and not each.chart.in_control]
    return DriftResult(
        headline="Never calibrated."
        if due is None
        else Message("Calibrate again by {day:%Y-%m-%d}.", due),
        simulated=any(each.simulated for each in found),
        remarks=tuple(
            Message("{title}: not in control; find the reason before you continue", each.title)
            for each in outside
        ),
        transducer_serial=serial,
        due=due,
        charts=[_chart(each) for each in found],
        series=found,
    )


def _chart(series: campaign.DriftSeries) -> DriftChart:
    chart, trend, prediction = series.chart, series.trend, series.prediction
    return DriftChart(
        title=series.title,
        unit=series.unit,
        simulated=series.simulated,
        moments=series.moments,
        values=series.values,
        remarks=[series.remark(row) for row in range(len(series.values))],
        tolerance=series.tolerance,
        mean=None if chart is None else chart.centre,
        lower=None if chart is None else chart.lower,
        upper=None if chart is None else chart.upper,
        in_control=None if chart is None else chart.in_control,
        per_year=None if trend is None else trend.per_year,
        significant=None if trend is None else trend.significant,
        leaves_tolerance=None if prediction is None else prediction.expected,
    )


DRIFT = Operation(
    "records drift",
    DriftRequest,
    run_drift,
    lambda request: Message("Drift of {serial}", request.serial),
    quick=True,
)
