"""The smoothing spline beside SciPy's, and its uncertainty beside the truth."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import make_smoothing_spline

from torquebench.compensation import SplineModel, make_model
from torquebench.compensation.spline import integrated_wiener_kernel


def truth(reading: np.ndarray) -> np.ndarray:
    return reading + 1e-3 * reading + 0.6 * np.sin(reading / 250.0)


def noisy(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    reading = np.sort(np.random.default_rng(seed).uniform(-1000.0, 1000.0, count))
    reading[[0, -1]] = [-1000.0, 1000.0]
    return reading, truth(reading) + np.random.default_rng(seed + 1).normal(0.0, 0.2, count)


@given(seed=st.integers(0, 1000), count=st.integers(8, 60))
def test_with_the_same_smoothing_it_is_scipys_spline(seed: int, count: int) -> None:
    reading, standard = noisy(count, seed)
    model = SplineModel(outliers="keep").fit(reading[:, None], standard)
    span = np.ptp(reading)
    other = make_smoothing_spline(
        (reading - reading[0]) / span, standard - reading, lam=model.smoothing_
    )
    at = np.linspace(reading[0], reading[-1], 50)
    expected = at + other((at - reading[0]) / span)
    np.testing.assert_allclose(model.predict(at[:, None]), expected, rtol=0, atol=5e-4)


def test_generalised_cross_validation_chooses_as_scipy_does() -> None:
    reading, standard = noisy(50, 4)
    model = SplineModel(criterion="gcv").fit(reading[:, None], standard)
    other = make_smoothing_spline((reading - reading[0]) / np.ptp(reading), standard - reading)
    at = np.linspace(reading[0], reading[-1], 50)
    expected = at + other((at - reading[0]) / np.ptp(reading))
    np.testing.assert_allclose(model.predict(at[:, None]), expected, atol=2e-2)


@given(a=st.floats(0.01, 2.0), b=st.floats(0.01, 2.0))
def test_the_kernel_is_the_integral_that_defines_it(a: float, b: float) -> None:
    expected = quad(lambda u: (a - u) * (b - u), 0.0, min(a, b))[0]
    kernel = integrated_wiener_kernel(np.array([a]), np.array([b]))[0, 0]
    assert kernel == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("criterion", ["reml", "gcv"])
def test_intervals_cover_the_truth(criterion: str) -> None:
    at = np.linspace(-1000.0, 1000.0, 77)
    inside = []
    for seed in range(20):
        reading, standard = noisy(50, seed)
        model = make_model("spline", criterion=criterion).fit(reading[:, None], standard)
        torque, std = model.predict(at[:, None], return_std=True)
        inside.append(np.abs(torque - truth(at)) < 1.96 * std)
    # without a branch or a physical form the posterior allows for more than this truth shows
    assert np.mean(inside) > 0.92


def test_repeats_count_and_give_the_noise() -> None:
    step = np.linspace(-1000.0, 1000.0, 25)
    reading = np.tile(step, 4)
    standard = truth(reading) + np.random.default_rng(0).normal(0.0, 0.2, reading.size)
    model = SplineModel().fit(reading[:, None], standard)
    assert model.knots_.size == 25
    assert model.noise_nm_ == pytest.approx(0.2, rel=0.2)
    assert np.max(np.abs(model.predict(step[:, None]) - truth(step))) < 0.4


def test_beyond_the_last_point_it_goes_on_straight_and_stays_unsure() -> None:
    reading, standard = noisy(40, 2)
    model = SplineModel().fit(reading[:, None], standard)
    at = reading[-1] + np.array([0.0, 5.0, 10.0, 15.0])
    torque, std = model.predict(at[:, None], return_std=True)
    np.testing.assert_allclose(np.diff(torque, 2), 0.0, atol=1e-9)
    assert np.all(std > 0.5 * std[0])


def test_a_straight_line_without_noise_stays_one() -> None:
    reading = np.linspace(-1.0, 1.0, 12)
    model = SplineModel().fit(reading[:, None], 2.0 + 1.5 * reading)
    assert model.predict([[0.3]])[0] == pytest.approx(2.45, abs=1e-9)
    assert model.effective_parameters_ == pytest.approx(2.0, abs=0.5)
