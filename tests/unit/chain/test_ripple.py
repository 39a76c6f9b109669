"""Ripple within a revolution: found by the angle in empty runs, and corrected by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from torquebench.chain import (
    MeasuringChain,
    Readings,
    Ripple,
    effect_from,
    identify,
)
from torquebench.chain.identification.records import EmptyRun, TurningCalibration
from torquebench.chain.identification.ripple import identify_ripple
from torquebench.compensation import features, make_model

RANGE_NM = 50.0
WINDOW_S = 0.01
NOISE_NM = 0.004
FULL_RPM = 1200.0


def mean_ripple(speed_rpm: np.ndarray, angle_rad: np.ndarray, window_s: float) -> np.ndarray:
    """Return what a window of a ripple holds: two orders that grow with the square of the speed."""
    share = (speed_rpm / FULL_RPM) ** 2
    total = np.zeros(angle_rad.size)
    for order, size, phase in ((1, 0.06, 0.4), (2, 0.04, 2.0)):
        left = np.sinc(order * speed_rpm / 60.0 * window_s)
        total += size * share * left * np.sin(order * angle_rad + phase)
    return total


def empty_run(seed: int, *, angle: bool = True, size: float = 1.0) -> EmptyRun:
    time_s = WINDOW_S * np.arange(8000)
    nodes = np.linspace(0.0, time_s[-1], 10)
    speed = np.interp(time_s, nodes, FULL_RPM * np.array([0, 0, 0.3, 0.3, 1, 1, 0, -0.6, -1, 0]))
    turned = np.cumsum(speed) / 60.0 * WINDOW_S * 2.0 * np.pi
    drag = 0.02 * np.tanh(speed / 50.0)
    noise = NOISE_NM * np.random.default_rng(seed).standard_normal(time_s.size)
    reading = size * mean_ripple(speed, turned, WINDOW_S) + drag + noise
    return EmptyRun(
        f"run-{seed}.csv",
        time_s,
        reading,
        speed,
        np.full(time_s.size, 23.0),
        angle_rad=turned % (2.0 * np.pi) if angle else None,
    )


@pytest.fixture(scope="module")
def ripple() -> Ripple:
    found = identify_ripple([empty_run(1), empty_run(2)])
    assert found is not None
    return found


def at_random(count: int = 4000, seed: int = 5) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    return FULL_RPM * generator.uniform(-1, 1, count), generator.uniform(0, 2 * np.pi, count)


def test_the_ripple_at_other_speeds_and_angles_is_what_runs_showed(ripple: Ripple) -> None:
    assert set(ripple.orders) == {1.0, 2.0}
    speed, angle = at_random()
    readings = Readings(np.zeros(speed.size), speed_rpm=speed, angle_rad=angle)
    (part,) = ripple.components(readings, np.zeros(speed.size))
    truth = mean_ripple(speed, angle, WINDOW_S)
    error = part.value_nm + truth
    assert np.std(error) < 0.03 * np.std(truth)
    covered = np.mean(np.abs(error) <= 2.0 * part.uncertainty_nm)
    assert covered > 0.9


def test_a_shorter_window_holds_more_of_it(ripple: Ripple) -> None:
    speed, angle = at_random()
    readings = Readings(
        np.zeros(speed.size), speed_rpm=speed, angle_rad=angle, window_s=0.1 * WINDOW_S
    )
    (part,) = ripple.components(readings, np.zeros(speed.size))
    truth = mean_ripple(speed, angle, 0.1 * WINDOW_S)
    assert np.std(part.value_nm + truth) < 0.03 * np.std(truth)


def test_without_an_angle_its_size_is_in_u_of_short_windows(ripple: Ripple) -> None:
    speed, angle = at_random()
    for window_s in (WINDOW_S, 0.2 * WINDOW_S):
        readings = Readings(np.zeros(speed.size), speed_rpm=speed, window_s=window_s)
        (part,) = ripple.components(readings, np.zeros(speed.size))
        truth = mean_ripple(speed, angle, window_s)
        assert not np.any(part.value_nm)
        assert np.mean(np.square(truth / part.uncertainty_nm)) == pytest.approx(1.0, abs=0.15)
    steady = Readings(np.zeros(3), speed_rpm=FULL_RPM, window_s=np.inf)
    (part,) = ripple.components(steady, np.zeros(3))
    assert np.max(part.uncertainty_nm) <= max(ripple.uncertainty_nm)


def test_a_mean_over_many_turns_has_less_of_it_than_one_over_part_of_a_turn(
    ripple: Ripple,
) -> None:
    chain = MeasuringChain(linear_model(), (ripple,))
    time_s = WINDOW_S * np.arange(200)
    known = Readings(np.zeros(200), time_s=time_s, speed_rpm=np.full(200, FULL_RPM))
    torque = chain.torque(known)

    def left(count: int) -> float:
        return float(torque.at(np.arange(count)).mean().component("ripple by angle")[0])

    assert left(2) > 0.6 * left(1)
    assert left(200) < 0.15 * left(1)


def linear_model():
    standard = np.linspace(-RANGE_NM, RANGE_NM, 20)
    return make_model("polynomial", range_nm=RANGE_NM).fit(features(standard), standard)


def test_a_chain_keeps_it_and_switches_it_off(ripple: Ripple) -> None:
    again = effect_from(ripple.specification())
    assert again == ripple
    chain = MeasuringChain(linear_model(), (ripple,))
    known = Readings(np.zeros(1), speed_rpm=FULL_RPM, angle_rad=1.0)
    added = chain.torque(known).added("ripple by angle")[0]
    off = chain.switched("a person", ["ripple"])
    assert added != 0.0
    assert off.torque(known).added("ripple by angle")[0] == 0.0
    assert off.torque(known).component("ripple by angle")[0] >= abs(added)
    assert chain.unmeasured(Readings(np.zeros(1), speed_rpm=0.0)) == ("angle_rad",)
    (identified,) = ripple.identified(RANGE_NM)
    assert identified.percent == pytest.approx(100.0 * ripple.largest_nm / RANGE_NM)
    assert identified.measured == "orders 1, 2"


def test_runs_without_angle_or_ripple_tell_none() -> None:
    assert identify_ripple([empty_run(1, angle=False)]) is None
    assert identify_ripple([empty_run(1, size=0.0), empty_run(2, size=0.0)]) is None
    assert identify_ripple([]) is None


def test_runs_whose_ripple_differs_say_so_in_u(ripple: Ripple) -> None:
    other = identify_ripple([empty_run(1), empty_run(2, size=1.5)])
    assert other is not None
    assert max(other.uncertainty_nm) > 5.0 * max(ripple.uncertainty_nm)


def test_an_identification_holds_it_and_scatter_is_what_it_leaves() -> None:
    share = np.concatenate([np.linspace(-1, 1, 24), np.linspace(1, -1, 24)])
    points = TurningCalibration(
        RANGE_NM * share,
        RANGE_NM * share,
        np.sign(np.gradient(np.abs(share))),
        np.zeros(48),
        np.full(48, 23.0),
    )
    by_angle = identify(points, [empty_run(1)], RANGE_NM)
    blind = identify(points, [replace(empty_run(1), angle_rad=None)], RANGE_NM)
    assert any(isinstance(each, Ripple) for each in by_angle.effects)
    assert not any(isinstance(each, Ripple) for each in blind.effects)
    scatter = [
        max(next(each for each in found.effects if hasattr(each, "noise_nm")).noise_nm or (0.0,))
        for found in (by_angle, blind)
    ]
    assert scatter[0] < 0.2 * scatter[1]
