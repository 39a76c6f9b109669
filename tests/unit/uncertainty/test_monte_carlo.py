"""Monte Carlo: distributions, intervals, adaptive procedure, agreement with GUM."""

from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.uncertainty import (
    Distribution,
    Quantity,
    coverage_interval,
    monte_carlo,
    numerical_tolerance,
    propagate,
    sample,
    validate,
)


@pytest.mark.parametrize("distribution", list(Distribution))
def test_draws_have_the_stated_mean_and_deviation(distribution):
    draws = sample(distribution, 5.0, 0.7, inf, 200_000, np.random.default_rng(1))
    assert np.mean(draws) == pytest.approx(5.0, abs=0.01)
    assert np.std(draws) == pytest.approx(0.7, rel=0.01)


def test_finite_freedom_gives_student_t_and_inexact_limits():
    generator = np.random.default_rng(2)
    t = sample(Distribution.NORMAL, 0.0, 1.0, 10.0, 400_000, generator)
    assert np.std(t) == pytest.approx((10 / 8) ** 0.5, rel=0.01)
    half_width, inexactness = 3**0.5, 3**0.5 / (2 * 8) ** 0.5
    trapezoid = sample(Distribution.RECTANGULAR, 0.0, 1.0, 8.0, 400_000, generator)
    assert np.max(np.abs(trapezoid)) <= half_width + inexactness
    # JCGM 101:2008, 6.4.3.3: variance (b − a)²/12 + d²/9
    assert np.var(trapezoid) == pytest.approx(1.0 + inexactness**2 / 9, rel=0.01)


@pytest.mark.parametrize(
    ("uncertainty", "digits", "expected"),
    [(0.00035, 2, 5e-6), (2.0, 1, 0.5), (0.0996, 2, 5e-3), (36.0, 2, 0.5), (0.0, 2, 0.0)],
)
def test_numerical_tolerance(uncertainty, digits, expected):
    """JCGM 101:2008, 7.9.2.1, examples 1 and 2 among them."""
    assert numerical_tolerance(uncertainty, digits) == pytest.approx(expected)


@given(st.integers(0, 10_000), st.floats(0.5, 0.99))
def test_shortest_interval_is_never_longer_and_both_hold_the_probability(seed, probability):
    draws = np.random.default_rng(seed).gamma(2.0, 1.0, 2_000)
    shortest = coverage_interval(draws, probability, "shortest")
    symmetric = coverage_interval(draws, probability)
    assert shortest[1] - shortest[0] <= symmetric[1] - symmetric[0]
    for low, high in (shortest, symmetric):
        inside = np.mean((draws >= low) & (draws <= high))
        assert inside == pytest.approx(probability, abs=2e-3)


def test_same_seed_same_result():
    results = [
        monte_carlo(lambda a: a**2, [Quantity("a", 1.0, 0.1)], generator=np.random.default_rng(4))
        for _ in range(2)
    ]
    assert results[0] == results[1]


def test_correlated_draws_keep_their_correlation():
    quantities = [Quantity("a", 0.0, 1.0, 20.0), Quantity("b", 0.0, 2.0, 20.0)]
    result = monte_carlo(
        lambda a, b: a - b,
        quantities,
        correlations={("a", "b"): 0.8},
        generator=np.random.default_rng(5),
        tolerance=0.02,
    )
    expected = (1 + 4 - 2 * 0.8 * 2) ** 0.5 * (20 / 18) ** 0.5
    assert result.standard_uncertainty == pytest.approx(expected, rel=0.02)


def test_gum_is_confirmed_for_student_t_interval():
    quantities = [Quantity("only", 10.0, 0.02, 12.0)]
    budget = propagate(lambda a: a + 0.0, quantities)
    result = monte_carlo(
        lambda a: a + 0.0,
        quantities,
        generator=np.random.default_rng(6),
        tolerance=numerical_tolerance(0.02, 1) / 5,
    )
    assert validate(budget, result, significant_digits=1).agrees


def test_unreached_tolerance_is_reported_and_never_agrees():
    quantities = [Quantity("a", 0.0, 1.0)]
    result = monte_carlo(
        lambda a: a,
        quantities,
        generator=np.random.default_rng(7),
        tolerance=1e-9,
        maximum_trials=40_000,
    )
    assert not result.converged
    assert result.trials == 40_000
    assert not validate(propagate(lambda a: a, quantities), result, 1).agrees


def test_quadratic_near_zero_where_gum_gives_nothing():
    """JCGM 101:2008, 9.4: a squared quantity around zero has no first-order uncertainty."""
    quantities = [Quantity("a", 0.0, 0.005), Quantity("b", 0.0, 0.005)]
    result = monte_carlo(
        lambda a, b: a**2 + b**2,
        quantities,
        generator=np.random.default_rng(8),
        coverage_probability=0.95,
        interval_kind="shortest",
        tolerance=1e-6,
    )
    assert result.value == pytest.approx(50e-6, abs=1e-6)
    assert result.standard_uncertainty == pytest.approx(50e-6, abs=1e-6)
    assert result.high == pytest.approx(150e-6, abs=3e-6)
    assert propagate(lambda a, b: a**2 + b**2, quantities).standard_uncertainty == 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda g: monte_carlo(lambda a: a[:3], [Quantity("a", 0, 1)], generator=g),
            "takes arrays",
        ),
        (
            lambda g: monte_carlo(lambda a: a / 0.0 * 0.0, [Quantity("a", 0, 1)], generator=g),
            "not finite for some draws",
        ),
        (
            lambda g: monte_carlo(
                lambda a, b: a + b,
                [Quantity("a", 0, 1), Quantity.rectangular("b", 0, 1)],
                correlations={("a", "b"): 0.5},
                generator=g,
            ),
            "another distribution than normal: b",
        ),
        (
            lambda g: sample(Distribution.RECTANGULAR, 0.0, 1.0, 0.5, 3, g),
            "degrees of freedom",
        ),
    ],
)
def test_bad_input_is_named(call, message):
    with np.errstate(all="ignore"), pytest.raises(InputError, match=message):
        call(np.random.default_rng(0))


def test_too_few_draws_and_no_digits_are_refused():
    with pytest.raises(InputError, match="at least 2"):
        coverage_interval(np.array([1.0]))
    with pytest.raises(InputError, match="significant digits"):
        numerical_tolerance(1.0, 0)
