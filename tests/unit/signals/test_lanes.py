import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from torquebench.signals._kernels import slope_and_intervals
from torquebench.signals._lanes import LANES, slope_and_intervals_in_lanes


@njit
def in_lanes(ticks, low, high):
    return slope_and_intervals_in_lanes(ticks, low, high)


@given(
    intervals=st.lists(st.integers(-5, 10_000), min_size=LANES + 1, max_size=80),
    offset=st.integers(-(2**62), 2**62),
    data=st.data(),
)
def test_lanes_do_what_the_plain_loop_does(intervals, offset, data):
    ticks = np.cumsum(np.array(intervals, dtype=np.int64)) + offset
    low = data.draw(st.integers(1, ticks.size - LANES))
    high = data.draw(st.integers(low + LANES, ticks.size))
    assert in_lanes(ticks, low, high) == slope_and_intervals(ticks, low, high)
    window = ticks[low:high].astype(object)
    weights = [2 * i + 1 - window.size for i in range(window.size)]
    exact = sum(weight * tick for weight, tick in zip(weights, window, strict=True))
    steps = np.diff(ticks[low - 1 : high])
    assert in_lanes(ticks, low, high) == (exact, steps.min(), steps.max())
