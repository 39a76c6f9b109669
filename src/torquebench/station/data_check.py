"""Check the integrity of a data directory: registry, folders, files, audit log."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.bench.audit.chain import AUDIT_FILE, AuditEnd, audit_end, check_audit
from torquebench.bench.audit.entries import AUDIT_FOLDER
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records import (
    Finding,
    IntegrityReport,
    Registry,
    RunFolder,
    RunSummary,
    check_records,
)
from torquebench.records.accounts import PANEL_FILE
from torquebench.records.chain import START, ChainHead
from torquebench.records.files import UNREADABLE
from torquebench.records.integrity import survived
from torquebench.records.registry.database import (
    REGISTRY_FILE,
    REGISTRY_URL,
    WAY_BACK,
    lost_registry,
)
from torquebench.records.registry.database_check import (
    damage_of_file,
    index_damage_only,
    schema_changes,
)
from torquebench.records.runs.lock import RunLock
from torquebench.records.runs.time_check import time_remarks
from torquebench.records.runs.unfinished import RunState, UnfinishedRun, unentered_folders

if TYPE_CHECKING:
    from collections.abc import Iterable

OF_AN_INDEX = "only an index is damaged: `torquebench records rebuild` repairs it"


def check_data_directory(
    data: Path,
    *,
    anchors: tuple[ChainHead, ...] = (),
    folders: bool = True,
    registry: str | None = None,
) -> IntegrityReport:
    """Compare all files of a data directory with the registry.

    Nothing is written, so even a directory on a read-only file system can be checked.

    Parameters
    ----------
    anchors : tuple of ChainHead
        Ends of the chain that were noted earlier.
    folders : bool, default True
        Whether run folders and files are compared too, which reads all of them.
    registry : str, optional
        URL of the registry; by default that of the data directory.

    Returns
    -------
    IntegrityReport
        Report with one finding per defect. If the registry can't be read, no files are compared.
    """
    findings: list[Finding] = []
    if registry is None and not os.environ.get(REGISTRY_URL):
        lost = lost_registry(data)
        if lost:
            return _unread([Finding("registry", str(data / REGISTRY_FILE), "", lost, "", WAY_BACK)])
        findings += _file_damage(data / REGISTRY_FILE)
    findings += _file_damage(data / PANEL_FILE)
    try:
        opened = Registry.open(data) if registry is None else Registry(registry, data)
        with opened:
            return _check(opened, findings, anchors, folders=folders)
    except (RecordError, *UNREADABLE) as error:
        found = error.found if isinstance(error, RecordError) else str(error)
        if not any(each.where.endswith(REGISTRY_FILE) for each in findings):
            where = str(data / REGISTRY_FILE)
            findings.append(Finding("database", where, "", found, "", WAY_BACK))
        return _unread(findings)


def _unread(findings: list[Finding]) -> IntegrityReport:
    return IntegrityReport(ChainHead(0, START), 0, 0, 0, tuple(findings))


def run_folders(data: Path) -> list[Path]:
    """Return the folders of all runs of a data directory, the oldest first."""
    runs = data / "runs"
    return sorted(path for path in runs.iterdir() if path.is_dir()) if runs.is_dir() else []


def _file_damage(file: Path) -> Iterator[Finding]:
    damage = damage_of_file(file) if file.exists() else ()
    if not damage:
        return
    more = Message(" (and {count} more)", len(damage) - 1) if len(damage) > 1 else ""
    remedy = WAY_BACK
    if index_damage_only(damage):
        remedy = OF_AN_INDEX
    if file.name == PANEL_FILE:
        remedy = "`torquebench records restore BACKUP`"
    yield Finding("database", str(file), "", damage[0] + more, "", remedy)


def _check(
    registry: Registry,
    findings: list[Finding],
    anchors: tuple[ChainHead, ...],
    *,
    folders: bool,
) -> IntegrityReport:
    findings += schema_changes(registry)
    report = check_records(registry, anchors=anchors, folders=folders)
    unreadable: list[str] = []
    runs = registry.entries(RunSummary, problems=unreadable)
    if any(each.kind == "changed" for each in report.findings):
        # A damaged row doesn't match its index either; the row's finding is enough.
        findings = [each for each in findings if each.remedy != OF_AN_INDEX]
    findings += report.findings
    findings += survived("folders", _strangers(registry, {run.run_id for run in runs}))
    findings += survived("folders", _without_folder(runs))
    log, lines = registry.root / AUDIT_FOLDER, 0
    try:
        audit = check_audit(log, _noted(registry, log, runs if folders else ()))
        lines = audit.lines
        findings += [Finding("audit", where, "", what) for where, what in audit.problems]
    except (RecordError, OSError, *UNREADABLE) as error:
        findings.append(Finding("audit", str(log), "", f"it can't be compared: {error}"))
    remarks = []
    with contextlib.suppress(RecordError, *UNREADABLE):  # an unreadable row is another finding
        remarks += [*_rebuilt(registry), *time_remarks(registry)]
    return replace(
        report,
        findings=tuple(dict.fromkeys(findings)),
        audit_lines=lines,
        remarks=tuple(remarks),
    )


def _rebuilt(registry: Registry) -> Iterator[str]:
    for when, by, how, runs in registry.rebuilt():
        yield (
            Message(
                "the registry was {how} by {by} on {when:%Y-%m-%d %H:%M:%S} UTC ({count} "
                "runs); ends of the chain that were noted earlier may be missing",
                how,
                by or "somebody",
                when,
                len(runs),
            )
        )


def _strangers(registry: Registry, known: set[str]) -> Iterator[Finding]:
    """Yield a finding for every run or certificate folder that isn't in the registry."""
    strange = [path for path in run_folders(registry.root) if path.name not in known]
    if strange and not known:
        count = Message("{count} run folder{value}", len(strange), "s" if len(strange) > 1 else "")
        yield Finding("registry", registry.name, "", f"holds no run beside {count}", "", WAY_BACK)
        return
    own = {run.run_id for run in unentered_folders(registry)} if strange else set()
    for path in strange:
        yield from _stranger(registry, path, own=path.name in own)
    archive = registry.root / "certificates"
    issued = {Path(each.archive).name for each in registry.certificates()}
    for path in sorted(archive.iterdir()) if archive.is_dir() else ():
        if path.is_dir() and path.name not in issued:
            yield Finding(
                "orphan",
                str(path),
                "",
                "no certificate of this number is registered",
                "",
                "`torquebench records rebuild` enters it, or remove it",
            )


