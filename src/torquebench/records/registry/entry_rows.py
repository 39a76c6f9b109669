"""Entries of the registry, to and from rows of its tables."""

import functools
import json
from collections.abc import Mapping
from dataclasses import MISSING, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypeVar

from sqlalchemy import Column, ColumnElement, FromClause, Row, Select, Table, select
from sqlalchemy.orm import Session

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.files import json_text, revived, with_messages
from torquebench.records.registry.database import Database, insert
from torquebench.records.registry.entries import CheckEntry
from torquebench.records.registry.schema import POINTS_TO, TABLES, equipment, metadata, runs

__all__ = ["EntryRecords", "as_json", "entry_of", "equipment_key", "number_of", "run_row"]

Entry = TypeVar("Entry", bound=Any)

_REFERENCES = {
    "kind": ("equipment_key", "kind"),
    "serial": ("equipment_key", "serial"),
    "transducer_serial": ("transducer_key", "serial"),
    "counter_identity": ("counter_key", "serial"),
    "standard_serial": ("standard_key", "serial"),
    "run_id": ("run_key", "run_id"),
    "supersedes": ("supersedes_key", "number"),
}
"""Key of the row that a field stands in, and its column there."""
_NUMBERS = {
    "calibration_id": "calibration_key",
    "model_id": "model_key",
    "subject_id": "subject_key",
}
"""Key whose number a field has; the row's own number where the table has no such key."""


class EntryRecords(Database):
    """Entries are added and listed by the names of their fields."""

    def _add(self, entry: Any) -> int:
        """Append an entry, and new equipment that it names; return its number.

        Raises
        ------
        RecordError
            Where its run isn't registered.
        """
        table = TABLES[type(entry)]
        with self.writing() as session:
            return insert(session, table, **self._columns(session, entry, table))

    def _columns(self, session: Session, entry: Any, table: Table) -> dict[str, Any]:
        """Return the columns of a table, without the row's number, from the fields of an entry."""
        low, high = getattr(entry, "valid_nm", None) or (None, None)
        values: dict[str, Any] = {
            "recorded": datetime.now(UTC),
            "valid_low_nm": low,
            "valid_high_nm": high,
        }
        for column in table.columns:
            name = column.name
            if name == "id" or name in values:
                continue
            if name.endswith("_key"):
                values[name] = _key(session, entry, column)
                continue
            value = getattr(entry, name)
            if isinstance(value, Mapping):
                value = as_json(value)
            elif isinstance(value, Path):
                value = self.stored(value)
            elif value is None and not column.nullable:
                value = ""
            values[name] = value
        return {name: value for name, value in values.items() if name in table.columns}

    def entries(
        self,
        kind: type[Entry],
        *,
        order: tuple[str, ...] = ("id",),
        newest_first: bool = False,
        limit: int | None = None,
        **wanted: Any,
    ) -> list[Entry]:
        """Return the entries of a kind.

        Parameters
        ----------
        kind : type
            One of `torquebench.records.registry.entries`.
        order : tuple of str
            Columns by which they are sorted.
        newest_first : bool
            Whether they are sorted downwards.
        limit : int, optional
            No more than these.
        **wanted
            Values of fields; None for any.
        """
        query, places = _view(kind)  # type: ignore[arg-type]  # types are hashable
        for name, value in wanted.items():
            if value is not None:
                query = query.where(places[name] == value)
        columns = [TABLES[kind].c[name] for name in order]
        query = query.order_by(*(each.desc() if newest_first else each for each in columns))
        with self.session() as session:
            rows = session.execute(query.limit(limit))
            return [entry_of(kind, row._mapping, self.root) for row in rows]


