"""Append-only Arrow IPC streams that survive a kill at any time."""

import hashlib
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pyarrow as pa

from torquebench.atomic_write import atomic_path
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.durable_file import DurableFile
from torquebench.tables import numbers_of

FLUSH_INTERVAL_S = 0.5
"""Longest time between two synchronisations while data arrive, s of wall time."""
_CHECKSUM = b"sha256"


class ArrowStream:
    """Append-only stream that writes data in batches with checksums.

    A batch is written by the first call after `FLUSH_INTERVAL_S` or `CAPACITY`, so that a kill
    loses less than a second of data. Calls may come from any thread.

    Parameters
    ----------
    path : pathlib.Path
        File to write; it appears with the first call that appends.
    """

    CONTENT: str
    """Name of the stream's content in messages."""
    CAPACITY: int
    """Largest amount of pending data in memory."""
    COMPRESSION: str

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._file: DurableFile | None = None
        self._writer: Any = None
        self._pending: list[Any] = []
        self._pending_size = 0
        self._last_flush = time.monotonic()
        self._closed = False

    def _batches(self, pending: list[Any]) -> Iterable[Any]:
        """Return the pending data as record batches."""
        raise NotImplementedError

    def _acknowledge(self) -> None:
        """Note that all appended data are on the disk."""
        raise NotImplementedError

    def flush(self) -> None:
        """Write everything that is still in memory to the disk."""
        with self._lock:
            self._flush()

    def close(self) -> None:
        """Write the pending data and end the stream; further calls do nothing."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._flush()
            if self._file is None or self._file.failed:
                return
            try:
                if self._writer is not None:
                    self._writer.close()
                self._file.synchronise()
            except OSError as error:
                raise self._file.failure(error) from error
            self._file.close()

    @contextmanager
    def _appending(self) -> Iterator[None]:
        """Lock the stream while data are appended, and write the pending data when they are due.

        Raises
        ------
        RecordError
            Where the stream is closed or the disk fails; nothing can be appended after that.
        """
        with self._lock:
            if self._closed or (self._file is not None and self._file.failed):
                raise RecordError(
                    Message("{name} is closed", self._path),
                    Message("{content} before the run is sealed", self.CONTENT),
                )
            yield
            if self._file is None:
                self._file = DurableFile(self._path)
            due = time.monotonic() - self._last_flush >= FLUSH_INTERVAL_S
            if due or self._pending_size >= self.CAPACITY:
                self._flush()

    def _flush(self) -> None:
        if not self._pending or self._file is None:
            return
        batches = list(self._batches(self._pending))
        self._pending, self._pending_size = [], 0
        try:
            if self._writer is None:
                options = pa.ipc.IpcWriteOptions(compression=self.COMPRESSION, use_threads=False)
                schema = batches[0].schema
                self._writer = pa.ipc.new_stream(self._file, schema, options=options)
            for batch in batches:
                self._writer.write_batch(batch, custom_metadata={_CHECKSUM: _digest(batch)})
            self._file.synchronise()
        except OSError as error:
            raise self._file.failure(error) from error
        self._acknowledge()
        self._last_flush = time.monotonic()


class WholeBatches:
    """Iterates over the undamaged batches of an Arrow stream.

    An incomplete end, as after a kill, is skipped, and `torn_bytes` gives its size. Batches with a
    wrong checksum are skipped, and `damaged` gives their number.

    Parameters
    ----------
    path : pathlib.Path
        The stream of a run that is running, was killed, or is closed.

    Raises
    ------
    RecordError
        Where the file isn't an Arrow stream.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.torn_bytes = 0
        self.damaged = 0

    def __iter__(self) -> Iterator[Any]:
        size, whole = self._path.stat().st_size, 0
        with pa.OSFile(str(self._path), "rb") as source:
            try:
                with pa.ipc.open_stream(source) as reader:
                    whole = source.tell()
                    while True:
                        batch, checksum = reader.read_next_batch_with_custom_metadata()
                        whole = source.tell()
                        if _is_as_written(batch, checksum):
                            yield batch
                        else:
                            self.damaged += 1
            except StopIteration:
                whole = size
            except (pa.ArrowException, OSError) as error:
                if whole == 0 and size > 0 and not _torn_start(self._path):
                    raise RecordError(
                        Message("{path} can't be read: {problem}", self._path, error),
                        "an Arrow stream",
                    ) from error
        self.torn_bytes = size - whole


def seal_stream(
    stream: Path, sealed: Path, write: Callable[[Path], object], same: Callable[[Path], bool]
) -> None:
    """Replace a closed stream by a sealed file with the same content.

    Parameters
    ----------
    write : callable
        Writes the sealed file under a given name.
    same : callable
        Returns whether the sealed file has the stream's content.

    Raises
    ------
    RecordError
        Where the contents differ or the disk is full; the stream is then kept.
    """
    with atomic_path(sealed, private=True) as part:
        write(part)
        if not same(part):
            raise RecordError(
                Message("{part} differs from {stream}", part, stream),
                "the same content",
                "check the disk",
            )
    stream.unlink()


def _is_as_written(batch: Any, metadata: Any) -> bool:
    try:
        batch.validate(full=True)
        return metadata is not None and metadata.get(_CHECKSUM) == _digest(batch).encode()
    except (pa.ArrowException, ValueError):  # text that isn't UTF-8
        return False


def _digest(batch: Any) -> str:
    """Return the SHA-256 of a batch's columns and values, independent of Arrow's memory layout."""
    digest = hashlib.sha256(described_schema(batch.schema).encode("utf-8", "surrogateescape"))
    for column in batch.columns:
        _feed(digest, column)
    return digest.hexdigest()


def _feed(digest: Any, array: Any) -> None:
    if array.null_count == 0:
        digest.update(b"\x01" * len(array))
    else:
        digest.update(array.is_valid().to_numpy(zero_copy_only=False).tobytes())
    if pa.types.is_struct(array.type):
        for number in range(array.type.num_fields):
            _feed(digest, array.field(number))
    elif pa.types.is_list(array.type):
        digest.update(repr(array.value_lengths().to_pylist()).encode())
        _feed(digest, array.flatten())
    elif pa.types.is_primitive(array.type):
        filled = array
        if array.null_count:
            filled = array.fill_null(False if pa.types.is_boolean(array.type) else 0)
        digest.update(numbers_of(filled).tobytes())
    else:  # text and bytes
        for value in array.to_pylist():
            content = value.encode() if isinstance(value, str) else value or b""
            digest.update(f"{len(content)}:".encode())
            digest.update(content)


def _torn_start(path: Path) -> bool:
    """Return whether the file begins like an Arrow stream, so that only its end is missing.

    A power cut may leave zeros in unwritten blocks.
    """
    with path.open("rb") as file:
        return b"\xff\xff\xff\xff".startswith(file.read(4).rstrip(b"\0"))


def described_schema(schema: Any) -> str:
    """Return the names and types of a schema's columns as text."""
    return ", ".join(f"{field.name} ({field.type})" for field in schema)
