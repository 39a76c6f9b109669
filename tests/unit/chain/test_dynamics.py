"""The dynamics of a chain as one of its effects."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from tests.unit.dynamics.simulated_chain import SimulatedChain, steps

from torquebench.chain import (
    Dynamics,
    MeasuringChain,
    Readings,
    RecordedStream,
    effect_from,
    joined,
)
from torquebench.compensation import features, make_model
from torquebench.dynamics import TransferFunction, design_inverse
from torquebench.errors import InputError

INTERVAL_S = 5e-5


@pytest.fixture(scope="module")
def effect() -> Dynamics:
    covariance = np.diag([2.0**2, 0.003**2, (2e-6) ** 2, (2e-6) ** 2])
    transfer = TransferFunction(
        510.3, 0.0599, 53e-6, 167e-6, INTERVAL_S, tuple(map(tuple, covariance.tolist()))
    )
    return Dynamics.of("steps", design_inverse(transfer, INTERVAL_S))


@pytest.fixture(scope="module")
def chain(effect: Dynamics) -> MeasuringChain:
    standard = np.linspace(-50.0, 50.0, 41)
    noise = 1e-3 * np.random.default_rng(1).standard_normal(41)
    model = make_model("polynomial").fit(features(standard / 1.002 + noise), standard)
    return MeasuringChain(model, (effect,))


def run() -> tuple[Readings, np.ndarray]:
    simulated = SimulatedChain(interval_s=INTERVAL_S, noise_nm=1e-3)
    time, reading, torque = simulated.run(steps, 0.09)
    return Readings(reading / 1.002, counter_nm=np.full(time.size, 1e-3), time_s=time), torque


def part(readings: Readings, rows: slice) -> Readings:
    assert readings.time_s is not None
    assert isinstance(readings.counter_nm, np.ndarray)
    return Readings(
        readings.reading_nm[rows],
        counter_nm=readings.counter_nm[rows],
        time_s=readings.time_s[rows],
    )


def test_a_stream_gives_the_torque_back_however_it_is_cut(
    chain: MeasuringChain, effect: Dynamics
) -> None:
    readings, torque = run()
    whole = chain.stream().push(readings)
    stream = chain.stream()
    cuts = [0, 1, 2, 90, 91, 700, len(readings)]
    pieces = joined([stream.push(part(readings, slice(*pair))) for pair in pairwise(cuts)])
    np.testing.assert_array_equal(pieces.value_nm, whole.value_nm)
    np.testing.assert_array_equal(pieces.standard_uncertainty_nm, whole.standard_uncertainty_nm)
    late = round(effect.delay_s / INTERVAL_S)
    raw = np.abs(1.002 * readings.reading_nm - torque)
    error = np.abs(whole.value_nm[late:] - torque[:-late])
    assert error[100:].max() < 0.25 * raw.max()


def test_a_record_in_pieces_gives_what_the_whole_gives(
    chain: MeasuringChain, effect: Dynamics
) -> None:
    readings, _ = run()
    expected = chain.torque(part(readings, slice(0, 1700)))
    record = RecordedStream(chain)
    cuts = [0, 3, 500, 1695, 1700]
    blocks = [part(readings, slice(*pair)) for pair in pairwise(cuts)]
    pieces = [record.torque(*pair) for pair in pairwise([*blocks, None])]
    found = joined(pieces)
    np.testing.assert_array_equal(found.value_nm, expected.value_nm)
    np.testing.assert_array_equal(found.standard_uncertainty_nm, expected.standard_uncertainty_nm)
    # the live stream gives the same torques, later
    late, settled = effect.rows_late, len(effect.weights)
    live = chain.stream().push(part(readings, slice(0, 1700)))
    np.testing.assert_allclose(found.value_nm[settled:-late], live.value_nm[settled + late :])


def test_a_record_keeps_the_time_of_a_pulse(chain: MeasuringChain, effect: Dynamics) -> None:
    simulated = SimulatedChain(interval_s=INTERVAL_S, noise_nm=0.0)

    def pulse(time_s: np.ndarray) -> np.ndarray:
        return 20.0 * np.exp(-0.5 * ((time_s - 0.02) / 4e-4) ** 2)

    time, reading, torque = simulated.run(pulse, 0.04)
    found = chain.torque(Readings(reading / 1.002, time_s=time)).value_nm
    near = np.abs(time - 0.02) < 2e-3
    middle, true = (
        np.sum(each[near] * time[near]) / np.sum(each[near]) for each in (found, torque)
    )
    assert abs(middle - true) < 0.5 * INTERVAL_S
    assert effect.rows_late > 2
    assert abs(int(np.argmax(found)) - int(np.argmax(torque))) <= 1


def test_the_end_of_a_record_is_uncertain_by_what_the_filter_lacks(effect: Dynamics) -> None:
    time = np.arange(200) * INTERVAL_S
    quick = 10.0 * np.sin(2.0 * np.pi * 500.0 * time)
    found, *_ = effect.components(Readings(quick, time_s=time), quick)
    added, u = np.asarray(found.value_nm), np.asarray(found.uncertainty_nm)
    last = slice(-effect.rows_late, None)
    assert np.all(u[last] >= np.abs(added[last]) / np.sqrt(3.0))
    assert u[100:150].max() < 0.2 * np.abs(added[100:150]).max()


def test_steady_torques_and_readings_without_a_time_stay_as_they_are(
    chain: MeasuringChain,
) -> None:
    alone = replace(chain, stored=())
    steady = Readings(np.full(400, 20.0), time_s=np.arange(400) * INTERVAL_S)
    for readings in (steady, Readings(np.array([1.0, 20.0, -7.0]))):
        found, without = chain.torque(readings), alone.torque(readings)
        np.testing.assert_allclose(found.value_nm, without.value_nm, atol=1e-9)
        np.testing.assert_allclose(
            found.standard_uncertainty_nm, without.standard_uncertainty_nm, rtol=1e-6
        )


def test_another_rate_widens_by_what_the_chain_is_late(
    chain: MeasuringChain, effect: Dynamics
) -> None:
    time = np.arange(50) * 1e-2
    found = chain.stream().push(Readings(100.0 * time - 20.0, time_s=time))
    late = 100.0 * effect.late_s
    np.testing.assert_allclose(found.component("dynamics")[1:], late / np.sqrt(3.0), rtol=1e-6)
    assert not found.added("dynamics").any()


def test_the_first_readings_are_uncertain_by_what_the_filter_makes_of_an_unknown_past(
    effect: Dynamics,
) -> None:
    time = np.arange(200) * INTERVAL_S
    quick = 10.0 * np.sin(2.0 * np.pi * 500.0 * time)
    first, *_ = effect.stream().components(Readings(quick, time_s=time), quick)
    settled = len(effect.weights) - 1
    assert isinstance(first.uncertainty_nm, np.ndarray)
    assert isinstance(first.value_nm, np.ndarray)
    begun = np.abs(first.value_nm[1:settled]) / np.sqrt(3.0)
    assert np.all(first.uncertainty_nm[1:settled] >= begun)
    assert first.uncertainty_nm[settled:].max() < 0.5 * np.abs(first.value_nm).max() / np.sqrt(3.0)


def test_a_gap_or_a_fault_begins_the_filter_anew(effect: Dynamics) -> None:
    time = np.arange(300) * INTERVAL_S
    quick = 10.0 * np.sin(2.0 * np.pi * 500.0 * time)
    after = effect.components(Readings(quick[150:], time_s=time[150:]), quick[150:])[0]
    gap = np.concatenate([time[:150], time[150:] + 1.0])
    found = effect.components(Readings(quick, time_s=gap), quick)[0]
    np.testing.assert_array_equal(np.asarray(found.value_nm)[150:], after.value_nm)
    np.testing.assert_array_equal(np.asarray(found.uncertainty_nm)[150:], after.uncertainty_nm)
    faulty = quick.copy()
    faulty[149] = np.nan
    found = effect.components(Readings(faulty, time_s=time), faulty)[0]
    assert np.isnan(np.asarray(found.value_nm)[149])
    np.testing.assert_array_equal(np.asarray(found.value_nm)[150:], after.value_nm)
    np.testing.assert_array_equal(np.asarray(found.uncertainty_nm)[150:], after.uncertainty_nm)


def test_it_is_stored_by_its_numbers(effect: Dynamics) -> None:
    assert effect_from(effect.specification()) == effect
    with pytest.raises(InputError, match="no coefficients"):
        effect_from({"kind": "dynamics", "record": "", "interval_s": 1e-4})
    with pytest.raises(InputError, match=r"0\.001 s"):
        effect.check_rate(np.arange(5) * 1e-3)
