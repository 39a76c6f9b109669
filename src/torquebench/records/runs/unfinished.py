"""The state of a run, derived from its folder and the registry, so that no measurement is lost.

A run is written, sealed, entered into the registry, and its result is registered (a calibration
with its models, a check, a verification). The state isn't stored, since a stored state could be
wrong: it is derived from folder and registry. A kill, a full disk or a failing database can
interrupt any step, so every start checks for unfinished runs.
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

__all__ = [
    "REGISTERS",
    "RunState",
    "UnfinishedRun",
    "followers",
    "latest_unfinished_calibration",
    "unentered_folders",
    "unfinished_runs",
]

REGISTERS = "registers"
"""Key of a run's metadata: the kind of its result, and how it is registered."""
LONGEST_H = 24.0
"""How long an interrupted calibration can be resumed, unless its profile states it, h."""
RECENT = timedelta(days=30)
MANY = 10_000


class RunState(Enum):
    """State of an unfinished run."""

    LEFT_OPEN = "left open"
    """Its process has ended without sealing it."""
    SEALED = "sealed"
    """It isn't in the registry, or its end isn't."""
    MEASURED = "measured"
    """It is complete and entered; its result isn't registered."""
    INTERRUPTED = "interrupted"
    """A calibration that can be resumed; from its beginning if it has no point yet."""
    COPY = "copy"
    """A folder with another name than its run: copied, or renamed. It is never entered."""


@dataclass(frozen=True)
class UnfinishedRun:
    """An unfinished run, and the possible actions.

    Parameters
    ----------
    run_id, kind : str
    state : RunState
    folder : pathlib.Path
    """

    run_id: str
    kind: str
    state: RunState
    folder: Path

    @property
    def found(self) -> str:
        """Its state, in words."""
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
        """Where the run's own folder is, or was."""
        return self.folder.with_name(RunFolder(self.folder).run_id)

    @property
    def remedy(self) -> str:
        """Remedy."""
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
                    "`torquebench records finish {run_id}` enters it; so does any start",
                    self.run_id,
                )
            case RunState.MEASURED:
                return Message(
                    "`torquebench records finish {run_id}`: nothing is measured again; "
                    "or `records discard {run_id}`",
                    self.run_id,
                )
        return Message(
            "resume it with `torquebench resume {run_id}`, or `records discard {run_id}`",
            self.run_id,
        )


def unfinished_runs(registry: RunRecords, now: datetime | None = None) -> tuple[UnfinishedRun, ...]:
    """Return every run that isn't finished and that no process writes, the oldest first.

    Parameters
    ----------
    registry : Registry
        Registry of the data directory.
    now : datetime.datetime, optional
        The present time: an interrupted calibration can be resumed for a limited time.
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
    """Yield runs of the data directory that the registry doesn't know, or not the end of.

    Left out are folders that a process writes, and those that another registry has made: the end
    of its chain is noted in them.
    """
    entered = registry.entered_runs(names := _folders(registry.root / "runs"))
    for name in names:
        path = registry.root / "runs" / name
        if entered.get(name) or is_held(path):
            continue
        try:
            folder = RunFolder.open(path)
            metadata = folder.metadata
        except RecordError:  # killed before anything was written
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
    """Return whether a completed run has a result to be registered."""
    if run.kind.startswith("calibrate-"):
        return True
    try:
        return bool(RunFolder(run.folder).metadata.get(REGISTERS))
    except RecordError:  # moved away, or broken: `records verify` reports it
        return False


def _interrupted(registry: RunRecords, now: datetime) -> Iterator[UnfinishedRun]:
    """Yield interrupted calibrations that can still be resumed and have no continuation."""
    candidates = registry.interrupted_calibrations(now - RECENT)
    for run in candidates:
        folder = RunFolder(run.folder)
        if not folder.sealed or not can_go_on(folder, now):
            continue
        if not followers(registry, run) and not _calibrated_since(registry, run):
            yield UnfinishedRun(run.run_id, run.kind, RunState.INTERRUPTED, run.folder)


def can_go_on(folder: RunFolder, now: datetime) -> bool:
    """Return whether an interrupted calibration had begun, not too long ago by its profile.

    A continuation without a point of its own is left out: the run before it is resumed instead.
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

    One that was discarded doesn't count, nor one that ended before it had a point.
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
    """Return the newest unfinished calibration, also one that can't be finished any more.

    None where the newest ones are registered, discarded, or were resumed by a later run.
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
    """Return whether the same module was calibrated completely after a run."""
    for other in registry.runs(limit=MANY, kind=run.kind):
        if other.run_id == run.run_id:
            return False
        if other.status == "completed":
            return True
    return False
