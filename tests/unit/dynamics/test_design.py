"""Inverse filters on steps that were simulated in continuous time."""

import numpy as np
import pytest
from tests.unit.dynamics.simulated_chain import SimulatedChain, steps

from torquebench.dynamics import TransferFunction, design_inverse
from torquebench.errors import InputError

INPUT = TransferFunction(513.0, 0.06, 53e-6, 167e-6, 5e-5)
OUTPUT = TransferFunction(255.0, 0.10, 53e-6, 167e-6, 1e-4)


@pytest.mark.parametrize(
    "transfer",
    [INPUT, OUTPUT, TransferFunction(1000.0, 0.4, 26e-6, 120e-6, 2e-5)],
    ids=["input", "output", "damped"],
)
def test_a_step_has_three_times_the_bandwidth_without_overshoot(transfer: TransferFunction) -> None:
    found = design_inverse(transfer, transfer.window_s)
    raw, compensated = found.raw, found.compensated
    assert raw.overshoot > 0.25
    assert compensated.bandwidth_hz >= 3.0 * raw.bandwidth_hz
    assert compensated.overshoot <= 0.05
    assert compensated.rise_time_s < 0.5 * raw.rise_time_s
    assert found.filter.weights.sum() == pytest.approx(1.0, abs=1e-12)  # slow torques stay


def test_the_torque_comes_back_with_an_uncertainty_that_covers_its_error() -> None:
    chain = SimulatedChain(interval_s=5e-5, noise_nm=0.002)
    time, reading, torque = chain.run(steps, 0.09)
    covariance = np.diag([2.0**2, 0.003**2, (2e-6) ** 2, (2e-6) ** 2])
    wrong = TransferFunction(
        514.3, 0.0588, 54e-6, 166e-6, 5e-5, tuple(map(tuple, covariance.tolist()))
    )
    found = design_inverse(wrong, 5e-5)
    result = found.filter.stream().push(reading, np.full(reading.size, 0.002))
    places = round(found.delay_s / 5e-5)
    start, stop = 100, time.size - places
    error = result.value[start + places : stop + places] - torque[start:stop]
    kept = np.abs(reading[start:stop] - torque[start:stop])
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.sqrt(np.mean(kept**2))
    u = result.standard_uncertainty[start + places : stop + places]
    ringing = np.abs(np.gradient(torque[start:stop])) == 0.0  # the low-pass rounds the steps
    assert np.mean(np.abs(error[ringing]) < 2.0 * u[ringing]) > 0.9


def test_the_covariance_of_the_coefficients_is_that_of_the_parameters() -> None:
    covariance = np.diag([3.0**2, 0.004**2, (2e-6) ** 2, (2e-6) ** 2])
    transfer = TransferFunction(
        513.0, 0.06, 53e-6, 147e-6, 5e-5, tuple(map(tuple, covariance.tolist()))
    )
    found = design_inverse(transfer, 5e-5)
    assert found.filter.factors.shape[0] <= 4
    generator = np.random.default_rng(3)
    draws = [
        design_inverse(transfer.with_values(row), 5e-5, found.bandwidth_hz).filter.weights[:16]
        for row in generator.multivariate_normal(transfer.values, covariance, 150)
        if row.min() > 0.0
    ]
    spread = np.std(draws, axis=0)
    assert found.filter.covariance is not None
    stated = np.sqrt(np.diag(found.filter.covariance))[:16]
    assert np.median(stated / spread) == pytest.approx(1.0, abs=0.2)


def test_a_bandwidth_beyond_the_rate_or_below_the_chains_own_is_refused() -> None:
    with pytest.raises(InputError, match="use shorter counter windows"):
        design_inverse(INPUT, 1e-3)
    with pytest.raises(InputError, match="up to 6000 Hz"):
        design_inverse(INPUT, 5e-5, 8000.0)
    with pytest.raises(InputError, match="the chain itself"):
        design_inverse(INPUT, 5e-5, 200.0)
