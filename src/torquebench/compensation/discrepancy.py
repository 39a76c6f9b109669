"""Model discrepancy: the uncertainty of any estimator against the posterior of the truth.

The definition of this uncertainty is in `curve_uncertainty`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike

from torquebench.compensation.base import CompensationModel
from torquebench.compensation.columns import FloatArray, by_names, feature_column, features
from torquebench.compensation.curve_uncertainty import (
    COVERAGE_95,
    CurveUncertainty,
    half_widths,
    student_widening,
)
from torquebench.compensation.estimator import clone
from torquebench.compensation.state import encode_value
from torquebench.progress import NO_PROGRESS, Progress

__all__ = [
    "FEWEST_POINTS",
    "DiscrepancyUncertainty",
    "Posterior",
    "Values",
    "discrepancy",
    "fit_posterior",
]

Values = Callable[[FloatArray, FloatArray], FloatArray]
"""Additional torque from u and branch, all as fractions of full scale."""
Posterior = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""Mean and standard deviation of the true additional torque from u and branch."""

_SPACING = 0.025  # distance of the nodes, as a share of full scale
_SAMPLES_PER_NODE = 4
FEWEST_POINTS = 5
"""Fewest points for which a discrepancy is estimated."""


class DiscrepancyUncertainty(CompensationModel):
    """An estimator whose uncertainty is its discrepancy from the posterior.

    The values are those of the estimator. Fewer than five points don't determine a discrepancy; the
    estimator's covariance is used then, widened for its degrees of freedom.

    Parameters
    ----------
    estimator : CompensationModel
        Any kind, not fitted.
    posterior : CompensationModel
        A kind whose ``predict(X, return_std=True)`` is mean and standard deviation of the truth. If
        it isn't fitted, a copy is fitted to the same points; a fitted one may serve several
        estimators of its points.

    Attributes
    ----------
    estimator_ : CompensationModel
        Fitted.
    uncertainty_ : CurveUncertainty or None

    Examples
    --------
    >>> from torquebench.compensation import HybridModel, PolynomialModel
    >>> reading = np.linspace(-100.0, 100.0, 41)
    >>> standard = reading + 1e-5 * reading**2 + 0.05 * np.sin(reading / 8)
    >>> bare = PolynomialModel().fit(reading[:, None], standard)
    >>> wrapped = DiscrepancyUncertainty(PolynomialModel(), HybridModel())
    >>> wrapped = wrapped.fit(reading[:, None], standard)
    >>> bool(wrapped.predict([[55.0]]) == bare.predict([[55.0]]))
    True
    >>> X = reading[:, None]
    >>> stds = [np.mean(model.predict(X, return_std=True)[1]) for model in (wrapped, bare)]
    >>> bool(stds[0] > 2 * stds[1])
    True
    """

    estimator_: CompensationModel
    uncertainty_: CurveUncertainty | None

    def __init__(self, estimator: CompensationModel, posterior: CompensationModel) -> None:
        self.estimator = estimator
        self.posterior = posterior

    @classmethod
    def around(
        cls,
        fitted: CompensationModel,
        posterior: CompensationModel,
        uncertainty: CurveUncertainty | None,
    ) -> Self:
        """Return a fitted estimator together with an uncertainty that is known."""
        model = cls(clone(fitted), posterior)
        model._take(fitted, uncertainty)
        return model

    def fit(self, X: ArrayLike, y: ArrayLike, progress: Progress = NO_PROGRESS) -> Self:
        """Fit the estimator, then compare its curve with the posterior of the same points.

        Parameters
        ----------
        X, y, progress
            As for `CompensationModel.fit`.

        Returns
        -------
        self
        """
        X = by_names(X)
        estimator = clone(self.estimator).fit(X, y, progress)
        uncertainty = None
        if estimator.points_ >= FEWEST_POINTS:
            posterior = self.posterior
            if not hasattr(posterior, "points_"):
                posterior = fit_posterior(posterior, estimator, X, y)
            uncertainty = _against(estimator, posterior, np.asarray(X, dtype=np.float64))
        self._take(estimator, uncertainty)
        return self

    def __repr__(self, N_CHAR_MAX: int = 700) -> str:
        return f"{type(self).__name__}({self.estimator!r})"

    def get_state(self) -> dict[str, Any]:
        """Return the estimator's state and the discrepancy."""
        return {**self.estimator_.get_state(), "discrepancy": encode_value(self.uncertainty_)}

    @property
    def kind(self) -> str:  # type: ignore[override] # a class has one kind, a wrapper any
        """Kind of the estimator."""
        return self.estimator.kind

    @property
    def doubtful(self) -> bool:  # type: ignore[override] # see kind
        """Whether the estimator's kind may be worse than the raw reading."""
        return self.estimator.doubtful

    @property
    def complexity(self) -> int:  # type: ignore[override] # see kind
        """Rank of the estimator."""
        return self.estimator.complexity

    @property
    def used_features(self) -> tuple[str, ...]:  # type: ignore[override] # see kind
        """Columns that the estimator uses."""
        return self.estimator.used_features

    @property
    def maximum_points(self) -> int | None:  # type: ignore[override] # see kind
        """Points that the estimator takes without averaging."""
        return self.estimator.maximum_points

    @property
    def range_nm(self) -> float | None:  # type: ignore[override] # see kind
        """Range of the estimator."""
        return self.estimator.range_nm

    @property
    def range_margin(self) -> float:  # type: ignore[override] # see kind
        """Share by which a reading may lie outside the estimator's range."""
        return self.estimator.range_margin

    @property
    def outliers(self) -> str:  # type: ignore[override] # see kind
        """Treatment of outliers by the estimator."""
        return self.estimator.outliers

    @property
    def kind_parameters(self) -> dict[str, Any]:
        """Parameters of the estimator."""
        return self.estimator.kind_parameters

    def scatter_at(self, torque_nm: FloatArray) -> FloatArray:
        """Return the standard deviation of single readings at torques in N·m.

        About a curve that can't follow the chain, points scatter by more than a reading does. The
        form's error is in the curve's uncertainty already, so this is the posterior's noise.
        """
        if self.uncertainty_ is None:
            return self.estimator_.scatter_at(torque_nm)
        u = torque_nm / self.full_scale_nm_
        return np.asarray(self.full_scale_nm_ * self.uncertainty_.scatter_at(u))

    @property
    def scatter_nm(self) -> float:
        """Standard deviation of a single reading in N·m, root mean square over the range."""
        if self.uncertainty_ is None:
            return self.estimator_.scatter_nm
        squares = np.square(self.uncertainty_.scatter)
        return float(self.full_scale_nm_ * np.sqrt(np.mean(squares)))

    @property
    def scatter_freedom(self) -> float:
        """Degrees of freedom of the scatter, which is the posterior's."""
        if self.uncertainty_ is None:
            return self.estimator_.scatter_freedom
        if np.isnan(self.uncertainty_.freedom):  # of version 0.2.0, which took at least 4
            return max(self.degrees_of_freedom_, 4.0)
        return self.uncertainty_.freedom

    def with_range(self, range_nm: float) -> Self:
        """Return an unfitted copy for another range."""
        return type(self)(self.estimator.with_range(range_nm), self.posterior)

    def _take(self, fitted: CompensationModel, uncertainty: CurveUncertainty | None) -> None:
        vars(self).pop("_table", None)  # of an earlier fit
        self.estimator_, self.uncertainty_ = fitted, uncertainty
        self.n_features_in_ = fitted.n_features_in_
        self.full_scale_nm_ = fitted.full_scale_nm_
        self.reading_low_nm_ = fitted.reading_low_nm_
        self.reading_high_nm_ = fitted.reading_high_nm_
        self.points_, self.outliers_ = fitted.points_, fitted.outliers_
        self.noise_nm_ = fitted.noise_nm_
        self.effective_parameters_ = fitted.effective_parameters_
        self.degrees_of_freedom_ = fitted.degrees_of_freedom_

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, progress: Progress) -> None:
        raise NotImplementedError  # `fit` leaves the check to the estimator

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        torque, _ = self.estimator_._predict(X, return_std=False)
        return torque, self._curve_uncertainty(X) if return_std else None

    def _curve_uncertainty(self, X: FloatArray) -> FloatArray:
        if self.uncertainty_ is None:
            widening = student_widening(self.degrees_of_freedom_)
            return np.asarray(widening * self.estimator_._curve_uncertainty(X))
        u, branch = X[:, 0] / self.full_scale_nm_, feature_column(X, "branch")
        return np.asarray(self.full_scale_nm_ * self.uncertainty_.at(u, branch))


