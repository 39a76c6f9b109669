"""Every edge of every channel: a delta-encoded Arrow stream while a run goes on."""

import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from torquebench.errors import RecordError
from torquebench.records.durable_file import DurableFile
from torquebench.records.edge_codec import EncodedEdges, decode_edges, encode_edges
from torquebench.records.raw_stream import WholeBatches, write_checked
from torquebench.signals import EdgeBlock

__all__ = ["EdgeStream", "RecordedEdges", "damage_to", "stream_edges"]

FLUSH_INTERVAL_S = 0.5
"""Longest time between two synchronisations while blocks come, s of wall time."""
FLUSH_EDGES = 1_000_000
"""Edges in memory at most: four transducers with 60 kHz make 240 000 a second."""

_ENCODED = [
    ("count", pa.int64()),
    ("first_tick", pa.int64()),
    ("first_period", pa.int64()),
    ("differences", pa.large_binary()),
    ("escaped", pa.list_(pa.int64())),
]
_SCHEMA = pa.schema(
    [
        ("channel", pa.string()),
        ("timebase_hz", pa.float64()),
        ("start_tick", pa.int64()),
        ("stop_tick", pa.int64()),
        ("rising", pa.struct(_ENCODED)),
        ("falling", pa.struct(_ENCODED)),
    ],
    metadata={"torquebench.encoding": "second differences of one byte, -128 escapes"},
)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedEdges:
    """One block of one channel as it was recorded."""

    channel: str
    block: EdgeBlock


class EdgeStream:
    """Appends blocks of edges to an Arrow IPC stream that survives a kill at any moment.

    Blocks are on the disk at the latest with the first call after `FLUSH_INTERVAL_S`, together:
    what `acknowledged_tick` tells is what was synchronised with the disk, of all channels. Calls
    may come from any thread.

    Parameters
    ----------
    path : pathlib.Path
        File to write; it appears with the first block.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._file: DurableFile | None = None
        self._writer: Any = None
        self._pending: list[dict[str, Any]] = []
        self._pending_edges = 0
        self._pending_tick: int | None = None
        self._acknowledged: int | None = None
        self._last_flush = time.monotonic()
        self._closed = False

    @property
    def acknowledged_tick(self) -> int | None:
        """Tick up to which all channels are on the disk, itself not included; None at first."""
        return self._acknowledged

    def append(self, blocks: Mapping[str, EdgeBlock]) -> None:
        """Append the blocks of one interval.

        Parameters
        ----------
        blocks : mapping of channel name to EdgeBlock
            A channel without edges has a block without edges: that it was silent is kept, too.

        Raises
        ------
        RecordError
            Where the stream is closed or the disk fails; nothing can be appended after that.
        """
        with self._lock:
            if self._closed or (self._file is not None and self._file.failed):
                raise RecordError(f"{self._path} is closed", "edges before the run is sealed")
            for channel, block in blocks.items():
                self._pending.append(_row(channel, block))
                self._pending_edges += len(block)
                stop = block.stop_tick
                self._pending_tick = max(stop, self._pending_tick or stop)
            due = time.monotonic() - self._last_flush >= FLUSH_INTERVAL_S
            if due or self._pending_edges >= FLUSH_EDGES:
                self._flush()

    def flush(self) -> None:
        """Write everything that is still in memory to the disk."""
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

    def _flush(self) -> None:
        if not self._pending:
            return
        batch = pa.RecordBatch.from_pylist(self._pending, schema=_SCHEMA)
        tick = self._pending_tick
        self._pending, self._pending_edges, self._pending_tick = [], 0, None
        if self._file is None:
            self._file = DurableFile(self._path)
        try:
            if self._writer is None:
                options = pa.ipc.IpcWriteOptions(compression="zstd", use_threads=False)
                self._writer = pa.ipc.new_stream(self._file, _SCHEMA, options=options)
            write_checked(self._writer, batch)
            self._file.synchronise()
        except OSError as error:
            raise self._file.failure(error) from error
        self._acknowledged = tick
        self._last_flush = time.monotonic()


def stream_edges(path: Path) -> Iterator[RecordedEdges]:
    """Yield the blocks of a stream in the order in which they were appended.

    An incomplete end, as a kill leaves it, is left out; see `WholeBatches`.
    """
    for batch in WholeBatches(path):
        for row in batch.to_pylist():
            yield RecordedEdges(row["channel"], _block(row))


def damage_to(path: Path) -> tuple[int, int]:
    """Return the size of a stream's incomplete end, bytes, and how many of its blocks are damaged.

    Both are 0 where it is whole or doesn't exist.
    """
    if not path.exists():
        return 0, 0
    batches = WholeBatches(path)
    for _ in batches:
        pass
    return batches.torn_bytes, batches.damaged


def _row(channel: str, block: EdgeBlock) -> dict[str, Any]:
    falling = block.falling_ticks
    return {
        "channel": channel,
        "timebase_hz": block.timebase_hz,
        "start_tick": block.start_tick,
        "stop_tick": block.stop_tick,
        "rising": _encoded(block.ticks),
        "falling": None if falling is None else _encoded(falling),
    }


def _encoded(ticks: NDArray[np.int64]) -> dict[str, Any]:
    encoded = encode_edges(ticks)
    return {
        "count": encoded.count,
        "first_tick": encoded.first_tick,
        "first_period": encoded.first_period,
        "differences": encoded.differences.tobytes(),
        "escaped": encoded.escaped,
    }


def _decoded(parts: dict[str, Any]) -> NDArray[np.int64]:
    return decode_edges(
        EncodedEdges(
            parts["count"],
            parts["first_tick"],
            parts["first_period"],
            np.frombuffer(parts["differences"], dtype=np.int8),
            np.asarray(parts["escaped"], dtype=np.int64),
        )
    )


def _block(row: dict[str, Any]) -> EdgeBlock:
    falling = row["falling"]
    return EdgeBlock(
        _decoded(row["rising"]),
        row["start_tick"],
        row["stop_tick"],
        row["timebase_hz"],
        None if falling is None else _decoded(falling),
    )
