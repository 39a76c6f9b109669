from .base import CompensationModel as CompensationModel
from .checks import (
    WHOLE_SHARE as WHOLE_SHARE,
    OutlierWarning as OutlierWarning,
    PointsReducedWarning as PointsReducedWarning,
    Outlier as Outlier,
)
from .columns import (
    BRANCH_WORDS as BRANCH_WORDS,
    FEATURES as FEATURES,
    branch_values as branch_values,
    by_names as by_names,
    feature_column as feature_column,
    features as features,
)
from .design import (
    Proposal as Proposal,
    propose_points as propose_points,
)
from .discrepancy import FormModel as FormModel
from .export.formats import (
    EXPORTS as EXPORTS,
    export_table as export_table,
)
from .factory import (
    make_model as make_model,
    model_from_state as model_from_state,
)
from .hybrid import (
    HybridModel as HybridModel,
)
from .hysteresis import (
    HistoryCompensator as HistoryCompensator,
    HysteresisOperator as HysteresisOperator,
    LiveTorque as LiveTorque,
)
from .kinds import MODELS as MODELS, MODEL_NAMES as MODEL_NAMES, check_kind as check_kind
from .model_file import (
    Provenance as Provenance,
    ReadingScale as ReadingScale,
    StoredModel as StoredModel,
    load_model as load_model,
    save_model as save_model,
)
from .network import NetworkModel as NetworkModel
from .polynomial import (
    PolynomialModel as PolynomialModel,
)
from .radial_basis import (
    RadialBasisModel as RadialBasisModel,
)
from .repeats import (
    NoiseFloor as NoiseFloor,
    noise_floor as noise_floor,
    repeat_groups as repeat_groups,
)
from .selection import (
    CANDIDATES as CANDIDATES,
    Comparison as Comparison,
    LeftOut as LeftOut,
    ModelScore as ModelScore,
    compare as compare,
    worse_than_raw as worse_than_raw,
)
from .table import (
    CompensationTable as CompensationTable,
    compile_table as compile_table,
)

RECOMMENDED: str
