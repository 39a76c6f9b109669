"""Inference of the hybrid: noise, smoothness and structured effects from calibration points.

With everything in fractions of full scale, the additional torque is

    a = main form (equation 15 per direction) + deviation (Gaussian process)
        + structured effects + noise.

For one setting of noise and deviation, the main form, whose coefficients have wide normal priors,
and the deviation are marginalised in closed form (C. E. Rasmussen, C. K. I. Williams,
Gaussian Processes for Machine Learning, 2006, eq. 2.39-2.42, explicit basis functions) by whitening
with the Cholesky factor of their covariance plus noise; the effects are averaged on the whitened
data. Settings on a grid round the noise of best evidence are then averaged by their evidence.

Noise with heavy tails is a scale mixture: Student's distribution with `_FREEDOM` degrees of freedom
is normal noise with a gamma-distributed weight per point, whose posterior mean follows in closed
form (C. M. Bishop, Pattern Recognition and Machine Learning, 2006, section 2.3.7 and 10.1). Where
the residuals look like it, both kinds of noise are averaged by their evidence.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import lgamma

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dpotri

from torquebench.compensation.averaging import AveragedEffects, average_effects
from torquebench.compensation.columns import FloatArray
from torquebench.compensation.hybrid_effects import (
    Dictionary,
    Effect,
    EffectPoints,
    all_columns,
    at_zero_time,
    count_levels,
    make_dictionary,
    make_effects,
    smallest_torque,
)

__all__ = [
    "Member",
    "Problem",
    "Setting",
    "curve_variance",
    "deviation_kernel",
    "explore",
    "main_columns",
]

_MAIN_SCALES = np.array([1e-4, 3e-2, 3e-2, 3e-2, 3e-2])
"""Prior standard deviations of c₀ (the zero was taken), and of c₁, c₂ per direction (free)."""
_SMOOTH_LENGTH = 0.4
_ROUGH_LENGTH = 0.1
_ROUGH_SHARE = 0.3
_AMPLITUDES = (3e-5, 1.5e-4, 7e-4)
_LARGEST_AMPLITUDE = 4e-2
_USUAL_NOISE = 2e-4
_LEAST_NOISE = 1e-6
_NEGLIGIBLE_SHARE = 2e-3
_FREEDOM = 4.0
_TAILED_KURTOSIS = 3.3
_TAILS_ODDS = 4.0  # prior odds where residuals look like it: few real readings scatter normally
_TAILS_ROUNDS = 12


def main_columns(u: FloatArray) -> FloatArray:
    """Return the scaled columns of equation 15: c₀ and c₁x, c₂x² per direction, shape (n, 5).

    Examples
    --------
    >>> (main_columns(np.array([-0.5])) / main_columns(np.array([1.0]))[0, 1]).round(4) + 0.0
    array([[ 0.0033,  0.    ,  0.    , -0.5   ,  0.25  ]])
    """
    plus, minus = np.maximum(u, 0.0), np.minimum(u, 0.0)
    columns = np.column_stack([np.ones_like(u), plus, plus**2, minus, minus**2])
    return np.asarray(columns * _MAIN_SCALES)


def deviation_kernel(u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the covariance of the deviation from main form and effects, for unit amplitude.

    A smooth part, one per direction, whose standard deviation is √|u|: without torque there is
    nothing to deviate; and a smaller rough part for what no effect describes.

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
    """What is averaged over outside the effects.

    Attributes
    ----------
    noise : float
        Standard deviation of a point, as a fraction of full scale.
    amplitude : float
        Amplitude of the deviation, before the problem's prior scale.
    """

    noise: float
    amplitude: float


@dataclass(frozen=True)
class Member:
    """One setting with its posterior.

    Attributes
    ----------
    setting : Setting
    weights : float64 array of shape (n,)
        Weights of the points; a point's noise variance is noise² / weight.
    factor : float64 array of shape (n, n)
        Lower Cholesky factor of the covariance of main form, deviation and noise.
    effects : AveragedEffects
        Posterior of the effects.
    log_evidence : float
        Evidence lower bound, with the prior of the setting.
    solved : float64 array of shape (n,)
        Inverse covariance times what the effects leave.
    inverse_diagonal : float64 array of shape (n,)
        Diagonal of the inverse covariance.
    effective : float
        Number of coefficients that the data determine.
    """

    setting: Setting
    weights: FloatArray
    factor: FloatArray
    effects: AveragedEffects
    log_evidence: float
    solved: FloatArray
    inverse_diagonal: FloatArray
    effective: float

    @property
    def point_noise(self) -> FloatArray:
        """Noise variance of every point."""
        return np.asarray(self.setting.noise**2 / self.weights)

    @property
    def residual(self) -> FloatArray:
        """Posterior mean of the noise of every point."""
        return np.asarray(self.point_noise * self.solved)


class Problem:
    """Calibration points with everything that doesn't depend on noise and deviation.

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
    """

    def __init__(
        self, points: EffectPoints, target: FloatArray, weights: FloatArray, prior_scale: float
    ) -> None:
        self.points, self.target, self.weights = points, target, weights
        self.prior_scale = prior_scale
        self.dictionary: Dictionary = make_dictionary(
            count_levels(points.u), smallest_torque(points.u)
        )
        self.kinds: list[Effect] = make_effects(points, self.dictionary, prior_scale)
        self.main = prior_scale * main_columns(points.u)
        self._main_gram = self.main @ self.main.T
        self._deviation = prior_scale**2 * deviation_kernel(points.u, points.u)
        blocks = [kind.columns.reshape(-1, target.size) for kind in self.kinds]
        self._stacked = np.vstack([target[None, :], *blocks]).T

    def copies(self) -> list[Effect]:
        """Return the kind of every single effect."""
        return [kind for kind in self.kinds for _ in range(kind.copies)]

    def solve(self, setting: Setting, weights: FloatArray | None = None) -> Member:
        """Whiten by main form, deviation and noise, then average over the effects."""
        weights = self.weights if weights is None else weights
        noise2 = setting.noise**2 / weights
        covariance = self._main_gram + setting.amplitude**2 * self._deviation
        covariance[np.diag_indices_from(covariance)] += noise2
        factor = cholesky(covariance, lower=True, check_finite=False)
        white = solve_triangular(factor, self._stacked, lower=True, check_finite=False)
        white = np.ascontiguousarray(white.T)
        candidates, start = [], 1
        for kind in self.kinds:
            count, width, size = kind.columns.shape
            block = white[start : start + count * width]
            candidates.append(kind.whitened(block.reshape(count, width, size)))
            start += count * width
        effects = average_effects(white[0], candidates)
        prior = -0.5 * np.log(setting.noise / (self.prior_scale * _USUAL_NOISE)) ** 2
        log_evidence = effects.log_evidence - float(np.sum(np.log(np.diag(factor)))) + prior
        left = white[0] - effects.fit
        solved = solve_triangular(factor, left, lower=True, trans=1, check_finite=False)
        inverse_diagonal = np.diag(dpotri(factor, lower=1)[0]).copy()
        determined = [np.sum(w * t) for w, t in zip(effects.weights, effects.traces, strict=True)]
        effective = weights.size - np.sum(noise2 * inverse_diagonal) + np.sum(determined)
        return Member(
            setting,
            weights,
            factor,
            effects,
            float(log_evidence),
            solved,
            inverse_diagonal,
            float(effective),
        )

    def settle_noise(self, member: Member, rounds: int = 6) -> Member:
        """Follow MacKay's fixed point, noise² = residual power / free points, and solve again."""
        for _ in range(rounds):
            power = float(np.sum(member.weights * member.residual**2))
            freedom = max(self.target.size - member.effective, 0.1 * self.target.size)
            noise = max(float(np.sqrt(power / freedom)), _LEAST_NOISE * self.prior_scale)
            done = abs(np.log(noise / member.setting.noise)) < 0.1
            member = self.solve(replace(member.setting, noise=noise), member.weights)
            if done:
                break
        return member


