"""Backup of a data directory while the bench runs, and its restoration.

A backup is itself a data directory, whose records can be listed, verified and exported. The
registry is copied first, in one consistent state, and all files to which it refers are already
complete. Sealed runs never change, so each is copied once.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from torquebench import __version__
from torquebench.atomic_write import (
    atomic_folder,
    atomic_path,
    atomic_write,
    private_folder,
    replacing,
)
from torquebench.bench.audit.chain import AUDIT_FILE, audit_end, check_audit, files_aside
from torquebench.bench.audit.entries import AUDIT_FOLDER
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress
from torquebench.records import ChainHead, Registry, RunFolder, anchor_of, sha256_of_file
from torquebench.records.files import read_json
from torquebench.records.read_only import sqlite_reader
from torquebench.records.registry.database import REGISTRY_FILE, REGISTRY_URL, WAY_BACK
from torquebench.records.registry.database_check import damage_of_file
from torquebench.records.runs.folder import MANIFEST
from torquebench.station.bench_lock import LOCK_FILE, BenchLock
from torquebench.station.data_check import check_data_directory, run_folders

BACKUP_FILE = "backup.json"
"""File that marks a folder as a backup; it contains the backup's time and end of the chain."""
ASIDE = "replaced-"
"""Beginning of the name of the folder in which `restore` keeps replaced files."""
ATTEMPTS = 5


@dataclass
class Backup:
    """Copied files of a backup.

    Attributes
    ----------
    head : ChainHead
        End of the chain in the registry's copy.
    runs, known_runs : int
        Numbers of run folders that were copied now, and by earlier backups.
    open_runs : list of str
        Runs that were in progress; their copies are incomplete, as after a power cut.
    files : int
        Number of other files that were copied.
    problems : list of str
        Damaged or missing files, which couldn't be copied.
    outside : list of str
        Registered files outside the data directory, which aren't copied.
    """

    head: ChainHead
    runs: int = 0
    known_runs: int = 0
    open_runs: list[str] = field(default_factory=list)
    files: int = 0
    problems: list[str] = field(default_factory=list)
    outside: list[str] = field(default_factory=list)


def back_up(data: Path, target: Path, progress: Progress = NO_PROGRESS) -> Backup:
    """Copy a data directory into a new or existing backup; its bench may be in use.

    Parameters
    ----------
    target : pathlib.Path
        A new or empty folder, or an earlier backup of the same records.
    progress : Progress
        Receives the progress of copying.

    Raises
    ------
    InputError
        If the target isn't such a folder, or the registry is on a server.
    RecordError
        Where the registry is damaged; an earlier backup is kept unchanged.
    """
    require_file_registry("a backup")
    _require_target(data, target)
    private_folder(target)
    for leftover in target.glob(".*.part*"):  # left by an interrupted backup
        leftover.unlink()
    progress.start("Copying the registry")
    with replacing(target / REGISTRY_FILE) as copy:
        _copy_database(data / REGISTRY_FILE, copy)
        damage = damage_of_file(copy)
        if damage:
            raise RecordError(
                Message(
                    "the registry {data} is damaged: {damage}", data / REGISTRY_FILE, damage[0]
                ),
                "an undamaged registry; an earlier backup is kept unchanged",
                WAY_BACK,
            )
        with Registry(f"sqlite:///{copy}", data) as registry:
            _require_same_records(registry, target)
            backup = _copy_files(registry, data, target, progress)
        for ending in ("-wal", "-shm"):
            copy.with_name(f"{copy.name}{ending}").unlink(missing_ok=True)
    said = {
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "of": str(data.resolve()),
        "chain_end": str(backup.head),
        "software_version": __version__,
    }
    atomic_write(target / BACKUP_FILE, json.dumps(said, indent=2) + "\n", private=True)
    return backup


