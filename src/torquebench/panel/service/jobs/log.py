"""Stored results of jobs for the users who started them, which survive a restart of the server."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from datetime import datetime

from sqlalchemy import insert, select, update
from sqlalchemy.sql import Executable

from torquebench.errors import RecordError
from torquebench.panel.service.access.actors import Actor
from torquebench.panel.service.jobs.job import JobView
from torquebench.panel.service.store import PanelStore, job_log, utc_text

__all__ = ["EndedJob", "JobLog"]

MOST_TOLD = 3
"""Largest number of results shown to a user; older ones are in the records."""


@dataclass(frozen=True)
class EndedJob:
    """A finished job whose result the user who started it hasn't seen.

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
        self._write(update(job_log).where(job_log.c.state == "running").values(state="interrupted"))

    def _write(self, statement: Executable) -> None:
        """Write to the store; ignore a full disk, which raises an alarm elsewhere."""
        with contextlib.suppress(RecordError), self._store.transaction() as connection:
            connection.execute(statement)

    def began(self, actor: Actor, job: JobView) -> None:
        """Store the start of a job."""
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
                told=False,
            )
        )

    def ended(self, job: JobView) -> None:
        """Store the end of a job."""
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
            )
        )

    def untold(self, who: str) -> list[EndedJob]:
        """Return a person's finished jobs that they haven't seen, the oldest first."""
        query = (
            select(job_log)
            .where(job_log.c.who == who, job_log.c.told.is_(False), job_log.c.state != "running")
            .order_by(job_log.c.started.desc())
            .limit(MOST_TOLD)
        )
        with self._store.transaction(reading=True) as connection:
            rows = connection.execute(query).all()
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
            for row in reversed(rows)
        ]

    def told(self, job_id: str) -> None:
        """Store that the user who started a job has seen its result."""
        with self._store.transaction() as connection:
            connection.execute(update(job_log).where(job_log.c.job_id == job_id).values(told=True))
