import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.signals import AngleCounter, EdgeBlock, PulseTrainFault, SignalFaultKind

TIMEBASE = 100e6
STOP = 3_000_000


def blocks(train, borders):
    edges = [0, *borders, STOP]
    return [
        EdgeBlock(train[(train >= low) & (train < high)], low, high, TIMEBASE)
        for low, high in itertools.pairwise(edges)
    ]


# A ripple of one period per revolution, 90 marks each, while the speed triples.
TIME = np.linspace(0, 0.03, 60_001)
ANGLE = 2 * np.pi * (400 * TIME + 0.5 * 26_000 * TIME**2)
PHASE = np.concatenate(([0.0], np.cumsum(60e3 + 300 * np.sin(ANGLE[1:])) * (TIME[1] - TIME[0])))
TORQUE = np.round(np.interp(np.arange(0.3, PHASE[-1]), PHASE, TIME) * TIMEBASE).astype(np.int64)
MARKS = np.round(
    np.interp(np.arange(0.5, ANGLE[-1] / (2 * np.pi) * 90), ANGLE / (2 * np.pi) * 90, TIME)
    * TIMEBASE
).astype(np.int64)


def test_a_window_of_one_revolution_averages_the_ripple_out():
    counter = AngleCounter("gated", 90, 90, TIMEBASE)
    samples = counter.push(*(blocks(train, [])[0] for train in (TORQUE, MARKS)))
    assert len(samples.frequency) >= 20
    counts = AngleCounter("reciprocal", 90, 90, TIMEBASE)
    whole = counts.push(*(blocks(train, [])[0] for train in (TORQUE, MARKS)))
    # Ripple ±300 Hz; what is left comes from the speed's change within the revolution and
    # from edges, which don't fall on the marks.
    assert np.max(np.abs(whole.frequency.frequency_hz - 60e3)) < 30
    np.testing.assert_allclose(np.diff(samples.angle_rad), 2 * np.pi)


def test_speed_and_angle_follow_the_marks():
    counter = AngleCounter("regression", 9, 90, TIMEBASE)
    samples = counter.push(*(blocks(train, [])[0] for train in (TORQUE, MARKS)))
    expected = np.interp(samples.frequency.time_s, TIME, np.gradient(ANGLE, TIME))
    np.testing.assert_allclose(samples.speed_rad_s, expected, rtol=2e-3)
    first_mark = np.interp(MARKS[0] / TIMEBASE, TIME, ANGLE)
    at = np.interp(samples.frequency.time_s, TIME, ANGLE) - first_mark
    np.testing.assert_allclose(samples.angle_rad, at, atol=0.05)


@given(borders=st.lists(st.integers(0, STOP), max_size=6), per_window=st.integers(1, 40))
def test_however_cut_the_windows_are_the_same(borders, per_window):
    results = []
    for cuts in ([], sorted(borders)):
        counter = AngleCounter("regression", per_window, 90, TIMEBASE)
        parts = [
            counter.push(block, marks)
            for block, marks in zip(blocks(TORQUE, cuts), blocks(MARKS, cuts), strict=True)
        ]
        results.append(
            (
                np.concatenate([part.frequency.frequency_hz for part in parts]).tobytes(),
                np.concatenate([part.angle_rad for part in parts]).tobytes(),
                np.concatenate([part.speed_rad_s for part in parts]).tobytes(),
            )
        )
    assert results[0] == results[1]


def test_without_all_marks_there_is_no_angle():
    counter = AngleCounter("regression", 9, 90, TIMEBASE)
    torque, marks = blocks(TORQUE, [1_000_000, 2_000_000]), blocks(MARKS, [1_000_000, 2_000_000])
    counter.push(torque[0], marks[0])
    with pytest.raises(PulseTrainFault) as caught:
        counter.push(torque[2], marks[2])
    assert caught.value.kind is SignalFaultKind.LOST_DATA


def test_both_channels_cover_the_same_time():
    counter = AngleCounter("regression", 9, 90, TIMEBASE)
    with pytest.raises(InputError, match="different intervals"):
        counter.push(blocks(TORQUE, [])[0], blocks(MARKS, [5])[1])


@pytest.mark.parametrize("marks", [(0, 90), (9, 0)])
def test_windows_need_marks(marks):
    with pytest.raises(InputError, match="marks per"):
        AngleCounter("regression", *marks, TIMEBASE)
