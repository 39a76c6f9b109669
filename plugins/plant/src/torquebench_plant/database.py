"""The plant's registry on a PostgreSQL server: creation, connection, queries."""

from __future__ import annotations

import contextlib
import secrets
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from datetime import UTC, datetime
from typing import Any, Self

from sqlalchemy import Connection, bindparam, func, insert, inspect, select, text, update
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import SQLAlchemyError

from torquebench.errors import InputError, RecordError
from torquebench.message import Message
from torquebench.records import ChainHead, Link, broken_links
from torquebench.records.registry import database_failures, engine_of, url_with_driver
from torquebench_plant.folders import FolderStore
from torquebench_plant.schema import (
    BENCH_FUNCTIONS,
    PLANT_SCHEMA,
    PLANT_VERSION,
    benches,
    folders,
    links,
    plant_metadata,
    runs,
    settings,
    statements,
)

CHUNK = 5000
CLOCK_WARNED_S, CLOCK_REFUSED_S = 120.0, 86_400.0
"""Differences between the clocks of bench and plant that cause a warning and a refusal, s."""
CONNECTIONS = 20
"""Largest number of connections of one role."""
_OPEN_RIGHTS = """
SELECT format('REVOKE TEMPORARY ON DATABASE %I FROM PUBLIC', datname) FROM pg_database
  WHERE datname = current_database() AND has_database_privilege('public', oid, 'TEMP')
UNION ALL SELECT 'REVOKE CREATE ON SCHEMA public FROM PUBLIC' FROM pg_namespace
  WHERE nspname = 'public' AND has_schema_privilege('public', oid, 'CREATE')
UNION ALL SELECT format('REVOKE EXECUTE ON FUNCTION %s FROM PUBLIC', oid::regprocedure)
  FROM pg_proc WHERE pronamespace = 'pg_catalog'::regnamespace
  AND proname IN ('lo_creat', 'lo_create', 'lo_from_bytea', 'lo_import')
  AND has_function_privilege('public', oid, 'EXECUTE')
"""


@dataclass(frozen=True)
class BenchState:
    """One bench in the plant's registry.

    Parameters
    ----------
    number : int
        Its number in the plant: benches may have the same name.
    name, place : str
        Name and location that were registered.
    head : ChainHead
        End of its chain in the plant.
    ahead_s : float
        How far the newest entry's time is ahead of the plant's clock, s; 0 if it isn't.
    last_contact : datetime or None
        When the bench last sent entries or folders.
    runs, folders : int
        Numbers of known runs and of sealed folders that have arrived.
    replaced_by : int or None
        Number of the bench that replaced it.
    """

    number: int
    name: str
    place: str
    registered: datetime
    head: ChainHead
    last_contact: datetime | None
    runs: int
    folders: int
    replaced_by: int | None = None
    ahead_s: float = 0.0

    @property
    def title(self) -> str:
        """Return number and name, so that benches with the same name are distinguished."""
        return f"{self.number} {self.name}"


@dataclass(frozen=True)
class PlantRun:
    """One line of the plant's list of runs; the fields are those of `records.RunSummary`.

    Parameters
    ----------
    bench : str
        Number and name of the bench.
    specimen_type, serial, batch : str
        Data of the tested reducer; empty for other runs and until the folder has arrived.
    withdrawn : datetime or None
        When the run was withdrawn; None if it wasn't.
    url : str
        URL of the run's folder; empty until the folder has arrived.
    """

    bench_key: int
    bench: str
    run_id: str
    kind: str
    started: datetime
    status: str
    simulated: bool
    operator: str
    software_version: str
    specimen_type: str
    serial: str
    batch: str
    withdrawn: datetime | None
    withdrawn_by: str
    withdrawn_reason: str
    url: str
    points_url: str


class PlantDatabase:
    """A connection to a plant's registry.

    Parameters
    ----------
    url : str or sqlalchemy.URL
        ``postgresql://user:password@server/database``.

    Raises
    ------
    InputError
        The URL names no PostgreSQL, or its driver isn't installed.
    UnavailableError
        The server doesn't answer.
    """

    def __init__(self, url: str | URL) -> None:
        parsed = url_with_driver(url)
        if parsed.drivername == "sqlite":
            raise InputError(
                Message("a plant's registry in {parsed}", parsed.render_as_string()),
                "postgresql://user:password@server/database",
                "a plant's registry is shared by many benches and needs a server",
            )
        self.url = parsed
        self._engine = engine_of(parsed)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    @property
    def name(self) -> str:
        """Return the URL without the password."""
        return self.url.render_as_string()

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    @contextmanager
    def transaction(self) -> Iterator[Connection]:
        """Yield a connection in one transaction.

        Raises
        ------
        RecordError
            The database fails or refuses a statement; nothing is stored then.
        """
        with (
            database_failures(Message("the plant's registry {name}", self.name)),
            self._engine.begin() as connection,
        ):
            yield connection


