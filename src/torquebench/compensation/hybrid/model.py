"""The recommended model: an average of Gaussian processes of a chain's physics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import ClassVar

import numpy as np

from torquebench.compensation.base import CompensationModel
from torquebench.compensation.checks import WHOLE_SHARE
from torquebench.compensation.columns import FloatArray, feature_column
from torquebench.compensation.curve_uncertainty import CurveUncertainty, student_widening
from torquebench.compensation.estimator import Between, parameter
from torquebench.compensation.hybrid.average import average
from torquebench.compensation.hybrid.calibration_path import (
    correlated_covariance,
    count_levels,
    path_clock,
    path_side,
)
from torquebench.compensation.hybrid.member import Member, Problem
from torquebench.compensation.hybrid.parts import (
    FORM,
    Points,
    Term,
    catalogue,
    curve,
    form_columns,
    unmeasured_loop,
)
from torquebench.compensation.kinds import register
from torquebench.progress import Progress

_USUAL_SPREAD, _USUAL_SLOPE = 2e-3, 5e-3
"""Usual root mean squares about equation 15 and of the additional torque, as shares of full scale;
more scales all priors, or those of the trend.
"""
_NEGLIGIBLE = 1e-9  # of full scale: terms are dropped if their coefficients add up to less
_NEAR, _FAR = np.geomspace(5e-4, 0.03, 8), np.linspace(0.03, 1.0, 40)[1:]
_BLOCK = 256
"""Readings evaluated at once: their columns fit the cache."""


@dataclass(frozen=True)
class Average:
    """Members of the posterior with their probabilities.

    `unit` is the unit of their curves, `scatter` the factor by which the points' correlated scatter
    raises the noise, `branches` are the recorded branches.
    """

    members: list[Member]
    shares: FloatArray
    unit: float
    scatter: float
    branches: frozenset[float]

    def mean_of(self, values: Sequence[float]) -> float:
        """Return the mean of the members' values, weighted by their probabilities."""
        return float(self.shares @ values)


