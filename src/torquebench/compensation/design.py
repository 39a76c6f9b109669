"""Optimal design: the calibration points that lower the predicted uncertainty most.

The hybrid's posterior after a first, coarse series predicts by how much a new point lowers the
uncertainty at each torque; the model in use states the present uncertainty there. Points are chosen
one by one: each lowers the criterion most, with all chosen points treated as measured. This depends
on their torques only, not on their readings (greedy sequential design; A. Krause, A. Singh, C.
Guestrin, J. Machine Learning Research 9 (2008) 235-284).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from torquebench.compensation.base import CompensationModel
from torquebench.compensation.columns import FloatArray, features
from torquebench.compensation.curve_uncertainty import CurveUncertainty
from torquebench.compensation.hybrid.model import Average, HybridModel
from torquebench.compensation.hybrid.parts import Points
from torquebench.errors import InputError
from torquebench.message import Message

Criterion = Literal["worst", "integrated"]

_PLACES = 121
_SHARPNESS = 16
"""Exponent of the mean that approximates the maximum smoothly, where two peaks are equally high."""

_MOST = 150
"""Largest number of points in one proposal: its first points should be measured before more are
predicted."""


@dataclass(frozen=True)
class Proposal:
    """Calibration points in the order in which a bench can load them.

    Attributes
    ----------
    nominal_nm : float64 array of shape (k,)
        Torques: clockwise up and down again, then counter-clockwise up and down again.
    branch : int8 array of shape (k,)
        +1 on the way up, -1 on the way down.
    before_nm, after_nm : float
        Standard uncertainty by the criterion (worst, or root mean square) before the points are
        measured, and as predicted after.
    """

    nominal_nm: FloatArray
    branch: np.ndarray[tuple[int], np.dtype[np.int8]]
    before_nm: float
    after_nm: float


class _Process(HybridModel):
    """The hybrid with the covariance of its curve."""

    def _tabulated(self, average: Average) -> CurveUncertainty:
        self._average = average
        return super()._tabulated(average)

    def covariance(self, reading_nm: FloatArray, branch: FloatArray) -> FloatArray:
        """Return the covariance of the curve among readings, in (N·m)²."""
        shares, points = self._average.shares, Points(reading_nm / self.scale_nm_, branch)
        curves = [member.curve(points) for member in self._average.members]
        means = np.array([mean for mean, _ in curves])
        deviation = means - shares @ means
        total = (deviation.T * shares) @ deviation
        for share, (_, factors) in zip(shares, curves, strict=True):
            total += share * factors @ factors.T
        return np.asarray((self.scale_nm_ * self._average.unit) ** 2 * total)


def propose_points(
    model: CompensationModel,
    X: ArrayLike,
    y: ArrayLike,
    count: int,
    *,
    criterion: Criterion = "worst",
) -> Proposal:
    """Propose the next calibration points.

    Parameters
    ----------
    model : fitted CompensationModel
        Model of any kind with an uncertainty, fitted to X and y.
    X : array_like of shape (n, k)
        Calibration so far, see `features`.
    y : array_like of shape (n,)
        Standard torque in N·m.
    count : int
        Number of proposed points, 1 to 150; preferably a few at a time.
    criterion : {"worst", "integrated"}
        Whether the largest or the root mean square standard uncertainty over the range counts.

    Raises
    ------
    InputError
        When the count isn't possible, or the calibration so far is too small for a fit.

    Examples
    --------
    >>> from torquebench.compensation import features, make_model
    >>> reading = np.linspace(-100.0, 100.0, 16)
    >>> X, y = features(reading, 1.0), reading + 1e-5 * reading**2 + 0.01 * np.sin(reading)
    >>> proposal = propose_points(make_model("polynomial-3").fit(X, y), X, y, count=6)
    >>> proposal.nominal_nm.size, bool(proposal.after_nm < proposal.before_nm)
    (6, True)
    """
    if not 1 <= count <= _MOST:
        raise InputError(
            Message("{count} points to propose", count),
            Message("1 to {most}", _MOST),
            "measure these first and propose again",
        )
    rows = np.atleast_2d(np.asarray(X, dtype=np.float64))
    full_scale = float(model.full_scale_nm_)
    low = max(model.reading_low_nm_, -full_scale)
    high = min(model.reading_high_nm_, full_scale)
    places = np.tile(np.linspace(low, high, _PLACES), 2)
    branch = np.repeat([1.0, -1.0], _PLACES)
    process = _Process(range_nm=full_scale, outliers="keep").fit(rows, y)
    posterior, noise_variance = process.covariance(places, branch), process.scatter_nm**2
    # the posterior predicts the influence of a point, the model states the present uncertainty
    deviation = _model_deviation(model, rows.shape[1], places, branch)
    scale = deviation / np.sqrt(np.maximum(np.diag(posterior), 1e-18 * full_scale**2))
    posterior *= np.outer(scale, scale)
    chosen: list[int] = []
    for _ in range(count):
        variance = np.diag(posterior)
        after = variance[:, None] - posterior**2 / (variance + noise_variance)
        score = _score(after, criterion)
        score[chosen] = np.inf
        best = int(np.argmin(score))
        chosen.append(best)
        column = posterior[:, best].copy()
        posterior -= np.outer(column, column) / (column[best] + noise_variance)
    order = _staircase(places[chosen], branch[chosen])
    return Proposal(
        places[chosen][order],
        branch[chosen][order].astype(np.int8),
        _uncertainty(np.square(deviation), criterion),
        _uncertainty(np.diag(posterior), criterion),
    )


def _model_deviation(
    model: CompensationModel, columns: int, places: FloatArray, branch: FloatArray
) -> FloatArray:
    """Return the model's standard uncertainty at readings and branches, N·m; above 0."""
    X = np.zeros((places.size, columns))
    X[:, : min(columns, 2)] = features(places, branch)[:, : min(columns, 2)]
    _, deviation = model.predict(X, return_std=True)
    return np.maximum(deviation, 1e-9 * model.full_scale_nm_)


def _score(variance: FloatArray, criterion: Criterion) -> FloatArray:
    """Return the criterion to be minimised for each column of variances over the range."""
    if criterion == "integrated":
        return np.asarray(np.mean(variance, axis=0))
    largest = np.max(variance)
    power = (np.maximum(variance, 0.0) / largest) ** (_SHARPNESS // 2)
    return np.asarray(np.mean(power, axis=0))


def _uncertainty(variance: FloatArray, criterion: Criterion) -> float:
    """Return the standard uncertainty that belongs to a value of the criterion."""
    size = np.max(variance) if criterion == "worst" else np.mean(variance)
    return float(np.sqrt(max(size, 0.0)))


def _staircase(target: FloatArray, branch: FloatArray) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """Order points for loading: clockwise, then counter-clockwise, each rising, then falling."""
    counter_clockwise = target < 0
    size = np.where(branch > 0, np.abs(target), -np.abs(target))
    return np.lexsort((size, -branch, counter_clockwise))
