from .bench_chains import (
    check_standard as check_standard,
    recorded_effects as recorded_effects,
    used_chain as used_chain,
)
from .calibrating import (
    CALIBRATION as CALIBRATION,
    FinishedCalibration as FinishedCalibration,
    measure_calibration as measure_calibration,
)
from .calibration_comparison import (
    CalibrationComparison as CalibrationComparison,
    CalibrationStep as CalibrationStep,
)
from .checking import (
    check_module as check_module,
    judge_check as judge_check,
)
from .doubts import (
    CALIBRATOR as CALIBRATOR,
    VERIFICATION_STANDARD as VERIFICATION_STANDARD,
    doubts_before as doubts_before,
)
from .drifting import (
    DriftSeries as DriftSeries,
)
from .finishing import (
    discard_run as discard_run,
    find_unfinished as find_unfinished,
    finish_recorded_run as finish_recorded_run,
)
from .fitting import (
    CHOSEN_ELSEWHERE as CHOSEN_ELSEWHERE,
    COMPARED_COLUMNS as COMPARED_COLUMNS,
    FittedModel as FittedModel,
    ModelChoice as ModelChoice,
    fit_metrics as fit_metrics,
    fit_models as fit_models,
    model_in_use as model_in_use,
    model_title as model_title,
    few_points as few_points,
    remarks_on as remarks_on,
    store_model as store_model,
)
from .measuring import (
    Measured as Measured,
    RunAbortedError as RunAbortedError,
    RunOptions as RunOptions,
    measure as measure,
)
from .reducers.quantities import (
    ReducerTestQuantity as ReducerTestQuantity,
)
from .reducers.results import (
    SHORT_TEST as SHORT_TEST,
    ReducerTestOutcome as ReducerTestOutcome,
    ReducerTestRecord as ReducerTestRecord,
    ReducerTestRehearsal as ReducerTestRehearsal,
)
from .reducers.settings import (
    ReducerTestSettings as ReducerTestSettings,
)
from .reducers.tests import (
    rehearse_reducer_test as rehearse_reducer_test,
    run_reducer_test as run_reducer_test,
)
from .registering import (
    read_measured as read_measured,
    registers_calibration as registers_calibration,
    run_data as run_data,
)
from .resuming import (
    find_interrupted as find_interrupted,
    read_interrupted as read_interrupted,
    resume_calibration as resume_calibration,
)
from .standard_reducer import (
    FRICTION as FRICTION,
    StandardReducer as StandardReducer,
    check_standard_reducer as check_standard_reducer,
    certified_reducer as certified_reducer,
)
from .verifying import (
    verify_on_bench as verify_on_bench,
)
