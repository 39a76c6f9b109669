"""Check the integrity of all records: hash chain, rows, model files, run folders."""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sqlalchemy import Select, Table, inspect, select
from sqlalchemy.orm import Session

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records.chain import ChainHead, Link, broken_links, canonical, changed_fields
from torquebench.records.files import UNREADABLE, sha256_of_file
from torquebench.records.registry.database import Database
from torquebench.records.registry.entries import Amendment, archived_at, links, metadata
from torquebench.records.registry.runs import REBUILT, RunRecords
from torquebench.records.runs.folder import MANIFEST, RunFolder

calibrations, certificates, equipment, models, reports, run_ends, runs = (
    metadata.tables[name]
    for name in (
        *("calibrations", "certificates", "equipment", "models", "reports"),
        *("run_ends", "runs"),
    )
)

FindingKind = Literal[
    "changed",
    "removed",
    "added",
    "chain",
    "file",
    "anchor",
    "database",
    "schema",
    "registry",
    "orphan",
    "audit",
]
FROM_BACKUP = "`torquebench records restore BACKUP`"
_REMEDIES: dict[str, str] = {
    "changed": f"{FROM_BACKUP}, or `torquebench records amend` enters the correct value",
    "file": f"{FROM_BACKUP} brings the file back as it was",
}


@dataclass(frozen=True)
class Finding:
    """One difference between a record and its entry in the chain.

    Parameters
    ----------
    kind : str
        What happened: a field was changed, a row removed, a row added without the registry, the
        chain itself changed, a file differs, the chain lacks a link that was noted elsewhere; the
        database is damaged, its schema differs, the registry is missing, a run's folder isn't
        registered, or the audit log was changed.
    where : str
        Table and number of the row, or the path of the file.
    field : str
        Name of the field; empty if unknown.
    found, registered : str
        The present value, and the value when it was entered.
    remedy : str
        How to repair it; by default the remedy for its kind.
    """

    kind: FindingKind
    where: str
    field: str = ""
    found: str = ""
    registered: str = ""
    remedy: str = ""

    @property
    def way_back(self) -> str:
        """How to repair the finding."""
        return self.remedy or _REMEDIES.get(self.kind, FROM_BACKUP)

    @property
    def place(self) -> str:
        """Table and row, or file, with the field if known."""
        return f"{self.where}, {self.field}" if self.field else self.where

    @property
    def what(self) -> str:
        """Description of the difference."""
        match self.kind:
            case "changed" if self.field:
                return f"{self.found} instead of {self.registered}"
            case "removed":
                return "removed after it was entered"
            case "added":
                return "added past the registry"
        return self.found

    def __str__(self) -> str:
        return f"{self.place}: {self.what}"


@dataclass(frozen=True)
class IntegrityReport:
    """Result of a check of all records.

    Parameters
    ----------
    head : ChainHead
        The end of the chain.
    records, runs, files : int
        Numbers of compared rows, sealed run folders and single files.
    findings : tuple of Finding
        Empty if all records match their entries.
    audit_lines : int
        Number of compared lines of the audit log.
    remarks : tuple of str
        Doubts about unchanged records: clocks that were set back, standards whose certificate had
        expired.
    """

    head: ChainHead
    records: int
    runs: int
    files: int
    findings: tuple[Finding, ...]
    audit_lines: int = 0
    remarks: tuple[str, ...] = ()

    @property
    def intact(self) -> bool:
        """Whether there are no findings."""
        return not self.findings


def anchor_of(text: str) -> ChainHead:
    """Parse the end of a chain, written as ``number:hash``.

    Raises
    ------
    InputError
        Where the text has another form.

    Examples
    --------
    >>> anchor_of("3:" + "ab" * 32).sequence
    3
    """
    number, _, digest = text.strip().partition(":")
    hexadecimal = len(digest) == 64 and all(mark in "0123456789abcdef" for mark in digest)
    if not (number.isdecimal() and hexadecimal):
        raise InputError(
            Message("chain end {text!r}", text),
            "a number, a colon and 64 hexadecimal digits",
            "copy it whole",
        )
    return ChainHead(int(number), digest)


def check_records(
    registry: RunRecords, *, anchors: tuple[ChainHead, ...] = (), folders: bool = True
) -> IntegrityReport:
    """Compare every record with its entry in the hash chain.

    Parameters
    ----------
    registry : Database
        The open registry.
    anchors : tuple of ChainHead
        Ends of the chain that were noted earlier, for instance on a certificate. A chain that was
        rewritten doesn't contain them.
    folders : bool, default True
        Whether run folders and files are compared too, which reads all of them.
    """
    check = _Check(registry)
    findings = [*survived("chain", check.chain()), *check.rows()]
    compared_runs = 0
    if folders:
        for found in check.runs():
            compared_runs += 1
            findings += found
        findings += survived("files", check.single_files())
    findings += check.anchored(anchors)
    return IntegrityReport(
        registry.head(), check.compared, compared_runs, check.files, tuple(dict.fromkeys(findings))
    )


