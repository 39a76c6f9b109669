"""Inference of the hybrid: noise, smoothness and structured effects from calibration points.

With everything in fractions of full scale, the additional torque is

    a = main form (equation 15 per direction) + deviation (Gaussian process)
        + structured effects + drift of the zero (Gaussian process over time) + noise.

For one setting of noise, deviation and drift, the main form, whose coefficients have wide normal
priors, the deviation and the drift are marginalised in closed form (C. E. Rasmussen,
C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, eq. 2.39-2.42, explicit basis
functions) by whitening with the Cholesky factor of their covariance plus noise; the effects are
averaged on the whitened data. `search` averages over settings.
"""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.linalg.lapack import dpotri

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.hybrid.averaging import AveragedEffects, average_effects
from torquebench.compensation.hybrid.drift import (
    AMPLITUDES as DRIFT_AMPLITUDES,
)
from torquebench.compensation.hybrid.drift import (
    NO_DRIFT_SHARE,
    drift_kinds,
)
from torquebench.compensation.hybrid.effects import (
    Dictionary,
    Effect,
    EffectPoints,
    count_levels,
    lies_on_step,
    make_dictionary,
    make_effects,
    smallest_torque,
)

__all__ = [
    "GROWTHS",
    "LEAST_NOISE",
    "MANY_CANDIDATES",
    "PLAIN_FORMS",
    "Member",
    "Problem",
    "Setting",
    "deviation_kernel",
    "deviation_variance",
    "main_columns",
]

GROWTHS = (1.0, 2.5, 6.0)
"""Candidate ratios at full scale of the noise proportional to load to the constant noise."""

LEAST_NOISE = 1e-6
"""Smallest standard deviation of a point in the search, as a fraction of full scale."""

_GROWTH_SHARE = 0.3
_MAIN_SCALES = np.array([1e-4, 3e-2, 3e-2, 3e-2, 3e-2])
"""Prior standard deviations of c₀ (small, as the zero is measured), and of mean c₁, c₂ and their
differences between the directions (large).
"""
_ALIKE = 0.05
"""Factor on the differences' scales where the same parts carry the torque in both directions."""
_SMOOTH_LENGTH = 0.4
_ROUGH_LENGTH = 0.1
_ROUGH_SHARE = 0.3
_USUAL_NOISE = 2e-4
_KEPT_CHANCE = 0.99
_PLAIN_ODDS = 0.3
"""Prior odds of a plain form, all together, to a chain with effects."""
_PLAIN_ZERO = 5.0
"""Factor on the scale of c₀ in plain forms, in which nothing else describes an offset."""
PLAIN_FORMS = (
    (_PLAIN_ZERO, 1.0, 0.0, 0.0, 0.0),
    (_PLAIN_ZERO, 1.0, 0.0, 0.0, 1.0),
    (_PLAIN_ZERO, 1.0, 1.0, 0.0, 0.0),
    (_PLAIN_ZERO, 1.0, 1.0, _ALIKE, _ALIKE),
    (_PLAIN_ZERO, 1.0, 1.0, 1.0, 1.0),
)
"""Factors on the main form's scales for chains without effects: linear; with u²; with u|u|; with
nearly equal directions; with independent directions.
"""
MANY_CANDIDATES = ("ripple", "bump", "wave")
"""Kinds of which most candidates are dropped after a first round."""


def main_columns(u: FloatArray) -> FloatArray:
    """Return the scaled columns of equation 15, shape (n, 5).

    In order: the constant; u and u|u|, which both directions share; |u| and u², half the difference
    of the directions.

    Examples
    --------
    >>> (main_columns(np.array([-0.5])) / main_columns(np.array([1.0]))[0, 1]).round(4) + 0.0
    array([[ 0.0033, -0.5   , -0.25  ,  0.5   ,  0.25  ]])
    """
    size = np.abs(u)
    columns = np.column_stack([np.ones_like(u), u, u * size, size, u * u])
    return np.asarray(columns * _MAIN_SCALES)


