"""The database below the registry: connection, append-only transactions, entries."""

import contextlib
import importlib
import os
import sqlite3
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self, TypeVar

from sqlalchemy import (
    URL,
    Column,
    Connection,
    Engine,
    NullPool,
    Select,
    Table,
    TypeDecorator,
    create_engine,
    event,
    inspect,
    make_url,
    select,
    text,
)
from sqlalchemy.engine import ExceptionContext
from sqlalchemy.engine.interfaces import DBAPIConnection
from sqlalchemy.exc import (
    ArgumentError,
    DBAPIError,
    InterfaceError,
    OperationalError,
    SQLAlchemyError,
)
from sqlalchemy.orm import Session, object_session

from torquebench.atomic_write import create_private, private_folder
from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records.chain import START, ChainHead, Link, canonical, seal
from torquebench.records.files import UNREADABLE
from torquebench.records.read_only import is_writable, sqlite_reader
from torquebench.records.registry.entries import Entry, Identity, Registered, completed, links
from torquebench.records.registry.migrating import upgrade

REGISTRY_FILE = "registry.sqlite"
WAY_BACK = "`torquebench records restore BACKUP`, or without a backup `torquebench records rebuild`"
"""Remedy for a lost or damaged registry."""
REGISTRY_URL = "TORQUEBENCH_REGISTRY"
"""Environment variable with the URL of a registry on a server."""
SERVER_TIMEOUT_S = 10.0
"""How long to wait for a server's answer, s."""
PATIENCE_S = 30.0
"""How long `Database.patiently` retries, s."""
RETRY_S = 0.25
DISCONNECTING = ("08", "57P")
"""SQLSTATEs of a lost connection: PostgreSQL 18, appendix A."""
PASSING = (*DISCONNECTING, "40", "53", "55P03", "57")
"""SQLSTATEs of temporary failures: deadlocks, no space, a server that is starting."""
_REMEDIES = {
    "28": "check user and password in the URL",
    "3D000": "check the database's name in the URL, or create the database",
    "42501": "use the URL of a role that may do this, such as the administrator's",
    "42710": "choose another name",
}
"""Remedies by the beginning of the SQLSTATE."""

Result = TypeVar("Result")


class UnavailableError(RecordError):
    """The registry's database can't be used at the moment; its content is unchanged."""


def lost_registry(data_dir: Path) -> str:
    """Return a message if a data directory has runs but its registry is missing or empty, else "".

    A new registry must not be created there by accident.
    """
    file, runs = data_dir / REGISTRY_FILE, data_dir / "runs"
    if file.exists() and file.stat().st_size:
        return ""
    count = sum(path.is_dir() for path in runs.iterdir()) if runs.is_dir() else 0
    if not count:
        return ""
    state = "is empty" if file.exists() else "is missing"
    return Message(
        "{state} beside {count} run folder{value}", state, count, "s" if count > 1 else ""
    )


