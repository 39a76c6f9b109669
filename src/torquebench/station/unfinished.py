"""Unfinished runs of a kill, a full disk or a database: sealed and entered at the start."""

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

__all__ = ["RecoveredRun", "recover_unfinished"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RecoveredRun:
    """A recovered open or unregistered run, and the action taken.

    Parameters
    ----------
    run_id, kind, side : str
    points : int
        Acknowledged points that were kept.
    torn_bytes : int
        Bytes of incomplete ends that were left out.
    damaged : str
        Further omitted parts because of damage, with their place.
    status : str
        Its end: "interrupted", or the status in its sealed folder.
    problem : str
        Why it could not be sealed or entered yet; empty when it was.
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
        """Remedy; empty for `unfinished_runs`, which have their own."""
        if self.problem:
            return Message(
                "it can't be entered yet ({problem}); make room or repair the disk", self.problem
            )
        return "start again; what was recorded stays"


def recover_unfinished(registry: Registry) -> tuple[RecoveredRun, ...]:
    """Seal unsealed runs, and enter missing entries of this bench's runs into the registry.

    Complete documents and samples are kept, incomplete ends are cut off and counted. A run that
    another process has locked is skipped. The caller must hold the data directory's lock
    (`BenchLock`): a run that is just beginning isn't locked yet.
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
