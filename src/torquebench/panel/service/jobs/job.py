"""A running job: its progress, its points and its end."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
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
from torquebench.records.signatures import Signature

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
    values: dict[str, float] = {}
    for key, value in data.items():
        if not isinstance(value, int | float):
            continue
        device, _, name = key.rpartition("-")
        short = name or key
        if short in values:
            short = f"{device.partition('-')[0]}_{name}"
        values[short] = float(value)
    if "reading_nm" in values and "standard_nm" in values:
        values["error_nm"] = values["reading_nm"] - values["standard_nm"]
    return values


class Job:
    """A job under way; also the campaign's progress watcher. Safe to use from any thread.

    Parameters
    ----------
    state : JobView
        At its start.
    actor : Actor
    """

    def __init__(self, state: JobView, actor: Actor) -> None:
        self.actor = actor
        self.signature: Signature | None = None
        self.points = Points()
        self.cancelled, self.finishing, self.ended = (threading.Event() for _ in range(3))
        self._state = state
        self._lock = threading.RLock()
        self._stage_since = 0.0

    def view(self) -> JobView:
        """Return the present state of the job."""
        with self._lock:
            may_finish = self._state.can_finish and not self.finishing.is_set()
            return replace(self._state, points=len(self.points), can_finish=may_finish)

    def _set(self, **changes: Any) -> None:
        with self._lock:
            self._state = replace(self._state, **changes)

    # -- events of a campaign ---------------------------------------------------------------

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage; ends the stage before."""
        with self._lock:
            self.finish()
            self._set(stage=title, total=total, done=0, detail="")
            self._stage_since = time.monotonic()

    def reach(self, done: int, detail: str = "") -> None:
        """Report the number of finished steps and the present one."""
        self._set(done=done, detail=detail)

    def finish(self, detail: str = "") -> None:
        """End the stage."""
        with self._lock:
            if self._state.stage:
                seconds = time.monotonic() - self._stage_since
                stage = JobStage(self._state.stage, detail, seconds)
                stages = (*self._state.stages, stage)
                self._set(stages=stages, stage="", total=None, done=0, detail="")

    # -- requests of people -----------------------------------------------------------------

    def change(self, before: Sequence[JobState], after: JobState) -> bool:
        """Change from one of some states to another; False where it is in none of them."""
        with self._lock:
            if self._state.state not in before:
                return False
            self._set(state=after)
            return True

    # -- its end ----------------------------------------------------------------------------

    def end(
        self, state: JobState, *, problem: Problem | None = None, result: JobResult | None = None
    ) -> None:
        """Note how it ended."""
        with self._lock:
            if state == "done":
                self.finish()
            self._set(state=state, problem=problem, result=result, finished=datetime.now(UTC))
        self.ended.set()
