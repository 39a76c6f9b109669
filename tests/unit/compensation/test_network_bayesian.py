"""Bayesian training: a maximum of the posterior, right evidence, honest intervals, both solvers."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from torquebench.compensation import NetworkModel
from torquebench.compensation.network_training import (
    NetworkMember,
    NetworkParameters,
    _Problem,
    jacobian,
    network_values,
    nguyen_widrow_start,
    train_member,
)


def truth(reading: np.ndarray) -> np.ndarray:
    quadratic = 1e-3 * reading + 1e-6 * reading * np.abs(reading)
    return reading + quadratic + 0.5 * np.tanh(reading / 30.0) + 0.4 * np.sin(reading / 200.0)


def noisy(count: int, seed: int, noise: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    reading = np.linspace(-2000.0, 2000.0, count)
    return reading, truth(reading) + np.random.default_rng(seed).normal(0.0, noise, count)


def trained(
    count: int, hidden: int, iterations: int = 200, tolerance: float = 1e-9
) -> tuple[np.ndarray, np.ndarray, NetworkMember]:
    x = np.linspace(-1.0, 1.0, count)
    target = np.sin(3.0 * x) + np.random.default_rng(0).normal(0.0, 0.1, count)
    start = nguyen_widrow_start(np.random.default_rng(1), hidden, 0.3)
    member = train_member(x, target, np.ones(count), start, iterations, tolerance)
    return x, target, member


@pytest.mark.parametrize(("count", "hidden"), [(20, 10), (60, 10)])
def test_training_ends_where_the_gradient_of_the_objective_vanishes(
    count: int, hidden: int
) -> None:
    x, target, member = trained(count, hidden)
    errors = target - network_values(member.parameters, x)
    decay = np.repeat(member.precisions, [hidden, hidden, hidden + 1]) * member.parameters.flat
    pull = jacobian(member.parameters, x).T @ errors / member.noise_variance
    assert np.linalg.norm(pull - decay) < 2e-2 * np.linalg.norm(decay)


@pytest.mark.parametrize(("count", "hidden"), [(20, 10), (60, 10)])
def test_effective_parameters_and_evidence_are_those_of_their_definitions(
    count: int, hidden: int
) -> None:
    x, target, member = trained(count, hidden, iterations=8)
    J = jacobian(member.parameters, x)
    precision = np.repeat(member.precisions, [hidden, hidden, hidden + 1])
    hessian = J.T @ J / member.noise_variance + np.diag(precision)
    gamma = precision.size - np.trace(np.diag(precision) @ np.linalg.inv(hessian))
    assert member.effective_parameters == pytest.approx(gamma, rel=1e-6)
    errors = target - network_values(member.parameters, x)
    kernel = J @ np.diag(1.0 / precision) @ J.T + member.noise_variance * np.eye(count)
    fit = errors @ errors / member.noise_variance + precision @ member.parameters.flat**2
    determinant = np.linalg.slogdet(2.0 * np.pi * kernel)[1]
    assert member.log_evidence == pytest.approx(-0.5 * (fit + determinant), rel=1e-6)


def test_evidence_at_the_maximum_is_that_of_a_gaussian_process() -> None:
    x, target, member = trained(20, 10)
    J = jacobian(member.parameters, x)
    precision = np.repeat(member.precisions, [10, 10, 11])
    covariance = J @ np.diag(1.0 / precision) @ J.T + member.noise_variance * np.eye(20)
    linear_target = target - network_values(member.parameters, x) + J @ member.parameters.flat
    expected = multivariate_normal.logpdf(linear_target, cov=covariance)
    assert member.log_evidence == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("count", [5, 30, 31, 60])
@pytest.mark.parametrize("damping", [0.0, 0.7])
def test_a_step_solves_the_damped_normal_equations(count: int, damping: float) -> None:
    generator = np.random.default_rng(count)
    x, target = np.sort(generator.uniform(-1.0, 1.0, count)), generator.standard_normal(count)
    weights, precisions = generator.uniform(0.2, 2.0, count), np.array([0.3, 2.0, 5.0])
    start = nguyen_widrow_start(generator, 10, 0.2)
    problem = _Problem(x, target, weights, hidden=10)
    problem.move_to(start.flat)
    problem.linearise()
    J = jacobian(start, x)
    prior = np.repeat(precisions, [10, 10, 11])
    system = (J.T * weights / 0.04) @ J + np.diag((1.0 + damping) * prior)
    errors = target - network_values(start, x)
    right = J.T @ (weights * errors) / 0.04 - prior * start.flat
    np.testing.assert_allclose(
        problem.step(precisions, 0.04, damping), np.linalg.solve(system, right), rtol=1e-6
    )


def test_it_is_far_better_than_a_polynomial_and_never_worse_than_the_noise() -> None:
    reading, standard = noisy(60, seed=1)
    model = NetworkModel().fit(reading[:, None], standard)
    dense = np.linspace(-2000.0, 2000.0, 801)
    error = model.predict(dense[:, None]) - truth(dense)
    assert np.sqrt(np.mean(error**2)) < 0.3
    assert 0.15 < model.noise_nm_ < 0.45
    assert 6.0 < model.effective_parameters_ < 40.0
    assert model.shares_.sum() == pytest.approx(1.0)


@pytest.mark.nightly
def test_intervals_cover_the_truth() -> None:
    dense = np.linspace(-2000.0, 2000.0, 201)
    inside = []
    for seed in range(12):
        reading, standard = noisy(50, seed)
        model = NetworkModel().fit(reading[:, None], standard)
        fresh = truth(dense) + np.random.default_rng(seed + 100).normal(0.0, 0.3, dense.size)
        torque, std = model.predict(dense[:, None], return_std=True)
        of_reading = np.hypot(std, model.scatter_at(dense))
        inside.append(np.abs(torque - fresh) < 1.96 * of_reading)
    assert 0.91 < np.mean(inside) < 0.985


def test_without_noise_it_follows_the_chain() -> None:
    reading = np.linspace(-2000.0, 2000.0, 50)
    standard = reading + 1e-3 * reading + 1e-6 * reading**2
    model = NetworkModel().fit(reading[:, None], standard)
    dense = np.linspace(-2000.0, 2000.0, 301)
    error = model.predict(dense[:, None]) - (dense + 1e-3 * dense + 1e-6 * dense**2)
    assert np.max(np.abs(error)) < 0.02


@settings(max_examples=3)
@given(
    seed=st.integers(0, 2**31),
    scale=st.sampled_from([1e-3, 1.0, 1e4]),
    ensemble=st.integers(1, 3),
)
def test_units_do_not_matter_and_the_seed_decides_alone(
    seed: int, scale: float, ensemble: int
) -> None:
    reading, standard = noisy(30, 0)
    plain, scaled = (
        NetworkModel(ensemble=ensemble, random_state=seed, iterations=5).fit(
            factor * reading[:, None], factor * standard
        )
        for factor in (1.0, scale)
    )
    torque, std = plain.predict(reading[:, None], return_std=True)
    scaled_torque, scaled_std = scaled.predict(scale * reading[:, None], return_std=True)
    np.testing.assert_allclose(scaled_torque, scale * torque, rtol=1e-6)
    np.testing.assert_allclose(scaled_std, scale * std, rtol=1e-3)


def test_one_start_and_small_starts_are_a_choice() -> None:
    reading, standard = noisy(40, 2)
    for parameters in ({"ensemble": 1}, {"start": "small-uniform"}):
        model = NetworkModel(**parameters).fit(reading[:, None], standard)  # type: ignore[arg-type]
        assert np.sqrt(np.mean((model.predict(reading[:, None]) - truth(reading)) ** 2)) < 0.5


def test_flat_parameters_carry_the_published_layout() -> None:
    reading, standard = noisy(20, 3)
    model = NetworkModel(ensemble=1).fit(reading[:, None], standard)
    parameters = model.networks_[0]
    assert isinstance(parameters, NetworkParameters)
    assert parameters.flat.size == 151  # 1-50-1
