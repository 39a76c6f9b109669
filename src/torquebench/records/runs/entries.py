"""The registry's runs: one entry at the start, one at the end."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy import Select, func, select

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.files import sha256_of_file
from torquebench.records.registry.database import insert
from torquebench.records.registry.entries import Amendment, RunSummary
from torquebench.records.registry.entry_rows import EntryRecords, entry_of, number_of, run_row
from torquebench.records.registry.schema import audit_ends, run_ends, runs

if TYPE_CHECKING:
    from torquebench.records.runs.folder import RunFolder

__all__ = ["RunRecords"]

REBUILT = "registry"
"""Subject of the entries about runs that were entered again from their folders."""


class RunRecords(EntryRecords):
    """Runs and how they ended."""

    def add_run(self, summary: RunSummary) -> None:
        """Register a run when it starts.

        Raises
        ------
        RecordError
            Where the identifier is taken.
        """
        with self.writing() as session:
            if number_of(session, runs, run_id=summary.run_id) is not None:
                raise RecordError(
                    Message("run {run_id} is registered", summary.run_id), "a new identifier"
                )
            self._add(summary)
            if summary.status != "running" and summary.finished is not None:
                insert(session, run_ends, **self._columns(session, summary, run_ends))

    def finish_run(self, folder: "RunFolder", finished: datetime | None = None) -> None:
        """Enter how a sealed run ended, and the hash of its manifest.

        Parameters
        ----------
        folder : RunFolder
            The sealed run.
        finished : datetime.datetime, optional
            When it ended, with time zone; by default when it was sealed.

        Raises
        ------
        RecordError
            Where the run isn't registered, isn't sealed, or its end is entered already.
        """
        from torquebench.records.runs.folder import MANIFEST  # not imported for lists of runs

        manifest = folder.manifest
        with self.writing() as session:
            run_key = run_row(session, folder.run_id).id
            if number_of(session, run_ends, run_key=run_key) is not None:
                raise RecordError(
                    Message("the end of run {run_id} is registered", folder.run_id),
                    "one end",
                    "records are never overwritten",
                )
            insert(
                session,
                run_ends,
                run_key=run_key,
                status=manifest["status"],
                reason=manifest["reason"],
                finished=finished or datetime.fromisoformat(manifest["sealed"]),
                manifest_sha256=sha256_of_file(folder.path / MANIFEST),
            )

    def add_audit_end(self, log: Path, line: int, sha256: str) -> None:
        """Note where an audit log ends now.

        Parameters
        ----------
        log : pathlib.Path
            Its folder.
        line, sha256 : int, str
            Number and hash of its last line.
        """
        with self.writing() as session:
            now = datetime.now(UTC)
            insert(
                session, audit_ends, log=self.stored(log), line=line, sha256=sha256, recorded=now
            )

    def audit_ends(self, log: Path) -> list[tuple[int, str]]:
        """Return number and hash of the last lines that were noted of an audit log."""
        query = select(audit_ends.c.line, audit_ends.c.sha256).order_by(audit_ends.c.id)
        with self.session() as session:
            ends = session.execute(query.where(audit_ends.c.log == self.stored(log)))
            return [(line, sha256) for line, sha256 in ends]

    def note_rebuilt(self, run_ids: list[str], *, by: str, anew: bool) -> None:
        """Enter that runs were entered again from their folders, by whom and when.

        The end of a chain that such a folder notes may be that of a registry that is lost.
        """
        reason = "rebuilt from run folders" if anew else "completed from run folders"
        self._add(Amendment(REBUILT, 0, datetime.now(UTC), by, reason, {"runs": run_ids}))

    def rebuilt(self) -> list[tuple[datetime, str, str, list[str]]]:
        """Return when, by whom, how and with which runs the registry was rebuilt."""
        return [
            (entry.amended, entry.amended_by, entry.reason, list(entry.changes.get("runs", ())))
            for entry in self.entries(Amendment, subject=REBUILT)
        ]

    def runs(
        self, limit: int | None = 100, offset: int = 0, kind: str | None = None
    ) -> list[RunSummary]:
        """Return runs, the newest first.

        Parameters
        ----------
        limit : int or None
            How many; all by None.
        offset : int
            How many of the newest to pass over.
        kind : str, optional
            Only runs of this kind.
        """
        return self._runs(self.runs_query(kind).limit(limit).offset(offset))

    def unfinished_runs(self) -> list[RunSummary]:
        """Return runs whose end isn't registered, the oldest first: they run, or were killed."""
        return self._runs(self._runs_and_ends().where(run_ends.c.id.is_(None)).order_by(runs.c.id))

    def number_of_runs(self) -> int:
        """Return how many runs are registered."""
        with self.session() as session:
            return session.scalar(select(func.count()).select_from(runs)) or 0

    def runs_beginning(self, name: str, limit: int = 100) -> list[RunSummary]:
        """Return runs whose identifier begins with a text, by identifier."""
        end = name[:-1] + chr(ord(name[-1]) + 1) if name else "\U0010ffff"
        query = self._runs_and_ends().where(runs.c.run_id >= name, runs.c.run_id < end)
        return self._runs(query.order_by(runs.c.run_id).limit(limit))

    def run(self, run_id: str) -> RunSummary:
        """Return one run.

        Raises
        ------
        RecordError
            Where it isn't registered.
        """
        for run in self._runs(self._runs_and_ends().where(runs.c.run_id == run_id)):
            return run
        raise RecordError(Message("run {run_id} isn't registered", run_id), "a registered run")

    def runs_query(self, kind: str | None = None) -> Select[Any]:
        """Return the query of the list of runs, without its limit."""
        query = self._runs_and_ends().order_by(runs.c.started.desc(), runs.c.id.desc())
        return query if kind is None else query.where(runs.c.kind == kind)

    @staticmethod
    def _runs_and_ends() -> Select[Any]:
        columns = [*runs.c, *(column for column in run_ends.c if column.name != "id")]
        return select(*columns).outerjoin(run_ends, run_ends.c.run_key == runs.c.id)

    def _runs(self, query: Select[Any]) -> list[RunSummary]:
        with self.session() as session:
            rows = session.execute(query)
            return [entry_of(RunSummary, row._mapping, self.root) for row in rows]