def fit_posterior(
    posterior: CompensationModel, estimator: CompensationModel, X: ArrayLike, y: ArrayLike
) -> CompensationModel:
    """Fit a copy of a posterior to the points of an estimator, with its range.

    Parameters
    ----------
    posterior, estimator : CompensationModel
        As for `DiscrepancyUncertainty`; the estimator's parameters are used.
    X, y
        As for `CompensationModel.fit`.

    Returns
    -------
    posterior : CompensationModel
        Fitted to at least three columns: without a branch, a loop counts as scatter.
    """
    fitted: CompensationModel = clone(posterior).set_params(
        range_nm=estimator.range_nm,
        range_margin=estimator.range_margin,
        outliers=estimator.outliers,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the estimator has already warned
        return fitted.fit(_with_branch(np.asarray(X, dtype=np.float64)), y)


def _with_branch(X: FloatArray) -> FloatArray:
    """Return the columns up to the series at least, filled with zeros."""
    return np.pad(X, ((0, 0), (0, max(3 - X.shape[1], 0))))


def _against(
    estimator: CompensationModel, posterior: CompensationModel, X: FloatArray
) -> CurveUncertainty:
    """Compare two models that were fitted to the same points."""
    scale, width = estimator.full_scale_nm_, X.shape[1]
    low, high = estimator.reading_low_nm_, estimator.reading_high_nm_
    series = float(np.min(feature_column(X, "series")))

    def rows(u: FloatArray, branch: FloatArray) -> FloatArray:
        # u times full scale rounds, and may then exceed the limits
        full = np.zeros((u.size, max(width, 3)))
        full[:, :3] = features(np.clip(scale * u, low, high), branch, series)
        return full

    def values(u: FloatArray, branch: FloatArray) -> FloatArray:
        return estimator.predict(rows(u, branch)[:, :width]) / scale - u

    def truth(u: FloatArray, branch: FloatArray) -> tuple[FloatArray, FloatArray]:
        torque, std = posterior.predict(rows(u, branch), return_std=True)
        return torque / scale - u, std / scale

    branches = np.unique(feature_column(X, "branch"))
    uncertainty = discrepancy(
        values,
        truth,
        (low / scale, high / scale),
        branch_aware="branch" in estimator.used_features,
        branches=frozenset(branches[branches != 0.0].tolist()),
    )
    scatter = posterior.scatter_at(scale * uncertainty.nodes) / scale
    return replace(uncertainty, scatter=scatter, freedom=posterior.scatter_freedom)


def discrepancy(
    values: Values,
    posterior: Posterior,
    limits: tuple[float, float],
    *,
    branch_aware: bool,
    branches: frozenset[float],
) -> CurveUncertainty:
    """Return the uncertainty of a model's values against the posterior of the truth.

    Parameters
    ----------
    values : callable
        The model.
    posterior : callable
        Mean and standard deviation of the truth.
    limits : tuple of float
        Lowest and highest u that the model accepts.
    branch_aware : bool
        Whether the model's values depend on the branch.
    branches : frozenset of float
        Branches that the calibration recorded, of +1 and −1: with one of them or none, the others
        are unknown, and a loop counts as noise.

    Returns
    -------
    uncertainty : CurveUncertainty
    """
    count = int(np.ceil((limits[1] - limits[0]) / _SPACING)) * _SAMPLES_PER_NODE
    u = np.linspace(limits[0], limits[1], count + 1)
    nodes = np.arange(0, u.size, _SAMPLES_PER_NODE)
    offsets = np.arange(1 - _SAMPLES_PER_NODE, _SAMPLES_PER_NODE)
    beside = np.clip(nodes[:, None] + offsets, 0, u.size - 1)

    def error(known: float, truth: float) -> tuple[FloatArray, FloatArray]:
        mean, spread = posterior(u, np.full(u.size, truth))
        bias = values(u, np.full(u.size, known)) - mean
        return bias[beside], spread[beside]

    def std(*cases: tuple[FloatArray, FloatArray]) -> FloatArray:
        bias, spread = (np.concatenate(parts, axis=1) for parts in zip(*cases, strict=True))
        return half_widths(bias, spread) / COVERAGE_95

    if len(branches) < 2:
        only = next(iter(branches), 1.0)
        plain = std(error(only, only))
        return CurveUncertainty(u[nodes], plain, plain, plain)
    if not branch_aware:
        both = std(error(0.0, 1.0), error(0.0, -1.0))
        return CurveUncertainty(u[nodes], both, both, both)
    # Half a loop to either side; the budget needs its standard deviation.
    halves = [bias**2 + spread**2 for bias, spread in (error(0.0, 1.0), error(0.0, -1.0))]
    middle = np.sqrt(np.mean(np.concatenate(halves, axis=1), axis=1))
    return CurveUncertainty(u[nodes], std(error(1.0, 1.0)), std(error(-1.0, -1.0)), middle)
