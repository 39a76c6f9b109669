"""`torquebench records compare`: two calibrations of one transducer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape

from torquebench.cli.answers import CALIBRATION_STEP, COMPARED_CALIBRATIONS
from torquebench.cli.options import (
    CSV_ENDINGS,
    DEFAULT_DATA,
    DataOption,
    check_output,
    data_directory,
    numbered,
)
from torquebench.cli.reports import check_reports, report_option, write_reports
from torquebench.cli.terminal.console import answer, narrow_table, out, say, say_file, warn
from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.campaign.calibration_comparison import CalibrationComparison

__all__ = ["compare"]


def compare(
    first: Annotated[str, typer.Argument(help="A calibration, such as `calibration-2`.")],
    second: Annotated[str, typer.Argument(help="Another one of the same transducer.")],
    report: Annotated[list[Path] | None, report_option("a page with figures")] = None,
    result: Annotated[Path | None, typer.Option("--out", help="Write the steps as CSV.")] = None,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Compare two calibrations of one transducer, step by step.

    A change is significant if it exceeds the uncertainties of both calibrations (E_n beyond ±1).
    Only the common range of torques is compared.
    """
    from torquebench.records import Registry

    check_reports(report)
    if result is not None:
        check_output(result, endings=CSV_ENDINGS)
    numbers = [_number(name) for name in (first, second)]

    from torquebench.campaign.calibration_comparison import compare_calibrations

    with Registry.open(data_directory(data)) as registry:
        found = compare_calibrations(registry, *numbers)
    _print(found)
    steps = [CALIBRATION_STEP.of(step) for step in found.steps]
    answer(**COMPARED_CALIBRATIONS.of(found, steps=steps))
    if result is not None:
        _write(found, result)
        say_file("Steps", result)
    if report:
        from torquebench.reports.calibration_comparison import calibration_comparison_page

        page = calibration_comparison_page(found)
        write_reports(page, report)


def _number(name: str) -> int:
    named = numbered(name, "calibration", "")
    if named is None:
        raise InputError(
            Message("a calibration {name!r}", name),
            "a name such as calibration-2",
            "torquebench records list calibrations",
        )
    return named[1]


def _print(found: CalibrationComparison) -> None:
    from torquebench.reports.calibration_comparison import BRANCHES
    from torquebench.uncertainty import stated

    said = " - simulated" if found.simulated else ""
    title = f"{found.before.name} and {found.after.name}, transducer "
    say(f"[bold]{title}{escape(found.after.entry.transducer_serial)}{said}[/bold]")
    table = narrow_table(
        "Additional torque, N·m",
        columns=(">|reading", "|", ">|before", ">|after", ">|change", ">|U", ">|E_n", "|"),
        caption="U of the change, k = 2; E_n = change/U",
    )
    for step in found.steps:
        table.add_row(
            f"{step.reading_nm:.5g}",
            BRANCHES[step.branch],
            stated(step.before_nm, step.expanded_uncertainty_nm)[0],
            stated(step.after_nm, step.expanded_uncertainty_nm)[0],
            *stated(step.change_nm, step.expanded_uncertainty_nm),
            f"{step.normalised_error:+.2f}",
            "[yellow]changed[/yellow]" if step.significant else "",
        )
    out().print(table)
    for remark in found.remarks:
        warn(remark)
    say(f"[bold]{escape(found.verdict())}[/bold]")


def _write(found: CalibrationComparison, path: Path) -> None:
    from torquebench.atomic_write import atomic_write

    lines = [f"# before = {found.before.name}", f"# after = {found.after.name}"]
    lines += ["# simulated = true"] * found.simulated
    lines.append("reading_nm,branch,before_nm,after_nm,change_nm,expanded_uncertainty_nm,e_n")
    lines += [
        f"{step.reading_nm!r},{step.branch},{step.before_nm!r},{step.after_nm!r},"
        f"{step.change_nm!r},{step.expanded_uncertainty_nm!r},{step.normalised_error!r}"
        for step in found.steps
    ]
    atomic_write(path, ("\n".join(lines) + "\n").encode())
