"""The chain's physical form: shafts, bearings and transducers as one linear basis.

Everything is written in fractions of full scale: u = reading / FS, x = |u|, s = sign(u), and the
branch b (+1 where |torque| grows, −1 where it falls, 0 unknown). The columns are

=====================  ==============================================================
c₀                     constant of equation 15 and the zero's error
c₁ x s, c₂ x² s        equation 15, T′ = c₀ + c₁T + c₂T|T|, one pair per direction
tanh(u / w)            bearing Coulomb friction, which turns round with the torque
b s 4x(1 − x)          hysteresis of a loop that returns to zero (Rayleigh's law)
b s (1 − x)            hysteresis that leaves a remanence at zero
=====================  ==============================================================

Both hysteresis columns vanish at full scale, where a major loop turns. Rayleigh's law makes the
half-width of a loop a parabola between its turning points (S. Chikazumi, Physics of Ferromagnetism,
section 18.3; the same holds for elastic hysteresis at small strain), and the two columns span the
parabolas for loops that turn at zero and at −FS.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from torquebench.compensation.base import CompensationModel, FloatArray, feature_column
from torquebench.compensation.hybrid.calibration_path import path_clocks
from torquebench.compensation.kinds import register
from torquebench.progress import Progress

__all__ = ["PRIOR_SCALES", "ChainPoints", "PhysicsModel", "chain_points", "physics_basis"]

PRIOR_SCALES = np.array([1.5e-4, 3e-2, 3e-2, 3e-2, 3e-2, 5e-4, 3e-4, 3e-4])
"""Prior standard deviations of the columns' coefficients, as fractions of full scale. They are
orders of magnitude: a zero within some 0.03 % FS, gain and curvature of several per cent (so free),
a reversal step and a loop of some hundredths of a per cent.

