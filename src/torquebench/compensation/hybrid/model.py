"""The recommended model: the chain's physics plus a Gaussian process of structured effects."""

from __future__ import annotations

from numbers import Integral
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from torquebench.compensation.base import CompensationModel, FloatArray, feature_column
from torquebench.compensation.curve_uncertainty import CurveUncertainty, student_widening
from torquebench.compensation.estimator import Between, parameter
from torquebench.compensation.hybrid.correlated_scatter import correlated_covariance
from torquebench.compensation.hybrid.effects import (
    KINDS,
    WAVE_COLUMNS,
    Dictionary,
    EffectPoints,
    at_zero_time,
    effects_sum,
    path_clocks,
)
from torquebench.compensation.hybrid.inference import (
    MANY_CANDIDATES,
    Member,
    Problem,
    deviation_kernel,
    main_columns,
)
from torquebench.compensation.hybrid.posterior_variance import curve_variance
from torquebench.compensation.hybrid.search import explore
from torquebench.compensation.kinds import register
from torquebench.progress import Progress

__all__ = ["HybridModel"]

_USUAL_SPREAD = 2e-3
_KEPT_SHARE = 0.01
_NEGLIGIBLE = 1e-9  # of full scale, summed over all dropped candidates of a kind


@register("hybrid")
class HybridModel(CompensationModel):
    """Physics, smooth deviation and structured effects, averaged over everything unknown.

    The additional torque is equation 15 in consistent form with constants per direction, a smooth
    Gaussian process per direction for the rest, and a sum of structured effects: a step at torque
    reversal, hysteresis, ripple of an unknown period, up to three local bumps. Shapes aren't
    selected but averaged by evidence, as are noise and smoothness (`inference`, `search`,
    `averaging`). Zero drift during the calibration, steady or relaxing, is a nuisance parameter and
    marginalised (`drift`); noise with heavy tails, or noise that grows with the load, is
    recognised.

    Parameters
    ----------
    range_nm, range_margin, outliers
        See `CompensationModel`.
    maximum_points : int, default 800
        More points than this are averaged with their neighbours.

    Attributes
    ----------
    dictionary_ : Dictionary
        Shapes of effects that the data support.
    main_ : float64 array of shape (5,)
        Posterior means of the scaled coefficients of equation 15.
    deviation_ : float64 array of shape (n,)
        Weights of the deviation's kernel at `train_u_`.
    effects_ : list of float64 array
        Posterior means of the coefficients of every kind of effect.
    present_ : dict of str to float
        Posterior probability that the chain shows a kind of effect at all.
    uncertainty_ : CurveUncertainty
        Posterior standard deviation of the curve.

    Notes
    -----
    The posterior of the effects is a factorised approximation (variational), checked against Gibbs
    sampling of the same model: errors agree within 2 %.

    Examples
    --------
    >>> torque = np.concatenate([np.linspace(-100.0, 100.0, 25)] * 2)
    >>> branch = np.where(np.arange(50) < 25, 1.0, -1.0) * np.sign(torque)
    >>> reading = torque - 1e-5 * torque * np.abs(torque) - 0.01 * branch * np.sign(torque)
    >>> model = HybridModel().fit(np.column_stack([reading, branch]), torque)
    >>> bool(abs(model.predict([[49.965, 1.0]])[0] - 50.0) < 0.01)
    True
    """

    maximum_points: int = parameter(800, Between(Integral, 8))

    complexity: ClassVar[int] = 40
    used_features: ClassVar[tuple[str, ...]] = ("reading_nm", "branch", "series")

    dictionary_: Dictionary
    main_: FloatArray
    deviation_: FloatArray
    effects_: list[FloatArray]
    train_u_: FloatArray
    present_: dict[str, float]
    uncertainty_: CurveUncertainty

    def _minimum_points(self) -> int:
        return 8

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, _progress: Progress) -> None:
        u, branch = X[:, 0] / self.full_scale_nm_, feature_column(X, "branch")
        target = (y - X[:, 0]) / self.full_scale_nm_
        series = feature_column(X, "series")
        points = EffectPoints(u, branch, path_clocks(u, branch, series))
        spread = _spread_about_main(u, target, weights)
        correlated = correlated_covariance(u, branch, series, target)
        problem = Problem(points, target, weights, max(1.0, spread / _USUAL_SPREAD), correlated)
        problem, members = explore(problem, max(spread, 1e-5))
        evidence = np.array([member.log_evidence for member in members])
        shares = np.exp(evidence - evidence.max())
        shares /= shares.sum()
        members = [m for m, share in zip(members, shares, strict=True) if share > _KEPT_SHARE]
        shares = shares[shares > _KEPT_SHARE] / np.sum(shares[shares > _KEPT_SHARE])
        noise = float(shares @ [_mean_noise(problem, member) for member in members])
        self.noise_nm_ = self.full_scale_nm_ * noise
        self.effective_parameters_ = float(shares @ [member.effective for member in members])
        self._average_means(problem, members, shares)
        self._tabulate_std(problem, members, shares)

    def _average_means(self, problem: Problem, members: list[Member], shares: FloatArray) -> None:
        """Merge the means of all members, which are linear in the same columns."""
        scale = problem.prior_scale
        self.train_u_ = problem.points.u
        self.main_, self.deviation_ = np.zeros(5), np.zeros(self.train_u_.size)
        effects = [np.zeros(kind.columns.shape[:2]) for kind in problem.kinds]
        absent = np.zeros(len(problem.kinds))
        for share, member in zip(shares, members, strict=True):
            main = main_columns(self.train_u_) * member.main_scales
            self.main_ += share * member.main_scales * (main.T @ member.solved)
            self.deviation_ += share * (scale * member.setting.amplitude) ** 2 * member.solved
            index = 0
            for k, kind in enumerate(problem.kinds):
                chance = 1.0
                for _ in range(kind.copies):
                    effects[k] += share * member.effects.means[index]
                    chance *= 1.0 - member.effects.present[index]
                    index += 1
                absent[k] += share * chance
        self.present_ = {
            kind.name: float(1.0 - missing)
            for kind, missing in zip(problem.kinds, absent, strict=True)
        }
        self.dictionary_, self.effects_ = _without_negligible(problem, effects)

    def _tabulate_std(self, problem: Problem, members: list[Member], shares: FloatArray) -> None:
        """Tabulate the curve's uncertainty on both branches, more closely around the reversal."""
        near = np.geomspace(5e-4, 0.03, 8)
        far = np.linspace(0.03, 1.0 + self.range_margin, 40)[1:]
        positive = np.concatenate([near, far])
        nodes = np.concatenate([-positive[::-1], positive])
        widening = student_widening(problem.target.size - self.effective_parameters_)
        up2, down2 = (widening**2 * v for v in curve_variance(problem, members, shares, nodes))
        half = self._mean(nodes, np.ones(nodes.size)) - self._mean(nodes, np.zeros(nodes.size))
        unknown = np.sqrt(0.5 * (up2 + down2) + half**2)
        if not np.any(problem.points.branch):
            # A loop may exist that was never measured; the curve in its middle is known.
            middle2, _ = curve_variance(problem, members, shares, nodes, 0.0)
            up2 = down2 = widening**2 * middle2
        self.uncertainty_ = CurveUncertainty(nodes, np.sqrt(up2), np.sqrt(down2), unknown)

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        u, branch = X[:, 0] / self.full_scale_nm_, feature_column(X, "branch")
        torque = X[:, 0] + self.full_scale_nm_ * self._mean(u, branch)
        if not return_std:
            return torque, None
        return torque, self._curve_uncertainty(X)

    def _curve_uncertainty(self, X: FloatArray) -> FloatArray:
        u, branch = X[:, 0] / self.full_scale_nm_, feature_column(X, "branch")
        return np.asarray(self.full_scale_nm_ * self.uncertainty_.at(u, branch))

    def _mean(self, u: FloatArray, branch: FloatArray) -> FloatArray:
        """Return the mean additional torque as a fraction of full scale."""
        mean = np.empty_like(u)
        means = dict(zip(KINDS, self.effects_, strict=True))
        for start in range(0, u.size, _BLOCK):
            part = slice(start, start + _BLOCK)
            points = at_zero_time(u[part], branch[part])
            mean[part] = main_columns(u[part]) @ self.main_
            mean[part] += deviation_kernel(u[part], self.train_u_) @ self.deviation_
            mean[part] += effects_sum(points, self.dictionary_, means)
        return mean


