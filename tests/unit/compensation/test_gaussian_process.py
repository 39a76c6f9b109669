import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import multivariate_normal
from tests.support.chains import make_chain
from tests.watching import Watching

from torquebench.compensation import GaussianProcessModel, features, model_from_state
from torquebench.compensation.gaussian_process import log_posterior
from torquebench.compensation.kernels import (
    PARAMETERS,
    PRIOR_MEAN,
    PRIOR_STD,
    KernelPoints,
    covariance,
    gradients,
    variance,
)

THETAS = arrays(np.float64, 7, elements=st.floats(-1.0, 1.0)).map(lambda z: PRIOR_MEAN + z)


def some_points(seed: int, count: int = 12) -> KernelPoints:
    rng = np.random.default_rng(seed)
    branch = rng.choice([-1.0, 0.0, 1.0], count)
    return KernelPoints(rng.uniform(-1, 1, count), branch, rng.uniform(0, 1, (2, count)))


@settings(max_examples=25)
@given(theta=THETAS, seed=st.integers(0, 1000))
def test_covariances_are_symmetric_and_positive(theta: np.ndarray, seed: int) -> None:
    points = some_points(seed)
    matrix = covariance(points, points, theta)
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-12)
    assert np.linalg.eigvalsh(matrix)[0] > -1e-12 * np.linalg.eigvalsh(matrix)[-1]


@settings(max_examples=25)
@given(theta=THETAS, seed=st.integers(0, 1000))
def test_the_variance_is_the_diagonal_of_the_covariance(theta: np.ndarray, seed: int) -> None:
    points = some_points(seed)
    curve = KernelPoints(points.u, points.branch)
    np.testing.assert_allclose(variance(curve, theta), np.diag(covariance(curve, curve, theta)))


@settings(max_examples=20)
@given(theta=THETAS, seed=st.integers(0, 1000))
def test_kernel_gradients_agree_with_differences(theta: np.ndarray, seed: int) -> None:
    points = some_points(seed, 8)
    matrix, slopes = gradients(points, theta)
    np.testing.assert_allclose(matrix, covariance(points, points, theta), rtol=1e-12)
    for k, slope in enumerate(slopes):
        step = 1e-5 * np.eye(7)[k]
        above, below = (covariance(points, points, theta + s) for s in (step, -step))
        np.testing.assert_allclose(slope, (above - below) / 2e-5, rtol=1e-5, atol=1e-12)


@settings(max_examples=20)
@given(theta=THETAS, seed=st.integers(0, 1000))
def test_likelihood_gradients_agree_with_differences(theta: np.ndarray, seed: int) -> None:
    points = some_points(seed)
    rng = np.random.default_rng(seed)
    target, weights = 3e-4 * rng.standard_normal(12), rng.uniform(0.5, 1.0, 12)
    _, gradient = log_posterior(points, target, weights, theta)
    for k in range(7):
        step = 1e-5 * np.eye(7)[k]
        above, below = (log_posterior(points, target, weights, theta + s)[0] for s in (step, -step))
        assert gradient[k] == pytest.approx((above - below) / 2e-5, rel=1e-3, abs=1e-4)


def test_the_posterior_density_is_likelihood_times_prior() -> None:
    points, theta = some_points(3), PRIOR_MEAN + 0.2
    target, weights = np.linspace(-2e-4, 3e-4, 12), np.ones(12)
    matrix = covariance(points, points, theta) + np.exp(2 * theta[-1]) * np.eye(12)
    expected = multivariate_normal(np.zeros(12), matrix).logpdf(target)
    expected += 0.5 * 12 * np.log(2 * np.pi) - 0.5 * np.sum((0.2 / PRIOR_STD) ** 2)
    value, _ = log_posterior(points, target, weights, theta)
    assert value == pytest.approx(float(expected), rel=1e-7)
    assert len(PARAMETERS) == theta.size


def test_hyper_parameters_are_averaged_not_picked() -> None:
    data = make_chain("reference", 2).calibration(50)
    model = GaussianProcessModel(range_nm=2000).fit(data.X, data.standard_nm)
    assert model.shares_.size > 3
    assert model.shares_.sum() == pytest.approx(1.0)
    assert model.shares_.max() < 0.9
    assert model.noise_nm_ == pytest.approx(0.4, rel=0.7)


def test_predictions_agree_with_the_textbook_formulas() -> None:
    data = make_chain("quadratic", 5).calibration(50)
    model = GaussianProcessModel(range_nm=2000).fit(data.X, data.standard_nm)
    at = features([-1500.0, 3.0, 700.0], [1, 1, -1], [1, 1, 1])
    mean, std = model.predict(at, return_std=True)
    train = KernelPoints(model.train_u_, model.train_branch_, model.train_elapsed_)
    new = KernelPoints(at[:, 0] / 2000, at[:, 1])
    means, seconds = [], []
    for theta in model.thetas_:  # Rasmussen & Williams, eq. 2.25 and 2.26
        noise = np.exp(2 * theta[-1]) * np.eye(50)
        inverse = np.linalg.inv(covariance(train, train, theta) + noise)
        cross = covariance(new, train, theta)
        value = cross @ inverse @ model.train_target_
        spread = np.diag(covariance(new, new, theta) - cross @ inverse @ cross.T)
        means.append(value)
        seconds.append(spread + value**2)
    first = model.shares_ @ np.array(means)
    np.testing.assert_allclose(mean, at[:, 0] + 2000 * first, atol=1e-4)
    second = model.shares_ @ np.array(seconds)
    np.testing.assert_allclose(std, 2000 * np.sqrt(second - first**2), rtol=1e-3)


def test_it_follows_ripple_that_no_polynomial_follows() -> None:
    u = np.linspace(-1, 1, 80)
    added = 2e-3 * u * np.abs(u) + 5e-4 * np.sin(15 * u)
    model = GaussianProcessModel().fit(100 * u[:, None], 100 * (u + added))
    dense = np.linspace(-0.99, 0.99, 300)
    wanted = 2e-3 * dense * np.abs(dense) + 5e-4 * np.sin(15 * dense)
    error = model.predict(100 * dense[:, None]) / 100 - dense - wanted
    assert np.max(np.abs(error)) < 3e-5


def test_state_gives_the_same_predictions_bit_for_bit() -> None:
    data = make_chain("kinked", 4).calibration(40)
    model = GaussianProcessModel().fit(data.X, data.standard_nm)
    again = model_from_state(model.get_state())
    for one, other in zip(
        model.predict(data.X, return_std=True), again.predict(data.X, return_std=True), strict=True
    ):
        np.testing.assert_array_equal(one, other)


def test_progress_is_told() -> None:
    data = make_chain("quadratic", 4).calibration(30)
    watching = Watching()
    GaussianProcessModel().fit(data.X, data.standard_nm, progress=watching)
    assert watching.done
    assert all(0 <= done <= 100 for done in watching.done)
