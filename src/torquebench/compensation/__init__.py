"""Compensation models: from a torque reading to the best estimate of the torque.

Every model is a scikit-learn regressor with an uncertainty; this package also selects among them by
cross-validation, stores them as JSON, compiles them to tables for live readings and other programs,
follows hysteresis, and proposes the next calibration points.
"""

import lazy_loader

__getattr__, __dir__, _public = lazy_loader.attach_stub(__name__, __file__)
__all__ = ["RECOMMENDED", *_public]

RECOMMENDED = "hybrid"
"""Kind of model that a calibration activates by default."""
