"""The raw samples of a run: an Arrow stream while it runs, a Parquet file when it is sealed."""

import hashlib
import os
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import RecordError
from torquebench.records.durable_file import DurableFile

__all__ = ["RawReading", "RawStream", "WholeBatches", "read_raw", "seal_raw", "write_checked"]

FLUSH_INTERVAL_S = 0.5
FLUSH_ROWS = 20_000
_CHECKSUM = b"sha256"


class RawStream:
    """Appends columns of samples to an Arrow IPC stream that survives a kill at any moment.

    Samples reach the disk at the latest with the first call after `FLUSH_INTERVAL_S` or
    `FLUSH_ROWS`, so a kill costs less than a second of them. Columns and types are those of the
    first call. Calls may come from any thread.

    Parameters
    ----------
    path : pathlib.Path
        File to write; it appears with the first samples.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._file: DurableFile | None = None
        self._writer: Any = None
        self._schema: Any = None
        self._pending: list[Any] = []
        self._pending_rows = 0
        self._acknowledged = 0
        self._last_flush = time.monotonic()
        self._closed = False

    @property
    def acknowledged_rows(self) -> int:
        """Samples that are on the disk, whatever happens now."""
        return self._acknowledged

    def append(self, columns: Mapping[str, ArrayLike]) -> None:
        """Append one block of samples.

        Parameters
        ----------
        columns : mapping of str to array, shape (n,), or scalar
            Samples by column; a scalar holds for the whole block.

        Raises
        ------
        RecordError
            Where lengths, columns or types differ from those before, the stream is closed, or
            the disk fails.
        """
        with self._lock:
            if self._closed or (self._file is not None and self._file.failed):
                raise RecordError(f"{self._path} is closed", "samples before the run is sealed")
            batch = self._batch(columns)
            if self._schema is None:
                self._open(batch.schema)
            elif batch.schema != self._schema:
                raise RecordError(
                    f"raw samples with the columns {_described(batch.schema)}",
                    f"{_described(self._schema)}, as at the start of the run",
                )
            self._pending.append(batch)
            self._pending_rows += batch.num_rows
            due = time.monotonic() - self._last_flush >= FLUSH_INTERVAL_S
            if due or self._pending_rows >= FLUSH_ROWS:
                self._flush()

    def flush(self) -> None:
        """Write all samples that are still in memory to the disk."""
        with self._lock:
            self._flush()

    def close(self) -> None:
        """Write what is in memory and end the stream; more calls do nothing."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            self._flush()
            if self._file is None or self._file.failed:
                return
            try:
                self._writer.close()
                self._file.synchronise()
            except OSError as error:
                raise self._file.failure(error) from error
            self._file.close()

    def _batch(self, columns: Mapping[str, ArrayLike]) -> Any:
        arrays = {name: np.asarray(values) for name, values in columns.items()}
        lengths = {array.size for array in arrays.values() if array.ndim == 1}
        if len(lengths) != 1 or any(array.ndim > 1 for array in arrays.values()):
            raise RecordError(
                f"raw columns of lengths {sorted(lengths)}",
                "one-dimensional columns of one length, and scalars",
            )
        n = lengths.pop()
        full: dict[str, NDArray[Any]] = {
            name: np.full(n, array) if array.ndim == 0 else array for name, array in arrays.items()
        }
        return pa.RecordBatch.from_pydict(
            {name: pa.array(np.ascontiguousarray(array)) for name, array in full.items()}
        )

    def _open(self, schema: Any) -> None:
        self._schema = schema
        self._file = DurableFile(self._path)

    def _flush(self) -> None:
        if not self._pending or self._file is None:
            return
        table = pa.Table.from_batches(self._pending).combine_chunks()
        self._pending, self._pending_rows = [], 0
        try:
            if self._writer is None:
                options = pa.ipc.IpcWriteOptions(compression="lz4")
                self._writer = pa.ipc.new_stream(self._file, self._schema, options=options)
            for batch in table.to_batches():
                write_checked(self._writer, batch)
            self._file.synchronise()
        except OSError as error:
            raise self._file.failure(error) from error
        self._acknowledged += table.num_rows
        self._last_flush = time.monotonic()


@dataclass(frozen=True, eq=False)
class RawReading:
    """Raw samples as read back.

    Parameters
    ----------
    columns : mapping of str to array, shape (n,)
        Samples by column, in the order in which they were written.
    torn_bytes : int
        Bytes of an incomplete last block, which are left out; 0 for a stream that was closed.
    damaged : int
        Blocks with a wrong checksum, which are left out, too.
    """

    columns: Mapping[str, NDArray[Any]]
    torn_bytes: int = 0
    damaged: int = 0

    @property
    def rows(self) -> int:
        """Number of samples in each column."""
        return next((column.size for column in self.columns.values()), 0)


