import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.signals import EdgeBlock, SignalFaultKind, regression
from torquebench.signals.analogue import AnalogueInput, Threshold, edges_of_wave
from torquebench.signals.glitches import GlitchFilter
from torquebench.signals.periods import FrequencyInput, edges_of_periods


def wave(frequency, rate, count, *, noise=0.0, seed=1):
    """A square wave as a transducer's driver and a cable round it off."""
    time = np.arange(count) / rate
    rounded = np.tanh(4 * np.sin(2 * np.pi * frequency * time + 0.3))
    return rounded + np.random.default_rng(seed).normal(0.0, noise, count)


class TestAnalogue:
    def test_interpolation_finds_times_between_samples(self):
        block = edges_of_wave(wave(12_345.6, 1e6, 20_000), 1e6)
        period = np.diff(block.ticks) / block.timebase_hz
        np.testing.assert_allclose(1 / period, 12_345.6, rtol=5e-4)
        assert 1 / period.mean() == pytest.approx(12_345.6, rel=2e-6)

    @given(cuts=st.lists(st.integers(0, 3000), max_size=6))
    def test_however_cut_the_edges_are_the_same(self, cuts):
        samples = wave(9_876.5, 1e6, 3000, noise=0.05)
        threshold = Threshold.of_wave(samples)
        stream = AnalogueInput(1e6, threshold)
        blocks = [stream.push(part) for part in np.split(samples, sorted(cuts))]
        whole = edges_of_wave(samples, 1e6, threshold)
        assert np.concatenate([block.ticks for block in blocks]).tolist() == whole.ticks.tolist()
        falling = np.concatenate([block.falling_ticks for block in blocks])
        assert falling.tolist() == whole.falling_ticks.tolist()
        for before, after in itertools.pairwise(blocks):
            assert before.stop_tick == after.start_tick

    def test_hysteresis_keeps_noise_from_doubling_edges(self):
        samples = wave(5_000.0, 1e6, 20_000, noise=0.1)
        assert len(edges_of_wave(samples, 1e6, Threshold(0.0, 0.0))) > 110
        assert len(edges_of_wave(samples, 1e6, Threshold(0.0, 1.2))) == 100

    def test_a_counter_takes_the_block_as_any_other(self):
        block = edges_of_wave(wave(60e3, 5e6, 50_000, noise=0.01), 5e6)
        samples = regression(block, 2e-3)
        assert not samples.fault.any()
        np.testing.assert_allclose(samples.frequency_hz, 60e3, rtol=2e-5)

    @pytest.mark.parametrize(
        ("act", "message"),
        [
            (lambda: edges_of_wave(np.ones(100), 1e6), "stays at 1"),
            (lambda: edges_of_wave([], 1e6), "empty"),
            (lambda: edges_of_wave([0.0, np.nan, 1.0], 1e6), "not finite"),
            (lambda: AnalogueInput(0.0, Threshold(0.0, 0.1)), "sample rate"),
            (lambda: AnalogueInput(1.0, Threshold(0.0, 0.1)).push([np.inf]), "finite"),
            (lambda: Threshold(0.0, -1.0), "hysteresis"),
        ],
    )
    def test_what_is_no_wave_is_refused(self, act, message):
        with pytest.raises(InputError, match=message):
            act()


class TestPeriods:
    @given(st.lists(st.integers(1, 10_000), min_size=1, max_size=50), st.integers(0, 50))
    def test_parts_of_a_stream_join(self, periods, cut):
        whole = edges_of_periods(periods, 1e8, start_tick=7)
        first = edges_of_periods(periods[:cut], 1e8, start_tick=7)
        rest = edges_of_periods(periods[cut:], 1e8, start_tick=first.stop_tick - 1)
        assert first.ticks.tolist() + rest.ticks.tolist() == whole.ticks.tolist()
        assert first.stop_tick == rest.start_tick
        assert rest.stop_tick == whole.stop_tick

    @pytest.mark.parametrize("periods", [[5, 0], [5, -3], [1.5]])
    def test_impossible_periods_are_refused(self, periods):
        with pytest.raises(InputError):
            edges_of_periods(periods, 1e8)


