"""Model discrepancy: the uncertainty of any curve against the posterior of the truth.

The definition of this uncertainty is in `curve_uncertainty`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from torquebench.compensation.base import CompensationModel
from torquebench.compensation.columns import FloatArray, by_names, feature_column, features
from torquebench.compensation.curve_uncertainty import COVERAGE_95, CurveUncertainty, half_widths
from torquebench.compensation.hybrid import HybridModel
from torquebench.progress import NO_PROGRESS, Progress

Values = Callable[[FloatArray, FloatArray], FloatArray]
"""Function from u and branch to the additional torque, all as fractions of full scale."""
Posterior = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""Function from u and branch to mean and standard deviation of the true additional torque."""

POSTERIOR_POINTS = 200
"""Largest number of points to which the posterior of the truth is fitted; more are averaged."""
_SPACING = 0.025  # distance of the nodes, as a share of full scale
_SAMPLES_PER_NODE = 4


class FormModel(CompensationModel):
    """Base of models of a fixed form, whose deviation from the chain isn't scatter.

    `fit` compares the curve with the hybrid's posterior of the truth from the same points, unless
    `_fit` states `uncertainty_` itself.
    """

    def fit(self, X: ArrayLike, y: ArrayLike, progress: Progress = NO_PROGRESS) -> Self:
        """Fit the model to calibration points, and compute its curve's discrepancy."""
        X = by_names(X)
        self.fit_curve(X, y, progress)
        if self.lacks_uncertainty:
            self.uncertainty_ = discrepancy_of(self, fit_posterior(self, X, y), X)
        return self


def fit_posterior(model: CompensationModel, X: ArrayLike, y: ArrayLike) -> HybridModel:
    """Fit the posterior of the truth to the points of a model, with the model's range.

    The points are padded to three columns: without a branch, a loop counts as scatter.
    """
    posterior = HybridModel(
        range_nm=model.range_nm,
        range_margin=model.range_margin,
        outliers=model.outliers,
        zeroed=model.zeroed,
        maximum_points=POSTERIOR_POINTS,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the model has already warned
        return posterior.fit(_with_branch(np.asarray(X, dtype=np.float64)), y)


def _with_branch(X: FloatArray) -> FloatArray:
    """Pad the columns with zeros up to the series."""
    return np.pad(X, ((0, 0), (0, max(3 - X.shape[1], 0))))


def discrepancy_of(
    model: CompensationModel, posterior: CompensationModel, X: ArrayLike
) -> CurveUncertainty:
    """Return a fitted curve's uncertainty from its difference to a posterior of the same points."""
    X = np.asarray(X, dtype=np.float64)
    scale, width = model.full_scale_nm_, X.shape[1]
    low, high = model.reading_low_nm_, model.reading_high_nm_
    series = float(np.min(feature_column(X, "series")))

    def rows(u: FloatArray, branch: FloatArray) -> FloatArray:
        """Return columns of a model at shares of full scale."""
        # u times full scale is rounded and may then exceed the limits
        full = np.zeros((u.size, max(width, 3)))
        full[:, :3] = features(np.clip(scale * u, low, high), branch, series)
        return full

    def values(u: FloatArray, branch: FloatArray) -> FloatArray:
        return model.predict(rows(u, branch)[:, :width]) / scale - u

    def truth(u: FloatArray, branch: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the posterior's mean error and its standard deviation, in units of u."""
        torque, std = posterior.predict(rows(u, branch), return_std=True)
        return torque / scale - u, std / scale

    branches = np.unique(feature_column(X, "branch"))
    uncertainty = discrepancy(
        values,
        truth,
        (low / scale, high / scale),
        branch_aware="branch" in model.used_features,
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
        Branches that the calibration recorded (+1, −1). If one is missing, a loop counts as noise.
    """
    count = int(np.ceil((limits[1] - limits[0]) / _SPACING)) * _SAMPLES_PER_NODE
    u = np.linspace(limits[0], limits[1], count + 1)
    nodes = np.arange(0, u.size, _SAMPLES_PER_NODE)
    offsets = np.arange(1 - _SAMPLES_PER_NODE, _SAMPLES_PER_NODE)
    beside = np.clip(nodes[:, None] + offsets, 0, u.size - 1)

    def error(value: float, truth: float) -> tuple[FloatArray, FloatArray]:
        """Return bias and spread near each node where one branch is known and another is true."""
        mean, spread = posterior(u, np.full(u.size, truth))
        bias = values(u, np.full(u.size, value)) - mean
        return bias[beside], spread[beside]

    def std(*cases: tuple[FloatArray, FloatArray]) -> FloatArray:
        """Return the u at each node over equally probable cases of (bias, spread)."""
        bias, spread = (np.concatenate(parts, axis=1) for parts in zip(*cases, strict=True))
        return half_widths(bias, spread) / COVERAGE_95

    if len(branches) < 2:
        only = next(iter(branches), 1.0)
        plain = std(error(only, only))
        return CurveUncertainty(u[nodes], plain, plain, plain)
    if not branch_aware:
        both = std(error(0.0, 1.0), error(0.0, -1.0))
        return CurveUncertainty(u[nodes], both, both, both)
    # The unknown branch may be half a loop to either side; the budget needs the standard deviation
    # of that.
    halves = [bias**2 + spread**2 for bias, spread in (error(0.0, 1.0), error(0.0, -1.0))]
    middle = np.sqrt(np.mean(np.concatenate(halves, axis=1), axis=1))
    return CurveUncertainty(u[nodes], std(error(1.0, 1.0)), std(error(-1.0, -1.0)), middle)
