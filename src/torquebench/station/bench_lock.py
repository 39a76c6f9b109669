"""Lock a bench and its records; the lock ends with the process.

Two processes must not command one drive or write runs into one data directory. Opening a bench
therefore locks the data directory and, if the bench has real instruments, its drives. Reading
records needs no lock.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import socket
import sys
import tempfile
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Self

from torquebench.atomic_write import private_folder
from torquebench.bench.description import BenchDescription
from torquebench.errors import InputError
from torquebench.message import Message

LOCK_FILE = "bench.lock"
"""File in the data directory that names the process with the open bench; it is never deleted."""
LOCKED_BYTE = 2**30
"""Position of the locked byte on Windows, far behind the text, which stays readable."""
LONGEST_OWNER = 4096
LONGEST_SHOWN = 120


class BenchLock:
    """Locks a bench for this process until it is released or the process ends.

    Parameters
    ----------
    description : BenchDescription or None
        Bench to lock; None locks only the records.
    data_dir : pathlib.Path
        Folder of the records; created if missing.

    Raises
    ------
    InputError
        Another process has locked the bench or the records.

    Examples
    --------
    >>> import tempfile
    >>> from torquebench.bench.description import default_bench
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     lock = BenchLock(default_bench(), Path(folder))
    ...     lock.release()
    """

    def __init__(self, description: BenchDescription | None, data_dir: Path) -> None:
        self._files: list[int] = []
        private_folder(data_dir)
        owner = _owner(description)
        try:
            self._hold(data_dir / LOCK_FILE, owner, f"the records in {data_dir}")
            for place, what in () if description is None else _drives(description):
                self._hold(place, owner, what)
        except BaseException:
            self.release()
            raise

    def _hold(self, path: Path, owner: Mapping[str, str], what: str) -> None:
        file = _opened(path)
        try:
            _lock(file)
        except OSError as error:
            text = os.pread(file, LONGEST_OWNER, 0) if hasattr(os, "pread") else b""
            os.close(file)
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES, errno.EDEADLK):
                raise InputError(
                    Message("{path} can't be locked: {strerror}", path, error.strerror),
                    "a data directory on a file system with locks",
                    "choose a folder on a local disk with --data",
                ) from error
            raise InputError(
                Message("{what} are in use by {text}", what, _told(text)),
                "one process with an open bench",
                "wait until that process ends, or end it; records can be listed and "
                "exported meanwhile",
            ) from None
        self._files.append(file)
        with contextlib.suppress(OSError):  # a full disk: the lock works without a name, too
            os.truncate(file, 0)
            os.write(file, json.dumps(owner, ensure_ascii=False).encode() + b"\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def release(self) -> None:
        """Release all locks. A second call does nothing."""
        files, self._files = self._files, []
        for file in files:
            with contextlib.suppress(OSError):
                os.truncate(file, 0)
            os.close(file)


def _owner(description: BenchDescription | None) -> dict[str, str]:
    """Describe this process for the error messages of other processes."""
    return {
        "bench": "" if description is None else description.name,
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "pid": str(os.getpid()),
        "host": socket.gethostname(),
        "since": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _told(text: bytes) -> str:
    """Describe the process named in a lock file."""
    try:
        owner = {key: _plain(str(value)) for key, value in json.loads(text).items()}
        return Message(
            "`{command}` (process {pid} on {host}, since {since})",
            owner["command"],
            owner["pid"],
            owner["host"],
            owner["since"],
        )
    except (ValueError, KeyError, AttributeError):  # locked a moment ago, or by another version
        return "another process"


def _plain(text: str) -> str:
    return "".join(letter for letter in text if letter.isprintable())[:LONGEST_SHOWN]


def _drives(description: BenchDescription) -> Iterator[tuple[Path, str]]:
    """Yield a lock file for every drive that other processes could command, and its name."""
    driver: Mapping[str, Any] = description.driver
    if description.bench.driver == "simulated":
        return  # the simulated instruments belong to this process
    sections = {key: driver[key] for key in ("input_drive", "output_drive") if key in driver}
    for key, section in (sections or {description.bench.driver: driver}).items():
        told = {name: value for name, value in dict(section).items() if name != "timeout_s"}
        text = json.dumps(told, sort_keys=True, default=str)
        digest = hashlib.sha256(text.encode()).hexdigest()[:16]
        what = (
            Message("the instruments of {key}", key)
            if not sections
            else Message("the commands of {key}", key)
        )
        yield Path(tempfile.gettempdir(), f"torquebench-{digest}.lock"), what


def _opened(path: Path) -> int:
    """Open a lock file; that of another user is opened read-only."""
    flags = os.O_RDWR | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOFOLLOW", 0)
    with contextlib.suppress(FileNotFoundError):
        try:
            return os.open(path, flags)
        except PermissionError:
            return os.open(path, (flags & ~os.O_RDWR) | os.O_RDONLY)
    return os.open(path, flags | os.O_CREAT, 0o644)


if sys.platform == "win32":  # pragma: no cover - the tests run elsewhere
    import msvcrt

    def _lock(file: int) -> None:
        os.lseek(file, LOCKED_BYTE, os.SEEK_SET)
        msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        os.lseek(file, 0, os.SEEK_SET)

else:
    import fcntl

    def _lock(file: int) -> None:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
