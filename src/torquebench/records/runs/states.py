"""The registry's runs by their state; see `records.unfinished`."""

from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import ColumnElement, select

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records.chain import ChainHead
from torquebench.records.registry.database import run_row
from torquebench.records.registry.entries import RunSummary
from torquebench.records.registry.schema import (
    AmendmentRow,
    CalibrationRow,
    CheckRow,
    LinkRow,
    RunEndRow,
    RunRow,
    VerificationRow,
)
from torquebench.records.runs.entries import RunRecords

__all__ = ["DISCARDED", "INTERRUPTED", "RunStateRecords"]

DISCARDED = "discarded"
"""Amendment of a run's end if somebody discards the run."""
INTERRUPTED = ("interrupted", "aborted", "failed")
CHUNK = 500

_FOLLOWS: Mapping[str, Any] = {
    "calibrate-": CalibrationRow.run_key,
    "check-": CheckRow.run_key,
    "verify-": VerificationRow.run_key,
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
                    select(RunRow.run_id, RunEndRow.id)
                    .outerjoin(RunEndRow, RunEndRow.run_key == RunRow.id)
                    .where(RunRow.run_id.in_(wanted[start : start + CHUNK]))
                )
                found.update({name: end is not None for name, end in session.execute(query)})
        return found

    def passes_through(self, head: ChainHead) -> bool:
        """Return whether a noted end of a chain is a link of this registry's."""
        query = select(LinkRow.sha256).where(LinkRow.sequence == head.sequence)
        with self.session() as session:
            return session.scalar(query) == head.sha256

    def completed_runs_without_result(self) -> list[RunSummary]:
        """Return completed runs without a registered result, oldest first."""
        wanted: ColumnElement[bool] | None = None
        for kind, key in _FOLLOWS.items():
            one = RunRow.kind.startswith(kind) & RunRow.id.not_in(
                select(key).where(key.is_not(None))
            )
            wanted = one if wanted is None else wanted | one
        assert wanted is not None
        query = self._runs_and_ends().where(wanted, RunEndRow.status == "completed")
        return self._not_discarded(query)

    def calibration_of_run(self, run_id: str) -> int | None:
        """Return the number of the calibration that a run measured; None where it has none."""
        query = (
            select(CalibrationRow.id)
            .join(RunRow, CalibrationRow.run_key == RunRow.id)
            .where(RunRow.run_id == run_id)
            .order_by(CalibrationRow.id)
        )
        with self.session() as session:
            return session.scalar(query)

    def interrupted_calibrations(self, since: datetime) -> list[RunSummary]:
        """Return calibrations that were begun after a moment and not completed, oldest first."""
        query = self._runs_and_ends().where(
            RunRow.kind.startswith("calibrate-"),
            RunEndRow.status.in_(INTERRUPTED),
            RunRow.started > since,
        )
        return self._not_discarded(query)

    def _not_discarded(self, query: Any) -> list[RunSummary]:
        query = query.where(RunEndRow.id.not_in(_discarded_ends())).order_by(RunRow.id)
        with self.session() as session:
            return [self._run(row) for row in session.execute(query)]

    def discarded(self, run_id: str) -> bool:
        """Return whether a run was discarded."""
        query = (
            select(RunEndRow.id)
            .join(RunRow, RunEndRow.run_key == RunRow.id)
            .where(RunRow.run_id == run_id, RunEndRow.id.in_(_discarded_ends()))
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
            end = session.scalar(select(RunEndRow).where(RunEndRow.run_key == row.id))
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
            session.add(
                AmendmentRow(
                    subject=RunEndRow.__tablename__,
                    subject_key=end.id,
                    amended=datetime.now(UTC),
                    amended_by=by.strip(),
                    reason=reason.strip(),
                    changes={"status": DISCARDED},
                )
            )


def _discarded_ends() -> Any:
    """Return the query of ends that were amended to `DISCARDED`."""
    return select(AmendmentRow.subject_key).where(
        AmendmentRow.subject == RunEndRow.__tablename__,
        AmendmentRow.changes["status"].as_string() == DISCARDED,
    )
