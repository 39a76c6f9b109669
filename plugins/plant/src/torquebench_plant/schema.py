"""Tables and functions of a plant's registry.

A bench sends the links of its hash chain, which are stored unchanged. The database derives all
other tables from those links (``functions.sql``), so that a bench can't write rows that aren't in
its chain.
"""

from __future__ import annotations

import re
from importlib import resources
from typing import Any

from sqlalchemy import (
    ARRAY,
    BigInteger,
    Boolean,
    Column,
    DateTime,
    Float,
    ForeignKey,
    Index,
    Integer,
    MetaData,
    Table,
    Text,
    UniqueConstraint,
    text,
)
from sqlalchemy.dialects.postgresql import JSONB
from sqlalchemy.types import Date, TypeEngine

from torquebench.records.registry import Document, UtcDateTime, metadata
from torquebench.records.registry import links as chain

PLANT_SCHEMA = "plant"
PLANT_VERSION = "2"

plant_metadata = MetaData(schema=PLANT_SCHEMA)
_Moment = DateTime(timezone=True)


def _texts(names: str, default: str | None = "") -> list[Column[str]]:
    """Return columns of text that are never null, by their names in a row."""
    return [Column(name, Text, nullable=False, server_default=default) for name in names.split()]


def _mirrored_type(kind: TypeEngine[Any]) -> TypeEngine[Any]:
    if isinstance(kind, Document):
        return JSONB()
    if isinstance(kind, Integer):
        return BigInteger()
    if isinstance(kind, Date | Boolean | Float):
        return kind
    return _Moment if isinstance(kind, UtcDateTime) else Text()


settings = Table(
    "settings", plant_metadata, Column("name", Text, primary_key=True), *_texts("content")
)

benches = Table(
    "benches",
    plant_metadata,
    Column("bench_key", Integer, primary_key=True),
    *_texts("name place"),
    Column("role", Text, unique=True),
    Column("registered", _Moment, nullable=False),
    Column("first_sha256", Text, unique=True),
    Column("head_sequence", BigInteger, nullable=False, server_default="0"),
    Column("head_sha256", Text, nullable=False, server_default="0" * 64),
    Column("last_contact", _Moment),
    Column("replaced_by", Integer, ForeignKey("plant.benches.bench_key")),
)

links = Table(
    "links",
    plant_metadata,
    Column("bench_key", Integer, ForeignKey("plant.benches.bench_key"), primary_key=True),
    *(
        Column(
            each.name,
            _mirrored_type(each.type),
            primary_key=each.primary_key,
            nullable=False,
            autoincrement=False,
        )
        for each in chain.c
    ),
)

runs = Table(
    "runs",
    plant_metadata,
    Column("bench_key", Integer, primary_key=True),
    Column("id", BigInteger, primary_key=True),
    *_texts("run_id kind", None),
    Column("started", _Moment, nullable=False),
    *_texts("side operator"),
    Column("simulated", Boolean, nullable=False),
    *_texts("profile_name profile_sha256 software_version"),
    Column("end_id", BigInteger),
    Column("finished", _Moment),
    *_texts("status", "running"),
    *_texts("reason"),
    Column("manifest_sha256", Text),
    *_texts("specimen_type serial batch"),
    Column("withdrawn", _Moment),
    *_texts("withdrawn_by withdrawn_reason"),
    UniqueConstraint("bench_key", "run_id", name="uq_plant_runs_run_id"),
    # Lists are sorted newest first: each index serves one filter and is read backwards.
    Index("ix_plant_runs_started", "started"),
    Index("ix_plant_runs_bench", "bench_key", "started"),
    Index("ix_plant_runs_kind", "kind", "started"),
    Index("ix_plant_runs_status", "status", "started"),
    Index("ix_plant_runs_operator", "operator", "started"),
    Index("ix_plant_runs_type", "specimen_type", "kind", "started"),
    Index("ix_plant_runs_serial", "serial", "started"),
    Index("ix_plant_runs_batch", "batch", "started"),
    Index("ix_plant_runs_simulated", "simulated", "started"),
    Index("ix_plant_runs_withdrawn", "started", postgresql_where=text("withdrawn IS NOT NULL")),
    Index("ix_plant_runs_manifest", "manifest_sha256"),
    Index("ix_plant_runs_end", "bench_key", "end_id"),
)

