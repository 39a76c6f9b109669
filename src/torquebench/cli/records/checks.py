"""`torquebench records verify`, `review`, `amend`, `use`: integrity, decisions, activation."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from torquebench.cli.answers import DEFECT, RECORDS_VERIFIED
from torquebench.cli.failure import CHECK_FAILED
from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory, named_values, numbered
from torquebench.cli.terminal.console import answer, narrow_table, out, say, warn
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["amend", "checked_directory", "review", "use", "verify"]

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
    chain. Each defect is named with its remedy. Exit code 1 if there is one.
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
        There is neither.
    """
    from torquebench.station.data_check import run_folders

    return data if run_folders(data) else data_directory(data)


def review(
    record: SubjectArgument,
    by: Annotated[str, typer.Option(help="Person who reviewed it; not the person who measured.")],
    remark: Annotated[str, typer.Option(help="What was found.")] = "",
    reject: Annotated[bool, typer.Option("--reject", help="It isn't accepted.")] = False,
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Enter the review of a record."""
    from torquebench.records import Registry
    from torquebench.records.signatures import how, present_signature

    subject, number = _subject(record)
    with Registry.open(data_directory(data)) as registry:
        registry.review(subject, number, checked_by=by, accepted=not reject, remark=remark)
    say(f"{record} checked by {by}: {'not accepted' if reject else 'accepted'}")
    say(how(present_signature()))
    answer(record=record)


def amend(
    record: SubjectArgument,
    changes: Annotated[list[str], typer.Argument(help="field=value: the corrected value.")],
    by: Annotated[str, typer.Option(help="Who says so.")],
    reason: Annotated[str, typer.Option(help="Why.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Enter a correction of a record. The record itself isn't changed."""
    from torquebench.records import Registry

    subject, number = _subject(record)
    fields = named_values(changes, "change", "measured_by=Anna")
    with Registry.open(data_directory(data)) as registry:
        registry.amend(subject, number, fields, amended_by=by, reason=reason)
    answer(record=record)
    say(f"{record} amended: {', '.join(fields)}. The record itself stays as it was.")


def _subject(record: str) -> tuple[Any, int]:
    named = numbered(record, *SUBJECTS)
    if named is None:
        raise InputError(
            Message("record {record!r}", record),
            ", ".join(f"{name}-NUMBER" for name in SUBJECTS),
            "see `torquebench records list`",
        )
    return SUBJECTS[named[0]], named[1]


def use(
    model: Annotated[str, typer.Argument(help="A model such as model-14.")],
    by: Annotated[str, typer.Option(metavar="NAME", help="Who decides it.")],
    reason: Annotated[str, typer.Option(metavar="WHY", help="Reason, for the record.")],
    data: DataOption = DEFAULT_DATA,
) -> None:
    """Put a model into use for its transducer and counter, with a name and a reason.

    `calibrate` doesn't put a model into use whose calibration contradicts itself; this command
    overrides that, and the registry stores name and reason.
    """
    from torquebench.records import Registry
    from torquebench.records.signatures import how, present_signature

    named = numbered(model, "model")
    if named is None:
        raise InputError(
            Message("{model!r}", model), "a model such as model-14", "see `records list models`"
        )
    for value, option in ((by, "--by NAME"), (reason, "--reason WHY")):
        if not value.strip():
            raise InputError(
                Message("an empty {split}", option.split()[0]), "a name and a reason", option
            )
    with Registry.open(data_directory(data)) as registry:
        entry = registry.model(named[1])
        entry.check_file()
        for contradiction in entry.contradictions:
            warn(str(contradiction))
        registry.activate(entry.model_id, operator=by, reason=reason, despite_contradictions=True)
    answer(record=model)
    say(f"In use: {model} of calibration-{entry.calibration_id}, by {by}: {reason}")
    say(how(present_signature()))
