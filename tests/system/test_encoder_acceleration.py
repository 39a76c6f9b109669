"""Acceleration from encoder samples, and what it is worth in the live stream."""

from pathlib import Path

import numpy as np
import pytest
from tests.streamed import streamed

from torquebench.bench.acceleration import EncoderAcceleration
from torquebench.bench.active_chain import ActiveChain
from torquebench.chain import Inertia, MeasuredRotation, MeasuringChain, Torque
from torquebench.compensation import features, make_model
from torquebench.procedures.reducers.setup import turn_at
from torquebench.procedures.setup import power_on, set_mode
from torquebench.station import Station
from torquebench.units import RAD_S_PER_RPM

PER_REVOLUTION = 360_000


def sampled(time_s: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    return np.floor(angle_rad * PER_REVOLUTION / (2.0 * np.pi)).astype(np.int64)


def test_a_ramp_is_known_within_its_uncertainty_and_its_begin_widens_it() -> None:
    time_s = 0.001 * np.arange(500)
    ramp = 31.4 * np.maximum(time_s - 0.24, 0.0) ** 2 / 2.0
    counts = sampled(time_s, 3.0 * time_s + ramp)
    shaft = EncoderAcceleration()
    found = [
        shaft(time_s[rows], counts[rows], PER_REVOLUTION)
        for rows in (slice(start, start + 50) for start in range(0, 500, 50))
    ]
    steady = [abs(each.rad_s2) for each in found[:4]]
    assert max(steady) < 0.1
    assert [each.rad_s2 for each in found[6:]] == pytest.approx([31.4] * 4, abs=0.1)
    assert max(each.uncertainty_rad_s2 for each in (*found[1:4], *found[6:])) < 0.2
    assert found[5].uncertainty_rad_s2 > 5.0  # the block in which the ramp began lies before it


@pytest.mark.parametrize("size", [5, 10, 50])
def test_it_is_the_bend_of_a_parabola_by_least_squares(size: int) -> None:
    generator = np.random.default_rng(size)
    time_s = 100.0 + 0.001 * np.arange(size)
    angle = 30.0 * np.sin(9.0 * time_s) + generator.normal(0.0, 1e-4, size)
    counts = sampled(time_s, angle)
    found = EncoderAcceleration()(time_s, counts, PER_REVOLUTION)
    count_rad = 2.0 * np.pi / PER_REVOLUTION
    at, turned = time_s - time_s.mean(), count_rad * (counts - counts[0])
    fitted, covariance = np.polyfit(at, turned, 2, cov="unscaled")
    rest = np.sum((turned - np.polyval(fitted, at)) ** 2) / (size - 3)
    noise = np.sqrt((rest + count_rad**2 / 12.0) * covariance[0, 0])
    assert found.rad_s2 == pytest.approx(2.0 * fitted[0], rel=1e-9)
    assert found.uncertainty_rad_s2 == pytest.approx(2.0 * noise, rel=1e-9)


def test_too_few_samples_tell_nothing() -> None:
    found = EncoderAcceleration()(np.array([0.0, 0.1]), np.array([0, 1]), PER_REVOLUTION)
    assert np.isnan(found.rad_s2)


def chain(*effects: Inertia | MeasuredRotation) -> ActiveChain:
    torque = np.linspace(-50.0, 50.0, 30)
    model = make_model("polynomial", range_nm=50.0).fit(features(torque), torque)
    return ActiveChain(MeasuringChain(model, effects), "1", "polynomial")


def test_inertia_is_taken_off_while_it_ramps_and_its_doubt_is_in_u() -> None:
    active = chain(Inertia("ramps", 0.0025, 0.00002, largest_rad_s2=300.0))

    def push(at_s: float, *acceleration: float) -> Torque:
        names = ("acceleration_rad_s2", "acceleration_uncertainty_rad_s2")
        known = dict(zip(names, acceleration, strict=False))
        return streamed(active, [at_s], [5.0], speed_rpm=0.0, temperature_c=23.0, **known)

    still, ramps, blind = push(0.1, 0.0, 0.0), push(0.2, 31.4, 2.0), push(0.3)
    assert ramps.value_nm[0] == pytest.approx(still.value_nm[0] - 0.0025 * 31.4, abs=1e-4)
    expected = np.hypot(0.00002 * 31.4, 0.0025 * 2.0)
    assert ramps.component("inertia")[0] == pytest.approx(expected)
    assert blind.component("inertia")[0] == pytest.approx(0.0025 * 300.0 / np.sqrt(3.0))


def test_a_correction_is_switched_at_the_bench_between_two_windows() -> None:
    active = chain(Inertia("ramps", 0.0025, 0.0, largest_rad_s2=300.0))

    def push(at_s: float) -> float:
        known = {"acceleration_rad_s2": 31.4, "acceleration_uncertainty_rad_s2": 0.0}
        torque = streamed(active, [at_s], [0.0], speed_rpm=0.0, temperature_c=23.0, **known)
        return float(torque.value_nm[0])

    assert active.states() == ()
    corrected = push(0.1)
    (inertia,) = (each for each in active.states() if each.name == "inertia")
    assert (inertia.state, inertia.contribution_nm) == ("holds", pytest.approx(-0.0785))
    active.switch_off(["inertia"])
    assert push(0.2) == pytest.approx(corrected + 0.0785)
    (inertia,) = (each for each in active.states() if each.name == "inertia")
    assert (inertia.state, inertia.uncertainty_nm) == ("off", pytest.approx(0.0785))
    active.switch_off([])
    assert push(0.3) == pytest.approx(corrected)


def test_the_time_since_the_bench_was_opened_says_nothing_of_running_in() -> None:
    speeds, temperatures = (0.0, 1200.0), (10.0, 40.0)
    nothing = ((0.0, 0.0), (0.0, 0.0))
    fresh = MeasuredRotation(
        "empty runs", 23.0, -1200.0, 1200.0, 10.0, 40.0, speeds, temperatures,
        nothing, nothing, nothing, nothing,
        running_in_s=600.0, running_in_nm=(0.1, 0.1), running_in_uncertainty_nm=(0.01, 0.01),
    )  # fmt: skip
    found = streamed(chain(fresh), [1.0], [0.0], speed_rpm=600.0, temperature_c=23.0)
    assert found.added("running-in")[0] == 0.0
    assert found.component("running-in")[0] == pytest.approx(np.hypot(0.1 / np.sqrt(3.0), 0.01))


def test_the_bench_measures_its_own_ramps(tmp_path: Path) -> None:
    with Station.open(None, tmp_path) as station:
        viewer = station.acquisition.add_viewer(10_000)

        def ramp():
            yield from set_mode(station.devices, "input", "driven")
            yield from power_on(station.devices, "input")
            yield from turn_at(station.devices, "input", 600.0, 300.0)

        station.run(ramp(), kind="ramp")
        blocks = list(iter(lambda: viewer.get(0.0), None))
    found = np.array([block.condition("input_acceleration_rad_s2") for block in blocks])
    doubt = np.array([block.condition("input_acceleration_uncertainty_rad_s2") for block in blocks])
    asked = 300.0 * RAD_S_PER_RPM
    ramping = np.abs(found - asked) < 0.1 * asked
    assert np.sum(ramping) * station.description.counter.block_s == pytest.approx(2.0, abs=0.4)
    assert np.median(doubt[ramping]) < 0.05 * asked
