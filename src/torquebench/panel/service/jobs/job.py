"""A running job: its progress, its points and its end."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from torquebench.panel.service.access.actors import Actor
from torquebench.panel.service.jobs.values import (
    JobPoint,
    JobResult,
    JobStage,
    JobState,
    JobView,
    Problem,
)

__all__ = ["Job", "Points"]

MOST_POINTS = 20_000


class Points:
    """Turns a run's documents into points as they arrive.

    Examples
    --------
    >>> points = Points()
    >>> points("descriptor", {"uid": "d", "name": "points"})
    >>> points("event", {"descriptor": "d", "data": {"output-steady-reading_nm": 10.5,
    ...     "output-steady-standard_nm": 10.0, "point-series": 1, "output-steady-settled": True}})
    >>> points.since(0)[0].values
    {'reading_nm': 10.5, 'standard_nm': 10.0, 'series': 1.0, 'settled': 1.0, 'error_nm': 0.5}
    """

    def __init__(self) -> None:
        self._streams: dict[str, str] = {}
        self._points: list[JobPoint] = []

    def __call__(self, name: str, document: Mapping[str, Any]) -> None:
        """Receive a document, on the run engine's thread."""
        if name == "descriptor":
            self._streams[document["uid"]] = document["name"]
        elif name == "event" and len(self._points) < MOST_POINTS:
            stream = self._streams.get(document["descriptor"], "")
            values = _values(document["data"])
            self._points.append(JobPoint(len(self._points) + 1, stream, values))

    def __len__(self) -> int:
        return len(self._points)

    def since(self, number: int) -> list[JobPoint]:
        """Return the points after one."""
        return self._points[max(0, number) :]


def _values(data: Mapping[str, Any]) -> dict[str, float]:
    """Return an event's numbers by field; by device and field for equal field names."""
    found: dict[str, float] = {}
    for key, value in data.items():
        if not isinstance(value, int | float):
            continue
        device, _, name = key.rpartition("-")
        short = name or key
        if short in found:
            short = f"{device.partition('-')[0]}_{name}"
        found[short] = float(value)
    if "reading_nm" in found and "standard_nm" in found:
        found["error_nm"] = found["reading_nm"] - found["standard_nm"]
    return found


@dataclass(eq=False)
class Job:
    """A job under way; also the campaign's progress watcher. Safe to use from any thread."""

    kind: str
    title: str
    request: Mapping[str, Any]
    actor: Actor
    can_pause: bool
    can_finish: bool = False
    job_id: str = field(default_factory=lambda: secrets.token_hex(6))
    points: Points = field(default_factory=Points)
    state: JobState = "running"
    started: datetime = field(default_factory=lambda: datetime.now(UTC))
    finished: datetime | None = None
    problem: Problem | None = None
    result: JobResult | None = None
    cancelled: threading.Event = field(default_factory=threading.Event)
    finishing: threading.Event = field(default_factory=threading.Event)
    ended: threading.Event = field(default_factory=threading.Event)
    _lock: threading.RLock = field(default_factory=threading.RLock)
    _stage: str = ""
    _stage_since: float = 0.0
    _done: int = 0
    _total: int | None = None
    _detail: str = ""
    _stages: list[JobStage] = field(default_factory=list)

    # -- events of a campaign ---------------------------------------------------------------

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage; ends the stage before."""
        with self._lock:
            self.finish()
            self._stage, self._total, self._done = title, total, 0
            self._stage_since, self._detail = time.monotonic(), ""

    def reach(self, done: int, detail: str = "") -> None:
        """Report the number of finished steps and the present one."""
        with self._lock:
            self._done, self._detail = done, detail

    def finish(self, detail: str = "") -> None:
        """End the stage."""
        with self._lock:
            if not self._stage:
                return
            seconds = time.monotonic() - self._stage_since
            self._stages.append(JobStage(self._stage, detail, seconds))
            self._stage, self._total, self._done, self._detail = "", None, 0, ""

    # -- requests of people -----------------------------------------------------------------

    def change(self, before: Sequence[JobState], after: JobState) -> bool:
        """Change from one of some states to another; False where it is in none of them."""
        with self._lock:
            if self.state not in before:
                return False
            self.state = after
            return True

    # -- its end ----------------------------------------------------------------------------

    def end(
        self, state: JobState, *, problem: Problem | None = None, result: JobResult | None = None
    ) -> None:
        """Note how it ended."""
        with self._lock:
            if state == "done":
                self.finish()
            self.state, self.problem, self.result = state, problem, result
            self.finished = datetime.now(UTC)
        self.ended.set()

    def view(self) -> JobView:
        """Return the present state of the job."""
        with self._lock:
            return JobView(
                job_id=self.job_id,
                kind=self.kind,
                title=self.title,
                request=self.request,
                started_by=self.actor.label,
                state=self.state,
                can_pause=self.can_pause,
                can_finish=self.can_finish and not self.finishing.is_set(),
                stage=self._stage,
                done=self._done,
                total=self._total,
                detail=self._detail,
                stages=tuple(self._stages),
                points=len(self.points),
                started=self.started,
                finished=self.finished,
                problem=self.problem,
                result=self.result,
            )
