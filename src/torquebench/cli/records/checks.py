"""`torquebench records verify`, `review`, `amend`, `use`: integrity, decisions, activation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from torquebench.cli.options import DEFAULT_DATA, DataOption, data_directory, named_values
from torquebench.message import Message
from torquebench.operations.result import Result
from torquebench.reports.page import Block, Facts, Page, Section, Table

__all__ = ["Entered", "amend", "checked_directory", "verify"]

SubjectArgument = Annotated[
    str, typer.Argument(help="A record such as calibration-3, model-2 or certificate-1.")
]


@dataclass(frozen=True)
class Defect:
    """A record that has changed since its entry."""

    kind: str
    where: str
    found: str
    remedy: str


@dataclass(frozen=True, kw_only=True)
class VerifiedRecords(Result):
    """All records and files compared with their entries."""

    intact: bool
    records: int
    runs: int
    files_compared: int
    audit_lines: int
    chain_end: str
    defects: Sequence[Defect]

    @property
    def failed(self) -> bool:
        """Whether a record has changed."""
        return not self.intact

    def page(self) -> Page:
        """Return its description."""
        compared = f"{self.records} records"
        if self.runs or self.files_compared:
            compared += f", {self.runs} run folders and {self.files_compared} files"
        compared += f", {self.audit_lines} lines of the audit log"
        blocks: list[Block] = [Facts([("compared", compared), ("chain end", self.chain_end)])]
        if self.defects:
            rows = [(each.kind, each.where, each.found, each.remedy) for each in self.defects]
            header = ("what", "where", "found", "way back")
            blocks.insert(0, Table(header, rows, words=True))
        return Page("Records compared with their entries", "", [Section("", "", blocks)])


@dataclass(frozen=True, kw_only=True)
class Entered(Result):
    """Entries in the registry."""

    record: str


def verify(
    data: DataOption = DEFAULT_DATA,
    end: Annotated[
        list[str] | None,
        typer.Option(help="An end of the chain noted down earlier (number:hash); repeatable."),
    ] = None,
    files: Annotated[
        bool, typer.Option(help="Also compare run folders and files, which reads all of them.")
    ] = True,
) -> VerifiedRecords:
    """Compare every record and every file with its entry; nothing is written.

    This checks the database with its indexes, tables and triggers, every row by the hash chain,
    every run folder, model and certificate, unregistered folders, and the audit log by its own
    chain. Each defect is listed with its remedy. The exit code is 1 if there is a defect.
    """
    from torquebench.records import anchor_of
    from torquebench.station.data_check import check_data_directory

    anchors = tuple(anchor_of(each) for each in end or ())
    report = check_data_directory(checked_directory(data), anchors=anchors, folders=files)
    count = len(report.findings)
    defects = "1 defect." if count == 1 else Message("{count} defects.", count)
    return VerifiedRecords(
        headline="All are unchanged." if report.intact else defects,
        remarks=report.remarks,
        intact=report.intact,
        records=report.records,
        runs=report.runs,
        files_compared=report.files,
        audit_lines=report.audit_lines,
        chain_end=str(report.head),
        defects=[
            Defect(each.kind, each.place, each.what, each.way_back) for each in report.findings
        ],
    )


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
) -> Entered:
    """Enter a correction of a record. The record itself isn't changed."""
    from torquebench.operations.certificates import subject_of
    from torquebench.records import Registry

    subject, number = subject_of(record)
    fields = named_values(changes, "change", "measured_by=Anna")
    with Registry.open(data_directory(data)) as registry:
        registry.amend(subject, number, fields, amended_by=by, reason=reason)
    return Entered(
        headline=Message(
            "{record} amended: {fields}. The record itself stays as it was.",
            record,
            ", ".join(fields),
        ),
        record=record,
    )
