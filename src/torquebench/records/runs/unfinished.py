"""Find unfinished runs by their folders and the registry, so that no measurement is lost.

A run is written, sealed, entered into the registry, and its result is registered (a calibration
with its models, a check, a verification). A kill, a full disk or a failing database can interrupt
any step, so every start checks for unfinished runs. Their state is derived from folder and
registry, since a stored state could be wrong.
"""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import Enum
from pathlib import Path
from typing import Any

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.chain import ChainHead
from torquebench.records.files import UNREADABLE
from torquebench.records.registry.entries import RunSummary
from torquebench.records.registry.runs import INTERRUPTED, RunRecords
from torquebench.records.runs.folder import RunFolder
from torquebench.records.runs.lock import is_held
from torquebench.units import HOUR

REGISTERS = "registers"
"""Key of a run's metadata that states the kind of result and how to register it."""
LONGEST_H = 24.0
"""For how long an interrupted calibration can be resumed, unless its profile states a time, h."""
RECENT = timedelta(days=30)
MANY = 10_000


class RunState(Enum):
    """State of an unfinished run."""

    LEFT_OPEN = "left open"
    """Its process ended without sealing the folder."""
    SEALED = "sealed"
    """The folder is sealed, but the registry lacks the run or its end."""
    MEASURED = "measured"
    """The run is complete and registered, but its result isn't registered."""
    INTERRUPTED = "interrupted"
    """An interrupted calibration that can be resumed; without a point, from the beginning."""
    COPY = "copy"
    """A copied or renamed folder: its name isn't the run's identifier. It is never registered."""


@dataclass(frozen=True)
class UnfinishedRun:
    """An unfinished run, with its state and remedy in words."""

    run_id: str
    kind: str
    state: RunState
    folder: Path

    @property
    def found(self) -> str:
        """State of the run in words."""
        match self.state:
            case RunState.LEFT_OPEN:
                return Message("run {run_id} was left open", self.run_id)
            case RunState.COPY if self._original.exists():
                return Message(
                    "folder {run_id} is a copy of run {original}", self.run_id, self._original.name
                )
            case RunState.COPY:
                return Message(
                    "folder {run_id} holds run {original} under another name",
                    self.run_id,
                    self._original.name,
                )
            case RunState.SEALED:
                return Message(
                    "run {run_id} is measured and sealed, and not in the registry", self.run_id
                )
            case RunState.MEASURED:
                what = self.kind.partition("-")[0].replace("calibrate", "calibration")
                what = what.replace("verify", "verification")
                return Message(
                    "run {run_id} is measured, and its {what} isn't registered", self.run_id, what
                )
        return Message("run {run} was interrupted", self.run_id)

    @property
    def _original(self) -> Path:
        """The path that the run's folder had when it was made."""
        return self.folder.with_name(RunFolder(self.folder).run_id)

    @property
    def remedy(self) -> str:
        """How to finish or remove the run."""
        match self.state:
            case RunState.COPY if self._original.exists():
                return Message(
                    "nothing of it is entered; remove it, or move it out of {runs}",
                    self.folder.parent,
                )
            case RunState.COPY:
                return Message(
                    "nothing of it is entered; rename it to {original}", self._original.name
                )
            case RunState.LEFT_OPEN | RunState.SEALED:
                return Message(
                    "`torquebench records finish {run_id}` enters it, and so does every "
                    "start of torquebench",
                    self.run_id,
                )
            case RunState.MEASURED:
                return Message(
                    "`torquebench records finish {run_id}` without measuring again, or "
                    "`records discard {run_id}`",
                    self.run_id,
                )
        return Message(
            "resume it with `torquebench resume {run_id}`, or `records discard {run_id}`",
            self.run_id,
        )


def unfinished_runs(registry: RunRecords, now: datetime | None = None) -> tuple[UnfinishedRun, ...]:
    """Return every unfinished run that no process is writing, the oldest first.

    Parameters
    ----------
    registry : Registry
        Registry of the data directory.
    now : datetime.datetime, optional
        The present time, because an interrupted calibration can be resumed for a limited time only.
    """
    found = list(unentered_folders(registry))
    found += [
        UnfinishedRun(run.run_id, run.kind, RunState.MEASURED, run.folder)
        for run in registry.completed_runs_without_result()
        if _registers(run) and run.folder.is_dir()
    ]
    found += _interrupted(registry, now or datetime.now(UTC))
    return tuple(sorted(found, key=lambda run: run.run_id))


