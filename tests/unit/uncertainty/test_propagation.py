"""GUM propagation against GTC, against algebra, and against bad input."""

from math import inf

import GTC
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.uncertainty import (
    Budget,
    Quantity,
    check_by_monte_carlo,
    coverage_factor,
    propagate,
    sensitivities,
    welch_satterthwaite,
)

values = st.floats(-100.0, 100.0).map(lambda v: v + (1.0 if v >= 0 else -1.0))
uncertainties = st.floats(1e-3, 1.0)
freedoms = st.one_of(st.just(inf), st.floats(2.0, 200.0))


@given(st.lists(st.tuples(values, uncertainties, freedoms), min_size=3, max_size=3))
def test_agrees_with_gtc(rows):
    ours = propagate(
        lambda a, b, c: a * np.exp(0.01 * b) / c,
        [Quantity(name, *row) for name, row in zip("abc", rows, strict=True)],
    )
    a, b, c = (GTC.ureal(value, u, freedom) for value, u, freedom in rows)
    theirs = a * GTC.exp(0.01 * b) / c
    assert ours.value == pytest.approx(GTC.value(theirs), rel=1e-12)
    assert ours.standard_uncertainty == pytest.approx(GTC.uncertainty(theirs), rel=1e-9)
    assert ours.degrees_of_freedom == pytest.approx(GTC.dof(theirs), rel=1e-8)


@given(st.floats(-0.95, 0.95), uncertainties, uncertainties)
def test_agrees_with_gtc_for_correlated_quantities(correlation, u_first, u_second):
    ours = propagate(
        lambda a, b: a * b,
        [Quantity("a", 2.0, u_first), Quantity("b", -3.0, u_second)],
        correlations={("a", "b"): correlation},
    )
    a, b = GTC.ureal(2.0, u_first, independent=False), GTC.ureal(-3.0, u_second, independent=False)
    GTC.set_correlation(correlation, a, b)
    assert ours.standard_uncertainty == pytest.approx(GTC.uncertainty(a * b), rel=1e-9)


def test_correlated_ensemble_counts_once_like_gtc():
    x, y = GTC.multiple_ureal([1.0, 2.0], [0.1, 0.2], 5)
    GTC.set_correlation(0.6, x, y)
    z = GTC.ureal(1.0, 0.15, 9)
    ours = propagate(
        lambda a, b, c: a + b + c,
        [Quantity("x", 1.0, 0.1, 5.0), Quantity("y", 2.0, 0.2, 5.0), Quantity("z", 1.0, 0.15, 9.0)],
        correlations={("x", "y"): 0.6},
    )
    assert ours.degrees_of_freedom == pytest.approx(GTC.dof(x + y + z), rel=1e-9)
    assert not ours.cautions


def test_correlated_group_with_different_freedoms_is_cautious_and_says_so():
    budget = propagate(
        lambda a, b: a + b,
        [Quantity("a", 0.0, 1.0, 4.0), Quantity("b", 0.0, 1.0, inf)],
        correlations={("a", "b"): 0.5},
    )
    assert budget.degrees_of_freedom == pytest.approx(4.0)
    assert "a, b belong together" in budget.cautions[0]
    assert "caution" in budget.text()


def test_one_estimate_behind_two_quantities_counts_once():
    """Both uncertainties are multiples of one standard deviation with 6 degrees of freedom."""
    pair = [Quantity("mean", 0.0, 0.3, 6.0), Quantity("single", 0.0, 1.0, 6.0)]
    together = propagate(lambda a, b: a + b, pair, shared_freedom=[("mean", "single")])
    assert together.degrees_of_freedom == pytest.approx(6.0)
    assert together.standard_uncertainty == pytest.approx(1.09**0.5)
    checked = check_by_monte_carlo(
        lambda a, b: a + b,
        pair,
        generator=np.random.default_rng(1),
        shared_freedom=[("mean", "single")],
        significant_digits=1,
    )
    assert checked.agrees
    with pytest.raises(InputError, match="shared degrees of freedom"):
        propagate(lambda a, b: a + b, pair, shared_freedom=[("mean", "other")])


@given(st.lists(st.tuples(uncertainties, freedoms), min_size=1, max_size=8))
def test_effective_freedom_lies_between_the_smallest_and_the_sum(rows):
    u, freedom = np.array(rows).T
    effective = float(welch_satterthwaite(u, freedom))
    assert min(freedom) * (1 - 1e-12) <= effective <= np.sum(freedom) * (1 + 1e-9)


@given(st.floats(1.0, 1e4), st.floats(0.5, 0.999))
def test_coverage_factor_falls_with_freedom(freedom, probability):
    assert coverage_factor(freedom, probability) >= coverage_factor(inf, probability)
    assert coverage_factor(freedom, probability) >= coverage_factor(freedom + 1, probability)


