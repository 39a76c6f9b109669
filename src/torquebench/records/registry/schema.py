"""The registry's tables: the only definition of a record's columns.

Every table is append-only: triggers refuse changes, and the chain's links reveal changes that
bypass them. Later information (a run's end, the state of equipment, a calibration's review) is a
row of its own that refers to the original.
"""

from datetime import UTC, date, datetime
from typing import Any

from sqlalchemy import (
    JSON,
    Date,
    DateTime,
    Dialect,
    ForeignKey,
    Index,
    MetaData,
    String,
    Text,
    TypeDecorator,
)
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

__all__ = [
    "ActivationRow",
    "AdjustmentRow",
    "AmendmentRow",
    "AuditEndRow",
    "Base",
    "CalibrationRow",
    "CertificateRow",
    "CheckRow",
    "ComponentRow",
    "DescriptionRow",
    "EquipmentRow",
    "LinkRow",
    "ModelRow",
    "ReportRow",
    "ReviewRow",
    "RunEndRow",
    "RunRow",
    "VerificationRow",
    "ZeroingRow",
]

Sha256 = String(64)


class UtcDateTime(TypeDecorator[datetime]):
    """A moment with time zone, stored in UTC: SQLite itself keeps no time zone."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        """Turn a moment into UTC on its way into the database."""
        return None if value is None else value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, _dialect: Dialect) -> datetime | None:
        """Give a stored moment its time zone back."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if value.tzinfo is None else value.astimezone(UTC)


class Base(DeclarativeBase):
    """Base of all tables."""

    type_annotation_map = {  # noqa: RUF012 - SQLAlchemy reads it once
        datetime: UtcDateTime,
        date: Date,
        str: Text,
        dict[str, Any]: JSON,
    }
    metadata = MetaData(
        naming_convention={
            "ix": "ix_%(table_name)s_%(column_0_N_name)s",
            "uq": "uq_%(table_name)s_%(column_0_N_name)s",
            "fk": "fk_%(table_name)s_%(column_0_name)s",
            "pk": "pk_%(table_name)s",
        }
    )


class LinkRow(Base):
    """One link of the hash chain: a row of another table as entered."""

    __tablename__ = "chain"

    sequence: Mapped[int] = mapped_column(primary_key=True, autoincrement=False)
    table: Mapped[str]
    key: Mapped[int]
    recorded: Mapped[str]
    content: Mapped[str]
    previous_sha256: Mapped[str] = mapped_column(Sha256)
    sha256: Mapped[str] = mapped_column(Sha256, unique=True)

    __table_args__ = (Index("ix_chain_row", "table", "key", unique=True),)


class NumberedRow(Base):
    """A row with a number of its own."""

    __abstract__ = True

    id: Mapped[int] = mapped_column(primary_key=True, sort_order=-1)


# Equipment


class EquipmentRow(NumberedRow):
    """A transducer, standard, counter, drive or bench, by its kind and serial."""

    __tablename__ = "equipment"

    kind: Mapped[str]
    serial: Mapped[str]
    recorded: Mapped[datetime]

    __table_args__ = (Index("ix_equipment_identity", "kind", "serial", unique=True),)


class DescriptionRow(NumberedRow):
    """Data of a piece of equipment from a time on; the latest row is valid."""

    __tablename__ = "equipment_descriptions"

    equipment_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"), index=True)
    manufacturer: Mapped[str]
    model: Mapped[str]
    range_nm: Mapped[float | None]
    details: Mapped[dict[str, Any]]
    recorded: Mapped[datetime]

    equipment: Mapped[EquipmentRow] = relationship()


class ComponentRow(NumberedRow):
    """A piece of equipment fitted into another one, or taken out of it."""

    __tablename__ = "components"

    whole_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"), index=True)
    part_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"), index=True)
    role: Mapped[str]
    change: Mapped[str]
    performed: Mapped[datetime]
    performed_by: Mapped[str]
    reason: Mapped[str]

    whole: Mapped[EquipmentRow] = relationship(foreign_keys=[whole_key])
    part: Mapped[EquipmentRow] = relationship(foreign_keys=[part_key])


