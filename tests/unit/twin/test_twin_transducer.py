"""The transducer's operators: loops close, inner loops are forgotten, drifts are what they are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.twin import TwinParameters
from torquebench.twin.transducer import (
    LOADING_OFFSET,
    NOISES,
    fresh_transducer_state,
    transducer_frequency,
    transducer_signal,
)

NOMINAL = TwinParameters.draw("nominal", 5).input.transducer
SILENT = np.zeros(NOISES)
ODD = NOMINAL._replace(linearity=(1e-4, 1e-4))


def signals(path, *, constants=NOMINAL, state=None, temperature=23.0, speed=0.0, elapsed=0.0):
    """Relative deviation of the signal along a path of relative torques."""
    state = fresh_transducer_state() if state is None else state
    scale = constants.nominal_torque_nm
    shown = [
        transducer_signal(constants, state, x * scale, temperature, speed, elapsed, SILENT)
        for x in np.atleast_1d(path)
    ]
    return np.array(shown) / scale - np.atleast_1d(path)


def there_and_back(low, high, points=40):
    up = np.linspace(low, high, points)
    return np.concatenate((up, up[::-1][1:]))


@given(low=st.floats(-1.0, 0.4), width=st.floats(0.1, 0.6))
def test_loops_close_after_the_first_one(low, width):
    path = there_and_back(low, low + width)
    state = fresh_transducer_state()
    signals(path, state=state)
    second, third = signals(path, state=state), signals(path, state=state)
    np.testing.assert_allclose(second, third, atol=1e-15)
    assert second[0] == pytest.approx(second[-1], abs=1e-15)


def test_falling_torque_reads_more_than_rising_torque():
    path = there_and_back(0.0, 1.0, 101)
    state = fresh_transducer_state()
    signals(path, state=state)
    deviation = signals(path, state=state)
    width = deviation[101:] - deviation[:100][::-1]
    assert np.all(width[5:-5] > 0.0)
    assert 0.5e-4 < width.max() < 3e-4
    # energy: the reading lags, so the loop's area has the sign of a loss
    assert np.trapezoid(deviation, path) < 0.0


@given(
    inner=st.lists(st.floats(0.0, 0.79), min_size=1, max_size=6),
    points=st.integers(1, 30),
)
def test_inner_loops_are_wiped_out(inner, points):
    """After the outer extreme is passed, nothing tells what happened inside."""
    plain, eventful = fresh_transducer_state(), fresh_transducer_state()
    for state in (plain, eventful):
        signals([0.0, 1.0, 0.0, 0.8], state=state)
    signals([*inner, 0.8], state=eventful)
    after = np.linspace(0.8, 1.0, points + 1)[1:]
    rest = np.concatenate((after, [0.3, -0.2]))
    np.testing.assert_allclose(
        signals(rest, state=plain), signals(rest, state=eventful), atol=1e-15
    )


@given(path=st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=12))
def test_turned_over_torque_gives_turned_over_reading(path):
    there = signals(path, constants=ODD)
    back = signals([-x for x in path], constants=ODD)
    np.testing.assert_allclose(there, -back, atol=1e-16)


@given(corners=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=6), pieces=st.integers(2, 30))
def test_memory_knows_the_way_not_its_steps(corners, pieces):
    coarse, fine = fresh_transducer_state(), fresh_transducer_state()
    end = signals(corners, state=coarse)[-1]
    dense = np.concatenate(
        [np.linspace(a, b, pieces) for a, b in zip([0.0, *corners], corners, strict=False)]
    )
    assert signals(dense, state=fine)[-1] == pytest.approx(end, abs=1e-14)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("side", ["input", "output"])
def test_linearity_with_hysteresis_keeps_the_data_sheet(seed, side):
    constants = getattr(TwinParameters.draw("nominal", seed), side).transducer
    state = fresh_transducer_state()
    for sign in (1.0, -1.0):
        path = sign * there_and_back(0.0, 1.0, 201)
        signals(path, state=state, constants=constants)
        zero = signals([0.0], state=state, constants=constants)[0]
        deviation = np.abs(signals(path, state=state, constants=constants) - zero)
        size = np.abs(path)
        for share, limit in ((0.2, 1e-4), (0.6, 2e-4), (1.0, 3e-4)):
            # the hysteresis at zero counts twice where the torque has just turned
            assert deviation[size <= share].max() < limit + 1.5e-4


def test_zero_and_span_drift_and_speed():
    warm = signals([0.0, 1.0], temperature=33.0) - signals([0.0, 1.0])
    assert warm[0] == pytest.approx(10.0 * NOMINAL.zero_drift_per_k, rel=1e-9)
    assert warm[1] - warm[0] == pytest.approx(10.0 * NOMINAL.span_drift_per_k, rel=1e-9)
    assert 1e-4 < abs(warm[0]) < 1e-3
    fast = 1000.0 * 2 * np.pi / 60
    turning = signals([0.0], speed=fast)[0]
    assert 0.5e-4 < abs(turning) < 1.5e-4
    assert signals([0.0], speed=-fast)[0] == turning


def test_creep_follows_the_load_and_returns():
    state = fresh_transducer_state()
    first = signals([1.0], state=state, elapsed=1e-3)[0]
    hold = signals(np.full(60_000, 1.0), state=state, elapsed=20e-3)[-1]
    assert hold - first == pytest.approx(sum(NOMINAL.creep), rel=0.02)
    back = signals(np.zeros(60_000), state=state, elapsed=20e-3)[-1]
    assert abs(back - signals([0.0], state=state)[0]) < 1e-9


@settings(max_examples=5)
@given(seed=st.integers(0, 1000))
def test_repeatability_of_steady_readings(seed):
    generator = np.random.default_rng(seed)
    state = fresh_transducer_state()
    scale = NOMINAL.nominal_torque_nm
    found = []
    for _ in range(150):  # load to 60 %, unload, again and again
        for torque in (*np.linspace(0.02, 0.6, 12), *np.linspace(0.58, 0.0, 12)):
            normal = generator.standard_normal(NOISES)
            normal[3:] = 0.0  # neither wander nor noise of single values
            shown = transducer_signal(NOMINAL, state, torque * scale, 23.0, 0.0, 0.0, normal)
            if torque == 0.6:
                found.append(shown / scale)
    spread = np.std(np.array(found)[20:])
    assert spread == pytest.approx(NOMINAL.repeatability, rel=0.35)


def test_no_normal_numbers_no_noise():
    state = fresh_transducer_state()
    signals(there_and_back(0.0, 1.0), state=state, elapsed=1e-3)
    assert state[LOADING_OFFSET] == 0.0


def test_frequency_has_a_sensitivity_for_each_direction():
    plus = transducer_frequency(NOMINAL, 10.0) - NOMINAL.zero_hz
    minus = NOMINAL.zero_hz - transducer_frequency(NOMINAL, -10.0)
    assert plus == pytest.approx(10.0 * NOMINAL.sensitivity_hz_per_nm[0])
    assert minus == pytest.approx(10.0 * NOMINAL.sensitivity_hz_per_nm[1])
    assert plus != minus
