"""Hot loops of the counters.

Every counter is a quotient of two integers: a numerator in ticks and a denominator in edges,
summed relative to the window's start, so that a result depends on nothing but the edges in its
window and is the same to the last bit however the stream was cut. Integer sums over slices
also vectorise, where the same loop over floats must keep its order and runs eight times slower.
"""

import numpy as np
from numba import int64, njit

from torquebench.signals._prefetch import prefetch

__all__ = ["GATED", "RECIPROCAL", "REGRESSION", "SUSPECT", "TRIANGULAR", "count", "frequencies"]

GATED, RECIPROCAL, REGRESSION, TRIANGULAR = 0, 1, 2, 3
# A window whose pulse train is irregular; it is looked at more closely outside the hot loop.
SUSPECT = 255
# Edges per look-ahead for irregular intervals, and distance of the prefetch: a few kilobytes,
# well inside the first cache, and far enough ahead of the memory's latency.
_CHUNK = 512
_AHEAD = 2048
_EDGES_PER_CACHE_LINE = 8


@njit(cache=True)
def _interval_range(ticks, low, high):  # type: ignore[no-untyped-def]
    shortest = int64(2**62)
    longest = int64(-(2**62))
    before = ticks[low - 1 : high - 1]
    after = ticks[low:high]
    for i in range(after.size):
        interval = after[i] - before[i]
        shortest = min(shortest, interval)
        longest = max(longest, interval)
    return shortest, longest


@njit(cache=True)
def _first_at_or_after(ticks, guess, tick):  # type: ignore[no-untyped-def]
    i = min(guess, ticks.size)
    while i < ticks.size and ticks[i] < tick:
        i += 1
    while i > 0 and ticks[i - 1] >= tick:
        i -= 1
    return i


@njit(cache=True)
def _irregular(ticks, low, high, stop):  # type: ignore[no-untyped-def]
    for i in range(max(low, 2), high):
        interval = ticks[i] - ticks[i - 1]
        previous = ticks[i - 1] - ticks[i - 2]
        if 2 * interval > 3 * previous or 3 * interval < 2 * previous:
            return True
    return high > 1 and 2 * (stop - ticks[high - 1]) > 3 * (ticks[high - 1] - ticks[high - 2])


@njit(cache=True)
def _quotient(ticks, base, stop, method):  # type: ignore[no-untyped-def]
    n = ticks.size
    if method == REGRESSION:
        first_moment = int64(0)
        total = int64(0)
        for i in range(n):
            offset = ticks[i] - base
            total += offset
            first_moment += offset * i
        return 2 * first_moment - (n - 1) * total, n * (n * n - 1)
    if method == TRIANGULAR:
        half = n // 2
        early = int64(0)
        late = int64(0)
        for i in range(half):
            early += ticks[i] - base
        for i in range(n - half, n):
            late += ticks[i] - base
        return late - early, half * (n - half)
    if method == RECIPROCAL:
        return ticks[n - 1] - ticks[0], n - 1
    return stop - base, n


@njit(cache=True)
def count(ticks, starts, stops, method, edges, numerator, denominator, fault):  # type: ignore[no-untyped-def]
    """Count the edges of windows [starts[k], stops[k]), both not decreasing.

    Parameters
    ----------
    ticks : int64 array, shape (m,)
        Edges, increasing, with the two edges before the first window where the stream has them.
    starts, stops : int64 arrays, shape (n,)
        Windows.
    method : int
        One of this module's method numbers.
    edges, numerator, denominator : int64 arrays, shape (n,)
        Results: T = numerator/denominator in ticks per edge (6 times that for the regression).
    fault : uint8 array, shape (n,)
        Result: 0; 1 and 2 for no and too few edges; SUSPECT where two successive intervals
        differ by more than a half, or where more than one and a half are missing at the end.

    Returns
    -------
    int
        Index of the first edge that isn't later than the one before it, or -1.
    """
    fewest = 1 if method == GATED else 2
    low = 0
    high = 0
    n = 0
    advance = 0
    last_stop = int64(-(2**62))
    looked = 0
    irregular_until = 0
    for k in range(starts.size):
        base = starts[k]
        stop = stops[k]
        if base == last_stop:
            low = high
        else:
            before = low
            low = _first_at_or_after(ticks, low + advance, base)
            advance = low - before
        last_stop = stop
        high = _first_at_or_after(ticks, low + n, stop)
        n = high - low
        for ahead in range(low + _AHEAD, min(high + _AHEAD, ticks.size), _EDGES_PER_CACHE_LINE):
            prefetch(ticks, ahead)
        looked = max(looked, low - 1, 1)
        while looked < high:
            until = min(looked + _CHUNK, ticks.size)
            shortest, longest = _interval_range(ticks, max(looked - 1, 1), until)
            if shortest <= 0:
                for i in range(max(looked - 1, 1), until):
                    if ticks[i] <= ticks[i - 1]:
                        return i
            if 2 * longest > 3 * shortest:
                irregular_until = until
            looked = until
        edges[k] = n
        code = 0
        if n < fewest:
            code = 1 if n == 0 else 2
        else:
            numerator[k], denominator[k] = _quotient(ticks[low:high], base, stop, method)
            tail = ticks[max(high - 2, 0) : high]
            short = tail.size == 2 and 2 * (stop - tail[1]) > 3 * (tail[1] - tail[0])
            if (low < irregular_until or short) and _irregular(ticks, low, high, stop):
                code = SUSPECT
        fault[k] = code
    return -1


@njit(cache=True, error_model="numpy")
def frequencies(  # type: ignore[no-untyped-def]
    numerator, denominator, fault, method, trains, timebase, edge_noise, frequency, uncertainty
):
    """Turn quotients into frequency and standard uncertainty; NaN where there is a fault.

    Parameters
    ----------
    numerator, denominator : int64 arrays, shape (n,)
        From `count`, or summed over several trains of edges.
    fault : uint8 array, shape (n,)
        Fault codes.
    method : int
        As for `count`.
    trains : int
        Trains of edges in the sums: 1, or 2 for rising and falling edges.
    timebase : float
        Timebase in Hz.
    edge_noise : float
        Standard deviation of one edge's time in ticks.
    frequency, uncertainty : float64 arrays, shape (n,)
        Results in Hz.
    """
    scale = timebase / 6.0 if method == REGRESSION else timebase
    for k in range(numerator.size):
        if fault[k] != 0:
            frequency[k] = np.nan
            uncertainty[k] = np.nan
            continue
        span = float(numerator[k])
        parts = float(denominator[k])
        value = scale * parts / span
        frequency[k] = value
        if method == REGRESSION:
            uncertainty[k] = value * edge_noise * np.sqrt(12.0 * parts) / (6.0 * span)
        elif method == TRIANGULAR:
            # parts = h² per train, for h edges in each half
            uncertainty[k] = value * edge_noise * np.sqrt(2.0 * np.sqrt(parts * trains)) / span
        elif method == RECIPROCAL:
            uncertainty[k] = value * edge_noise * np.sqrt(2.0 * trains) / span
        else:
            uncertainty[k] = timebase * trains / (np.sqrt(6.0) * span)