class Plant(PlantDatabase):
    """A plant's registry, for administration and for queries.

    Examples
    --------
    >>> plant = Plant("postgresql://admin:secret@server/torquebench")
    >>> plant.name
    'postgresql+pg8000://admin:***@server/torquebench'
    >>> plant.close()
    """

    @classmethod
    def open(cls, url: str | URL) -> Self:
        """Open an existing plant registry.

        Raises
        ------
        RecordError
            The database contains no plant registry, or one of another version.
        """
        plant = cls(url)
        try:
            with plant.transaction() as connection:
                known = inspect(connection).has_table("settings", schema=PLANT_SCHEMA)
                version = plant._setting(connection, "version") if known else ""
        except BaseException:
            plant.close()
            raise
        if version != PLANT_VERSION:
            plant.close()
            raise RecordError(
                Message(
                    "{name} holds {version}",
                    plant.name,
                    Message("a plant's registry of version {version}", version)
                    if known
                    else "no plant's registry",
                ),
                Message("one of version {plant_version}", PLANT_VERSION),
                "torquebench plant init makes one in another database; benches send it everything",
            )
        return plant

    @classmethod
    def create(cls, url: str | URL, folders_url: str) -> Self:
        """Create a plant's registry in an existing database, and open it.

        Parameters
        ----------
        url : str or sqlalchemy.URL
            URL of the database for a role that may create tables and roles.
        folders_url : str
            URL at which sealed run folders are stored: ``file:///…`` or ``s3://bucket/…``.

        Raises
        ------
        RecordError
            The database already contains a plant registry, or isn't in UTF-8.
        """
        plant = cls(url)
        try:
            with plant.transaction() as connection:
                plant._create(connection, folders_url.rstrip("/"))
        except BaseException:
            plant.close()
            raise
        return plant

    def _create(self, connection: Connection, folders_url: str) -> None:
        encoding = connection.scalar(text("SHOW server_encoding"))
        if encoding != "UTF8":
            raise RecordError(
                Message("{name} is in {encoding}", self.name, encoding), "a database in UTF8"
            )
        if inspect(connection).has_schema(PLANT_SCHEMA):
            raise RecordError(
                Message("{name} has a schema {plant_schema!r}", self.name, PLANT_SCHEMA),
                "a database without one",
                "use it as it is, or name another database",
            )
        connection.execute(text(f"CREATE SCHEMA {PLANT_SCHEMA}"))
        plant_metadata.create_all(connection, checkfirst=False)
        for statement in statements():
            connection.exec_driver_sql(statement)
        content = {
            "version": PLANT_VERSION,
            "folders": folders_url,
            "identity": secrets.token_hex(8),
        }
        connection.execute(
            insert(settings), [{"name": key, "content": value} for key, value in content.items()]
        )
        connection.execute(
            text(f"REVOKE ALL ON ALL FUNCTIONS IN SCHEMA {PLANT_SCHEMA} FROM PUBLIC")
        )
        self._protect_disk(connection)

    @staticmethod
    def _protect_disk(connection: Connection) -> None:
        """Revoke everybody's rights to fill the disk with data outside the plant's tables.

        Rights that this role can't revoke remain; `open_rights` lists them.
        """
        for statement in connection.scalars(text(_OPEN_RIGHTS)).all():
            with contextlib.suppress(SQLAlchemyError), connection.begin_nested():
                connection.exec_driver_sql(statement)

    def open_rights(self) -> list[str]:
        """Return the statements that the server's administrator has to run to protect the disk.

        Without them a bench's role may store large objects or temporary tables of any size.
        """
        with self.transaction() as connection:
            return list(connection.scalars(text(_OPEN_RIGHTS)))

    @staticmethod
    def _setting(connection: Connection, name: str) -> str:
        query = select(settings.c.content).where(settings.c.name == name)
        return connection.scalar(query) or ""

    @property
    def folders_url(self) -> str:
        """Return the URL at which sealed run folders are stored."""
        with self.transaction() as connection:
            return self._setting(connection, "folders")

    def register_bench(
        self, name: str, place: str = "", *, replaces: int | None = None
    ) -> tuple[int, URL]:
        """Give a bench a number and a role in the database.

        The role may only add rows of this bench. Benches may have the same name.

        Parameters
        ----------
        name, place : str
            Its name and location.
        replaces : int, optional
            Number of the bench whose registry was recreated; the rows of this number no longer
            count.

        Returns
        -------
        int, sqlalchemy.URL
            The bench's number, and the URL by which it reaches the plant. The URL contains the
            role's password, which isn't stored anywhere else.
        """
        if not name.strip():
            raise InputError("a bench without a name", "a name")
        with self.transaction() as connection:
            self._protect_disk(connection)
            if replaces is not None:
                self._bench(connection, replaces)
            number = connection.scalar(
                insert(benches)
                .values(name=name.strip(), place=place.strip(), registered=datetime.now(UTC))
                .returning(benches.c.bench_key)
            )
            assert number is not None
            # Roles remain when a database is dropped and created again with the same name.
            made = self._setting(connection, "identity")[:6]
            role = f"torquebench_{self.url.database}_{made}_{number}"[-63:]
            connection.execute(
                update(benches).where(benches.c.bench_key == number).values(role=role)
            )
            url = self._add_role(
                connection,
                role,
                f"CONNECT ON DATABASE {_quoted(self.url.database or '')}",
                *(f"EXECUTE ON FUNCTION {PLANT_SCHEMA}.{each}" for each in BENCH_FUNCTIONS),
            )
            if replaces is not None:
                connection.execute(
                    update(benches)
                    .where(benches.c.bench_key == replaces)
                    .values(replaced_by=number)
                )
        return number, url

    def add_reader(self, name: str) -> URL:
        """Create a read-only role; return its URL."""
        with self.transaction() as connection:
            return self._add_role(
                connection, name, f"SELECT ON ALL TABLES IN SCHEMA {PLANT_SCHEMA}"
            )

    def _add_role(self, connection: Connection, role: str, *rights: str) -> URL:
        """Create a role that may sign in, with rights in the plant's schema; return its URL."""
        password, quoted = secrets.token_urlsafe(24), _quoted(role)
        connection.exec_driver_sql(
            f"CREATE ROLE {quoted} LOGIN CONNECTION LIMIT {CONNECTIONS} PASSWORD '{password}'"
        )
        for right in (f"USAGE ON SCHEMA {PLANT_SCHEMA}", *rights):
            connection.exec_driver_sql(f"GRANT {right} TO {quoted}")
        return make_url(self.url).set(drivername="postgresql", username=role, password=password)

    def _bench(self, connection: Connection, number: int) -> None:
        known = connection.scalars(select(benches.c.bench_key)).all()
        if number not in known:
            raise InputError(
                Message("bench number {number}", number),
                ", ".join(str(each) for each in sorted(known)[:20]) or "a registered bench",
                "torquebench plant status lists them",
            )

    def benches(self) -> list[BenchState]:
        """Return every bench, the oldest first."""
        known, arrived = (
            select(func.count()).where(table.c.bench_key == benches.c.bench_key).scalar_subquery()
            for table in (runs, folders)
        )
        newest = (
            select(links.c.recorded)
            .where(
                links.c.bench_key == benches.c.bench_key,
                links.c.sequence == benches.c.head_sequence,
            )
            .scalar_subquery()
        )
        query = select(
            benches,
            known.label("known"),
            arrived.label("arrived"),
            newest.label("newest"),
            func.now().label("now"),
        )
        query = query.order_by(benches.c.bench_key)
        with self.transaction() as connection:
            return [
                BenchState(
                    number=row.bench_key,
                    name=row.name,
                    place=row.place,
                    registered=row.registered,
                    head=ChainHead(row.head_sequence, row.head_sha256),
                    last_contact=row.last_contact,
                    runs=row.known,
                    folders=row.arrived,
                    replaced_by=row.replaced_by,
                    ahead_s=_ahead_s(row.newest, row.now),
                )
                for row in connection.execute(query)
            ]

    def runs(
        self, limit: int = 100, offset: int = 0, *, withdrawn: bool | None = None, **filters: Any
    ) -> list[PlantRun]:
        """Return runs of all benches, the newest first.

        Parameters
        ----------
        limit, offset : int
            Number of rows, and number of the newest rows to skip.
        withdrawn : bool, optional
            Only withdrawn runs (True), or only the others (False).
        **filters
            Required value of a field of `PlantRun`, such as ``kind="test-hysteresis"``,
            ``bench_key=3``, ``batch="B-17"``.

        Raises
        ------
        InputError
            A filter isn't a column of runs.
        """
        unknown = sorted(set(filters) - set(_FILTERS))
        if unknown:
            raise InputError(Message("filter {unknown}", ", ".join(unknown)), ", ".join(_FILTERS))
        query = (
            select(
                *(runs.c[name] for name in _LISTED),
                func.concat(benches.c.bench_key, " ", benches.c.name).label("bench"),
                func.coalesce(folders.c.url, "").label("url"),
                func.coalesce(folders.c.points_url, "").label("points_url"),
            )
            .join(benches, benches.c.bench_key == runs.c.bench_key)
            .outerjoin(
                folders,
                (folders.c.bench_key == runs.c.bench_key) & (folders.c.run_id == runs.c.run_id),
            )
            .where(benches.c.replaced_by.is_(None))
            .order_by(runs.c.started.desc())
            .limit(limit)
            .offset(offset)
        )
        for name, wanted in filters.items():
            if wanted is not None:
                query = query.where(runs.c[name] == wanted)
        if withdrawn is not None:
            query = query.where(runs.c.withdrawn.is_not(None) == withdrawn)
        with self.transaction() as connection:
            return [PlantRun(**row._mapping) for row in connection.execute(query)]

    def run(self, run_id: str, bench: int | None = None) -> PlantRun:
        """Return one run.

        Raises
        ------
        InputError
            There is no such run, or several benches have a run of this name and `bench` isn't
            given.
        """
        found = self.runs(3, run_id=run_id, bench_key=bench)
        if len(found) != 1:
            said = ", ".join(each.bench for each in found)
            raise InputError(
                Message("run {run_id} of {count} benches: {said}", run_id, len(found), said)
                if found
                else Message("run {run_id} isn't known", run_id),
                "a run of one bench",
                "name the bench by its number" if found else "torquebench plant runs lists them",
            )
        return found[0]

    def withdraw(self, run: PlantRun, *, by: str, reason: str) -> int:
        """Withdraw a run, so that answers no longer use it.

        Its bench records the withdrawal at its next contact. If several benches have sent the
        same sealed run, all copies are withdrawn. Folder and rows are kept.

        Returns
        -------
        int
            How many entries of the run were withdrawn.

        Raises
        ------
        InputError
            The name or the reason is empty, or the run is already withdrawn.
        """
        if not by.strip() or not reason.strip():
            raise InputError("a withdrawal without name or reason", "a name and a reason")
        if run.withdrawn is not None:
            raise InputError(
                Message(
                    "run {run_id} was withdrawn by {withdrawn_by}: {withdrawn_reason}",
                    run.run_id,
                    run.withdrawn_by,
                    run.withdrawn_reason,
                ),
                "a run that counts",
            )
        with self.transaction() as connection:
            marked = connection.scalar(
                text("SELECT plant.withdraw(:bench, :run, :by, :why)"),
                {
                    "bench": run.bench_key,
                    "run": run.run_id,
                    "by": by.strip(),
                    "why": reason.strip(),
                },
            )
        return int(marked or 0)

    def links(self, bench: int, after: int = 0) -> Iterator[Link]:
        """Yield the links that a bench has sent, in the order of its chain."""
        names = ("sequence", "table", "key", "recorded", "content", "previous_sha256", "sha256")
        query = (
            select(*(links.c[name] for name in names))
            .where(links.c.bench_key == bench, links.c.sequence > bindparam("after"))
            .order_by(links.c.sequence)
            .limit(CHUNK)
        )
        while True:
            with self.transaction() as connection:
                rows: Sequence[Any] = connection.execute(query, {"after": after}).all()
            yield from (Link(*row) for row in rows)
            if len(rows) < CHUNK:
                return
            after = rows[-1].sequence

    def verify_chain(self, state: BenchState) -> tuple[int, list[str]]:
        """Check a bench's hash chain in the plant, from its first entry to its head.

        Returns
        -------
        int, list of str
            Number of checked entries, and the findings.
        """
        checked, last, problems = 0, ChainHead(0, "0" * 64), []

        def counted() -> Iterator[Link]:
            nonlocal checked, last
            for link in self.links(state.number):
                checked += 1
                last = ChainHead(link.sequence, link.sha256)
                yield link

        problems = [said for _, said in broken_links(counted())]
        if last != state.head:
            problems.append(f"the chain ends with {last} instead of {state.head}")
        return checked, problems

    def verify_folders(self, bench: int) -> list[str]:
        """Compare every folder of a bench that has arrived with its manifest in the chain."""
        query = (
            select(folders.c.url, runs.c.manifest_sha256)
            .join(
                runs,
                (runs.c.bench_key == folders.c.bench_key) & (runs.c.run_id == folders.c.run_id),
            )
            .where(folders.c.bench_key == bench)
        )
        store = FolderStore(self.folders_url)
        with self.transaction() as connection:
            rows = connection.execute(query).all()
        return [said for url, manifest in rows for said in store.verify(url, manifest)]


def _ahead_s(recorded: str | None, now: datetime) -> float:
    """Return how far an entry's time lies in the future, s; 0 for a time in the past."""
    if recorded is None:
        return 0.0
    ahead_s = (datetime.fromisoformat(recorded) - now).total_seconds()
    return ahead_s if ahead_s > CLOCK_WARNED_S else 0.0


_LISTED = tuple(each.name for each in fields(PlantRun) if each.name in runs.columns)
_FILTERS = tuple(name for name in _LISTED if not name.startswith(("withdrawn", "started")))


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'
