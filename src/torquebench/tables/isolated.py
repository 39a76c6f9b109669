"""Reading of foreign files in a separate process, with limits of memory, time and size.

Malicious files can attack native parsers, and small files may expand to many gigabytes. All formats
except text are therefore read by a separate process, whose crash only causes an error message;
programs that command a bench (panel, API) read text in this way, too (decision 194). The process
sends the rows as an Arrow stream. Run as a program, this module is that process.
"""

from __future__ import annotations

import contextlib
import io
import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.processes import limit_process

_AT_ONCE = 2
_TURNS = threading.BoundedSemaphore(_AT_ONCE)
_HEADER = b"torquebench:table"
_NICE = 5
_START_S = 120.0
_REFUSED, _TOO_LARGE = 2, 3
_ENVIRONMENT = {
    # without reserved memory, which would count
    "ARROW_DEFAULT_MEMORY_POOL": "system",
    "MALLOC_ARENA_MAX": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
}


@dataclass(frozen=True)
class Limits:
    """Limits for reading a file.

    Parameters
    ----------
    memory_mb : int
        Memory of the reader's process, in addition to its programs.
    seconds : float
        Time until the whole table is read, or until the next batch.
    cells : int or None
        Number of cells in the whole table.
    mb : int or None
        Size of the table in memory, and of a text file.
    """

    memory_mb: int = 512
    seconds: float = 30.0
    cells: int | None = 20_000_000
    mb: int | None = 256


BATCHES = Limits(cells=None, mb=None)
"""Limits for tables that are read and written batch by batch."""
_MOST_FOLD, _EXPANDED = 1000, 256 << 20
"""Largest ratio of the cells' size to the file's, for files whose cells have more than so many
bytes."""


class Stream:
    """A table, as its process sends it.

    Attributes
    ----------
    schema : pyarrow.Schema
    header : dict
        Properties of the table in the file: origin, rows, before, notes, …
    """

    def __init__(self, process: subprocess.Popen[bytes], path: str, limits: Limits) -> None:
        import pyarrow as pa
        import pyarrow.ipc

        self._process, self._path, self._limits = process, path, limits
        self._pipe = _Pipe(process, _START_S)
        self._errors = pa.ArrowInvalid, OSError, EOFError
        try:
            self._pipe.read(1)  # now its programs are loaded, which takes time on a busy computer
            self._pipe.wait_again(limits.seconds)
            self._reader = pa.ipc.open_stream(self._pipe)
        except self._errors as error:
            raise self._ended() from error
        self.schema = self._reader.schema
        self.header: dict[str, Any] = json.loads((self.schema.metadata or {})[_HEADER])

    def batches(self) -> Iterator[Any]:
        """Yield the record batches.

        Raises
        ------
        InputError
            The file can't be read to its end, or exceeds the limits.
        """
        while True:
            if self._limits.cells is None:
                self._pipe.wait_again(self._limits.seconds)
            try:
                batch = self._reader.read_next_batch()
            except StopIteration:
                break
            except self._errors as error:
                raise self._ended() from error
            yield batch
        if self._process.wait(timeout=self._limits.seconds):
            raise self._ended()

    def _ended(self) -> InputError:
        """Return an error with the reason why the process has ended."""
        if self._pipe.late:
            return InputError(
                Message("{path}: not read in {seconds:g} s", self._path, self._pipe.late),
                "a table that is read in that time",
                "take fewer rows, or save it as Parquet or CSV",
            )
        code = self._process.wait()
        assert self._process.stderr is not None
        told = self._process.stderr.read()
        if code == _REFUSED:
            with contextlib.suppress(ValueError, KeyError):
                found, allowed, remedy = (_restored(each) for each in json.loads(told))
                return InputError(found, allowed, remedy)
        if code == _TOO_LARGE or b"memory" in told or b"alloc" in told:
            return InputError(
                Message(
                    "{path}: more than {memory} MB when it is read",
                    self._path,
                    self._limits.memory_mb,
                ),
                "a smaller table",
                "take fewer rows or columns, or save it as CSV",
            )
        how = f"signal {-code}" if code < 0 else f"exit code {code}"
        return InputError(
            Message("{path}: its reader has failed ({how})", self._path, how),
            "a file that isn't damaged",
            "save it again, best as CSV or Parquet",
        )


