import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.signals import (
    EdgeBlock,
    FrequencyCounter,
    FrequencySamples,
    PulseTrainFault,
    SignalFaultKind,
    count_windows,
    gated,
    reciprocal,
    regression,
    triangular,
)
from torquebench.signals._kernels import mark_repeats

METHODS = ["gated", "reciprocal", "regression", "triangular"]
TIMEBASE = 100e6


# Textbook formulas of the counters in floating point, independent of the kernels' integer sums:
# mean period of the edges of one window, whose start is 0.


def gated_period(edges, length):
    return length / edges.size


def reciprocal_period(edges, _):
    return (edges[-1] - edges[0]) / (edges.size - 1)


def regression_period(edges, _):
    """Slope of the edges' times against their number."""
    number = np.arange(edges.size) - (edges.size - 1) / 2
    return number @ (edges - edges.mean()) / (number @ number)


def triangular_period(edges, _):
    """Difference of the mean times of the last and the first half of the edges."""
    half = edges.size // 2
    return (edges[-half:].mean() - edges[:half].mean()) / (edges.size - half)


PERIODS = {
    "gated": gated_period,
    "reciprocal": reciprocal_period,
    "regression": regression_period,
    "triangular": triangular_period,
}


def reference_frequency(ticks, starts, stops, method):
    """Frequency of each window [start, stop) in Hz, NaN where it has too few edges."""
    result = []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        inside = ticks[(ticks >= start) & (ticks < stop)] - start
        enough = inside.size >= (1 if method == "gated" else 2)
        period = PERIODS[method](inside.astype(float), stop - start) if enough else np.nan
        result.append(TIMEBASE / period)
    return np.array(result)


def cut(ticks, stop, borders, falling=None):
    """The same stream in blocks between the given ticks."""
    edges = [0, *sorted(borders), stop]
    blocks = []
    for low, high in itertools.pairwise(edges):
        first, last = np.searchsorted(ticks, (low, high))
        down = None
        if falling is not None:
            down_first, down_last = np.searchsorted(falling, (low, high))
            down = falling[down_first:down_last]
        blocks.append(EdgeBlock(ticks[first:last], low, high, TIMEBASE, down))
    return blocks


