import itertools

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.counting import counted

from torquebench.errors import InputError
from torquebench.signals import (
    EdgeBlock,
    FrequencyCounter,
    PulseTrainFault,
    Record,
    SignalFaultKind,
)
from torquebench.signals.counters import irregularities

METHODS = ["reciprocal", "regression", "triangular"]
TIMEBASE = 100e6


# Textbook formulas of the counters in floating point, independent of the kernels' integer sums:
# mean period of the edges of one window, whose start is 0.


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
    "reciprocal": reciprocal_period,
    "regression": regression_period,
    "triangular": triangular_period,
}


def reference_frequency(ticks, starts, stops, method):
    """Frequency of each window [start, stop) in Hz, NaN where it has too few edges."""
    result = []
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        inside = ticks[(ticks >= start) & (ticks < stop)] - start
        enough = inside.size >= 2
        period = PERIODS[method](inside.astype(float), stop - start) if enough else np.nan
        result.append(TIMEBASE / period)
    return np.array(result)


def cut(ticks, stop, borders):
    """The same stream in blocks between the given ticks."""
    blocks = []
    for low, high in itertools.pairwise([0, *sorted(borders), stop]):
        first, last = np.searchsorted(ticks, (low, high))
        blocks.append(EdgeBlock(ticks[first:last], low, high, TIMEBASE))
    return blocks


def same_to_the_last_bit(one: Record, other: Record) -> bool:
    return set(one) == set(other) and all(
        one[name].tobytes() == other[name].tobytes() for name in one
    )


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_a_stream_cut_anywhere_gives_the_same_to_the_last_bit(method, data):
    stop = 60_000
    intervals = data.draw(st.lists(st.integers(1, 3000), min_size=0, max_size=120))
    ticks = np.cumsum(np.array(intervals, dtype=np.int64))
    ticks = ticks[ticks < stop]
    window_s = data.draw(st.integers(1_000, 20_000)) / TIMEBASE
    borders = data.draw(st.lists(st.integers(0, stop), max_size=12))
    whole, parts = (counted(cut(ticks, stop, each), window_s, method) for each in ([], borders))
    assert same_to_the_last_bit(whole, parts)


@pytest.mark.parametrize("method", METHODS)
def test_a_block_of_few_ticks_each_changes_nothing(method, pulse_train):
    ticks = pulse_train(100e3, 0.1e-3)
    whole, single = cut(ticks, 10_000, []), cut(ticks, 10_000, range(1, 10_000, 7))
    assert same_to_the_last_bit(counted(whole, 30e-6, method), counted(single, 30e-6, method))


