"""The panel's database of people, sessions, clients, actions and changes of settings.

It is separate from the registry, because accounts are changed and sessions deleted, which the
registry's append-only tables forbid, and because several benches may share a registry.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from sqlalchemy import (
    Boolean,
    Column,
    Connection,
    Dialect,
    Float,
    Integer,
    Table,
    Text,
    TypeDecorator,
    insert,
    select,
    update,
)
from sqlalchemy.dialects.sqlite import insert as sqlite_insert
from sqlalchemy.engine import URL

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records import json_text
from torquebench.records.accounts import PANEL_FILE, metadata, name_key, users
from torquebench.records.registry.database import database_failures, engine_of

SCHEMA_VERSION = 5


class MessageText(TypeDecorator[str]):
    """Text that keeps the template and values of a message, for its translation."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, _dialect: Dialect) -> str | None:
        """Store a message as JSON, other text as it is."""
        return json_text(value.as_plain()) if isinstance(value, Message) else value

    def process_result_value(self, value: str | None, _dialect: Dialect) -> str | None:
        """Return the message, or the text."""
        is_message = value is not None and value.startswith('{"template":')
        return Message.restored(json.loads(value)) if value and is_message else value


def _table(name: str, texts: str, *others: Column[Any], key: str = "") -> Table:
    """Define a table with columns of required texts and other columns.

    `key` names the text columns of the primary key; without it, rows are numbered.
    """
    numbers = () if key else (Column("id", Integer, primary_key=True),)
    columns = (
        Column(text, Text, primary_key=text in key.split(), nullable=False)
        for text in texts.split()
    )
    return Table(name, metadata, *numbers, *columns, *others)


sessions = _table(
    "sessions",
    "token_sha256 address",
    Column("user_id", Integer, nullable=False),
    Column("created", Float, nullable=False),
    Column("seen", Float, nullable=False),
    key="token_sha256",
)
clients = _table(
    "clients",
    "name role created created_by",
    Column("token_sha256", Text, nullable=False, unique=True),
    Column("revoked", Text),
)
failures = _table(
    "failures",
    "",
    Column("subject", Text, nullable=False, index=True),
    Column("at", Float, nullable=False),
)
events = _table("events", "at who details", Column("what", MessageText, nullable=False))
preferences = _table("preferences", "who name value", key="who name")
job_log = _table(
    "job_log",
    "job_id kind state verdict started",
    Column("who", Text, nullable=False, index=True),
    Column("title", MessageText, nullable=False),
    Column("headline", MessageText, nullable=False),
    Column("told", Boolean, nullable=False),
    key="job_id",
)
results = _table("results", "job_id view", key="job_id")
queue = _table(
    "queue",
    "kind request who state verdict added job_id",
    Column("position", Integer, nullable=False),
    Column("title", MessageText, nullable=False),
    Column("headline", MessageText, nullable=False),
    Column("finished", Text),
)
changes = _table("changes", "at who section name reason before after", Column("undoes", Integer))


@dataclass(frozen=True)
class Event:
    """A logged action.

    Parameters
    ----------
    number : int
    at : datetime.datetime
        UTC.
    who, what : str
    details : mapping
    """

    number: int
    at: datetime
    who: str
    what: str
    details: Mapping[str, Any]


class PanelStore:
    """The open database of a data directory; safe to use from any thread.

    Parameters
    ----------
    data_dir : pathlib.Path
        Data directory, which must exist.

    Raises
    ------
    RecordError
        The database can't be opened, or a newer version has made it.
    """

    def __init__(self, data_dir: Path) -> None:
        path = data_dir / PANEL_FILE
        self._engine = engine_of(URL.create("sqlite", database=str(path)))
        self._name = path.name
        try:
            self._upgrade()
        except BaseException:
            self.close()
            raise

    def _upgrade(self) -> None:
        with self.transaction() as connection:
            found = int(connection.exec_driver_sql("PRAGMA user_version").scalar() or 0)
            if found > SCHEMA_VERSION:
                raise RecordError(
                    Message("{name} has version {found}", self._name, found),
                    Message("{schema_version} or older", SCHEMA_VERSION),
                    "it was made by a newer torquebench: upgrade this one",
                )
            if found < SCHEMA_VERSION:
                metadata.create_all(connection)
                for row in connection.execute(select(users)).all():  # other keys before 0.3.0
                    connection.execute(
                        update(users).where(users.c.id == row.id).values(key=name_key(row.name))
                    )
                connection.exec_driver_sql(f"PRAGMA user_version={SCHEMA_VERSION}")

    def close(self) -> None:
        """Close all connections; further calls do nothing."""
        self._engine.dispose()

    @contextlib.contextmanager
    def transaction(self, *, reading: bool = False) -> Iterator[Connection]:
        """Yield a connection in one transaction, which is stored completely or not at all.

        Parameters
        ----------
        reading : bool
            Whether it only reads, which doesn't wait for writers.

        Raises
        ------
        RecordError
            The database fails.
        """
        engine = self._engine.execution_options(writes=not reading)
        with database_failures(self._name), engine.begin() as connection:
            yield connection

    # -- actions ----------------------------------------------------------------------------

    def note(self, who: str, what: str, **details: Any) -> None:
        """Log an action."""
        with self.transaction() as connection:
            note(connection, who, what, **details)

    def events(self, limit: int = 100, before: int | None = None) -> list[Event]:
        """Return the log of actions, the newest first; `before` is an event's number."""
        query = select(events).order_by(events.c.id.desc()).limit(limit)
        if before is not None:
            query = query.where(events.c.id < before)
        with self.transaction(reading=True) as connection:
            return [
                Event(
                    row.id,
                    datetime.fromisoformat(row.at),
                    row.who,
                    row.what,
                    json.loads(row.details),
                )
                for row in connection.execute(query)
            ]

    # -- preferences ------------------------------------------------------------------------

    def preference(self, who: str, name: str) -> Any:
        """Return a person's preference; None without one."""
        query = select(preferences.c.value).where(
            preferences.c.who == who, preferences.c.name == name
        )
        with self.transaction(reading=True) as connection:
            kept = connection.execute(query).scalar()
        return None if kept is None else json.loads(kept)

    def keep_preference(self, who: str, name: str, value: Any) -> None:
        """Store a person's preference, replacing the earlier one."""
        text = json_text(value)
        kept = sqlite_insert(preferences).values(who=who, name=name, value=text)
        with self.transaction() as connection:
            connection.execute(
                kept.on_conflict_do_update(index_elements=["who", "name"], set_={"value": text})
            )


def note(connection: Connection, who: str, what: str, **details: Any) -> None:
    """Log an action in an open transaction."""
    connection.execute(
        insert(events).values(at=utc_text(), who=who, what=what, details=json_text(details))
    )


def utc_text() -> str:
    """Return the present time in UTC as stored text: ISO 8601 with milliseconds."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