class TestSampledFrequency:
    def test_silence_and_repetition_are_faults(self):
        stream = FrequencyInput(0.02, stuck_windows=3)
        first = stream.push([0.0, 0.1, 0.2, 0.3], [60e3, 0.0, np.nan, 60e3])
        assert first.fault.tolist() == [0, 1, 1, 0]
        second = stream.push([0.4, 0.5, 0.6], [60e3, 60e3, 61e3])
        assert second.fault.tolist() == [0, SignalFaultKind.STUCK, 0]
        assert np.isnan(second.frequency_hz[1])
        assert second.standard_uncertainty_hz[0] == 0.02

    def test_the_callers_array_stays_as_it_is(self):
        frequency = np.array([0.0, 60e3])
        FrequencyInput(0.02).push([0.0, 0.1], frequency)
        assert frequency.tolist() == [0.0, 60e3]

    def test_rows_of_different_length_are_refused(self):
        with pytest.raises(InputError, match="two equal rows"):
            FrequencyInput(0.02).push([0.0], [1.0, 2.0])
        with pytest.raises(InputError, match="uncertainty"):
            FrequencyInput(np.nan)


class TestGlitches:
    def test_chatter_after_each_edge_is_left_out(self, pulse_train):
        clean = pulse_train(60e3, 5e-3)
        chatter = np.sort(np.concatenate((clean, clean[::3] + 12, clean[::3] + 25)))
        stream = GlitchFilter(1e-6, 100e6)
        kept = stream.push(EdgeBlock(chatter, 0, 500_000, 100e6))
        assert np.array_equal(kept.ticks, clean[clean < 500_000])
        assert stream.removed == chatter.size - clean.size

    def test_a_spike_goes_with_both_its_edges(self):
        rising = np.array([1000, 1500, 2000])
        falling = np.array([1300, 1504, 2300])
        stream = GlitchFilter(0.5e-6, 100e6, both_edges=True)
        kept = stream.push(EdgeBlock(rising, 0, 3000, 100e6, falling))
        assert kept.ticks.tolist() == [1000, 2000]
        assert kept.falling_ticks.tolist() == [1300, 2300]
        assert (stream.removed, kept.stop_tick) == (2, 2950)

    @given(
        steps=st.lists(st.integers(1, 60), min_size=1, max_size=60),
        cuts=st.lists(st.integers(0, 3600), max_size=6),
        both=st.booleans(),
    )
    def test_however_cut_the_same_is_left(self, steps, cuts, both):
        edges = np.cumsum(steps)
        stop = 3700

        def run(borders):
            stream = GlitchFilter(20e-8, 100e6, both_edges=both)
            blocks = []
            for low, high in zip([0, *borders], [*borders, stop], strict=True):
                part = [
                    train[(train >= low) & (train < high)] for train in (edges[::2], edges[1::2])
                ]
                blocks.append(stream.push(EdgeBlock(part[0], low, high, 100e6, part[1])))
            return blocks, stream.removed

        (whole,), removed = run([])
        blocks, removed_in_parts = run(sorted(cuts))
        assert removed == removed_in_parts
        assert np.concatenate([b.ticks for b in blocks]).tolist() == whole.ticks.tolist()
        for before, after in itertools.pairwise(blocks):
            assert before.stop_tick == after.start_tick
        if both:
            falling = np.concatenate([b.falling_ticks for b in blocks])
            assert falling.tolist() == whole.falling_ticks.tolist()
            left = np.sort(np.concatenate((whole.ticks, whole.falling_ticks)))
            assert np.all(np.diff(left) >= 20)

    @pytest.mark.parametrize(
        ("blocks", "message"),
        [
            ([EdgeBlock([1], 0, 5, 80e6, [2])], "timebase"),
            ([EdgeBlock([1], 0, 5, 100e6)], "falling"),
            ([EdgeBlock([1, 2], 0, 5, 100e6, [3])], "in a row"),
            ([EdgeBlock([1], 0, 5, 100e6, [2]), EdgeBlock([9], 8, 10, 100e6, [])], "next from"),
            ([EdgeBlock([1], 0, 5, 100e6, []), EdgeBlock([6], 5, 10, 100e6, [])], "in a row"),
        ],
    )
    def test_what_is_no_stream_is_refused(self, blocks, message):
        stream = GlitchFilter(1e-8, 100e6, both_edges=True)
        for block in blocks[:-1]:
            stream.push(block)
        with pytest.raises(InputError, match=message):
            stream.push(blocks[-1])

    def test_a_time_below_one_tick_is_refused(self):
        with pytest.raises(InputError, match="least time"):
            GlitchFilter(1e-9, 100e6)
