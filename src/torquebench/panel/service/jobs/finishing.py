"""Jobs that finish an interrupted run, or discard it.

Details of their results: for a calibration those of "calibrate"; for other runs none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from torquebench.campaign.finishing import discard_run, find_unfinished, finish_run
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.panel.service.fields import RunId
from torquebench.panel.service.jobs.calibrations import calibration_job_result
from torquebench.panel.service.jobs.runner import JobContext, JobKind, JobRequest, Workplace
from torquebench.panel.service.jobs.values import JobResult
from torquebench.panel.service.problems import NotFoundError
from torquebench.records import Registry, unfinished_runs

__all__ = ["FINISHING_KINDS", "DiscardRequest", "FinishRequest", "UnfinishedView", "unfinished"]


@dataclass(frozen=True)
class UnfinishedView:
    """An unfinished run.

    Parameters
    ----------
    run_id, kind : str
    state : {"left open", "sealed", "measured", "interrupted", "copy"}
        Its state: "interrupted" must be resumed on its bench, "copy" is a folder that is never
        entered, the others can be finished without measuring.
    found, remedy : str
        Its state in words, and the command that finishes it.
    """

    run_id: str
    kind: str
    state: str
    found: str
    remedy: str


def unfinished(registry: Registry) -> list[UnfinishedView]:
    """Return the runs that aren't finished and that no process writes, the oldest first."""
    return [
        UnfinishedView(run.run_id, run.kind, run.state.value, run.found, run.remedy)
        for run in unfinished_runs(registry)
    ]


class FinishRequest(JobRequest):
    """Enter, fit and register an unfinished run; nothing is measured again."""

    run_id: RunId


class DiscardRequest(JobRequest):
    """Discard an unfinished run; its folder stays unchanged."""

    run_id: RunId
    reason: Annotated[str, Field(min_length=1, max_length=200)]


def run_finish(context: JobContext, request: FinishRequest) -> JobResult:
    """Finish a run as its own job would have done."""
    registry = context.station.registry
    run = find_unfinished(registry, request.run_id)
    finished = finish_run(registry, run, context.job)
    if finished.calibration is not None:
        return calibration_job_result(finished.calibration)
    return JobResult(
        headline=Message("{sentence}.", finished.sentence),
        simulated=registry.run(run.run_id).simulated,
        run_ids=(run.run_id,),
    )


def run_discard(context: JobContext, request: DiscardRequest) -> JobResult:
    """Enter the decision and its reason."""
    registry = context.station.registry
    run = find_unfinished(registry, request.run_id)
    discard_run(registry, run, by=context.actor.label, reason=request.reason)
    return JobResult(
        headline=Message("run {run} is discarded.", run.run_id),
        simulated=registry.run(run.run_id).simulated,
        run_ids=(run.run_id,),
    )


def _check_unfinished(place: Workplace, request: FinishRequest | DiscardRequest) -> None:
    try:
        find_unfinished(place.station.registry, request.run_id)
    except InputError as problem:
        raise NotFoundError(problem.found, problem.allowed, problem.remedy) from None


FINISHING_KINDS: tuple[JobKind, ...] = (
    JobKind(
        "finish-run",
        lambda asked: Message("Finish {run_id}", asked.run_id),
        FinishRequest,
        run_finish,
        check=_check_unfinished,
        moves=False,
        can_pause=False,
    ),
    JobKind(
        "discard-run",
        lambda asked: Message("Discard {run_id}", asked.run_id),
        DiscardRequest,
        run_discard,
        check=_check_unfinished,
        role="metrologist",
        moves=False,
        can_pause=False,
    ),
)
