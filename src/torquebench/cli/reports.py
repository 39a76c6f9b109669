"""Results and reports of commands: terminal, JSON, files and exit code follow from one result."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from torquebench.cli.options import check_output
from torquebench.cli.terminal.console import answer, print_file, say_file, warn
from torquebench.operations.result import Result

if TYPE_CHECKING:
    from torquebench.reports.page import Page

ReportOption = Annotated[
    list[Path] | None,
    typer.Option(
        "--report",
        metavar="<path>",
        help="Write a report with figures (.html or .pdf). May be repeated.",
    ),
]


@dataclasses.dataclass(frozen=True, kw_only=True)
class Told(Result):
    """Result that its command prints while it works."""


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


def present(result: Result, reports: Iterable[Path] | None = None) -> None:
    """Print a result, write its reports, and end with exit code 1 if it failed."""
    from torquebench.cli.failure import CHECK_FAILED

    answer(**result.plain())
    if not isinstance(result, Told):
        _print(result)
    if reports:
        from torquebench.reports.page import Facts, Section

        page = result.page()
        remarks = Section("Remarks", "", [Facts([("", each) for each in result.remarks])])
        sections = [*page.sections, *[remarks] * bool(result.remarks)]
        write_reports(dataclasses.replace(page, sections=sections), list(reports))
    if result.failed:
        raise typer.Exit(CHECK_FAILED)


def _print(result: Result) -> None:
    from torquebench.cli.terminal.page import print_page, print_verdict

    page = result.page()
    print_page(page)
    if result.verdict or (result.headline and page.title != result.headline):
        print_verdict(result)
    for remark in result.remarks:
        warn(remark)
    for file in result.files:
        print_file("File", file)
