"""Every edge of every channel: a delta-encoded Arrow stream during a run."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from torquebench.records.edges.codec import EncodedEdges, decode_edges, encode_edges
from torquebench.records.streams.arrow_stream import ArrowStream, WholeBatches
from torquebench.signals import EdgeBlock

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
    ],
    metadata={"torquebench.encoding": "second differences of one byte, -128 escapes"},
)


@dataclass(frozen=True, slots=True, eq=False)
class RecordedEdges:
    """One recorded block of one channel."""

    channel: str
    block: EdgeBlock


class EdgeStream(ArrowStream):
    """Appends blocks of edges; all channels' edges before `acknowledged_tick` are on the disk."""

    CONTENT, COMPRESSION = "edges", "zstd"
    CAPACITY = 1_000_000  # four transducers at 60 kHz give 240 000 a second

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self._tick: int | None = None
        self._acknowledged: int | None = None

    @property
    def acknowledged_tick(self) -> int | None:
        """Tick before which the edges of all channels are on the disk; None before any write."""
        return self._acknowledged

    def append(self, blocks: Mapping[str, EdgeBlock]) -> None:
        """Append the blocks of one interval.

        Parameters
        ----------
        blocks : mapping of channel name to EdgeBlock
            A channel without edges gets an empty block, which records that it had no pulses.

        Raises
        ------
        RecordError
            Where the stream is closed or the disk fails; nothing can be appended after that.
        """
        with self._appending():
            for channel, block in blocks.items():
                self._pending.append(_row(channel, block))
                self._pending_size += len(block)
                self._tick = max(block.stop_tick, self._tick or block.stop_tick)

    def _batches(self, pending: list[Any]) -> Iterable[Any]:
        return [pa.RecordBatch.from_pylist(pending, schema=_SCHEMA)]

    def _acknowledge(self) -> None:
        self._acknowledged = self._tick


def stream_edges(path: Path) -> Iterator[RecordedEdges]:
    """Yield the blocks of a stream in the order in which they were appended.

    An incomplete end, as after a kill, is skipped; see `WholeBatches`.
    """
    for batch in WholeBatches(path):
        for row in batch.to_pylist():
            yield RecordedEdges(row["channel"], _block(row))


def damage_to(path: Path) -> tuple[int, int]:
    """Return the size of a stream's incomplete end in bytes, and its number of damaged blocks.

    Both are 0 if the stream is intact or doesn't exist.
    """
    if not path.exists():
        return 0, 0
    batches = WholeBatches(path)
    for _ in batches:
        pass
    return batches.torn_bytes, batches.damaged


def _row(channel: str, block: EdgeBlock) -> dict[str, Any]:
    return {
        "channel": channel,
        "timebase_hz": block.timebase_hz,
        "start_tick": block.start_tick,
        "stop_tick": block.stop_tick,
        "rising": _encoded(block.ticks),
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
    return EdgeBlock(
        _decoded(row["rising"]),
        row["start_tick"],
        row["stop_tick"],
        row["timebase_hz"],
    )
