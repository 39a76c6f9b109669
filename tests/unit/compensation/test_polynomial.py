"""Polynomials: exact where exact is possible, per direction, through zero, honest uncertainty."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from torquebench.compensation import PolynomialModel
from torquebench.compensation.polynomial import fit_orthogonal
from torquebench.errors import InputError

READING = np.linspace(-2000.0, 2000.0, 41)


@given(
    degree=st.integers(1, 8),
    coefficients=st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9),
    low=st.floats(-1e4, 1e4),
    span=st.floats(1e-2, 1e4),
)
def test_a_polynomial_of_the_same_degree_is_found_exactly(
    degree: int, coefficients: list[float], low: float, span: float
) -> None:
    x = low + span * np.linspace(0.0, 1.0, 23)
    u = 2.0 * (x - x[0]) / (x[-1] - x[0]) - 1.0
    y = np.polynomial.polynomial.polyval(u, coefficients[: degree + 1])
    fitted = fit_orthogonal(x, y, np.ones(23), degree)
    np.testing.assert_allclose(fitted(x), y, atol=1e-10)


@given(degree=st.integers(1, 6), seed=st.integers(0, 1000), through_zero=st.booleans())
def test_fit_and_variance_are_those_of_least_squares(
    degree: int, seed: int, through_zero: bool
) -> None:
    generator = np.random.default_rng(seed)
    x = generator.uniform(-3.0, 5.0, 20)
    y, weights = generator.standard_normal(20), generator.uniform(0.1, 2.0, 20)
    powers = np.arange(1 if through_zero else 0, degree + 1)
    design = x[:, None] ** powers
    covariance = np.linalg.inv(design.T @ (weights[:, None] * design))
    fitted = fit_orthogonal(x, y, weights, degree, through_zero)
    at = np.linspace(-3.0, 5.0, 9)
    at_design = at[:, None] ** powers
    expected = covariance @ design.T @ (weights * y)
    np.testing.assert_allclose(fitted(at), at_design @ expected, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        fitted.relative_variance(at),
        np.einsum("ij,jk,ik->i", at_design, covariance, at_design),
        rtol=1e-6,
    )


def test_coefficients_are_those_of_equation_15() -> None:
    standard = READING + (2.0 + 1e-3 * READING + 1e-6 * READING**2)
    model = PolynomialModel(degree=2).fit(READING[:, None], standard)
    fitted = Polynomial.fit(READING, model.polynomials_[0](READING), 2).convert().coef
    np.testing.assert_allclose(fitted, [2.0, 1.001, 1e-6], rtol=1e-9)
    assert model.noise_nm_ < 1e-11


def test_each_direction_gets_its_own_polynomial() -> None:
    standard = READING + np.where(READING < 0.0, 2e-3, -1e-3) * READING
    standard += 1e-6 * READING * np.abs(READING)
    joint = PolynomialModel(degree=2).fit(READING[:, None], standard)
    split = PolynomialModel(degree=2, per_direction=True).fit(READING[:, None], standard)
    assert split.noise_nm_ < 1e-11 < joint.noise_nm_
    assert split.effective_parameters_ == 6.0
    np.testing.assert_allclose(split.predict(READING[:, None]), standard, atol=1e-9)


def test_one_direction_alone_makes_one_polynomial_and_a_short_one_is_refused() -> None:
    clockwise = READING[READING >= 0.0]
    model = PolynomialModel(per_direction=True).fit(clockwise[:, None], clockwise)
    assert len(model.polynomials_) == 1
    lopsided = np.concatenate([[-2000.0, -1000.0], clockwise[1:]])
    with pytest.raises(InputError, match="2 readings in the counter-clockwise direction"):
        PolynomialModel(per_direction=True).fit(lopsided[:, None], lopsided)


@pytest.mark.parametrize("per_direction", [False, True])
def test_through_zero_means_exactly_zero(per_direction: bool) -> None:
    standard = READING * 1.001
    model = PolynomialModel(degree=3, through_zero=True, per_direction=per_direction)
    model.fit(READING[:, None], standard)
    torque, std = model.predict([[0.0]], return_std=True)
    assert torque[0] == 0.0
    assert std[0] < 1e-5 * READING.max()


@pytest.mark.nightly
def test_intervals_cover_the_truth_as_often_as_they_say() -> None:
    truth = READING + 1.0 - 5e-4 * READING + 4e-7 * READING**2
    inside, widths = [], []
    for seed in range(12):
        noise = np.random.default_rng(seed).normal(0.0, 0.4, READING.size)
        model = PolynomialModel(degree=2).fit(READING[:, None], truth + noise)
        torque, std = model.predict(READING[:, None], return_std=True)
        inside.append(np.abs(torque - truth) < 1.96 * std)
        plain = model._coefficient_std(READING[:, None])
        widths.append(np.median(std) / np.median(plain))
    # Above 0.95, since so few points never rule out a small misfit of the form; yet not wide.
    assert np.mean(inside) > 0.93
    assert 1.0 < np.median(widths) < 2.5


def test_half_the_weight_is_half_the_points() -> None:
    generator = np.random.default_rng(0)
    x, y = generator.uniform(-1.0, 1.0, 15), generator.standard_normal(15)
    twice = fit_orthogonal(np.repeat(x, 2), np.repeat(y, 2), np.full(30, 0.5), 3)
    once = fit_orthogonal(x, y, np.ones(15), 3)
    np.testing.assert_allclose(twice.coefficients, once.coefficients, rtol=1e-10)
    np.testing.assert_allclose(twice.relative_variance(x), once.relative_variance(x), rtol=1e-10)


@pytest.mark.parametrize("degree", [0, 31, 1.5])
def test_a_degree_outside_its_limits_is_refused(degree: float) -> None:
    with pytest.raises(InputError, match="degree"):
        PolynomialModel(degree=degree).fit(READING[:, None], READING)  # type: ignore[arg-type]
