"""Stored jobs with their results, which survive a restart of the server."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from datetime import datetime
from typing import Any

from sqlalchemy import Select, delete, insert, select, update
from sqlalchemy.sql import Executable

from torquebench.errors import RecordError
from torquebench.figures import Curve
from torquebench.message import Message
from torquebench.operations import Result
from torquebench.panel.service.access.actors import Actor
from torquebench.panel.service.jobs.job import JobStage, JobView, Problem
from torquebench.panel.service.problems import NotFoundError
from torquebench.panel.service.store import PanelStore, job_log, results, utc_text
from torquebench.records.files import plain_json
from torquebench.reports.curve_figures import Panel
from torquebench.reports.page import Diagram, Facts, Figure, Page, Section, Table, drawn

MOST_TOLD = 3
"""Largest number of results shown to a user; older ones are in the records."""


@dataclass(frozen=True, kw_only=True)
class StoredResult(Result):
    """Result of an earlier job: its values and its description."""

    values: Mapping[str, Any]
    description: Page

    def plain(self) -> dict[str, Any]:
        """Return the values as they were."""
        return {name: plain_json(value) for name, value in self.values.items()}

    def page(self) -> Page:
        """Return the description as it was."""
        return self.description


TYPES = {
    each.__name__: each
    for each in (
        *(JobView, JobStage, Problem, StoredResult),
        *(Page, Section, Facts, Table, Figure, Diagram, Panel, Curve),
    )
}
"""Types in a stored job; their names are stored under `TYPE`."""
TYPE = "#"


@dataclass(frozen=True)
class EndedJob:
    """Name and end of a finished job.

    Parameters
    ----------
    job_id, kind, title : str
    state : {"done", "failed", "aborted", "interrupted"}
        How it ended; "interrupted" means by the end of the server.
    headline : str
        Headline of the result, or the reason of its end.
    verdict : str
    started : datetime.datetime
        UTC.
    """

    job_id: str
    kind: str
    title: str
    state: str
    headline: str
    verdict: str
    started: datetime


class JobLog:
    """Stores start and end of every job; jobs that are open at the server's start were interrupted.

    Parameters
    ----------
    store : PanelStore
    """

    def __init__(self, store: PanelStore) -> None:
        self._store = store
        running = job_log.c.state == "running"
        with store.transaction(reading=True) as connection:
            interrupted = connection.scalars(select(job_log.c.job_id).where(running)).all()
        for job_id in interrupted:
            with contextlib.suppress(NotFoundError):  # the disk was full at its start
                self.store(replace(self.job(job_id), state="interrupted"))
        self._write(update(job_log).where(running).values(state="interrupted"))

    def _write(self, *statements: Executable) -> None:
        """Write to the store; ignore a full disk, which raises an alarm elsewhere."""
        with contextlib.suppress(RecordError), self._store.transaction() as connection:
            for statement in statements:
                connection.execute(statement)

    def began(self, actor: Actor, job: JobView, *, told: bool = False) -> None:
        """Store the start of a job, and whether the user needs no message about its end."""
        self._write(
            insert(job_log).values(
                job_id=job.job_id,
                who=actor.name if actor.kind == "person" else "",
                kind=job.kind,
                title=job.title,
                state="running",
                headline="",
                verdict="",
                started=utc_text(),
                told=told,
            )
        )
        if job.open:
            self.store(job)

    def ended(self, job: JobView) -> None:
        """Store the end of a job; `store` adds its result, once its figures are drawn."""
        said = job.result.headline if job.result is not None else ""
        if job.problem is not None:
            said = job.problem.found
        self._write(
            update(job_log)
            .where(job_log.c.job_id == job.job_id)
            .values(
                state=job.state,
                headline=said,
                verdict="" if job.result is None else job.result.verdict,
            ),
            delete(results).where(results.c.job_id == job.job_id),
        )

    def store(self, job: JobView) -> None:
        """Store a job, as it began or with its result and its description, its figures drawn."""
        if (result := job.result) is not None:
            common = {each.name: getattr(result, each.name) for each in fields(Result)}
            stored = StoredResult(**common, values=result.plain(), description=result.page())
            job = replace(job, result=stored)
        view = json.dumps(_plain(job), ensure_ascii=False)
        self._write(insert(results).prefix_with("OR REPLACE").values(job_id=job.job_id, view=view))

    def job(self, job_id: str) -> JobView:
        """Return an ended job as it was.

        Raises
        ------
        NotFoundError
            No job of this identifier has ended.
        """
        query = select(results.c.view).where(results.c.job_id == job_id)
        with self._store.transaction(reading=True) as connection:
            stored = connection.execute(query).scalar()
        if stored is None:
            raise NotFoundError(Message("no job {name!r}", job_id[:40]), "a job of the list")
        view: JobView = _restored(json.loads(stored))
        return view

    def newest(self, limit: int) -> list[EndedJob]:
        """Return the stored jobs that have ended, the newest first."""
        stored = job_log.c.job_id.in_(select(results.c.job_id))
        return self._ended(select(job_log).where(stored, job_log.c.state != "running"), limit)

    def untold(self, who: str) -> list[EndedJob]:
        """Return a person's finished jobs that they haven't seen, the oldest first."""
        query = select(job_log).where(
            job_log.c.who == who, job_log.c.told.is_(False), job_log.c.state != "running"
        )
        return self._ended(query, MOST_TOLD)[::-1]

    def _ended(self, query: Select[Any], limit: int) -> list[EndedJob]:
        newest = query.order_by(job_log.c.started.desc()).limit(limit)
        with self._store.transaction(reading=True) as connection:
            rows = connection.execute(newest).all()
        return [
            EndedJob(
                row.job_id,
                row.kind,
                row.title,
                row.state,
                row.headline,
                row.verdict,
                datetime.fromisoformat(row.started),
            )
            for row in rows
        ]

    def told(self, job_id: str) -> None:
        """Store that the user who started a job has seen its result."""
        with self._store.transaction() as connection:
            connection.execute(update(job_log).where(job_log.c.job_id == job_id).values(told=True))


def _plain(value: Any) -> Any:
    """Return a value as JSON from which `_restored` makes it again: texts keep their templates."""
    if isinstance(value, Message):
        return {TYPE: "Message", **value.as_plain()}
    if isinstance(value, datetime):
        return {TYPE: "datetime", "text": value.isoformat()}
    if isinstance(value, Section):
        value = replace(value, blocks=tuple(drawn(value.blocks)))
    if is_dataclass(value) and not isinstance(value, type):
        parts = {
            each.name: _plain(getattr(value, each.name)) for each in fields(value) if each.init
        }
        return {TYPE: type(value).__name__, **parts}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return plain_json(value)


def _restored(plain: Any) -> Any:
    if isinstance(plain, list):
        return tuple(map(_restored, plain))
    if not isinstance(plain, dict):
        return plain
    kind = plain.get(TYPE)
    if kind == "Message":
        return Message.restored(plain)
    if kind == "datetime":
        return datetime.fromisoformat(plain["text"])
    parts = {name: _restored(value) for name, value in plain.items() if name != TYPE}
    return parts if kind is None else TYPES[kind](**parts)
