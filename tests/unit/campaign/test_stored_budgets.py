"""Budgets of reducer tests in a run's results: what a contribution is shared by stays with it."""

import json

import pytest

from torquebench.campaign.reducers.results import budget_from_plain, plain_budget
from torquebench.reducers import budget, change_between
from torquebench.uncertainty import BudgetLine, Shared


@pytest.mark.parametrize("shared", Shared)
def test_what_a_contribution_is_shared_by_is_stored(shared: Shared) -> None:
    parts = [BudgetLine("an effect", 0.2, 7.0, -1.0, shared), BudgetLine("loops", 0.1)]
    known = budget(3.0, "arcmin", parts)
    stored = budget_from_plain(json.loads(json.dumps(plain_budget(known))))
    assert stored == known
    change = change_between("backlash", stored, stored).change
    cancels = shared is Shared.CALIBRATION
    assert change.standard_uncertainty == pytest.approx(0.02**0.5 if cancels else 0.1**0.5)
