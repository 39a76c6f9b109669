"""Evaluation of tests on reducers: measured columns in, values with uncertainty out.

Pure: torque-angle loops, no-load and break-away torque, transmission error and efficiency, each
value a `Budget` with its contributions; descriptions of reducers, verdicts and comparisons.
"""

from torquebench.reducers.breakaway import BreakawayResult, BreakawayRun, evaluate_breakaway
from torquebench.reducers.comparison import (
    COMMON_CONTRIBUTIONS,
    Change,
    SpecimenComparison,
    change_between,
    compare_specimens,
)
from torquebench.reducers.description import (
    DataSheetLimits,
    EfficiencyLimit,
    NoLoadLimit,
    ReducerDescription,
    available_reducers,
    load_reducer,
)
from torquebench.reducers.efficiency import EfficiencyMap, EfficiencyPoint, evaluate_efficiency
from torquebench.reducers.flange_torque import FlangeInertia, torque_at_flange
from torquebench.reducers.friction import (
    FrictionCurve,
    FrictionResult,
    evaluate_friction,
    friction_curve,
)
from torquebench.reducers.friction_fit import FORMS, Estimate, FrictionFit, fit_friction
from torquebench.reducers.hysteresis import evaluate_hysteresis
from torquebench.reducers.loop_results import (
    HysteresisResult,
    KeyPoint,
    LoopCurve,
    LoopFeatures,
    StiffnessRegions,
)
from torquebench.reducers.loop_rules import (
    LOST_MOTION_RULES,
    LoopSettings,
    LoopUncertainty,
    LostMotionRule,
)
from torquebench.reducers.motion import FirstMotion, first_motion
from torquebench.reducers.no_load import NoLoadResult, evaluate_no_load
from torquebench.reducers.no_load_points import NoLoadPoint
from torquebench.reducers.quantities import Contribution, Finding, ResultQuantity, budget, refuse
from torquebench.reducers.tare import Tare, TareValue, fit_tare
from torquebench.reducers.torque_uncertainty import TorqueUncertainty
from torquebench.reducers.transmission_error import (
    AngleUncertainty,
    DirectionError,
    ErrorOrder,
    TransmissionErrorResult,
    evaluate_transmission_error,
)
from torquebench.reducers.verdicts import AnyResult, QuantityVerdict, verdicts

__all__ = [
    "COMMON_CONTRIBUTIONS",
    "FORMS",
    "LOST_MOTION_RULES",
    "AngleUncertainty",
    "AnyResult",
    "BreakawayResult",
    "BreakawayRun",
    "Change",
    "Contribution",
    "DataSheetLimits",
    "DirectionError",
    "EfficiencyLimit",
    "EfficiencyMap",
    "EfficiencyPoint",
    "ErrorOrder",
    "Estimate",
    "Finding",
    "FirstMotion",
    "FlangeInertia",
    "FrictionCurve",
    "FrictionFit",
    "FrictionResult",
    "HysteresisResult",
    "KeyPoint",
    "LoopCurve",
    "LoopFeatures",
    "LoopSettings",
    "LoopUncertainty",
    "LostMotionRule",
    "NoLoadLimit",
    "NoLoadPoint",
    "NoLoadResult",
    "QuantityVerdict",
    "ReducerDescription",
    "ResultQuantity",
    "SpecimenComparison",
    "StiffnessRegions",
    "Tare",
    "TareValue",
    "TorqueUncertainty",
    "TransmissionErrorResult",
    "available_reducers",
    "budget",
    "change_between",
    "compare_specimens",
    "evaluate_breakaway",
    "evaluate_efficiency",
    "evaluate_friction",
    "evaluate_hysteresis",
    "evaluate_no_load",
    "evaluate_transmission_error",
    "first_motion",
    "fit_friction",
    "fit_tare",
    "friction_curve",
    "load_reducer",
    "refuse",
    "torque_at_flange",
    "verdicts",
]
