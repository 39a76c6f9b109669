"""`torquebench records verify`, `review`, `amend`, `use`: integrity, decisions, activation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from torquebench.cli.answers import DEFECT, RECORDS_VERIFIED
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory, named_values
from torquebench.cli.terminal.console import answer, narrow_table, out, say, warn

__all__ = ["amend", "checked_directory", "verify"]

SubjectArgument = Annotated[
    str, typer.Argument(help="A record such as calibration-3, model-2 or certificate-1.")
]


def verify(
    data: DataOption = DEFAULT_DATA,
    end: Annotated[
        list[str] | None,
        typer.Option(help="An end of the chain noted down earlier (number:hash); repeatable."),
    ] = None,
    files: Annotated[
        bool, typer.Option(help="Also compare run folders and files, which reads all of them.")
    ] = True,
) -> None:
    """Compare every record and every file with its entry; nothing is written.

    This checks the database with its indexes, tables and triggers, every row by the hash chain,
    every run folder, model and certificate, unregistered folders, and the audit log by its own
    chain. Each defect is listed with its remedy. The exit code is 1 if there is a defect.
    """
    from torquebench.records import anchor_of
    from torquebench.station.data_check import check_data_directory

    anchors = tuple(anchor_of(each) for each in end or ())
    report = check_data_directory(checked_directory(data), anchors=anchors, folders=files)
    compared = f"{report.records} records"
    if files:
        compared += f", {report.runs} run folders and {report.files} files"
    compared += f", {report.audit_lines} lines of the audit log"
    for remark in report.remarks:
        warn(remark)
    defects = [DEFECT.of(each) for each in report.findings]
    answer(**RECORDS_VERIFIED.of(report, defects=defects))
    if report.intact:
        say(compared)
        say("All are [green]unchanged[/green].")
        say(f"chain end {report.head}")
        return
    count = len(report.findings)
    table = narrow_table(
        f"{count} defect{'s' if count > 1 else ''}", columns=("what", "where", "found", "way back")
    )
    for finding in report.findings:
        table.add_row(finding.kind, finding.place, finding.what, finding.way_back)
    out().print(table)
    say(f"{compared} compared, chain end {report.head}")
    raise typer.Exit(CHECK_FAILED)


def checked_directory(data: Path) -> Path:
    """Return a data directory with a registry, or with runs whose registry is lost.

    Raises
    ------
    InputError
        The directory has neither a registry nor runs.
    """
    from torquebench.station.data_check import run_folders

    return data if run_folders(data) else data_directory(data)


def amend(
    record: SubjectArgument,
    changes: Annotated[list[str], typer.Argument(help="field=value: the corrected value.")],
    by: Annotated[str, typer.Option(help="Who says so.")],
    reason: Annotated[str, typer.Option(help="Why.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Enter a correction of a record. The record itself isn't changed."""
    from torquebench.operations.certificates import subject_of
    from torquebench.records import Registry

    subject, number = subject_of(record)
    fields = named_values(changes, "change", "measured_by=Anna")
    with Registry.open(data_directory(data)) as registry:
        registry.amend(subject, number, fields, amended_by=by, reason=reason)
    answer(record=record)
    say(f"{record} amended: {', '.join(fields)}. The record itself stays as it was.")
