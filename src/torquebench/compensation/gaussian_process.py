"""Exact Gaussian process over reading and branch, averaged over its hyper-parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.linalg import cho_solve, cholesky

from torquebench.compensation.base import CompensationModel, FloatArray, feature_column
from torquebench.compensation.hybrid.calibration_path import path_clocks
from torquebench.compensation.kernels import (
    PRIOR_MEAN,
    PRIOR_STD,
    KernelPoints,
    covariance,
    gradients,
    variance,
)
from torquebench.compensation.kinds import register
from torquebench.progress import SHARES, Progress

__all__ = ["GaussianProcessModel", "log_posterior"]

_RADIUS = 1.1  # radius of the design's points, in units of √(number of hyper-parameters)
_BOUNDS = [
    (mean - 4 * std, mean + 4 * std) for mean, std in zip(PRIOR_MEAN, PRIOR_STD, strict=True)
]
_LARGEST_STEP = 1.5  # largest step in hyper-parameters, in prior standard deviations
_JITTER = 1e-14


@dataclass(frozen=True)
class _Data:
    points: KernelPoints
    target: FloatArray
    weights: FloatArray


def log_posterior(
    points: KernelPoints, target: FloatArray, weights: FloatArray, theta: FloatArray
) -> tuple[float, FloatArray]:
    """Return the log posterior density of hyper-parameters and its gradient.

    Parameters
    ----------
    points : KernelPoints
        n calibration points.
    target : float64 array of shape (n,)
        Additional torque as a fraction of full scale.
    weights : float64 array of shape (n,)
        A point's noise variance is σ² / weight.
    theta : float64 array of shape (7,)
        Hyper-parameters, `kernels.PARAMETERS`.

    Returns
    -------
    value : float
        Log marginal likelihood (Rasmussen & Williams 2006, eq. 5.8) plus log prior, up to a
        constant.
    gradient : float64 array of shape (7,)
        By eq. 5.9: ½ tr((ααᵀ − K⁻¹) ∂K/∂θ), with α = K⁻¹y.
    """
    matrix, slopes = gradients(points, theta)
    noise2 = np.exp(2 * theta[-1]) / weights
    matrix[np.diag_indices_from(matrix)] += noise2 + _JITTER
    factor = cholesky(matrix, lower=True, check_finite=False)
    solved = cho_solve((factor, True), target, check_finite=False)
    inverse = cho_solve((factor, True), np.eye(target.size), check_finite=False)
    difference = np.outer(solved, solved) - inverse
    gradient = np.empty(theta.size)
    gradient[:-1] = 0.5 * np.tensordot(slopes, difference, axes=2)
    gradient[-1] = np.sum(np.diag(difference) * noise2)
    value = -0.5 * float(target @ solved) - float(np.sum(np.log(np.diag(factor))))
    deviation = (theta - PRIOR_MEAN) / PRIOR_STD
    return value - 0.5 * float(deviation @ deviation), gradient - deviation / PRIOR_STD


@register("gaussian-process")
class GaussianProcessModel(CompensationModel):
    """Exact Gaussian process with a composite kernel, its hyper-parameters averaged.

    The kernel (see `kernels`) has a quadratic trend, a smooth and a rough part, a step at reversal,
    hysteresis, and a drift of the zero as a nuisance. Its seven hyper-parameters are not picked:
    the posterior density is explored from its mode along the principal axes of its curvature, and
    the predictions at these points are averaged.

    Parameters
    ----------
    range_nm, range_margin, outliers
        See `CompensationModel`.

    Attributes
    ----------
    thetas_ : float64 array of shape (k, 7)
        Hyper-parameters of every member of the average.
    shares_ : float64 array of shape (k,)
        Their weights.
    train_u_, train_branch_, train_target_, train_weights_ : float64 array of shape (n,)
        Calibration points, as fractions of full scale.
    train_elapsed_ : float64 array of shape (clocks, n)
        Their time since the zero was taken.
    target_scale_ : float
        Factor on the additional torque, for data that aren't in a chain's usual proportions.

    Notes
    -----
    The design is the axial part of the central composite design of H. Rue, S. Martino and
    N. Chopin (J. R. Stat. Soc. B 71 (2009) 319-392, section 6.5): the mode and, on each of the m
    principal axes, two points at a distance of 1.1 √m standard deviations, weighted so that a
    normal posterior's second moment comes out exactly, and by the true density.

    Examples
    --------
    >>> reading = np.linspace(-100.0, 100.0, 30)
    >>> model = GaussianProcessModel().fit(reading[:, None], reading + 1e-5 * reading**2)
    >>> model.predict([[50.0]]).round(3)
    array([50.025])
    """

    complexity: ClassVar[int] = 45
    maximum_points: int | None = 600
    used_features: ClassVar[tuple[str, ...]] = ("reading_nm", "branch", "series")

    thetas_: FloatArray
    shares_: FloatArray
    train_u_: FloatArray
    train_branch_: FloatArray
    train_elapsed_: FloatArray
    train_target_: FloatArray
    train_weights_: FloatArray
    target_scale_: float

    def _minimum_points(self) -> int:
        return 6

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, progress: Progress) -> None:
        target = (y - X[:, 0]) / self.full_scale_nm_
        self.target_scale_ = max(1.0, float(np.max(np.abs(target))) / 3e-2)
        self.train_u_ = X[:, 0] / self.full_scale_nm_
        self.train_branch_ = feature_column(X, "branch")
        self.train_target_ = target / self.target_scale_
        self.train_weights_ = weights
        self.train_elapsed_ = path_clocks(
            self.train_u_, self.train_branch_, feature_column(X, "series")
        )
        data = _Data(self._train_points(), self.train_target_, weights)
        mode = _find_mode(data)
        progress.reach(SHARES * 7 // 10, "averaging over hyper-parameters")
        self.thetas_, self.shares_ = _design(data, mode)
        self._after_restore()
        noise = self.target_scale_ * float(self.shares_ @ np.exp(self.thetas_[:, -1]))
        self.noise_nm_ = self.full_scale_nm_ * noise
        traces = []
        for theta, (_, factor) in zip(self.thetas_, self._members, strict=True):
            inverse = cho_solve((factor, True), np.eye(target.size))
            noise2 = np.exp(2 * theta[-1]) / weights
            traces.append(target.size - float(np.sum(noise2 * np.diag(inverse))))
        self.effective_parameters_ = float(self.shares_ @ traces)

    def _after_restore(self) -> None:
        points = self._train_points()
        self._members: list[tuple[FloatArray, FloatArray]] = []
        for theta in self.thetas_:
            matrix = covariance(points, points, theta)
            noise2 = np.exp(2 * theta[-1]) / self.train_weights_
            matrix[np.diag_indices_from(matrix)] += noise2 + _JITTER
            factor = cholesky(matrix, lower=True)
            self._members.append((cho_solve((factor, True), self.train_target_), factor))

    def _train_points(self) -> KernelPoints:
        return KernelPoints(self.train_u_, self.train_branch_, self.train_elapsed_)

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        points = KernelPoints(X[:, 0] / self.full_scale_nm_, feature_column(X, "branch"))
        train = self._train_points()
        upward = KernelPoints(points.u, np.where(points.branch == 0.0, 1.0, points.branch))
        mean, second = np.zeros(X.shape[0]), np.zeros(X.shape[0])
        for share, theta, (solved, factor) in zip(
            self.shares_, self.thetas_, self._members, strict=True
        ):
            cross = covariance(points, train, theta)
            value = cross @ solved
            mean += share * value
            if return_std:
                explained = np.sum(cross * cho_solve((factor, True), cross.T).T, axis=1)
                half = covariance(upward, train, theta) @ solved - value
                spread = np.maximum(variance(points, theta) - explained, 0.0)
                second += share * (spread + half**2 + value**2)
        unit = self.full_scale_nm_ * self.target_scale_
        torque = X[:, 0] + unit * mean
        if not return_std:
            return torque, None
        return torque, unit * np.sqrt(np.maximum(second - mean**2, 0.0))


def _find_mode(data: _Data) -> FloatArray:
    """Maximise the posterior from a smooth and a rough start."""
    from scipy.optimize import minimize  # imported late: other models don't need it

    def objective(theta: FloatArray) -> tuple[float, FloatArray]:
        value, gradient = log_posterior(data.points, data.target, data.weights, theta)
        return -value, -gradient

    rough_start = PRIOR_MEAN.copy()
    rough_start[0] -= 2.0
    results = [
        minimize(objective, start, jac=True, method="L-BFGS-B", bounds=_BOUNDS)
        for start in (PRIOR_MEAN, rough_start)
    ]
    best = min(results, key=lambda result: float(result.fun))
    return np.asarray(best.x, dtype=np.float64)


def _design(data: _Data, mode: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points on the principal axes of the posterior around its mode, and their weights."""
    size, step = mode.size, 1e-3
    hessian = np.empty((size, size))
    for k in range(size):
        shift = step * np.eye(size)[k]
        above = log_posterior(data.points, data.target, data.weights, mode + shift)[1]
        below = log_posterior(data.points, data.target, data.weights, mode - shift)[1]
        hessian[k] = (above - below) / (2 * step)
    curvature, axes = np.linalg.eigh(-0.5 * (hessian + hessian.T))
    scales = 1.0 / np.sqrt(np.maximum(curvature, _LARGEST_STEP**-2))
    radius = _RADIUS * np.sqrt(size)
    moves = radius * (axes * scales).T
    thetas = np.vstack([mode, mode + moves, mode - moves])
    density = np.array(
        [log_posterior(data.points, data.target, data.weights, t)[0] for t in thetas]
    )
    # The outer points have equal weights such that E[zᵀz] = m for a standard normal z.
    outer = 1.0 / (2 * size * (_RADIUS**2 - 1.0) * np.exp(-0.5 * radius**2))
    weights = np.exp(density - density[0])
    weights[1:] *= outer
    shares = weights / weights.sum()
    kept = shares > 1e-3
    return thetas[kept], shares[kept] / shares[kept].sum()