def _stranger(registry: Registry, path: Path, *, own: bool) -> Iterator[Finding]:
    """Yield the finding for an unregistered folder; `own` says whether this registry made it."""
    try:
        folder = RunFolder.open(path)
        lock = RunLock(path)
    except (RecordError, OSError):
        yield Finding("orphan", str(path), "", "isn't a run", "", "remove it")
        return
    if not lock.held:  # a process is writing it
        return
    lock.release()
    if registry.runs_beginning(path.name, limit=1):  # it was registered meanwhile
        return
    if folder.copy_of:
        run = UnfinishedRun(path.name, "", RunState.COPY, path)
        yield Finding("orphan", str(path), "", run.found, "", run.remedy)
        return
    state = "a sealed run" if folder.sealed else "a run that wasn't sealed"
    command = Message("finish {name}", path.name) if own else "rebuild"
    yield Finding(
        "orphan",
        str(path),
        "",
        f"{state} that isn't in the registry",
        "",
        f"`torquebench records {command}` enters it",
    )


def _without_folder(runs: Iterable[RunSummary]) -> Iterator[Finding]:
    """Yield a finding for every run without a registered end whose folder is missing."""
    for run in runs:
        if run.finished is None and not run.folder.is_dir():
            yield Finding(
                "file", str(run.folder), "", "the folder of a run that started is missing"
            )


def _noted(
    registry: Registry, log: Path, runs: Iterable[RunSummary]
) -> Iterator[tuple[AuditEnd, str]]:
    """Yield the audit log's ends that registry and run folders note, and where they note them."""
    for run in runs:
        if run.finished is not None and run.folder.is_relative_to(registry.root):
            end = audit_end(run.folder / AUDIT_FILE)
            if end.line:
                yield end, Message("run {run_id}", run.run_id)
    for line, sha256 in registry.audit_ends(log):
        yield AuditEnd(line, sha256), "the registry"
