"""The registry's runs by their state; see `records.unfinished`."""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import ColumnElement, select

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records.chain import ChainHead
from torquebench.records.registry.entries import Amendment, CalibrationEntry, RunSummary
from torquebench.records.registry.entry_rows import number_of, run_row
from torquebench.records.registry.schema import (
    amendments,
    calibrations,
    checks,
    links,
    run_ends,
    runs,
    verifications,
)
from torquebench.records.runs.entries import RunRecords

__all__ = ["DISCARDED", "INTERRUPTED", "RunStateRecords"]

DISCARDED = "discarded"
"""Amendment of a run's end if somebody discards the run."""
INTERRUPTED = ("interrupted", "aborted", "failed")
CHUNK = 500

_FOLLOWS: Mapping[str, Any] = {
    "calibrate-": calibrations.c.run_key,
    "check-": checks.c.run_key,
    "verify-": verifications.c.run_key,
}
"""Column by which results of a kind of run refer to it."""


class RunStateRecords(RunRecords):
    """Runs by their state."""

    def entered_runs(self, run_ids: Iterable[str]) -> dict[str, bool]:
        """Return which of some runs are registered, and whether their ends are."""
        wanted, found = list(run_ids), {}
        with self.session() as session:
            for start in range(0, len(wanted), CHUNK):
                query = (
                    select(runs.c.run_id, run_ends.c.id)
                    .outerjoin(run_ends, run_ends.c.run_key == runs.c.id)
                    .where(runs.c.run_id.in_(wanted[start : start + CHUNK]))
                )
                found.update({name: end is not None for name, end in session.execute(query)})
        return found

    def passes_through(self, head: ChainHead) -> bool:
        """Return whether a noted end of a chain is a link of this registry's."""
        query = select(links.c.sha256).where(links.c.sequence == head.sequence)
        with self.session() as session:
            return session.scalar(query) == head.sha256

    def completed_runs_without_result(self) -> list[RunSummary]:
        """Return completed runs without a registered result, oldest first."""
        wanted: ColumnElement[bool] | None = None
        for kind, key in _FOLLOWS.items():
            one = runs.c.kind.startswith(kind) & runs.c.id.not_in(
                select(key).where(key.is_not(None))
            )
            wanted = one if wanted is None else wanted | one
        assert wanted is not None
        query = self._runs_and_ends().where(wanted, run_ends.c.status == "completed")
        return self._not_discarded(query)

    def calibration_of_run(self, run_id: str) -> int | None:
        """Return the number of the calibration that a run measured; None where it has none."""
        for calibration in self.entries(CalibrationEntry, run_id=run_id, limit=1):
            return calibration.calibration_id
        return None

    def interrupted_calibrations(self, since: datetime) -> list[RunSummary]:
        """Return calibrations that were begun after a moment and not completed, oldest first."""
        query = self._runs_and_ends().where(
            runs.c.kind.startswith("calibrate-"),
            run_ends.c.status.in_(INTERRUPTED),
            runs.c.started > since,
        )
        return self._not_discarded(query)

    def _not_discarded(self, query: Any) -> list[RunSummary]:
        query = query.where(run_ends.c.id.not_in(_discarded_ends()))
        return self._runs(query.order_by(runs.c.id))

    def discarded(self, run_id: str) -> bool:
        """Return whether a run was discarded."""
        query = (
            select(run_ends.c.id)
            .join(runs, run_ends.c.run_key == runs.c.id)
            .where(runs.c.run_id == run_id, run_ends.c.id.in_(_discarded_ends()))
        )
        with self.session() as session:
            return session.scalar(query) is not None

    def discard_run(self, run_id: str, *, by: str, reason: str) -> None:
        """Discard a run that has ended; its folder stays unchanged.

        Raises
        ------
        InputError
            Nobody or no reason is named, or something of it is registered already.
        RecordError
            The run isn't registered, or hasn't ended.
        """
        if not by.strip() or not reason.strip():
            raise InputError(
                Message("run {run} discarded without a reason", run_id), "a name and a reason"
            )
        with self.writing() as session:
            row = run_row(session, run_id)
            end = number_of(session, run_ends, run_key=row.id)
            if end is None:
                raise RecordError(
                    Message("run {run_id} has not ended", run_id), "a run that has ended"
                )
            for kind, key in _FOLLOWS.items():
                if row.kind.startswith(kind) and session.scalar(select(key).where(key == row.id)):
                    raise InputError(
                        Message("run {run_id} has a registered result", run_id),
                        "a run without one",
                        "review the result with `torquebench records review --reject`",
                    )
            now, changes = datetime.now(UTC), {"status": DISCARDED}
            self._add(Amendment(run_ends.name, end, now, by.strip(), reason.strip(), changes))


def _discarded_ends() -> Any:
    """Return the query of ends that were amended to `DISCARDED`."""
    return select(amendments.c.subject_key).where(
        amendments.c.subject == run_ends.name,
        amendments.c.changes["status"].as_string() == DISCARDED,
    )