def unentered_folders(registry: RunRecords) -> Iterator[UnfinishedRun]:
    """Yield runs of the data directory that the registry lacks, or whose end it lacks.

    Folders that a process is writing are skipped, and so are folders of another registry, which
    they name by the end of its chain.
    """
    entered = registry.entered_runs(names := _folders(registry.root / "runs"))
    for name in names:
        path = registry.root / "runs" / name
        if entered.get(name) or is_held(path):
            continue
        try:
            folder = RunFolder.open(path)
            metadata = folder.metadata
        except RecordError:  # killed before the metadata were written
            continue
        if name not in entered and not folder.copy_of and not _belongs(registry, metadata):
            continue
        state = RunState.SEALED if folder.sealed else RunState.LEFT_OPEN
        if folder.copy_of:
            state = RunState.COPY
        yield UnfinishedRun(name, str(metadata.get("kind", "")), state, path)


def _folders(runs: Path) -> list[str]:
    return sorted(each.name for each in os.scandir(runs)) if runs.is_dir() else []


def _belongs(registry: RunRecords, metadata: Mapping[str, Any]) -> bool:
    """Return whether a run's folder belongs to this registry."""
    number, _, digest = str(metadata.get("registry_head", "")).partition(":")
    known = number.isdecimal() and int(number) > 0
    return known and registry.passes_through(ChainHead(int(number), digest))


def _registers(run: RunSummary) -> bool:
    """Return whether a completed run has a result to register."""
    if run.kind.startswith("calibrate-"):
        return True
    try:
        return bool(RunFolder(run.folder).metadata.get(REGISTERS))
    except RecordError:  # moved away, or broken: `records verify` reports it
        return False


def _interrupted(registry: RunRecords, now: datetime) -> Iterator[UnfinishedRun]:
    """Yield interrupted calibrations that can still be resumed and that no later run resumed."""
    candidates = registry.interrupted_calibrations(now - RECENT)
    for run in candidates:
        folder = RunFolder(run.folder)
        if not folder.sealed or not can_go_on(folder, now):
            continue
        if not followers(registry, run) and not _calibrated_since(registry, run):
            yield UnfinishedRun(run.run_id, run.kind, RunState.INTERRUPTED, run.folder)


def can_go_on(folder: RunFolder, now: datetime) -> bool:
    """Return whether an interrupted calibration is recent enough to be resumed, by its profile.

    A resumed run without new points can't be resumed; the run before it is resumed instead.
    """
    start, last_s = _start_and_last_point(folder)
    try:
        if not start or (last_s is None and folder.metadata.get("resumes")):
            return False
        last_s = float(start["time"]) if last_s is None else last_s
        clause = start.get("profile", {}).get("settings", {}).get("interruption") or {}
        passed_h = (now.timestamp() - last_s) / HOUR
        return clause.get("resume") != "never" and passed_h <= clause.get("longest_h", LONGEST_H)
    except (RecordError, *UNREADABLE):  # `records verify` reports the error
        return False


def _start_and_last_point(folder: RunFolder) -> tuple[dict[str, Any], float | None]:
    """Return a run's start document and the time of its last point; None without one."""
    last_s = None
    try:
        start = next((document for _, document in folder.documents("start")), {})
        for point in folder.points():
            last_s = float(point["time"])
    except (RecordError, OSError, *UNREADABLE):  # `records verify` reports the error
        return {}, None
    return start, last_s


def followers(registry: RunRecords, run: RunSummary) -> tuple[RunSummary, ...]:
    """Return the runs that resumed a run, the newest first.

    Discarded runs and runs that ended before their first point are left out.
    """
    found = []
    for other in registry.runs(limit=MANY, kind=run.kind):
        if other.run_id == run.run_id:
            break
        if run.run_id in _resumed(other) and not registry.discarded(other.run_id):
            ended = other.status in INTERRUPTED
            if not ended or _start_and_last_point(RunFolder(other.folder))[1] is not None:
                found.append(other)
    return tuple(found)


def latest_unfinished_calibration(registry: RunRecords) -> RunSummary | None:
    """Return the newest unfinished calibration, even if it can't be finished any more.

    None if the newest calibrations were registered, discarded, or resumed by a later run.
    """
    measured = {run.run_id for run in registry.completed_runs_without_result()}
    for run in registry.runs(limit=MANY):
        if not run.kind.startswith("calibrate-") or registry.discarded(run.run_id):
            continue
        if run.run_id in measured:
            return run
        begun = run.status in INTERRUPTED and _start_and_last_point(RunFolder(run.folder))[0]
        interrupted = begun and not followers(registry, run)
        if interrupted and not _calibrated_since(registry, run):
            return run
    return None


def _resumed(run: RunSummary) -> list[str]:
    try:
        return list(RunFolder(run.folder).metadata.get("resumes", ()))
    except (RecordError, TypeError):
        return []


def _calibrated_since(registry: RunRecords, run: RunSummary) -> bool:
    """Return whether a later run calibrated the same module completely."""
    for other in registry.runs(limit=MANY, kind=run.kind):
        if other.run_id == run.run_id:
            return False
        if other.status == "completed":
            return True
    return False
