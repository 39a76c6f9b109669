"""Export a run's streams for other programs: as CSV, Parquet, HDF5, TDMS or MDF4."""

from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from torquebench.atomic_write import atomic_path
from torquebench.columns import Column, column_of
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records.runs.folder import RunFolder
from torquebench.records.runs.streams import (
    Attributes,
    EdgePiece,
    Samples,
    edge_pieces,
    run_attributes,
    sample_columns,
)

StreamFormat = Literal["csv", "parquet", "hdf5", "tdms", "mdf4"]
Stream = Literal["samples", "edges"]
STREAM_FORMATS: tuple[StreamFormat, ...] = get_args(StreamFormat)

_PACKAGES = {"hdf5": "h5py", "tdms": "nptdms", "mdf4": "asammdf"}
_ENDINGS = {"hdf5": ".h5", "mdf4": ".mf4"}


def stream_ending(file_format: StreamFormat) -> str:
    """Return the file name extension of a format.

    Examples
    --------
    >>> stream_ending("mdf4"), stream_ending("csv")
    ('.mf4', '.csv')
    """
    return _ENDINGS.get(file_format, f".{file_format}")


def export_streams(
    folder: RunFolder, path: Path, file_format: StreamFormat, stream: Stream = "samples"
) -> None:
    """Write one stream of a run to a file, completely or not at all.

    Every format holds the run's attributes and each column's unit: CSV in comment lines before the
    header, Parquet in the metadata of schema and fields, HDF5 as attributes, TDMS as properties
    (`unit_string`), MDF4 in header and channels. Edges are written in pieces, except to MDF4, which
    needs whole channels.

    Parameters
    ----------
    folder : RunFolder
        A run that is running, was killed or is sealed.
    path : pathlib.Path
        File to write; replaced where it exists.
    file_format : {"csv", "parquet", "hdf5", "tdms", "mdf4"}
    stream : {"samples", "edges"}
        Frequency, torque, angle, speed and temperature of every window; or every edge.

    Raises
    ------
    InputError
        The run has no such stream, the format's package isn't installed, or the file can't be
        written.
    """
    package = _PACKAGES.get(file_format)
    if package is not None and find_spec(package) is None:
        raise InputError(
            Message("the format {file_format} without the package {package}", file_format, package),
            "a format whose package is installed",
            Message('install it: pip install "torquebench[{file_format}]"', file_format),
        )
    write_samples, write_edges = _writers(file_format)
    attributes = {**run_attributes(folder), "stream": stream}
    with atomic_path(path, stream_ending(file_format)) as part:
        if stream == "samples":
            write_samples(part, sample_columns(folder), attributes)
        else:
            write_edges(part, edge_pieces(folder), attributes)


SampleWriter = Callable[[Path, Samples, Attributes], None]
EdgeWriter = Callable[[Path, Iterable[EdgePiece], Attributes], None]


def _writers(file_format: StreamFormat) -> tuple[SampleWriter, EdgeWriter]:
    if file_format == "csv":
        return _csv_samples, _csv_edges
    if file_format == "parquet":
        return _parquet_samples, _parquet_edges
    # These modules import packages of an extra.
    if file_format == "hdf5":
        from torquebench.records.export.hdf5 import write_edges, write_samples
    elif file_format == "tdms":
        from torquebench.records.export.tdms import write_edges, write_samples
    else:
        from torquebench.records.export.mdf4 import write_edges, write_samples
    return write_samples, write_edges


def _table(samples: Samples) -> Any:
    arrays = [pa.array(values, from_pandas=True) for values in samples.values()]  # NaN to null
    fields = [
        pa.field(column.name, array.type, metadata=column.attributes)
        for column, array in zip(samples, arrays, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=pa.schema(fields))


def _edge_schema(attributes: Attributes) -> Any:
    types = {
        "channel": pa.string(),
        "edge": pa.string(),
        "tick": pa.int64(),
        "timebase_hz": pa.float64(),
    }
    return pa.schema(
        [pa.field(name, kind, metadata=column_of(name).attributes) for name, kind in types.items()],
        metadata=_text(attributes),
    )


def _edge_batches(pieces: Iterable[EdgePiece], schema: Any) -> Iterator[Any]:
    for piece in pieces:
        count = piece.ticks.size
        values = [
            pa.repeat(piece.channel, count),
            pa.repeat(piece.edge, count),
            pa.array(piece.ticks),
            pa.array(np.full(count, piece.timebase_hz)),
        ]
        yield pa.RecordBatch.from_arrays(values, schema=schema)


def _text(attributes: Attributes) -> dict[str, str]:
    return {name: str(value) for name, value in attributes.items()}


def _csv_comments(attributes: Attributes, columns: Iterable[Column]) -> bytes:
    lines = [f"# {name}: {value}" for name, value in _text(attributes).items()]
    lines += [f"# unit of {column.name}: {column.unit}" for column in columns if column.unit]
    return "".join(line.replace("\n", " ") + "\n" for line in lines).encode()


def _csv_samples(path: Path, samples: Samples, attributes: Attributes) -> None:
    with path.open("wb") as file:
        file.write(_csv_comments(attributes, samples))
        pyarrow.csv.write_csv(_table(samples), file)


def _csv_edges(path: Path, pieces: Iterable[EdgePiece], attributes: Attributes) -> None:
    schema = _edge_schema(attributes)
    with path.open("wb") as file:
        file.write(_csv_comments(attributes, map(column_of, schema.names)))
        with pyarrow.csv.CSVWriter(file, schema) as writer:
            for batch in _edge_batches(pieces, schema):
                writer.write_batch(batch)


def _parquet_samples(path: Path, samples: Samples, attributes: Attributes) -> None:
    table = _table(samples).replace_schema_metadata(_text(attributes))
    pq.write_table(table, path, compression="zstd")


def _parquet_edges(path: Path, pieces: Iterable[EdgePiece], attributes: Attributes) -> None:
    schema = _edge_schema(attributes)
    encodings = {"tick": "DELTA_BINARY_PACKED"}
    with pq.ParquetWriter(
        path,
        schema,
        compression="zstd",
        use_dictionary=["channel", "edge", "timebase_hz"],
        column_encoding=encodings,
    ) as writer:
        for batch in _edge_batches(pieces, schema):
            writer.write_batch(batch)
