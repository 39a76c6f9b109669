"""Measurement uncertainty: budgets of sums, their check by Monte Carlo, decision rules.

Pure functions with frozen results. Sources: JCGM 100:2008 (GUM), JCGM 101:2008 (Monte Carlo), JCGM
106:2012 (conformity), ILAC-G8:09/2019 (guard bands).
"""

from torquebench.uncertainty.budget import (
    COVERAGE_PROBABILITY,
    Budget,
    BudgetLine,
    Shared,
    coverage_factor,
    welch_satterthwaite,
)
from torquebench.uncertainty.certified import CertifiedUncertainty
from torquebench.uncertainty.decision import (
    Decision,
    Tolerance,
    Verdict,
    conformance_probability,
    decide,
)
from torquebench.uncertainty.distributions import Distribution, sample
from torquebench.uncertainty.monte_carlo import (
    MonteCarloResult,
    Validation,
    check_by_monte_carlo,
    coverage_interval,
    monte_carlo,
    numerical_tolerance,
)
from torquebench.uncertainty.stating import rounded, stated

__all__ = [
    "COVERAGE_PROBABILITY",
    "Budget",
    "BudgetLine",
    "CertifiedUncertainty",
    "Decision",
    "Distribution",
    "MonteCarloResult",
    "Shared",
    "Tolerance",
    "Validation",
    "Verdict",
    "check_by_monte_carlo",
    "conformance_probability",
    "coverage_factor",
    "coverage_interval",
    "decide",
    "monte_carlo",
    "numerical_tolerance",
    "rounded",
    "sample",
    "stated",
    "welch_satterthwaite",
]