class Database:
    """An open database with the registry's tables, which only grows.

    Every row that a transaction adds gets its link of the hash chain in the same transaction.

    Parameters
    ----------
    url : str or sqlalchemy.URL
        Database URL as SQLAlchemy takes it: ``sqlite:///…`` or ``postgresql://…``.
    root : pathlib.Path
        The data directory. In SQLite, paths below it are stored relative to it, so that it can
        be moved; a server, which several benches share, gets whole paths.

    Attributes
    ----------
    known_head : ChainHead
        The last end of the chain that this process has read; also available while the database
        doesn't answer.

    Raises
    ------
    InputError
        Where the URL is invalid, or its database needs a driver that isn't installed.
    RecordError
        Where the database can't be opened, or a newer version of torquebench has made it.
    """

    def __init__(self, url: str | URL, root: Path) -> None:
        self.root = root.resolve()
        self._open = threading.local()
        self._closing = contextlib.ExitStack()
        self._url = url_with_driver(url)
        self._sqlite = self._url.drivername == "sqlite"
        file = Path(self._url.database or "")
        self.read_only = self._sqlite and file.is_file() and not is_writable(file)
        if self.read_only:
            self._engine = _reading_engine(self._closing.enter_context(sqlite_reader(file)))
        else:
            self._engine = engine_of(self._url)
        self.known_head = ChainHead(0, START)
        try:
            upgrade(self._engine, read_only=self.read_only)
        except SQLAlchemyError as error:
            self.close()
            raise _kind_of(error)(
                Message("the registry {name} can't be opened: {error}", self.name, _cause(error)),
                "a database that can be read and written",
                "make room on its disk, or check whether it runs and can be written",
            ) from error
        except RecordError:
            self.close()
            raise

    @classmethod
    def open(cls, data_dir: Path, url: str | None = None, *, longest_s: float = 0.0) -> Self:
        """Open the registry of a data directory; create directory and registry if they don't exist.

        Parameters
        ----------
        data_dir : pathlib.Path
            Folder of runs and model files.
        url : str, optional
            A database elsewhere, such as ``postgresql://user@server/torquebench``. By default
            ``$TORQUEBENCH_REGISTRY``, or a SQLite file in the data directory.
        longest_s : float
            How long to retry if the database server doesn't answer, s.

        Raises
        ------
        RecordError
            Where the directory can't be created or the database isn't a registry.
        """
        try:
            private_folder(data_dir)
        except OSError as error:
            raise RecordError(
                Message(
                    "can't create the data directory {folder}: {strerror}", data_dir, error.strerror
                ),
                "a folder with write permission",
                "choose another with --data",
            ) from error
        given = url or os.environ.get(REGISTRY_URL)
        file = data_dir.resolve() / REGISTRY_FILE
        lost = "" if given else lost_registry(data_dir)
        if lost:
            raise RecordError(
                Message("the registry {file} {lost}", file, lost),
                "a registry that lists these runs",
                WAY_BACK,
            )
        waits_s = longest_s if given else 0.0
        address = given or URL.create("sqlite", database=str(file))
        deadline = time.monotonic() + waits_s
        while True:
            try:
                return cls(address, data_dir)
            except UnavailableError as error:
                if time.monotonic() < deadline:
                    time.sleep(RETRY_S)
                    continue
                if not waits_s:
                    raise
                found = Message("{found}; it was tried for {waits_s:g} s", error.found, waits_s)
                raise UnavailableError(found, error.allowed, error.remedy) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    @property
    def name(self) -> str:
        """URL of the database without its password."""
        return self._url.render_as_string()

    @property
    def dialect(self) -> str:
        """``"sqlite"`` or ``"postgresql"``."""
        return self._engine.dialect.name

    def close(self) -> None:
        """Close all connections; further calls do nothing."""
        self._engine.dispose()
        self._closing.close()

    @contextmanager
    def session(self) -> Iterator[Session]:
        """Yield a session that sees one consistent state of the registry.

        Within `writing` of the same thread it is that transaction's session and sees the rows it
        added.

        Raises
        ------
        RecordError
            Where the database fails.
        """
        outer: Session | None = getattr(self._open, "session", None)
        if outer is not None:
            yield outer
            return
        with self._session() as session:
            yield session

    @contextmanager
    def writing(self) -> Iterator[Session]:
        """Yield a session in a transaction that is stored and chained completely or not at all.

        Transactions run one after the other, so that the chain has one end. A nested call in the
        same thread joins the outer transaction, so that related entries are stored together.

        Raises
        ------
        RecordError
            Where the database fails; it refuses changes of rows.
        """
        outer: Session | None = getattr(self._open, "session", None)
        if outer is not None:
            yield outer
            return
        if self.read_only:
            raise RecordError(
                Message("{name} can only be read", self.name),
                "a data directory with write permission",
                "copy it, with its runs, to a folder with write permission",
            )
        with self._session(writes=True) as session:
            if not self._sqlite:
                session.execute(text("LOCK TABLE chain IN SHARE ROW EXCLUSIVE MODE"))
            self._open.session = session
            try:
                yield session
                head = _append_links(session)
            finally:
                self._open.session = None
        self.known_head = head

    @contextmanager
    def _session(self, *, writes: bool = False) -> Iterator[Session]:
        engine = self._engine.execution_options(writes=writes)
        with (
            database_failures(Message("the registry {name}", self.name)),
            Session(engine) as session,
            session.begin(),
        ):
            yield session

    def execute(self, *statements: str) -> None:
        """Run SQL statements on the schema in one transaction, without adding records."""
        with self._session(writes=True) as session:
            for statement in statements:
                session.execute(text(statement))

    def patiently(
        self,
        action: Callable[[], Result],
        *,
        told: Callable[[str], None] | None = None,
    ) -> Result:
        """Run an operation on the registry; retry while its server doesn't answer.

        A registry in a file gets one attempt, since retrying doesn't mend a file.

        Parameters
        ----------
        action : callable
            The operation, made of whole transactions, so that it can be repeated.
        told : callable, optional
            Called with the problem before the first retry.

        Raises
        ------
        UnavailableError
            The server is still unavailable.
        """
        deadline = time.monotonic() + (0.0 if self._sqlite else PATIENCE_S)
        while True:
            try:
                return action()
            except UnavailableError as error:
                if time.monotonic() >= deadline:
                    raise
                if told is not None:
                    told(error.found)
                    told = None
                time.sleep(RETRY_S)

    def head(self) -> ChainHead:
        """Return the end of the chain, whose hash covers every record so far."""
        with self.session() as session:
            self.known_head = _head(session)
        return self.known_head

    def stored(self, path: Path) -> str:
        """Return a path as the registry stores it; see the parameter `root`."""
        resolved = path.resolve()
        inside = self._sqlite and resolved.is_relative_to(self.root)
        return (resolved.relative_to(self.root) if inside else resolved).as_posix()

    # -- entries --------------------------------------------------------------------------------

    def add(self, entry: Registered) -> int:
        """Append an entry, and equipment that it names and that is new; return the entry's number.

        Raises
        ------
        RecordError
            Where the entry's run isn't registered.
        """
        table = type(entry).__table__
        assert isinstance(table, Table)
        with self.writing() as session:
            content = self._columns(session, entry)
            appended = session.execute(table.insert().returning(table.c.id), content)
            number: int = appended.scalar_one()
            bound = {name: _bound(table.c[name], value, session) for name, value in content.items()}
            session.info.setdefault("added", []).append((table.name, {"id": number, **bound}))
            return number

    def _columns(self, session: Session, entry: Registered) -> dict[str, Any]:
        """Return the columns of an entry's row, without its number."""
        values: dict[str, Any] = {}
        for attribute in inspect(type(entry)).column_attrs:
            column = attribute.columns[0]
            if not isinstance(column, Column) or column.primary_key:
                continue
            value = getattr(entry, attribute.key)
            if attribute.key == column.name and column.foreign_keys:
                value = self._row_of(session, entry, column) if value is None else value
            elif column.name == "recorded":
                value = datetime.now(UTC)
            elif isinstance(value, Path):
                value = self.stored(value)
            elif value is None and not column.nullable:
                value = ""  # no path
            values[column.name] = value
        return values

    def _row_of(self, session: Session, entry: Registered, column: Column[Any]) -> int | None:
        """Return the number of the row that an entry's key refers to; None without one."""
        wanted, kind = {}, ""
        for each in fields(entry):
            key, attribute = each.metadata.get("through", ("", ""))
            if key == column.name:
                wanted[attribute.partition(".")[2]] = getattr(entry, each.name)
                kind = each.metadata.get("kind", "")
        if column.nullable and not any(wanted.values()):
            return None
        (foreign,) = column.foreign_keys
        target = foreign.column.table
        if target.name == "equipment":
            return self.equipment_key(**{"kind": kind, **wanted})
        query = select(target.c.id)
        for name, value in wanted.items():
            query = query.where(target.c[name] == value)
        number = session.scalar(query)
        if number is None and target.name == "runs":
            raise RecordError(
                Message("run {run_id} isn't registered", wanted["run_id"]), "a registered run"
            )
        return number

    def equipment_key(self, kind: Any, serial: str) -> int:
        """Return the number of a piece of equipment; register it if it is new."""
        known = self.entries(Identity, kind=kind, serial=serial)
        return known[0].number if known else self.add(Identity(kind, serial))

    def entries(
        self,
        kind: type[Entry],
        /,
        *conditions: Any,
        order: tuple[str, ...] = ("id",),
        newest_first: bool = False,
        limit: int | None = None,
        offset: int = 0,
        problems: list[str] | None = None,
        **wanted: Any,
    ) -> list[Entry]:
        """Return the entries of a kind, one of `torquebench.records.registry.entries`.

        Parameters
        ----------
        *conditions
            SQLAlchemy conditions on the kind's attributes.
        order : tuple of str
            Columns to sort by.
        newest_first : bool
            Whether to sort in descending order.
        limit, offset : int, optional
            How many entries to return, and how many to skip.
        problems : list of str, optional
            Receives a message for each entry that can't be read; such entries are then skipped.
        **wanted
            Required values of fields; None means any value.

        Raises
        ------
        RecordError
            Where the database fails, or an entry can't be read.
        """
        query = entries_query(kind, *conditions, order=order, newest_first=newest_first, **wanted)
        query = query.limit(limit).offset(offset or None)
        with self.session() as session:
            try:
                return [self.complete(entry) for entry in session.scalars(query)]
            except (*UNREADABLE, DBAPIError) as error:
                if problems is None and isinstance(error, DBAPIError):
                    raise
                numbers = session.scalars(query.with_only_columns(kind.__table__.c.id)).all()
        unreadable: list[str] = []
        entries = self._readable(kind, numbers, unreadable)
        if problems is None and unreadable:
            raise RecordError(unreadable[0], "an entry as it was stored", WAY_BACK)
        if problems is not None:
            problems += unreadable
        return entries

    def _readable(
        self, kind: type[Entry], numbers: Sequence[int], problems: list[str]
    ) -> list[Entry]:
        """Read entries one by one by their numbers; skip those that can't be read."""
        found = []
        for number in numbers:
            query = select(kind).where(kind.__table__.c.id == number)
            try:
                with self.session() as session:
                    found += [self.complete(entry) for entry in session.scalars(query)]
            except (RecordError, *UNREADABLE) as error:
                problem = getattr(error, "found", error)
                name = kind.__tablename__
                problems.append(Message("{name} {number}: {problem}", name, number, problem))
        return found

    def complete(self, entry: Entry) -> Entry:
        """Detach an entry from its session and complete it; see `completed`."""
        session = object_session(entry)
        if session is not None:
            session.expunge(entry)
        return completed(entry, self.root)

    def links(self, after: int = 0, limit: int | None = None) -> list[Link]:
        """Return the links of the chain that follow the link with a number."""
        query = select(links).where(links.c.sequence > after).order_by(links.c.sequence)
        with self.session() as session:
            return [Link(**row._mapping) for row in session.execute(query.limit(limit))]


