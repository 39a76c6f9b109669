"""Torque at the reducer's flange: what the flange takes to move isn't the reducer's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.swinging_flange import (
    INTERVAL_S,
    RATED_NM,
    STIFFNESS_NM_RAD,
    TRUE_BACKLASH,
    swinging_loop,
)

from torquebench.errors import InputError
from torquebench.reducers import (
    FlangeInertia,
    LoopSettings,
    LoopUncertainty,
    evaluate_hysteresis,
    torque_at_flange,
)

INERTIA = 0.25
RESOLUTION = 2.0 * np.pi / 3.6e6
INNER = slice(5, -5)


def swung(inertia, frequency_hz=25.0, amplitude_rad=2e-5):
    """A flange that swings on a straight spring: time, torques of spring and transducer, angle."""
    time = INTERVAL_S * np.arange(1000)
    swing = 2.0 * np.pi * frequency_hz
    angle = 1e-3 * time + amplitude_rad * np.sin(swing * time)
    spring = STIFFNESS_NM_RAD * angle
    acceleration = -(swing**2) * amplitude_rad * np.sin(swing * time)
    return time, spring, spring + inertia * acceleration, angle


@given(st.floats(0.01, 10.0), st.floats(1.0, 40.0), st.floats(1e-7, 1e-4))
@settings(max_examples=60)
def test_what_a_swinging_flange_takes_is_taken_off(inertia, frequency_hz, amplitude_rad):
    time, spring, read, angle = swung(inertia, frequency_hz, amplitude_rad)
    found, _ = torque_at_flange(time, read, angle, FlangeInertia(inertia))
    allowed = 0.07 * np.abs(read - spring).max() + 0.012 * STIFFNESS_NM_RAD * amplitude_rad
    assert np.abs(found - spring)[INNER].max() < allowed
    # Where there is no acceleration to be had, the torque stays as it was read.
    assert np.array_equal(found[:5], read[:5])
    assert np.array_equal(found[-5:], read[-5:])


def test_its_uncertainty_is_that_of_inertia_and_angle():
    time, spring, read, angle = swung(INERTIA)
    noise = RESOLUTION / 12.0**0.5
    (_, known), (_, unsure) = (
        torque_at_flange(
            time,
            read,
            angle,
            FlangeInertia(INERTIA, percent),
            standard_uncertainty_nm=0.01,
            angle_uncertainty_rad=noise,
        )
        for percent in (0.0, 20.0)
    )
    taken = np.abs(read - spring)[INNER]
    added = np.sqrt(unsure**2 - known**2)[INNER]
    assert added == pytest.approx(0.1 * taken, abs=0.01 * taken.max())
    # Counts of 3.6 million a turn, by the gain of the window for white noise.
    own = np.sqrt(known**2 - 0.01**2)
    assert own[INNER] == pytest.approx(INERTIA * 0.0322, rel=0.02)
    assert np.all(own[:5] == 0.0)


def test_of_white_noise_of_the_torque_58_per_cent_stay():
    noise = np.random.default_rng(4).standard_normal(20_000)
    time = INTERVAL_S * np.arange(noise.size)
    found, _ = torque_at_flange(time, noise, np.zeros(noise.size), FlangeInertia(INERTIA))
    assert found.std() == pytest.approx(1.0 / 3.0**0.5, rel=0.02)


def test_gaps_part_a_recording():
    time, _, read, angle = swung(INERTIA)
    flange = FlangeInertia(INERTIA)
    alone, _ = torque_at_flange(time, read, angle, flange)
    # Without the gap there would be a jump of the angle, and with it an acceleration.
    for later in (40.0, -0.5):
        joined, _ = torque_at_flange(
            np.append(time, later + time), np.append(read, read), np.append(angle, angle + 0.5),
            flange,
        )  # fmt: skip
        assert joined == pytest.approx(np.append(alone, alone), abs=1e-6)


def test_what_has_no_acceleration_is_refused():
    time, _, read, angle = swung(INERTIA)
    flange = FlangeInertia(INERTIA)
    with pytest.raises(InputError, match="8 samples without 11 of them at even times"):
        torque_at_flange(time[:8], read[:8], angle[:8], flange)
    with pytest.raises(InputError, match="at an even rate"):
        torque_at_flange(np.zeros(1000), read, angle, flange)
    with pytest.raises(InputError, match="999 times"):
        torque_at_flange(time[1:], read, angle, flange)
    for bad in ((-0.1, 10.0), (np.nan, 10.0), (0.1, np.inf)):
        with pytest.raises(InputError, match="finite, 0 or more"):
            FlangeInertia(*bad)


def rippling_loop():
    time, torque, angle = swinging_loop(INERTIA, 0.02 * RATED_NM)
    return time, torque, angle + 2e-7 * np.random.default_rng(3).standard_normal(angle.size)


def test_a_loop_is_as_wide_as_the_reducers_own():
    time, torque, angle = rippling_loop()
    found, beyond = (
        evaluate_hysteresis(
            torque,
            angle,
            LoopSettings(rated_torque_nm=RATED_NM, rule="harmonic-drive"),
            resolution_rad=RESOLUTION,
            time_s=time,
            flange=flange,
            uncertainty=LoopUncertainty(torque_branch_nm=0.01),
        )
        for flange in (FlangeInertia(INERTIA), None)
    )
    assert found.backlash.value == pytest.approx(TRUE_BACKLASH, rel=0.01)
    assert TRUE_BACKLASH - beyond.backlash.value > 0.08 * TRUE_BACKLASH
    # What a ripple still hides is known better where the torque is that at the reducer.
    assert found.backlash.expanded_uncertainty() < 0.6 * beyond.backlash.expanded_uncertainty()


def test_a_flange_asks_for_times():
    _, torque, angle = rippling_loop()
    settings = LoopSettings(rated_torque_nm=RATED_NM)
    with pytest.raises(InputError, match=r"0\.25 kg·m² ± 10 %, but no times"):
        evaluate_hysteresis(torque, angle, settings, flange=FlangeInertia(INERTIA))
