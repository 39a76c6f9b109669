"""Check the integrity of a registry's database: pages, indexes, tables, triggers."""

import functools
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from sqlalchemy import Connection, StaticPool, create_engine, inspect, text

from torquebench.records.integrity import Finding
from torquebench.records.read_only import sqlite_reader
from torquebench.records.registry.database import WAY_BACK, Database
from torquebench.records.registry.entries import metadata
from torquebench.records.registry.migrating import upgrade
from torquebench.records.registry.schema_version import VERSIONS_TABLE

_OF_AN_INDEX = ("missing from index", "entries in index", "non-unique entry in index")


def damage_of_file(file: Path) -> tuple[str, ...]:
    """Return the defects that SQLite finds in a file's pages, indexes and references.

    Parameters
    ----------
    file : pathlib.Path
        An existing database; it may be in use.
    """
    try:
        with sqlite_reader(file) as address, closing(_connected(address)) as connection:
            said = [row[0] for row in connection.execute("PRAGMA integrity_check(20)")]
            found = [] if said == ["ok"] else said
            for table, row, other, _ in connection.execute("PRAGMA foreign_key_check"):
                found.append(f"{table} {row} points to a row of {other} that doesn't exist")
    except sqlite3.DatabaseError as error:
        return (str(error),)
    return tuple(dict.fromkeys(line for each in found for line in each.splitlines()))


def index_damage_only(damage: tuple[str, ...]) -> bool:
    """Return whether only indexes are damaged; they can be rebuilt from the rows.

    Examples
    --------
    >>> index_damage_only(("row 3 missing from index ix_runs_started",))
    True
    """
    return bool(damage) and all(any(mark in line for mark in _OF_AN_INDEX) for line in damage)


def _connected(address: str) -> sqlite3.Connection:
    return sqlite3.connect(address, uri=True, timeout=5.0)


def schema_changes(registry: Database) -> Iterator[Finding]:
    """Yield tables, indexes and triggers that differ from those that this version creates."""
    present, expected = _schema(registry), _expected_schema(registry.dialect)
    for key in sorted(expected.keys() | present.keys()):
        if present.get(key) == expected.get(key):
            continue
        what = "differs from what was made"
        if key not in present:
            what = "is missing"
        elif key not in expected:
            what = "doesn't belong to the registry"
        kind, name = key
        yield Finding("schema", f"{kind} {name}", found=what, remedy=WAY_BACK)


def mend_schema(registry: Database) -> list[str]:
    """Recreate missing or changed indexes and triggers of a SQLite registry.

    Returns
    -------
    list of str
        Recreated indexes and triggers.
    """
    present, expected = _schema(registry), _expected_schema(registry.dialect)
    mended = []
    for (kind, name), sql in sorted(expected.items()):
        if kind in ("index", "trigger") and present.get((kind, name)) != sql:
            registry.execute(f"DROP {kind} IF EXISTS {name}", sql)
            mended.append(f"{kind} {name}")
    return mended


Schema = dict[tuple[str, str], str]


def _schema(registry: Database) -> Schema:
    with registry.session() as session:
        connection = session.connection()
        if registry.dialect == "sqlite":
            return _sqlite_schema(connection)
        return _server_schema(connection)


def _sqlite_schema(connection: Connection) -> Schema:
    query = text("SELECT type, name, sql FROM sqlite_master WHERE sql IS NOT NULL")
    rows = connection.execute(query)
    return {(kind, name): " ".join(sql.split()) for kind, name, sql in rows}


@functools.cache
def _expected_schema(dialect: str) -> Schema:
    if dialect == "sqlite":
        engine = create_engine("sqlite://", poolclass=StaticPool)
        upgrade(engine)
        with engine.connect() as connection:
            found = _sqlite_schema(connection)
        engine.dispose()
        return found
    expected: Schema = {("table", VERSIONS_TABLE): "version_num"}
    for table in metadata.sorted_tables:
        expected["table", table.name] = ", ".join(sorted(column.name for column in table.columns))
        expected["trigger", f"keep_{table.name}"] = "enabled"
        for index in table.indexes:
            expected["index", str(index.name)] = table.name
    return expected


def _server_schema(connection: Connection) -> Schema:
    inspector = inspect(connection)
    found: Schema = {}
    for table in inspector.get_table_names():
        columns = sorted(column["name"] for column in inspector.get_columns(table))
        found["table", table] = ", ".join(columns)
        for index in inspector.get_indexes(table):
            if not index.get("duplicates_constraint"):
                found["index", str(index["name"])] = table
    triggers = text("SELECT tgname, tgenabled FROM pg_trigger WHERE NOT tgisinternal")
    for name, enabled in connection.execute(triggers):
        on = enabled in ("O", "A", b"O", b"A")
        found["trigger", name] = "enabled" if on else "disabled"
    return found
