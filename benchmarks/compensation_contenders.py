"""Contenders in the comparison of compensation models: own kinds, other libraries, bounds.

Every contender gets the same calibration and gives the torque at any reading, with a standard
uncertainty where it has one. Other libraries are used as a careful user would: residual mapping
(they learn standard − reading), columns scaled to unit variance, branch and direction of the
loading as further inputs where the library takes several, and enough iterations to converge.
"""

from __future__ import annotations

import importlib.util
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from tests.support.chain_shapes import FloatArray
from tests.support.chains import CalibrationSet, Chain, known_form

from torquebench.calibration import CalibrationData
from torquebench.campaign.fitting import fit_table
from torquebench.compensation import RECOMMENDED, CompensationModel, make_model

__all__ = ["DEFAULT", "Contender", "Prediction", "contenders"]


class Prediction(NamedTuple):
    """Torque at readings, N·m, with standard uncertainties where the contender states any.

    ``curve_std_nm`` is that of the curve, and ``scatter_nm`` what single readings add to it.
    """

    torque_nm: FloatArray
    curve_std_nm: FloatArray | None = None
    scatter_nm: FloatArray | None = None


Predict = Callable[[FloatArray], Prediction]

HIDDEN = 50
"""Neurons of every network, as in the published sources."""

POLYNOMIALS = (2, 3)

DEFAULT = "default of fit"
"""Contender with the default model of ``torquebench fit``."""


@dataclass(frozen=True)
class Contender:
    """One method of compensation.

    Attributes
    ----------
    name : str
        Name in the tables.
    fit : callable
        Function of a chain and its calibration that returns a prediction; only the bounds use the
        chain's true form.
    own : bool
        Whether it is one of this package's kinds of model.
    slow : bool
        Whether a fit takes longer than a few tenths of a second.
    """

    name: str
    fit: Callable[[Chain, CalibrationSet], Predict]
    own: bool = False
    slow: bool = False


OTHER_KINDS = ("bayesian-network", "published-network", "radial-basis")
MODEL_NAMES = (
    *(f"polynomial-{degree}" for degree in (1, *POLYNOMIALS)),
    *(f"polynomial-{degree} per direction" for degree in POLYNOMIALS),
    *OTHER_KINDS,
)
"""Contenders that are a single kind of model of this package, without the default model."""


def contenders() -> list[Contender]:
    """Return all contenders whose library is installed, bounds first."""
    found = [
        Contender("known form", _known(nonlinear=False)),
        Contender("known form, constants unknown", _known(nonlinear=True), slow=True),
        Contender("raw reading", lambda _chain, _data: lambda X: Prediction(X[:, 0])),
    ]
    found.append(Contender(DEFAULT, _default, own=True))
    found += [
        Contender(f"polynomial-{degree}", _own("polynomial", degree=degree), own=True)
        for degree in (1, *POLYNOMIALS)
    ]
    found += [
        Contender(
            f"polynomial-{degree} per direction",
            _own("polynomial", degree=degree, per_direction=True),
            own=True,
        )
        for degree in POLYNOMIALS
    ]
    found += [
        Contender(kind, _own(kind), own=True, slow=kind == "published-network")
        for kind in (RECOMMENDED, *OTHER_KINDS)
    ]
    found += [
        Contender("scikit-learn MLPRegressor", _sklearn_network, slow=True),
        Contender("scikit-learn GaussianProcessRegressor", _sklearn_process, slow=True),
        Contender("SciPy make_smoothing_spline", _scipy_spline, slow=True),
    ]
    if importlib.util.find_spec("pyrenn") is not None:
        found.append(Contender("pyrenn", _pyrenn, slow=True))
    if importlib.util.find_spec("torch") is not None:
        found.append(Contender("PyTorch L-BFGS", _torch, slow=True))
    return found


def _own(kind: str, **parameters: Any) -> Callable[[Chain, CalibrationSet], Predict]:
    def fit(chain: Chain, data: CalibrationSet) -> Predict:
        model = make_model(kind, range_nm=chain.range_nm, **parameters)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.fit(data.X, data.standard_nm)
        return lambda X: _predicted(model, X)

    return fit


def _predicted(model: CompensationModel, X: FloatArray) -> Prediction:
    torque, std = model.predict(X[:, : model.n_features_in_], return_std=True)
    return Prediction(torque, std, np.asarray(model.scatter_at(X[:, 0])))


def _default(chain: Chain, data: CalibrationSet) -> Predict:
    """Fit the default model to a table, as the command does."""
    reading, branch, series = data.X.T
    table = CalibrationData(
        reading, data.standard_nm, series.astype(np.int64), branch.astype(np.int8), chain.range_nm
    )
    model = fit_table(table, "benchmark").model
    return lambda X: _predicted(model, X)


def _known(nonlinear: bool) -> Callable[[Chain, CalibrationSet], Predict]:
    def fit(chain: Chain, data: CalibrationSet) -> Predict:
        fitted = known_form(chain, data, nonlinear=nonlinear)
        return lambda X: Prediction(fitted.predict(X))

    return fit