@pytest.mark.parametrize("method", METHODS)
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_counters_agree_with_their_numpy_reference(method, data):
    intervals = data.draw(st.lists(st.integers(1, 5000), min_size=0, max_size=200))
    window = data.draw(st.integers(1, 60_000))
    offset = window * data.draw(st.integers(0, 2**52 // window))
    ticks = np.cumsum(np.array(intervals, dtype=np.int64)) + offset
    count = 9
    block = EdgeBlock(
        ticks[ticks < offset + count * window], offset, offset + count * window, TIMEBASE
    )
    record = counted(block, window / TIMEBASE, method, check_train=False)
    starts = offset + window * np.arange(count)
    expected = reference_frequency(ticks, starts, starts + window, method)
    np.testing.assert_allclose(record["frequency_hz"], expected, rtol=1e-12)


@pytest.mark.parametrize("method", METHODS)
def test_long_windows_over_many_look_ahead_chunks(method, pulse_train):
    ticks = pulse_train(240e3, 0.2)
    record = counted(EdgeBlock(ticks, 0, 20_000_000, TIMEBASE), 3_333_333 / TIMEBASE, method)
    assert not record["fault"].any()
    starts = np.arange(6) * 3_333_333
    np.testing.assert_allclose(
        record["frequency_hz"],
        reference_frequency(ticks, starts, starts + 3_333_333, method),
        rtol=1e-12,
    )


def test_the_regression_is_exact_far_from_the_origin():
    start = 2**61 // 100_000 * 100_000
    block = EdgeBlock(np.arange(0, 100_000, 1600) + start, start, start + 100_000, TIMEBASE)
    assert counted(block, 1e-3)["frequency_hz"].tolist() == [62_500.0]


def test_windows_lie_on_one_grid_for_all_channels(pulse_train):
    late = EdgeBlock(
        pulse_train(60e3, 20e-3)[200:] + 1_000_000, 1_250_000, 3_000_000, timebase_hz=TIMEBASE
    )
    np.testing.assert_allclose(counted(late, 5e-3)["time_s"], [0.0175, 0.0225, 0.0275])


class TestFaults:
    def windows(self, ticks, stop=3_000_000, method="regression", **options):
        block = EdgeBlock(ticks, 0, stop, TIMEBASE)
        return FrequencyCounter(method, 10e-3, TIMEBASE, **options).push(block)

    @pytest.mark.parametrize("method", METHODS)
    def test_no_pulses_is_a_fault_and_never_a_number(self, method, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        silent = ticks[(ticks < 1_000_000) | (ticks >= 2_000_000)]
        samples = self.windows(silent, method=method)
        assert samples["fault"].tolist()[:2] == [0, SignalFaultKind.NO_PULSES]
        assert np.isnan(samples["frequency_hz"][1])
        assert np.isnan(samples["frequency_uncertainty_hz"][1])
        with pytest.raises(PulseTrainFault, match=r"input: no pulses.* at 0.015 s") as caught:
            samples.raise_on_fault("input")
        assert caught.value.kind is SignalFaultKind.NO_PULSES

    def test_a_silent_channel_has_only_faults(self):
        samples = self.windows(np.empty(0, dtype=np.int64))
        assert samples["fault"].tolist() == [SignalFaultKind.NO_PULSES] * 3

    def test_one_edge_is_too_few(self):
        samples = self.windows(np.array([1_500_000]))
        assert samples["fault"].tolist()[1] == SignalFaultKind.TOO_FEW_PULSES

    @pytest.mark.parametrize("method", METHODS)
    def test_a_missing_pulse_is_found(self, method, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        samples = self.windows(np.delete(ticks, [900, 950, 951]), method=method)
        assert samples["fault"].tolist() == [0, SignalFaultKind.MISSING_PULSES, 0]
        assert np.isnan(samples["frequency_hz"][1])

    @pytest.mark.parametrize("share", [0.02, 0.3, 0.5, 0.63, 0.98])
    def test_a_doubled_pulse_is_found(self, share, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        extra = ticks[[700, 800]] + int(share * 1e8 / 60e3)
        samples = self.windows(np.sort(np.concatenate((ticks, extra))))
        assert samples["fault"].tolist() == [0, SignalFaultKind.DOUBLED_PULSES, 0]

    def test_every_pulse_doubled(self, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        samples = self.windows(np.sort(np.concatenate((ticks, ticks + 60))))
        assert samples["fault"].tolist() == [SignalFaultKind.DOUBLED_PULSES] * 3

    @pytest.mark.parametrize("method", METHODS)
    def test_a_train_that_stops_within_a_window_is_a_fault_there(self, method, pulse_train):
        ticks = pulse_train(60e3, 30e-3)
        samples = self.windows(ticks[ticks < 1_500_000], method=method)
        assert samples["fault"].tolist() == [
            0,
            SignalFaultKind.MISSING_PULSES,
            SignalFaultKind.NO_PULSES,
        ]

    def test_torque_that_changes_fast_is_no_fault(self):
        # 60 ± 30 kHz within 1 ms, the fastest that a transducer of 3 kHz bandwidth can show
        time = np.linspace(0, 30e-3, 400_000)
        phase = 60e3 * time + 30e3 / (2 * np.pi * 1e3) * (1 - np.cos(2 * np.pi * 1e3 * time))
        ticks = np.interp(np.arange(1, 1800), phase, time * TIMEBASE).astype(np.int64)
        assert not self.windows(ticks)["fault"].any()

    def test_the_check_of_the_train_can_be_switched_off(self):
        ticks = np.cumsum(np.tile([300, 3000, 1000], 700))
        ticks = ticks[ticks < 3_000_000]
        assert self.windows(ticks)["fault"].any()
        assert not self.windows(ticks, check_train=False)["fault"][:-1].any()

    def test_a_lost_block_is_marked_and_counting_goes_on(self, pulse_train):
        ticks = pulse_train(60e3, 50e-3)
        first, _, last = cut(ticks, 5_000_000, [1_500_000, 2_500_000])
        counter = FrequencyCounter("regression", 10e-3, TIMEBASE)
        samples = Record.join([counter.push(first), counter.push(last)])
        lost = SignalFaultKind.LOST_DATA
        assert samples["fault"].tolist() == [0, lost, lost, 0, 0]
        assert np.isnan(samples["frequency_hz"][[1, 2]]).all()


class TestRefusals:
    def test_blocks_that_overlap(self):
        counter = FrequencyCounter("reciprocal", 1e-3, TIMEBASE)
        counter.push(EdgeBlock(np.array([5]), 0, 1000, TIMEBASE))
        with pytest.raises(InputError, match="block from tick 500"):
            counter.push(EdgeBlock(np.array([600]), 500, 2000, TIMEBASE))

    def test_another_timebase(self):
        counter = FrequencyCounter("reciprocal", 1e-3, TIMEBASE)
        with pytest.raises(InputError, match="timebase"):
            counter.push(EdgeBlock(np.array([5]), 0, 1000, 80e6))

    @pytest.mark.parametrize("place", [2, 600, 1100])
    def test_edges_that_do_not_increase(self, place):
        ticks = np.arange(0, 1_200_000, 1000)
        ticks[place] = ticks[place - 1]
        with pytest.raises(InputError, match="strictly increasing"):
            counted(EdgeBlock(ticks, 0, 1_200_000, TIMEBASE), 1e-3)

    def test_a_regression_too_long_for_its_sums(self):
        ticks = np.arange(0, 4_000_000, dtype=np.int64)
        with pytest.raises(InputError, match="shorter windows"):
            counted(EdgeBlock(ticks, 0, 4_000_000, TIMEBASE), 0.04)

    @pytest.mark.parametrize(
        "options",
        [
            {"window_s": 0.0},
            {"window_s": np.nan},
            {"timebase_hz": 0.0},
            {"edge_jitter_s": -1.0},
            {"method": "fourier"},
        ],
    )
    def test_parameters_outside_their_range(self, options):
        good = {"method": "reciprocal", "window_s": 1e-3, "timebase_hz": TIMEBASE}
        with pytest.raises(InputError):
            FrequencyCounter(**(good | options))


@given(
    st.sets(st.integers(5, 90), max_size=6),
    st.integers(100, 5000),
    st.integers(0, 2**32 - 1),
)
def test_missing_pulses_are_counted(missing, period, seed):
    jitter = np.random.default_rng(seed).integers(-period // 50, period // 50 + 1, 100)
    ticks = np.delete(np.arange(100) * period + jitter, sorted(missing))
    assert irregularities(ticks) == (len(missing), 0, False)


def test_a_regular_train_has_no_irregularities():
    assert irregularities(np.arange(0, 1000, 7), 1000) == (0, 0, False)
    assert irregularities(np.array([5])) == (0, 0, False)
    assert irregularities(np.arange(0, 1000, 10), 1200).stopped
