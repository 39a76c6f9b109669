from .adaptive import (
    Adaptive as Adaptive,
    AdaptiveRound as AdaptiveRound,
    Placement as Placement,
    Proposed as Proposed,
    even_points as even_points,
    extension_steps as extension_steps,
    place_points as place_points,
)
from .consistency import (
    Disagreement as Disagreement,
    Examination as Examination,
    WrongRow as WrongRow,
    examine as examine,
)
from .condition_cells import (
    Cell as Cell,
    cell_rows as cell_rows,
    cells as cells,
)
from .data import (
    OPTIONAL_COLUMNS as OPTIONAL_COLUMNS,
    REQUIRED_COLUMNS as REQUIRED_COLUMNS,
    RANGE_MARGIN as RANGE_MARGIN,
    CalibrationData as CalibrationData,
    infer_branch as infer_branch,
    infer_series as infer_series,
    plainest as plainest,
)
from .deviations import (
    CalibrationRecord as CalibrationRecord,
    Deviation as Deviation,
    ReferenceStandard as ReferenceStandard,
    assign_nominal as assign_nominal,
    check_steps as check_steps,
    find_deviations as find_deviations,
    ladder_points as ladder_points,
    refuse_deviations as refuse_deviations,
)
from .drift import (
    ControlChart as ControlChart,
    DriftPrediction as DriftPrediction,
    Trend as Trend,
    find_trend as find_trend,
    individuals_chart as individuals_chart,
    predict_drift as predict_drift,
    propose_due_date as propose_due_date,
    span_errors as span_errors,
)
from .evaluation import (
    CLASSES as CLASSES,
    PERCENT_DIGITS as PERCENT_DIGITS,
    Classification as Classification,
    ClassLimits as ClassLimits,
    Interpolation as Interpolation,
    LoadingSeries as LoadingSeries,
    Regression as Regression,
    StaticEvaluation as StaticEvaluation,
    classify as classify,
    evaluate_static as evaluate_static,
    limits_of_class as limits_of_class,
    regression as regression,
)
from .plausibility import (
    Contradiction as Contradiction,
    Plausibility as Plausibility,
    examine_table as examine_table,
    find_contradictions as find_contradictions,
    rows_in_words as rows_in_words,
)
from .profile import (
    Profile as Profile,
    available_profiles as available_profiles,
    load_profile as load_profile,
)
from .results import (
    CalibrationResults as CalibrationResults,
    DirectionResults as DirectionResults,
    SideBySide as SideBySide,
    calibration_results as calibration_results,
)
from .series import (
    Loading as Loading,
    TaredPoints as TaredPoints,
    ZeroHysteresis as ZeroHysteresis,
    loading_series as loading_series,
    own_steps as own_steps,
    tare as tare,
    zero_hysteresis as zero_hysteresis,
)
from .steps import Step as Step
from .verification import (
    RAW as RAW,
    ErrorSummary as ErrorSummary,
    ModelVerification as ModelVerification,
    Repeatability as Repeatability,
    VerificationResult as VerificationResult,
    repeatability as repeatability,
    summarise_errors as summarise_errors,
    verify as verify,
)
