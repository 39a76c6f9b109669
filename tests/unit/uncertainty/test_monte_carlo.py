"""Monte Carlo: distributions, intervals, adaptive procedure, agreement with GUM."""

from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.uncertainty import (
    Budget,
    BudgetLine,
    Distribution,
    check_by_monte_carlo,
    coverage_interval,
    monte_carlo,
    numerical_tolerance,
    sample,
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
def test_an_interval_holds_its_probability(seed, probability):
    draws = np.random.default_rng(seed).gamma(2.0, 1.0, 2_000)
    low, high = coverage_interval(draws, probability)
    assert np.mean((draws >= low) & (draws <= high)) == pytest.approx(probability, abs=2e-3)


def test_same_seed_same_result():
    budget = Budget.of(1.0, "", [BudgetLine("a", 0.1)])
    first, second = (
        monte_carlo(budget, generator=np.random.default_rng(4), tolerance=0.001) for _ in range(2)
    )
    assert first == second


def test_gum_is_confirmed_for_student_t_interval():
    budget = Budget.of(10.0, "", [BudgetLine("only", 0.02, 12.0)])
    generator = np.random.default_rng(6)
    assert check_by_monte_carlo(budget, generator=generator, significant_digits=1).agrees


def test_unreached_tolerance_is_reported_and_never_agrees():
    checked = check_by_monte_carlo(
        Budget.of(0.0, "", [BudgetLine("a", 1.0)]),
        generator=np.random.default_rng(7),
        significant_digits=6,
        maximum_trials=40_000,
    )
    assert not checked.monte_carlo.converged
    assert checked.monte_carlo.trials == 40_000
    assert not checked.agrees


def test_limits_that_may_change_sides_are_refused():
    with pytest.raises(InputError, match="degrees of freedom"):
        sample(Distribution.RECTANGULAR, 0.0, 1.0, 0.5, 3, np.random.default_rng(0))


def test_too_few_draws_and_no_digits_are_refused():
    with pytest.raises(InputError, match="at least 2"):
        coverage_interval(np.array([1.0]))
    with pytest.raises(InputError, match="significant digits"):
        numerical_tolerance(1.0, 0)
