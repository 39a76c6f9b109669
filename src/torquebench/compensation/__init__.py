"""Models of the measuring chain's error: from a torque reading to the best estimate of the torque.

Every model is a scikit-learn regressor with an uncertainty; this room also selects among them by
cross-validation and stores them as JSON.
"""

from torquebench.compensation.base import (
    FEATURES,
    MODELS,
    CompensationModel,
    feature_column,
    features,
    make_model,
)
from torquebench.compensation.bayesian_network import BayesianNetworkModel
from torquebench.compensation.checks import OutlierWarning, PointsReducedWarning, WildPoint
from torquebench.compensation.gaussian_process import GaussianProcessModel
from torquebench.compensation.hybrid import HybridModel
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

__all__ = [
    "CANDIDATES",
    "FEATURES",
    "MODELS",
    "RECOMMENDED",
    "BayesianNetworkModel",
    "Comparison",
    "CompensationModel",
    "GaussianProcessModel",
    "HybridModel",
    "ModelScore",
    "NoiseFloor",
    "OutlierWarning",
    "PhysicsModel",
    "PointsReducedWarning",
    "PolynomialModel",
    "Provenance",
    "PublishedNetworkModel",
    "RadialBasisModel",
    "SplineModel",
    "StoredModel",
    "WildPoint",
    "compare",
    "feature_column",
    "features",
    "load_model",
    "make_model",
    "noise_floor",
    "repeat_groups",
    "save_model",
]

RECOMMENDED = "hybrid"
"""Kind of model that a calibration puts into use when nobody chooses another."""