def same_to_the_last_bit(one: FrequencySamples, other: FrequencySamples) -> bool:
    return all(
        getattr(one, name).tobytes() == getattr(other, name).tobytes()
        for name in (
            "time_s",
            "frequency_hz",
            "edges",
            "standard_uncertainty_hz",
            "fault",
            "missing",
            "doubled",
        )
    )


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_a_stream_cut_anywhere_gives_the_same_to_the_last_bit(method, data):
    stop = 60_000
    intervals = data.draw(st.lists(st.integers(1, 3000), min_size=0, max_size=120))
    ticks = np.cumsum(np.array(intervals, dtype=np.int64))
    ticks = ticks[ticks < stop]
    falling = ticks[:-1] + np.maximum(np.diff(ticks) // 3, 0)
    falling = falling[np.diff(falling, prepend=-1) > 0]
    both = data.draw(st.booleans())
    window = data.draw(st.integers(1_000, 20_000))
    step = data.draw(st.integers(500, 25_000))
    borders = data.draw(st.lists(st.integers(0, stop), max_size=12))
    options = {
        "window_s": window / TIMEBASE,
        "step_s": step / TIMEBASE,
        "timebase_hz": TIMEBASE,
        "both_edges": both,
        "stuck_windows": 3,
    }
    results = []
    for blocks in (cut(ticks, stop, [], falling), cut(ticks, stop, borders, falling)):
        counter = FrequencyCounter(method, **options)
        results.append(FrequencySamples.concatenate([counter.push(block) for block in blocks]))
    assert same_to_the_last_bit(*results)


@pytest.mark.parametrize("method", METHODS)
def test_a_block_of_one_tick_each_changes_nothing(method, pulse_train):
    ticks = pulse_train(100e3, 0.1e-3)
    whole = cut(ticks, 10_000, [])
    single = cut(ticks, 10_000, range(1, 10_000, 7))
    count = {"gated": gated, "reciprocal": reciprocal, "regression": regression}
    run = count.get(method, triangular)
    assert same_to_the_last_bit(run(whole, 30e-6), run(single, 30e-6))


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_counters_agree_with_their_numpy_reference(method, data):
    intervals = data.draw(st.lists(st.integers(1, 5000), min_size=0, max_size=200))
    offset = data.draw(st.integers(0, 2**52))
    ticks = np.cumsum(np.array(intervals, dtype=np.int64)) + offset
    starts = np.sort(np.array(data.draw(st.lists(st.integers(0, 200_000), min_size=1, max_size=9))))
    starts = starts + offset
    stops = starts + data.draw(st.integers(1, 60_000))
    found = count_windows(
        ticks, starts, stops, method, timebase_hz=TIMEBASE, check_train=False
    ).frequency_hz
    expected = reference_frequency(ticks, starts, stops, method)
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_long_windows_over_many_look_ahead_chunks(method, pulse_train):
    ticks = pulse_train(240e3, 0.2)
    starts = np.arange(0, 16_666_665, 3_333_333)
    stops = starts + 3_333_333
    found = count_windows(ticks, starts, stops, method, timebase_hz=TIMEBASE)
    assert not found.fault.any()
    np.testing.assert_allclose(
        found.frequency_hz,
        reference_frequency(ticks, starts, stops, method),
        rtol=1e-12,
    )


def test_the_regression_is_exact_far_from_the_origin():
    ticks = np.arange(0, 100_000, 1600) + 2**61
    samples = count_windows(ticks, [2**61], [2**61 + 100_000], timebase_hz=TIMEBASE)
    assert samples.frequency_hz[0] == 62_500.0


def test_windows_lie_on_one_grid_for_all_channels(pulse_train):
    late = EdgeBlock(
        pulse_train(60e3, 20e-3)[200:] + 1_000_000, 1_250_000, 3_000_000, timebase_hz=TIMEBASE
    )
    samples = regression(late, 5e-3)
    np.testing.assert_allclose(samples.time_s, [0.0175, 0.0225, 0.0275])


def test_sliding_windows_contain_the_fixed_ones(pulse_train):
    block = EdgeBlock(pulse_train(60e3, 50e-3), 0, 5_000_000, TIMEBASE)
    fixed = regression(block, 10e-3)
    sliding = regression(block, 10e-3, step_s=2.5e-3)
    assert sliding.frequency_hz[::4].tobytes() == fixed.frequency_hz.tobytes()


@pytest.mark.parametrize("method", ["reciprocal", "regression", "triangular"])
def test_both_edges_need_no_duty_cycle_of_a_half(method, pulse_train):
    rising = pulse_train(60e3, 20e-3)
    falling = pulse_train(60e3, 20e-3, phase=0.37 + 0.17, seed=2)
    block = EdgeBlock(rising, 0, 2_000_000, TIMEBASE, falling)
    counter = FrequencyCounter(method, 10e-3, TIMEBASE, both_edges=True, edge_jitter_s=5e-9)
    samples = counter.push(block)
    assert np.all(samples.edges >= 1199)
    error = np.abs(samples.frequency_hz - 60e3)
    assert np.all(error < 5 * samples.standard_uncertainty_hz)


class TestFaults:
    def windows(self, ticks, stop=3_000_000, method="regression", **options):
        block = EdgeBlock(ticks, 0, stop, TIMEBASE)
        return FrequencyCounter(method, 10e-3, TIMEBASE, **options).push(block)

    @pytest.mark.parametrize("method", METHODS)
    def test_no_pulses_is_a_fault_and_never_a_number(self, method, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        silent = ticks[(ticks < 1_000_000) | (ticks >= 2_000_000)]
        samples = self.windows(silent, method=method)
        assert samples.fault.tolist()[:2] == [0, SignalFaultKind.NO_PULSES]
        assert np.isnan(samples.frequency_hz[1])
        assert np.isnan(samples.standard_uncertainty_hz[1])
        with pytest.raises(PulseTrainFault, match=r"input: no pulses.* at 0.015 s") as caught:
            samples.raise_on_fault("input")
        assert caught.value.kind is SignalFaultKind.NO_PULSES

    def test_a_silent_channel_has_only_faults(self):
        samples = self.windows(np.empty(0, dtype=np.int64))
        assert samples.fault.tolist() == [SignalFaultKind.NO_PULSES] * 3

    def test_one_edge_is_too_few(self):
        samples = self.windows(np.array([1_500_000]))
        assert samples.fault.tolist()[1] == SignalFaultKind.TOO_FEW_PULSES

    @pytest.mark.parametrize("method", METHODS)
    def test_a_missing_pulse_is_found_and_counted(self, method, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        samples = self.windows(np.delete(ticks, [900, 950, 951]), method=method)
        assert samples.fault.tolist() == [0, SignalFaultKind.MISSING_PULSES, 0]
        assert samples.missing.tolist() == [0, 3, 0]
        assert np.isnan(samples.frequency_hz[1])

    @pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.63, 0.98])
    def test_a_doubled_pulse_is_found_and_counted(self, share, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        extra = ticks[[700, 800]] + int(share * 1e8 / 60e3)
        samples = self.windows(np.sort(np.concatenate((ticks, extra))))
        assert samples.fault.tolist() == [0, SignalFaultKind.DOUBLED_PULSES, 0]
        assert samples.doubled.tolist() == [0, 2, 0]

    def test_every_pulse_doubled(self, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        samples = self.windows(np.sort(np.concatenate((ticks, ticks + 60))))
        assert samples.fault.tolist() == [SignalFaultKind.DOUBLED_PULSES] * 3
        assert np.all(np.abs(samples.doubled - 600) <= 1)

    @pytest.mark.parametrize("method", METHODS)
    def test_a_train_that_stops_within_a_window_is_a_fault_there(self, method, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        samples = self.windows(ticks[ticks < 1_500_000], method=method)
        assert samples.fault.tolist() == [
            0,
            SignalFaultKind.MISSING_PULSES,
            SignalFaultKind.NO_PULSES,
        ]

    def test_torque_that_changes_fast_is_no_fault(self):
        # 60 ± 30 kHz within 1 ms, the fastest that a transducer of 3 kHz bandwidth can show
        time = np.linspace(0, 30e-3, 400_000)
        phase = 60e3 * time + 30e3 / (2 * np.pi * 1e3) * (1 - np.cos(2 * np.pi * 1e3 * time))
        ticks = np.interp(np.arange(1, 1800), phase, time * TIMEBASE).astype(np.int64)
        assert not self.windows(ticks).fault.any()

    def test_the_check_of_the_train_can_be_switched_off(self):
        ticks = np.cumsum(np.tile([300, 3000, 1000], 700))
        ticks = ticks[ticks < 3_000_000]
        assert self.windows(ticks).fault.any()
        assert not self.windows(ticks, check_train=False).fault[:-1].any()

    def test_a_stuck_counter_repeats_itself(self):
        ticks = np.arange(0, 30_000_000, 1600)
        samples = self.windows(ticks, stop=30_000_000, stuck_windows=10)
        assert samples.fault.tolist() == [0] * 9 + [SignalFaultKind.STUCK] * 21
        assert np.isnan(samples.frequency_hz[9:]).all()
        assert not self.windows(ticks, stop=30_000_000, stuck_windows=None).fault.any()

    def test_jitter_is_no_stuck_counter(self, pulse_train):
        ticks = pulse_train(62.5e3, 0.3, jitter_s=1e-9)
        assert not self.windows(ticks, stop=30_000_000, stuck_windows=3).fault.any()

    def test_a_lost_block_is_marked_and_counting_goes_on(self, pulse_train):
        ticks = pulse_train(60e3, 50e-3)
        first, _, last = cut(ticks, 5_000_000, [1_500_000, 2_500_000])
        counter = FrequencyCounter("regression", 10e-3, TIMEBASE)
        samples = FrequencySamples.concatenate([counter.push(first), counter.push(last)])
        lost = SignalFaultKind.LOST_DATA
        assert samples.fault.tolist() == [0, lost, lost, 0, 0]
        assert np.isnan(samples.frequency_hz[[1, 2]]).all()


class TestRefusals:
    def test_blocks_that_overlap(self):
        counter = FrequencyCounter("gated", 1e-3, TIMEBASE)
        counter.push(EdgeBlock(np.array([5]), 0, 1000, TIMEBASE))
        with pytest.raises(InputError, match="block from tick 500"):
            counter.push(EdgeBlock(np.array([600]), 500, 2000, TIMEBASE))

    def test_another_timebase(self):
        counter = FrequencyCounter("gated", 1e-3, TIMEBASE)
        with pytest.raises(InputError, match="timebase"):
            counter.push(EdgeBlock(np.array([5]), 0, 1000, 80e6))

    def test_falling_edges_that_are_needed(self):
        counter = FrequencyCounter("regression", 1e-3, TIMEBASE, both_edges=True)
        with pytest.raises(InputError, match="falling"):
            counter.push(EdgeBlock(np.array([5]), 0, 1000, TIMEBASE))

    @pytest.mark.parametrize("place", [2, 600, 1100])
    def test_edges_that_do_not_increase(self, place):
        ticks = np.arange(0, 1_200_000, 1000)
        ticks[place] = ticks[place - 1]
        with pytest.raises(InputError, match="strictly increasing"):
            regression(EdgeBlock(ticks, 0, 1_200_000, TIMEBASE), 1e-3)

    def test_a_regression_too_long_for_its_sums(self):
        ticks = np.arange(0, 4_000_000, dtype=np.int64)
        with pytest.raises(InputError, match="shorter windows"):
            count_windows(ticks, [0], [4_000_000], timebase_hz=TIMEBASE)

    @pytest.mark.parametrize(
        "options",
        [
            {"window_s": 0.0},
            {"window_s": np.nan},
            {"step_s": -1.0},
            {"timebase_hz": 0.0},
            {"edge_jitter_s": -1.0},
            {"stuck_windows": 1},
            {"method": "fourier"},
        ],
    )
    def test_parameters_outside_their_range(self, options):
        good = {"method": "gated", "window_s": 1e-3, "timebase_hz": TIMEBASE}
        with pytest.raises(InputError):
            FrequencyCounter(**(good | options))

    def test_windows_out_of_order(self):
        with pytest.raises(InputError, match="ordered"):
            count_windows([1, 2, 3], [5, 0], [10, 4], timebase_hz=TIMEBASE)

    def test_no_blocks(self):
        with pytest.raises(InputError, match="no block"):
            gated([], 1e-3)


@given(
    values=st.lists(st.integers(0, 2), max_size=80),
    longest=st.integers(2, 9),
    cuts=st.lists(st.integers(0, 80), max_size=5),
)
def test_repeats_are_counted_over_any_cut(values, longest, cuts):
    frequency = np.repeat(np.array(values, dtype=np.float64), 3)
    expected = [
        k >= longest - 1 and len(set(frequency[k - longest + 1 : k + 1])) == 1
        for k in range(frequency.size)
    ]
    last, run, found = np.nan, 0, []
    for part in np.split(frequency, sorted(cuts)):
        fault = np.zeros(part.size, dtype=np.uint8)
        last, run, marked = mark_repeats(part, fault, longest, 5, last, run)
        assert marked == np.count_nonzero(fault)
        found.extend((fault == 5).tolist())
    assert found == expected
