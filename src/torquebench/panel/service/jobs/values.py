"""Values of a job for display."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any, Literal

from torquebench.errors import TorquebenchError
from torquebench.message import Message
from torquebench.records.files import plain_json

__all__ = [
    "JobPoint",
    "JobPreview",
    "JobResult",
    "JobStage",
    "JobState",
    "JobView",
    "PendingPrompt",
    "Problem",
]

JobState = Literal["running", "pausing", "paused", "aborting", "done", "failed", "aborted"]


@dataclass(frozen=True)
class Problem:
    """Why something was refused or failed.

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
        """Put an error into words.

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
    """A finished part of a job: its title and its result, in words."""

    title: str
    detail: str
    seconds: float


@dataclass(frozen=True)
class JobPoint:
    """One recorded point, as soon as it is recorded.

    Parameters
    ----------
    number : int
        Counts from 1 within the job.
    stream : str
        Such as "points" or "zero_output".
    values : mapping of str to float
        Measured fields and the point's stamp (`series`, `branch`, `nominal_nm`, …); with a
        standard mounted also `error_nm`, reading minus standard.
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
class JobPreview:
    """Preview of a job, checked against limits and interlocks; nothing has moved.

    Parameters
    ----------
    kind, title : str
    duration_s : float
        Bench time without waiting longer for settling or warming up, s.
    points : int
    largest_torque_nm, limit_torque_nm : mapping of side to float
        Largest commanded torque, and the bench's limit.
    largest_speed_rpm, limit_speed_rpm : mapping of side to float
    time_s, nominal_nm : tuple of float
        The torque commanded to the loaded side over time, for a staircase; empty otherwise.
    mounts : tuple of str
        The mountings that the person at the bench will make, in order.
    remarks : tuple of str
    doubts : tuple of str
        Doubts about the result, such as an expired standard or a wrong clock.
    """

    kind: str
    title: str
    duration_s: float
    points: int
    largest_torque_nm: Mapping[str, float] = field(default_factory=dict)
    limit_torque_nm: Mapping[str, float] = field(default_factory=dict)
    largest_speed_rpm: Mapping[str, float] = field(default_factory=dict)
    limit_speed_rpm: Mapping[str, float] = field(default_factory=dict)
    time_s: tuple[float, ...] = ()
    nominal_nm: tuple[float, ...] = ()
    mounts: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


@dataclass(frozen=True)
class JobResult:
    """Result of a job.

    Parameters
    ----------
    headline : str
        One sentence.
    verdict : str
        "pass", "conditionalPass", "conditionalFail", "fail", or empty without a tolerance.
    simulated : bool
        Whether every figure has to say so.
    run_ids : tuple of str
    calibration_id : int or None
    model_ids : mapping of model name to int
    certificate : str or None
        Number of the certificate that was issued.
    details : mapping
        Tables and curves as JSON; given as a type of `jobs.details`.
    """

    headline: str
    verdict: str = ""
    simulated: bool = False
    run_ids: tuple[str, ...] = ()
    calibration_id: int | None = None
    model_ids: Mapping[str, int] = field(default_factory=dict)
    certificate: str | None = None
    details: Any = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Hold the details as JSON does: plain lists, numbers and text."""
        object.__setattr__(self, "details", plain_json(self.details))


@dataclass(frozen=True)
class JobView:
    """The present state of a job.

    Parameters
    ----------
    job_id, kind, title : str
    request : mapping
        The request, as JSON.
    started_by : str
    state : {"running", "pausing", "paused", "aborting", "done", "failed", "aborted"}
    can_pause : bool
    can_finish : bool
        Whether it runs until a user finishes it.
    stage : str
        The present step.
    done, total : int, int or None
        Steps of the stage; None if unknown.
    detail : str
    stages : tuple of JobStage
        The finished stages.
    points : int
        Number of points in `jobs.points`.
    started, finished : datetime.datetime
        UTC; `finished` is None while it is open.
    problem : Problem or None
        Why it failed or was aborted.
    result : JobResult or None
        Once it is done.
    """

    job_id: str
    kind: str
    title: str
    request: Mapping[str, Any]
    started_by: str
    started: datetime
    can_pause: bool
    can_finish: bool = False
    state: JobState = "running"
    stage: str = ""
    done: int = 0
    total: int | None = None
    detail: str = ""
    stages: tuple[JobStage, ...] = ()
    points: int = 0
    finished: datetime | None = None
    problem: Problem | None = None
    result: JobResult | None = None

    @property
    def open(self) -> bool:
        """Whether it is still under way."""
        return self.finished is None
