"""The panel's queue: operations that are performed one after the other, in a changeable order."""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal, get_args

from sqlalchemy import Row, insert, select, update

from torquebench.errors import InputError, InterlockError, TorquebenchError
from torquebench.message import Message
from torquebench.operations import Operation, Request, Result, find_operation
from torquebench.operations.queue import queued_operation
from torquebench.panel.service.access.actors import Actor, require
from torquebench.panel.service.jobs.runner import JobRunner, require_person
from torquebench.panel.service.problems import (
    BusyError,
    LeaseError,
    NotFoundError,
    PermissionDeniedError,
)
from torquebench.panel.service.store import PanelStore, queue, utc_text
from torquebench.records import json_text

POLL_S = 0.1
HISTORY = 100
MOST = 500

QueueState = Literal["waiting", "running", "done", "failed", "aborted", "removed"]


@dataclass(frozen=True)
class QueueItem:
    """An operation of the queue.

    Parameters
    ----------
    number : int
    kind, title : str
    request : mapping
    added_by : str
    state : {"waiting", "running", "done", "failed", "aborted", "removed"}
    headline, verdict : str
        Headline and verdict of its result; without a result, the reason.
    job_id : str
        Its job; empty before its start.
    added, finished : datetime.datetime
        UTC; `finished` is None before.
    """

    number: int
    kind: str
    title: str
    request: Mapping[str, Any]
    added_by: str
    state: QueueState
    headline: str
    verdict: str
    job_id: str
    added: datetime
    finished: datetime | None


@dataclass(frozen=True)
class QueueView:
    """The present state of the queue.

    Parameters
    ----------
    running : bool
        Whether the next operation starts automatically.
    started_by : str
        The person who started the queue, whose permissions apply.
    reason : str
        Why the queue stopped, unless a person stopped it.
    items : tuple of QueueItem
        The running operation and the waiting ones, in order.
    history : tuple of QueueItem
        The newest first.
    """

    running: bool
    started_by: str
    reason: str
    items: tuple[QueueItem, ...]
    history: tuple[QueueItem, ...]


