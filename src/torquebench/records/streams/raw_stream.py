"""The raw samples of a run: an Arrow stream while it runs, a Parquet file when it is sealed."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import ArrayLike, NDArray

from torquebench.columns import column_of
from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.streams.arrow_stream import (
    ArrowStream,
    WholeBatches,
    described_schema,
    seal_stream,
)
from torquebench.tables import numbers_of


class RawStream(ArrowStream):
    """Appends columns of samples, each with its unit and description.

    The first call fixes columns and types.
    """

    CONTENT, CAPACITY, COMPRESSION = "samples", 20_000, "lz4"

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._schema: Any = None
        self._rows = 0
        self._acknowledged = 0

    @property
    def acknowledged_rows(self) -> int:
        """Number of samples that are safely on the disk."""
        return self._acknowledged

    def append(self, columns: Mapping[str, ArrayLike]) -> None:
        """Append one block of samples.

        Parameters
        ----------
        columns : mapping of str to array, shape (n,), or scalar
            Samples by column; a scalar applies to the whole block.

        Raises
        ------
        RecordError
            Where lengths, columns or types differ from those before, the stream is closed, or
            the disk fails.
        """
        with self._appending():
            batch = self._batch(columns)
            if self._schema is None:
                self._schema = _with_units(batch.schema)
            elif batch.schema != self._schema:
                raise RecordError(
                    Message(
                        "raw samples with the columns {described_schema}",
                        described_schema(batch.schema),
                    ),
                    Message(
                        "{described_schema}, as at the start of the run",
                        described_schema(self._schema),
                    ),
                )
            self._pending.append(pa.RecordBatch.from_arrays(batch.columns, schema=self._schema))
            self._pending_size += batch.num_rows
            self._rows += batch.num_rows

    def _batches(self, pending: list[Any]) -> Iterable[Any]:
        batches: list[Any] = pa.Table.from_batches(pending).combine_chunks().to_batches()
        return batches

    def _acknowledge(self) -> None:
        self._acknowledged = self._rows

    def _batch(self, columns: Mapping[str, ArrayLike]) -> Any:
        arrays = {name: np.asarray(values) for name, values in columns.items()}
        lengths = {array.size for array in arrays.values() if array.ndim == 1}
        if len(lengths) != 1 or any(array.ndim > 1 for array in arrays.values()):
            raise RecordError(
                Message("raw columns of lengths {lengths}", sorted(lengths)),
                "one-dimensional columns of one length, and scalars",
            )
        n = lengths.pop()
        full: dict[str, NDArray[Any]] = {
            name: np.full(n, array) if array.ndim == 0 else array for name, array in arrays.items()
        }
        return pa.RecordBatch.from_pydict({name: _arrow(array) for name, array in full.items()})


def _with_units(schema: Any) -> Any:
    return pa.schema(
        [field.with_metadata(column_of(field.name, samples=True).attributes) for field in schema]
    )


def _arrow(array: NDArray[Any]) -> Any:
    """Return numbers as an Arrow array without calling `pyarrow.array`, which imports pandas."""
    if array.dtype.kind not in "biuf" or not array.dtype.isnative:
        return pa.array(np.ascontiguousarray(array))
    bits = array.dtype.kind == "b"
    values = np.packbits(array, bitorder="little") if bits else np.ascontiguousarray(array)
    buffers = [None, pa.py_buffer(values)]
    return pa.Array.from_buffers(pa.from_numpy_dtype(array.dtype), array.size, buffers, 0)


@dataclass(frozen=True, eq=False)
class RawReading:
    """Raw samples read from a run folder.

    Parameters
    ----------
    columns : mapping of str to array, shape (n,)
        Samples by column, in the order in which they were written.
    torn_bytes : int
        Size of an incomplete last block, which is skipped, in bytes; 0 for a closed stream.
    damaged : int
        Number of blocks with a wrong checksum, which are skipped, too.
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

    An incomplete last block, as after a kill, is skipped and its size reported.

    Raises
    ------
    RecordError
        Where the file isn't an Arrow stream or Parquet file.
    """
    stream, sealed = folder / "raw.arrow", folder / "raw.parquet"
    if sealed.exists():
        try:
            table = pq.ParquetFile(sealed).read()
        except (pa.ArrowException, OSError) as error:
            raise RecordError(
                Message("{path} can't be read: {problem}", sealed, error), "a Parquet file"
            ) from error
        return RawReading(_columns(table))
    if not stream.exists():
        return RawReading({})
    found = WholeBatches(stream)
    batches = list(found)
    columns = _columns(pa.Table.from_batches(batches)) if batches else {}
    return RawReading(columns, found.torn_bytes, found.damaged)


def _columns(table: Any) -> dict[str, NDArray[Any]]:
    return {
        name: np.concatenate([numbers_of(chunk) for chunk in table.column(name).chunks])
        if table.num_rows
        else table.column(name).to_numpy()
        for name in table.column_names
    }


def seal_raw(folder: Path) -> None:
    """Convert the closed sample stream of a run, if it has one, into a Parquet file.

    Raises
    ------
    RecordError
        Where the Parquet file doesn't contain the same rows; the stream is then kept.
    """
    stream, sealed = folder / "raw.arrow", folder / "raw.parquet"
    if not stream.exists():
        return
    batches = list(WholeBatches(stream))
    if not batches:
        return
    table = pa.Table.from_batches(batches)
    seal_stream(
        stream,
        sealed,
        lambda path: pq.write_table(table, path, compression="zstd"),
        lambda path: _same(pq.ParquetFile(path).read(), table),
    )


def _same(first: Any, second: Any) -> bool:
    """Compare two tables; NaN, which stands for a fault, equals NaN."""
    if first.schema != second.schema or first.num_rows != second.num_rows:
        return False
    pairs = zip(_columns(first).values(), _columns(second).values(), strict=True)
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in pairs)
