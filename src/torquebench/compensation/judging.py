"""A model judged against the posterior of the truth: see `curve_uncertainty`."""

from __future__ import annotations

import hashlib
import threading
import warnings
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import replace
from typing import Protocol

import numpy as np

from torquebench.compensation.checks import (
    CalibrationPoints,
    PointsReducedWarning,
    reduce_points,
)
from torquebench.compensation.columns import FloatArray, feature_column, features
from torquebench.compensation.curve_uncertainty import (
    COVERAGE_95,
    CurveUncertainty,
    half_widths,
)

__all__ = ["Posterior", "Values", "forget_posteriors", "judge", "judge_model"]

Values = Callable[[FloatArray, FloatArray], FloatArray]
"""Additional torque from u and branch, all as fractions of full scale."""
Posterior = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""Mean and standard deviation of the true additional torque from u and branch."""

_SPACING = 0.025  # of the nodes, as a share of full scale
_SAMPLES_PER_NODE = 4
_FEWEST_POINTS = 8  # fewer say nothing of what a form can't follow
_MOST_POINTS = 200  # more are averaged: a posterior in some fifty milliseconds
_KEPT_POSTERIORS = 4


def judge(
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
        Branches that the calibration recorded, of +1 and −1: with one of them or none, nothing is
        said of another, and a loop counts as noise.

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
    # Half a loop to either side, next to other contributions in a budget: its standard deviation.
    halves = [bias**2 + spread**2 for bias, spread in (error(0.0, 1.0), error(0.0, -1.0))]
    middle = np.sqrt(np.mean(np.concatenate(halves, axis=1), axis=1))
    return CurveUncertainty(u[nodes], std(error(1.0, 1.0)), std(error(-1.0, -1.0)), middle)


class Judged(Protocol):
    """What is asked of a fitted model, and of the model that gives the posterior."""

    full_scale_nm_: float
    reading_low_nm_: float
    reading_high_nm_: float
    range_margin: float
    used_features: tuple[str, ...]
    noise_nm_: float

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, progress: None) -> None: ...

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]: ...


def judge_model(
    model: Judged,
    make_reference: Callable[..., Judged],
    points: CalibrationPoints,
    weights: FloatArray,
) -> CurveUncertainty | None:
    """Compare a fitted model's curve with the posterior of the truth that its own points give.

    Parameters
    ----------
    model : CompensationModel
        Fitted.
    make_reference : callable
        Class of the model that gives the posterior.
    points : CalibrationPoints
        What the model was fitted to.
    weights : float64 array of shape (n,)
        Their weights.

    Returns
    -------
    uncertainty : CurveUncertainty or None
        None for fewer than eight points.
    """
    if points.y.size < _FEWEST_POINTS:
        return None
    reference = _posterior_model(model, make_reference, points, weights)
    scale, width = model.full_scale_nm_, points.X.shape[1]
    series = float(points.X[0, 2]) if width > 2 else 0.0

    def rows(u: FloatArray, branch: FloatArray) -> FloatArray:
        return features(scale * u, branch, series)

    def values(u: FloatArray, branch: FloatArray) -> FloatArray:
        return model._predict(rows(u, branch)[:, :width], return_std=False)[0] / scale - u

    def posterior(u: FloatArray, branch: FloatArray) -> tuple[FloatArray, FloatArray]:
        torque, std = reference._predict(rows(u, branch), return_std=True)
        return torque / scale - u, np.asarray(std) / scale

    branches = np.unique(np.sign(feature_column(points.X, "branch")))
    found = judge(
        values,
        posterior,
        (model.reading_low_nm_ / scale, model.reading_high_nm_ / scale),
        branch_aware="branch" in model.used_features,
        branches=frozenset(branches[branches != 0.0].tolist()),
    )
    return replace(found, scatter=reference.noise_nm_ / scale)


_posteriors: OrderedDict[bytes, Judged] = OrderedDict()
_lock = threading.Lock()


def forget_posteriors() -> None:
    """Forget the posteriors that are kept for models of the same points."""
    with _lock:
        _posteriors.clear()


def _posterior_model(
    model: Judged,
    make_reference: Callable[..., Judged],
    points: CalibrationPoints,
    weights: FloatArray,
) -> Judged:
    """Fit the reference, or take the one that another model of the same points was judged by."""
    limits = (model.full_scale_nm_, model.reading_low_nm_, model.reading_high_nm_)
    digest = hashlib.sha256(repr((limits, model.range_margin, points.X.shape)).encode())
    for values in (points.X, points.y, weights):
        digest.update(np.ascontiguousarray(values).tobytes())
    key = digest.digest()
    with _lock:
        found = _posteriors.get(key)
    if found is not None:
        return found
    reference = make_reference(range_nm=limits[0], range_margin=model.range_margin)
    reference.full_scale_nm_, reference.reading_low_nm_, reference.reading_high_nm_ = limits
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PointsReducedWarning)
        points, weights = reduce_points(points, weights, _MOST_POINTS, reference.used_features)
    reference._fit(points.X, points.y, weights, None)
    with _lock:
        _posteriors[key] = reference
        while len(_posteriors) > _KEPT_POSTERIORS:
            _posteriors.popitem(last=False)
    return reference