def test_shares_add_up_and_perfect_correlation_adds_linearly():
    budget = propagate(
        lambda a, b: a + b,
        [Quantity("a", 1.0, 0.3), Quantity("b", 1.0, 0.4)],
        correlations={("a", "b"): 1.0},
        unit="N·m",
    )
    assert budget.standard_uncertainty == pytest.approx(0.7)
    assert sum(line.share for line in budget.lines) == pytest.approx(1.0)
    low, high = budget.interval()
    assert (high - low) / 2 == pytest.approx(1.4)


def test_difference_of_fully_correlated_quantities_has_no_uncertainty():
    budget = propagate(
        lambda a, b: a - b,
        [Quantity("a", 1.0, 0.5), Quantity("b", 1.0, 0.5)],
        correlations={("a", "b"): 1.0},
    )
    assert budget.standard_uncertainty == pytest.approx(0.0, abs=1e-8)


def test_functions_that_are_not_analytic_get_their_derivative_by_differences():
    assert sensitivities(lambda a: abs(a) * 3.0, [-2.0], [0.1])[0] == pytest.approx(-3.0)
    table = np.linspace(0.0, 10.0, 11)
    interpolated = sensitivities(lambda a: float(np.interp(a, table, table**2)), [2.5], [0.1])
    assert interpolated[0] == pytest.approx(5.0)


@given(st.floats(-3.0, 3.0), st.floats(1e-6, 0.5))
def test_both_derivative_methods_agree_on_analytic_functions(x, scale):
    def function(value):
        return np.sin(value) * np.exp(0.3 * value) + value**3

    exact = sensitivities(function, [x], [scale], "complex-step")[0]
    close = sensitivities(function, [x], [scale], "differences")[0]
    assert close == pytest.approx(exact, rel=1e-8, abs=1e-8)


def test_derivative_beside_a_pole_and_where_there_is_none():
    beside = sensitivities(lambda a: 1.0 / a, [1.0], [1.0])
    assert beside[0] == pytest.approx(-1.0)
    with pytest.raises(InputError, match="not finite around input 1"):
        sensitivities(lambda a: np.log(-abs(a)), [1.0], [0.1], "differences")


def test_analytic_derivatives_are_taken_as_given():
    budget = propagate(lambda a: a, [Quantity("a", 1.0, 2.0)], derivatives=[3.0])
    assert budget.standard_uncertainty == 6.0


def test_budget_text_shows_every_line():
    budget = propagate(
        lambda a, b: a * b,
        [Quantity("lever", 0.5, 1e-4, unit="m"), Quantity("force", 100.0, 0.1, 12.0, unit="N")],
        unit="N·m",
    )
    lines = budget.text().splitlines()
    assert lines[1].startswith("lever")
    assert lines[2].startswith("force")
    assert "N·m" in lines[3]
    assert "k = " in lines[3]


def test_zero_uncertainty_everywhere():
    budget = propagate(lambda a: a, [Quantity("a", 1.0, 0.0)])
    assert (budget.standard_uncertainty, budget.degrees_of_freedom) == (0.0, inf)
    assert isinstance(budget, Budget)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: propagate(lambda: 0.0, []), "no input quantity"),
        (
            lambda: propagate(lambda a, b: a + b, [Quantity("a", 1, 1), Quantity("a", 1, 1)]),
            "appear twice",
        ),
        (
            lambda: propagate(
                lambda a, b: a + b,
                [Quantity("a", 1, 1), Quantity("b", 1, 1)],
                correlations={("a", "c"): 0.1},
            ),
            "'a' and 'c'",
        ),
        (
            lambda: propagate(
                lambda a, b: a + b,
                [Quantity("a", 1, 1), Quantity("b", 1, 1)],
                correlations={("a", "b"): 1.1},
            ),
            "between -1 and 1",
        ),
        (
            lambda: propagate(
                lambda a, b, c: a + b + c,
                [Quantity(n, 1, 1) for n in "abc"],
                correlations={("a", "b"): 0.9, ("b", "c"): 0.9, ("a", "c"): -0.9},
            ),
            "contradict each other",
        ),
        (lambda: propagate(lambda a: a * np.nan, [Quantity("a", 1, 1)]), "finite result"),
        (lambda: propagate(lambda a: a, [Quantity("a", 1, 1)], derivatives=[1, 2]), "derivatives"),
        (
            lambda: sensitivities(lambda a: max(a, 0.0), [1.0], [0.1], "complex-step"),
            "complex number",
        ),
        (lambda: coverage_factor(3.0, 1.0), "coverage probability"),
        (lambda: coverage_factor(0.0), "above 0"),
        (lambda: Quantity("a", np.nan, 1.0), "finite value"),
        (lambda: Quantity("a", 1.0, -1.0), "0 or more"),
        (lambda: Quantity("a", 1.0, 1.0, 0.0), "above 0"),
        (lambda: Quantity.from_certificate("a", 1.0, 0.1, 0.0), "coverage factor"),
    ],
)
def test_bad_input_is_named(call, message):
    with pytest.raises(InputError, match=message):
        call()


def test_a_certificate_becomes_a_quantity():
    assert Quantity.from_certificate("ref", 1.0, 0.4).standard_uncertainty == 0.2