folders = Table(
    "folders",
    plant_metadata,
    Column("bench_key", Integer, primary_key=True),
    Column("run_id", Text, primary_key=True),
    *_texts("manifest_sha256 url", None),
    Column("points_url", Text),
    Column("bytes", BigInteger, nullable=False),
    Column("left_out", ARRAY(Text), nullable=False),
    Column("arrived", _Moment, nullable=False),
)

results = Table(
    "results",
    plant_metadata,
    Column("bench_key", Integer, primary_key=True),
    Column("run_id", Text, primary_key=True),
    Column("quantity", Text, primary_key=True),
    *_texts("title"),
    Column("value", Float, nullable=False),
    Column("expanded_uncertainty", Float),
    *_texts("unit limit verdict"),
)

batches = Table(
    "batches",
    plant_metadata,
    Column("serial", Text, primary_key=True),
    *_texts("batch"),
    Column("recorded", _Moment, nullable=False),
)

withdrawals = Table(
    "withdrawals",
    plant_metadata,
    Column("id", BigInteger, primary_key=True),
    Column("bench_key", Integer, nullable=False),
    Column("run_id", Text, nullable=False),
    Column("manifest_sha256", Text),
    Column("withdrawn", _Moment, nullable=False),
    *_texts("withdrawn_by reason"),
    Index("ix_plant_withdrawals_manifest", "manifest_sha256"),
    Index("ix_plant_withdrawals_run", "run_id"),
)

reevaluations = Table(
    "reevaluations",
    plant_metadata,
    Column("id", BigInteger, primary_key=True),
    Column("bench_key", Integer, nullable=False),
    *_texts("run_id label software_version manifest_sha256", None),
    Column("earlier", JSONB, nullable=False),
    Column("values", Text, nullable=False),
    *_texts("problem remark"),
    Column("evaluated", _Moment, nullable=False),
    # A run that couldn't be evaluated is tried again; its last row counts.
    Index("ix_plant_reevaluations_run", "label", "bench_key", "run_id", "id"),
)


def _mirror(table: Table) -> Table:
    """Return the plant's copy of a bench's table, with the bench's number."""
    columns = [
        Column(each.name, _mirrored_type(each.type)) for each in table.columns if each.name != "id"
    ]
    indexes = [
        Index(f"ix_plant_{table.name}_{name}", name, "bench_key")
        for name in _LOOKED_UP
        if name in table.columns
    ]
    return Table(
        table.name,
        plant_metadata,
        Column("bench_key", Integer, primary_key=True),
        Column("id", BigInteger, primary_key=True),
        *columns,
        *indexes,
    )


_LOOKED_UP = ("serial", "transducer_key", "equipment_key")
_OTHERWISE = (chain.name, "runs", "run_ends")

mirrored = {
    table.name: _mirror(table) for table in metadata.sorted_tables if table.name not in _OTHERWISE
}
"""The plant's copies of a bench's tables, by the name of the bench's table."""

KEPT = ("links", "results", "folders", "withdrawals", "reevaluations", *mirrored)
"""Tables whose rows can't be changed or removed."""

BENCH_FUNCTIONS = (
    "my_bench()",
    "append(json)",
    "my_missing_folders(integer)",
    "my_withdrawals()",
    "arrived(json)",
)
"""Functions that a bench's role may call."""


def statements() -> list[str]:
    """Return the statements that create the functions and protect stored rows from changes."""
    text = resources.files(__package__).joinpath("functions.sql").read_text(encoding="utf-8")
    names = ", ".join(f"'{name}'" for name in mirrored)
    text = text.replace("{mirrored}", f"ARRAY[{names}]")
    return [
        *re.split(r"\n\n(?=(?:--.*\n)?CREATE)", text)[1:],
        *(
            f'CREATE TRIGGER no_changes BEFORE UPDATE OR DELETE OR TRUNCATE ON plant."{name}" '
            "FOR EACH STATEMENT EXECUTE FUNCTION plant.no_changes()"
            for name in KEPT
        ),
    ]
