"""
A model of your own
===================

A compensation model is a scikit-learn regressor from reading to torque. A subclass of
``FormModel`` gives the fit and the curve; checks of the data, range limits,
cross-validation, uncertainty and budgets come with it. The data are simulated.
"""

# %%
# Additional torque = ``a + b·x + c·x·|x|``: an offset, a span error, and a curvature that is
# odd in the torque.
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import torquebench as tb
from torquebench.uncertainty import CertifiedUncertainty
from torquebench.chain import MeasuringChain, Readings, Reference
from torquebench.compensation import FormModel, make_model


class OddSquare(FormModel):
    """Offset, span and odd square by weighted least squares."""

    def _terms(self, X):
        x = X[:, 0] / self.full_scale_nm_
        return np.column_stack([np.ones_like(x), x, x * np.abs(x)])

    def _fit(self, X, y, weights, progress):
        root = np.sqrt(weights)
        terms = self._terms(X) * root[:, None]
        self.coefficients_, squares, *_ = np.linalg.lstsq(terms, (y - X[:, 0]) * root)
        self.effective_parameters_ = 3.0
        self.noise_nm_ = float(np.sqrt(squares[0] / (len(y) - 3)))

    def _predict(self, X):
        return X[:, 0] + self._terms(X) @ self.coefficients_


# %%
# It is compared like any other model, at steps left out:
calibration = tb.read_calibration(Path("../../examples") / "calibration-output.csv")
comparison = tb.compare(
    calibration,
    {
        "odd square": OddSquare(),
        "polynomial-2": make_model("polynomial-2"),
        "radial-basis": make_model("radial-basis"),
    },
)
_, axes = plt.subplots(figsize=(7.6, 2.4), layout="constrained")
drawing = tb.plot(comparison, ax=axes)

# %%
# In a measuring chain it gets U and a budget:
model = OddSquare(range_nm=calibration.range_nm)
model.fit(calibration.features(), calibration.standard_nm)
chain = MeasuringChain(
    model, (Reference("certificate 17", CertifiedUncertainty.flat(0.4, 40.0, 2000.0)),)
)
print(chain.torque(Readings(np.array([1500.0]))).budget(0).text())
