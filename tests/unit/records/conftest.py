"""Registries on every database that torquebench supports."""

import itertools
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from sqlalchemy import Engine, NullPool, create_engine, inspect, make_url, text
from tests import postgresql_server

from torquebench.records import Registry

# Where PostgreSQL is not installed its half is left out, and the report's header says so.
BACKENDS = ["sqlite"]
if postgresql_server.binaries() is not None or os.environ.get("CI"):
    BACKENDS.append("postgresql")

_numbers = itertools.count()


@pytest.fixture(scope="session")
def postgresql_socket() -> Iterator[Path]:
    """One server for all tests of a process."""
    with postgresql_server.server() as socket:
        yield socket


@pytest.fixture(params=BACKENDS)
def registry_url(request: pytest.FixtureRequest) -> str | None:
    """URL of an empty database; None for SQLite in the data directory."""
    if request.param == "sqlite":
        return None
    socket = request.getfixturevalue("postgresql_socket")
    return postgresql_server.create_database(socket, f"registry_{next(_numbers)}")


@pytest.fixture
def registry(tmp_path: Path, registry_url: str | None) -> Iterator[Registry]:
    with Registry.open(tmp_path, registry_url) as opened:
        yield opened


@pytest.fixture
def around(tmp_path: Path, registry_url: str | None) -> Iterator[Engine]:
    """A way into the database past torquebench and past its triggers, with full rights."""
    url = make_url(registry_url or f"sqlite:///{tmp_path / 'registry.sqlite'}")
    if url.drivername == "postgresql":
        url = url.set(drivername="postgresql+pg8000")
    engine = create_engine(url, poolclass=NullPool)
    yield engine
    engine.dispose()


@pytest.fixture
def unguarded(around: Engine, registry: Registry) -> Engine:
    """The same with every trigger and every foreign key switched off."""
    with around.begin() as connection:
        if around.dialect.name == "sqlite":
            query = text("SELECT name FROM sqlite_master WHERE type = 'trigger'")
            for name in connection.scalars(query).all():
                connection.execute(text(f"DROP TRIGGER {name}"))
        else:
            for table in inspect(connection).get_table_names():
                connection.execute(text(f'ALTER TABLE "{table}" DISABLE TRIGGER ALL'))
    return around