def entry_of(kind: type[Entry], columns: Mapping[Any, Any], root: Path = Path()) -> Entry:
    """Return the entry of a row whose columns have the names of its fields.

    Parameters
    ----------
    kind : type
        One of `torquebench.records.registry.entries`.
    columns : mapping
        Where there is no value, the field has its default.
    root : pathlib.Path
        Data directory of the stored paths.
    """
    values = dict(columns)
    if values.get("valid_low_nm") is not None and values["valid_high_nm"] is not None:
        values["valid_nm"] = values["valid_low_nm"], values["valid_high_nm"]
    known = {}
    for field in fields(kind):
        value = values.get(field.name)
        optional = field.default is not MISSING or field.default_factory is not MISSING
        if value is None and optional:
            continue
        if field.type in (Path, Path | None):
            value = root / value if value else None
        known[field.name] = revived(value)
    entry: Entry = kind(**known)
    return entry


@functools.cache
def _view(kind: type) -> tuple[Select[Any], Mapping[str, ColumnElement[Any]]]:
    """Return the query of all entries of a kind, and its columns by the names of the fields."""
    table = TABLES[kind]
    source: FromClause = table
    joined: dict[str, FromClause] = {}

    def row_at(key: str, row: FromClause) -> FromClause:
        nonlocal source
        if key not in joined:
            joined[key] = metadata.tables[POINTS_TO[key]].alias(key)
            source = source.outerjoin(joined[key], joined[key].c.id == row.c[key])
        return joined[key]

    def place(name: str, row: FromClause) -> ColumnElement[Any] | None:
        if name in row.c:
            return row.c[name]
        if name in _NUMBERS:
            return row.c.get(_NUMBERS[name], row.c.id)
        key, column = _REFERENCES.get(name, ("", ""))
        if key in row.c:
            return row_at(key, row).c[column]
        if "calibration_key" in row.c:  # of a model: what its calibration has
            return place(name, row_at("calibration_key", row))
        return None

    names = [field.name for field in fields(kind)]
    if "valid_nm" in names:
        names += ["valid_low_nm", "valid_high_nm"]
    places = {name: column for name in names if (column := place(name, table)) is not None}
    query = select(*(column.label(name) for name, column in places.items()))
    return query.select_from(source), places


def _key(session: Session, entry: Any, column: Column[Any]) -> int | None:
    """Return the number of the row that a key of an entry points to; None for none."""
    key = column.name
    for name, of in _NUMBERS.items():
        if of == key:
            number: int | None = getattr(entry, name)
            return number
    wanted = {place: getattr(entry, name) for name, (of, place) in _REFERENCES.items() if of == key}
    if column.nullable and not any(wanted.values()):
        return None
    table = POINTS_TO[key]
    if table == "runs":
        return int(run_row(session, wanted["run_id"]).id)
    if table == "equipment":
        kind = key.removesuffix("_key")
        if kind == "standard":
            kind = "verification-standard" if isinstance(entry, CheckEntry) else "calibrator"
        return equipment_key(session, **{"kind": kind, **wanted})
    return number_of(session, metadata.tables[table], **wanted)


def number_of(session: Session, table: Table, **wanted: Any) -> int | None:
    """Return the number of the row that has these values; None where there is none."""
    query = select(table.c.id).where(*(table.c[name] == value for name, value in wanted.items()))
    return session.scalar(query)


def equipment_key(session: Session, kind: str, serial: str) -> int:
    """Return the number of a piece of equipment, which is registered if it isn't yet."""
    number = number_of(session, equipment, kind=kind, serial=serial)
    if number is not None:
        return number
    return insert(session, equipment, kind=kind, serial=serial, recorded=datetime.now(UTC))


def run_row(session: Session, run_id: str) -> Row[Any]:
    """Return a run's row.

    Raises
    ------
    RecordError
        Where it isn't registered.
    """
    row = session.execute(select(runs).where(runs.c.run_id == run_id)).one_or_none()
    if row is None:
        raise RecordError(Message("run {run_id} isn't registered", run_id), "a registered run")
    return row


def as_json(value: Any) -> dict[str, Any]:
    """Return a value as the database's JSON columns take it; see `with_messages`."""
    content: dict[str, Any] = json.loads(json_text(with_messages(value)))
    return content
