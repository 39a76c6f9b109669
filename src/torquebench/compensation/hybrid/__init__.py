"""The recommended model: Gaussian processes of a chain's physics, averaged by their evidence.

`model` has the estimator. `parts` describes the effects that a chain may show, `member` solves one
structure of parts, `average` weighs the structures, and `calibration_path` derives time and
correlated scatter from the order of the points.
"""

from torquebench.compensation.hybrid.model import HybridModel

__all__ = ["HybridModel"]
