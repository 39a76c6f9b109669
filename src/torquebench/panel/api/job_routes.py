"""Operations on jobs: start, watch, pause, resume, abort; one operation for each kind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query

from torquebench.panel.api.access import Caller, Service, Watched
from torquebench.panel.api.models import AbortBody, AnswerBody
from torquebench.panel.service import (
    JOB_KINDS,
    JobPoint,
    JobPreview,
    JobView,
    PendingPrompt,
)
from torquebench.panel.service.jobs.runner import JobKind

__all__ = ["router"]

router = APIRouter(tags=["jobs"])

JobId = Annotated[str, Path(pattern=r"^[0-9a-f]{12}$")]


@router.get("/jobs")
def jobs(service: Watched) -> list[JobView]:
    """Return the last jobs, the newest first."""
    return service.jobs.recent()


@router.get("/jobs/{job_id}")
def job(service: Watched, job_id: JobId) -> JobView:
    """Return the present state of a job."""
    return service.jobs.get(job_id)


@router.get("/jobs/{job_id}/points")
def points(
    service: Watched,
    job_id: JobId,
    since: Annotated[int, Query(ge=0, le=2**53)] = 0,
) -> list[JobPoint]:
    """Return the points of a job after a number, up to now."""
    return service.jobs.points(job_id, since)


@router.post("/jobs/{job_id}/pause")
def pause(service: Service, caller: Caller, job_id: JobId) -> JobView:
    """Hold a job at its next point, without torque."""
    return service.jobs.pause(caller, job_id)


@router.post("/jobs/{job_id}/resume")
def resume(service: Service, caller: Caller, job_id: JobId) -> JobView:
    """Let a paused job go on."""
    return service.jobs.resume(caller, job_id)


@router.post("/jobs/{job_id}/finish")
def finish(service: Service, caller: Caller, job_id: JobId) -> JobView:
    """End a job that continues until then, such as a recording, with its result."""
    return service.jobs.finish(caller, job_id)


@router.post("/jobs/{job_id}/abort")
def abort(service: Service, caller: Caller, job_id: JobId, body: AbortBody) -> JobView:
    """End a job with zero torque."""
    return service.jobs.abort(caller, job_id, body.reason)


@router.get("/prompt")
def prompt(service: Watched) -> PendingPrompt | None:
    """Return the pending request to the person at the bench, or null."""
    return service.jobs.prompt


@router.post("/prompt/{number}", status_code=204)
def answer(
    service: Service,
    caller: Caller,
    number: Annotated[int, Path(ge=1, le=2**53)],
    body: AnswerBody,
) -> None:
    """Answer the request to the person at the bench."""
    service.jobs.answer(caller, number, done=body.done)


def _starter(kind: JobKind) -> Callable[..., JobView]:
    def start(service: Service, caller: Caller, body: Any) -> JobView:
        return service.jobs.start(caller, kind.name, body)

    start.__annotations__["body"] = kind.request
    return start


def _previewer(kind: JobKind) -> Callable[..., JobPreview]:
    def preview(service: Watched, body: Any) -> JobPreview:
        return service.jobs.preview(kind.name, body)

    preview.__annotations__["body"] = kind.request
    return preview


def _add(kind: JobKind) -> None:
    words = (kind.request.__doc__ or "").strip()
    name = kind.name.replace("-", "_")
    router.add_api_route(
        f"/start/{kind.name}",
        _starter(kind),
        methods=["POST"],
        status_code=202,
        name=f"start_{name}",
        summary=f"Start: {kind.name}",
        description=words,
    )
    if kind.preview is not None:
        router.add_api_route(
            f"/preview/{kind.name}",
            _previewer(kind),
            methods=["POST"],
            name=f"preview_{name}",
            summary=f"Preview: {kind.name}",
            description=f"{words}\n\nDry run: nothing moves.",
        )


for _kind in JOB_KINDS.values():
    _add(_kind)
