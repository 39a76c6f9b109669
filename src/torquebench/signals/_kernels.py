"""Hot loops of the counters.

Every counter is a quotient of two integers: a numerator in ticks and a denominator in edges. A
result depends only on the edges in its window and is the same to the last bit however the stream
was cut. Integer sums also vectorise, where the same loop over floats must keep its order and runs
eight times slower.
"""

import numpy as np
from numba import int64

from torquebench.kernels import inner, kernel

GATED, RECIPROCAL, REGRESSION, TRIANGULAR = 0, 1, 2, 3
# A window with an irregular pulse train, which is inspected outside the hot loop.
SUSPECT = 255
# Windows whose integers fit the inner caches until they are converted to frequencies.
_GROUP = 2048


@inner
def _first_at_or_after(ticks, guess, tick):  # type: ignore[no-untyped-def] # Numba infers
    i = min(guess, ticks.size)
    while i < ticks.size and ticks[i] < tick:
        i += 1
    while i > 0 and ticks[i - 1] >= tick:
        i -= 1
    return i


@inner
def _irregular(ticks, low, high, stop):  # type: ignore[no-untyped-def] # Numba infers
    for i in range(max(low, 2), high):
        interval = ticks[i] - ticks[i - 1]
        previous = ticks[i - 1] - ticks[i - 2]
        if 2 * interval > 3 * previous or 3 * interval < 2 * previous:
            return True
    return high > 1 and 2 * (stop - ticks[high - 1]) > 3 * (ticks[high - 1] - ticks[high - 2])


@inner
def _sum(ticks, low, high):  # type: ignore[no-untyped-def] # Numba infers
    # Passing a slice would count references, which costs as much as a short sum.
    window = ticks[low:high]
    total = int64(0)
    for i in range(window.size):
        total += window[i]
    return total