class AdjustmentRow(NumberedRow):
    """Work on a piece of equipment that may change its indication."""

    __tablename__ = "adjustments"

    equipment_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"), index=True)
    what: Mapped[str]
    before: Mapped[dict[str, Any]]
    after: Mapped[dict[str, Any]]
    performed: Mapped[datetime]
    performed_by: Mapped[str]
    checked_by: Mapped[str]
    reason: Mapped[str]

    equipment: Mapped[EquipmentRow] = relationship()


class ReportRow(NumberedRow):
    """The certificate of a standard by the laboratory that calibrated it."""

    __tablename__ = "reports"

    equipment_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"), index=True)
    number: Mapped[str]
    laboratory: Mapped[str]
    performed: Mapped[date | None]
    due: Mapped[date | None]
    measured_by: Mapped[str]
    checked_by: Mapped[str]
    valid_low_nm: Mapped[float | None]
    valid_high_nm: Mapped[float | None]
    expanded_uncertainty_percent: Mapped[float | None]
    file: Mapped[str]
    file_sha256: Mapped[str] = mapped_column(Sha256)
    recorded: Mapped[datetime]

    equipment: Mapped[EquipmentRow] = relationship()


class ZeroingRow(NumberedRow):
    """The unloaded zero of a transducer, read and taken for 0 N·m."""

    __tablename__ = "zeroings"

    transducer_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"))
    run_key: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    performed: Mapped[datetime]
    zero_hz: Mapped[float]
    zero_nm: Mapped[float]
    temperature_c: Mapped[float | None]
    simulated: Mapped[bool]

    transducer: Mapped[EquipmentRow] = relationship()
    run: Mapped["RunRow | None"] = relationship()

    __table_args__ = (Index("ix_zeroings_transducer", "transducer_key", "performed"),)


# Runs


class RunRow(NumberedRow):
    """One run of a procedure and its folder, as it began."""

    __tablename__ = "runs"

    run_id: Mapped[str] = mapped_column(unique=True)
    kind: Mapped[str]
    started: Mapped[datetime]
    side: Mapped[str]
    operator: Mapped[str]
    bench: Mapped[str]
    simulated: Mapped[bool]
    profile_name: Mapped[str]
    profile_sha256: Mapped[str] = mapped_column(Sha256)
    software_version: Mapped[str]
    folder: Mapped[str]

    __table_args__ = (
        # Lists of runs are sorted newest first: these indexes serve them, read backwards.
        Index("ix_runs_started", "started", "id"),
        Index("ix_runs_kind_started", "kind", "started", "id"),
    )


class RunEndRow(NumberedRow):
    """How a run ended, and the hash of the manifest that seals its folder."""

    __tablename__ = "run_ends"

    run_key: Mapped[int] = mapped_column(ForeignKey("runs.id"), unique=True)
    finished: Mapped[datetime]
    status: Mapped[str]
    reason: Mapped[str]
    manifest_sha256: Mapped[str] = mapped_column(Sha256)

    run: Mapped[RunRow] = relationship()


class AuditEndRow(NumberedRow):
    """End of an audit log when its bench was closed: a removal before it is detected."""

    __tablename__ = "audit_ends"

    log: Mapped[str]
    line: Mapped[int]
    sha256: Mapped[str] = mapped_column(Sha256)
    recorded: Mapped[datetime]


# Calibrations, models, verifications


class CalibrationRow(NumberedRow):
    """One calibration of one chain: a transducer read by one counter."""

    __tablename__ = "calibrations"

    run_key: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    transducer_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"), index=True)
    counter_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"))
    standard_key: Mapped[int | None] = mapped_column(ForeignKey("equipment.id"))
    performed: Mapped[datetime]
    measured_by: Mapped[str]
    range_nm: Mapped[float]
    valid_low_nm: Mapped[float]
    valid_high_nm: Mapped[float]
    due: Mapped[date | None]
    points: Mapped[int]
    data_sha256: Mapped[str] = mapped_column(Sha256)
    profile_name: Mapped[str]
    profile_sha256: Mapped[str] = mapped_column(Sha256)
    simulated: Mapped[bool]
    files: Mapped[dict[str, Any]]
    summary: Mapped[dict[str, Any]]

    run: Mapped[RunRow | None] = relationship()
    transducer: Mapped[EquipmentRow] = relationship(foreign_keys=[transducer_key])
    counter: Mapped[EquipmentRow] = relationship(foreign_keys=[counter_key])
    standard: Mapped[EquipmentRow | None] = relationship(foreign_keys=[standard_key])


