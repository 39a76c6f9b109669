"""Steps of the migrations: tables, columns, and triggers that make a table append-only.

A migration names tables and columns; `torquebench.records.registry.entries` defines the types. A
test compares the tables with those of 0.2.0.
"""

from collections.abc import Mapping
from typing import Any

from alembic import op
from sqlalchemy import Column, ForeignKey, Index, MetaData, Table

from torquebench.records.registry.entries import metadata


def create_tables(columns: Mapping[str, str]) -> None:
    """Create append-only tables with the named columns, and their indexes."""
    made = MetaData(naming_convention=metadata.naming_convention)
    for name, listed in columns.items():
        table = metadata.tables[name]
        keys = [column.name for column in table.primary_key]
        named = dict.fromkeys([*keys, *listed.split()])
        copy = Table(name, made, *(_copied(table.c[each]) for each in named))
        for index in table.indexes:
            indexed = [column.name for column in index.columns]
            if not table.c[indexed[0]].index and set(indexed) <= set(copy.c.keys()):
                Index(index.name, *(copy.c[each] for each in indexed), unique=index.unique)
    made.create_all(op.get_bind())
    for name in columns:
        forbid_changes(name)


def _copied(column: Column[Any]) -> Column[Any]:
    keys = (ForeignKey(each.target_fullname) for each in column.foreign_keys)
    copy = column._copy()
    for key in keys:
        copy.append_foreign_key(key)
    return copy


def add_columns(column: str, *tables: str) -> None:
    """Add a column to tables; it is empty in existing rows."""
    for table in tables:
        op.add_column(table, _copied(metadata.tables[table].c[column]))


def forbid_changes(table: str) -> None:
    """Create triggers by which the database refuses to change or delete a table's rows."""
    message = f"{table} is append-only: amend the record instead"
    if op.get_bind().dialect.name == "sqlite":
        for event in ("UPDATE", "DELETE"):
            op.execute(
                f"CREATE TRIGGER keep_{table}_{event.lower()} BEFORE {event} ON {table} "
                f"BEGIN SELECT RAISE(ABORT, '{message}'); END"
            )
        return
    op.execute(
        f"CREATE FUNCTION keep_{table}() RETURNS trigger LANGUAGE plpgsql AS "
        f"$$ BEGIN RAISE EXCEPTION '{message}'; END $$"
    )
    op.execute(
        f"CREATE TRIGGER keep_{table} BEFORE UPDATE OR DELETE OR TRUNCATE ON {table} "
        f"FOR EACH STATEMENT EXECUTE FUNCTION keep_{table}()"
    )
