"""The registry's tables: which fields of the entries are stored, in which columns.

Every table is append-only: triggers refuse changes, and the chain's links reveal changes that
bypass them. Later information (a run's end, the state of equipment, a calibration's review) is a
row of its own that refers to the original.
"""

from collections.abc import Mapping
from datetime import UTC, date, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal, get_args, get_origin, get_type_hints

from sqlalchemy import (
    JSON,
    Boolean,
    Column,
    Date,
    DateTime,
    Dialect,
    Double,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    TypeDecorator,
)

from torquebench.records.chain import Link
from torquebench.records.registry import entries

__all__ = [
    "POINTS_TO",
    "TABLES",
    "UtcDateTime",
    "activations",
    "adjustments",
    "amendments",
    "audit_ends",
    "calibrations",
    "certificates",
    "checks",
    "components",
    "descriptions",
    "equipment",
    "links",
    "metadata",
    "models",
    "reports",
    "reviews",
    "run_ends",
    "runs",
    "verifications",
    "zeroings",
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


metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "pk": "pk_%(table_name)s",
    }
)
POINTS_TO = {
    **dict.fromkeys(
        ("equipment_key", "whole_key", "part_key", "transducer_key", "counter_key", "standard_key"),
        "equipment",
    ),
    "run_key": "runs",
    "calibration_key": "calibrations",
    "model_key": "models",
    "supersedes_key": "certificates",
}
"""Table of the rows whose numbers a column has."""
TABLES: dict[type, Table] = {}
"""Table of each kind of entry."""
_TYPES: dict[Any, Any] = {
    str: Text,
    Literal: Text,
    Path: Text,
    int: Integer,
    float: Double,
    tuple: Double,
    bool: Boolean,
    datetime: UtcDateTime,
    date: Date,
    Mapping: JSON,
}


def _table(
    name: str,
    entry: type,
    columns: str,
    *indexes: Index,
    empty: str = "",
    indexed: str = "",
    unique: str = "",
    others: Mapping[str, type] = MappingProxyType({}),
) -> Table:
    """Return the table of a kind of entry: a number, and columns with the types of its fields.

    Parameters
    ----------
    name : str
    entry : type
        A frozen dataclass.
    columns : str
        Names in their order, separated by spaces: fields of the entry, the limits of its field
        ``valid_nm``, and keys, which are numbers of rows of other tables.
    *indexes : sqlalchemy.Index
        Over several columns.
    empty, indexed, unique : str
        Columns that may be empty, that have an index, whose values differ.
    others : mapping of str to type
        Columns for which the entry has no field.
    """
    hints = {**get_type_hints(entry), "recorded": datetime, **others}
    made = (
        Column(
            column,
            *(
                (Integer, ForeignKey(f"{POINTS_TO[column]}.id"))
                if column in POINTS_TO
                else (_type(column, hints),)
            ),
            nullable=column in empty.split(),
            index=column in indexed.split() or None,
            unique=column in unique.split() or None,
        )
        for column in columns.split()
    )
    table = Table(name, metadata, Column("id", Integer, primary_key=True), *made, *indexes)
    TABLES.setdefault(entry, table)
    return table


def _type(column: str, hints: Mapping[str, Any]) -> Any:
    if column.endswith("sha256"):
        return String(64)
    field = {"subject_key": "subject_id"}.get(column, column)
    hint = hints["valid_nm" if column.startswith("valid_") else field]
    for kind in (hint, *get_args(hint)):  # the first that isn't a union with None
        if (get_origin(kind) or kind) in _TYPES:
            return _TYPES[get_origin(kind) or kind]
    raise TypeError(f"{column} has the type {hint}")


# Rows of the other tables as entered, by the fields of a link of the hash chain.
links = Table(
    "chain",
    metadata,
    Column("sequence", Integer, primary_key=True, autoincrement=False),
    *(
        Column(name, _type(name, get_type_hints(Link)), nullable=False, unique=name == "sha256")
        for name in ("table", "key", "recorded", "content", "previous_sha256", "sha256")
    ),
    Index("ix_chain_row", "table", "key", unique=True),
)