def require_file_registry(what: str) -> None:
    """Raise an error if the registry is on a server, where file operations don't apply."""
    if os.environ.get(REGISTRY_URL):
        raise InputError(
            Message("{what} of a registry on a server", what),
            "a registry in its data directory",
            "use the server's own tool (`pg_dump`), and copy the data directory beside it",
        )


def _require_target(data: Path, target: Path) -> None:
    here, there = data.resolve(), target.resolve()
    if there.is_relative_to(here) or here.is_relative_to(there):
        raise InputError(
            Message("one of {target} and {data} contains the other", target, data),
            "two separate folders",
            "choose another folder",
        )
    if target.is_dir() and any(target.iterdir()) and not (target / BACKUP_FILE).exists():
        names = {path.name for path in target.iterdir()} - {"runs"}
        if not all(name.startswith(f".{REGISTRY_FILE}.") for name in names):
            # an interrupted first backup may be completed
            raise InputError(
                Message("{target} contains other files", target),
                "a new folder, or a backup",
                "choose another folder",
            )


def _require_same_records(registry: Registry, target: Path) -> None:
    if not (target / BACKUP_FILE).exists():
        return
    before = _noted_head(target)
    if before.sequence and not registry.passes_through(before):
        raise InputError(
            Message(
                "the registry doesn't pass through the end of the chain in {target}, "
                "entry {sequence}",
                target,
                before.sequence,
            ),
            "an earlier backup of the same records",
            "check with `torquebench records verify` whether the registry was replaced; "
            "or choose another folder, and keep this backup",
        )


def _noted_head(backup: Path) -> ChainHead:
    return anchor_of(str(read_json(backup / BACKUP_FILE).get("chain_end", "")))


def _copy_database(source: Path, target: Path) -> None:
    """Copy a consistent state of a SQLite database, which may be in use, into an empty file."""
    with (
        sqlite_reader(source) as address,
        closing(sqlite3.connect(address, uri=True, timeout=30.0)) as origin,
        closing(sqlite3.connect(target)) as copy,
    ):
        target.chmod(source.stat().st_mode & 0o777)
        try:
            origin.backup(copy)
            copy.execute("PRAGMA journal_mode=DELETE")  # a single file without a log beside it
        except sqlite3.DatabaseError as error:
            raise RecordError(
                Message("{path} can't be read: {problem}", source, error), "a sound file", WAY_BACK
            ) from error


def _copy_files(registry: Registry, data: Path, target: Path, progress: Progress) -> Backup:
    backup = Backup(registry.head())
    ended = {
        run.folder.name: run.manifest_sha256
        for run in registry.runs(limit=None)
        if run.finished is not None
    }
    folders = run_folders(data)
    progress.start("Copying run folders", len(folders))
    for number, folder in enumerate(folders):
        progress.reach(number, folder.name)
        copied = target / "runs" / folder.name
        registered = ended.pop(folder.name, None)
        if registered is not None and _manifest_sha256(copied) == registered:
            backup.known_runs += 1
            continue
        problem = _copy_run(folder, copied, registered)
        if problem:
            backup.problems.append(problem)
            continue
        backup.runs += 1
        if not RunFolder(copied).sealed:
            backup.open_runs.append(folder.name)
    backup.problems += [f"run {name} has no folder" for name in ended]
    progress.reach(len(folders))
    others = list(_other_files(data))
    progress.start("Copying other files", len(others))
    for number, path in enumerate(others):
        progress.reach(number, path.name)
        name = path.relative_to(data)
        if path.suffix == ".sqlite":
            _copy_file(path, target / name, _copy_database)
        elif not _same(path, target / name):
            _copy_file(path, target / name)
            backup.files += 1
    _copy_audit(data / AUDIT_FOLDER, target / AUDIT_FOLDER)
    backup.outside += sorted(_outside(registry, data))
    return backup


def _manifest_sha256(folder: Path) -> str:
    manifest = folder / MANIFEST
    return sha256_of_file(manifest) if manifest.is_file() else ""


