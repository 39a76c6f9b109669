"""The database below the registry: opening it, transactions, and rows found by their names."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from sqlalchemy import URL, create_engine, event, select
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from torquebench.errors import RecordError
from torquebench.records.entries import InstrumentKind
from torquebench.records.files import json_text
from torquebench.records.schema import Base, InstrumentRow, RunRow

__all__ = ["Database", "as_json", "instrument_row", "run_row"]


class Database:
    """An open database with the registry's tables.

    Parameters
    ----------
    url : str or sqlalchemy.URL
        Database URL as SQLAlchemy takes it.
    root : pathlib.Path
        The data directory; paths below it are stored relative to it, so that it can be moved.
    """

    def __init__(self, url: str | URL, root: Path) -> None:
        self.root = root.resolve()
        self._engine = create_engine(url)
        if self._engine.dialect.name == "sqlite":
            event.listen(self._engine, "connect", _set_up_sqlite)
        try:
            Base.metadata.create_all(self._engine)
        except SQLAlchemyError as error:
            self._engine.dispose()
            raise RecordError(
                f"the registry {self._engine.url.render_as_string()} can't be opened: {error}",
                "a database that can be read and written",
            ) from error

    @classmethod
    def open(cls, data_dir: Path) -> Self:
        """Open the registry of a data directory, creating both where they don't exist.

        Raises
        ------
        RecordError
            Where the directory can't be created or the file isn't a registry.
        """
        try:
            data_dir.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise RecordError(
                f"can't create the data directory {data_dir}: {error.strerror}",
                "a folder with write permission",
                "choose another with --data",
            ) from error
        file = data_dir.resolve() / "registry.sqlite"
        return cls(URL.create("sqlite", database=str(file)), data_dir)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close all connections; more calls do nothing."""
        self._engine.dispose()

    @contextmanager
    def session(self) -> Iterator[Session]:
        """Yield a session in one transaction: all of it is kept, or nothing.

        Raises
        ------
        RecordError
            Where the database fails.
        """
        try:
            with Session(self._engine) as session, session.begin():
                yield session
        except SQLAlchemyError as error:
            raise RecordError(
                f"the registry {self._engine.url.render_as_string()} failed: {error}",
                "a database that can be read and written",
            ) from error

    def stored(self, path: Path) -> str:
        """Return a path as it is stored: relative to the data directory where it lies below."""
        resolved = path.resolve()
        inside = resolved.is_relative_to(self.root)
        return (resolved.relative_to(self.root) if inside else resolved).as_posix()


def _set_up_sqlite(connection: Any, _record: object) -> None:
    cursor = connection.cursor()
    # WAL lets readers (the list of runs) work while a run writes; FULL survives a power cut.
    for pragma in ("foreign_keys=ON", "journal_mode=WAL", "synchronous=FULL", "busy_timeout=5000"):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def instrument_row(session: Session, kind: InstrumentKind, serial: str) -> InstrumentRow:
    """Return an instrument's row, a new one where it isn't registered yet."""
    query = select(InstrumentRow).where(InstrumentRow.kind == kind, InstrumentRow.serial == serial)
    row = session.scalar(query)
    if row is None:
        row = InstrumentRow(kind=kind, serial=serial, recorded=datetime.now(UTC))
        session.add(row)
        session.flush()
    return row


def run_row(session: Session, run_id: str) -> RunRow:
    """Return a run's row.

    Raises
    ------
    RecordError
        Where it isn't registered.
    """
    row = session.scalar(select(RunRow).where(RunRow.run_id == run_id))
    if row is None:
        raise RecordError(f"run {run_id} isn't registered", "a registered run")
    return row


def as_json(value: Any) -> dict[str, Any]:
    """Return a value as the database's JSON columns take it; see `json_text`."""
    content: dict[str, Any] = json.loads(json_text(value))
    return content