class _Check:
    """One check of a registry."""

    def __init__(self, registry: RunRecords) -> None:
        self.registry = registry
        problems: list[str] = []
        amendments = registry.entries(Amendment, subject=REBUILT, problems=problems)
        self.entered_again = {
            run
            for each in amendments
            if isinstance(each.changes, dict)
            for run in each.changes.get("runs", ())
        }
        self.files = 0
        self.compared = 0
        self.links = registry.links()
        self.anchors: list[tuple[ChainHead, str]] = []

    def chain(self) -> Iterator[Finding]:
        for link, what in broken_links(self.links):
            yield Finding("chain", f"{link.table} {link.key}", found=what)

    def rows(self) -> Iterator[Finding]:
        registered: dict[str, dict[int, Link]] = {}
        for link in self.links:
            registered.setdefault(link.table, {})[link.key] = link
        for name, table in sorted(metadata.tables.items()):
            if table is not links:
                yield from survived(name, self._table(table, registered.pop(name, {})))
        for name, removed in registered.items():
            for key in removed:
                yield Finding("removed", f"{name} {key}")

    def _table(self, table: Table, entered: dict[int, Link]) -> Iterator[Finding]:
        for number, row in _rows(self.registry, table):
            self.compared += 1
            link = entered.pop(number, None)
            where = f"{table.name} {number}"
            if isinstance(row, Exception):
                yield Finding("changed", where, found=f"it can't be read: {row}")
            elif link is None:
                yield Finding("added", where)
            else:
                yield from _differences(where, row, link)
        for key in entered:
            yield Finding("removed", f"{table.name} {key}")

    def runs(self) -> Iterator[list[Finding]]:
        rows: dict[int, Any] = dict(_rows(self.registry, runs))
        for number, end in _rows(self.registry, run_ends):
            run = None if isinstance(end, Exception) else rows.get(end.get("run_key", 0))
            if isinstance(end, Exception) or run is None or isinstance(run, Exception):
                continue  # `rows` reports this row
            yield list(survived(f"run_ends {number}", self._run(run, end)))

    def _run(self, run: Mapping[str, Any], end: Mapping[str, Any]) -> Iterator[Finding]:
        path = self.registry.root / run["folder"]
        for what in folder_changes(path, end["manifest_sha256"]):
            yield Finding("file", str(path), found=what)
        try:
            noted = RunFolder(path).metadata.get("registry_head")
        except RecordError:
            return
        if path.name in self.entered_again:  # it states the lost registry's chain
            return
        if isinstance(noted, str):
            try:
                self.anchors.append((anchor_of(noted), f"run folder {path}"))
            except InputError:
                return

    def single_files(self) -> Iterator[Finding]:
        files = [
            (row["file"], row["file_sha256"])
            for table in (models, reports)
            for _, row in _rows(self.registry, table)
            if not isinstance(row, Exception) and row["file"]
        ]
        for name, digest in (*files, *self._certificates()):
            path = self.registry.root / name
            self.files += 1
            if not path.is_file():
                yield Finding("file", str(path), found="the file is missing")
            elif sha256_of_file(path) != digest:
                yield Finding("file", str(path), found="changed after it was registered")

    def _certificates(self) -> Iterator[tuple[str, str]]:
        """Yield path and entered hash of each archived certificate file."""
        for link in self.links:
            if link.table != certificates.name:
                continue
            try:
                entered = json.loads(link.content)
                archive = archived_at(entered["number"], entered["summary"])
                yield from (
                    (f"{archive}/{name}", digest) for name, digest in entered["files"].items()
                )
            except UNREADABLE:
                continue  # the chain itself was changed, which `chain` reports

    def anchored(self, anchors: tuple[ChainHead, ...]) -> Iterator[Finding]:
        known = {link.sequence: link.sha256 for link in self.links}
        noted = [*((anchor, "the chain end that was given") for anchor in anchors), *self.anchors]
        for anchor, source in noted:
            if anchor.sequence and known.get(anchor.sequence) != anchor.sha256:
                yield Finding(
                    "anchor",
                    source,
                    found=f"the chain doesn't pass through entry {anchor.sequence}, "
                    f"{anchor.sha256[:12]}…, that was noted there",
                )


