"""Input, messages and results of a run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from torquebench.bench.safety import Alarm

__all__ = ["LONGEST_BEFORE_S", "ExitStatus", "RunRecord"]

LONGEST_BEFORE_S = 60.0
"""Longest time before a run for which acquired data are kept, s."""

ExitStatus = Literal["success", "abort", "fail"]


@dataclass(frozen=True)
class RunRecord:
    """Result of a run: its folder and how it ended.

    Parameters
    ----------
    run_id : str
    kind : str
    folder : pathlib.Path
        The sealed run folder.
    exit_status : {"success", "abort"}
        A failed run raises instead.
    result : object
        Return value of the plan; None unless it succeeded.
    reason : str
        Why it was aborted.
    bench_seconds : float
        Bench time that it took, s.
    interruptions : int
        Number of pauses.
    alarms : tuple of Alarm
        Alarms during the run.
    metadata : mapping
        Metadata at the start.
    """

    run_id: str
    kind: str
    folder: Path
    exit_status: ExitStatus
    result: Any = None
    reason: str = ""
    bench_seconds: float = 0.0
    interruptions: int = 0
    alarms: tuple[Alarm, ...] = ()
    metadata: Mapping[str, Any] = field(default_factory=dict)