@dataclass(frozen=True)
class _Scaling:
    """Reading, branch, direction and residual with zero mean and unit variance."""

    centre: FloatArray
    width: FloatArray
    target_centre: float
    target_width: float

    @classmethod
    def of(cls, data: CalibrationSet) -> _Scaling:
        inputs, target = data.X, data.standard_nm - data.X[:, 0]
        return cls(inputs.mean(0), inputs.std(0), float(target.mean()), float(target.std()))

    def inputs(self, X: FloatArray) -> FloatArray:
        return np.asarray((X - self.centre) / self.width)

    def target(self, data: CalibrationSet) -> FloatArray:
        residual = data.standard_nm - data.X[:, 0]
        return np.asarray((residual - self.target_centre) / self.target_width)

    def torque(self, X: FloatArray, scaled: FloatArray) -> FloatArray:
        return np.asarray(X[:, 0] + self.target_centre + self.target_width * np.ravel(scaled))


def _sklearn_network(_chain: Chain, data: CalibrationSet) -> Predict:
    from sklearn.neural_network import MLPRegressor

    scaling = _Scaling.of(data)
    network = MLPRegressor(
        hidden_layer_sizes=(HIDDEN,),
        activation="tanh",
        solver="lbfgs",
        alpha=1e-3,
        max_iter=20_000,
        max_fun=1_000_000,
        tol=1e-7,
        random_state=0,
    )
    network.fit(scaling.inputs(data.X), scaling.target(data))
    return lambda X: Prediction(scaling.torque(X, network.predict(scaling.inputs(X))))


def _sklearn_process(_chain: Chain, data: CalibrationSet) -> Predict:
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    scaling = _Scaling.of(data)
    kernel = ConstantKernel(1.0, (1e-3, 1e5)) * RBF([1.0, 1.0, 1.0], (1e-2, 1e3))
    process = GaussianProcessRegressor(kernel + WhiteKernel(1e-3, (1e-8, 1e1)), random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        process.fit(scaling.inputs(data.X), scaling.target(data))
    noise = float(process.kernel_.k2.noise_level)

    def predict(X: FloatArray) -> Prediction:
        mean, std = process.predict(scaling.inputs(X), return_std=True)
        curve = np.sqrt(np.maximum(std**2 - noise, 0.0))
        scatter = np.full(mean.size, scaling.target_width * np.sqrt(noise))
        return Prediction(scaling.torque(X, mean), scaling.target_width * curve, scatter)

    return predict


def _scipy_spline(_chain: Chain, data: CalibrationSet) -> Predict:
    from scipy.interpolate import make_smoothing_spline

    scaling = _Scaling.of(data)
    # SciPy's spline wants each reading once; a coarse display repeats readings: take weighted
    # means.
    x, place, number = np.unique(
        scaling.inputs(data.X)[:, 0], return_inverse=True, return_counts=True
    )
    y = np.bincount(place, scaling.target(data)) / number
    spline = make_smoothing_spline(x, y, w=number.astype(np.float64))
    return lambda X: Prediction(scaling.torque(X, spline(scaling.inputs(X)[:, 0])))


def _pyrenn(_chain: Chain, data: CalibrationSet) -> Predict:
    import pyrenn

    scaling = _Scaling.of(data)
    np.random.seed(0)  # noqa: NPY002 - pyrenn draws its start from the global generator
    network = pyrenn.CreateNN([3, HIDDEN, 1])
    network = pyrenn.train_LM(
        scaling.inputs(data.X).T, scaling.target(data), network, k_max=100, E_stop=1e-8
    )
    return lambda X: Prediction(scaling.torque(X, pyrenn.NNOut(scaling.inputs(X).T, network)))


def _torch(_chain: Chain, data: CalibrationSet) -> Predict:
    import torch

    scaling = _Scaling.of(data)
    torch.manual_seed(0)
    torch.set_num_threads(1)
    network = torch.nn.Sequential(
        torch.nn.Linear(3, HIDDEN), torch.nn.Tanh(), torch.nn.Linear(HIDDEN, 1)
    ).double()
    inputs, target = torch.tensor(scaling.inputs(data.X)), torch.tensor(scaling.target(data))
    optimiser = torch.optim.LBFGS(
        network.parameters(), max_iter=2000, line_search_fn="strong_wolfe", tolerance_change=1e-12
    )

    def closure() -> Any:
        optimiser.zero_grad()
        decay = sum((p**2).sum() for p in network.parameters())
        loss = ((network(inputs)[:, 0] - target) ** 2).mean() + 2e-5 * decay
        loss.backward()
        return loss

    optimiser.step(closure)

    def predict(X: FloatArray) -> Prediction:
        with torch.no_grad():
            scaled = network(torch.tensor(scaling.inputs(X))).numpy()
        return Prediction(scaling.torque(X, scaled))

    return predict