def _copy_run(folder: Path, copied: Path, registered: str | None) -> str:
    """Copy a run's folder completely or not at all; return its defect, if any."""
    try:
        # The copy replaces an earlier one, of a run that was still open or was changed.
        with atomic_folder(copied) as part:
            for _ in range(ATTEMPTS):
                shutil.rmtree(part, ignore_errors=True)
                was_sealed = RunFolder(folder).sealed
                try:
                    shutil.copytree(folder, part, ignore=shutil.ignore_patterns(".*.part"))
                except (
                    shutil.Error,
                    FileNotFoundError,
                ):  # being sealed, which renames files
                    continue
                if was_sealed == RunFolder(folder).sealed:
                    break
            if (part / MANIFEST).exists():
                RunFolder.open(part).verify()
            if registered is not None and _manifest_sha256(part) != registered:
                raise RecordError("its manifest differs from the registered one")
    except RecordError as error:
        return Message("run {label}: {found}", folder.name, error.found)
    return ""


def _other_files(data: Path) -> Iterator[Path]:
    """Yield files of the data directory other than registry, runs and audit log."""
    for path in sorted(data.rglob("*")):
        top = path.relative_to(data).parts[0]
        own = top in ("runs", AUDIT_FOLDER, REGISTRY_FILE, LOCK_FILE, BACKUP_FILE)
        passing = path.name.endswith((".part", "-wal", "-shm", "-journal"))
        kept_aside = top.startswith((ASIDE, "registry-damaged-"))
        if path.is_file() and not own and not passing and not kept_aside:
            yield path


def _same(first: Path, second: Path) -> bool:
    if not second.is_file() or first.stat().st_size != second.stat().st_size:
        return False
    return sha256_of_file(first) == sha256_of_file(second)


def _copy_file(
    source: Path, target: Path, copy: Callable[[Path, Path], object] = shutil.copy2
) -> None:
    private_folder(target.parent)
    with atomic_path(target) as part:
        copy(source, part)


def _copy_audit(source: Path, target: Path) -> None:
    """Copy the complete lines of an audit log that may be written or archived meanwhile."""
    if not source.is_dir():
        return
    private_folder(target)
    for _ in range(ATTEMPTS):
        before = files_aside(source)
        for path in before:
            if not _same(path, target / path.name):
                _copy_file(path, target / path.name)
        content = (source / AUDIT_FILE).read_bytes() if (source / AUDIT_FILE).exists() else b""
        if files_aside(source) == before:
            break
    atomic_write(target / AUDIT_FILE, content[: content.rfind(b"\n") + 1], private=True)


def _outside(registry: Registry, data: Path) -> set[str]:
    named = [entry.file for entry in registry.models()]
    for equipment in registry.equipment():
        named += [each.file for each in registry.reports(equipment.serial) if each.file is not None]
    return {str(file) for file in named if not file.resolve().is_relative_to(data.resolve())}


# -- restoration ------------------------------------------------------------------------------


@dataclass
class Restored:
    """Restored files.

    Attributes
    ----------
    restored : list of str
        Missing files that were restored.
    replaced : list of str
        Files that differed from the backup's and were replaced by them.
    kept : list of str
        Files newer than the backup's, which are kept.
    missing : list of str
        Files that the backup's registry names but the backup doesn't contain.
    aside : pathlib.Path or None
        Folder of the replaced files.
    """

    restored: list[str] = field(default_factory=list)
    replaced: list[str] = field(default_factory=list)
    kept: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    aside: Path | None = None


