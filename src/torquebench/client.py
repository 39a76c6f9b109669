"""A client of the panel's HTTP API, for programs: `Client`, and `AsyncClient` for event loops.

It needs only ``pip install "torquebench[client]"``: a program on another computer starts jobs,
receives events and reads results without polling.

Examples
--------
>>> from torquebench.client import Client
>>> with Client("http://127.0.0.1:8080", token) as bench:            # doctest: +SKIP
...     (module,) = bench.calibrate(side="output", bench_clear=True)["modules"]
...     bench.verification(side="output", calibration=module["calibration_id"], bench_clear=True)
...     bench.records_use(model=module["models"][0]["model_id"], reason="checked")
...     bench.reading("output_torque_nm")
"""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Self

import httpx

from torquebench.atomic_write import atomic_path
from torquebench.errors import TorquebenchError
from torquebench.message import Message

__all__ = ["AsyncClient", "Client", "Event", "JobError", "RefusedError"]

API_PATH = "/api/v1"
TIMEOUT_S = 60.0
"""Timeout of an answer, s; a stream of events sends something at least every 15 s."""
RECONNECTS = 10
"""Number of successive breaks of an event stream after which an error is raised."""


class RefusedError(TorquebenchError):
    """The server refuses a request.

    Attributes
    ----------
    status : int
        HTTP status: 401 no valid token, 403 not allowed, 409 forbidden in the present state, 422
        wrong value.
    kind : str
        Name of the error, such as "torquebench:LeaseError".
    """

    def __init__(
        self, status: int, kind: str, found: str, allowed: str = "", remedy: str = ""
    ) -> None:
        super().__init__(found, allowed, remedy)
        self.status, self.kind = status, kind


class JobError(TorquebenchError):
    """A job failed or was aborted.

    Attributes
    ----------
    job : dict
        The job, as returned by `GET /jobs/ID`.
    """

    def __init__(self, job: Mapping[str, Any]) -> None:
        problem = job["problem"] or {}
        super().__init__(
            f"{job['title']} {job['state']}: {problem.get('found', '')}",
            problem.get("allowed", ""),
            problem.get("remedy", ""),
        )
        self.job = dict(job)


@dataclass(frozen=True)
class Event:
    """An event of a job, prompt or alarm.

    Parameters
    ----------
    name : str
        "job", "points", "prompt" or "alarm".
    data : dict or None
        Data as in the API; None if the request to the operator has been answered.
    """

    name: str
    data: Any


class _Events:
    """Assembles events from the lines of a stream."""

    def __init__(self) -> None:
        self._name, self._data = "", ""

    def __call__(self, line: str) -> Event | None:
        field, _, value = line.partition(": ")
        if field == "event":
            self._name = value
        elif field == "data":
            self._data = value
        elif not line and self._name:
            event = Event(self._name, json.loads(self._data))
            self._name = ""
            return event
        return None


