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

USER = "torquebench"
PORT = 5432  # names the socket's file; the server listens on no network


def binaries() -> Path | None:
    """Return the folder with `initdb` and `postgres`, of the newest version; None without one."""
    found = shutil.which("postgres")
    folders = [Path(found).resolve().parent] if found else []
    folders += sorted(
        Path("/usr/lib/postgresql").glob("*/bin"), key=lambda path: path.parent.name, reverse=True
    )
    return next((path for path in folders if (path / "initdb").is_file()), None)


@contextmanager
def server() -> Iterator[Path]:
    """Run a server on a socket in a folder of its own, and yield the socket."""
    bin_folder = binaries()
    assert bin_folder is not None, "PostgreSQL isn't installed (Debian package: postgresql)"
    folder = Path(tempfile.mkdtemp(prefix="torquebench-postgresql-"))
    identity: dict[str, object] = {}
    if os.geteuid() == 0:  # the server refuses to run as root
        identity = {"user": "postgres", "group": "postgres", "extra_groups": []}
        shutil.chown(folder, "postgres", "postgres")
    data = folder / "data"
    initialise = [bin_folder / "initdb", "-D", data, "-U", USER, "-A", "trust", "-E", "UTF8"]
    initialise += ["--locale=C", "--no-sync"]
    serve = [bin_folder / "postgres", "-D", data, "-k", folder, "-p", str(PORT)]
    serve += ["-c", "listen_addresses=", "-c", "fsync=off", "-c", "full_page_writes=off"]
    try:
        subprocess.run(initialise, cwd=folder, check=True, capture_output=True, **identity)  # type: ignore[call-overload]
        with (folder / "log").open("wb") as log:
            process = subprocess.Popen(serve, cwd=folder, stdout=log, stderr=log, **identity)  # type: ignore[call-overload]
        try:
            socket = folder / f".s.PGSQL.{PORT}"
            _wait(socket, process, folder / "log")
            yield socket
        finally:
            process.send_signal(signal.SIGQUIT)  # at once: nobody needs its data any more
            process.wait(timeout=30)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def connect(socket: Path, database: str = "postgres") -> pg8000.native.Connection:
    """Return a connection below the registry, as whoever tampers with it would have."""
    return pg8000.native.Connection(USER, database=database, unix_sock=str(socket))


def create_database(socket: Path, name: str) -> str:
    """Create an empty database and return its URL."""
    connection = connect(socket)
    connection.run(f'CREATE DATABASE "{name}"')
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
