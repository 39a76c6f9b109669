"""`torquebench records drift`: control charts of one transducer, and its due date."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING, Annotated

import typer
from rich.text import Text

from torquebench.cli.answers import CHART
from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory
from torquebench.cli.terminal.console import answer, narrow_table, out, say, warn
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.campaign.drifting import DriftSeries

__all__ = ["drift"]


def drift(
    serial: Annotated[str, typer.Argument(help="Serial number of the transducer.")],
    tolerance: Annotated[
        float,
        typer.Option(min=1e-6, help="Tolerance of the span's drift, in % (zero: % of range)."),
    ] = 0.1,
    base: Annotated[
        int | None,
        typer.Option(min=3, help="Number of first values from which the limits are computed."),
    ] = None,
    longest_days: Annotated[
        int, typer.Option(min=1, help="Longest time between two calibrations.")
    ] = 365,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Show the drift of a transducer over calibrations, zeroings and checks, and its due date.

    Control chart of single values with the limits of the moving range, Mann-Kendall trend test, and
    a line with its prediction interval up to the tolerance.
    """
    from torquebench.campaign.drifting import drift_of, next_due
    from torquebench.records import Registry

    with Registry.open(data_directory(data)) as registry:
        if serial not in {each.serial for each in registry.equipment("transducer")}:
            known = ", ".join(each.serial for each in registry.equipment("transducer"))
            raise InputError(
                Message("transducer {serial!r}", serial), known or "a registered transducer"
            )
        found = drift_of(
            registry,
            serial,
            tolerance_percent=tolerance,
            base=base,
            models=registry.models(serial),
        )
    if not found:
        raise InputError(
            Message("no calibration and no zeroing of transducer {serial}", serial),
            "at least one",
            "torquebench calibrate",
        )
    for series in found:
        _print_series(series)
    due = next_due(found, longest_days=longest_days)
    answer(transducer=serial, charts=[CHART.of(series) for series in found], due=due)
    if due is not None:
        say(f"[bold]Calibrate again by {due.isoformat()}[/bold]")


def _print_series(series: DriftSeries) -> None:
    chart = series.chart
    simulated = " - simulated" if series.simulated else ""
    out().print(Text(f"{series.title}, {series.unit}{simulated}", style="bold"))
    table = narrow_table(columns=("|when (UTC)", ">value", ">moving range", ""))
    for row, (moment, value) in enumerate(zip(series.moments, series.values, strict=True)):
        moving = f"{abs(value - series.values[row - 1]):.4f}" if row else ""
        table.add_row(f"{moment:%Y-%m-%d %H:%M}", f"{value:+.4f}", moving, series.remark(row))
    out().print(table)
    if chart is None:
        say("fewer than 3 values: no control chart yet")
        out().print()
        return
    say(
        f"mean {chart.centre:+.4f}, limits {chart.lower:+.4f} to {chart.upper:+.4f}, "
        f"moving range up to {chart.moving_range_upper:.4f}"
    )
    if not chart.in_control:
        warn(f"{series.title}: not in control; look for the reason before you go on")
    trend = series.trend
    if trend is not None:
        words = "a trend" if trend.significant else "no trend"
        say(
            f"{words}: {trend.per_year:+.3g} {series.unit} a year "
            f"(Mann-Kendall τ = {trend.tau:.2f}, p = {trend.p_value:.2g})"
        )
    prediction = series.prediction
    if prediction is not None:
        say(
            f"leaves ±{series.tolerance:g} {series.unit}: expected {_day(prediction.expected)}, "
            f"earliest {_day(prediction.earliest)}, latest {_day(prediction.latest)} "
            f"({100 * prediction.level:.0f} % interval)"
        )
    out().print()


def _day(moment: datetime | None) -> str:
    return "not within ten years" if moment is None else f"{moment:%Y-%m-%d}"
