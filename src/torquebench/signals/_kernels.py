"""Hot loops of the counters.

Every counter is a quotient of two integers: a numerator in ticks and a denominator in edges. A
result depends only on the edges in its window and is the same to the last bit however the stream
was cut. Integer sums can also be vectorised, while a loop over floats must keep its order and is
eight times slower.
"""

import numpy as np
from numba import int64

from torquebench.kernels import inner, kernel

RECIPROCAL, REGRESSION, TRIANGULAR = 1, 2, 3
# A window with an irregular pulse train, which is inspected outside the hot loop.
SUSPECT = 255
# Windows whose integers fit the inner caches until they are converted to frequencies.
_GROUP = 2048


@inner
def _first_at_or_after(ticks, guess, tick):  # type: ignore[no-untyped-def] # Numba infers
    """Return the first edge at or after a tick, searched from a guess."""
    i = min(guess, ticks.size)
    while i < ticks.size and ticks[i] < tick:
        i += 1
    while i > 0 and ticks[i - 1] >= tick:
        i -= 1
    return i


@inner
def _irregular(ticks, low, high, stop):  # type: ignore[no-untyped-def] # Numba infers
    """Return whether successive intervals differ by a half, or the end lacks pulses."""
    for i in range(max(low, 2), high):
        interval = ticks[i] - ticks[i - 1]
        previous = ticks[i - 1] - ticks[i - 2]
        if 2 * interval > 3 * previous or 3 * interval < 2 * previous:
            return True
    return high > 1 and 2 * (stop - ticks[high - 1]) > 3 * (ticks[high - 1] - ticks[high - 2])


@inner
def _sum(ticks, low, high):  # type: ignore[no-untyped-def] # Numba infers
    """Return the sum of a range of ticks."""
    # Passing a slice would count references, which takes as long as a short sum.
    window = ticks[low:high]
    total = int64(0)
    for i in range(window.size):
        total += window[i]
    return total


@inner
def slope_and_intervals(ticks, low, high):  # type: ignore[no-untyped-def] # Numba infers
    """Return Σ (2i + 1 − n)·ticks[low + i] over n edges, and their shortest and longest interval.

    An interval belongs to the edge at its end. The weights add up to zero, so that absolute ticks
    need no origin, and an intermediate overflow cancels, because 64-bit integers wrap around.
    """
    shortest = int64(2**62)
    longest = int64(-(2**62))
    if low > 0:
        shortest = longest = ticks[low] - ticks[low - 1]
    slope = ticks[low] * (1 - (high - low))
    for i in range(low + 1, high):
        slope += ticks[i] * (2 * i + 1 - low - high)
        interval = ticks[i] - ticks[i - 1]
        shortest = min(shortest, interval)
        longest = max(longest, interval)
    return slope, shortest, longest


@inner
def _first_out_of_order(ticks, low, high):  # type: ignore[no-untyped-def] # Numba infers
    """Return the first edge that isn't later than the one before it; -1 for none."""
    for i in range(max(low, 1), high):
        if ticks[i] <= ticks[i - 1]:
            return i
    return -1