@register("hybrid")
class HybridModel(CompensationModel):
    """Average of Gaussian processes with a chain's physical effects.

    The additional torque is equation 15 with constants of each direction, a step at torque
    reversal, a hysteresis loop, smooth and rough deviations and ripple, each with an unknown
    amplitude and shape (`parts`). Which of them a chain has isn't selected: a handful of structures
    are averaged by their evidence, as are plain forms, noise that grows with the torque, noise with
    heavy tails, and a drift of the zero during the calibration, which is estimated and isn't part
    of the curve (`average`, `member`).

    Parameters
    ----------
    range_nm, range_margin, outliers
        See `CompensationModel`.
    maximum_points : int, default 500
        More points than this are averaged with their neighbours.

    Attributes
    ----------
    form_ : float64 array of shape (6,)
        Coefficients of 1, u, |u|, u², u|u|, u³, u being reading / `scale_nm_`.
    terms_ : list of Term
        All other terms of the curve.
    scale_nm_ : float
        Full scale, or the largest reading of a calibration that doesn't reach it.
    present_ : dict of str to float
        Posterior probability of each part.
    uncertainty_ : CurveUncertainty
        Posterior standard deviation of the curve, and scatter of single readings.

    Examples
    --------
    >>> torque = np.concatenate([np.linspace(-100.0, 100.0, 25)] * 2)
    >>> branch = np.where(np.arange(50) < 25, 1.0, -1.0) * np.sign(torque)
    >>> reading = torque - 1e-5 * torque * np.abs(torque) - 0.01 * branch * np.sign(torque)
    >>> model = HybridModel().fit(np.column_stack([reading, branch]), torque)
    >>> bool(abs(model.predict([[49.965, 1.0]])[0] - 50.0) < 0.01)
    True
    """

    maximum_points: int = parameter(Between(Integral, 8), default=500)

    complexity: ClassVar[int] = 40
    used_features: ClassVar[tuple[str, ...]] = ("reading_nm", "branch", "series")

    def _minimum_points(self) -> int:
        return 5

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, _progress: Progress) -> None:
        """Fit and average the members; keep the average's means, tables and scatter."""
        average = self._averaged(X, y, weights)
        self._add_means(average)
        self.effective_parameters_ = average.mean_of(
            [member.effective_parameters() for member in average.members]
        )
        self.uncertainty_ = self._tabulated(average)
        at_points = self.uncertainty_.scatter_at(X[:, 0] / self.scale_nm_)
        self.noise_nm_ = self.scale_nm_ * float(np.sqrt(np.mean(at_points**2)))

    def _averaged(self, X: FloatArray, y: FloatArray, weights: FloatArray) -> Average:
        """Average the structures of the chain, in fractions of `scale_nm_`."""
        largest = float(np.max(np.abs(X[:, 0])))
        complete = largest >= WHOLE_SHARE * self.full_scale_nm_
        self.scale_nm_ = self.full_scale_nm_ if complete else largest
        u, branch = X[:, 0] / self.scale_nm_, feature_column(X, "branch")
        series, target = feature_column(X, "series"), (y - X[:, 0]) / self.scale_nm_
        unit, trend_scale = _scales(u, target, weights)
        branches = frozenset(np.unique(np.sign(branch[branch != 0.0])).tolist())
        points = Points(u, branch, path_clock(u, branch, series), path_side(u, series))
        parts = catalogue(count_levels(u), with_loops=len(branches) == 2)
        shared = correlated_covariance(u, branch, series, target)
        whitening, scatter = None, 1.0
        if shared is not None:
            whitening, scatter = _whitening(shared, weights), 1.0 + float(np.mean(np.diag(shared)))
            weights = np.ones(u.size)
        problem = Problem(points, target / unit, parts, trend_scale, whitening)
        members, shares = average(problem, weights)
        return Average(members, shares, unit, scatter, branches)

    def _add_means(self, average: Average) -> None:
        """Add up the members' mean curves, term by term."""
        terms: dict[tuple[str, tuple[float, ...]], FloatArray] = {}
        members, shares, unit = average.members, average.shares, average.unit
        present = dict.fromkeys(members[0].problem.parts, 0.0)
        for share, member in zip(shares, members, strict=True):
            for name in member.structure.parts:
                present[name] += float(share)
            for name, (shape, beta) in member.coefficients().items():
                key = (name, tuple(shape.tolist()))
                terms[key] = terms.get(key, np.zeros(beta.size)) + unit * share * beta
        self.present_: dict[str, float] = {name: min(share, 1.0) for name, share in present.items()}
        self.form_: FloatArray = terms.pop(("form", ()))
        self.terms_ = [
            Term(name, np.array(shape), beta)
            for (name, shape), beta in terms.items()
            if np.abs(beta).sum() > _NEGLIGIBLE
        ]
        if self.zeroed:
            unloaded = self._mean(np.zeros(1), np.zeros(1))
            self.terms_.append(Term("zero", np.zeros(0), -unloaded))

    def _tabulated(self, average: Average) -> CurveUncertainty:
        """Return the uncertainty on both branches, at nodes that are denser around the reversal."""
        members, shares, unit = average.members, average.shares, average.unit
        branches = average.branches
        positive = np.concatenate([_NEAR, (1.0 + self.range_margin) * _FAR])
        nodes = np.concatenate([-positive[::-1], positive])
        freedom = 1.0 / average.mean_of([1.0 / member.noise_freedom for member in members])
        widening = student_widening(freedom)

        def variance(branch: float) -> FloatArray:
            """Return the curve's variance at the nodes: within members and between them."""
            means, variances = [], []
            for member in members:
                mean, factors = member.curve(Points(nodes, np.full(nodes.size, branch)))
                means.append(mean)
                variances.append(np.sum(factors**2, axis=1))
            between = shares @ np.square(means) - (shares @ np.array(means)) ** 2
            total = shares @ np.array(variances) + np.maximum(between, 0.0)
            return np.asarray((widening * unit) ** 2 * total)

        up2, down2 = variance(1.0), variance(-1.0)
        half = self._mean(nodes, np.ones(nodes.size)) - self._mean(nodes, np.zeros(nodes.size))
        unknown2 = 0.5 * (up2 + down2) + half**2
        if len(branches) < 2:
            # An unmeasured loop may exist: the other branch is twice half a loop away.
            loop2 = (unit * unmeasured_loop(nodes)) ** 2
            unknown2 = up2 + (2.0 * loop2 if branches else loop2)
            up2 = up2 + 4.0 * loop2 if branches == {-1.0} else up2
            down2 = down2 + 4.0 * loop2 if branches == {1.0} else down2
        noise2 = average.scatter * unit**2 * (shares @ np.array([m.noise(nodes) for m in members]))
        up, down, unknown, noise = np.sqrt([up2, down2, unknown2, noise2])
        return CurveUncertainty(nodes, up, down, unknown, noise, freedom)

    def _noise_freedom(self, count: int) -> float:
        freedom = super()._noise_freedom(count)
        return freedom if self.uncertainty_ is None else self.uncertainty_.freedom

    @property
    def _unit_nm(self) -> float:
        return self.scale_nm_

    @property
    def scatter_nm(self) -> float:
        """Standard deviation of a single reading in N·m, root mean square over the points."""
        return float(self.noise_nm_)

    def _predict(self, X: FloatArray) -> FloatArray:
        u, branch = X[:, 0] / self.scale_nm_, feature_column(X, "branch")
        return np.asarray(X[:, 0] + self.scale_nm_ * self._mean(u, branch))

    def _mean(self, u: FloatArray, branch: FloatArray) -> FloatArray:
        """Return the mean additional torque as a fraction of `scale_nm_`."""
        mean = np.empty_like(u)
        for start in range(0, u.size, _BLOCK):
            rows = slice(start, start + _BLOCK)
            mean[rows] = curve(self.form_, self.terms_, Points(u[rows], branch[rows]))
        return mean


def _scales(u: FloatArray, target: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Return the unit of all priors, and a factor on the trend's, from equation 15's residuals."""
    columns, root = form_columns(u, FORM[:5]), np.sqrt(weights)
    solution = np.linalg.lstsq(columns * root[:, None], target * root, rcond=None)[0]
    spread = float(np.sqrt(np.mean(weights * (target - columns @ solution) ** 2)))
    unit = max(1.0, spread / _USUAL_SPREAD)
    size = float(np.sqrt(np.mean(weights * target**2)))
    return unit, max(1.0, size / (unit * _USUAL_SLOPE))


def _whitening(shared: FloatArray, weights: FloatArray) -> FloatArray:
    """Return the inverse Cholesky factor of the points' correlated scatter."""
    from scipy import linalg  # imported late: a server at rest doesn't need SciPy

    factor = linalg.cholesky(np.diag(1.0 / weights) + shared, lower=True)
    return np.asarray(linalg.solve_triangular(factor, np.eye(len(factor)), lower=True))
