"""Atomic writes: a file holds either its old content or all of the new content.

Only regular files are replaced. Links are followed, devices and pipes are written to directly, and
``-`` is standard output.
"""

import contextlib
import errno
import io
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from torquebench.errors import InputError, RecordError, TorquebenchError
from torquebench.message import Message

__all__ = [
    "atomic_file",
    "atomic_folder",
    "atomic_path",
    "atomic_write",
    "create_private",
    "is_standard_output",
    "private_folder",
    "replacing",
    "require_private",
    "sync_folder",
]

_STANDARD_OUTPUT = 1
_STANDARD_STREAMS = {"/dev/stdout": _STANDARD_OUTPUT, "/dev/stderr": 2}
_DESCRIPTOR = re.compile(r"(?:/dev/fd|/proc/(self|thread-self|[0-9]+)/fd)/([0-9]+)")
_MOST_LINKS = 40
_DISK_FAILED = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


def atomic_write(path: Path, content: str | bytes, *, private: bool = False) -> None:
    """Write a file so that it holds either its old content or all of the new content.

    Parameters
    ----------
    path : pathlib.Path
        File to be written; its folder must exist. A link is followed, a device or pipe is written
        to directly, and ``-`` is standard output.
    content : str or bytes
        Text is written as UTF-8 with unchanged line ends.
    private : bool
        Whether a new file is its owner's alone.

    Raises
    ------
    InputError
        If the path can't be written to.
    RecordError
        If the disk is full or fails.
    """
    with atomic_file(path, private=private) as file:
        file.write(content.encode() if isinstance(content, str) else content)


@contextlib.contextmanager
def atomic_file(path: Path, *, private: bool = False) -> Iterator[IO[bytes]]:
    """Yield a binary file whose content replaces that of a path if the block ends without error.

    Parameters and errors are those of `atomic_write`. Writes to a device, a pipe or standard output
    are direct.
    """
    with _worded(path):
        target = _target(path)
        if isinstance(target, int):
            with _stream(target) as file:
                yield file
        elif _is_special(target):
            with target.open("wb") as file:
                yield file
        else:
            with replacing(target, private=private) as part, part.open("wb") as file:
                yield file


@contextlib.contextmanager
def atomic_path(path: Path, ending: str = "", *, private: bool = False) -> Iterator[Path]:
    """Yield the name of an empty file whose content replaces that of a path after the block.

    It is meant for libraries that open files themselves. Parameters and errors are those of
    `atomic_write`.

    Parameters
    ----------
    path : pathlib.Path
    ending : str, optional
        Ending of the yielded name, for libraries that need it.
    private : bool
        Whether a new file is its owner's alone.
    """
    with _worded(path):
        target = _target(path)
        if isinstance(target, Path) and not _is_special(target):
            with replacing(target, ending, private=private) as part:
                yield part
            return
    with tempfile.TemporaryDirectory() as folder:
        part = Path(folder, f"part{ending}")
        yield part
        with part.open("rb") as source, atomic_file(path) as file:
            shutil.copyfileobj(source, file)


@contextlib.contextmanager
def replacing(target: Path, ending: str = "", *, private: bool = False) -> Iterator[Path]:
    """Yield an empty file beside a target file, which it replaces if the block ends without error.

    It has the permissions of the file that it replaces, unless the block changes them. It raises
    the operating system's errors and doesn't follow links: callers have to report errors
    themselves.
    """
    if target.exists() and not os.access(
        target, os.W_OK
    ):  # the folder's permissions alone would allow it
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(target))
    part = target.parent / f".{target.name}.{os.urandom(4).hex()}.part{ending}"
    try:
        part.touch(0o600 if private else 0o666, exist_ok=False)
        if target.exists():
            part.chmod(stat.S_IMODE(target.stat().st_mode))
        yield part
        with part.open(
            "rb" if os.name == "posix" else "rb+"
        ) as file:  # Windows requires write permission
            os.fsync(file.fileno())
        part.replace(target)
    finally:
        part.unlink(missing_ok=True)
    sync_folder(target.parent)


@contextlib.contextmanager
def atomic_folder(path: Path) -> Iterator[Path]:
    """Yield a new folder that replaces another one if the block ends without error.

    A folder that an interrupted process has left is removed first.
    """
    part = path.with_name(f".{path.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        private_folder(part)
        yield part
        if path.exists():
            shutil.rmtree(path)
        part.replace(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)
    sync_folder(path.parent)


def private_folder(folder: Path) -> None:
    """Create a folder and its parents with access for the owner only.

    The permissions of an existing folder aren't changed.
    """
    for each in (*reversed(folder.parents), folder):
        if not each.is_dir():
            # another process may create the file in between, which is an error
            each.mkdir(mode=0o700, exist_ok=True)


def require_private(path: Path) -> None:
    """Refuse a file with secrets that others may read.

    Raises
    ------
    InputError
        Others may read the file; the message states the command that prevents this.
    """
    if path.stat().st_mode & 0o077:
        raise InputError(
            Message("{key} is open to others", path), "mode 0600", Message("chmod 600 {key}", path)
        )


def create_private(path: Path) -> io.FileIO:
    """Create a file that only its owner may read, for writing without a buffer.

    Raises
    ------
    FileExistsError
        The file already exists.
    """
    return io.FileIO(path, "xb", opener=lambda name, flags: os.open(name, flags, 0o600))


def is_standard_output(path: Path) -> bool:
    """Return whether a path leads to standard output, to which nothing else may be printed."""
    return _target(path) == _STANDARD_OUTPUT


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable against a power failure, if the platform can."""
    if os.name == "nt":  # Windows can't open a folder
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _target(path: Path) -> Path | int:
    """Return the file to which a path leads, or the number of one of this process's descriptors."""
    if str(path) == "-":
        return _STANDARD_OUTPUT
    current = path.absolute()
    for _ in range(_MOST_LINKS):
        for each in map(str, (current, current.parent.resolve() / current.name)):
            if each in _STANDARD_STREAMS:
                return _STANDARD_STREAMS[each]
            found = _DESCRIPTOR.fullmatch(each)
            if found and found[1] in (None, "self", "thread-self", str(os.getpid())):
                return int(found[2])
        if str(current).startswith("/proc/") or not current.is_symlink():
            return current
        current = current.parent / current.readlink()
    raise OSError(errno.ELOOP, os.strerror(errno.ELOOP), str(path))


def _is_special(target: Path) -> bool:
    """Return whether a path is a device, a pipe or a socket, which is never replaced."""
    try:
        mode = target.stat().st_mode
    except FileNotFoundError:
        return False
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(target))
    return not stat.S_ISREG(mode)


@contextlib.contextmanager
def _stream(descriptor: int) -> Iterator[IO[bytes]]:
    """Open a descriptor for writing; standard output in the order of what Python wrote to it."""
    if descriptor == _STANDARD_OUTPUT:
        sys.stdout.flush()
        if isinstance(getattr(sys.stdout, "buffer", None), io.BufferedIOBase):
            yield sys.stdout.buffer
            sys.stdout.buffer.flush()
            return
    with os.fdopen(os.dup(descriptor), "wb") as file:
        yield file


@contextlib.contextmanager
def _worded(path: Path) -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # the reader closed the pipe early
        raise
    except OSError as error:
        kind: type[TorquebenchError] = RecordError if error.errno in _DISK_FAILED else InputError
        raise kind(
            Message("can't write {path}: {strerror}", path, error.strerror or error),
            "a file in an existing folder with write permission and space",
            "name another file, or make room on the disk",
        ) from error
