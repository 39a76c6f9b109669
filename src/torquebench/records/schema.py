"""The registry's tables: the one place that says which columns a record has."""

from datetime import UTC, datetime
from typing import Any

from sqlalchemy import JSON, DateTime, Dialect, ForeignKey, Index, String, TypeDecorator, text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

__all__ = [
    "ActivationRow",
    "Base",
    "CalibrationRow",
    "InstrumentRow",
    "ModelRow",
    "RunRow",
    "VerificationRow",
]


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

    type_annotation_map = {datetime: UtcDateTime, dict[str, Any]: JSON}  # noqa: RUF012 - SQLAlchemy reads it once


class InstrumentRow(Base):
    """A transducer, calibrator, verification standard or counter, by its serial."""

    __tablename__ = "instruments"

    id: Mapped[int] = mapped_column(primary_key=True)
    kind: Mapped[str] = mapped_column(String(40))
    serial: Mapped[str] = mapped_column(String(120))
    manufacturer: Mapped[str] = mapped_column(String(120), default="")
    model: Mapped[str] = mapped_column(String(120), default="")
    range_nm: Mapped[float | None]
    details: Mapped[dict[str, Any]] = mapped_column(default=dict)
    recorded: Mapped[datetime]

    __table_args__ = (Index("ix_instruments_identity", "kind", "serial", unique=True),)


class RunRow(Base):
    """One run of a procedure and its folder."""

    __tablename__ = "runs"

    id: Mapped[int] = mapped_column(primary_key=True)
    run_id: Mapped[str] = mapped_column(String(120), unique=True)
    kind: Mapped[str] = mapped_column(String(60))
    started: Mapped[datetime]
    finished: Mapped[datetime | None]
    status: Mapped[str] = mapped_column(String(20))
    reason: Mapped[str] = mapped_column(default="")
    side: Mapped[str] = mapped_column(String(20), default="")
    operator: Mapped[str] = mapped_column(String(120), default="")
    bench: Mapped[str] = mapped_column(String(120), default="")
    simulated: Mapped[bool]
    profile_name: Mapped[str] = mapped_column(String(120), default="")
    profile_sha256: Mapped[str] = mapped_column(String(64), default="")
    software_version: Mapped[str] = mapped_column(String(40))
    folder: Mapped[str]
    manifest_sha256: Mapped[str] = mapped_column(String(64), default="")

    __table_args__ = (
        # The list of runs is always the newest first; this index alone answers it.
        Index("ix_runs_started", text("started DESC"), text("id DESC")),
        Index("ix_runs_kind_started", "kind", text("started DESC")),
    )


class CalibrationRow(Base):
    """One calibration of one chain: a transducer read by one counter."""

    __tablename__ = "calibrations"

    id: Mapped[int] = mapped_column(primary_key=True)
    run_key: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    transducer_key: Mapped[int] = mapped_column(ForeignKey("instruments.id"), index=True)
    counter_key: Mapped[int] = mapped_column(ForeignKey("instruments.id"))
    standard_key: Mapped[int | None] = mapped_column(ForeignKey("instruments.id"))
    performed: Mapped[datetime]
    range_nm: Mapped[float]
    points: Mapped[int]
    data_sha256: Mapped[str] = mapped_column(String(64))
    profile_name: Mapped[str] = mapped_column(String(120), default="")
    profile_sha256: Mapped[str] = mapped_column(String(64), default="")
    simulated: Mapped[bool]
    summary: Mapped[dict[str, Any]] = mapped_column(default=dict)

    run: Mapped[RunRow | None] = relationship()
    transducer: Mapped[InstrumentRow] = relationship(foreign_keys=[transducer_key])
    counter: Mapped[InstrumentRow] = relationship(foreign_keys=[counter_key])


class ModelRow(Base):
    """One fitted compensation model and its file."""

    __tablename__ = "models"

    id: Mapped[int] = mapped_column(primary_key=True)
    calibration_key: Mapped[int] = mapped_column(ForeignKey("calibrations.id"), index=True)
    kind: Mapped[str] = mapped_column(String(60))
    file: Mapped[str]
    file_sha256: Mapped[str] = mapped_column(String(64))
    range_nm: Mapped[float]
    side: Mapped[str] = mapped_column(String(20), default="")
    metrics: Mapped[dict[str, Any]] = mapped_column(default=dict)
    created: Mapped[datetime]

    calibration: Mapped[CalibrationRow] = relationship()


class ActivationRow(Base):
    """A model put into use, or taken out of use (no model), for a transducer and its counter."""

    __tablename__ = "activations"

    id: Mapped[int] = mapped_column(primary_key=True)
    transducer_key: Mapped[int] = mapped_column(ForeignKey("instruments.id"))
    counter_key: Mapped[int] = mapped_column(ForeignKey("instruments.id"))
    model_key: Mapped[int | None] = mapped_column(ForeignKey("models.id"))
    activated: Mapped[datetime]
    operator: Mapped[str] = mapped_column(String(120), default="")
    reason: Mapped[str] = mapped_column(default="")

    model: Mapped[ModelRow | None] = relationship()

    __table_args__ = (
        Index("ix_activations_chain", "transducer_key", "counter_key", text("id DESC")),
    )


class VerificationRow(Base):
    """What a verification found for one model."""

    __tablename__ = "verifications"

    id: Mapped[int] = mapped_column(primary_key=True)
    model_key: Mapped[int] = mapped_column(ForeignKey("models.id"), index=True)
    run_key: Mapped[int | None] = mapped_column(ForeignKey("runs.id"))
    performed: Mapped[datetime]
    data_sha256: Mapped[str] = mapped_column(String(64))
    simulated: Mapped[bool]
    summary: Mapped[dict[str, Any]] = mapped_column(default=dict)

    model: Mapped[ModelRow] = relationship()
    run: Mapped[RunRow | None] = relationship()
