"""Budgets of sums against GTC and against algebra."""

from math import inf

import GTC
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.uncertainty import (
    Budget,
    BudgetLine,
    Distribution,
    Shared,
    coverage_factor,
    welch_satterthwaite,
)

uncertainties = st.floats(1e-3, 1.0)
freedoms = st.one_of(st.just(inf), st.floats(2.0, 200.0))
rows_of_lines = st.lists(
    st.tuples(uncertainties, freedoms, st.sampled_from([1.0, -1.0])), min_size=1, max_size=8
)


@given(rows_of_lines)
def test_a_sum_agrees_with_gtc(rows: list[tuple[float, float, float]]) -> None:
    ours = Budget.of(3.0, "N·m", [BudgetLine("part", *row) for row in rows])
    theirs = 3.0 + sum(sign * GTC.ureal(0.0, u, freedom) for u, freedom, sign in rows)
    assert ours.value == GTC.value(theirs)
    assert ours.standard_uncertainty == pytest.approx(GTC.uncertainty(theirs), rel=1e-9)
    assert ours.degrees_of_freedom == pytest.approx(GTC.dof(theirs), rel=1e-8)
    assert sum(line.share for line in ours.lines) == pytest.approx(1.0)


@given(rows_of_lines)
def test_effective_freedom_lies_between_the_smallest_and_the_sum(
    rows: list[tuple[float, float, float]],
) -> None:
    u, freedom, _ = np.array(rows).T
    effective = float(welch_satterthwaite(u, freedom))
    assert min(freedom) * (1 - 1e-12) <= effective <= np.sum(freedom) * (1 + 1e-9)


@given(st.floats(1.0, 1e4), st.floats(0.5, 0.999))
def test_coverage_factor_falls_with_freedom(freedom: float, probability: float) -> None:
    assert coverage_factor(freedom, probability) >= coverage_factor(inf, probability)
    assert coverage_factor(freedom, probability) >= coverage_factor(freedom + 1, probability)


@pytest.mark.parametrize("arguments", [(3.0, 1.0), (0.0, 0.95)])
def test_an_impossible_coverage_is_refused(arguments: tuple[float, float]) -> None:
    with pytest.raises(InputError):
        coverage_factor(*arguments)


def test_gum_h1_end_gauge() -> None:
    """GUM, table H.1: contributions to the length in nm, with their degrees of freedom."""
    sizes = {25.0: 18.0, 5.8: 24.0, 3.9: 5.0, 6.7: 8.0, 2.9: 50.0, 16.6: 2.0}
    lines = [BudgetLine(f"{size} nm", size, freedom) for size, freedom in sizes.items()]
    budget = Budget.of(838.0, "nm", lines)
    assert budget.standard_uncertainty == pytest.approx(32.0, abs=0.5)
    assert budget.degrees_of_freedom == pytest.approx(16.75, abs=0.1)
    assert budget.expanded_uncertainty(0.99) == pytest.approx(92.0, abs=1.5)
    low, high = budget.interval(0.99)
    assert (low + high) / 2 == pytest.approx(838.0)


def test_a_multiple_keeps_source_and_sign() -> None:
    line = BudgetLine("zero", 0.2, 9.0, -1.0, Shared.ZEROING, value=5.0)
    half = line.times(-0.5)
    assert (half.standard_uncertainty, half.sensitivity, half.value) == (0.1, 1.0, 0.0)
    assert (half.name, half.degrees_of_freedom, half.shared) == ("zero", 9.0, Shared.ZEROING)
    assert half.common


def test_text_shows_every_line() -> None:
    lines = [BudgetLine("lever", 0.01), BudgetLine.rectangular("force", 0.05)]
    shown = Budget.of(50.0, "N·m", lines).text().splitlines()
    assert shown[1].startswith("lever")
    assert shown[2].startswith("force")
    assert str(Distribution.RECTANGULAR) in shown[2]
    assert "k = " in shown[3]


def test_zero_uncertainty_everywhere() -> None:
    budget = Budget.of(1.0, "N·m", [BudgetLine("a", 0.0)])
    assert (budget.standard_uncertainty, budget.degrees_of_freedom) == (0.0, inf)
