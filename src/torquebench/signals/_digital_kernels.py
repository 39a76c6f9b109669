"""Hot loop of edge finding in bit-packed samples."""

import numpy as np
from numba import int64, njit, uint64

from torquebench.signals._processor import (
    byte_swap,
    leading_zeros,
    prefetch,
    trailing_zeros,
)

__all__ = ["CHUNK", "MOST_PER_WORD", "find_transitions"]

# Words looked at in one go, and distance of the prefetch: a few kilobytes of the first cache.
CHUNK = 1024
_AHEAD = 2048
MOST_PER_WORD = 64
_WORDS_PER_GROUP = 8


@njit(cache=True)
def _changes(word, before, highest_first):  # type: ignore[no-untyped-def] # Numba infers
    """Bits of a word that differ from the sample before them."""
    if highest_first:
        return word ^ ((word >> uint64(1)) | (before << uint64(63)))
    return word ^ ((word << uint64(1)) | (before >> uint64(63)))


@njit(cache=True)
def _flag_words(words, low, high, before, flags):  # type: ignore[no-untyped-def] # Numba infers
    """Flag words in which the level changes, lowest bit first, without a branch."""
    word = words[low]
    flags[0] = (word ^ ((word << uint64(1)) | (before >> uint64(63)))) != uint64(0)
    earlier = words[low : high - 1]
    later = words[low + 1 : high]
    rest = flags[1 : high - low]
    for i in range(later.size):
        word = later[i]
        rest[i] = (word ^ ((word << uint64(1)) | (earlier[i] >> uint64(63)))) != uint64(0)


@njit(cache=True)
def _flag_swapped_words(words, low, high, before, flags):  # type: ignore[no-untyped-def] # Numba infers
    """Flag words likewise, highest bit of the first byte first."""
    word = byte_swap(words[low])
    flags[0] = (word ^ ((word >> uint64(1)) | (before << uint64(63)))) != uint64(0)
    earlier = words[low : high - 1]
    later = words[low + 1 : high]
    rest = flags[1 : high - low]
    for i in range(later.size):
        word = byte_swap(later[i])
        last = byte_swap(earlier[i])
        rest[i] = (word ^ ((word >> uint64(1)) | (last << uint64(63)))) != uint64(0)


@njit(cache=True)
def find_transitions(  # type: ignore[no-untyped-def] # Numba infers
    words, first, before, highest_first, offset, flags, up_and_down
):
    """Find the samples at which the level differs from the sample before.

    Parameters
    ----------
    words : uint64 array, shape (n,)
        64 samples each, as they lie in memory (lowest address, lowest byte first).
    first : int
        Word to begin with.
    before : uint64
        Word before that one, or one whose last sample has the level before the stream.
    highest_first : bool
        True where a byte's highest bit is its first sample.
    offset : int
        Number of the first sample of word 0.
    flags : uint8 array, shape (CHUNK,)
        Scratch.
    up_and_down : int64 array, shape (2, m)
        Result: sample numbers of the first, third, fifth … change, and of those between.

    Returns
    -------
    count, word
        How many were found, and the word to go on with when there was no more room.
    """
    groups = flags.view(np.uint64)
    room = 2 * up_and_down.shape[1]
    count = 0
    low = first
    while low < words.size:
        high = min(low + CHUNK, words.size)
        if room - count < (high - low) * MOST_PER_WORD:
            # Only what surely fits: a chunk of noise may change at every sample.
            high = min(high, low + (room - count) // MOST_PER_WORD)
            if high <= low:
                return count, low
        if highest_first:
            _flag_swapped_words(words, low, high, before, flags)
        else:
            _flag_words(words, low, high, before, flags)
        used = (high - low + _WORDS_PER_GROUP - 1) // _WORDS_PER_GROUP
        flags[high - low : used * _WORDS_PER_GROUP] = 0
        for group in range(used):
            prefetch(words, low + group * _WORDS_PER_GROUP + _AHEAD)
            marked = groups[group]
            while marked:
                place = low + group * _WORDS_PER_GROUP
                place += int64(trailing_zeros(marked) >> uint64(3))
                marked &= marked - uint64(1)
                word = words[place]
                last = before if place == low else words[place - 1]
                if highest_first:
                    if place != low:
                        last = byte_swap(last)
                    changes = _changes(byte_swap(word), last, True)
                    while changes:
                        bit = leading_zeros(changes)
                        up_and_down[count & 1, count >> 1] = offset + place * 64 + int64(bit)
                        count += 1
                        changes ^= uint64(1) << (uint64(63) - bit)
                else:
                    changes = _changes(word, last, False)
                    while changes:
                        bit = trailing_zeros(changes)
                        up_and_down[count & 1, count >> 1] = offset + place * 64 + int64(bit)
                        count += 1
                        changes &= changes - uint64(1)
        before = byte_swap(words[high - 1]) if highest_first else words[high - 1]
        low = high
    return count, words.size
