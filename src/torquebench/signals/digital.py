"""Raw digital samples to edges: bit-packed or one byte per sample."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals.edges import EdgeBlock

__all__ = ["BitOrder", "DigitalInput", "edges_of_bits", "edges_of_bytes"]

BitOrder = Literal["lowest first", "highest first"]

_BitOrder = Literal["big", "little"]
"""Data type of NumPy."""


class DigitalInput:
    """Digital samples of one channel as a stream of edge blocks.

    An edge's tick is the number of the first sample at the new level, so the sample rate is
    the timebase. The level before the first sample is that of the first sample.

    Parameters
    ----------
    sample_rate_hz : float
        Samples per second.
    bit_order : {"lowest first", "highest first"}
        The bit of a byte that is its first sample, for packed samples.

    Examples
    --------
    >>> stream = DigitalInput(24e6)
    >>> block = stream.push_bytes([0, 0, 1, 1, 1, 0])
    >>> block.ticks, block.falling_ticks
    (array([2]), array([5]))
    >>> stream.push_bytes([1, 1]).ticks
    array([6])
    """

    def __init__(self, sample_rate_hz: float, bit_order: BitOrder = "lowest first") -> None:
        if not (np.isfinite(sample_rate_hz) and sample_rate_hz > 0):
            raise InputError(
                Message("sample rate {sample_rate_hz} Hz", sample_rate_hz), "a frequency above 0 Hz"
            )
        if bit_order not in ("lowest first", "highest first"):
            raise InputError(
                Message("bit order {bit_order!r}", bit_order), "'lowest first' or 'highest first'"
            )
        self.sample_rate_hz = float(sample_rate_hz)
        self._order: _BitOrder = "big" if bit_order == "highest first" else "little"
        self._samples = 0
        self._level: bool | None = None

    def push_bits(self, packed: ArrayLike) -> EdgeBlock:
        """Take the next samples, eight in a byte.

        Parameters
        ----------
        packed : array_like of uint8, shape (n,), or bytes
            8·n samples.

        Raises
        ------
        InputError
            When the array isn't a row of bytes.
        """
        return self._push(_row_of_bytes(packed), self._order)

    def push_bytes(self, samples: ArrayLike, channel: int = 0) -> EdgeBlock:
        """Take the next samples, one in a byte.

        Parameters
        ----------
        samples : array_like of uint8, shape (n,), or bytes
            Samples; each byte holds up to eight channels.
        channel : int
            Bit of the byte that is the channel, 0 to 7.

        Raises
        ------
        InputError
            When the array isn't a row of bytes, or the channel isn't a bit of one.
        """
        if channel not in range(8):
            raise InputError(Message("channel {channel}", channel), "a bit of the byte, 0 to 7")
        level = _row_of_bytes(samples) & np.uint8(1 << channel)
        packed = np.packbits(level, bitorder="little")
        return self._push(packed, "little", samples=level.size)

    def _push(
        self, packed: NDArray[np.uint8], order: _BitOrder, samples: int | None = None
    ) -> EdgeBlock:
        count = 8 * packed.size if samples is None else samples
        start = self._samples
        self._samples += count
        if not count:
            none = np.empty(0, dtype=np.int64)
            return EdgeBlock(none, start, start, self.sample_rate_hz, none)
        level = _level_of(packed[:1], 0, order) if self._level is None else self._level
        self._level = _level_of(packed, count - 1, order)
        changes = _changes(packed, level, order)
        changes = start + changes[: changes.searchsorted(count)]
        first, second = changes[0::2].copy(), changes[1::2].copy()
        rising, falling = (second, first) if level else (first, second)
        return EdgeBlock(rising, start, self._samples, self.sample_rate_hz, falling)


def edges_of_bits(
    packed: ArrayLike, sample_rate_hz: float, bit_order: BitOrder = "lowest first"
) -> EdgeBlock:
    """Edges of one recording of bit-packed samples; see `DigitalInput`.

    Examples
    --------
    >>> edges_of_bits(np.array([0b11110000, 0b00001111], dtype=np.uint8), 1e6).ticks
    array([4])
    """
    return DigitalInput(sample_rate_hz, bit_order).push_bits(packed)


def edges_of_bytes(samples: ArrayLike, sample_rate_hz: float, channel: int = 0) -> EdgeBlock:
    """Edges of one channel of a recording with one byte per sample; see `DigitalInput`.

    Examples
    --------
    >>> edges_of_bytes([4, 0, 4, 4, 0, 4], 1e6, channel=2).ticks
    array([2, 5])
    """
    return DigitalInput(sample_rate_hz).push_bytes(samples, channel)


def _row_of_bytes(samples: ArrayLike) -> NDArray[np.uint8]:
    if isinstance(samples, bytes | bytearray | memoryview):
        return np.frombuffer(samples, dtype=np.uint8)
    array = np.asarray(samples)
    if array.ndim != 1:
        raise InputError(Message("samples with {ndim} dimensions", array.ndim), "one row")
    if array.dtype == np.bool_ or not array.size:
        return array.astype(np.uint8)
    if not np.issubdtype(array.dtype, np.integer) or (
        array.dtype != np.uint8 and (array.min() < 0 or array.max() > 255)
    ):
        raise InputError(Message("samples of type {dtype}", array.dtype), "bytes, 0 to 255")
    return np.ascontiguousarray(array, dtype=np.uint8)


def _level_of(packed: NDArray[np.uint8], sample: int, order: _BitOrder) -> bool:
    byte = packed[sample // 8 : sample // 8 + 1]
    return bool(np.unpackbits(byte, bitorder=order)[sample % 8])


def _changes(packed: NDArray[np.uint8], before: bool, order: _BitOrder) -> NDArray[np.int64]:
    """Find the samples at which the level differs from the sample before."""
    previous = np.empty_like(packed)
    previous[:1], previous[1:] = 255 if before else 0, packed[:-1]
    uniform = (packed == 0) | (packed == 255)
    places = np.flatnonzero((packed != previous) | ~uniform)  # unpacks only these few
    bits = np.unpackbits(packed[places, None], axis=1, bitorder=order)
    last = np.unpackbits(previous[places, None], axis=1, bitorder=order)[:, -1:]
    row, bit = np.nonzero(np.diff(np.hstack([last, bits]), axis=1))
    return np.asarray(8 * places[row] + bit, dtype=np.int64)
