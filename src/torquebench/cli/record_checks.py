"""`torquebench records verify`, `review` and `amend`: whether records hold, and who says what."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from torquebench.cli.console import narrow_table, out, say
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory
from torquebench.errors import InputError

__all__ = ["register"]

SubjectArgument = Annotated[
    str, typer.Argument(help="A record such as calibration-3, model-2 or certificate-1.")
]

SUBJECTS = {
    "calibration": "calibrations",
    "model": "models",
    "verification": "verifications",
    "check": "checks",
    "certificate": "certificates",
    "adjustment": "adjustments",
    "report": "reports",
    "run": "runs",
}


def register(app: typer.Typer) -> None:
    """Add the commands."""
    app.command("verify")(verify)
    app.command("review")(review)
    app.command("amend")(amend)


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
    """Compare every record with what was entered, along the hash chain, and every file.

    Names table, row and field of what was changed after the fact. Exit code 1 where something is.
    """
    from torquebench.records import Registry, anchor_of, check_records

    anchors = tuple(anchor_of(each) for each in end or ())
    with Registry.open(data_directory(data)) as registry:
        report = check_records(registry, anchors=anchors, folders=files)
    compared = f"{report.records} records"
    if files:
        compared += f", {report.runs} run folders and {report.files} files"
    if report.intact:
        say(f"{compared} are [green]as they were entered[/green]")
        say(f"chain end {report.head}")
        return
    table = narrow_table(f"{len(report.findings)} changed after the fact")
    for heading in ("what", "where", "field", "now", "entered"):
        table.add_column(heading, overflow="fold")
    for finding in report.findings:
        table.add_row(finding.kind, finding.where, finding.field, finding.found, finding.registered)
    out().print(table)
    say(f"{compared} compared, chain end {report.head}")
    raise typer.Exit(CHECK_FAILED)


def review(
    record: SubjectArgument,
    by: Annotated[str, typer.Option(help="Who has checked it: not the one who measured.")],
    remark: Annotated[str, typer.Option(help="What was found.")] = "",
    reject: Annotated[bool, typer.Option("--reject", help="It isn't accepted.")] = False,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Enter who has checked a record."""
    from torquebench.records import Registry

    subject, number = _subject(record)
    with Registry.open(data_directory(data)) as registry:
        registry.review(subject, number, checked_by=by, accepted=not reject, remark=remark)
    say(f"{record} checked by {by}: {'not accepted' if reject else 'accepted'}")


def amend(
    record: SubjectArgument,
    changes: Annotated[
        list[str], typer.Argument(help="field=value: what the record should have said.")
    ],
    by: Annotated[str, typer.Option(help="Who says so.")],
    reason: Annotated[str, typer.Option(help="Why.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Enter what a record should have said. The record itself stays as it was."""
    from torquebench.records import Registry

    subject, number = _subject(record)
    fields = dict(_assignment(each) for each in changes)
    with Registry.open(data_directory(data)) as registry:
        registry.amend(subject, number, fields, amended_by=by, reason=reason)
    say(f"{record} amended: {', '.join(fields)}. The record itself stays as it was.")


def _subject(record: str) -> tuple[Any, int]:
    kind, _, number = record.rpartition("-")
    if kind not in SUBJECTS or not number.isdecimal():
        raise InputError(
            f"record {record!r}",
            ", ".join(f"{name}-NUMBER" for name in SUBJECTS),
            "see `torquebench records list`",
        )
    return SUBJECTS[kind], int(number)


def _assignment(text: str) -> tuple[str, str]:
    name, mark, value = text.partition("=")
    if not mark or not name:
        raise InputError(f"change {text!r}", "field=value", "such as measured_by=Anna")
    return name, value
