"""Runs in the registry: their entries at start and end, and queries of their states."""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sqlalchemy import ColumnElement, exists, func, or_, select

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records.accounts import Accounts
from torquebench.records.chain import ChainHead
from torquebench.records.files import sha256_of_file
from torquebench.records.registry.database import Database
from torquebench.records.registry.entries import (
    Amendment,
    AuditEnd,
    CalibrationEntry,
    CheckEntry,
    RunEnd,
    RunSummary,
    VerificationEntry,
    links,
)
from torquebench.records.signatures import Signature

if TYPE_CHECKING:
    from torquebench.records.runs.folder import RunFolder

REBUILT = "registry"
"""Subject of amendments that list runs that were registered again from their folders."""
DISCARDED = "discarded"
"""Status to which a run's end is amended when a person discards the run."""
INTERRUPTED = ("interrupted", "aborted", "failed")
CHUNK = 500
_FOLLOWS: Mapping[str, Any] = {
    "calibrate-": CalibrationEntry.run_key,
    "check-": CheckEntry.run_key,
    "verify-": VerificationEntry.run_key,
}
"""Foreign key by which the results of a kind of run refer to the run."""
_STATUS: Any = RunSummary.status


class RunRecords(Database):
    """Registry of runs, their ends and their states; see `unfinished_runs`."""

    def add_run(self, run: RunSummary) -> None:
        """Register a run when it starts.

        Raises
        ------
        RecordError
            Where the identifier is taken.
        """
        with self.writing():
            if self.entries(RunSummary, run_id=run.run_id):
                raise RecordError(
                    Message("run {run_id} is registered", run.run_id), "a new identifier"
                )
            number = self.add(run)
            if run.status != "running" and run.finished is not None:
                self.add(
                    RunEnd(
                        run_key=number,
                        finished=run.finished,
                        status=run.status,
                        reason=run.reason,
                        manifest_sha256=run.manifest_sha256,
                    )
                )

    def end_run(self, folder: "RunFolder", finished: datetime | None = None) -> None:
        """Register how a sealed run ended, and the hash of its manifest.

        Parameters
        ----------
        folder : RunFolder
            The sealed run.
        finished : datetime.datetime, optional
            When it ended, with time zone; by default the time of sealing.

        Raises
        ------
        RecordError
            Where the run isn't registered or not sealed, or its end is registered already.
        """
        from torquebench.records.runs.folder import MANIFEST  # not imported for lists of runs

        manifest = folder.manifest
        with self.writing():
            run = self.run(folder.run_id)
            if run.finished is not None:
                raise RecordError(
                    Message("the end of run {run_id} is already registered", folder.run_id),
                    "one end",
                    "records are never overwritten",
                )
            self.add(
                RunEnd(
                    run_key=run.number,
                    status=manifest["status"],
                    reason=manifest["reason"],
                    finished=finished or datetime.fromisoformat(manifest["sealed"]),
                    manifest_sha256=sha256_of_file(folder.path / MANIFEST),
                )
            )

    def run(self, run_id: str) -> RunSummary:
        """Return one run.

        Raises
        ------
        RecordError
            Where it isn't registered.
        """
        for run in self.entries(RunSummary, run_id=run_id):
            return run
        raise RecordError(Message("run {run_id} isn't registered", run_id), "a registered run")

    def runs(
        self,
        limit: int | None = 100,
        offset: int = 0,
        kind: str | None = None,
        *conditions: ColumnElement[bool],
        problems: list[str] | None = None,
    ) -> list[RunSummary]:
        """Return runs, the newest first.

        Parameters
        ----------
        limit : int or None
            How many runs; None for all.
        offset : int
            How many of the newest runs to skip.
        kind : str, optional
            Only runs of this kind.
        *conditions
            SQLAlchemy conditions on the attributes of `RunSummary`.
        problems : list of str, optional
            Receives a message for each entry that can't be read; see `entries`.
        """
        return self.entries(
            RunSummary,
            *conditions,
            order=("started", "id"),
            newest_first=True,
            limit=limit,
            offset=offset,
            problems=problems,
            kind=kind,
        )

    def number_of_runs(self, *conditions: ColumnElement[bool]) -> int:
        """Return the number of registered runs that meet the conditions."""
        with self.session() as session:
            query = select(func.count()).select_from(RunSummary).where(*conditions)
            return session.scalar(query) or 0

    def runs_beginning(self, name: str, limit: int = 100) -> list[RunSummary]:
        """Return runs whose identifier begins with a text, by identifier."""
        end = name[:-1] + chr(ord(name[-1]) + 1) if name else "\U0010ffff"
        within = RunSummary.run_id >= name, RunSummary.run_id < end
        return self.entries(RunSummary, *within, order=("run_id",), limit=limit)

    # -- audit log, rebuilt registries ----------------------------------------------------------

    def add_audit_end(self, log: Path, line: int, sha256: str) -> None:
        """Register the present end of an audit log.

        Parameters
        ----------
        log : pathlib.Path
            Folder of the audit log.
        line, sha256 : int, str
            Number and hash of its last line.
        """
        self.add(AuditEnd(log=self.stored(log), line=line, sha256=sha256))

    def audit_ends(self, log: Path) -> list[tuple[int, str]]:
        """Return the registered ends of an audit log: number and hash of the last line then."""
        ends = self.entries(AuditEnd, log=self.stored(log))
        return [(end.line, end.sha256) for end in ends]

    def note_rebuilt(self, run_ids: list[str], *, by: str, anew: bool) -> None:
        """Register which runs were registered again from their folders, by whom and when.

        Such a folder may state the end of a lost registry's chain.
        """
        reason = "rebuilt from run folders" if anew else "completed from run folders"
        self.add(Amendment(REBUILT, 0, datetime.now(UTC), by, reason, {"runs": run_ids}))

    def rebuilt(self) -> list[tuple[datetime, str, str, list[str]]]:
        """Return when, by whom, how and with which runs the registry was rebuilt."""
        return [
            (entry.amended, entry.amended_by, entry.reason, list(entry.changes.get("runs", ())))
            for entry in self.entries(Amendment, subject=REBUILT)
        ]

    # -- states ---------------------------------------------------------------------------------

    def entered_runs(self, run_ids: Iterable[str]) -> dict[str, bool]:
        """Return the registered ones of these runs, and whether their ends are registered."""
        wanted, entered = list(run_ids), {}
        with self.session() as session:
            for start in range(0, len(wanted), CHUNK):
                query = (
                    select(RunSummary.run_id, RunEnd.number)
                    .outerjoin(RunEnd, RunEnd.run_key == RunSummary.number)
                    .where(RunSummary.run_id.in_(wanted[start : start + CHUNK]))
                )
                entered.update({name: end is not None for name, end in session.execute(query)})
        return entered

    def unfinished_runs(self) -> list[RunSummary]:
        """Return runs without a registered end, oldest first; they are running or were killed."""
        return self.entries(RunSummary, ~exists().where(RunEnd.run_key == RunSummary.number))

    def passes_through(self, head: ChainHead) -> bool:
        """Return whether a noted chain end is a link of this registry's chain."""
        query = select(links.c.sha256).where(links.c.sequence == head.sequence)
        with self.session() as session:
            return session.scalar(query) == head.sha256

    def completed_runs_without_result(self) -> list[RunSummary]:
        """Return completed runs without a registered result, oldest first."""
        without = or_(
            *(
                RunSummary.kind.startswith(kind) & ~exists().where(key == RunSummary.number)
                for kind, key in _FOLLOWS.items()
            )
        )
        return self._not_discarded(without, _STATUS == "completed")

    def calibration_of_run(self, run_id: str) -> int | None:
        """Return the number of the calibration that a run measured; None without one."""
        for calibration in self.entries(CalibrationEntry, run_id=run_id, limit=1):
            return calibration.calibration_id
        return None

    def interrupted_calibrations(self, since: datetime) -> list[RunSummary]:
        """Return calibration runs after a certain time that weren't completed, the oldest first."""
        return self._not_discarded(
            RunSummary.kind.startswith("calibrate-"),
            _STATUS.in_(INTERRUPTED),
            RunSummary.started > since,
        )

    def _not_discarded(self, *conditions: Any) -> list[RunSummary]:
        discarded = exists().where(
            RunEnd.run_key == RunSummary.number, RunEnd.number.in_(_discarded_ends())
        )
        return self.entries(RunSummary, ~discarded, *conditions)

    def discarded(self, run_id: str) -> bool:
        """Return whether a run was discarded."""
        query = (
            select(RunEnd.number)
            .join(RunSummary, RunEnd.run_key == RunSummary.number)
            .where(RunSummary.run_id == run_id, RunEnd.number.in_(_discarded_ends()))
        )
        with self.session() as session:
            return session.scalar(query) is not None

    def discard_run(
        self, run_id: str, *, by: str, reason: str, signature: Signature | None = None
    ) -> None:
        """Discard a run that has ended; its folder stays unchanged.

        Raises
        ------
        InputError
            No person or no reason is named, or a result of the run is registered.
        RecordError
            The run isn't registered, or hasn't ended.
        """
        if not by.strip() or not reason.strip():
            raise InputError(
                Message("run {run} discarded without a reason", run_id), "a name and a reason"
            )
        signature = signature or Signature.typed()
        Accounts.of(self.root).refuse_typed(by, signature)
        with self.writing() as session:
            run = self.run(run_id)
            ends = self.entries(RunEnd, run_key=run.number)
            if not ends:
                raise RecordError(
                    Message("run {run_id} has not ended", run_id), "a run that has ended"
                )
            for kind, key in _FOLLOWS.items():
                result = select(key).where(key == run.number)
                if run.kind.startswith(kind) and session.scalar(result):
                    raise InputError(
                        Message("run {run_id} has a registered result", run_id),
                        "a run without a registered result",
                        "review the result with `torquebench records review --reject`",
                    )
            now, changes = datetime.now(UTC), {"status": DISCARDED}
            why = reason.strip()
            self.add(
                Amendment("run_ends", ends[0].number, now, by.strip(), why, changes, signature)
            )


def _discarded_ends() -> Any:
    """Return the query for the run ends that were amended to `DISCARDED`."""
    return select(Amendment.subject_id).where(
        Amendment.subject == "run_ends",
        Amendment.__table__.c.changes["status"].as_string() == DISCARDED,
    )
