"""The edges of a sealed run: a Parquet file of plain ticks that any tool can read."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from torquebench.errors import RecordError
from torquebench.message import Message
from torquebench.records.edges.stream import RecordedEdges, stream_edges
from torquebench.records.files import EDGE_STREAM
from torquebench.records.streams.arrow_stream import seal_stream
from torquebench.signals import EdgeBlock

EDGE_ARCHIVE = "edges.parquet"
"""Name of the sealed edges in a run's folder."""
GROUP_EDGES = 2_000_000
"""Edges per row group; this bounds the memory needed for sealing and reading."""

_TICKS = pa.list_(pa.int64())
_SCHEMA = pa.schema(
    [
        ("channel", pa.string()),
        ("timebase_hz", pa.float64()),
        ("start_tick", pa.int64()),
        ("stop_tick", pa.int64()),
        ("rising_ticks", _TICKS),
    ],
    metadata={
        "torquebench.edges": "one row a block: edges of a channel in [start_tick, stop_tick), "
        "in ticks of timebase_hz since its start"
    },
)
# Parquet's own delta encoding: as small as the stream, and readable by any tool.
_ENCODING = {
    "rising_ticks.list.element": "DELTA_BINARY_PACKED",
    "channel": "PLAIN",
    "timebase_hz": "PLAIN",
    "start_tick": "DELTA_BINARY_PACKED",
    "stop_tick": "DELTA_BINARY_PACKED",
}


def seal_edges(folder: Path) -> None:
    """Convert the closed edge stream of a run, if it has one, into a Parquet file.

    Memory stays bounded however long the run was.

    Raises
    ------
    RecordError
        Where the Parquet file doesn't contain the same edges; the stream is then kept.
    """
    stream, sealed = folder / EDGE_STREAM, folder / EDGE_ARCHIVE
    if not stream.exists():
        return

    def write(path: Path) -> None:
        with pq.ParquetWriter(
            path, _SCHEMA, compression="zstd", use_dictionary=False, column_encoding=_ENCODING
        ) as writer:
            for group in _groups(stream_edges(stream)):
                writer.write_batch(group)

    seal_stream(
        stream, sealed, write, lambda path: _same_blocks(stream_edges(stream), _archived(path))
    )


def read_edges(folder: Path) -> Iterator[RecordedEdges]:
    """Yield the edges of a run folder, running, killed or sealed, block by block.

    An incomplete end, as after a kill, is left out. Memory stays bounded.

    Raises
    ------
    RecordError
        If the file isn't a valid archive.
    """
    if (folder / EDGE_ARCHIVE).exists():
        yield from _archived(folder / EDGE_ARCHIVE)
    elif (folder / EDGE_STREAM).exists():
        yield from stream_edges(folder / EDGE_STREAM)


def _groups(recorded: Iterable[RecordedEdges]) -> Iterator[Any]:
    rows: list[dict[str, Any]] = []
    edges = 0
    for each in recorded:
        block = each.block
        rows.append(
            {
                "channel": each.channel,
                "timebase_hz": block.timebase_hz,
                "start_tick": block.start_tick,
                "stop_tick": block.stop_tick,
                "rising_ticks": block.ticks,
            }
        )
        edges += len(block)
        if edges >= GROUP_EDGES:
            yield pa.RecordBatch.from_pylist(rows, schema=_SCHEMA)
            rows, edges = [], 0
    if rows:
        yield pa.RecordBatch.from_pylist(rows, schema=_SCHEMA)


def _archived(path: Path) -> Iterator[RecordedEdges]:
    try:
        with pq.ParquetFile(path) as file:
            for group in range(file.num_row_groups):
                for batch in file.read_row_group(group).to_batches():
                    yield from _rows(batch)
    except (pa.ArrowException, OSError) as error:
        raise RecordError(
            Message("{path} can't be read: {problem}", path, error), "a Parquet file of edges"
        ) from error


def _rows(batch: Any) -> Iterator[RecordedEdges]:
    columns = [batch.column(name) for name in _SCHEMA.names]
    for row in range(batch.num_rows):
        channel, timebase, start, stop, rising = (column[row] for column in columns)
        yield RecordedEdges(
            channel.as_py(),
            EdgeBlock(
                rising.values.to_numpy(),
                start.as_py(),
                stop.as_py(),
                timebase.as_py(),
            ),
        )


def _same_blocks(first: Iterable[RecordedEdges], second: Iterable[RecordedEdges]) -> bool:
    """Return whether two recordings consist of equal blocks of edges."""
    try:
        return all(_equal(a, b) for a, b in zip(first, second, strict=True))
    except ValueError:  # one of them is shorter
        return False


def _equal(first: RecordedEdges, second: RecordedEdges) -> bool:
    a, b = first.block, second.block
    return (first.channel, a.timebase_hz, a.start_tick, a.stop_tick) == (
        second.channel,
        b.timebase_hz,
        b.start_tick,
        b.stop_tick,
    ) and np.array_equal(a.ticks, b.ticks)
