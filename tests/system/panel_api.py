"""The `torquebench panel` command on a free port, and programs that talk to its API."""

import contextlib
import subprocess
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest
from tests.system.command_line import TIMEOUT_S, started
from tests.system.prepared_commands import RunningCommand

PASSWORD = "correct horse battery"
SLOW = pytest.mark.timeout(1200)
"""For modules of many operations: on a slow machine they take their time, and come in the end."""


@dataclass
class Server:
    """A running panel."""

    process: RunningCommand | subprocess.Popen[str]
    url: str
    code: str

    def client(self, token: str = "") -> httpx.Client:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        return httpx.Client(
            base_url=f"{self.url}/api/v1", headers=headers, timeout=TIMEOUT_S, verify=False
        )


@contextlib.contextmanager
def serving(folder: Path, *options: str, fresh: bool = False) -> Iterator[Server]:
    """Start a panel in a folder; it is gone when the block ends."""
    command = ("panel", "--port", "0", "--data", "data", *options)
    with started(*command, cwd=folder, fresh=fresh) as process:
        assert process.stdout is not None
        url = code = ""
        while not code:
            line = process.stdout.readline()
            assert line, "the panel ended before it served"
            url = line.split()[-1] if line.startswith("Panel:") else url
            code = line.split()[-1] if "code" in line else code
        yield Server(process, url, code)


def administrator(server: Server) -> httpx.Client:
    """Set the panel up and return its administrator."""
    with server.client() as nobody:
        made = nobody.post(
            "/setup", json={"code": server.code, "name": "Admin", "password": PASSWORD}
        )
    assert made.status_code == 200, made.text
    return server.client(made.json()["token"])


def person(server: Server, admin: httpx.Client, name: str, role: str) -> httpx.Client:
    """Add an account and return its session."""
    added = admin.post("/users", json={"name": name, "role": role, "password": PASSWORD})
    assert added.status_code == 201, added.text
    with server.client() as nobody:
        opened = nobody.post("/session", json={"name": name, "password": PASSWORD})
    return server.client(opened.json()["token"])


def program(server: Server, admin: httpx.Client, name: str, role: str) -> httpx.Client:
    """Make a client's token and return the client."""
    made = admin.post("/clients", json={"name": name, "role": role})
    assert made.status_code == 201, made.text
    return server.client(made.json()["token"])