@inner
def slope_and_intervals(ticks, low, high):  # type: ignore[no-untyped-def] # Numba infers
    """Sum of (2i + 1 − n)·ticks[low + i] over n edges, and their shortest and longest interval.

    Intervals are those that end at the edges. The weights add up to zero, so absolute ticks need
    no origin, and a sum that overflows on its way comes back right: 64-bit integers wrap around.
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
    for i in range(max(low, 1), high):
        if ticks[i] <= ticks[i - 1]:
            return i
    return -1


@inner
def _count_train(ticks, begin, starts, stops, method, check, edges, numerator, fault):  # type: ignore[no-untyped-def] # Numba infers
    """Count one train over windows; `begin` is about the first edge of the first window.

    Returns the first edge that isn't later than the one before it (-1 for none), and the edge
    after the last window.
    """
    fewest = 1 if method == GATED else 2
    low = high = begin
    n = advance = 0
    last_stop = int64(-(2**62))
    for k in range(starts.size):
        start = starts[k]
        stop = stops[k]
        if start == last_stop:
            low = high
        else:
            last_low = low
            low = _first_at_or_after(ticks, low + advance, start)
            advance = low - last_low
        last_stop = stop
        high = _first_at_or_after(ticks, low + n, stop)
        n = high - low
        edges[k] = n
        code = 0
        if n < fewest:
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
            elif method == RECIPROCAL:
                numerator[k] = ticks[high - 1] - ticks[low]
            else:
                numerator[k] = stop - start
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
    """T = numerator/denominator in ticks per edge; for the regression T is six times that."""
    if method == REGRESSION:
        for k in range(edges.size):
            denominator[k] = edges[k] * (edges[k] * edges[k] - 1)
    elif method == TRIANGULAR:
        for k in range(edges.size):
            half = edges[k] // 2
            denominator[k] = half * (edges[k] - half)
    else:
        first = 1 if method == RECIPROCAL else 0
        for k in range(edges.size):
            denominator[k] = edges[k] - first


@inner
def _largest(edges, starts, stops):  # type: ignore[no-untyped-def] # Numba infers
    """Largest product of edges² and ticks of a window, which bounds its sums."""
    largest = 0.0
    for k in range(edges.size):
        largest = max(largest, float(edges[k]) * float(edges[k]) * float(stops[k] - starts[k]))
    return largest


@inner
def _pool(sums, edges, fault, more, more_edges, more_fault):  # type: ignore[no-untyped-def] # Numba infers
    """Add a second train's sums, edges and faults to the first's."""
    for k in range(edges.size):
        sums[0, k] += more[0, k]
        sums[1, k] += more[1, k]
        edges[k] += more_edges[k]
        if fault[k] == 0 or (fault[k] == SUSPECT and more_fault[k] != 0):
            fault[k] = more_fault[k]


@inner(error_model="numpy")
def _convert(  # type: ignore[no-untyped-def] # Numba infers
    starts, stops, numerator, denominator, edges, fault, trains, method, timebase, edge_noise,
    time, frequency, uncertainty,
):  # fmt: skip
    """Turn quotients into frequency and standard uncertainty; NaN where there is a fault.

    Returns how many windows are SUSPECT.
    """
    scale = timebase / 6.0 if method == REGRESSION else timebase
    # Sum of the edges' squared weights: n(n² − 1)/3 here, since the numerator lacks a factor
    # of 6; n; and 2 for each train. A gate has two roundings whatever the edges' noise.
    by_parts = 1.0 / 3.0 if method == REGRESSION else 0.0
    by_edges = 1.0 if method == TRIANGULAR else 0.0
    constant = 2.0 * trains if method == RECIPROCAL else 0.0
    gate = timebase * trains / np.sqrt(6.0) if method == GATED else 0.0
    half_tick = 0.5 / timebase
    suspects = 0
    for k in range(fault.size):
        time[k] = (float(starts[k]) + float(stops[k])) * half_tick
        parts = float(denominator[k])
        per_span = 1.0 / float(numerator[k])
        value = scale * parts * per_span
        weights = by_parts * parts + by_edges * float(edges[k]) + constant
        spread = (value * edge_noise * np.sqrt(weights) + gate) * per_span
        frequency[k] = value if fault[k] == 0 else np.nan
        uncertainty[k] = spread if fault[k] == 0 else np.nan
    for k in range(fault.size):
        suspects += fault[k] == SUSPECT
    return suspects


@kernel
def count(  # type: ignore[no-untyped-def] # Numba infers
    rising,
    falling,
    both,
    starts,
    stops,
    method,
    check,
    timebase,
    edge_noise,
    time,
    frequency,
    uncertainty,
    edges,
    fault,
):
    """Count the edges of windows [starts[k], stops[k]), neither of which decreases.

    Parameters
    ----------
    rising, falling : int64 arrays, shape (m,)
        Trains of increasing edges, each with the two edges before the first window where the
        stream has them.
    both : bool
        Use the falling edges too, with a separate phase.
    starts, stops : int64 arrays, shape (n,)
        Windows in ticks.
    method : int
        One of this module's method numbers.
    check : bool
        Mark irregular trains as SUSPECT: two successive intervals differ by more than a half,
        or more than one and a half are missing at the end.
    timebase : float
        Timebase in Hz.
    edge_noise : float
        Standard deviation of one edge's time in ticks.
    time, frequency, uncertainty : float64 arrays, shape (n,)
        Results: the windows' centres in seconds, and Hz.
    edges : int64 array, shape (n,)
        Result: edges in each window.
    fault : uint8 array, shape (n,)
        Result: 0; 1 and 2 for no and too few edges; SUSPECT.

    Returns
    -------
    wrong : int
        Index of the first edge that isn't later than the one before it, or -1.
    wrong_falls : bool
        Whether that is a falling edge.
    suspects : int
        Number of SUSPECT windows.
    largest_sum : float
        Bound of the largest sum: the most edges in a window, squared, times its length in ticks.
    """
    size = min(_GROUP, starts.size)
    sums = np.empty((2, size), dtype=np.int64)
    more = np.empty((2, size), dtype=np.int64)
    more_edges = np.empty(size, dtype=np.int64)
    more_fault = np.empty(size, dtype=np.uint8)
    at_rising = at_falling = suspects = 0
    largest = 0.0
    for first in range(0, starts.size, _GROUP):
        part = slice(first, min(first + _GROUP, starts.size))
        here = slice(0, part.stop - first)
        wrong, at_rising = _count_train(
            rising, at_rising, starts[part], stops[part], method, check,
            edges[part], sums[0, here], fault[part],
        )  # fmt: skip
        if wrong >= 0:
            return wrong, False, 0, 0.0
        _denominators(edges[part], method, sums[1, here])
        largest = max(largest, _largest(edges[part], starts[part], stops[part]))
        if both:
            wrong, at_falling = _count_train(
                falling, at_falling, starts[part], stops[part], method, check,
                more_edges[here], more[0, here], more_fault[here],
            )  # fmt: skip
            if wrong >= 0:
                return wrong, True, 0, 0.0
            _denominators(more_edges[here], method, more[1, here])
            largest = max(largest, _largest(more_edges[here], starts[part], stops[part]))
            _pool(sums, edges[part], fault[part], more, more_edges, more_fault)
        suspects += _convert(
            starts[part], stops[part], sums[0, here], sums[1, here], edges[part], fault[part],
            2.0 if both else 1.0, method, timebase, edge_noise,
            time[part], frequency[part], uncertainty[part],
        )  # fmt: skip
    return -1, False, suspects, largest


@kernel
def mark_repeats(frequency, fault, longest, code, last, run):  # type: ignore[no-untyped-def] # Numba infers
    """Mark windows whose number repeats the one before it for the `longest`th time or more.

    Parameters
    ----------
    frequency : float64 array, shape (n,)
        Frequencies; NaN isn't a repetition.
    fault : uint8 array, shape (n,)
        Result: `code` at such windows; others stay.
    longest, code : int
        Limit and fault code.
    last, run : float, int
        Number before the first window, and its repetitions in a row.

    Returns
    -------
    last, run, marked
        The same for the next call, and how many windows were marked.
    """
    marked = 0
    size = frequency.size
    if size == 0:
        return last, run, marked
    # A run this long can't slip between places half of it apart: a check of a few places is usually
    # sufficient, except for a run at the end.
    suspicious = frequency[0] == last
    for k in range(1, size, max(longest // 2, 1)):
        suspicious |= frequency[k] == frequency[k - 1]
    first = 0 if suspicious else max(size - longest, 1)
    if not suspicious:
        run = 1
        last = frequency[first - 1]
    for k in range(first, size):
        run = run + 1 if frequency[k] == last else 1
        last = frequency[k]
        if run >= longest:
            fault[k] = code
            marked += 1
    return last, run, marked


@kernel
def running_median(values, size):  # type: ignore[no-untyped-def] # Numba infers
    """Median of the `size` values around each, mirrored at both ends without repeating them.

    Of an even size the upper one of both in the middle, with one more value before than after.
    """
    last = values.size - 1
    window = np.empty(size)
    result = np.empty(values.size)
    for place in range(values.size):
        for k in range(size):
            at = abs(place - size // 2 + k)
            value = values[2 * last - at if at > last else at]
            free = k
            while free > 0 and window[free - 1] > value:
                window[free] = window[free - 1]
                free -= 1
            window[free] = value
        result[place] = window[size // 2]
    return result


@kernel
def mark_isolated(far, longest):  # type: ignore[no-untyped-def] # Numba infers
    """Keep marks of which at most `longest` follow each other."""
    kept = np.zeros(far.size, dtype=np.bool_)
    first = 0
    while first < far.size:
        stop = first
        while stop < far.size and far[stop]:
            stop += 1
        if stop - first <= longest:
            kept[first:stop] = True
        first = stop + 1
    return kept


@kernel
def settled_from(centred, latest):  # type: ignore[no-untyped-def] # Numba infers
    """Index up to `latest` from which on the variance by the number of samples is least."""
    total = squares = least = 0.0
    best = -1
    for first in range(centred.size - 1, -1, -1):
        total += centred[first]
        squares += centred[first] * centred[first]
        if first > latest:
            continue
        count = float(centred.size - first)
        spread = max(squares - total * total / count, 0.0) / (count * count)
        if best < 0 or spread <= least:
            best, least = first, spread
    return best
