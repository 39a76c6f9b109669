"""Server-sent events: jobs, their points, questions to the operator, alarms.

Listeners needn't poll. Each event contains the whole value of `GET /jobs/ID`, `/prompt` or
`/alarms`, so a missed event doesn't matter.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import APIRouter, Query
from pydantic import TypeAdapter
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from torquebench.panel.api.access import Caller, Service, Token, caller_of
from torquebench.panel.service import (
    AlarmView,
    BenchService,
    JobPoint,
    JobView,
    NotSignedInError,
    PendingPrompt,
)

router = APIRouter(tags=["jobs"])

POLL_INTERVAL_S = 0.05
"""Interval at which the bench's state is checked for changes, s."""
ALIVE_S = 15.0
"""Interval of keep-alive messages to a listener without events, s."""
SLOWEST_S = 20.0
"""Timeout for sending to a listener, s."""


@dataclass(frozen=True)
class JobPoints:
    """Points of a job that are new to a listener."""

    job_id: str
    points: list[JobPoint]


_JOB: TypeAdapter[JobView] = TypeAdapter(JobView)
_POINTS: TypeAdapter[JobPoints] = TypeAdapter(JobPoints)
_PROMPT: TypeAdapter[PendingPrompt | None] = TypeAdapter(PendingPrompt | None)
_ALARM: TypeAdapter[AlarmView] = TypeAdapter(AlarmView)


class EventStream(Response):
    """A streaming response until the events end or the listener disconnects."""

    media_type = "text/event-stream"

    def __init__(self, events: AsyncIterator[str]) -> None:
        super().__init__()
        self._events = events

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send every event as it arrives."""
        del scope
        headers = [(b"content-type", b"text/event-stream; charset=utf-8")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        left = asyncio.ensure_future(until_left(receive))
        try:
            async for event in self._events:
                if left.done():
                    return
                body = {"type": "http.response.body", "body": event.encode(), "more_body": True}
                await asyncio.wait_for(send(body), SLOWEST_S)
            await asyncio.wait_for(send({"type": "http.response.body", "body": b""}), SLOWEST_S)
        except TimeoutError:  # the listener doesn't read: the server closes the response
            return
        finally:
            left.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await left


async def until_left(receive: Receive) -> None:
    """Wait until a listener disconnects."""
    while (await receive())["type"] not in ("http.disconnect", "websocket.disconnect"):
        pass


@router.get(
    "/events",
    status_code=200,
    response_class=EventStream,
    responses={
        200: {
            "content": {"text/event-stream": {}},
            "description": "Events `job`, `points`, `prompt` and `alarm`; data as JSON.",
        }
    },
)
async def events(
    service: Service,
    caller: Caller,
    token: Token,
    job_id: Annotated[
        str | None,
        Query(
            pattern=r"^[0-9a-f]{12}$",
            description=("Only events of this job; the stream ends with it."),
        ),
    ] = None,
) -> EventStream:
    """Stream new events: `job`, `points` of jobs, `prompt` and `alarm`.

    The stream ends with the requested job, when the token becomes invalid, and with the server.
    """
    del caller  # every signed-in caller may listen
    if job_id is not None:
        service.jobs.get(job_id)
    return EventStream(_events(service, token, job_id))


async def _events(service: BenchService, token: str, job_id: str | None) -> AsyncIterator[str]:
    listener = _Listener(service, job_id)
    silent_since = time.monotonic()
    while not service.ending:
        try:
            caller_of(service, token, touch=False)  # the token may have been revoked
        except NotSignedInError:
            return
        over = listener.over
        news = listener.news()
        if not news and time.monotonic() - silent_since > ALIVE_S:
            news = ": here\n\n"
        if news:
            silent_since = time.monotonic()
            yield news
        if over:
            return
        await asyncio.sleep(POLL_INTERVAL_S)


class _Listener:
    """The state of one listener, from which its new events follow."""

    def __init__(self, service: BenchService, job_id: str | None) -> None:
        self._service, self._job_id = service, job_id
        old = service.jobs.recent() if job_id is None else []
        self._jobs = {view.job_id: view for view in old if not view.open}
        self._points: dict[str, int] = {}
        self._prompt: PendingPrompt | None = None
        self._alarms = {view.alarm_id: view for view in service.alarms() if not view.active}
        self._seen: tuple[object, ...] = ()

    @property
    def over(self) -> bool:
        """Whether the job of interest has ended."""
        return self._job_id is not None and not self._service.jobs.get(self._job_id).open

    def news(self) -> str:
        """Return new events as text; empty without any."""
        return "".join((*self._of_alarms(), *self._of_prompts(), *self._of_jobs()))

    def _of_jobs(self) -> Iterator[str]:
        jobs = self._service.jobs
        for view in reversed(jobs.recent()):
            if self._job_id not in (None, view.job_id) or self._jobs.get(view.job_id) == view:
                continue
            self._jobs[view.job_id] = view
            told = self._points.get(view.job_id, 0)
            points = jobs.points(view.job_id, told)
            if points:
                self._points[view.job_id] = told + len(points)
                yield _event("points", _POINTS, JobPoints(view.job_id, points))
            yield _event("job", _JOB, view)

    def _of_prompts(self) -> Iterator[str]:
        prompt = self._service.jobs.prompt
        if prompt != self._prompt:
            self._prompt = prompt
            yield _event("prompt", _PROMPT, prompt)

    def _of_alarms(self) -> Iterator[str]:
        entries = self._service.station.supervisor.entries
        if entries == self._seen:
            return
        self._seen = entries
        for view in reversed(self._service.alarms()):  # including one that has ended since
            if self._alarms.get(view.alarm_id) != view:
                self._alarms[view.alarm_id] = view
                yield _event("alarm", _ALARM, view)


def _event(name: str, adapter: TypeAdapter[Any], value: Any) -> str:
    return f"event: {name}\ndata: {adapter.dump_json(value).decode()}\n\n"
