"""Real recordings of logic analysers and a scope give their known frequencies."""

import numpy as np
import pytest

from torquebench.signals import FrequencyCounter, count_windows, regression
from torquebench.signals.analogue import edges_of_wave
from torquebench.signals.sigrok import parse_sigrok


@pytest.fixture(scope="module")
def recording(reference_data):
    def read(name):
        return parse_sigrok(reference_data(f"sigrok-pulse-trains/{name}").read_bytes())

    return read


def test_the_function_generator_on_the_analysers_clock(recording):
    block = recording("fgen_1mhz_12MSps_1s.sr").edges(0)
    assert block.timebase_hz == 12e6
    assert len(block) == 999_846
    intervals = np.diff(block.ticks)
    assert (intervals.min(), intervals.max()) == (11, 13)
    window = [block.ticks[0]], [block.ticks[-1] + 1]
    for method, expected in (("reciprocal", 999_846.08), ("regression", 999_846.10)):
        # Twelve ticks in a period: an interval of 11 or 13 is no irregular pulse.
        samples = count_windows(block.ticks, *window, method, timebase_hz=block.timebase_hz)
        assert samples.frequency_hz[0] == pytest.approx(expected, abs=0.006)
        assert not samples.fault.any()


def test_its_frequency_is_steady_over_windows(recording):
    block = recording("fgen_1mhz_12MSps_1s.sr").edges(0)
    samples = regression(block, 10e-3).raise_on_fault("function generator")
    assert len(samples) == 100
    assert samples.frequency_hz.mean() == pytest.approx(999_846.1, abs=0.3)
    assert np.ptp(samples.frequency_hz) < 5.0


@pytest.mark.parametrize(
    ("name", "edges", "shortest"), [("grbl_cnc_1.sr", 10_508, 492), ("grbl_cnc_3.sr", 56_903, 295)]
)
def test_step_pulses_with_ramps_and_pauses(recording, name, edges, shortest):
    block = recording(name).edges("STEP (Y axis)")
    assert len(block) == edges
    assert np.diff(block.ticks).min() == shortest
    counter = FrequencyCounter("regression", 50e-3, block.timebase_hz, check_train=False)
    samples = counter.push(block)
    # Where the axis moves there is a frequency, where it stands a fault and never 0 Hz.
    assert 0 < samples.valid.sum() < len(samples)
    assert np.nanmax(samples.frequency_hz) <= 2e6 / shortest
    assert np.nanmin(samples.frequency_hz) > 0


def test_pwm_and_its_crosstalk_have_one_frequency(recording):
    pwm = recording("pwmtest_snippet.sr")
    frequencies = []
    for channel in (4, 5):
        block = pwm.edges(channel)
        samples = regression(block, 20e-3).raise_on_fault("pwm")
        frequencies.append(samples.frequency_hz.mean())
    # 384 samples per period at 24 MHz is 62 500 Hz; the recording is 0.011 % slower.
    assert frequencies == pytest.approx([62_493.0] * 2, abs=1.0)


def test_the_scopes_square_wave(reference_data):
    path = reference_data("sigrok-pulse-trains/scope_1k2_square_ch1_scope_13_1.csv")
    table = np.loadtxt(path, delimiter=",", skiprows=2)
    rate = (len(table) - 1) / (table[-1, 0] - table[0, 0])
    assert rate == pytest.approx(5e6, rel=1e-6)
    block = edges_of_wave(table[:, 1], rate)
    periods = np.diff(block.ticks) / block.timebase_hz
    assert 1 / periods.mean() == pytest.approx(1199.99, abs=0.15)
    assert 1 / np.diff(block.falling_ticks / block.timebase_hz).mean() == pytest.approx(
        1199.99, abs=0.15
    )
