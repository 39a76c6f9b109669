"""The recommended model: the chain's physical form plus a Gaussian process on what it leaves."""

from __future__ import annotations

from itertools import product
from typing import Any, ClassVar

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from torquebench.compensation.base import CompensationModel, FloatArray, Progress, register
from torquebench.compensation.physics import (
    PRIOR_SCALES,
    ChainPoints,
    chain_points,
    physics_basis,
)

__all__ = ["HybridModel"]

_STEP_WIDTHS = (0.004, 0.012, 0.03)
_LENGTHS = (0.04, 0.09, 0.2, 0.5)
_AMPLITUDES = (2e-5, 8e-5, 2e-4, 5e-4)
_KEPT_SHARE = 1e-3


@register("hybrid")
class HybridModel(CompensationModel):
    """Physics plus Gaussian process on the residual, averaged over its hyper-parameters.

    Parameters
    ----------
    range_nm, range_margin, outliers
        See `CompensationModel`.

    Attributes
    ----------
    settings_ : float64 array of shape (k, 5)
        Step width, length, amplitude, noise (fractions of full scale) and share of every member
        of the mixture.
    """

    complexity: ClassVar[int] = 40
    maximum_points: ClassVar[int | None] = 600
    used_features: ClassVar[tuple[str, ...]] = ("reading_nm", "branch")

    settings_: FloatArray
    train_points_: FloatArray
    train_target_: FloatArray
    train_weights_: FloatArray

    def __init__(
        self,
        range_nm: float | None = None,
        range_margin: float = 0.02,
        outliers: str = "downweight",
    ) -> None:
        self.range_nm = range_nm
        self.range_margin = range_margin
        self.outliers = outliers

    def _minimum_points(self) -> int:
        return 8

    def _minimum_distinct(self) -> int:
        return 3

    def _fit(
        self,
        X: FloatArray,
        y: FloatArray,
        weights: FloatArray,
        progress: Progress | None,  # noqa: ARG002 - over at once
    ) -> None:
        points = chain_points(X, self.full_scale_nm_)
        self.train_points_ = np.column_stack([points.u, points.branch])
        self.train_target_ = (y - X[:, 0]) / self.full_scale_nm_
        self.train_weights_ = weights
        largest = float(np.max(np.abs(self.train_target_)))
        self.prior_scale_ = max(1.0, largest / 3e-2)
        rows = []
        for width, length, amplitude in product(_STEP_WIDTHS, _LENGTHS, _AMPLITUDES):
            noise, log_evidence = self._noise_by_evidence(width, length, amplitude)
            rows.append([width, length, amplitude, noise, log_evidence])
        settings = np.array(rows)
        share = np.exp(settings[:, 4] - settings[:, 4].max())
        settings[:, 4] = share / share.sum()
        settings = settings[settings[:, 4] > _KEPT_SHARE]
        settings[:, 4] /= settings[:, 4].sum()
        self.settings_ = settings
        self.noise_nm_ = self.full_scale_nm_ * float(settings[:, 4] @ settings[:, 3])
        self._after_restore()

    def _after_restore(self) -> None:
        points = ChainPoints(self.train_points_[:, 0], self.train_points_[:, 1])
        self._members: list[tuple[FloatArray, Any]] = []
        effective = 0.0
        for width, length, amplitude, noise, share in self.settings_:
            prior = self._kernel(points, points, width, length, amplitude)
            factor = cho_factor(prior + np.diag(noise**2 / self.train_weights_))
            self._members.append((cho_solve(factor, self.train_target_), factor))
            effective += share * float(np.trace(cho_solve(factor, prior)))
        self.effective_parameters_ = effective

    def _kernel(
        self, a: ChainPoints, b: ChainPoints, width: float, length: float, amplitude: float
    ) -> FloatArray:
        scales = self.prior_scale_ * PRIOR_SCALES
        left, right = physics_basis(a, width) * scales, physics_basis(b, width) * scales
        distance = (a.u[:, None] - b.u[None, :]) / length
        smooth = (self.prior_scale_ * amplitude) ** 2 * np.exp(-0.5 * distance**2)
        return np.asarray(left @ right.T + smooth)

    def _noise_by_evidence(
        self, width: float, length: float, amplitude: float
    ) -> tuple[float, float]:
        """Noise of highest evidence by its eigenvalues, and the log evidence there."""
        points = ChainPoints(self.train_points_[:, 0], self.train_points_[:, 1])
        root = np.sqrt(self.train_weights_)
        prior = self._kernel(points, points, width, length, amplitude) * np.outer(root, root)
        values, vectors = np.linalg.eigh(prior)
        power = (vectors.T @ (root * self.train_target_)) ** 2
        noises = self.prior_scale_ * np.geomspace(2e-5, 2e-3, 41)
        total = np.maximum(values, 0.0)[None, :] + noises[:, None] ** 2
        log_evidence = -0.5 * np.sum(power / total + np.log(total), axis=1)
        best = int(np.argmax(log_evidence))
        return float(noises[best]), float(log_evidence[best])

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        points = chain_points(X, self.full_scale_nm_)
        train = ChainPoints(self.train_points_[:, 0], self.train_points_[:, 1])
        up = ChainPoints(points.u, np.where(points.branch == 0.0, 1.0, points.branch))
        mean, second = np.zeros(X.shape[0]), np.zeros(X.shape[0])
        for setting, (solved, factor) in zip(self.settings_, self._members, strict=True):
            width, length, amplitude, _, share = setting
            cross = self._kernel(points, train, width, length, amplitude)
            value = cross @ solved
            mean += share * value
            if not return_std:
                continue
            scales = self.prior_scale_ * PRIOR_SCALES
            prior = np.sum((physics_basis(points, width) * scales) ** 2, axis=1)
            prior += (self.prior_scale_ * amplitude) ** 2
            variance = prior - np.sum(cross * cho_solve(factor, cross.T).T, axis=1)
            half = self._kernel(up, train, width, length, amplitude) @ solved - value
            second += share * (np.maximum(variance, 0.0) + value**2 + half**2)
        torque = X[:, 0] + self.full_scale_nm_ * mean
        if not return_std:
            return torque, None
        return torque, self.full_scale_nm_ * np.sqrt(np.maximum(second - mean**2, 0.0))
