"""Calibration as pure values: the table of a calibration, its profile, evaluation and check.

Arrays in, frozen values out; no device and no file except the packaged profiles.
"""

from torquebench.calibration.adaptive import (
    Adaptive,
    AdaptiveRound,
    Placement,
    Proposed,
    even_points,
    extension_steps,
    place_points,
)
from torquebench.calibration.classes import (
    CLASSES,
    Classification,
    ClassLimits,
    classify,
    limits_of_class,
)
from torquebench.calibration.data import RANGE_MARGIN, CalibrationData, infer_branch
from torquebench.calibration.deviations import (
    CalibrationRecord,
    Deviation,
    ReferenceStandard,
    assign_nominal,
    find_deviations,
    ladder_points,
    refuse_deviations,
)
from torquebench.calibration.drift import (
    ControlChart,
    DriftPrediction,
    Trend,
    find_trend,
    individuals_chart,
    predict_drift,
    propose_due_date,
    span_errors,
)
from torquebench.calibration.evaluation import (
    Interpolation,
    LoadingSeries,
    StaticEvaluation,
    evaluate_static,
)
from torquebench.calibration.profile import Profile, available_profiles, load_profile
from torquebench.calibration.results import (
    CalibrationResults,
    DirectionResults,
    SideBySide,
    calibration_results,
)
from torquebench.calibration.series import ZeroHysteresis, loading_series, zero_hysteresis
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
    "CLASSES",
    "RANGE_MARGIN",
    "RAW",
    "Adaptive",
    "AdaptiveRound",
    "CalibrationData",
    "CalibrationRecord",
    "CalibrationResults",
    "ClassLimits",
    "Classification",
    "ControlChart",
    "Deviation",
    "DirectionResults",
    "DriftPrediction",
    "ErrorSummary",
    "Interpolation",
    "LoadingSeries",
    "ModelVerification",
    "Placement",
    "Profile",
    "Proposed",
    "ReferenceStandard",
    "Repeatability",
    "SideBySide",
    "StaticEvaluation",
    "Step",
    "Trend",
    "VerificationResult",
    "ZeroHysteresis",
    "assign_nominal",
    "available_profiles",
    "calibration_results",
    "check_limits",
    "classify",
    "evaluate_static",
    "even_points",
    "extension_steps",
    "find_deviations",
    "find_trend",
    "individuals_chart",
    "infer_branch",
    "ladder_points",
    "limits_of_class",
    "load_profile",
    "loading_series",
    "place_points",
    "predict_drift",
    "propose_due_date",
    "refuse_deviations",
    "span_errors",
    "summarise_errors",
    "total_duration_s",
    "verify",
    "zero_hysteresis",
]
