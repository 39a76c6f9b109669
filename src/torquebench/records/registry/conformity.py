"""The registry's certificates, reviews and amendments."""

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Literal, get_args

from sqlalchemy import Table, select
from sqlalchemy.orm import Session

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.registry.database import Database, as_json, entry_of, row_of
from torquebench.records.registry.entries import Amendment, CertificateEntry, Review
from torquebench.records.registry.schema import (
    AmendmentRow,
    Base,
    CalibrationRow,
    CertificateRow,
    ReviewRow,
)

__all__ = ["ConformityRecords", "Subject"]

Subject = Literal[
    "equipment",
    "equipment_descriptions",
    "components",
    "adjustments",
    "reports",
    "zeroings",
    "runs",
    "run_ends",
    "calibrations",
    "models",
    "activations",
    "verifications",
    "checks",
    "certificates",
]
"""Tables whose records can be reviewed and amended."""


class ConformityRecords(Database):
    """Certificates, reviews and amendments."""

    def add_certificate(self, entry: CertificateEntry) -> None:
        """Register a certificate that is issued.

        Raises
        ------
        RecordError
            Where the number is taken, or calibration or replaced certificate aren't registered.
        """
        with self.writing() as session:
            if _certificate(session, entry.number) is not None:
                raise RecordError(
                    Message("certificate {number} is issued", entry.number),
                    "a new number",
                    "issue an amended certificate under its own number that supersedes it",
                )
            if session.get(CalibrationRow, entry.calibration_id) is None:
                raise RecordError(
                    Message("calibration {calibration_id} isn't registered", entry.calibration_id),
                    "a registered calibration",
                )
            replaced = _certificate(session, entry.supersedes) if entry.supersedes else None
            if entry.supersedes and replaced is None:
                raise RecordError(
                    Message("certificate {supersedes} isn't registered", entry.supersedes),
                    "an issued one",
                )
            files, summary = as_json(entry.files), as_json(entry.summary)
            row = row_of(
                CertificateRow, entry, files=files, summary=summary, supersedes=replaced,
                calibration_key=entry.calibration_id,
            )  # fmt: skip
            session.add(row)

    def certificates(self, calibration_id: int | None = None) -> list[CertificateEntry]:
        """Return certificates, all or of one calibration, the newest first."""
        with self.session() as session:
            rows = session.scalars(select(CertificateRow).order_by(CertificateRow.id.desc())).all()
            newer = {row.supersedes_key: row.number for row in reversed(rows)}
            return [
                entry_of(
                    CertificateEntry,
                    row,
                    calibration_id=row.calibration_key,
                    supersedes=row.supersedes.number if row.supersedes else "",
                    superseded_by=newer.get(row.id, ""),
                )
                for row in rows
                if calibration_id in (None, row.calibration_key)
            ]

    # Reviews

    def review(
        self,
        subject: Subject,
        subject_id: int,
        *,
        checked_by: str,
        accepted: bool = True,
        remark: str = "",
    ) -> None:
        """Enter the review of a record.

        Raises
        ------
        RecordError
            If there is no such record, no person is named, or the reviewer measured or entered it.
        """
        with self.writing() as session:
            content = _subject(session, subject, subject_id)
            measured_by = next((content[name] for name in _DOERS if content.get(name)), "")
            entered_by = (content.get("summary") or {}).get("entered by", "")
            doers = [str(each) for each in (measured_by, entered_by) if each]
            own = checked_by.strip().casefold() in (each.strip().casefold() for each in doers)
            if not checked_by.strip() or own:
                raise RecordError(
                    Message(
                        "{subject} {subject_id} checked by {checked_by}",
                        subject,
                        subject_id,
                        checked_by.strip() or "nobody",
                    ),
                    Message("somebody else than {doers}", " and ".join(doers))
                    if doers
                    else "a name",
                    "have a second person look over it",
                )
            session.add(
                ReviewRow(
                    subject=subject,
                    subject_key=subject_id,
                    checked=datetime.now(UTC),
                    checked_by=checked_by.strip(),
                    accepted=accepted,
                    remark=remark,
                )
            )

    def reviews(self, subject: Subject, subject_id: int) -> list[Review]:
        """Return the reviews of a record, the oldest first."""
        query = (
            select(ReviewRow)
            .where(ReviewRow.subject == subject, ReviewRow.subject_key == subject_id)
            .order_by(ReviewRow.id)
        )
        with self.session() as session:
            return [
                Review(subject, subject_id, row.checked, row.checked_by, row.accepted, row.remark)
                for row in session.scalars(query)
            ]

    # Amendments

    def amend(
        self,
        subject: Subject,
        subject_id: int,
        changes: Mapping[str, Any],
        *,
        amended_by: str,
        reason: str,
    ) -> None:
        """Enter an amendment of a record. The record itself stays as it was.

        Parameters
        ----------
        subject, subject_id : str, int
            The record that is amended: its table and number.
        changes : mapping of str to value
            Field to its correct value.
        amended_by, reason : str
            Person and reason.

        Raises
        ------
        RecordError
            If there is no such record or field, or no person or reason is named.
        """
        for what, given in (
            ("changes", changes),
            ("a name", amended_by.strip()),
            ("a reason", reason.strip()),
        ):
            if not given:
                raise RecordError(
                    Message(
                        "an amendment of {subject} {subject_id} without {what}",
                        subject,
                        subject_id,
                        what,
                    ),
                    "what it should have said, who says so, and why",
                )
        with self.writing() as session:
            content = _subject(session, subject, subject_id)
            for name in changes:
                if name not in content or name == "id":
                    known = ", ".join(sorted(set(content) - {"id"}))
                    raise RecordError(
                        Message("{subject} have no field {name}", subject, name), known
                    )
            session.add(
                AmendmentRow(
                    subject=subject,
                    subject_key=subject_id,
                    amended=datetime.now(UTC),
                    amended_by=amended_by.strip(),
                    reason=reason.strip(),
                    changes=as_json(changes),
                )
            )

    def amendments(self, subject: Subject, subject_id: int) -> list[Amendment]:
        """Return the amendments of a record, the oldest first."""
        query = (
            select(AmendmentRow)
            .where(AmendmentRow.subject == subject, AmendmentRow.subject_key == subject_id)
            .order_by(AmendmentRow.id)
        )
        with self.session() as session:
            return [
                Amendment(subject, subject_id, row.amended, row.amended_by, row.reason, row.changes)
                for row in session.scalars(query)
            ]


_DOERS = ("measured_by", "performed_by", "authorised_by", "operator")


def _certificate(session: Session, number: str) -> CertificateRow | None:
    return session.scalar(select(CertificateRow).where(CertificateRow.number == number))


def _subject(session: Session, subject: Subject, subject_id: int) -> dict[str, Any]:
    """Return the fields of the record that a review or an amendment points to."""
    if subject not in get_args(Subject):
        raise RecordError(
            Message("a record of kind {subject}", subject), ", ".join(get_args(Subject))
        )
    table: Table = Base.metadata.tables[subject]
    found = session.execute(select(table).where(table.c.id == subject_id)).one_or_none()
    if found is None:
        raise RecordError(
            Message("{subject} {subject_id} isn't registered", subject, subject_id),
            "a registered record",
        )
    return dict(found._mapping)
