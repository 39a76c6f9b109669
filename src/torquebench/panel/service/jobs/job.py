"""A job: a running operation with its progress, points and end."""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Annotated, Any, Literal

from pydantic import PlainSerializer

from torquebench.errors import TorquebenchError
from torquebench.message import Message
from torquebench.operations import Operation, Request, Result
from torquebench.panel.service.access.actors import Actor

MOST_POINTS = 20_000
LEAST_STEPS = 2
"""Steps of a stage by which its remaining time is estimated."""
JSON = PlainSerializer(lambda result: None if result is None else result.plain())
"""Serialiser of results of any type; `api.describing` adds their schemas."""

JobState = Literal[
    "running", "pausing", "paused", "aborting", "done", "failed", "aborted", "interrupted"
]


@dataclass(frozen=True)
class Problem:
    """Reason of a refusal or failure.

    Parameters
    ----------
    kind : str
        Name of the error's class, for programs.
    found, allowed, remedy : str
    """

    kind: str
    found: str
    allowed: str = ""
    remedy: str = ""

    @classmethod
    def of(cls, error: BaseException) -> Problem:
        """Convert an exception to a problem.

        Examples
        --------
        >>> Problem.of(TorquebenchError("2500 N·m", "2000 N·m", "load less")).allowed
        '2000 N·m'
        """
        if isinstance(error, TorquebenchError):
            return cls(type(error).__name__, error.found, error.allowed, error.remedy)
        return cls(
            type(error).__name__,
            Message("unforeseen: {error}", error),
            "",
            "report it with the log",
        )


@dataclass(frozen=True)
class JobStage:
    """A finished stage of a job, with its result as text."""

    title: str
    detail: str
    seconds: float


@dataclass(frozen=True)
class JobPoint:
    """A recorded point of a running or finished job.

    Parameters
    ----------
    number : int
        Number of the point within the job, from 1.
    stream : str
        Stream of the point, such as "points" or "zero_output".
    values : mapping of str to float
        Measured values and the point's labels (`series`, `branch`, `nominal_nm`, …); with a mounted
        standard also `error_nm`, reading minus standard.
    """

    number: int
    stream: str
    values: Mapping[str, float]


@dataclass(frozen=True)
class PendingPrompt:
    """A request to the person at the bench."""

    number: int
    text: str


@dataclass(frozen=True)
class JobView:
    """The present state of a job.

    Parameters
    ----------
    job_id, kind, title : str
    request : mapping
        The request, as JSON.
    started_by : str
    state : {"running", "pausing", "paused", "aborting", "done", "failed", "aborted", "interrupted"}
        "interrupted" means by the end of the server.
    can_pause : bool
    beside : bool
        Whether it is a recording, which leaves the bench to other jobs.
    can_finish : bool
        Whether it runs until a user finishes it.
    stage : str
        Title of the present stage.
    done, total : int, int or None
        Finished and total steps of the stage; None if unknown.
    detail : str
    remaining_s : float or None
        How long the stage still takes, s, by the mean time of its steps; None until two are done.
    stages : tuple of JobStage
        The finished stages.
    points : int
        Number of points in `jobs.points`.
    started, finished : datetime.datetime
        UTC; `finished` is None while it is open, and where the end of the server interrupted it.
    problem : Problem or None
        Why it failed or was aborted.
    result : Result or None
        Result of a finished job.
    """

    job_id: str
    kind: str
    title: str
    request: Mapping[str, Any]
    started_by: str
    started: datetime
    can_pause: bool
    beside: bool = False
    can_finish: bool = False
    state: JobState = "running"
    stage: str = ""
    done: int = 0
    total: int | None = None
    detail: str = ""
    remaining_s: float | None = None
    stages: tuple[JobStage, ...] = ()
    points: int = 0
    finished: datetime | None = None
    problem: Problem | None = None
    result: Annotated[Result | None, JSON] = None

    @property
    def open(self) -> bool:
        """Whether the job hasn't ended."""
        return self.finished is None and self.state != "interrupted"


class Points:
    """Converts a run's documents to points as they arrive.

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
        """Return the points after a number."""
        return self._points[max(0, number) :]


def _values(data: Mapping[str, Any]) -> dict[str, float]:
    """Return an event's numbers by field, or by device and field for equal field names."""
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
    """A running job, which also receives its operation's progress; safe to use from any thread.

    Parameters
    ----------
    operation : Operation
    request : Request
    actor : Actor
        The actor who started it.
    signed : bool
        Whether the person signed it with the password.
    """

    def __init__(
        self, operation: Operation, request: Request, actor: Actor, *, signed: bool = False
    ) -> None:
        self.operation, self.request, self.actor, self.signed = operation, request, actor, signed
        self.points = Points()
        self.finishing, self.ended = threading.Event(), threading.Event()
        self.abort_reason = ""
        """Who or what has aborted it; empty while it goes on."""
        self._state = JobView(
            job_id=secrets.token_hex(6),
            kind=operation.key,
            title=operation.title(request),
            request=request.model_dump(mode="json"),
            started_by=actor.label,
            started=datetime.now(UTC),
            can_pause=operation.can_pause,
            beside=operation.beside,
            can_finish=operation.can_finish,
        )
        self._lock = threading.RLock()
        self._stage_since = self._reached_at = 0.0

    def view(self) -> JobView:
        """Return the present state of the job."""
        with self._lock:
            may_finish = self._state.can_finish and not self.finishing.is_set()
            return replace(
                self._state,
                points=len(self.points),
                can_finish=may_finish,
                remaining_s=self._remaining_s(),
            )

    def _remaining_s(self) -> float | None:
        """Return how long the stage still takes by the mean time of its steps."""
        done, total = self._state.done, self._state.total
        if total is None or done < LEAST_STEPS or self._state.state != "running":
            return None
        return (total - done) * (self._reached_at - self._stage_since) / done

    def _set(self, **changes: Any) -> None:
        with self._lock:
            self._state = replace(self._state, **changes)

    # -- events of a campaign ---------------------------------------------------------------

    def start(self, title: str, total: int | None = None) -> None:
        """Begin a stage, and end the previous one."""
        with self._lock:
            self.finish()
            self._set(stage=title, total=total, done=0, detail="")
            self._stage_since = time.monotonic()

    def reach(self, done: int, detail: str = "") -> None:
        """Report the number of finished steps and the present one."""
        self._reached_at = time.monotonic()
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
        """Change the state if it is one of `before`; return whether it was."""
        with self._lock:
            if self._state.state not in before:
                return False
            self._set(state=after)
            return True

    # -- its end ----------------------------------------------------------------------------

    def end(
        self, state: JobState, *, problem: Problem | None = None, result: Result | None = None
    ) -> None:
        """Store the end of the job."""
        with self._lock:
            if state == "done":
                self.finish()
            self._set(state=state, problem=problem, result=result, finished=datetime.now(UTC))
        self.ended.set()