def restore(
    backup: Path, data: Path, *, replace: bool = False, progress: Progress = NO_PROGRESS
) -> Restored:
    """Restore missing files of a data directory, and with `replace` changed ones, all or none.

    The backup is first compared with its registry, and links in it are refused. All files are
    copied into a temporary folder and compared again before the first one is moved to its place.
    Files that differ from the backup are listed, and with `replace` moved to a separate folder.
    Newer files are kept.

    Parameters
    ----------
    backup : pathlib.Path
        A backup made by `back_up`.
    data : pathlib.Path
        The data directory; it needn't exist.
    replace : bool
        Whether to replace files that differ from the backup.
    progress : Progress
        Receives the progress of comparing and copying.

    Raises
    ------
    InputError
        Where the folder isn't a backup, files differ, or the bench is open. Then nothing is
        changed.
    RecordError
        Where the backup is damaged or contains a link, or the disk fails. Then nothing is changed.
    """
    require_file_registry("restoring")
    if not (backup / BACKUP_FILE).is_file():
        raise InputError(
            Message("{backup} isn't a backup", backup),
            Message("a folder with {metadata}", BACKUP_FILE),
        )
    _refuse_links(backup)
    done = Restored()
    progress.start("Comparing the backup with its registry")
    done.missing = _check_seals(backup)
    if data.exists():
        _refuse_links(data, ("runs", "models", "certificates", AUDIT_FOLDER))
    private_folder(data)
    with BenchLock(None, data):
        missing, differing = _compare(backup, data, done)
        if differing and not replace:
            shown = ", ".join(differing[:8]) + (", …" if len(differing) > 8 else "")
            raise InputError(
                Message(
                    "{count} in {data} differ from the backup: {shown}", len(differing), data, shown
                ),
                "files that are missing or equal those of the backup; nothing was changed",
                "--replace moves them into a separate folder and restores the backup's",
            )
        with _staged(backup, data, [*missing, *differing], progress) as staged:
            aside = data / f"{ASIDE}{datetime.now(UTC):%Y%m%dT%H%M%S%fZ}"
            _move_in(staged, data, (*missing, *differing), aside)
            done.aside = aside if aside.exists() else None
        done.restored, done.replaced = missing, differing
    return done


def _refuse_links(folder: Path, names: tuple[str, ...] = ()) -> None:
    """Raise an error if a folder contains links or devices, whose content is elsewhere.

    Parameters
    ----------
    names : tuple of str
        Names in the folder to check; by default all.
    """
    for path in (folder / name for name in names) if names else sorted(folder.rglob("*")):
        if path.is_symlink() or (path.exists() and not (path.is_dir() or path.is_file())):
            raise RecordError(
                Message("{path} is a link or a device", path),
                "files and folders",
                "replace it by the files themselves, or use another backup",
            )


def _check_seals(backup: Path) -> list[str]:
    """Compare all files of a backup with its registry; return the names of missing ones.

    Raises
    ------
    RecordError
        A file of the backup was changed.
    """
    damage = damage_of_file(backup / REGISTRY_FILE)
    if damage:
        raise RecordError(
            Message("the backup's own registry is damaged: {damage}", damage[0]), "", "take another"
        )
    with tempfile.TemporaryDirectory(prefix="torquebench-") as scratch:
        copy = Path(scratch) / REGISTRY_FILE  # an older registry is upgraded in this copy
        _copy_database(backup / REGISTRY_FILE, copy)
        report = check_data_directory(backup, registry=f"sqlite:///{copy}")
    changed = [
        finding
        for finding in report.findings
        if finding.kind not in ("orphan", "file") or Path(finding.where).exists()
    ]
    sealed = [each for each in changed if each.kind != "orphan"]
    if sealed:
        raise RecordError(
            Message(
                "the backup itself is damaged: {what}",
                Message.joined([str(each) for each in sealed[:3]], "; "),
            ),
            "an unchanged backup; nothing was restored",
            "take another backup",
        )
    return [finding.where for finding in report.findings if finding.kind == "file"]