class ModelRow(NumberedRow):
    """One fitted compensation model and its file."""

    __tablename__ = "models"

    calibration_key: Mapped[int] = mapped_column(ForeignKey("calibrations.id"), index=True)
    kind: Mapped[str]
    file: Mapped[str]
    file_sha256: Mapped[str] = mapped_column(Sha256)
    range_nm: Mapped[float]
    side: Mapped[str]
    metrics: Mapped[dict[str, Any]]
    created: Mapped[datetime]

    calibration: Mapped[CalibrationRow] = relationship()


class ActivationRow(NumberedRow):
    """A model put into use, or taken out of use (no model), for a transducer and its counter."""

    __tablename__ = "activations"

    transducer_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"))
    counter_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"))
    model_key: Mapped[int | None] = mapped_column(ForeignKey("models.id"))
    activated: Mapped[datetime]
    operator: Mapped[str]
    reason: Mapped[str]

    model: Mapped[ModelRow | None] = relationship()

    __table_args__ = (Index("ix_activations_chain", "transducer_key", "counter_key", "id"),)


class VerificationRow(NumberedRow):
    """Result of a verification for one model."""

    __tablename__ = "verifications"

    model_key: Mapped[int] = mapped_column(ForeignKey("models.id"), index=True)
    run_key: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    performed: Mapped[datetime]
    measured_by: Mapped[str]
    data_sha256: Mapped[str] = mapped_column(Sha256)
    simulated: Mapped[bool]
    summary: Mapped[dict[str, Any]]

    model: Mapped[ModelRow] = relationship()
    run: Mapped[RunRow | None] = relationship()


class CheckRow(NumberedRow):
    """A quick check of a chain against the check standard, with its verdict."""

    __tablename__ = "checks"

    transducer_key: Mapped[int] = mapped_column(ForeignKey("equipment.id"))
    standard_key: Mapped[int | None] = mapped_column(ForeignKey("equipment.id"))
    model_key: Mapped[int | None] = mapped_column(ForeignKey("models.id"))
    run_key: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    performed: Mapped[datetime]
    measured_by: Mapped[str]
    verdict: Mapped[str]
    worst_percent_fs: Mapped[float]
    tolerance_percent_fs: Mapped[float]
    simulated: Mapped[bool]
    summary: Mapped[dict[str, Any]]

    transducer: Mapped[EquipmentRow] = relationship(foreign_keys=[transducer_key])
    standard: Mapped[EquipmentRow | None] = relationship(foreign_keys=[standard_key])
    run: Mapped[RunRow | None] = relationship()

    __table_args__ = (Index("ix_checks_transducer", "transducer_key", "performed"),)


# Certificates, reviews, amendments


class CertificateRow(NumberedRow):
    """A certificate that was issued, with the hashes of its files."""

    __tablename__ = "certificates"

    number: Mapped[str] = mapped_column(unique=True)
    calibration_key: Mapped[int] = mapped_column(ForeignKey("calibrations.id"), index=True)
    supersedes_key: Mapped[int | None] = mapped_column(ForeignKey("certificates.id"))
    issued: Mapped[datetime]
    authorised_by: Mapped[str]
    files: Mapped[dict[str, Any]]
    summary: Mapped[dict[str, Any]]

    calibration: Mapped[CalibrationRow] = relationship()
    supersedes: Mapped["CertificateRow | None"] = relationship(remote_side="CertificateRow.id")


class ReviewRow(NumberedRow):
    """A review of a record, and its result."""

    __tablename__ = "reviews"

    subject: Mapped[str]
    subject_key: Mapped[int]
    checked: Mapped[datetime]
    checked_by: Mapped[str]
    accepted: Mapped[bool]
    remark: Mapped[str]

    __table_args__ = (Index("ix_reviews_subject", "subject", "subject_key"),)


class AmendmentRow(NumberedRow):
    """An amendment of a record; the record itself isn't changed."""

    __tablename__ = "amendments"

    subject: Mapped[str]
    subject_key: Mapped[int]
    amended: Mapped[datetime]
    amended_by: Mapped[str]
    reason: Mapped[str]
    changes: Mapped[dict[str, Any]]

    __table_args__ = (Index("ix_amendments_subject", "subject", "subject_key"),)