def _headers(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"} if token else {}


def _base(url: str) -> str:
    return url.rstrip("/") + API_PATH


def _content(answer: httpx.Response) -> Any:
    """Return an answer's content, or raise its error."""
    if answer.is_success:
        return answer.json() if answer.content else None
    try:
        problem = answer.json()
    except ValueError:
        problem = {}
    raise RefusedError(
        answer.status_code,
        problem.get("type", ""),
        problem.get("detail", "")
        or Message("{url}: {status}", answer.request.url, answer.status_code),
        problem.get("allowed", ""),
        problem.get("remedy", ""),
    )


def _result(job: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result of a job that has ended."""
    if job["state"] != "done":
        raise JobError(job)
    return dict(job["result"] or {})


def _value(bench: Mapping[str, Any], signal: str) -> float | None:
    newest = bench["signals"]
    if signal not in newest:
        raise RefusedError(
            422,
            "torquebench:InputError",
            Message("no signal {signal!r}", signal),
            ", ".join(newest),
        )
    return None if newest[signal]["stale"] else newest[signal]["value"]


def _stated(values: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


class _Requests:
    """Operations of one request each; those of `AsyncClient` are awaited."""

    request: Callable[..., Any]
    run: Callable[..., Any]

    def get(self, path: str, **query: Any) -> Any:
        """Read a resource."""
        return self.request("GET", path, query=_stated(query))

    def post(self, path: str, **body: Any) -> Any:
        """Call an operation that changes something."""
        return self.request("POST", path, body=body)

    def start(self, operation: str, **request: Any) -> Any:
        """Start an operation; return its job's first state, or its result if it isn't a job.

        An impossible operation is refused. ``get("/operations")`` lists all of them.
        """
        return self.post(f"/operations/{operation.replace('_', '-')}", **request)

    def preview(self, operation: str, **request: Any) -> Any:
        """Return what an operation would load and turn, without moving anything."""
        return self.post(f"/operations/{operation.replace('_', '-')}/preview", **request)

    def __getattr__(self, operation: str) -> Callable[..., Any]:
        """Return an operation as a method: ``client.calibrate(side="output")`` returns its result.

        See `run`; the names are those of the API's description, such as ``records_review``.
        """
        if operation.startswith("_"):
            raise AttributeError(operation)
        return partial(self.run, operation)

    def answer(self, number: int, *, done: bool = True) -> Any:
        """Answer a request to the person at the bench."""
        return self.post(f"/prompt/{number}", done=done)

    def stop(self, reason: str = "") -> Any:
        """Bring the bench to its safe state at once; this doesn't replace an emergency stop."""
        return self.post("/stop", reason=reason)


class Client(_Requests):
    """A connection to a panel's server.

    Parameters
    ----------
    url : str
        Address of the server, such as ``http://127.0.0.1:8080``.
    token : str
        Token of a client or of a session; `sign_in` opens a session.
    **options
        Options of `httpx.Client`, such as ``verify`` for a private certificate.
    """

    def __init__(self, url: str, token: str = "", **options: Any) -> None:
        options.setdefault("timeout", TIMEOUT_S)
        self.http = httpx.Client(base_url=_base(url), headers=_headers(token), **options)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection; a session stays open."""
        self.http.close()

    def request(
        self, method: str, path: str, *, query: Mapping[str, Any] | None = None, body: Any = None
    ) -> Any:
        """Call any operation of the API; return its JSON.

        Raises
        ------
        RefusedError
            The server refuses the request; the error has the server's found, allowed and remedy.
        """
        return _content(self.http.request(method, path, params=query, json=body))

    def sign_in(self, name: str, password: str) -> None:
        """Open a session for a person, and use it from now on."""
        session = self.post("/session", name=name, password=password)
        self.http.headers.update(_headers(session["token"]))

    def events(self, job_id: str | None = None) -> Iterator[Event]:
        """Yield events: of one job until its end, or of all jobs until the connection ends."""
        query = _stated({"job_id": job_id})
        with self.http.stream("GET", "/events", params=query) as answer:
            if not answer.is_success:
                answer.read()
                _content(answer)
            lines = _Events()
            for line in answer.iter_lines():
                event = lines(line)
                if event is not None:
                    yield event

    def wait(
        self, job_id: str, on_event: Callable[[Event], object] = lambda _event: None
    ) -> dict[str, Any]:
        """Wait for the end of a job, whatever its result, and return it.

        Parameters
        ----------
        job_id : str
        on_event : callable
            Called with every event: points as they arrive, and requests to the operator, which
            `answer` answers.
        """
        broken = 0
        while True:
            try:
                for event in self.events(job_id):
                    broken = 0
                    on_event(event)
                    if _is_end(event, job_id):
                        return dict(event.data)
            except httpx.TransportError:
                if broken >= RECONNECTS:
                    raise
            broken += 1
            if broken > RECONNECTS:
                raise httpx.RemoteProtocolError(f"no end of job {job_id} in {RECONNECTS} streams")

    def run(
        self,
        operation: str,
        on_event: Callable[[Event], object] = lambda _event: None,
        **request: Any,
    ) -> dict[str, Any]:
        """Start an operation, wait for it and return its result.

        Raises
        ------
        RefusedError
            The operation can't be started.
        JobError
            The job failed or was aborted.
        """
        started: dict[str, Any] = self.start(operation, **request)
        if "job_id" not in started:
            return started
        return _result(self.wait(started["job_id"], on_event))

    def reading(self, signal: str) -> float | None:
        """Return the newest value of a signal; None if there is none or it is stale."""
        return _value(self.get("/bench"), signal)

    def download(self, path: str, file: Path | str, **query: Any) -> Path:
        """Write a resource to a file, such as ``/runs/ID/export`` or ``/models/7/file``."""
        target = Path(file)
        with self.http.stream("GET", path, params=_stated(query)) as answer:
            if not answer.is_success:
                answer.read()
                _content(answer)
            with atomic_path(target) as part, part.open("wb") as content:
                content.writelines(answer.iter_bytes())
        return target


class AsyncClient(_Requests):
    """`Client` for an event loop: the same operations, awaited."""

    def __init__(self, url: str, token: str = "", **options: Any) -> None:
        options.setdefault("timeout", TIMEOUT_S)
        self.http = httpx.AsyncClient(base_url=_base(url), headers=_headers(token), **options)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def close(self) -> None:
        """Close the connection; a session stays open."""
        await self.http.aclose()

    async def request(
        self, method: str, path: str, *, query: Mapping[str, Any] | None = None, body: Any = None
    ) -> Any:
        """Call any operation of the API; see `Client.request`."""
        return _content(await self.http.request(method, path, params=query, json=body))

    async def sign_in(self, name: str, password: str) -> None:
        """Open a person's session and use it from now on."""
        session = await self.post("/session", name=name, password=password)
        self.http.headers.update(_headers(session["token"]))

    async def events(self, job_id: str | None = None) -> AsyncIterator[Event]:
        """Yield events; see `Client.events`."""
        query = _stated({"job_id": job_id})
        async with self.http.stream("GET", "/events", params=query) as answer:
            if not answer.is_success:
                await answer.aread()
                _content(answer)
            lines = _Events()
            async for line in answer.aiter_lines():
                event = lines(line)
                if event is not None:
                    yield event

    async def wait(
        self,
        job_id: str,
        on_event: Callable[[Event], Awaitable[object] | object] = lambda _event: None,
    ) -> dict[str, Any]:
        """Wait for the end of a job; see `Client.wait`. The result of `on_event` is awaited."""
        broken = 0
        while True:
            try:
                async for event in self.events(job_id):
                    broken = 0
                    result = on_event(event)
                    if isinstance(result, Awaitable):
                        await result
                    if _is_end(event, job_id):
                        return dict(event.data)
            except httpx.TransportError:
                if broken >= RECONNECTS:
                    raise
            broken += 1
            if broken > RECONNECTS:
                raise httpx.RemoteProtocolError(f"no end of job {job_id} in {RECONNECTS} streams")

    async def run(
        self,
        operation: str,
        on_event: Callable[[Event], Awaitable[object] | object] = lambda _event: None,
        **request: Any,
    ) -> dict[str, Any]:
        """Start an operation, wait for it and return its result; see `Client.run`."""
        started: dict[str, Any] = await self.start(operation, **request)
        if "job_id" not in started:
            return started
        return _result(await self.wait(started["job_id"], on_event))

    async def reading(self, signal: str) -> float | None:
        """Return the newest value of a signal; None if there is none or it is stale."""
        return _value(await self.get("/bench"), signal)

    async def download(self, path: str, file: Path | str, **query: Any) -> Path:
        """Write the content of a path to a file; see `Client.download`."""
        target = Path(file)
        async with self.http.stream("GET", path, params=_stated(query)) as answer:
            if not answer.is_success:
                await answer.aread()
                _content(answer)
            with atomic_path(target) as part, part.open("wb") as content:
                async for chunk in answer.aiter_bytes():
                    content.write(chunk)
        return target


def _is_end(event: Event, job_id: str) -> bool:
    return event.name == "job" and event.data["job_id"] == job_id and bool(event.data["finished"])