equipment = _table(
    "equipment",
    entries.Equipment,
    "kind serial recorded",
    Index("ix_equipment_identity", "kind", "serial", unique=True),
)
# Data of a piece of equipment from a time on; the latest row is valid.
descriptions = _table(
    "equipment_descriptions",
    entries.Equipment,
    "equipment_key manufacturer model range_nm details recorded",
    empty="range_nm",
    indexed="equipment_key",
)
# Pieces of equipment fitted into others, or taken out of them.
components = _table(
    "components",
    entries.Component,
    "whole_key part_key role change performed performed_by reason",
    others={"change": str, "performed": datetime, "performed_by": str, "reason": str},
    indexed="whole_key part_key",
)
adjustments = _table(
    "adjustments",
    entries.Adjustment,
    "equipment_key what before after performed performed_by checked_by reason",
    indexed="equipment_key",
)
reports = _table(
    "reports",
    entries.Report,
    "equipment_key number laboratory performed due measured_by checked_by valid_low_nm "
    "valid_high_nm expanded_uncertainty_percent file file_sha256 recorded",
    empty="performed due valid_low_nm valid_high_nm expanded_uncertainty_percent",
    indexed="equipment_key",
)
zeroings = _table(
    "zeroings",
    entries.Zeroing,
    "transducer_key run_key performed zero_hz zero_nm temperature_c simulated",
    Index("ix_zeroings_transducer", "transducer_key", "performed"),
    empty="run_key temperature_c",
)
runs = _table(
    "runs",
    entries.RunSummary,
    "run_id kind started side operator bench simulated profile_name profile_sha256 "
    "software_version folder",
    # Lists of runs are sorted newest first: these indexes serve them, read backwards.
    Index("ix_runs_started", "started", "id"),
    Index("ix_runs_kind_started", "kind", "started", "id"),
    unique="run_id",
)
# How runs ended, and the hash of the manifest that seals each folder.
run_ends = _table(
    "run_ends",
    entries.RunSummary,
    "run_key finished status reason manifest_sha256",
    unique="run_key",
)
# Ends of audit logs when their bench was closed: a removal before them is detected.
audit_ends = _table(
    "audit_ends", object, "log line sha256 recorded", others={"log": str, "line": int}
)

calibrations = _table(
    "calibrations",
    entries.CalibrationEntry,
    "run_key transducer_key counter_key standard_key performed measured_by range_nm "
    "valid_low_nm valid_high_nm due points data_sha256 profile_name profile_sha256 "
    "simulated files summary",
    empty="run_key standard_key due",
    indexed="transducer_key",
)
models = _table(
    "models",
    entries.ModelEntry,
    "calibration_key kind file file_sha256 range_nm side metrics created",
    indexed="calibration_key",
)
activations = _table(
    "activations",
    entries.Activation,
    "transducer_key counter_key model_key activated operator reason",
    Index("ix_activations_chain", "transducer_key", "counter_key", "id"),
    empty="model_key",
)
verifications = _table(
    "verifications",
    entries.VerificationEntry,
    "model_key run_key performed measured_by data_sha256 simulated summary",
    empty="run_key",
    indexed="model_key",
)
checks = _table(
    "checks",
    entries.CheckEntry,
    "transducer_key standard_key model_key run_key performed measured_by verdict "
    "worst_percent_fs tolerance_percent_fs simulated summary",
    Index("ix_checks_transducer", "transducer_key", "performed"),
    empty="standard_key model_key run_key",
)
certificates = _table(
    "certificates",
    entries.CertificateEntry,
    "number calibration_key supersedes_key issued authorised_by files summary",
    empty="supersedes_key",
    indexed="calibration_key",
    unique="number",
)
reviews = _table(
    "reviews",
    entries.Review,
    "subject subject_key checked checked_by accepted remark",
    Index("ix_reviews_subject", "subject", "subject_key"),
)
amendments = _table(
    "amendments",
    entries.Amendment,
    "subject subject_key amended amended_by reason changes",
    Index("ix_amendments_subject", "subject", "subject_key"),
)