def entries_query(
    kind: type[Entry],
    /,
    *conditions: Any,
    order: tuple[str, ...] = ("id",),
    newest_first: bool = False,
    **wanted: Any,
) -> Select[Any]:
    """Return the query of `Database.entries`, without limit and offset."""
    equal = (getattr(kind, name) == value for name, value in wanted.items() if value is not None)
    columns = [kind.__table__.c[name] for name in order]
    return (
        select(kind)
        .where(*conditions, *equal)
        .order_by(*(each.desc() if newest_first else each for each in columns))
    )


def _bound(column: Column[Any], value: Any, session: Session) -> Any:
    """Convert a value to the form that is stored and hashed."""
    if isinstance(column.type, TypeDecorator):
        return column.type.process_bind_param(value, session.get_bind().dialect)
    return value


@contextmanager
def database_failures(what: str) -> Iterator[None]:
    """Convert exceptions of the database into a `RecordError` that names the cause.

    Raises
    ------
    UnavailableError
        Where the failure may be temporary.
    RecordError
        For every other failure.
    """
    try:
        yield
    except (SQLAlchemyError, ConnectionError) as error:
        raise _kind_of(error)(
            Message("{name} failed: {said}", what, _cause(error)),
            "a database that can be read and written",
            _remedy(error),
        ) from error


