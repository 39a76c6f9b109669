"""Tables of errors within 80 columns: N·m, % of full scale and % of reading side by side."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from torquebench.cli.terminal.console import narrow_table, out, say
from torquebench.reports.errors_table import number

if TYPE_CHECKING:
    from torquebench.calibration import CalibrationData, ErrorSummary, VerificationResult
    from torquebench.chain import Effect, Torque
    from torquebench.compensation import Comparison

__all__ = [
    "cells_table",
    "comparison_table",
    "effects_table",
    "error_blocks",
    "print_kept",
    "print_verification",
]

NAME_COLUMNS = 29
NUMBER_COLUMNS = 7


def _grid() -> Table:
    table = Table.grid(padding=(0, 1, 0, 0))
    table.add_column(width=NAME_COLUMNS, no_wrap=True)
    for _ in range(6):
        table.add_column(width=NUMBER_COLUMNS, justify="right", no_wrap=True)
    return table


def _numbers(summary: ErrorSummary) -> list[str]:
    values = (
        summary.worst_nm,
        summary.rms_nm,
        summary.worst_percent_fs,
        summary.rms_percent_fs,
        summary.worst_percent_reading,
        summary.rms_percent_reading,
    )
    return [_narrow(value) for value in values]


def _narrow(value: float | None) -> str:
    """Return a number with as many digits as fit into its column."""
    texts = (number(value, digits) for digits in (3, 2, 1))
    return next((text for text in texts if len(text) <= NUMBER_COLUMNS), "0.000")


def error_blocks(
    blocks: Iterable[tuple[str, Sequence[tuple[str, ErrorSummary]]]],
) -> Iterable[RenderableType]:
    """Yield blocks of errors below a common heading.

    Parameters
    ----------
    blocks : iterable of (title, rows)
        Each row is a name and its errors; a name that begins with an asterisk is emphasised.
    """
    head = _grid()
    head.add_row("", *(Text(text, style="bold") for text in ("worst", "RMS") * 3))
    units = ("N·m", "N·m", "% FS", "% FS", "% rdg", "% rdg")
    head.add_row("", *(Text(text, style="dim") for text in units))
    yield head
    for title, rows in blocks:
        if not rows:
            continue
        yield Text(title, style="italic")
        body = _grid()
        for name, summary in rows:
            chosen = name.startswith("*")
            style = "bold green" if chosen else ""
            label = f"{'*' if chosen else ' '} {name.removeprefix('*')}"
            body.add_row(label, *_numbers(summary), style=style)
        yield body


def print_verification(result: VerificationResult, titles: Sequence[str]) -> None:
    """Print a verification's errors of the raw reading and of each model.

    The first model is marked.
    """
    simulated = " - simulated" if result.simulated else ""
    groups = f"{result.groups} group{'s' if result.groups > 1 else ''}"
    say(
        f"[bold]{result.points} readings in {groups}, range {result.range_nm:g} N·m"
        f"{simulated}[/bold]"
    )
    first, *others = titles
    rows = list(zip(("raw reading", f"*{first}", *others), result.models, strict=True))
    blocks = [
        (words, [(name, getattr(each, field)) for name, each in rows if getattr(each, field)])
        for words, field in (
            ("against the standard", "against_standard"),
            ("against the true torque", "against_truth"),
            ("averaged over the groups", "averaged"),
        )
    ]
    for part in error_blocks(blocks):
        out().print(part)


def print_kept(what: str, percent: float, tolerance: float) -> bool:
    """Print and return whether a value is within its tolerance, both in % of full scale."""
    kept = percent <= tolerance
    verdict = "[green]within[/green]" if kept else "[red]out of[/red]"
    say(f"{what} {number(percent)} % FS: {verdict} the tolerance of {tolerance:g} % FS")
    return kept


def comparison_table(comparison: Comparison, taken: str) -> Table:
    """Return a table of the models' errors at steps that they weren't fitted to.

    Parameters
    ----------
    comparison : Comparison
    taken : str
        Name of the model to mark.
    """
    table = narrow_table(
        columns=(
            "|model",
            ">|worst N·m",
            ">|RMS N·m",
            ">|worst % FS",
            ">|RMS % FS",
            ">|param.",
            ">|fit s",
        ),
        caption=f"errors at steps left out ({comparison.folds} folds, {comparison.points} points, "
        f"{comparison.steps} steps)",
    )
    for score in comparison.scores:
        chosen = score.name == taken
        table.add_row(
            f"{'*' if chosen else ' '} {score.name}",
            number(score.worst_nm),
            number(score.rms_nm),
            number(score.worst_percent_fs),
            number(score.rms_percent_fs),
            f"{score.effective_parameters:.1f}",
            f"{score.fit_time_s:.2f}",
            style="bold green" if chosen else "",
        )
    return table


def effects_table(effects: Sequence[Effect], range_nm: float) -> RenderableType:
    """Return a table of a rotating chain's identified effects: largest value and U of each."""
    table = narrow_table(
        "identified, largest where it was measured, % FS",
        columns=("|effect", ">|value", ">|± (k = 2)", ">|measured"),
    )
    for effect in effects:
        for part in effect.identified(range_nm):
            u = f"{part.u_percent:.2g}"
            table.add_row(part.name, f"{part.percent:.3g}", u, part.measured)
    return table


def cells_table(points: CalibrationData, torque: Torque) -> RenderableType:
    """Return a table of errors and coverage of U in cells of speed, temperature and torque."""
    from torquebench.calibration import cell_rows

    table = narrow_table(
        "error in % FS and coverage of U (k = 2), by speed, temperature, torque",
        columns=(">|1/min", ">|°C", ">|% of range", ">|points", ">|RMS", ">|worst", ">|covered"),
    )
    for row in cell_rows(points, torque):
        table.add_row(*row)
    return table