_BLOCK = 64
"""Readings at a time: from 128 KiB on, the memory of their columns would be new pages each time."""


def _mean_noise(problem: Problem, member: Member) -> float:
    """Return the root mean square of the points' scatter at their loads."""
    relative = problem.scatter / problem.load_weights(member.setting.growth)
    return member.setting.noise * float(np.sqrt(np.mean(relative)))


def _spread_about_main(u: FloatArray, target: FloatArray, weights: FloatArray) -> float:
    """Return the weighted root mean square of the residuals of equation 15 per direction."""
    columns, root = main_columns(u), np.sqrt(weights)
    solution = np.linalg.lstsq(columns * root[:, None], target * root, rcond=None)[0]
    return float(np.sqrt(np.mean(weights * (target - columns @ solution) ** 2)))


def _without_negligible(
    problem: Problem, effects: list[FloatArray]
) -> tuple[Dictionary, list[FloatArray]]:
    """Drop ripple and bumps whose coefficients add up to a negligible amplitude."""
    means = {"wave": np.zeros((0, WAVE_COLUMNS))}  # a kind without candidates
    means |= {kind.name: mean for kind, mean in zip(problem.kinds, effects, strict=True)}
    kept = {name: _worth_keeping(means[name]) for name in MANY_CANDIDATES}
    for name, candidates in kept.items():
        means[name] = means[name][candidates]
    return problem.dictionary.limited_to(kept), [means[name] for name in KINDS]


def _worth_keeping(means: FloatArray) -> NDArray[np.intp]:
    size = np.abs(means).sum(axis=1)
    order = np.argsort(size)
    kept = np.ones(size.size, dtype=bool)
    kept[order[np.cumsum(size[order]) < _NEGLIGIBLE]] = False
    return np.flatnonzero(kept)
