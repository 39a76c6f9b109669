"""A plant's registry on a PostgreSQL server that the tests start."""

import itertools
import os
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests import postgresql_server

from torquebench_plant import Plant

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
    """An empty plant whose folders are stored on a share."""
    url = postgresql_server.create_database(plant_socket, f"plant_{next(_numbers)}")
    (tmp_path / "share").mkdir()
    with Plant.create(url, f"file://{tmp_path}/share") as created:
        yield created


@pytest.fixture(scope="session")
def endpoint() -> Iterator[str]:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    serve = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    quiet = subprocess.DEVNULL
    with subprocess.Popen(serve, stdout=quiet, stderr=quiet) as server:
        deadline = time.monotonic() + 60.0
        while True:
            try:
                socket.create_connection(("127.0.0.1", port)).close()
                break
            except OSError:
                assert server.poll() is None
                assert time.monotonic() < deadline, "moto's server doesn't answer"
                time.sleep(0.1)
        yield f"http://127.0.0.1:{port}"
        server.terminate()


@pytest.fixture
def bucket(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> str:
    for name, value in (
        ("AWS_ENDPOINT_URL", endpoint),
        ("AWS_ACCESS_KEY_ID", "testing"),
        ("AWS_SECRET_ACCESS_KEY", "testing"),
        ("AWS_REGION", "us-east-1"),
        ("AWS_EC2_METADATA_DISABLED", "true"),
    ):
        monkeypatch.setenv(name, value)
    request = urllib.request.Request(f"{endpoint}/plant", method="PUT")
    urllib.request.urlopen(request).close()
    return "s3://plant/runs"
