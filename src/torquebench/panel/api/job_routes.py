"""Routes of operations, and of jobs: start, watch, pause, resume, abort."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query
from pydantic import BaseModel, Field, create_model

from torquebench.operations import (
    OPERATIONS,
    Flag,
    Operation,
    Preview,
    Request,
    Role,
)
from torquebench.operations.queue import QueuedRequest
from torquebench.panel.api.access import Caller, Service, Watched
from torquebench.panel.api.models import (
    AbortBody,
    AnswerBody,
    QueuePlaceBody,
    QueueStartBody,
    Secret,
)
from torquebench.panel.service import JobPoint, JobView, PendingPrompt, QueueItem, QueueView

router = APIRouter(tags=["jobs"])

SERVED = tuple(each for each in OPERATIONS.values() if each.served)
JobId = Annotated[str, Path(pattern=r"^[0-9a-f]{12}$")]


@router.get("/jobs")
def jobs(service: Watched) -> list[JobView]:
    """Return the last jobs, also those before the server's start, the newest first."""
    return service.jobs.last()


@router.get("/jobs/{job_id}")
def job(service: Watched, job_id: JobId) -> JobView:
    """Return the present state of a job, or a job that ended with its result."""
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
def pause_job(service: Service, caller: Caller, job_id: JobId) -> JobView:
    """Pause a job at its next point, with zero torque."""
    return service.jobs.pause(caller, job_id)


@router.post("/jobs/{job_id}/resume")
def resume_job(service: Service, caller: Caller, job_id: JobId) -> JobView:
    """Resume a paused job."""
    return service.jobs.resume(caller, job_id)


@router.post("/jobs/{job_id}/finish")
def finish_job(service: Service, caller: Caller, job_id: JobId) -> JobView:
    """Finish a job without a fixed end, such as a recording, and return its result."""
    return service.jobs.finish(caller, job_id)


@router.post("/jobs/{job_id}/abort")
def abort_job(service: Service, caller: Caller, job_id: JobId, body: AbortBody) -> JobView:
    """Abort a job with zero torque."""
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


# -- the queue ------------------------------------------------------------------------------

Number = Annotated[int, Path(ge=1, le=2**53)]


@router.get("/queue")
def queue(service: Watched) -> QueueView:
    """Return the queue of operations and its history."""
    return service.queue.view()


@router.post("/queue", status_code=201)
def add_to_queue(service: Service, caller: Caller, body: QueuedRequest) -> QueueItem:
    """Add an operation to the end of the queue."""
    return service.queue.add(caller, body.name, body.request)


@router.delete("/queue/{number:int}", status_code=204)
def remove_from_queue(service: Service, caller: Caller, number: Number) -> None:
    """Remove a waiting operation from the queue."""
    service.queue.remove(caller, number)


@router.post("/queue/{number:int}/move", status_code=204)
def move_in_queue(service: Service, caller: Caller, number: Number, body: QueuePlaceBody) -> None:
    """Move a waiting operation to another place in the queue."""
    service.queue.move(caller, number, body.place)


@router.post("/queue/start")
def start_queue(service: Service, caller: Caller, body: QueueStartBody) -> QueueView:
    """Start the waiting operations one after the other, until one fails."""
    return service.queue.start(caller, bench_clear=body.bench_clear, keep_going=body.keep_going)


@router.post("/queue/pause")
def pause_queue(service: Service, caller: Caller) -> QueueView:
    """Pause the queue; the running operation continues."""
    return service.queue.pause(caller)


# -- operations -----------------------------------------------------------------------------


class OperationView(BaseModel):
    """An operation with its title and minimum role; its route describes the parameters."""

    key: str
    summary: str
    role: Role
    moves: bool
    quick: bool = Field(description="Whether the response is its result; otherwise it is a job.")
    signed: bool = Field(description="Whether it must be signed with the password.")


@router.get("/operations", tags=["operations"])
def operations(_service: Watched) -> list[OperationView]:
    """Return all operations."""
    return [
        OperationView(
            key=each.key,
            summary=each.summary,
            role=each.role,
            moves=each.moves,
            quick=each.quick,
            signed=each.signed,
        )
        for each in SERVED
    ]


def _body(operation: Operation) -> type[Request]:
    """Return the model of an operation's request body: its fields, confirmation and password."""
    added: dict[str, Any] = {}
    if operation.loads:
        added["bench_clear"] = (Flag, False)
    if operation.signed:
        added["password"] = (Secret, ...)
    elif operation.signable:
        added["password"] = (Secret | None, None)
    base = operation.request
    if local := operation.local_fields:
        added |= {
            name: (info.annotation, info)
            for name, info in base.model_fields.items()
            if name not in local
        }
        base = Request
    if not added:
        return base
    body = create_model(operation.request.__name__, __base__=base, **added)
    body.__doc__ = operation.request.__doc__
    return body


def _parts(operation: Operation, body: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split a body into the request's fields, and confirmation and password."""
    values = {name: getattr(body, name) for name in body.model_fields_set}
    beside = {name: values.pop(name) for name in ("bench_clear", "password") if name in values}
    return {name: values[name] for name in operation.request.model_fields if name in values}, beside


def _starter(operation: Operation, body_type: type[Request]) -> Callable[..., JobView]:
    def start(service: Service, caller: Caller, body: Any) -> JobView:
        request, beside = _parts(operation, body)
        return service.start(caller, operation.name, request, **beside)

    start.__annotations__["body"] = body_type
    return start


def _performer(operation: Operation, body_type: type[Request]) -> Callable[..., Any]:
    def perform(service: Service, caller: Caller, body: Any) -> Any:
        request, beside = _parts(operation, body)
        result = service.perform(caller, operation.name, request, **beside)
        if operation.activates:  # wait until the live values use the new model
            service.wait_for_live()
        return result.plain()

    perform.__annotations__["body"] = body_type
    return perform


def _previewer(operation: Operation, body_type: type[Request]) -> Callable[..., Preview]:
    def preview(service: Watched, body: Any) -> Preview:
        return service.jobs.preview(operation.name, _parts(operation, body)[0])

    preview.__annotations__["body"] = body_type
    return preview


def _add(operation: Operation) -> None:
    """Add the routes of an operation."""
    name, body = operation.key.replace("-", "_"), _body(operation)
    quick = operation.quick
    router.add_api_route(
        f"/operations/{operation.key}",
        (_performer if quick else _starter)(operation, body),
        methods=["POST"],
        status_code=200 if quick else 202,
        name=name,
        summary=operation.summary,
        description=operation.description,
        tags=["operations"],
    )
    if operation.preview is not None:
        router.add_api_route(
            f"/operations/{operation.key}/preview",
            _previewer(operation, body),
            methods=["POST"],
            name=f"preview_{name}",
            summary=f"Preview: {operation.summary}",
            description=f"{operation.description}\n\nDry run: nothing moves.",
            tags=["operations"],
        )


for _operation in SERVED:
    _add(_operation)
