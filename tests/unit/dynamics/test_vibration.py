"""Vibration after steps of torque, and delay, of a shaft simulated by itself."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from torquebench.dynamics import (
    Delay,
    Inertia,
    MotorInertia,
    Sine,
    Steps,
    Vibration,
    identify_delay,
    identify_vibration,
    shaft_on_bench,
)
from torquebench.errors import InputError

INTERVAL_S = 1e-3
FINE = 20
MOTOR = MotorInertia(0.012, 0.00024)
FLANGE = Inertia(0.0025, 1e-5, 31.0, 400)


def shaken(
    seed: int, *, frequency_hz: float = 230.0, damping: float = 0.05, rise_s: float = 2e-3,
    late_s: float = 0.0, count: int = 60, ripple_hz: float = 33.0,
) -> Steps:  # fmt: skip
    """Steps of 0.5 N·m: a drive with a lag of 6 ms, its ripple, and noise of 0.008 N·m."""
    draw = np.random.default_rng(seed)
    fine_s, samples = INTERVAL_S / FINE, 200
    time = (np.arange(samples * FINE) - 20 * FINE) * fine_s
    natural = 2.0 * np.pi * frequency_hz
    swing = ([natural**2], np.polymul([1.0, 2.0 * damping * natural, natural**2], [6e-3, 1.0]))
    (above,), below, _ = cont2discrete(swing, fine_s, method="foh")
    rows = []
    for number in range(count):
        begins_s = draw.uniform(0.0, 5e-3)
        asked = 0.5 * np.clip((time - begins_s) / rise_s, 0.0, 1.0) * (-1) ** number
        phase = draw.uniform(0.0, 2.0 * np.pi)
        asked = asked + 0.02 * np.sin(2.0 * np.pi * ripple_hz * time + phase)
        torque = lfilter(above, below, asked)
        late = np.interp(time - late_s, time, torque)
        both = np.array([1.01 * late, torque]).reshape(2, samples, FINE).mean(axis=2)
        rows.append(both + [[0.008], [0.0025]] * draw.standard_normal(both.shape))
    found = np.array(rows)
    return Steps(INTERVAL_S, found[:, 0], found[:, 1])


@pytest.mark.parametrize(
    ("frequency_hz", "damping", "ripple_hz"), [(230.0, 0.05, 33.0), (80.0, 0.07, 39.5)]
)
def test_frequency_and_damping_come_back_within_their_u(
    frequency_hz: float, damping: float, ripple_hz: float
) -> None:
    misses = []
    for seed in range(3):
        steps = shaken(seed, frequency_hz=frequency_hz, damping=damping, ripple_hz=ripple_hz)
        found = identify_vibration(steps)
        assert found.steps == 60
        u = np.sqrt(np.diag(found.covariance))
        assert u[0] < 0.02 * frequency_hz
        misses += [
            (found.frequency_hz - frequency_hz) / u[0], (found.damping_ratio - damping) / u[1]
        ]  # fmt: skip
    assert np.max(np.abs(misses)) < 4.0
    assert np.sqrt(np.mean(np.square(misses))) < 2.0


@pytest.mark.parametrize("late_s", [-6e-5, 1.5e-4])
def test_the_delay_behind_the_reference_comes_back(late_s: float) -> None:
    found = identify_delay(shaken(1, late_s=late_s))
    assert abs(found.delay_s - late_s) < 3.0 * found.standard_uncertainty_s + 2e-6
    assert found.standard_uncertainty_s < 2e-5


def test_sines_of_two_periods_show_the_delay_beside_hysteresis() -> None:
    draw, sines = np.random.default_rng(3), []
    for period_s in (4.0, 1.0):
        time = np.arange(round(4.0 * period_s / INTERVAL_S)) * INTERVAL_S
        rate = 2.0 * np.pi / period_s
        standard = 10.0 + 7.5 * np.sin(rate * time)
        reading = 10.0 + 7.5 * np.sin(rate * (time - 1.5e-4) - 5e-4)  # 5e-4 rad of hysteresis
        noise = 0.008 * draw.standard_normal((2, time.size))
        sines.append(Sine(INTERVAL_S, period_s, reading + noise[0], standard + noise[1]))
    steps = shaken(1, late_s=1.5e-4)
    alone, found = identify_delay(steps), identify_delay(steps, sines)
    assert abs(found.delay_s - 1.5e-4) < 3.0 * found.standard_uncertainty_s + 2e-6
    assert found.standard_uncertainty_s < 1.5 * alone.standard_uncertainty_s


def test_steps_that_do_not_identify_are_refused_with_what_would() -> None:
    steps = shaken(1)
    with pytest.raises(InputError, match="don't identify the shaft's vibration") as refused:
        identify_vibration(shaken(1, rise_s=0.06))  # too slow to make the shaft vibrate
    assert "within half a period" in str(refused.value)
    noise = 0.008 * np.random.default_rng(1).standard_normal(steps.reading_nm.shape)
    with pytest.raises(InputError, match="no vibration stands out"):
        identify_vibration(replace(steps, reading_nm=noise))
    with pytest.raises(InputError, match="4 steps"):
        identify_vibration(replace(steps, reading_nm=steps.reading_nm[:4]))
    with pytest.raises(InputError, match="readings after each step"):
        identify_vibration(replace(steps, reading_nm=steps.reading_nm[:, :50]))
    broken = steps.reading_nm.copy()
    broken[3, 7] = np.nan
    with pytest.raises(InputError, match="gaps"):
        identify_vibration(replace(steps, reading_nm=broken))


def test_the_motor_s_vibration_gives_the_chain_s_resonance() -> None:
    vibration = Vibration(230.0, 0.05, ((0.25, 0.0), (0.0, 1e-6)), 60)
    transfer, shaft = shaft_on_bench(vibration, MOTOR, FLANGE, Delay(2.2e-4, 1e-5))
    assert transfer.resonance_hz == pytest.approx(230.0 * np.sqrt(0.012 / 0.0025))
    assert shaft.stiffness_nm_rad == pytest.approx(0.012 * (2.0 * np.pi * 230.0) ** 2)
    assert shaft.stiffness_uncertainty_nm_rad == pytest.approx(
        shaft.stiffness_nm_rad * np.hypot(2.0 * 0.5 / 230.0, 0.02)
    )
    # c and k are those of one shaft, on either inertia
    natural = 2.0 * np.pi * transfer.resonance_hz
    damping = 2.0 * transfer.damping_ratio * FLANGE.inertia_kgm2 * natural
    assert shaft.damping_nm_s == pytest.approx(damping)
    assert transfer.lag_s + transfer.delay_s == pytest.approx(2.2e-4)
    vague = MotorInertia(0.012, 0.0024)
    with pytest.raises(InputError, match="motor's inertia") as refused:
        shaft_on_bench(vibration, vague, FLANGE, Delay(2.2e-4, 1e-5))
    assert "more exactly" in str(refused.value)
