"""Hot loops of the counters.

Every counter is a quotient of two integers: a numerator in ticks and a denominator in edges,
summed relative to the window's start, so that a result depends on nothing but the edges in its
window and is the same to the last bit however the stream was cut. Integer sums over slices
also vectorise, where the same loop over floats must keep its order and runs eight times slower.
"""

import numpy as np
from numba import int64, njit

from torquebench.signals._processor import prefetch

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


# Slices are taken inside these functions: handing one over would count references, which costs
# as much as the sum over a short window. Weights add up to zero, so the absolute ticks need no
# base, and sums that overflow on the way come back right: 64-bit integers wrap around.
@njit(cache=True)
def _sum(ticks, low, high):  # type: ignore[no-untyped-def]
    window = ticks[low:high]
    total = int64(0)
    for i in range(window.size):
        total += window[i]
    return total


@njit(cache=True)
def _slope_sum(ticks, low, high):  # type: ignore[no-untyped-def]
    window = ticks[low:high]
    first_weight = 1 - (high - low)
    total = int64(0)
    for i in range(window.size):
        total += window[i] * (first_weight + 2 * i)
    return total


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
    wrong : int
        Index of the first edge that isn't later than the one before it, or -1.
    suspects : int
        How many windows are SUSPECT.
    most : int
        Most edges in a window.
    longest : int
        Length of the longest window in ticks.
    """
    fewest = 1 if method == GATED else 2
    low = 0
    high = 0
    n = 0
    advance = 0
    last_stop = int64(-(2**62))
    looked = 0
    irregular_until = 0
    suspects = 0
    most = 0
    longest_window = int64(0)
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
                        return i, 0, 0, 0
            if 2 * longest > 3 * shortest:
                irregular_until = until
            looked = until
        edges[k] = n
        most = max(most, n)
        longest_window = max(longest_window, stop - base)
        code = 0
        if n < fewest:
            code = 1 if n == 0 else 2
        else:
            if method == REGRESSION:
                numerator[k] = _slope_sum(ticks, low, high)
                denominator[k] = n * (n * n - 1)
            elif method == TRIANGULAR:
                half = n // 2
                late = _sum(ticks, high - half, high)
                numerator[k] = late - _sum(ticks, low, low + half)
                denominator[k] = half * (n - half)
            elif method == RECIPROCAL:
                numerator[k] = ticks[high - 1] - ticks[low]
                denominator[k] = n - 1
            else:
                numerator[k] = stop - base
                denominator[k] = n
            last = ticks[high - 1]
            short = high > 1 and 2 * (stop - last) > 3 * (last - ticks[high - 2])
            if (low < irregular_until or short) and _irregular(ticks, low, high, stop):
                code = SUSPECT
                suspects += 1
        fault[k] = code
    return -1, suspects, most, longest_window


@njit(cache=True, error_model="numpy")
def frequencies(  # type: ignore[no-untyped-def]
    starts,
    stops,
    numerator,
    denominator,
    fault,
    method,
    trains,
    timebase,
    edge_noise,
    time,
    frequency,
    uncertainty,
):
    """Turn quotients into frequency and standard uncertainty; NaN where there is a fault.

    Parameters
    ----------
    starts, stops : int64 arrays, shape (n,)
        Windows in ticks.
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
    time, frequency, uncertainty : float64 arrays, shape (n,)
        Results: the windows' centres in seconds, and Hz.
    """
    scale = timebase / 6.0 if method == REGRESSION else timebase
    for k in range(numerator.size):
        time[k] = (float(starts[k]) + float(stops[k])) / (2.0 * timebase)
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


@njit(cache=True)
def mark_repeats(frequency, fault, longest, code, last, run):  # type: ignore[no-untyped-def]
    """Mark windows whose number repeats the one before it for the `longest`th time or more.

    Parameters
    ----------
    frequency : float64 array, shape (n,)
        Frequencies; NaN repeats nothing.
    fault : uint8 array, shape (n,)
        Result: `code` at such windows; others stay.
    longest, code : int
        Limit and fault code.
    last, run : float, int
        Number before the first window, and how often in a row it came.

    Returns
    -------
    last, run, marked
        The same for the next call, and how many windows were marked.
    """
    marked = 0
    for k in range(frequency.size):
        run = run + 1 if frequency[k] == last else 1
        last = frequency[k]
        if run >= longest:
            fault[k] = code
            marked += 1
    return last, run, marked