def read_raw(folder: Path) -> RawReading:
    """Return the raw samples of a run folder, running, killed or sealed.

    An incomplete last block, as a kill leaves it, is left out and its size reported.

    Raises
    ------
    RecordError
        Where the file isn't an Arrow stream or Parquet file.
    """
    stream, sealed = folder / "raw.arrow", folder / "raw.parquet"
    if sealed.exists():
        try:
            table = pq.read_table(sealed)
        except (pa.ArrowException, OSError) as error:
            raise RecordError(f"{sealed} can't be read: {error}", "a Parquet file") from error
        return RawReading(_columns(table))
    if not stream.exists():
        return RawReading({})
    found = WholeBatches(stream)
    batches = list(found)
    columns = _columns(pa.Table.from_batches(batches)) if batches else {}
    return RawReading(columns, found.torn_bytes, found.damaged)


class WholeBatches:
    """The batches of an Arrow stream that are as they were written, one at a time.

    An incomplete end, as a kill leaves it, is left out; `torn_bytes` tells its size afterwards.
    So is a batch whose checksum is wrong; `damaged` tells how many.

    Parameters
    ----------
    path : pathlib.Path
        The stream, running, killed or closed.

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
                        f"{self._path} can't be read: {error}", "an Arrow stream"
                    ) from error
        self.torn_bytes = size - whole


def write_checked(writer: Any, batch: Any) -> None:
    """Write a batch with a checksum of its values beside it."""
    writer.write_batch(batch, custom_metadata={_CHECKSUM: _digest(batch)})


def _is_as_written(batch: Any, metadata: Any) -> bool:
    try:
        batch.validate(full=True)
        return metadata is not None and metadata.get(_CHECKSUM) == _digest(batch).encode()
    except (pa.ArrowException, ValueError):  # no text in UTF-8 among them
        return False


def _digest(batch: Any) -> str:
    """Return the SHA-256 of a batch's columns and values, however Arrow keeps them in memory."""
    digest = hashlib.sha256(_described(batch.schema).encode("utf-8", "surrogateescape"))
    for column in batch.columns:
        _feed(digest, column)
    return digest.hexdigest()


def _feed(digest: Any, array: Any) -> None:
    digest.update(array.is_valid().to_numpy(zero_copy_only=False).tobytes())
    if pa.types.is_struct(array.type):
        for number in range(array.type.num_fields):
            _feed(digest, array.field(number))
    elif pa.types.is_list(array.type):
        digest.update(repr(array.value_lengths().to_pylist()).encode())
        _feed(digest, array.flatten())
    elif pa.types.is_primitive(array.type):
        digest.update(
            array.fill_null(False if pa.types.is_boolean(array.type) else 0)
            .to_numpy(zero_copy_only=False)
            .tobytes()
        )
    else:  # text and bytes
        for value in array.to_pylist():
            content = value.encode() if isinstance(value, str) else value or b""
            digest.update(f"{len(content)}:".encode())
            digest.update(content)


def _torn_start(path: Path) -> bool:
    """Whether the file begins as an Arrow stream does, so that only its end may be missing.

    Zeros are blocks that a power cut left unwritten.
    """
    with path.open("rb") as file:
        return b"\xff\xff\xff\xff".startswith(file.read(4).rstrip(b"\0"))


def _columns(table: Any) -> dict[str, NDArray[Any]]:
    return {name: table.column(name).to_numpy() for name in table.column_names}


def seal_raw(folder: Path) -> None:
    """Turn the closed stream of a run into a Parquet file with the same rows, if there is one.

    Raises
    ------
    RecordError
        Where the Parquet file doesn't hold the same rows; the stream is kept then.
    """
    stream, sealed = folder / "raw.arrow", folder / "raw.parquet"
    if not stream.exists():
        return
    batches = list(WholeBatches(stream))
    if not batches:
        return
    table = pa.Table.from_batches(batches)
    part = folder / ".raw.parquet.part"
    pq.write_table(table, part, compression="zstd")
    if not _same(pq.read_table(part), table):
        raise RecordError(f"{part} differs from {stream}", "the same samples", "check the disk")
    with part.open("rb") as file:
        os.fsync(file.fileno())
    part.replace(sealed)
    stream.unlink()


def _same(first: Any, second: Any) -> bool:
    """Compare two tables; NaN, which stands where a channel had a fault, equals NaN."""
    if first.schema != second.schema or first.num_rows != second.num_rows:
        return False
    pairs = zip(_columns(first).values(), _columns(second).values(), strict=True)
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in pairs)


def _described(schema: Any) -> str:
    return ", ".join(f"{field.name} ({field.type})" for field in schema)
