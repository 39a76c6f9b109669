"""Evaluation of tests on reducers: measured columns in, values with uncertainty out.

Pure. So far the no-load friction: mean and spread at each speed, and its parts.
"""

from torquebench.reducers.friction import (
    FrictionCurve,
    FrictionResult,
    evaluate_friction,
    friction_curve,
)
from torquebench.reducers.friction_fit import FORMS, Estimate, FrictionFit, fit_friction

__all__ = [
    "FORMS",
    "Estimate",
    "FrictionCurve",
    "FrictionFit",
    "FrictionResult",
    "evaluate_friction",
    "fit_friction",
    "friction_curve",
]
