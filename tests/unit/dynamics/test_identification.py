"""Transfer functions and inertia from simulated runs with a known truth."""

from math import pi, sqrt

import numpy as np
import pytest
from tests.unit.dynamics.simulated_chain import SimulatedChain, sines, slow, steps

from torquebench.dynamics import (
    Inertia,
    Known,
    TransferFunction,
    identify,
    identify_inertia,
    shaft_of,
)
from torquebench.errors import InputError

CHAIN = SimulatedChain()
RESONANCE_HZ = sqrt(CHAIN.stiffness_nm_rad / CHAIN.inertia_kgm2) / (2.0 * pi)
DAMPING = CHAIN.damping_nm_s / (2.0 * sqrt(CHAIN.stiffness_nm_rad * CHAIN.inertia_kgm2))


def known(torque: object, duration_s: float, chain: SimulatedChain = CHAIN, seed: int = 0) -> Known:
    _, reading, standard = chain.run(torque, duration_s, seed)  # type: ignore[arg-type]
    return Known(chain.interval_s, 1.003 * reading + 0.1, standard)  # static errors don't matter


@pytest.mark.parametrize(("torque", "duration_s"), [(steps, 0.09), (sines, 0.25)])
def test_resonance_damping_and_lag_follow_from_steps_or_sines(
    torque: object, duration_s: float
) -> None:
    found = identify([known(torque, duration_s)], CHAIN.interval_s)
    for name, truth in (("resonance_hz", RESONANCE_HZ), ("damping_ratio", DAMPING)):
        error = getattr(found, name) - truth
        assert abs(error) < 3.0 * found.standard_uncertainty(name)
        assert abs(error) < 0.01 * truth
    late = found.lag_s + found.delay_s - CHAIN.lag_s - CHAIN.delay_s
    assert abs(late) < 5e-6
    for name, truth in (("lag_s", CHAIN.lag_s), ("delay_s", CHAIN.delay_s)):
        assert abs(getattr(found, name) - truth) < 3.0 * found.standard_uncertainty(name)


@pytest.mark.nightly
def test_the_uncertainty_covers_what_noise_does() -> None:
    truth = np.array([RESONANCE_HZ, DAMPING, CHAIN.lag_s, CHAIN.delay_s])
    inside = []
    for seed in range(6):
        found = identify([known(sines, 0.25, seed=seed)], CHAIN.interval_s)
        u = np.sqrt(np.diag(found.covariance))
        inside.append(np.abs(found.values - truth) < 2.0 * u)
    assert np.mean(inside) >= 0.8


def test_two_runs_say_more_than_one() -> None:
    one = identify([known(steps, 0.09)], CHAIN.interval_s)
    both = identify([known(steps, 0.09), known(sines, 0.25)], CHAIN.interval_s)
    assert both.standard_uncertainty("resonance_hz") < one.standard_uncertainty("resonance_hz")


@pytest.mark.parametrize(
    ("run", "word"),
    [
        (lambda: known(slow, 0.3), "don't identify the chain"),
        (lambda: known(steps, 0.09, SimulatedChain(noise_nm=25.0)), "don't identify the chain"),
        (lambda: Known(1e-4, np.zeros(100), np.zeros(100)), "doesn't change"),
        (lambda: Known(1e-4, np.full(100, np.nan), np.arange(100.0)), "gaps"),
        (lambda: Known(1e-4, np.zeros(10), np.zeros(10)), "50 at least"),
    ],
)
def test_runs_that_cannot_identify_it_are_refused_with_what_would(run: object, word: str) -> None:
    with pytest.raises(InputError, match=word):
        identify([run()], CHAIN.interval_s)  # type: ignore[operator]


def empty_run(
    ramps: tuple[float, ...] = (10.0, 31.0), *, inertia: float = 0.0025, seed: int = 1
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ramps to 1200 rpm and back in both directions, rad/s², with zero, drag and drift."""
    interval, speed = 0.01, [0.0]
    for ramp in ramps:
        for top in (125.0, 0.0, -125.0, 0.0):
            while abs(speed[-1] - top) > 1e-9:
                step = np.clip(top - speed[-1], -ramp * interval, ramp * interval)
                speed.append(speed[-1] + step)
            speed += [speed[-1]] * 100
    turning = np.array(speed)
    time = np.arange(turning.size) * interval
    generator = np.random.default_rng(seed)
    reading = (
        0.02
        + 1e-3 * time / 60.0
        + 2e-5 * np.abs(turning)
        + inertia * np.gradient(turning, interval)
    )
    reading += 0.003 * np.tanh(turning / 0.5) + 1e-5 * turning
    reading += 0.002 * generator.standard_normal(time.size)
    return time, reading, turning * 60.0 / (2.0 * pi)


def test_inertia_follows_from_ramps_beside_drag_and_zero_over_speed() -> None:
    errors = []
    for seed in range(20):
        found = identify_inertia(*empty_run(seed=seed))
        assert found.standard_uncertainty_kgm2 < 0.01 * 0.0025
        errors.append((found.inertia_kgm2 - 0.0025) / found.standard_uncertainty_kgm2)
    assert np.mean(np.abs(errors) < 2.0) >= 0.85
    assert found.largest_rad_s2 == pytest.approx(31.0, rel=1e-3)


def test_an_empty_run_without_ramps_is_refused() -> None:
    time, reading, speed = empty_run((10.0,))
    steady = np.full_like(speed, 600.0)
    with pytest.raises(InputError, match="gentle and steep ramps"):
        identify_inertia(time, reading, steady)
    with pytest.raises(InputError, match="known to 5 %"):
        identify_inertia(*empty_run((0.5, 1.0), inertia=2e-6))


def test_stiffness_and_damping_follow_from_inertia_and_resonance() -> None:
    covariance = np.diag([1.0, (0.01 * DAMPING) ** 2, 0.0, 0.0])
    transfer = TransferFunction(
        RESONANCE_HZ, DAMPING, covariance=tuple(map(tuple, covariance.tolist()))
    )
    shaft = shaft_of(transfer, Inertia(CHAIN.inertia_kgm2, 2.5e-5, 31.0, 400))
    assert shaft.stiffness_nm_rad == pytest.approx(CHAIN.stiffness_nm_rad, rel=1e-9)
    assert shaft.damping_nm_s == pytest.approx(CHAIN.damping_nm_s, rel=1e-9)
    generator = np.random.default_rng(4)
    moment = CHAIN.inertia_kgm2 + 2.5e-5 * generator.standard_normal(40_000)
    hertz = RESONANCE_HZ + generator.standard_normal(40_000)
    ratio = DAMPING * (1.0 + 0.01 * generator.standard_normal(40_000))
    stiffness = moment * (2.0 * pi * hertz) ** 2
    damping = 4.0 * pi * ratio * moment * hertz
    assert shaft.stiffness_uncertainty_nm_rad == pytest.approx(stiffness.std(), rel=0.03)
    assert shaft.damping_uncertainty_nm_s == pytest.approx(damping.std(), rel=0.03)
