"""The option `--report`: define it, check the files before, and write them after the work."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.options import check_output
from torquebench.cli.terminal.console import say_file

if TYPE_CHECKING:
    from torquebench.reports.page import Page

__all__ = ["ReportOption", "check_reports", "report_option", "write_reports"]


def report_option(what: str) -> Any:
    """Return an option `--report` with another description than `ReportOption`."""
    return typer.Option(
        "--report", metavar="<path>", help=f"Write {what} (.html or .pdf). May be repeated."
    )


ReportOption = Annotated[list[Path] | None, report_option("a report with figures")]


def check_reports(reports: Sequence[Path] | None) -> None:
    """Raise an error for report files that can't be written, before any work is done."""
    if not reports:
        return
    from torquebench.reports.page_pdf import check_suffix

    for report in reports:
        check_suffix(report)
        check_output(report)


def write_reports(page: Page, reports: Sequence[Path], title: str = "Report") -> None:
    """Write a page to each file, and print the paths."""
    from torquebench.reports.page_pdf import write_report

    for report in reports:
        say_file(title, write_report(page, report))
