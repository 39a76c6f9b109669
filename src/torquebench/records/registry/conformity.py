"""The registry's certificates, reviews and amendments."""

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, Literal, get_args

from sqlalchemy import select
from sqlalchemy.orm import Session

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.registry.entries import Amendment, CertificateEntry, Review
from torquebench.records.registry.entry_rows import EntryRecords, number_of
from torquebench.records.registry.schema import calibrations, certificates, metadata

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


class ConformityRecords(EntryRecords):
    """Certificates, reviews and amendments."""

    def add_certificate(self, entry: CertificateEntry) -> None:
        """Register a certificate that is issued.

        Raises
        ------
        RecordError
            Where the number is taken, or calibration or replaced certificate aren't registered.
        """
        with self.writing() as session:
            if number_of(session, certificates, number=entry.number) is not None:
                raise RecordError(
                    Message("certificate {number} is issued", entry.number),
                    "a new number",
                    "issue an amended certificate under its own number that supersedes it",
                )
            if number_of(session, calibrations, id=entry.calibration_id) is None:
                raise RecordError(
                    Message("calibration {calibration_id} isn't registered", entry.calibration_id),
                    "a registered calibration",
                )
            replaced = number_of(session, certificates, number=entry.supersedes)
            if entry.supersedes and replaced is None:
                raise RecordError(
                    Message("certificate {supersedes} isn't registered", entry.supersedes),
                    "an issued one",
                )
            self._add(entry)

    def certificates(self, calibration_id: int | None = None) -> list[CertificateEntry]:
        """Return certificates, all or of one calibration, the newest first."""
        entries = self.entries(CertificateEntry, newest_first=True)
        newer = {entry.supersedes: entry.number for entry in reversed(entries)}
        return [
            replace(entry, superseded_by=newer.get(entry.number, ""))
            for entry in entries
            if calibration_id in (None, entry.calibration_id)
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
            now = datetime.now(UTC)
            self._add(Review(subject, subject_id, now, checked_by.strip(), accepted, remark))

    def reviews(self, subject: Subject, subject_id: int) -> list[Review]:
        """Return the reviews of a record, the oldest first."""
        return self.entries(Review, subject=subject, subject_id=subject_id)

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
            now, by = datetime.now(UTC), amended_by.strip()
            self._add(Amendment(subject, subject_id, now, by, reason.strip(), changes))

    def amendments(self, subject: Subject, subject_id: int) -> list[Amendment]:
        """Return the amendments of a record, the oldest first."""
        return self.entries(Amendment, subject=subject, subject_id=subject_id)


_DOERS = ("measured_by", "performed_by", "authorised_by", "operator")


def _subject(session: Session, subject: Subject, subject_id: int) -> dict[str, Any]:
    """Return the fields of the record that a review or an amendment points to."""
    if subject not in get_args(Subject):
        raise RecordError(
            Message("a record of kind {subject}", subject), ", ".join(get_args(Subject))
        )
    table = metadata.tables[subject]
    found = session.execute(select(table).where(table.c.id == subject_id)).one_or_none()
    if found is None:
        raise RecordError(
            Message("{subject} {subject_id} isn't registered", subject, subject_id),
            "a registered record",
        )
    return dict(found._mapping)
