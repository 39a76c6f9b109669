"""A PostgreSQL server of the tests' own, from Debian's packages where they are installed."""

import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pg8000.native
from tests.programs import program

USER = "torquebench"
PORT = 5432  # names the socket's file; the server listens on no network


def binaries() -> Path | None:
    """Return the folder with `initdb` and `postgres`, of the newest version; None without one."""
    found = program("postgres")
    return None if found is None else Path(found).parent


class Server:
    """A server on a socket in a folder of its own, which can be stopped and started again."""

    def __init__(self, folder: Path, *, durable: bool = False) -> None:
        found = binaries()
        assert found is not None, "PostgreSQL isn't installed (Debian package: postgresql)"
        self.socket = folder / f".s.PGSQL.{PORT}"
        self._folder, self._data, self._bin = folder, folder / "data", found
        self._durable = durable
        self._identity: dict[str, object] = {}
        if os.geteuid() == 0:  # the server refuses to run as root
            self._identity = {"user": "postgres", "group": "postgres", "extra_groups": []}
            shutil.chown(folder, "postgres", "postgres")
        initialise = [found / "initdb", "-D", self._data, "-U", USER, "-A", "trust", "-E", "UTF8"]
        initialise += ["--locale=C", "--no-sync"]
        subprocess.run(initialise, cwd=folder, check=True, capture_output=True, **self._identity)  # type: ignore[call-overload]

    @property
    def url(self) -> str:
        """URL of a registry on it."""
        return f"postgresql://{USER}@/postgres?unix_sock={self.socket}"

    def start(self) -> None:
        """Start the server and wait until it answers."""
        serve = [self._bin / "postgres", "-D", self._data, "-k", self._folder, "-p", str(PORT)]
        serve += ["-c", "listen_addresses="]
        if not self._durable:
            serve += ["-c", "fsync=off", "-c", "full_page_writes=off"]
        with (self._folder / "log").open("ab") as log:
            self._process = subprocess.Popen(  # type: ignore[call-overload]
                serve, cwd=self._folder, stdout=log, stderr=log, **self._identity
            )
        _wait(self.socket, self._process, self._folder / "log")

    def stop(self) -> None:
        """End the server as its service does: whoever is connected is thrown out."""
        self._process.send_signal(signal.SIGINT)
        self._process.wait(timeout=30)

    def close(self) -> None:
        """End the server at once: nobody needs its data any more."""
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGQUIT)
            self._process.wait(timeout=30)


@contextmanager
def restartable(*, durable: bool = False) -> Iterator[Server]:
    """Run a server in a folder of its own, and yield it; one that isn't durable is faster."""
    folder = Path(tempfile.mkdtemp(prefix="torquebench-postgresql-"))
    try:
        found = Server(folder, durable=durable)
        found.start()
        try:
            yield found
        finally:
            found.close()
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def server() -> Iterator[Path]:
    """Run a server in a folder of its own, and yield its socket."""
    with restartable() as found:
        yield found.socket


def connect(socket: Path, database: str = "postgres") -> pg8000.native.Connection:
    """Return a connection below the registry, as whoever tampers with it would have."""
    return pg8000.native.Connection(USER, database=database, unix_sock=str(socket))


def create_database(socket: Path, name: str) -> str:
    """Create an empty database and return its URL."""
    connection = connect(socket)
    # five times as fast as by the log, which a server without fsync doesn't need
    connection.run(f'CREATE DATABASE "{name}" STRATEGY file_copy')
    connection.close()
    return f"postgresql://{USER}@/{name}?unix_sock={socket}"


def _wait(socket: Path, process: "subprocess.Popen[bytes]", log: Path) -> None:
    deadline = time.monotonic() + 60.0
    while True:
        try:
            connect(socket).close()
            return
        except (pg8000.native.Error, OSError):
            assert process.poll() is None, log.read_text(errors="replace")
            assert time.monotonic() < deadline, "PostgreSQL doesn't answer"
            time.sleep(0.05)
