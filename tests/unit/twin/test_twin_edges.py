"""Edges against the integral of the frequency, to the tick."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.twin.counter import CounterConstants, EdgeSource, edges_of_steps, lagged

STEP = 100_000
TIMEBASE = 100e6
QUIET = CounterConstants(timebase_error=0.0, jitter_s=0.0)

frequencies = st.lists(st.floats(15e3, 420e3), min_size=2, max_size=12)


def edges(frequency_hz, *, jitter=0.0, phase=0.0, first_step=0, delay=0.0):
    ticks = np.empty(int(np.sum(frequency_hz) * 1e-3) + 8, dtype=np.int64)
    count, phase = edges_of_steps(
        np.asarray(frequency_hz) / TIMEBASE,
        first_step,
        STEP,
        delay,
        jitter,
        phase,
        np.random.default_rng(0),
        ticks,
    )
    return ticks[:count], phase


def test_constant_frequency_to_the_tick():
    ticks, phase = edges([62_500.0] * 4)  # 1600 ticks a cycle, 187.5 cycles in 3 ms
    np.testing.assert_array_equal(ticks, 1600 * np.arange(1, 188))
    assert phase == pytest.approx(0.5, abs=1e-9)


@given(frequencies=frequencies, phase=st.floats(0.0, 0.999))
def test_each_edge_lies_where_the_phase_is_whole(frequencies, phase):
    ticks, left = edges(frequencies, phase=phase)
    border = np.arange(len(frequencies)) * STEP
    # exact integral of the linear interpolation at the edges
    per_tick = np.asarray(frequencies) / TIMEBASE
    total = np.concatenate(([0.0], np.cumsum(0.5 * (per_tick[1:] + per_tick[:-1]) * STEP)))

    def integral(tick):
        step = np.clip(tick // STEP, 0, len(border) - 2)
        into = tick - border[step]
        slope = (per_tick[step + 1] - per_tick[step]) / STEP
        return phase + total[step] + per_tick[step] * into + 0.5 * slope * into**2

    number = np.arange(1, ticks.size + 1)
    assert np.all(integral(ticks) <= number + 1e-6)  # the counter shows the last full tick
    assert np.all(integral(ticks + 1) >= number - 1e-6)
    assert ticks.size + left == pytest.approx(phase + total[-1], abs=1e-6)
    assert np.all(np.diff(ticks) > 0)


@given(
    frequencies=st.lists(st.floats(15e3, 105e3), min_size=4, max_size=10),
    cut=st.integers(1, 8),
)
def test_cutting_a_run_changes_nothing(frequencies, cut):
    cut = min(cut, len(frequencies) - 1)
    whole, _ = edges(frequencies, delay=16.7)
    first, phase = edges(frequencies[: cut + 1], delay=16.7)
    second, _ = edges(frequencies[cut:], phase=phase, first_step=cut, delay=16.7)
    np.testing.assert_array_equal(np.concatenate((first, second)), whole)


def test_clock_error_shifts_the_counted_frequency():
    counts = {}
    for error in (0.0, 1e-4):
        source = EdgeSource(
            np.random.default_rng(1), TIMEBASE, STEP, CounterConstants(error, 0.0), 0.0
        )
        source.run(0, np.full(1001, 60e3))
        ticks, _ = source.take(1000 * STEP)
        counts[error] = (ticks.size - 1) / (ticks[-1] - ticks[0])
    assert counts[1e-4] / counts[0.0] == pytest.approx(1.0 / (1.0 + 1e-4), abs=3e-8)


def test_jitter_has_its_standard_deviation():
    source = EdgeSource(np.random.default_rng(1), TIMEBASE, STEP, CounterConstants(0.0, 50e-9), 0.0)
    source.run(0, np.full(501, 62_500.0))
    ticks, _ = source.take(500 * STEP)
    deviation = ticks + 0.5 - 1600.0 * np.arange(1, ticks.size + 1)
    assert np.std(deviation) == pytest.approx(np.hypot(5.0, 12**-0.5), rel=0.02)
    assert abs(np.mean(deviation)) < 0.1


def test_delivery_is_cut_at_the_tick_and_numbered():
    source = EdgeSource(np.random.default_rng(1), TIMEBASE, STEP, QUIET, 220e-6)
    source.begin(60e3)
    source.run(0, np.full(11, 60e3))
    first, number = source.take(123_456)
    second, following = source.take(10 * STEP)
    assert number == 0
    assert following == first.size
    assert first[-1] < 123_456 <= second[0]
    both = np.concatenate((first, second))
    assert 0 <= both[0] < 1667  # no gap at the start although everything is delayed
    np.testing.assert_allclose(np.diff(both), 100e6 / 60e3, atol=1.0)


@given(
    start=st.floats(50e3, 70e3),
    end=st.floats(50e3, 70e3),
    before=st.floats(50e3, 70e3),
    lag=st.floats(20e-6, 2e-3),
)
def test_lag_solves_its_equation(start, end, before, lag):
    value, pieces = before, 4000
    for k in range(pieces):  # midpoint rule of lag·y' = x − y
        driven = start + (end - start) * (k + 0.5) / pieces
        rate = 1e-3 / pieces / lag
        value = ((1 - 0.5 * rate) * value + rate * driven) / (1 + 0.5 * rate)
    assert lagged(before, start, end, lag, 1e-3) == pytest.approx(value, abs=0.05)
