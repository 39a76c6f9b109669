"""Seal and register runs that a kill, a full disk or a failing registry left unfinished."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records import (
    Recovery,
    Registry,
    RunFolder,
    RunLock,
    RunState,
    UnfinishedRun,
    unentered_folders,
)
from torquebench.station.entering import enter_run

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RecoveredRun:
    """Result of recovering a run that wasn't sealed or registered.

    Parameters
    ----------
    points : int
        Number of acknowledged points.
    torn_bytes : int
        Bytes of incomplete ends that were removed.
    damaged : str
        Damaged parts that were removed.
    status : str
        "interrupted", or the status in the sealed folder.
    problem : str
        Why the run couldn't be sealed or registered; empty after success.
    """

    run_id: str
    kind: str
    side: str
    points: int
    torn_bytes: int = 0
    damaged: str = ""
    status: str = "interrupted"
    problem: str = ""

    @property
    def advice(self) -> str:
        """What to do next; empty for runs that `unfinished_runs` lists with their remedies."""
        if self.problem:
            return Message(
                "it can't be registered yet ({problem}); make room on the disk or repair it",
                self.problem,
            )
        return "start the run again; recorded data are kept"


def recover_unfinished(registry: Registry) -> tuple[RecoveredRun, ...]:
    """Seal unsealed runs, and add missing entries of this data directory's runs to the registry.

    Complete documents and samples are kept; incomplete ends are removed and counted. A run that
    another process has locked is skipped. The caller must hold the data directory's lock
    (`BenchLock`), because a run that is just starting isn't locked yet.
    """
    found = [
        _recovered(registry, run)
        for run in unentered_folders(registry)
        if run.state is not RunState.COPY
    ]
    runs = registry.root / "runs"
    for run in registry.unfinished_runs():
        if run.folder.parent == runs and not run.folder.is_dir():
            gone = Message("{place} is missing", run.folder)
            found.append(RecoveredRun(run.run_id, run.kind, run.side, 0, problem=gone))
    return tuple(each for each in found if each is not None)


def _recovered(registry: Registry, run: UnfinishedRun) -> RecoveredRun | None:
    folder, side = RunFolder(run.folder), ""
    try:
        side = str(folder.metadata.get("side", ""))
        hold = RunLock(folder.path)
    except (RecordError, OSError) as error:
        return RecoveredRun(run.run_id, run.kind, side, 0, problem=Message.of(error))
    if not hold.held:
        return None
    torn_bytes, damaged = 0, ""
    try:
        if not folder.sealed:
            report = folder.recover()
            torn_bytes = report.torn_document_bytes + report.torn_raw_bytes + report.torn_edge_bytes
            damaged = _named(report)
        enter_run(registry, folder)
        status, points = str(folder.manifest["status"]), sum(1 for _ in folder.points())
        return RecoveredRun(run.run_id, run.kind, side, points, torn_bytes, damaged, status)
    except (RecordError, InputError, OSError) as error:
        logger.warning("run %s can't be recovered: %s", run.run_id, error)
        return RecoveredRun(run.run_id, run.kind, side, 0, problem=Message.of(error))
    finally:
        hold.release()


def _named(report: Recovery) -> str:
    parts = [f"events.jsonl {damage}" for damage in report.damages]
    parts += [name for name in report.damaged_files if name != "events.jsonl"]
    return ", ".join(parts)
