from .breakaway import (
    BreakawayResult as BreakawayResult,
    BreakawayRun as BreakawayRun,
    FirstMotion as FirstMotion,
    evaluate_breakaway as evaluate_breakaway,
    first_motion as first_motion,
)
from .comparison import (
    Change as Change,
    SpecimenComparison as SpecimenComparison,
    change_between as change_between,
    compare_specimens as compare_specimens,
)
from .description import (
    CertifiedFriction as CertifiedFriction,
    DataSheetLimits as DataSheetLimits,
    EfficiencyLimit as EfficiencyLimit,
    NoLoadLimit as NoLoadLimit,
    ReducerDescription as ReducerDescription,
    available_reducers as available_reducers,
    load_reducer as load_reducer,
)
from .efficiency import (
    EfficiencyMap as EfficiencyMap,
    EfficiencyPoint as EfficiencyPoint,
    evaluate_efficiency as evaluate_efficiency,
)
from .loops.flange_torque import (
    FlangeInertia as FlangeInertia,
    torque_at_flange as torque_at_flange,
)
from .running.friction import (
    FrictionCurve as FrictionCurve,
    FrictionResult as FrictionResult,
    evaluate_friction as evaluate_friction,
)
from .running.friction_fit import (
    FORMS as FORMS,
    Estimate as Estimate,
    FrictionFit as FrictionFit,
    fit_friction as fit_friction,
)
from .loops.evaluation import (
    evaluate_hysteresis as evaluate_hysteresis,
)
from .loops.results import (
    LOST_MOTION_RULES as LOST_MOTION_RULES,
    Feature as Feature,
    HysteresisResult as HysteresisResult,
    KeyPoint as KeyPoint,
    LoopCurve as LoopCurve,
    LoopFeatures as LoopFeatures,
    LoopSettings as LoopSettings,
    LoopUncertainty as LoopUncertainty,
    LostMotionRule as LostMotionRule,
    OpenLoopError as OpenLoopError,
    StiffnessRegions as StiffnessRegions,
)
from .running.no_load import (
    NoLoadPoint as NoLoadPoint,
    NoLoadResult as NoLoadResult,
    evaluate_no_load as evaluate_no_load,
)
from .quantities import (
    LimitedQuantity as LimitedQuantity,
    ReducerResult as ReducerResult,
    Finding as Finding,
    ResultQuantity as ResultQuantity,
    budget as budget,
    refuse as refuse,
)
from .quantity_verdicts import (
    QuantityVerdict as QuantityVerdict,
    verdicts as verdicts,
)
from .running.tare import (
    Tare as Tare,
    TareValue as TareValue,
    fit_tare as fit_tare,
)
from .torque_uncertainty import (
    TorqueUncertainty as TorqueUncertainty,
)
from .transmission.evaluation import (
    AngleUncertainty as AngleUncertainty,
    DirectionError as DirectionError,
    ErrorOrder as ErrorOrder,
    TransmissionErrorResult as TransmissionErrorResult,
    evaluate_transmission_error as evaluate_transmission_error,
)
from .transmission.runs import (
    unwrapped as unwrapped,
)
from .transmission.swings import (
    Swing as Swing,
    SwingsResult as SwingsResult,
    evaluate_swings as evaluate_swings,
    turned_one_way as turned_one_way,
)
from .standard_reducer import (
    FrictionCheck as FrictionCheck,
    FrictionCheckPoint as FrictionCheckPoint,
    check_friction as check_friction,
)