@contextmanager
def _staged(backup: Path, data: Path, names: list[str], progress: Progress) -> Iterator[Path]:
    """Yield a folder in the data directory with copies of files and folders of a backup.

    Raises
    ------
    RecordError
        A copy can't be written, or differs from its source.
    """
    part = data / ".restored.part"
    shutil.rmtree(part, ignore_errors=True)  # left by an interrupted attempt
    try:
        private_folder(part)
        progress.start("Copying", len(names))
        for number, name in enumerate(names):
            progress.reach(number, name)
            source, copy = backup / name, part / name
            private_folder(copy.parent)
            if source.is_file():
                shutil.copy2(source, copy, follow_symlinks=False)
                same = _same(source, copy)
            else:
                shutil.copytree(source, copy, symlinks=True)
                files = (path for path in source.rglob("*") if path.is_file())
                same = all(_same(path, copy / path.relative_to(source)) for path in files)
            if not same:
                raise RecordError(
                    Message("{name} was copied with errors", name),
                    "the same bytes; nothing was changed",
                    "check the disk",
                )
        yield part
    except OSError as error:
        raise RecordError(
            Message("the backup can't be copied to {data}: {error}", data, error),
            "space on the disk; nothing was changed",
            "free space, or choose another --data",
        ) from error
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _move_in(staged: Path, data: Path, names: tuple[str, ...], aside: Path) -> None:
    """Move staged files to their places, and files there into another folder; all or none."""
    moved: list[tuple[Path, Path]] = []

    def move(source: Path, target: Path) -> None:
        private_folder(target.parent)
        source.rename(target)
        moved.append((source, target))

    try:
        for name in names:
            # SQLite would apply a log that remains beside the restored database.
            endings = ("", "-wal", "-shm") if name.endswith(".sqlite") else ("",)
            for present in (f"{name}{ending}" for ending in endings):
                if (data / present).exists():
                    move(data / present, aside / present)
            move(staged / name, data / name)
    except OSError:
        for source, target in reversed(moved):
            target.rename(source)
        shutil.rmtree(aside, ignore_errors=True)  # it contains only empty folders
        raise


def _compare(backup: Path, data: Path, done: Restored) -> tuple[list[str], list[str]]:
    """Return the missing and the different files; add newer ones to `kept`."""
    missing: list[str] = []
    differing: list[str] = []

    def sort(name: str, same: bool, newer: bool = False) -> None:
        if not (data / name).exists():
            missing.append(name)
        elif newer:
            done.kept.append(name)
        elif not same:
            differing.append(name)

    sort(REGISTRY_FILE, *_registry_state(backup, data))
    for folder in run_folders(backup):
        here = data / "runs" / folder.name
        sort(f"runs/{folder.name}", _same_run(folder, here), not RunFolder(folder).sealed)
    for path in _other_files(backup):
        name = path.relative_to(backup).as_posix()
        registered = name.startswith(("models/", "certificates/"))
        damaged = (
            path.suffix == ".sqlite" and (data / name).exists() and damage_of_file(data / name)
        )
        same = _same(path, data / name)
        sort(name, same, not same and not registered and not damaged)
    if (backup / AUDIT_FOLDER).is_dir():
        end = audit_end(backup / AUDIT_FOLDER / AUDIT_FILE)
        problems = check_audit(data / AUDIT_FOLDER, [(end, "the backup")]).problems
        sort(AUDIT_FOLDER, not problems)
    return missing, differing


def _registry_state(backup: Path, data: Path) -> tuple[bool, bool]:
    """Return whether the registry equals the backup's, and whether it is newer and undamaged."""
    file = data / REGISTRY_FILE
    if not file.exists() or not file.stat().st_size or damage_of_file(file):
        return False, False
    head = _noted_head(backup)
    try:
        with Registry(f"sqlite:///{file.resolve()}", data) as registry:
            same = registry.head() == head
            return same, not same and (not head.sequence or registry.passes_through(head))
    except RecordError:
        return False, False


def _same_run(copy: Path, here: Path) -> bool:
    if not here.is_dir():
        return False
    try:
        RunFolder.open(here).verify()
    except RecordError:
        return False
    return _manifest_sha256(copy) == _manifest_sha256(here)