def explore(problem: Problem, start_noise: float) -> list[Member]:
    """Find the noise of best evidence, then lay a grid of noise and deviation round it.

    Parameters
    ----------
    problem : Problem
    start_noise : float
        Where to start looking, as a fraction of full scale.

    Returns
    -------
    members : list of Member
        To be averaged by their evidence.
    """
    best = problem.settle_noise(problem.solve(Setting(start_noise, _AMPLITUDES[1])))
    members = _grid(problem, best)
    if _looks_heavy_tailed(best):
        tailed = _grid(problem, _with_tails(problem, best))
        odds = np.log(_TAILS_ODDS)
        members += [
            replace(member, log_evidence=_student_bound(problem, member) + odds)
            for member in tailed
        ]
    return members


def _grid(problem: Problem, best: Member) -> list[Member]:
    """Solve for noises round the best one and for all amplitudes of the deviation."""
    freedom = max(problem.target.size - best.effective, 4.0)
    step = 1.5 / np.sqrt(2 * freedom)
    noises = [best.setting.noise * float(np.exp(k * step)) for k in (-1, 0, 1)]

    def row(amplitude: float) -> list[Member]:
        return [problem.solve(Setting(noise, amplitude), best.weights) for noise in noises]

    members = [member for amplitude in _AMPLITUDES for member in row(amplitude)]
    largest = _AMPLITUDES[-1]
    while _best(members).setting.amplitude == largest < _LARGEST_AMPLITUDE:
        largest *= 4.0
        members += row(largest)
    return members


def _best(members: list[Member]) -> Member:
    return max(members, key=lambda member: member.log_evidence)