def deviation_kernel(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the covariance of the deviation from main form and effects, for unit amplitude.

    A smooth part for each direction with standard deviation √|u|, zero without torque, and a
    smaller rough part for deviations that no effect describes.

    Examples
    --------
    >>> deviation_kernel(np.array([0.5]), np.array([0.5, -0.5])).round(3)
    array([[0.59, 0.  ]])
    """
    plus = np.sqrt(np.outer(np.maximum(u, 0.0), np.maximum(v, 0.0)))
    minus = np.sqrt(np.outer(np.minimum(u, 0.0), np.minimum(v, 0.0)))
    square = (u[:, None] - v[None, :]) ** 2
    smooth = (plus + minus) * np.exp(-0.5 * square / _SMOOTH_LENGTH**2)
    return np.asarray(smooth + _ROUGH_SHARE**2 * np.exp(-0.5 * square / _ROUGH_LENGTH**2))


def deviation_variance(u: FloatArray) -> FloatArray:
    """Return the diagonal of `deviation_kernel`."""
    return np.abs(u) + _ROUGH_SHARE**2


@dataclass(frozen=True)
class Setting:
    """Parameters that are averaged outside the effects.

    Attributes
    ----------
    noise : float
        Standard deviation of a point's independent scatter, as a fraction of full scale: where it
        depends on the load, the geometric mean over the points.
    amplitude : float
        Amplitude of the deviation, before the problem's prior scale.
    drift : int
        Kind of drift, -1 for none.
    drift_amplitude : float
        Its amplitude, before the problem's prior scale.
    growth : float
        A point's noise variance is proportional to 1 + growth² u².
    """

    noise: float
    amplitude: float
    drift: int = -1
    drift_amplitude: float = 0.0
    growth: float = 0.0


@dataclass(frozen=True)
class Member:
    """One setting with its posterior.

    Attributes
    ----------
    setting : Setting
    weights : float64 array of shape (n,)
        Weights of the points, with the load's; a point's noise variance is noise² / weight.
    factor : float64 array of shape (n, n)
        Lower Cholesky factor of the covariance of main form, deviation, drift and scatter.
    effects : AveragedEffects
        Posterior of the effects.
    log_evidence : float
        Evidence lower bound, with the prior of the setting.
    solved : float64 array of shape (n,)
        Inverse covariance times the residuals of the effects.
    inverse_diagonal : float64 array of shape (n,)
        Diagonal of the inverse covariance.
    effective : float
        Number of coefficients that the data determine.
    main_scales : float64 array of shape (5,)
        Prior standard deviations of the main form's coefficients, 0 for those that it hasn't.
    """

    setting: Setting
    weights: FloatArray
    factor: FloatArray
    effects: AveragedEffects
    log_evidence: float
    solved: FloatArray
    inverse_diagonal: FloatArray
    effective: float
    main_scales: FloatArray

    @property
    def point_noise(self) -> FloatArray:
        """Noise variance of every point."""
        return np.asarray(self.setting.noise**2 / self.weights)

    @property
    def residual(self) -> FloatArray:
        """Posterior mean of the noise of every point."""
        return np.asarray(self.point_noise * self.solved)


class Problem:
    """Calibration points with everything that doesn't depend on the setting.

    Parameters
    ----------
    points : EffectPoints
        Calibration points.
    target : float64 array of shape (n,)
        Additional torque as a fraction of full scale.
    weights : float64 array of shape (n,)
        Weights of the points.
    prior_scale : float
        Factor on all prior amplitudes.
    correlated : float64 array of shape (n, n), optional
        Covariance of correlated scatter, for independent scatter of 1.

    Attributes
    ----------
    scatter : float64 array of shape (n,)
        Variance of a point, correlated scatter included, for independent scatter of 1.
    """

    def __init__(
        self,
        points: EffectPoints,
        target: FloatArray,
        weights: FloatArray,
        prior_scale: float,
        correlated: FloatArray | None = None,
    ) -> None:
        self.points, self.target, self.weights = points, target, weights
        self._correlated = correlated
        self._log_plain: float | None = None  # log prior of a plain chain; None for the others
        self.scatter = np.ones(target.size) if correlated is None else 1.0 + np.diag(correlated)
        self.prior_scale = prior_scale
        self._take_main(np.full(_MAIN_SCALES.size, prior_scale))
        self._deviation = prior_scale**2 * deviation_kernel(points.u, points.u)
        self.drifts = drift_kinds(points.elapsed)
        dictionary = make_dictionary(
            count_levels(points.u),
            smallest_torque(points.u),
            on_step=lies_on_step(points.u + target),  # the standard's: a zero has a reading, too
        )
        self._look_for(dictionary, make_effects(points, dictionary, prior_scale))

    def _take_main(self, scales: FloatArray) -> None:
        self.main_scales = scales
        self.main = main_columns(self.points.u) * scales
        self._main_gram = self.main @ self.main.T

    def _look_for(self, dictionary: Dictionary, kinds: list[Effect]) -> None:
        self.dictionary, self.kinds = dictionary, kinds
        blocks = [kind.columns.reshape(-1, self.target.size) for kind in kinds]
        self._stacked = np.vstack([self.target[None, :], *blocks]).T

    def alike(self) -> Problem:
        """Return the problem with directions that hardly differ in their main form."""
        problem = copy.copy(self)
        problem._take_main(self.prior_scale * np.array([1.0, 1.0, 1.0, _ALIKE, _ALIKE]))
        return problem

    def plain(self, form: tuple[float, ...]) -> Problem:
        """Return the problem of a chain with some columns of the main form only."""
        problem = copy.copy(self)
        problem._take_main(self.prior_scale * np.array(form))
        problem._log_plain = float(np.log(_PLAIN_ODDS / len(PLAIN_FORMS)))
        return problem

    def with_even_ripple(self) -> Problem:
        """Return the problem with even ripple only: enough to find the noise."""
        even = (self.dictionary.stretches == 0.0) & (self.dictionary.growing == 0.0)
        return self._limited_to({"ripple": np.flatnonzero(even)})

    def narrowed(self, members: list[Member]) -> Problem:
        """Return the problem without ripples, bumps and waves to which no member gives a chance."""
        kept, start = {}, 0
        for kind in self.kinds:
            effects = range(start, start + kind.copies)
            start += kind.copies
            if kind.name in MANY_CANDIDATES:
                chances = [m.effects.weights[k].sum(axis=0) for m in members for k in effects]
                kept[kind.name] = _likely(np.array(chances))
        return self._limited_to(kept)

    def _limited_to(self, kept: dict[str, NDArray[np.intp]]) -> Problem:
        kinds = [
            kind.limited_to(kept[kind.name]) if kind.name in kept else kind for kind in self.kinds
        ]
        problem = copy.copy(self)
        problem._look_for(self.dictionary.limited_to(kept), kinds)
        return problem

    def load_weights(self, growth: float) -> FloatArray:
        """Return weights for noise that grows with the load; their geometric mean is one."""
        variance = 1.0 + (growth * self.points.u) ** 2
        return np.asarray(np.exp(np.mean(np.log(variance))) / variance)

    def settings_of_drift(self) -> list[tuple[int, float]]:
        """Return every kind and amplitude of drift, none first."""
        kinds = range(len(self.drifts))
        return [(-1, 0.0)] + [(kind, size) for kind in kinds for size in DRIFT_AMPLITUDES]

    def _log_prior(self, setting: Setting) -> float:
        noise = np.log(setting.noise / (self.prior_scale * _USUAL_NOISE))
        growth = _GROWTH_SHARE / len(GROWTHS) if setting.growth > 0.0 else 1.0 - _GROWTH_SHARE
        drift = 1.0
        if self.drifts and self._log_plain is None:
            drift = NO_DRIFT_SHARE
            if setting.drift >= 0:
                drift = self.drifts[setting.drift].share / len(DRIFT_AMPLITUDES)
        return float(-0.5 * noise**2 + np.log(growth * drift) + (self._log_plain or 0.0))

    def solve(self, setting: Setting, weights: FloatArray | None = None) -> Member:
        """Whiten by main form, deviation, drift and noise, then average over the effects.

        Parameters
        ----------
        setting : Setting
        weights : float64 array of shape (n,), optional
            Replace the points' own weights, without the load's.

        Returns
        -------
        member : Member
        """
        weights = (self.weights if weights is None else weights) * self.load_weights(setting.growth)
        noise2 = setting.noise**2 / weights
        covariance = self._main_gram + setting.amplitude**2 * self._deviation
        if setting.drift >= 0:
            scale = self.prior_scale * setting.drift_amplitude
            covariance += scale**2 * self.drifts[setting.drift].covariance
        if self._correlated is not None:
            load = 1.0 / np.sqrt(self.load_weights(setting.growth))
            covariance += setting.noise**2 * np.outer(load, load) * self._correlated
        covariance[np.diag_indices_from(covariance)] += noise2
        factor = cholesky(covariance, lower=True, check_finite=False)
        effects, left = self._average(factor)
        log_evidence = effects.log_evidence - float(np.sum(np.log(np.diag(factor))))
        solved = solve_triangular(factor, left, lower=True, trans=1, check_finite=False)
        inverse_diagonal = np.diag(dpotri(factor, lower=1)[0]).copy()
        determined = [np.sum(w * t) for w, t in zip(effects.weights, effects.traces, strict=True)]
        effective = weights.size - np.sum(noise2 * inverse_diagonal) + np.sum(determined)
        return Member(
            setting,
            weights,
            factor,
            effects,
            log_evidence + self._log_prior(setting),
            solved,
            inverse_diagonal,
            float(effective),
            self.main_scales,
        )

    def _average(self, factor: FloatArray) -> tuple[AveragedEffects, FloatArray]:
        """Return the effects' posterior on whitened data, and the residuals."""
        if self._log_plain is not None:
            left = solve_triangular(factor, self.target, lower=True, check_finite=False)
            return self._without_effects(float(-0.5 * left @ left)), left
        white = solve_triangular(factor, self._stacked, lower=True, check_finite=False)
        white = np.ascontiguousarray(white.T)
        candidates, start = [], 1
        for kind in self.kinds:
            count, width, size = kind.columns.shape
            block = white[start : start + count * width]
            candidates.append(kind.whitened(block.reshape(count, width, size)))
            start += count * width
        effects = average_effects(white[0], candidates)
        return effects, np.asarray(white[0] - effects.fit)

    def _without_effects(self, log_evidence: float) -> AveragedEffects:
        """Return the posterior of effects that are certainly absent."""
        kinds = [kind for kind in self.kinds for _ in range(kind.copies)]
        shapes = [kind.columns.shape[:2] for kind in kinds]
        nothing = [np.zeros((kind.scales.size, len(kind.columns))) for kind in kinds]
        return AveragedEffects(
            weights=nothing,
            means=[np.zeros(shape) for shape in shapes],
            moments=[np.zeros((count, width, width)) for count, width in shapes],
            traces=nothing,
            present=np.zeros(len(kinds)),
            fit=np.zeros(self.target.size),
            spread=0.0,
            log_evidence=log_evidence,
        )

    def settle_noise(self, member: Member, rounds: int = 6) -> Member:
        """Follow MacKay's fixed point, noise² = residual power / free points, and solve again."""
        weights = member.weights / self.load_weights(member.setting.growth)
        for _ in range(rounds):
            power = float(np.sum(member.weights * member.residual**2))
            freedom = max(self.target.size - member.effective, 0.1 * self.target.size)
            noise = max(float(np.sqrt(power / freedom)), LEAST_NOISE * self.prior_scale)
            done = abs(np.log(noise / member.setting.noise)) < 0.1
            member = self.solve(replace(member.setting, noise=noise), weights)
            if done:
                break
        return member


def _likely(chances: FloatArray) -> NDArray[np.intp]:
    """Return the columns with nearly all of the weight of any row."""
    kept = np.zeros(chances.shape[1], dtype=bool)
    for row in chances:
        order = np.argsort(-row)
        enough = int(np.searchsorted(np.cumsum(row[order]), _KEPT_CHANCE * row.sum())) + 1
        kept[order[:enough]] = True
    return np.flatnonzero(kept)
