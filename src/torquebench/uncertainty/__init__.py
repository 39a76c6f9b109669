"""Measurement uncertainty: GUM and Monte Carlo propagation, budgets, decision rules.

Pure: quantities and functions in, frozen results out. Sources: JCGM 100:2008 (GUM),
JCGM 101:2008 (Monte Carlo), JCGM 106:2012 (conformity), ILAC-G8:09/2019 (guard bands).
"""

from torquebench.uncertainty.budget import (
    COVERAGE_PROBABILITY,
    Budget,
    BudgetLine,
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
from torquebench.uncertainty.line import LineFit, fit_line
from torquebench.uncertainty.monte_carlo import (
    MonteCarloResult,
    Validation,
    check_by_monte_carlo,
    coverage_interval,
    monte_carlo,
    numerical_tolerance,
    validate,
)
from torquebench.uncertainty.propagation import propagate
from torquebench.uncertainty.quantity import Quantity
from torquebench.uncertainty.sensitivity import sensitivities
from torquebench.uncertainty.shared import Shared
from torquebench.uncertainty.stating import rounded, stated

__all__ = [
    "COVERAGE_PROBABILITY",
    "Budget",
    "BudgetLine",
    "CertifiedUncertainty",
    "Decision",
    "Distribution",
    "LineFit",
    "MonteCarloResult",
    "Quantity",
    "Shared",
    "Tolerance",
    "Validation",
    "Verdict",
    "check_by_monte_carlo",
    "conformance_probability",
    "coverage_factor",
    "coverage_interval",
    "decide",
    "fit_line",
    "monte_carlo",
    "numerical_tolerance",
    "propagate",
    "rounded",
    "sample",
    "sensitivities",
    "stated",
    "validate",
    "welch_satterthwaite",
]