class JobQueue:
    """Performs operations one after the other; safe to use from any thread.

    It stops at an error, an aborted job and a failed check, and is stopped when the panel starts.
    Operations are started in the name of the person who started the queue.

    Parameters
    ----------
    jobs : JobRunner
    store : PanelStore
    note : callable
        Called with an actor, the action, and details.
    """

    def __init__(self, jobs: JobRunner, store: PanelStore, note: Any) -> None:
        self._jobs, self._store, self._note = jobs, store, note
        self._lock = threading.RLock()
        self._starter: Actor | None = None
        self._keep_going = False
        self._reason = ""
        self._thread: threading.Thread | None = None
        self._closed = threading.Event()
        with store.transaction() as connection:
            connection.execute(
                update(queue)
                .where(queue.c.state == "running")
                .values(state="aborted", headline="the panel was ended", finished=utc_text())
            )

    # -- watching ---------------------------------------------------------------------------

    def view(self) -> QueueView:
        """Return the present state of the queue."""
        with self._lock:
            starter, reason = self._starter, self._reason
            open_rows = self._rows(("running", "waiting"))
        ended = [each for each in get_args(QueueState) if each not in ("running", "waiting")]
        query = select(queue).where(queue.c.state.in_(ended)).order_by(queue.c.finished.desc())
        with self._store.transaction(reading=True) as connection:
            rows = connection.execute(query.limit(HISTORY)).all()
        return QueueView(
            running=starter is not None,
            started_by="" if starter is None else starter.label,
            reason=reason,
            items=tuple(map(_item, open_rows)),
            history=tuple(map(_item, rows)),
        )

    def _rows(self, states: tuple[QueueState, ...]) -> list[Row[Any]]:
        query = select(queue).where(queue.c.state.in_(states))
        with self._store.transaction(reading=True) as connection:
            return list(connection.execute(query.order_by(queue.c.position, queue.c.id)))

    def _set(self, number: int, **values: Any) -> None:
        with self._store.transaction() as connection:
            connection.execute(update(queue).where(queue.c.id == number).values(**values))

    # -- people -----------------------------------------------------------------------------

    def add(self, actor: Actor, name: str, request: Mapping[str, Any]) -> QueueItem:
        """Add an operation to the end of the queue.

        Raises
        ------
        InputError
            The request is invalid, or the operation needs a password.
        PermissionDeniedError
            The actor's role doesn't allow it.
        """
        operation, asked = queued_operation(name, request)
        require(actor, operation.role)
        require_person(actor, asked)
        with self._lock:
            waiting = self._rows(("waiting",))
            if len(waiting) >= MOST:
                raise InputError(Message("{count} operations wait", MOST), "fewer in the queue")
            values = {
                "kind": operation.key,
                "request": json_text(asked.model_dump(mode="json", exclude_unset=True)),
                "who": actor.label,
                "state": "waiting",
                "verdict": "",
                "added": utc_text(),
                "position": max((row.position for row in waiting), default=0) + 1,
                "title": operation.title(asked),
                "headline": "",
                "job_id": "",
            }
            with self._store.transaction() as connection:
                inserted = insert(queue).values(values).returning(queue.c.id)
                number = int(connection.execute(inserted).scalar_one())
            self._note(actor, "added to the queue", number=number, kind=operation.key)
            return _item(self._waiting(number))

    def _waiting(self, number: int) -> Row[Any]:
        row = next((each for each in self._rows(("waiting",)) if each.id == number), None)
        if row is None:
            raise NotFoundError(
                Message("no waiting operation {number}", number), "one of the queue that waits"
            )
        return row

    def remove(self, actor: Actor, number: int) -> None:
        """Remove a waiting operation.

        Raises
        ------
        NotFoundError
            The operation isn't waiting.
        """
        with self._lock:
            self._waiting(number)
            self._set(number, state="removed", finished=utc_text())
        self._note(actor, "removed from the queue", number=number)

    def move(self, actor: Actor, number: int, place: int) -> None:
        """Move a waiting operation to a place in the queue, from 0; raises like `remove`."""
        with self._lock:
            self._waiting(number)
            numbers = [row.id for row in self._rows(("waiting",)) if row.id != number]
            numbers.insert(max(0, place), number)
            for position, each in enumerate(numbers, start=1):
                self._set(each, position=position)
        self._note(actor, "moved in the queue", number=number, place=place)

    def start(
        self, actor: Actor, *, bench_clear: bool = False, keep_going: bool = False
    ) -> QueueView:
        """Start the waiting operations, one after the other.

        Parameters
        ----------
        actor : Actor
            Takes the command lease if it is free.
        bench_clear : bool
            Whether a person has confirmed that all operations may load a real bench.
        keep_going : bool
            Whether the queue continues after a failed check.

        Raises
        ------
        LeaseError
            Another session commands.
        InputError
            No operation is waiting, or nobody has confirmed that a real bench is clear.
        """
        self._jobs.command(actor)
        with self._lock:
            waiting = self._rows(("waiting",))
            if not waiting:
                raise InputError("an empty queue", "operations that wait")
            if any(find_operation(row.kind).loads for row in waiting) and not bench_clear:
                self._jobs.refuse_unconfirmed()
            self._starter, self._keep_going, self._reason = actor, keep_going, ""
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="job queue", daemon=True)
                self._thread.start()
        self._note(actor, "started the queue", waiting=len(waiting))
        return self.view()

    def pause(self, actor: Actor) -> QueueView:
        """Start no further operation; the running one continues."""
        self._jobs.command(actor)
        self._stop("")
        self._note(actor, "paused the queue")
        return self.view()

    def close(self) -> None:
        """Start no further operation, and wait for the thread; its job must have ended."""
        self._closed.set()
        if (thread := self._thread) is not None:
            thread.join()

    # -- working ----------------------------------------------------------------------------

    def _stop(self, reason: str) -> None:
        with self._lock:
            self._starter, self._reason = None, reason

    def _work(self) -> None:
        while (following := self._next()) is not None:
            row, actor = following
            try:
                self._have_done(row, actor)
            except BusyError:  # a person's job is running
                self._closed.wait(POLL_S)
            except (
                LeaseError,
                PermissionDeniedError,
                InterlockError,
            ) as error:  # it still waits
                self._stop(error.found)
            except Exception as error:  # the queue survives any error
                found = error.found if isinstance(error, TorquebenchError) else repr(error)
                self._set(row.id, state="failed", headline=found, finished=utc_text())
                self._stop(found)

    def _next(self) -> tuple[Row[Any], Actor] | None:
        """Return the next operation and the person who started the queue; None ends the thread."""
        with self._lock:
            waiting = self._rows(("waiting",))
            if self._closed.is_set() or self._starter is None or not waiting:
                self._starter = self._thread = None
                return None
            return waiting[0], self._starter

    def _have_done(self, row: Row[Any], actor: Actor) -> None:
        operation, request = _asked(row)
        if operation.quick:
            job = self._jobs.perform_and_store(actor, operation.name, request)
        else:
            job = self._jobs.start(actor, operation.name, request, bench_clear=True)
            self._set(row.id, state="running")
        self._set(row.id, job_id=job.job_id)
        while job.open:
            job = self._jobs.wait(job.job_id, POLL_S)
        found = "" if job.problem is None else job.problem.found
        self._ended(row.id, job.state, found, job.result)

    def _ended(self, number: int, state: str, found: str, result: Result | None) -> None:
        headline = found if result is None else result.headline
        verdict = "" if result is None else result.verdict
        self._set(number, state=state, headline=headline, verdict=verdict, finished=utc_text())
        if state != "done":
            self._stop(headline)
        elif result is not None and result.failed and not self._keep_going:
            self._stop(Message("a check failed: {headline}", headline))


def _asked(row: Row[Any]) -> tuple[Operation, Request]:
    return queued_operation(row.kind, json.loads(row.request))


def _item(row: Row[Any]) -> QueueItem:
    return QueueItem(
        number=row.id,
        kind=row.kind,
        title=row.title,
        request=json.loads(row.request),
        added_by=row.who,
        state=row.state,
        headline=row.headline,
        verdict=row.verdict,
        job_id=row.job_id,
        added=datetime.fromisoformat(row.added),
        finished=None if row.finished is None else datetime.fromisoformat(row.finished),
    )