def _head(session: Session) -> ChainHead:
    query = select(links.c.sequence, links.c.sha256).order_by(links.c.sequence.desc()).limit(1)
    last = session.execute(query).one_or_none()
    return ChainHead(0, START) if last is None else ChainHead(last.sequence, last.sha256)


def _append_links(session: Session) -> ChainHead:
    head, now, appended = _head(session), datetime.now(UTC), []
    for table, content in session.info.pop("added", []):
        link = seal(head, table, content["id"], now, canonical(content))
        appended.append(vars(link))
        head = ChainHead(link.sequence, link.sha256)
    if appended:
        session.execute(links.insert(), appended)
    return head


def url_with_driver(url: str | URL) -> URL:
    """Parse a registry's URL and add the database driver.

    Raises
    ------
    InputError
        Where the URL is invalid, or its driver isn't installed.
    """
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise InputError(
            Message("registry URL {url!r}", str(url)),
            "sqlite:///path/registry.sqlite or postgresql://user@server/database",
        ) from error
    if parsed.drivername == "postgresql":
        parsed = parsed.set(drivername="postgresql+pg8000")
    if parsed.drivername not in ("sqlite", "postgresql+pg8000"):
        raise InputError(
            Message("a registry in {drivername}", parsed.drivername), "sqlite or postgresql"
        )
    if parsed.drivername == "postgresql+pg8000":
        try:
            importlib.import_module("pg8000")
        except ImportError as error:
            raise InputError(
                "a registry in PostgreSQL without its driver",
                "pg8000",
                "pip install 'torquebench[postgresql]'",
            ) from error
    return parsed


