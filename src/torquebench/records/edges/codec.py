"""Edge times as second differences of one byte each: small, and exact to the tick.

The period of a transducer's output changes little from pulse to pulse, so the second difference of
its edge times is a few ticks of jitter. A second difference that doesn't fit into a byte (a missing
or doubled pulse, a jump of the clock) is replaced by an escape code and stored separately in full.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import RecordError
from torquebench.message import Message

ESCAPE = -128
"""Code for a second difference that doesn't fit into a byte."""


@dataclass(frozen=True, slots=True, eq=False)
class EncodedEdges:
    """Encoded edge times.

    Parameters
    ----------
    count : int
        Number of edges.
    first_tick : int
        Tick of the first edge; 0 without edges.
    first_period : int
        Ticks from the first edge to the second one; 0 with fewer than two edges.
    differences : ndarray of int8, shape (max(count - 2, 0),)
        Second differences in ticks; `ESCAPE` marks those that are stored in `escaped`.
    escaped : ndarray of int64
        Second differences that don't fit into a byte, in order.
    """

    count: int
    first_tick: int
    first_period: int
    differences: NDArray[np.int8]
    escaped: NDArray[np.int64]


def encode_edges(ticks: NDArray[np.int64]) -> EncodedEdges:
    """Encode edge times; `decode_edges` restores any int64 values exactly.

    Parameters
    ----------
    ticks : ndarray of int64, shape (n,)
        Ticks of the timebase.

    Examples
    --------
    >>> encoded = encode_edges(np.array([1000, 2667, 4333, 6000, 9334]))
    >>> encoded.differences.tolist(), encoded.escaped.tolist()
    ([-1, 1, -128], [1667])
    >>> decode_edges(encoded).tolist()
    [1000, 2667, 4333, 6000, 9334]
    """
    periods = np.diff(ticks)  # int64 overflows here, and decoding's sums overflow back
    differences = np.diff(periods)
    fits = (differences > ESCAPE) & (differences <= np.iinfo(np.int8).max)
    narrow = differences.astype(np.int8)
    escaped = np.empty(0, dtype=np.int64)
    if not fits.all():
        escaped = differences[~fits]
        narrow[~fits] = ESCAPE
    return EncodedEdges(
        ticks.size,
        int(ticks[0]) if ticks.size else 0,
        int(periods[0]) if periods.size else 0,
        narrow,
        escaped,
    )


def decode_edges(encoded: EncodedEdges) -> NDArray[np.int64]:
    """Return the edge times that were encoded.

    Raises
    ------
    RecordError
        Where the numbers of edges, differences and escapes contradict each other.
    """
    count, narrow = encoded.count, encoded.differences
    ticks = np.empty(count, dtype=np.int64)
    places = np.flatnonzero(narrow == ESCAPE)
    if narrow.size != max(count - 2, 0) or places.size != encoded.escaped.size:
        raise RecordError(
            Message(
                "{size} differences with {places_size} escapes for {count} edges",
                narrow.size,
                places.size,
                count,
            ),
            Message(
                "{count} differences with {size} escapes", max(count - 2, 0), encoded.escaped.size
            ),
            "restore the file from a backup",
        )
    if count == 0:
        return ticks
    ticks[0] = encoded.first_tick
    if count > 1:
        steps = ticks[1:]
        steps[0] = encoded.first_period
        steps[1:] = narrow
        steps[1 + places] = encoded.escaped
        np.cumsum(steps, out=steps)
        np.cumsum(ticks, out=ticks)
    return ticks
