"""Runs that a kill, a power cut or a full disk left open: found and sealed at the next start."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from torquebench.errors import RecordError
from torquebench.records import Recovery, Registry, RunFolder, RunSummary
from torquebench.station.holding import RunLock

__all__ = ["RecoveredRun", "recover_unfinished"]

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class RecoveredRun:
    """A run that was found open and was sealed as interrupted.

    Parameters
    ----------
    run_id, kind, side : str
    points : int
        Acknowledged points that were kept.
    torn_bytes : int
        Bytes of incomplete ends that were left out.
    damaged : str
        What else was left out because it is damaged, and where.
    problem : str
        Why it could not be sealed yet; empty when it was.
    """

    run_id: str
    kind: str
    side: str
    points: int
    torn_bytes: int = 0
    damaged: str = ""
    problem: str = ""

    @property
    def resumable(self) -> bool:
        """Whether `torquebench calibrate --resume` may go on with it."""
        return self.kind.startswith("calibrate-") and self.points > 0 and not self.problem

    @property
    def advice(self) -> str:
        """What to do about it."""
        if self.problem:
            return f"it can't be sealed yet ({self.problem}); make room or repair the disk"
        if self.resumable:
            return f"go on with `torquebench calibrate --resume {self.run_id}`, or start again"
        return "start again; what was recorded stays"


def recover_unfinished(registry: Registry) -> tuple[RecoveredRun, ...]:
    """Seal every run of a registry that is open although nobody writes it any more.

    Complete documents and samples are kept, incomplete ends are cut off and counted; nothing is
    filled in. A run that another process holds is left alone.
    """
    found = []
    for run in registry.unfinished_runs():
        recovered = _recovered(registry, run)
        if recovered is not None:
            found.append(recovered)
    return tuple(found)


def _recovered(registry: Registry, run: RunSummary) -> RecoveredRun | None:
    try:
        folder = RunFolder.open(run.folder)
        hold = RunLock(folder.path)
    except (RecordError, OSError) as error:
        return RecoveredRun(run.run_id, run.kind, run.side, 0, problem=str(error))
    if not hold.held:
        return None
    torn_bytes, damaged = 0, ""
    try:
        if not folder.sealed:
            report = folder.recover()
            torn_bytes = report.torn_document_bytes + report.torn_raw_bytes + report.torn_edge_bytes
            damaged = _named(report)
        try:
            registry.finish_run(folder)
        except RecordError:
            if any(each.run_id == run.run_id for each in registry.unfinished_runs()):
                raise  # no other process was quicker: it can't be entered
        points = _points(folder)
        return RecoveredRun(run.run_id, run.kind, run.side, points, torn_bytes, damaged)
    except (RecordError, OSError) as error:
        logger.warning("run %s can't be recovered: %s", run.run_id, error)
        return RecoveredRun(run.run_id, run.kind, run.side, 0, problem=str(error))
    finally:
        hold.release()


def _named(report: Recovery) -> str:
    parts = [f"events.jsonl {damage}" for damage in report.damages]
    parts += [name for name in report.damaged_files if name != "events.jsonl"]
    return ", ".join(parts)


def _points(folder: RunFolder) -> int:
    """Count the points that were acknowledged, zeros and other streams left out."""
    streams = {
        document["uid"]
        for _, document in folder.documents("descriptor")
        if document.get("name") == "points"
    }
    return sum(document["descriptor"] in streams for _, document in folder.documents("event"))
