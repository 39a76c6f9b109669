"""Injected faults: what breaks is exactly what was asked for, and heals afterwards."""

import numpy as np
import pytest

from torquebench.errors import InputError
from torquebench.twin import CHANNELS, BenchTwin, TwinParameters
from torquebench.twin.faults import broken_frequency, make_fault

PARAMETERS = TwinParameters.draw("nominal", 2)


def run(kind=None, *, cuts=(0.2,), channel="input_torque", **options):
    twin = BenchTwin(PARAMETERS, 3)
    twin.mount("calibrator")
    twin.set_clamped(True)
    if kind:
        twin.inject_fault(channel, kind, start_s=0.05, **options)
    return [twin.advance(cut) for cut in cuts]


def edges(blocks, channel="input_torque"):
    return np.concatenate([block.edges[channel] for block in blocks])


HEALTHY = edges(run())
INSIDE = (HEALTHY >= 5_000_000) & (HEALTHY < 10_000_000)


def test_silence():
    ticks = edges(run("silent"))
    np.testing.assert_array_equal(ticks, HEALTHY[~INSIDE])


def test_every_hundredth_pulse_is_missing():
    ticks = edges(run("missing_pulses"))
    lost = np.setdiff1d(HEALTHY, ticks)
    assert np.all(np.isin(lost, HEALTHY[INSIDE]))
    np.testing.assert_array_equal(np.diff(np.searchsorted(HEALTHY, lost)), 100)


def test_every_tenth_pulse_is_doubled():
    ticks = edges(run("doubled_pulses", amount=10))
    extra = np.setdiff1d(ticks, HEALTHY)
    assert extra.size == pytest.approx(INSIDE.sum() / 10, abs=1)
    np.testing.assert_array_equal(np.isin(extra - 20, HEALTHY), True)
    assert np.all(np.diff(ticks) > 0)


def test_frozen_frequency_doesnt_move():
    period = np.diff(edges(run("frozen", duration_s=0.1)))
    number = np.searchsorted(HEALTHY, [5_300_000, 14_900_000])
    held = period[number[0] : number[1]]
    whole = np.cumsum(held)
    line = whole - np.arange(1, whole.size + 1) * held.mean()
    assert np.max(np.abs(line - line.mean())) < 4.0  # ticks: jitter only
    free = np.cumsum(np.diff(HEALTHY)[number[0] : number[1]])
    wandering = free - np.arange(1, free.size + 1) * free[-1] / free.size
    assert np.max(np.abs(wandering)) > 5.0


@pytest.mark.parametrize(
    ("kind", "low", "high"), [("outlier", 71e3, 73e3), ("out_of_modulation", 5.9e3, 6.1e3)]
)
def test_frequency_jumps_and_comes_back(kind, low, high):
    ticks = edges(run(kind))
    frequency = 1e8 / np.diff(ticks)
    middle = (ticks[1:] > 5_300_000) & (ticks[:-1] < 9_900_000)
    assert np.all((frequency[middle] > low) & (frequency[middle] < high))
    outside = (ticks[1:] < 4_900_000) | (ticks[:-1] > 10_300_000)
    assert np.all(np.abs(frequency[outside] - 60e3) < 1e3)


def test_a_wrong_span_scales_what_is_beyond_the_zero():
    fault = make_fault("input_torque", "wrong_span", 10, 20, 1.5)
    frequency = np.array([60e3, 61e3, 61e3, 58e3])
    spoilt = broken_frequency([fault], frequency, np.array([5, 10, 15, 19]), 60e3)
    np.testing.assert_allclose(spoilt, [60e3, 61.5e3, 61.5e3, 57e3])


@pytest.mark.parametrize("kind", ["missing_pulses", "doubled_pulses", "outlier", "frozen"])
def test_faults_dont_depend_on_the_blocks(kind):
    whole = edges(run(kind))
    pieces = edges(run(kind, cuts=(0.0513, 0.0007, 0.05, 0.0333, 0.0647)))
    np.testing.assert_array_equal(whole, pieces)


def test_other_channels_stay_healthy():
    healthy, broken = run()[0], run("silent")[0]
    for channel in CHANNELS[1:]:
        np.testing.assert_array_equal(healthy.edges[channel], broken.edges[channel])


def test_encoder_slips_once():
    healthy, broken = run()[0], run("encoder_slip", channel="output", amount=77)[0]
    slipped = healthy.angles["output"].counts - broken.angles["output"].counts
    np.testing.assert_array_equal(slipped, np.where(healthy.truth.time_s >= 0.05, 77, 0))
    np.testing.assert_array_equal(healthy.angles["input"].counts, broken.angles["input"].counts)


@pytest.mark.parametrize(
    ("channel", "kind", "options", "message"),
    [
        ("input_torque", "burnt", {}, "one of silent"),
        ("input", "silent", {}, "input_torque"),
        ("input_torque", "encoder_slip", {}, "input, output"),
        ("input_torque", "silent", {"duration_s": 0.0}, "above 0 s"),
        ("input_torque", "missing_pulses", {"amount": 0.5}, "at least 1"),
    ],
)
def test_impossible_faults_are_refused(channel, kind, options, message):
    twin = BenchTwin(PARAMETERS, 1)
    with pytest.raises(InputError, match=message):
        twin.inject_fault(channel, kind, **options)