def _reading_engine(address: str) -> Engine:
    """Return an engine that opens a file read-only."""

    def connect() -> sqlite3.Connection:
        return sqlite3.connect(address, uri=True, check_same_thread=False)

    return create_engine("sqlite://", creator=connect, poolclass=NullPool)


def engine_of(url: URL) -> Engine:
    """Return an engine that tests its connections before it reuses them."""
    if url.drivername == "sqlite":
        if url.database:
            with contextlib.suppress(OSError):  # SQLite itself reports a file that can't be created
                create_private(Path(url.database)).close()
        engine = create_engine(url)
        event.listen(engine, "connect", _set_up_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
        return engine
    engine = create_engine(url, pool_pre_ping=True, connect_args={"timeout": SERVER_TIMEOUT_S})
    event.listen(engine, "handle_error", _note_disconnect)
    close = engine.dialect.do_close

    def close_quietly(dbapi_connection: DBAPIConnection) -> None:
        with contextlib.suppress(engine.dialect.loaded_dbapi.Error):  # the server was first
            close(dbapi_connection)

    # The pool closes connections through the dialect, which emits no event for that.
    engine.dialect.do_close = close_quietly  # type: ignore[method-assign]
    return engine


def _note_disconnect(context: ExceptionContext) -> None:
    # A server that shuts down sends a code that SQLAlchemy's dialect doesn't check; a server that
    # vanishes during a query causes an error of the socket.
    error = context.original_exception
    if isinstance(error, ConnectionError) or _code(error).startswith(DISCONNECTING):
        context.is_disconnect = True


def _code(error: BaseException | None) -> str:
    """Return the SQLSTATE of a PostgreSQL error; empty without one."""
    fields = error.args[0] if error is not None and error.args else None
    return str(fields.get("C", "")) if isinstance(fields, dict) else ""


def _kind_of(error: SQLAlchemyError | ConnectionError) -> type[RecordError]:
    """Return the class of torquebench error for an error of the database."""
    if isinstance(error, OperationalError | InterfaceError | ConnectionError) or (
        isinstance(error, DBAPIError)
        and (error.connection_invalidated or _code(error.orig).startswith(PASSING))
    ):
        return UnavailableError
    return RecordError


def _remedy(error: SQLAlchemyError | ConnectionError) -> str:
    original = getattr(error, "orig", None) or error
    code = _code(original)
    known = next((said for start, said in _REMEDIES.items() if code.startswith(start)), "")
    if known:
        return known
    # A server that refuses a role may close the connection before its reason is read.
    if isinstance(original, ConnectionError) or isinstance(original.__cause__, OSError):
        return (
            "check whether the server runs, and check user and password in the URL; its "
            "data are kept"
        )
    return "make room on its disk, or check whether it runs; its data are unchanged"


def _cause(error: SQLAlchemyError | ConnectionError) -> str:
    """Return the database's message without the SQL statement and its parameters."""
    said = getattr(error, "orig", None)
    if said is None:
        return str(error)
    fields = said.args[0] if said.args else ""
    if isinstance(fields, dict) and "M" in fields:
        return str(fields["M"])
    reason = said.__cause__  # the reason why a server can't be reached
    return str(said) if reason is None else f"{said} ({getattr(reason, 'strerror', '') or reason})"


def _set_up_sqlite(connection: Any, _record: object) -> None:
    connection.isolation_level = None  # transactions begin in `_begin_sqlite`
    cursor = connection.cursor()
    # WAL lets readers (the list of runs) work while a run writes; FULL survives a power cut.
    for pragma in ("busy_timeout=5000", "foreign_keys=ON", "journal_mode=WAL", "synchronous=FULL"):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _begin_sqlite(connection: Connection) -> None:
    # A transaction that begins by reading fails when it writes after another has extended the
    # chain.
    writes = connection.get_execution_options().get("writes", True)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