Generic orders of size, not those of any chain: a zero within some 0.03 % FS, gain and curvature
of per cents (so free), a reversal step and a loop of some hundredths of a per cent.
"""

_STEP_WIDTHS = np.tile([0.003, 0.008, 0.016, 0.03], 2)
_LOOP_FACTORS = np.repeat([1.0, 10.0], 4)
"""Every width of the step, with usual and with wide priors of step and hysteresis."""
_REVERSING = slice(5, 8)
_HYSTERESIS = slice(6, 8)
_DRIFT_SCALE = 1.4e-4


@dataclass(frozen=True)
class ChainPoints:
    """Readings in the chain's own coordinates.

    Attributes
    ----------
    u : float64 array of shape (n,)
        Reading / full scale.
    branch : float64 array of shape (n,)
        +1 up, −1 down, 0 unknown.
    """

    u: FloatArray
    branch: FloatArray


def chain_points(X: FloatArray, full_scale_nm: float) -> ChainPoints:
    """Turn a feature matrix into fractions of full scale.

    Examples
    --------
    >>> chain_points(np.array([[500.0, 1.0]]), 2000.0).u
    array([0.25])
    """
    return ChainPoints(X[:, 0] / full_scale_nm, feature_column(X, "branch"))


def physics_basis(points: ChainPoints, step_width: float) -> FloatArray:
    """Return the columns of the physical form, unscaled.

    Parameters
    ----------
    points : ChainPoints
        Where to evaluate.
    step_width : float
        Width of the reversal step as a fraction of full scale.

    Returns
    -------
    basis : float64 array of shape (n, 8)

    Examples
    --------
    >>> physics_basis(ChainPoints(np.array([0.5]), np.array([1.0])), 0.01).round(3)
    array([[1.  , 0.5 , 0.25, 0.  , 0.  , 1.  , 1.  , 0.5 ]])
    """
    u, x, side = points.u, np.abs(points.u), np.sign(points.u)
    positive, negative = u > 0, u < 0
    rest = np.clip(1.0 - x, 0.0, None)
    return np.column_stack(
        [
            np.ones_like(u),
            np.where(positive, u, 0.0),
            np.where(positive, u * x, 0.0),
            np.where(negative, u, 0.0),
            np.where(negative, u * x, 0.0),
            np.tanh(u / step_width),
            points.branch * side * 4 * x * rest,
            points.branch * side * rest,
        ]
    )


@register("physics")
class PhysicsModel(CompensationModel):
    """Physical form of the additional torque, as a Bayesian linear model.

    Equation 15 in consistent form per direction, a reversal step and hysteresis; see the module's
    table. A drift of the zero during the calibration is estimated and excluded. The coefficients
    have wide normal priors and are integrated out; the noise comes from the marginal likelihood by
    fixed-point iteration (MacKay, Neural Computation 4 (1992) 415, eq. 4.10) and the step's width
    is averaged over a grid, weighted by the same likelihood. The form's error is part of the
    uncertainty (`discrepancy`).

    Parameters
    ----------
    range_nm, range_margin, outliers
        See `CompensationModel`.

    Attributes
    ----------
    step_widths_ : float64 array of shape (k,)
        Step widths that are averaged over, each with usual and with wide priors of step and loop.
    coefficients_ : float64 array of shape (k, 8)
        Posterior means, as fractions of full scale, for each of them.
    covariances_ : float64 array of shape (k, 8, 8)
        Posterior covariances.
    evidence_ : float64 array of shape (k,)
        Their weights.

    Examples
    --------
    >>> reading = np.linspace(-100.0, 100.0, 24)
    >>> model = PhysicsModel().fit(reading[:, None], reading + 1e-5 * reading * np.abs(reading))
    >>> model.predict([[50.0]]).round(3)
    array([50.025])
    """

    complexity: ClassVar[int] = 20
    maximum_points: int | None = 600
    used_features: ClassVar[tuple[str, ...]] = ("reading_nm", "branch", "series")

    step_widths_: FloatArray
    coefficients_: FloatArray
    covariances_: FloatArray
    evidence_: FloatArray

    def _minimum_points(self) -> int:
        return 8

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, _progress: Progress) -> None:
        points = chain_points(X, self.full_scale_nm_)
        target = (y - X[:, 0]) / self.full_scale_nm_
        drift = -path_clocks(points.u, points.branch, feature_column(X, "series")).T
        fits = [
            _fit_linear(np.hstack([physics_basis(points, width), drift]), target, weights, factor)
            for width, factor in zip(_STEP_WIDTHS, _LOOP_FACTORS, strict=True)
        ]
        self.step_widths_ = _STEP_WIDTHS.copy()
        log_evidence = np.array([fit.log_evidence for fit in fits])
        share = np.exp(log_evidence - log_evidence.max())
        self.evidence_ = share / share.sum()
        self.coefficients_ = np.array([fit.mean for fit in fits])
        self.covariances_ = np.array([fit.covariance for fit in fits])
        self.noise_nm_ = self.full_scale_nm_ * float(self.evidence_ @ [fit.noise for fit in fits])
        self.effective_parameters_ = float(self.evidence_ @ [fit.effective for fit in fits])

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        points = chain_points(X, self.full_scale_nm_)
        known = np.where(points.branch == 0.0, 1.0, 0.0)
        # At zero the loop's limit from above, as in tables.
        beside = np.where(points.u == 0.0, np.finfo(np.float64).tiny, points.u)
        mean, second = np.zeros(X.shape[0]), np.zeros(X.shape[0])
        for share, width, coefficients, covariance in zip(
            self.evidence_, self.step_widths_, self.coefficients_, self.covariances_, strict=True
        ):
            basis = physics_basis(points, width)
            value = basis @ coefficients
            mean += share * value
            if return_std:
                variance = np.einsum("ij,jk,ik->i", basis, covariance, basis)
                up = physics_basis(ChainPoints(beside, known), width)[:, _HYSTERESIS]
                half = up @ coefficients[_HYSTERESIS]
                second += share * (variance + value**2 + half**2)
        torque = X[:, 0] + self.full_scale_nm_ * mean
        if not return_std:
            return torque, None
        return torque, self.full_scale_nm_ * np.sqrt(np.maximum(second - mean**2, 0.0))


@dataclass(frozen=True)
class _LinearFit:
    mean: FloatArray
    covariance: FloatArray
    noise: float
    effective: float
    log_evidence: float


def _fit_linear(
    basis: FloatArray, target: FloatArray, weights: FloatArray, loop_factor: float
) -> _LinearFit:
    """Bayesian linear regression with known priors and noise by MacKay's fixed point."""
    root = np.sqrt(weights)
    scaled, y = basis * root[:, None], target * root
    start = np.linalg.lstsq(scaled, y, rcond=None)[0]
    floor = 1e-9
    noise2 = float(np.mean((y - scaled @ start) ** 2)) + floor**2
    # Data unlike any chain's (another unit, a swapped column) get priors of their own size.
    scales = np.append(PRIOR_SCALES, np.full(basis.shape[1] - PRIOR_SCALES.size, _DRIFT_SCALE))
    scales[_REVERSING] *= loop_factor
    scales = scales * max(1.0, np.sqrt(noise2) / 1e-3, float(np.max(np.abs(target))) / 3e-2)
    gram, moment, power = scaled.T @ scaled, scaled.T @ y, float(y @ y)
    residual, effective = noise2 * y.size, 0.0
    for _ in range(30):
        factor = cho_factor(gram / noise2 + np.diag(scales**-2.0))
        mean = cho_solve(factor, moment / noise2)
        covariance = cho_solve(factor, np.eye(mean.size))
        effective = mean.size - float(np.sum(np.diag(covariance) / scales**2))
        residual = max(power - 2 * float(mean @ moment) + float(mean @ gram @ mean), 0.0)
        update = residual / max(y.size - effective, 1.0) + floor**2
        if abs(update / noise2 - 1.0) < 1e-6:
            break
        noise2 = update
    log_evidence = (
        -0.5 * residual / noise2
        - 0.5 * float(np.sum((mean / scales) ** 2))
        - 0.5 * y.size * np.log(noise2)
        - float(np.sum(np.log(np.diag(factor[0]))))
        - float(np.sum(np.log(scales)))
    )
    curve = slice(PRIOR_SCALES.size)  # drift isn't part of the curve
    return _LinearFit(
        mean[curve], covariance[curve, curve], float(np.sqrt(noise2)), effective, log_evidence
    )
