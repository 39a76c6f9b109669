"""Read-only access to a SQLite file, such as an archive, a backup or another person's data."""

import os
import shutil
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path


def is_writable(file: Path) -> bool:
    """Return whether a database's file and its folder can be written."""
    return os.access(file, os.W_OK) and os.access(file.parent, os.W_OK)


@contextmanager
def sqlite_reader(file: Path) -> Iterator[str]:
    """Yield the address for reading a database, even where its folder can't be written.

    A database in WAL mode keeps an index of its log in another file, which even a reader writes. If
    it can't be written, a database without a log is opened as immutable, and one with a log (its
    bench was killed, or is running) is read from a copy.

    Parameters
    ----------
    file : pathlib.Path
        The database; it must exist.
    """
    address = f"{file.resolve().as_uri()}?mode=ro"
    log = file.with_name(f"{file.name}-wal")
    if is_writable(file):
        yield address
    elif not log.exists() or not log.stat().st_size:
        yield f"{address}&immutable=1"
    elif _readable(address):
        yield address
    else:
        with tempfile.TemporaryDirectory(prefix="torquebench-") as folder:
            for source in (file, log):
                shutil.copyfile(source, Path(folder) / source.name)
            yield f"{(Path(folder) / file.name).as_uri()}?mode=ro"


def _readable(address: str) -> bool:
    try:
        with closing(sqlite3.connect(address, uri=True)) as connection:
            connection.execute("SELECT name FROM sqlite_master LIMIT 1").fetchone()
    except sqlite3.OperationalError:
        return False
    return True
