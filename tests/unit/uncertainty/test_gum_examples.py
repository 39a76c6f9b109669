"""Examples of JCGM 101:2008, 9.2, as golden values."""

from math import inf

import numpy as np
import pytest

from torquebench.uncertainty import Budget, BudgetLine, check_by_monte_carlo, monte_carlo


def test_additive_rectangular() -> None:
    """9.2.3: four rectangular quantities, 95 % interval ±3.88."""
    four = [BudgetLine.rectangular(f"X{k}", 3**0.5) for k in range(4)]
    result = monte_carlo(
        Budget.of(0.0, "", four),
        generator=np.random.default_rng(3),
        coverage_probability=0.95,
        tolerance=0.02,
    )
    assert result.standard_uncertainty == pytest.approx(2.0, abs=0.01)
    assert result.high == pytest.approx(3.88, abs=0.05)
    assert result.low == pytest.approx(-3.88, abs=0.05)


def test_gum_is_not_validated_where_the_distribution_is_no_bell() -> None:
    """9.2.4: one dominant rectangular quantity, GUM ±19.8, Monte Carlo ±17.0."""
    lines = [BudgetLine.rectangular(f"X{k}", 3**0.5) for k in range(3)]
    lines.append(BudgetLine.rectangular("X3", 10 * 3**0.5))
    checked = check_by_monte_carlo(
        Budget.of(0.0, "", lines), generator=np.random.default_rng(5), coverage_probability=0.95
    )
    assert checked.budget.expanded_uncertainty(0.95) == pytest.approx(19.9, abs=0.1)
    assert checked.monte_carlo.high == pytest.approx(17.0, abs=0.2)
    assert not checked.agrees
    assert "do not agree" in checked.sentence()


def test_normal_sum_is_validated() -> None:
    """9.2.2: four normal quantities, ±3.92."""
    checked = check_by_monte_carlo(
        Budget.of(0.0, "", [BudgetLine(f"X{k}", 1.0) for k in range(4)]),
        generator=np.random.default_rng(5),
        coverage_probability=0.95,
        significant_digits=1,
    )
    assert checked.budget.degrees_of_freedom == inf
    assert checked.monte_carlo.high == pytest.approx(3.92, abs=0.1)
    assert checked.agrees
    assert " agree" in checked.sentence()
