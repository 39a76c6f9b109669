"""Calibration as pure values: the table of a calibration, its profile, evaluation and check.

Arrays in, frozen values out; no device and no file except the packaged profiles.
"""

from torquebench.calibration.data import RANGE_MARGIN, CalibrationData, infer_branch
from torquebench.calibration.profile import Profile, available_profiles, load_profile
from torquebench.calibration.steps import Step, check_limits, total_duration_s
from torquebench.calibration.verification import (
    RAW,
    ErrorSummary,
    ModelVerification,
    Repeatability,
    VerificationResult,
    summarise_errors,
    verify,
)

__all__ = [
    "RANGE_MARGIN",
    "RAW",
    "CalibrationData",
    "ErrorSummary",
    "ModelVerification",
    "Profile",
    "Repeatability",
    "Step",
    "VerificationResult",
    "available_profiles",
    "check_limits",
    "infer_branch",
    "load_profile",
    "summarise_errors",
    "total_duration_s",
    "verify",
]