def _expected_squares(member: Member) -> FloatArray:
    """Return the posterior mean of every point's squared noise."""
    noise2 = member.point_noise
    return np.asarray(member.residual**2 + noise2 - noise2**2 * member.inverse_diagonal)


def _looks_heavy_tailed(member: Member) -> bool:
    scaled = member.residual / np.sqrt(member.point_noise)
    power = np.mean(scaled**2)
    return bool(np.mean(scaled**4) > _TAILED_KURTOSIS * power**2)


def _with_tails(problem: Problem, normal: Member) -> Member:
    """Follow the variational steps of Student noise from the normal member."""
    member, bound = normal, -np.inf
    for _ in range(_TAILS_ROUNDS):
        scale2 = member.setting.noise**2
        squares = _expected_squares(member)
        tails = (_FREEDOM + 1.0) / (_FREEDOM + squares / scale2)
        noise = max(float(np.sqrt(np.mean(tails * squares))), _LEAST_NOISE * problem.prior_scale)
        member = problem.solve(replace(member.setting, noise=noise), problem.weights * tails)
        before, bound = bound, _student_bound(problem, member)
        if bound - before < 0.1:
            break
    return member


def _student_bound(problem: Problem, member: Member) -> float:
    """Replace the normal likelihood in the evidence bound by Student's (Bishop, eq. 10.3)."""
    scale2 = member.setting.noise**2 / problem.weights
    squares = _expected_squares(member)
    normal = -0.5 * np.sum(np.log(member.point_noise) + squares / member.point_noise)
    shape = 0.5 * (_FREEDOM + 1.0)
    constant = 0.5 * _FREEDOM * np.log(0.5 * _FREEDOM) - lgamma(0.5 * _FREEDOM) + lgamma(shape)
    student = constant - 0.5 * np.log(scale2) - shape * np.log(0.5 * (_FREEDOM + squares / scale2))
    return float(member.log_evidence - normal + np.sum(student))


def curve_variance(
    problem: Problem,
    members: list[Member],
    shares: FloatArray,
    u: FloatArray,
    branch: float = 1.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the posterior variance of the curve, averaged over members.

    Parameters
    ----------
    problem : Problem
    members : list of Member
    shares : float64 array
        Weight of every member.
    u : float64 array of shape (m,)
        Where, as fractions of full scale.
    branch : float, default 1
        Size of the branch: 0 for the curve in the middle of the loop.

    Returns
    -------
    up, down : float64 array of shape (m,)
        Variance on the two branches, as a fraction of full scale squared.
    """
    points = at_zero_time(u, np.full(u.size, branch), len(problem.points.elapsed))
    columns = all_columns(points, problem.dictionary)
    main, same = problem.prior_scale * main_columns(u), deviation_kernel(u, problem.points.u)
    first, second = np.zeros((2, u.size)), np.zeros((2, u.size))
    for share, member in zip(shares, members, strict=True):
        amplitude2 = (problem.prior_scale * member.setting.amplitude) ** 2
        cross = main @ problem.main.T + amplitude2 * same
        gain = cho_solve((member.factor, True), cross.T, check_finite=False)
        common = (
            np.sum(main**2, axis=1)
            + amplitude2 * deviation_variance(u)
            - np.sum(gain.T * cross, axis=1)
        )
        value, variance = np.tile(cross @ member.solved, (2, 1)), np.tile(common, (2, 1))
        start = 0
        for kind, new in zip(problem.kinds, columns, strict=False):
            means = member.effects.means[start : start + kind.copies]
            moments = member.effects.moments[start : start + kind.copies]
            start += kind.copies
            both: tuple[FloatArray, ...] = (new, -new) if kind.name == "loop" else (new,)
            changes = [_effect_moments(side, kind.columns, gain, means, moments) for side in both]
            value += np.array([change[0] for change in changes])
            variance += np.array([change[1] for change in changes])
        first += share * value
        second += share * (variance + value**2)
    up, down = np.maximum(second - first**2, 0.0)
    return up, down


def _effect_moments(
    columns: FloatArray,
    train_columns: FloatArray,
    gain: FloatArray,
    means: list[FloatArray],
    moments: list[FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return what all copies of one kind add to the mean and to the variance of the curve.

    What an effect adds at calibration points is taken back from main form and deviation
    there, so that only columns minus their projection vary.
    """
    total: FloatArray = np.sum(moments, axis=0)
    value = np.tensordot(np.sum(means, axis=0), columns, axes=([0, 1], [0, 1]))
    size = np.einsum("jpp->j", total)
    kept = np.flatnonzero(size > _NEGLIGIBLE_SHARE * size.sum())
    left = columns[kept] - train_columns[kept] @ gain
    variance = np.einsum("jpn,jpn->n", left, total[kept] @ left)
    for mean in means:
        variance -= np.tensordot(mean[kept], left, axes=([0, 1], [0, 1])) ** 2
    return np.asarray(value), np.asarray(variance)
