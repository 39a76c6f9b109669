"""Models of the measuring chain's error: from a torque reading to the best estimate of the torque.

Every model is a scikit-learn regressor with an uncertainty; this room also selects among them by
cross-validation, stores them as JSON, compiles them to tables that run live or elsewhere, follows
hysteresis, budgets the uncertainty of a reading and proposes where to calibrate next.
"""

from torquebench.compensation.base import (
    FEATURES,
    MODELS,
    WHOLE_SHARE,
    CompensationModel,
    feature_column,
    features,
    make_model,
)
from torquebench.compensation.bayesian_network import BayesianNetworkModel
from torquebench.compensation.budget import (
    ChainSpecification,
    ReadingBudget,
    ReadingConditions,
    StreamUncertainty,
)
from torquebench.compensation.checks import OutlierWarning, PointsReducedWarning, WildPoint
from torquebench.compensation.design import Proposal, propose_points
from torquebench.compensation.export import EXPORTS, export_table
from torquebench.compensation.gaussian_process import GaussianProcessModel
from torquebench.compensation.hybrid import HybridModel
from torquebench.compensation.hysteresis import HistoryCompensator, HysteresisOperator, LiveTorque
from torquebench.compensation.model_file import (
    Provenance,
    StoredModel,
    load_model,
    save_model,
)
from torquebench.compensation.physics import PhysicsModel
from torquebench.compensation.polynomial import PolynomialModel
from torquebench.compensation.published_network import PublishedNetworkModel
from torquebench.compensation.radial_basis import RadialBasisModel
from torquebench.compensation.repeats import NoiseFloor, noise_floor, repeat_groups
from torquebench.compensation.selection import (
    CANDIDATES,
    Comparison,
    ModelScore,
    compare,
)
from torquebench.compensation.spline import SplineModel
from torquebench.compensation.table import CompensationTable, compile_table

__all__ = [
    "CANDIDATES",
    "EXPORTS",
    "FEATURES",
    "MODELS",
    "RECOMMENDED",
    "WHOLE_SHARE",
    "BayesianNetworkModel",
    "ChainSpecification",
    "Comparison",
    "CompensationModel",
    "CompensationTable",
    "GaussianProcessModel",
    "HistoryCompensator",
    "HybridModel",
    "HysteresisOperator",
    "LiveTorque",
    "ModelScore",
    "NoiseFloor",
    "OutlierWarning",
    "PhysicsModel",
    "PointsReducedWarning",
    "PolynomialModel",
    "Proposal",
    "Provenance",
    "PublishedNetworkModel",
    "RadialBasisModel",
    "ReadingBudget",
    "ReadingConditions",
    "SplineModel",
    "StoredModel",
    "StreamUncertainty",
    "WildPoint",
    "compare",
    "compile_table",
    "export_table",
    "feature_column",
    "features",
    "load_model",
    "make_model",
    "noise_floor",
    "propose_points",
    "repeat_groups",
    "save_model",
]

RECOMMENDED = "hybrid"
"""Kind of model that a calibration puts into use when nobody chooses another."""
