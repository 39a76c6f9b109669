"""The registry's runs: one entry at the start, one at the end."""

from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy import Select, func, select

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.files import sha256_of_file
from torquebench.records.registry.database import Database, row_of, run_row
from torquebench.records.registry.entries import RunSummary
from torquebench.records.registry.schema import AmendmentRow, AuditEndRow, RunEndRow, RunRow

if TYPE_CHECKING:
    from torquebench.records.runs.folder import RunFolder

__all__ = ["RunRecords"]

REBUILT = "registry"
"""Subject of the entries about runs that were entered again from their folders."""


class RunRecords(Database):
    """Runs and how they ended."""

    def add_run(self, summary: RunSummary) -> None:
        """Register a run when it starts.

        Raises
        ------
        RecordError
            Where the identifier is taken.
        """
        with self.writing() as session:
            if session.scalar(select(RunRow.id).where(RunRow.run_id == summary.run_id)):
                raise RecordError(
                    Message("run {run_id} is registered", summary.run_id), "a new identifier"
                )
            row = row_of(RunRow, summary, folder=self.stored(summary.folder))
            session.add(row)
            if summary.status != "running" and summary.finished is not None:
                session.flush()
                session.add(row_of(RunEndRow, summary, run=row))

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
            row = run_row(session, folder.run_id)
            if session.scalar(select(RunEndRow.id).where(RunEndRow.run_key == row.id)):
                raise RecordError(
                    Message("the end of run {run_id} is registered", folder.run_id),
                    "one end",
                    "records are never overwritten",
                )
            session.add(
                RunEndRow(
                    run=row,
                    status=manifest["status"],
                    reason=manifest["reason"],
                    finished=finished or datetime.fromisoformat(manifest["sealed"]),
                    manifest_sha256=sha256_of_file(folder.path / MANIFEST),
                )
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
            session.add(
                AuditEndRow(
                    log=self.stored(log), line=line, sha256=sha256, recorded=datetime.now(UTC)
                )
            )

    def audit_ends(self, log: Path) -> list[tuple[int, str]]:
        """Return number and hash of the last lines that were noted of an audit log."""
        query = select(AuditEndRow.line, AuditEndRow.sha256).order_by(AuditEndRow.id)
        with self.session() as session:
            found = session.execute(query.where(AuditEndRow.log == self.stored(log)))
            return [(line, sha256) for line, sha256 in found]

    def note_rebuilt(self, run_ids: list[str], *, by: str, anew: bool) -> None:
        """Enter that runs were entered again from their folders, by whom and when.

        The end of a chain that such a folder notes may be that of a registry that is lost.
        """
        with self.writing() as session:
            session.add(
                AmendmentRow(
                    subject=REBUILT,
                    subject_key=0,
                    amended=datetime.now(UTC),
                    amended_by=by,
                    reason="rebuilt from run folders" if anew else "completed from run folders",
                    changes={"runs": run_ids},
                )
            )

    def rebuilt(self) -> list[tuple[datetime, str, str, list[str]]]:
        """Return when, by whom, how and with which runs the registry was rebuilt."""
        query = select(AmendmentRow).where(AmendmentRow.subject == REBUILT)
        with self.session() as session:
            return [
                (row.amended, row.amended_by, row.reason, list(row.changes.get("runs", ())))
                for row in session.scalars(query.order_by(AmendmentRow.id))
            ]

    def runs(self, limit: int = 100, offset: int = 0, kind: str | None = None) -> list[RunSummary]:
        """Return runs, the newest first.

        Parameters
        ----------
        limit, offset : int
            How many, and how many of the newest to pass over.
        kind : str, optional
            Only runs of this kind.
        """
        query = self.runs_query(kind).limit(limit).offset(offset)
        with self.session() as session:
            return [self._run(row) for row in session.execute(query)]

    def unfinished_runs(self) -> list[RunSummary]:
        """Return runs whose end isn't registered, the oldest first: they run, or were killed."""
        query = self._runs_and_ends().where(RunEndRow.id.is_(None)).order_by(RunRow.id)
        with self.session() as session:
            return [self._run(row) for row in session.execute(query)]

    def number_of_runs(self) -> int:
        """Return how many runs are registered."""
        with self.session() as session:
            return session.scalar(select(func.count()).select_from(RunRow)) or 0

    def runs_beginning(self, name: str, limit: int = 100) -> list[RunSummary]:
        """Return runs whose identifier begins with a text, by identifier."""
        end = name[:-1] + chr(ord(name[-1]) + 1) if name else "\U0010ffff"
        query = self._runs_and_ends().where(RunRow.run_id >= name, RunRow.run_id < end)
        query = query.order_by(RunRow.run_id).limit(limit)
        with self.session() as session:
            return [self._run(row) for row in session.execute(query)]

    def run(self, run_id: str) -> RunSummary:
        """Return one run.

        Raises
        ------
        RecordError
            Where it isn't registered.
        """
        found = [run for run in self.runs_beginning(run_id, limit=1) if run.run_id == run_id]
        if not found:
            raise RecordError(Message("run {run_id} isn't registered", run_id), "a registered run")
        return found[0]

    def runs_query(self, kind: str | None = None) -> Select[Any]:
        """Return the query of the list of runs, without its limit."""
        query = self._runs_and_ends().order_by(RunRow.started.desc(), RunRow.id.desc())
        return query if kind is None else query.where(RunRow.kind == kind)

    @staticmethod
    def _runs_and_ends() -> Select[Any]:
        columns = [
            getattr(row, each.name)
            for row in (RunRow, RunEndRow)
            for each in fields(RunSummary)
            if each.name in row.__table__.columns
        ]
        return select(*columns).outerjoin(RunEndRow, RunEndRow.run_key == RunRow.id)

    def _run(self, row: Any) -> RunSummary:
        values = dict(row._mapping)
        folder = self.root / values.pop("folder")
        if values["finished"] is None:
            values |= {"status": "running", "reason": "", "manifest_sha256": ""}
        return RunSummary(**values, folder=folder)