def _rows(
    registry: RunRecords, table: Table
) -> Iterator[tuple[int, Mapping[str, Any] | Exception]]:
    """Yield number and columns of each row, or why it can't be read; columns may be missing."""
    with registry.session() as session:
        present = {each["name"] for each in inspect(session.connection()).get_columns(table.name)}
        query = select(*(column for column in table.c if column.name in present))
        numbers = list(session.scalars(select(table.c.id).order_by(table.c.id)))
    for start in range(0, len(numbers), 1000):
        chunk = numbers[start : start + 1000]
        try:
            yield from _read(registry, query.where(table.c.id.in_(chunk)).order_by(table.c.id))
        except (RecordError, *UNREADABLE):
            for number in chunk:
                try:
                    yield from _read(registry, query.where(table.c.id == number))
                except (RecordError, *UNREADABLE) as error:
                    yield number, error


def _read(registry: RunRecords, query: Select[Any]) -> list[tuple[int, Mapping[str, Any]]]:
    with registry.session() as session:
        return [(row.id, dict(row._mapping)) for row in session.execute(query)]


def survived(where: str, findings: Iterable[Finding]) -> Iterator[Finding]:
    """Yield findings, and one more if the compared data can't be read."""
    try:
        yield from findings
    except (RecordError, OSError, *UNREADABLE) as error:
        what = getattr(error, "found", None) or f"{type(error).__name__}: {error}"
        yield Finding("database", where, found=Message("it can't be compared: {what}", what))


def calibration_changes(registry: Database, calibration_id: int) -> tuple[str, ...]:
    """Describe changes of the rows on which a calibration's certificate is based.

    These are the rows of the calibration, its run, its chain and its standard, their certificates,
    and the models that were fitted to it: a few rows, however large the registry is.

    Raises
    ------
    RecordError
        Where there is no such calibration.
    """
    with registry.session() as session:
        query = select(calibrations).where(calibrations.c.id == calibration_id)
        calibration = session.execute(query).one_or_none()
        if calibration is None:
            raise RecordError(
                Message("calibration {calibration_id} isn't registered", calibration_id),
                "a registered calibration",
            )
        based_on = (
            (calibrations, "id", calibration_id),
            (runs, "id", calibration.run_key),
            (equipment, "id", calibration.transducer_key),
            (equipment, "id", calibration.counter_key),
            (equipment, "id", calibration.standard_key),
            (run_ends, "run_key", calibration.run_key),
            (models, "calibration_key", calibration_id),
            (reports, "equipment_key", calibration.standard_key),
        )
        return tuple(
            change
            for table, column, key in based_on
            for row in session.execute(select(table).where(table.c[column] == key))
            for change in _row_changes(session, table.name, row)
        )


def _row_changes(session: Session, table: str, row: Any) -> Iterator[str]:
    query = select(links).where(links.c.table == table, links.c.key == row.id)
    entered = session.execute(query).one_or_none()
    where = f"{table} {row.id}"
    if entered is None:
        yield str(Finding("added", where))
        return
    link = Link(**entered._mapping)
    if link.sha256 != link.expected_sha256():
        what = f"entry {link.sequence} doesn't have the hash that it was sealed with"
        yield str(Finding("chain", where, found=what))
    for finding in _differences(where, row._mapping, link):
        yield str(finding)


def _differences(where: str, row: Mapping[str, Any], link: Link) -> Iterator[Finding]:
    try:
        entered = json.loads(link.content)
    except UNREADABLE:
        yield Finding("chain", where, found="its entry in the chain can't be read")
        return
    present = {}
    for name, value in row.items():
        try:
            present[name] = json.loads(canonical({"": value}))[""]
        except UNREADABLE as error:
            yield Finding("changed", where, name, f"a value that can't be read ({error})", "text")
    for name, before, now in changed_fields(entered, present):
        if name in present or name not in row:
            yield Finding("changed", where, name, repr(now), repr(before))


def folder_changes(path: Path, manifest_sha256: str) -> list[str]:
    """Describe the changes of a sealed run folder; empty if it is intact.

    Parameters
    ----------
    path : pathlib.Path
        The folder.
    manifest_sha256 : str
        Hash of its manifest in the registry.
    """
    try:
        folder = RunFolder.open(path)
        if not folder.sealed:
            return ["its manifest is missing"]
        if sha256_of_file(path / MANIFEST) != manifest_sha256:
            return ["its manifest was changed after the run was registered"]
        folder.verify()
    except RecordError as error:
        return [error.found]
    except UNREADABLE as error:
        return [f"its manifest can't be read: {type(error).__name__}: {error}"]
    return []