class _Pipe(io.RawIOBase):
    """A process's output, of which a reader waits no longer than a time limit."""

    def __init__(self, process: subprocess.Popen[bytes], seconds: float) -> None:
        super().__init__()
        assert process.stdout is not None
        self._process, self._file = process, process.stdout.fileno()
        self.late = 0.0
        self.wait_again(seconds)

    def wait_again(self, seconds: float) -> None:
        """Restart the time limit."""
        self._seconds, self._until = seconds, time.monotonic() + seconds

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Read the available bytes, after waiting for them."""
        left = self._until - time.monotonic()
        if left <= 0.0 or not select.select([self._file], [], [], left)[0]:
            self.late = self._seconds
            self._process.kill()
            raise EOFError
        content = os.read(self._file, min(len(buffer), 1 << 20))
        buffer[: len(content)] = content
        return len(content)

    def read(self, size: int = -1) -> bytes:
        """Read a number of bytes, or fewer at the end."""
        content = bytearray()
        while len(content) < size:
            piece = bytearray(size - len(content))
            count = self.readinto(piece)
            if not count:
                break
            content += piece[:count]
        return bytes(content)


@contextlib.contextmanager
def open_isolated(
    path: Path, part: str, kind: str, rows: int, limits: Limits, called: str = ""
) -> Iterator[Stream]:
    """Open a file in a separate process.

    Parameters
    ----------
    path : pathlib.Path
    part : str
        Sheet or group, "" for the only one.
    kind : str
        Name of the file's format.
    rows : int
        Largest number of rows in a batch.
    limits : Limits
    called : str
        Name of the file in messages; by default its path.

    Raises
    ------
    InputError
        The file can't be read, or exceeds the limits.
    """
    arguments = {
        "path": str(path.absolute()),
        "shown": called or str(path),
        "part": part,
        "kind": kind,
        "rows": rows,
        "limits": [limits.memory_mb, limits.seconds, limits.cells, limits.mb],
    }
    with _TURNS:
        process = subprocess.Popen(
            [sys.executable, "-m", "torquebench.tables.isolated", json.dumps(arguments)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, **_ENVIRONMENT},
        )
        try:
            yield Stream(process, called or str(path), limits)
        finally:
            process.kill()
            process.communicate()


def _restored(plain: Any) -> str:
    return plain if isinstance(plain, str) else Message.restored(plain)


# -- the process ----------------------------------------------------------------------------


def main(arguments: dict[str, Any]) -> int:
    """Read a file and send it to standard output; return the exit code."""
    if hasattr(os, "setpriority"):
        os.setpriority(os.PRIO_PROCESS, 0, _NICE)  # the bench has priority, even during imports
    stream = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output that a package prints isn't part of the stream
    memory_mb, seconds, cells, mb = arguments["limits"]
    limits = Limits(memory_mb, seconds, cells, mb)
    try:
        _send(arguments, limits, stream)
        stream.close()
    except InputError as error:
        texts = (error.found, error.allowed, error.remedy)
        plain = [each.as_plain() if isinstance(each, Message) else each for each in texts]
        told, path = json.dumps(plain), json.dumps(arguments["path"])[1:-1]
        sys.stderr.write(told.replace(path, json.dumps(arguments["shown"])[1:-1]))
        return _REFUSED
    except MemoryError:
        return _TOO_LARGE
    except BrokenPipeError:
        return 0
    return 0


def _send(arguments: dict[str, Any], limits: Limits, stream: Any) -> None:
    import pyarrow as pa
    import pyarrow.ipc

    from torquebench.tables.formats import ROW, formats

    kind = next(each for each in formats() if each.name == arguments["kind"])
    path, shown = Path(arguments["path"]), arguments["shown"]
    _prepare(kind.package, limits)
    stream.write(b"\n")
    stream.flush()
    with ExitStack() as opened:
        try:
            table = kind.open(path, arguments["part"], opened)
            rows = table.rows
            names, stored = table.schema.names, path.stat().st_size
            if rows is not None:
                check_cells(shown, rows, len(names), limits)
                _check_expansion(shown, rows * len(names), stored)
            origin = f"{shown}#{table.part}" if table.part else shown
            header = {
                "origin": origin,
                "rows": rows,
                "before": table.before,
                "counted": table.counted,
                "separator": table.separator,
                "notes": [n.as_plain() if isinstance(n, Message) else n for n in table.notes],
                "numbered": table.numbered and table.schema.names[-1] == ROW,
            }
            metadata = {**(table.schema.metadata or {}), _HEADER: json.dumps(header)}
            schema = table.schema.with_metadata(metadata)
            count, size = 0, 0
            with pa.ipc.new_stream(stream, schema) as writer:
                for batch in table.batches(arguments["rows"]):
                    count, size = count + batch.num_rows, size + batch.nbytes
                    check_cells(shown, count, len(names), limits)
                    _check_expansion(shown, count * len(names), stored)
                    if limits.mb is not None and size > limits.mb << 20:
                        raise InputError(
                            Message("{path}: more than {size} MB of cells", shown, limits.mb),
                            Message("at most {size} MB", limits.mb),
                            "take fewer rows or columns",
                        )
                    writer.write_batch(batch)
        except (InputError, MemoryError, BrokenPipeError):
            raise
        except Exception as error:  # each library raises its own errors and those of struct
            words = str(error).replace(str(path), shown) or type(error).__name__
            if "memory" in words.lower() or "failed to map" in words:  # each with its own text
                raise MemoryError from error
            raise InputError(
                Message("can't read {source}: {error}", shown, words[:300]),
                "a file of the kind that its ending names",
            ) from error


class _WithoutPandas:
    """Import hook that keeps Arrow from importing pandas, which would take long."""

    def find_spec(self, name: str, _path: object = None, _target: object = None) -> None:
        """Refuse pandas."""
        if name == "pandas":
            raise ImportError(name)


def check_cells(path: str, rows: int, columns: int, limits: Limits) -> None:
    """Refuse a table with more cells than the limits allow."""
    if limits.cells is not None and rows * columns > limits.cells:
        raise InputError(
            Message("{path}: {rows} rows of {columns} columns", path, rows, columns),
            Message("at most {most} cells", limits.cells),
            "take fewer rows or columns",
        )


def _check_expansion(path: str, cells: int, stored: int) -> None:
    if 8 * cells > max(_MOST_FOLD * stored, _EXPANDED):
        raise InputError(
            Message("{path}: {cells} cells in {size} kB", path, cells, (stored >> 10) + 1),
            Message("at most {fold} times as many bytes as the file has", _MOST_FOLD),
            "save it as CSV if it is a recording",
        )


def _prepare(package: str, limits: Limits) -> None:
    """Import the reader of the format, then limit memory and processor time of this process."""
    from importlib import import_module

    import pyarrow as pa

    if package:
        import_module(package)
    if "pandas" not in sys.modules:
        sys.meta_path.insert(0, _WithoutPandas())
    pa.set_cpu_count(1)
    pa.set_io_thread_count(1)
    limit_process(limits.memory_mb, None if limits.cells is None else limits.seconds)


if __name__ == "__main__":
    code = main(json.loads(sys.argv[1]))
    sys.stderr.flush()
    os._exit(code)  # all is sent: a library that aborts as the interpreter ends spoils nothing
