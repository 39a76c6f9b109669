"""The recommended model: Gaussian processes of a chain's physics, averaged by their evidence.

`model` has the estimator. `parts` describes what a chain may show, `member` solves one structure of
parts, `average` weighs the structures, `calibration_path` reads time and scatter off the points'
path.
"""

from torquebench.compensation.hybrid.model import HybridModel

__all__ = ["HybridModel"]
