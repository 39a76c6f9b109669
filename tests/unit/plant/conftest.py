"""A plant's registry on a PostgreSQL server of the tests' own."""

import itertools
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests import postgresql_server

from torquebench.plant import Plant

if postgresql_server.binaries() is None and not os.environ.get("CI"):
    collect_ignore = [
        path.name for path in Path(__file__).parent.glob("test_*.py") if "postgresql" in path.name
    ]

_numbers = itertools.count()


@pytest.fixture(scope="session")
def plant_socket() -> Iterator[Path]:
    """One server for all tests of a process."""
    with postgresql_server.server() as socket:
        yield socket


@pytest.fixture
def plant(plant_socket: Path, tmp_path: Path) -> Iterator[Plant]:
    """An empty plant whose folders go to a share."""
    url = postgresql_server.create_database(plant_socket, f"plant_{next(_numbers)}")
    (tmp_path / "share").mkdir()
    with Plant.create(url, f"file://{tmp_path}/share") as created:
        yield created
