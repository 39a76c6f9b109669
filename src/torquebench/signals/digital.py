"""Raw digital samples to edges: bit-packed or one byte per sample."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.signals._digital_kernels import CHUNK, MOST_PER_WORD, find_transitions
from torquebench.signals.edges import EdgeBlock

__all__ = ["BitOrder", "DigitalInput", "edges_of_bits", "edges_of_bytes"]

BitOrder = Literal["lowest first", "highest first"]

_BYTES_PER_WORD = 8


class DigitalInput:
    """Digital samples of one channel as a stream of edge blocks.

    An edge's tick is the number of the first sample at the new level, so the sample rate is
    the timebase. The level before the first sample is that of the first sample.

    Parameters
    ----------
    sample_rate_hz : float
        Samples per second.
    bit_order : {"lowest first", "highest first"}
        Which bit of a byte is its first sample, for packed samples.

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
            raise InputError(f"sample rate {sample_rate_hz} Hz", "a frequency above 0 Hz")
        if bit_order not in ("lowest first", "highest first"):
            raise InputError(f"bit order {bit_order!r}", "'lowest first' or 'highest first'")
        self.sample_rate_hz = float(sample_rate_hz)
        self._highest_first = bit_order == "highest first"
        self._flags = np.zeros(CHUNK, dtype=np.uint8)
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
        return self._push(_row_of_bytes(packed), self._highest_first)

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
            raise InputError(f"channel {channel}", "a bit of the byte, 0 to 7")
        level = _row_of_bytes(samples) & np.uint8(1 << channel)
        packed = np.packbits(level, bitorder="little")
        return self._push(packed, highest_first=False, samples=level.size)

    def _push(
        self, packed: NDArray[np.uint8], highest_first: bool, samples: int | None = None
    ) -> EdgeBlock:
        count = 8 * packed.size if samples is None else samples
        start = self._samples
        self._samples += count
        if not count:
            none = np.empty(0, dtype=np.int64)
            return EdgeBlock(none, start, start, self.sample_rate_hz, none)
        before = _bit(packed, 0, highest_first) if self._level is None else self._level
        self._level = _bit(packed, count - 1, highest_first)
        words = _as_words(packed, count, self._level)
        first, second = _transitions(words, before, highest_first, start, self._flags)
        rising, falling = (second, first) if before else (first, second)
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
        raise InputError(f"samples with {array.ndim} dimensions", "one row")
    if array.dtype == np.bool_ or not array.size:
        return array.astype(np.uint8)
    if not np.issubdtype(array.dtype, np.integer) or (
        array.dtype != np.uint8 and (array.min() < 0 or array.max() > 255)
    ):
        raise InputError(f"samples of type {array.dtype}", "bytes, 0 to 255")
    return np.ascontiguousarray(array, dtype=np.uint8)


def _bit(packed: NDArray[np.uint8], sample: int, highest_first: bool) -> bool:
    place = 7 - sample % 8 if highest_first else sample % 8
    return bool((int(packed[sample // 8]) >> place) & 1)


def _as_words(packed: NDArray[np.uint8], count: int, last_level: bool) -> NDArray[np.uint64]:
    """Whole words; what is missing at the end repeats the last level, which makes no edge.

    Only samples that came one in a byte leave a byte half full; those are packed lowest first.
    """
    whole = count // (8 * _BYTES_PER_WORD) * _BYTES_PER_WORD
    if whole == packed.size and packed.ctypes.data % _BYTES_PER_WORD == 0:
        return packed.view("<u8")
    size = -(-packed.size // _BYTES_PER_WORD) * _BYTES_PER_WORD
    padded = np.full(size, 0xFF if last_level else 0, dtype=np.uint8)
    padded[: packed.size] = packed
    if count % 8 and last_level:
        padded[packed.size - 1] |= 0xFF & ~((1 << count % 8) - 1)
    return padded.view("<u8")


def _transitions(
    words: NDArray[np.uint64],
    before: bool,
    highest_first: bool,
    offset: int,
    flags: NDArray[np.uint8],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Find changes of the level: the first, third, fifth … and those between."""
    level = np.uint64(2**64 - 1 if before else 0)
    # Room for one change per word, but for several in a short record; memory that isn't
    # touched costs nothing.
    room = words.size // 2 + CHUNK * MOST_PER_WORD
    parts: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    word = total = 0
    while word < words.size:
        found = np.empty((2, room), dtype=np.int64)
        count, after = find_transitions(words, word, level, highest_first, offset, flags, found)
        pair = found[0, : (count + 1) // 2], found[1, : count // 2]
        parts.append(pair if total % 2 == 0 else pair[::-1])
        total += count
        if after < words.size:
            last = words[after - 1]
            level = np.uint64(int(last.byteswap() if highest_first else last))
            room = (words.size - after) * MOST_PER_WORD // 2
        word = after
    if len(parts) == 1:
        return parts[0]
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