@inner
def _count_train(ticks, begin, first, window, method, check, edges, numerator, fault):  # type: ignore[no-untyped-def] # Numba infers
    """Count a pulse train over windows; `begin` is near the first edge of the first window.

    Returns the first edge that isn't later than the one before it (-1 for none), and the edge
    after the last window.
    """
    stop = first * window
    low = high = _first_at_or_after(ticks, begin, stop)
    n = 0
    for k in range(edges.size):
        stop += window
        low = high
        high = _first_at_or_after(ticks, low + n, stop)
        n = high - low
        edges[k] = n
        code = 0
        if n < 2:
            numerator[k] = 0
            code = 1 if n == 0 else 2
        else:
            slope, shortest, longest = slope_and_intervals(ticks, low, high)
            if low > 1:
                before = ticks[low - 1] - ticks[low - 2]
                shortest = min(shortest, before)
                longest = max(longest, before)
            if shortest <= 0:
                return _first_out_of_order(ticks, low - 1, high), high
            if method == REGRESSION:
                numerator[k] = slope
            elif method == TRIANGULAR:
                late = _sum(ticks, high - n // 2, high)
                numerator[k] = late - _sum(ticks, low, low + n // 2)
            else:
                numerator[k] = ticks[high - 1] - ticks[low]
            if check:
                last = ticks[high - 1]
                short = high > 1 and 2 * (stop - last) > 3 * (last - ticks[high - 2])
                uneven = 2 * longest > 3 * shortest
                if (uneven or short) and _irregular(ticks, low, high, stop):
                    code = SUSPECT
        fault[k] = code
    return -1, high


@inner
def _denominators(edges, method, denominator):  # type: ignore[no-untyped-def] # Numba infers
    """Fill `denominator`: T = numerator/denominator, ticks per edge (6·T for the regression)."""
    if method == REGRESSION:
        for k in range(edges.size):
            denominator[k] = edges[k] * (edges[k] * edges[k] - 1)
    elif method == TRIANGULAR:
        for k in range(edges.size):
            half = edges[k] // 2
            denominator[k] = half * (edges[k] - half)
    else:
        for k in range(edges.size):
            denominator[k] = edges[k] - 1


@inner(error_model="numpy")
def _convert(  # type: ignore[no-untyped-def] # Numba infers
    first, window, numerator, denominator, edges, fault, method, timebase, edge_noise,
    time, frequency, uncertainty,
):  # fmt: skip
    """Convert quotients to frequency and standard uncertainty; NaN for a window with a fault.

    Returns how many windows are SUSPECT, and the largest number of edges.
    """
    scale = timebase / 6.0 if method == REGRESSION else timebase
    # Sum of the edges' squared weights for the three methods: n(n² − 1)/3 (the numerator lacks a
    # factor of 6), n, and 2.
    by_parts = 1.0 / 3.0 if method == REGRESSION else 0.0
    by_edges = 1.0 if method == TRIANGULAR else 0.0
    constant = 2.0 if method == RECIPROCAL else 0.0
    half_tick = 0.5 / timebase
    suspects = most = 0
    for k in range(fault.size):
        start = (first + k) * window
        time[k] = (float(start) + float(start + window)) * half_tick
        parts = float(denominator[k])
        per_span = 1.0 / float(numerator[k])
        value = scale * parts * per_span
        weights = by_parts * parts + by_edges * float(edges[k]) + constant
        spread = value * edge_noise * np.sqrt(weights) * per_span
        frequency[k] = value if fault[k] == 0 else np.nan
        uncertainty[k] = spread if fault[k] == 0 else np.nan
    for k in range(fault.size):
        suspects += fault[k] == SUSPECT
        most = max(most, edges[k])
    return suspects, most


@kernel
def count(  # type: ignore[no-untyped-def] # Numba infers
    ticks, first, window, method, check, timebase, edge_noise, rows, fault
):  # fmt: skip
    """Count the edges in consecutive windows [k·window, (k + 1)·window), from k = `first` on.

    Parameters
    ----------
    ticks : int64 array, shape (m,)
        Increasing edges, including the two edges before the first window if they exist.
    first, window : int
        Number of the first window, and the windows' length in ticks.
    method : int
        One of this module's method numbers.
    check : bool
        Whether to mark irregular trains as SUSPECT: two successive intervals differ by more than a
        half, or more than one and a half intervals are missing at the end.
    timebase : float
        Timebase in Hz.
    edge_noise : float
        Standard deviation of one edge's time in ticks.
    rows : float64 array, shape (3, n)
        Results: the windows' centres in seconds, frequency and standard uncertainty in Hz.
    fault : uint8 array, shape (n,)
        Result: 0; 1 and 2 for no and too few edges; SUSPECT.

    Returns
    -------
    wrong : int
        Index of the first edge that isn't later than the one before it, or -1.
    suspects : int
        Number of SUSPECT windows.
    most : int
        Largest number of edges in a window.
    end : int
        Index of the first edge after the last window; 0 without windows.
    """
    time, frequency, uncertainty = rows
    size = min(_GROUP, fault.size)
    sums = np.empty((2, size), dtype=np.int64)
    edges = np.empty(size, dtype=np.int64)
    at = suspects = most = 0
    for begin in range(0, fault.size, _GROUP):
        part = slice(begin, min(begin + _GROUP, fault.size))
        here = slice(0, part.stop - begin)
        wrong, at = _count_train(
            ticks, at, first + begin, window, method, check,
            edges[here], sums[0, here], fault[part],
        )  # fmt: skip
        if wrong >= 0:
            return wrong, 0, 0, 0
        _denominators(edges[here], method, sums[1, here])
        irregular, largest = _convert(
            first + begin, window, sums[0, here], sums[1, here], edges[here], fault[part],
            method, timebase, edge_noise, time[part], frequency[part], uncertainty[part],
        )  # fmt: skip
        suspects += irregular
        most = max(most, largest)
    return -1, suspects, most, at
