"""One structure of a chain's additional torque: a Gaussian process, its evidence and posterior.

The additional torque at the calibration points is y = Φβ + ε with normal coefficients β of zero
mean and standard deviations s(θ), columns Φ(θ) (`parts`) and normal noise of variances ν(θ). With
the whitened and scaled columns A = ν^−½ Φ s and B = 1 + AᵀA, the marginal likelihood of the
hyperparameters θ is

    log p(y|θ) = −½ yᵀν⁻¹y + ½ bᵀB⁻¹b − ½ log|B| − ½ Σ log 2πν,    b = Aᵀν^−½ y

(C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, eq. 2.30 and
appendix A.3). Its cost grows with the number of points only linearly, and all gradients are closed
forms. θ is found by maximising p(y|θ) p(θ); the integral over θ is Laplace's approximation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import lgamma
from typing import NamedTuple

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.hybrid.parts import (
    FORM,
    TRENDS,
    Part,
    Points,
    Prior,
    about,
    form_columns,
)

NOISE = about(2e-4, 0.8)
"""Prior of the standard deviation of a point."""
LEAST_NOISE = 1e-6
GROWTH = about(0.7, 1.2)
"""Prior of g, where the variance of a point is proportional to 1 + g² u²."""
_FARTHEST = 3.5  # prior standard deviations
_MANY, _UPPER = 200.0, 0.975  # degrees of freedom that are kept; quantile of Student's factor
_FREEDOM = 4.0
_ROUNDS = 8  # iterations of heavy-tailed noise at most
"""Degrees of freedom of noise with heavy tails."""
_LEAST_CURVATURE = 0.2  # of the prior's curvature; a smaller one isn't that of a normal posterior
_CLOSE = 5e-3  # times the log posterior per point: about 0.02 of the log posterior
_STEP = 1e-3  # step of a log hyperparameter, for differences of the gradient


@dataclass(frozen=True)
class Structure:
    """Assumed structure of a chain: its trend, parts and noise.

    Attributes
    ----------
    trend : str
        One of `TRENDS`.
    parts : tuple of str
        Names from the catalogue, sorted.
    growing, tailed : bool
        Whether the noise grows with the torque, and whether it has heavy tails.
    """

    trend: str
    parts: tuple[str, ...] = ()
    growing: bool = False
    tailed: bool = False

    def with_parts(self, *names: str) -> Structure:
        """Return the structure with further parts."""
        return replace(self, parts=tuple(sorted({*self.parts, *names})))

    def limited_to(self, names: Iterable[str]) -> Structure:
        """Return the structure with only those of its parts that are in `names`."""
        return replace(self, parts=tuple(sorted({*self.parts}.intersection(names))))


class Problem:
    """Calibration points, and the parts that they may contain.

    Parameters
    ----------
    target : float64 array of shape (n,)
        Additional torque, as a multiple of `unit`.
    trend_scale : float
        Factor on the prior scales of the trend.
    whitening : float64 array of shape (n, n), optional
        Inverse Cholesky factor of the correlation of the points' scatter.
    """

    def __init__(
        self,
        points: Points,
        target: FloatArray,
        parts: Mapping[str, Part],
        trend_scale: float = 1.0,
        whitening: FloatArray | None = None,
    ) -> None:
        self.points, self.parts, self.trend_scale = points, parts, trend_scale
        self._whitening = whitening
        self.target = self.white(target)
        self._kept: dict[str, FloatArray] = {}

    def white(self, values: FloatArray) -> FloatArray:
        """Transform columns at the points such that the scatter becomes independent."""
        return values if self._whitening is None else np.asarray(self._whitening @ values)

    def trend(self, name: str) -> FloatArray:
        """Return the whitened columns of a trend at the points, times their prior scales."""
        if name not in self._kept:
            self._kept[name] = self.white(self.trend_columns(name, self.points.u))
        return self._kept[name]

    def trend_columns(self, name: str, u: FloatArray) -> FloatArray:
        """Return the columns of a trend, times their prior scales."""
        scales = self.trend_scale * np.array(list(TRENDS[name].values()))
        return np.asarray(form_columns(u, list(TRENDS[name])) * scales)

    def columns(self, name: str, shape: FloatArray) -> tuple[FloatArray, FloatArray | None]:
        """Return the whitened columns of a part at the points, with their derivatives."""
        part = self.parts[name]
        if part.fixed:
            if name not in self._kept:
                self._kept[name] = self.white(part.columns(self.points, shape)[0])
            return self._kept[name], None
        columns, slopes = part.columns(self.points, shape)
        if self._whitening is None or slopes is None:
            return columns, slopes
        flat = self.white(slopes.reshape(len(slopes), -1))
        return self.white(columns), flat.reshape(slopes.shape)


class Layout:
    """Positions of a structure's hyperparameters in θ, and their priors."""

    def __init__(self, structure: Structure, parts: Mapping[str, Part]) -> None:
        self.structure = structure
        self.parts = {name: parts[name] for name in structure.parts}
        priors: list[Prior] = []
        self.amplitude: dict[str, int] = {}
        self.shape: dict[str, slice] = {}
        for name, part in self.parts.items():
            self.amplitude[name] = len(priors)
            self.shape[name] = slice(len(priors) + 1, len(priors) + 1 + len(part.shape))
            priors += [part.amplitude, *part.shape]
        self.noise = len(priors)
        priors += [NOISE, GROWTH] if structure.growing else [NOISE]
        self.growth = self.noise + 1 if structure.growing else None
        self.mean, self.sd = np.array(priors).T
        self.low, self.high = (self.mean + sign * _FARTHEST * self.sd for sign in (-1.0, 1.0))
        self.low[self.noise] = np.log(LEAST_NOISE)

    def start(self, other: Layout, theta: FloatArray) -> FloatArray:
        """Return the prior means, with another structure's values where both have them."""
        start: FloatArray = self.mean.copy()
        for name in self.parts:
            if name in other.parts:
                start[self.amplitude[name]] = theta[other.amplitude[name]]
                start[self.shape[name]] = theta[other.shape[name]]
        start[self.noise] = theta[other.noise]
        if self.growth is not None and other.growth is not None:
            start[self.growth] = theta[other.growth]
        return start

    def variances(self, theta: FloatArray, u: FloatArray) -> FloatArray:
        """Return the noise variance of points."""
        variance = np.full(u.size, np.exp(2.0 * theta[self.noise]))
        if self.growth is not None:
            variance *= 1.0 + np.exp(2.0 * theta[self.growth]) * u * u
        return variance

    def growth_share(self, theta: FloatArray, u: FloatArray) -> FloatArray:
        """Return half the derivative of the log variances by log g."""
        grown = np.exp(2.0 * theta[self.growth]) * u * u
        return np.asarray(grown / (1.0 + grown))


@dataclass(frozen=True, eq=False)
class Weighting:
    """Weights of the points: a point's noise variance is ν / weight.

    Attributes
    ----------
    weights : float64 array of shape (n,)
    base : float64 array of shape (n,)
        Weights without the factor due to heavy tails.
    correction : float
        Log likelihood of Student's noise, less that of normal noise with these weights.
    """

    weights: FloatArray
    base: FloatArray
    correction: float = 0.0


class _Block(NamedTuple):
    """Columns of one part, and the derivatives of columns and log scales by its shape."""

    name: str
    place: slice
    slopes: FloatArray | None
    of_scales: FloatArray


@dataclass(frozen=True, eq=False)
class _Solved:
    """Posterior of the coefficients for one θ.

    Attributes
    ----------
    columns : float64 array of shape (n, k)
        Whitened and scaled, A.
    scales : float64 array of shape (k,)
        Prior standard deviations s; the columns of the trend have 1.
    coefficients : float64 array of shape (k,)
        Posterior means of β / s.
    inverse : float64 array of shape (k, k)
        Inverse Cholesky factor of B.
    residual, leverage : float64 array of shape (n,)
        Whitened residuals, and the leverage of the points.
    root : float64 array of shape (n,)
        1 / √ν.
    """

    columns: FloatArray
    scales: FloatArray
    coefficients: FloatArray
    inverse: FloatArray
    residual: FloatArray
    leverage: FloatArray
    root: FloatArray
    blocks: list[_Block]


def log_posterior(
    problem: Problem, layout: Layout, weights: FloatArray, theta: FloatArray
) -> tuple[float, FloatArray, _Solved]:
    """Return log p(y|θ) p(θ) without constants, its gradient, and the coefficients' posterior."""
    from scipy.linalg import cholesky  # imported late: a server at rest doesn't need SciPy
    from scipy.linalg.lapack import dtrtri

    trend = problem.trend(layout.structure.trend)
    columns, scales, blocks = [trend], [np.zeros(trend.shape[1])], list[_Block]()
    first = trend.shape[1]
    for name, part in layout.parts.items():
        shape = np.exp(theta[layout.shape[name]])
        block, slopes = problem.columns(name, shape)
        relative, of_scales = part.scales(shape)
        columns.append(block)
        scales.append(theta[layout.amplitude[name]] + relative)
        blocks.append(_Block(name, slice(first, first + block.shape[1]), slopes, of_scales))
        first += block.shape[1]
    prior_sd = np.exp(np.concatenate(scales))
    noise = layout.variances(theta, problem.points.u) / weights
    root = 1.0 / np.sqrt(noise)
    white = np.hstack(columns)
    white *= prior_sd
    white *= root[:, None]
    gram = white.T @ white
    gram.flat[:: len(gram) + 1] += 1.0
    factor = cholesky(gram, lower=True, check_finite=False, overwrite_a=True)
    inverse = dtrtri(factor, lower=1)[0]
    y = problem.target * root
    c = inverse.T @ (inverse @ (white.T @ y))
    residual = y - white @ c
    from_prior = (theta - layout.mean) / layout.sd
    value = -0.5 * (residual @ y + np.log(noise).sum() + from_prior @ from_prior)
    value -= np.log(np.diag(factor)).sum()
    # derivative by the log scale of every column
    by_scale = c * c - (1.0 - np.sum(inverse * inverse, axis=0))
    slope = -from_prior / layout.sd
    for number, (name, place, slopes, of_scales) in enumerate(blocks):
        slope[layout.amplitude[name]] += by_scale[place].sum()
        slope[layout.shape[name]] += by_scale[place] @ of_scales
        if slopes is not None:
            slopes = slopes * (prior_sd[place] * root[:, None])[:, :, None]
            blocks[number] = _Block(name, place, slopes, of_scales)
            for k, at in enumerate(range(layout.noise)[layout.shape[name]]):
                moved = slopes[:, :, k]
                trace = np.sum(inverse[:, place] * (inverse @ (white.T @ moved)))
                slope[at] += residual @ moved @ c[place] - trace
    left = white @ inverse.T
    leverage = np.einsum("ij,ij->i", left, left)
    by_noise = residual**2 - (1.0 - leverage)  # twice the derivative by log ν
    slope[layout.noise] += by_noise.sum()
    if layout.growth is not None:
        slope[layout.growth] += by_noise @ layout.growth_share(theta, problem.points.u)
    solved = _Solved(white, prior_sd, c, inverse, residual, leverage, root, blocks)
    return float(value), slope, solved


def _freedom_of(variance: float) -> float:
    """Return the freedom whose Student's factor belongs to a log noise of this posterior variance.

    The posterior is that of a standard deviation which was estimated with some degrees of freedom,
    times the log-normal prior: few points leave the prior, which has no tails like Student's.
    """
    from scipy.optimize import brentq  # imported late: a fitted model doesn't need SciPy
    from scipy.special import ndtr, stdtridf

    estimated = max(0.5 * (1.0 / variance - 1.0 / NOISE.sd**2), 0.0)
    if estimated > _MANY:
        return float(estimated)
    log = np.linspace(-5.0 * NOISE.sd, 5.0 * NOISE.sd, 401)
    chance = -estimated * (log + 0.5 * np.exp(-2.0 * log)) - 0.5 * (log / NOISE.sd) ** 2
    chance = np.exp(chance - chance.max())
    chance /= chance.sum()
    factor = brentq(lambda k: chance @ ndtr(k * np.exp(-log)) - _UPPER, 1.0, 50.0)
    return float(stdtridf(_UPPER, factor))


@dataclass(frozen=True, eq=False)
class Member:
    """A structure with fitted hyperparameters.

    Attributes
    ----------
    theta : float64 array of shape (p,)
        Logarithms of the hyperparameters at the maximum of their posterior.
    log_posterior : float
        Log posterior there, without constants.
    covariance : float64 array of shape (p, p)
        Covariance of the hyperparameters; empty before `integrated`.
    log_evidence : float
        Laplace's approximation; before `integrated`, an upper limit.
    slope : float64 array of shape (p,)
        Gradient of the log posterior at the maximum; empty if it isn't from `fitted`.
    """

    problem: Problem
    layout: Layout
    weighting: Weighting
    theta: FloatArray
    log_posterior: float
    covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    log_evidence: float = float("inf")
    slope: FloatArray = field(default_factory=lambda: np.zeros(0))

    @classmethod
    def fitted(
        cls,
        problem: Problem,
        layout: Layout,
        weighting: Weighting,
        start: FloatArray | None = None,
        iterations: int = 60,
    ) -> Member:
        """Maximise the posterior of the hyperparameters."""
        from scipy.optimize import minimize  # imported late: a fitted model doesn't need SciPy

        def loss(theta: FloatArray) -> tuple[float, FloatArray]:
            value, slope, _ = log_posterior(problem, layout, weighting.weights, theta)
            return -value, -slope

        start = layout.mean if start is None else np.clip(start, layout.low, layout.high)
        optimum = minimize(
            loss,
            start,
            jac=True,
            method="L-BFGS-B",
            bounds=list(zip(layout.low, layout.high, strict=True)),
            options={"maxiter": iterations, "ftol": _CLOSE / len(problem.points)},
        )
        return cls(problem, layout, weighting, optimum.x, -float(optimum.fun), slope=-optimum.jac)

    @property
    def structure(self) -> Structure:
        """Structure of the chain in this member."""
        return self.layout.structure

    def start_for(self, layout: Layout) -> FloatArray:
        """Return start values for another structure, from this member's hyperparameters."""
        return layout.start(self.layout, self.theta)

    def integrated(self) -> Member:
        """Return the member with its evidence and the covariance of its hyperparameters."""
        layout = self.layout

        def slope(theta: FloatArray) -> FloatArray:
            return log_posterior(self.problem, layout, self.weighting.weights, theta)[1]

        curvature = np.empty((self.theta.size, self.theta.size))
        for k in range(self.theta.size):
            # away from the bound, towards the prior mean
            step = _STEP if self.theta[k] <= layout.mean[k] else -_STEP
            moved = self.theta.copy()
            moved[k] += step
            curvature[k] = (self.slope - slope(moved)) / step
        scaled = 0.5 * (curvature + curvature.T) * np.outer(layout.sd, layout.sd)
        values, vectors = np.linalg.eigh(scaled)
        values = np.maximum(values, _LEAST_CURVATURE)
        covariance = (vectors / values) @ vectors.T * np.outer(layout.sd, layout.sd)
        evidence = self.log_posterior - 0.5 * float(np.log(values).sum())
        return replace(
            self, covariance=covariance, log_evidence=evidence + self.weighting.correction
        )

    @cached_property
    def _solved(self) -> _Solved:
        return log_posterior(self.problem, self.layout, self.weighting.weights, self.theta)[2]

    # ---- noise ----------------------------------------------------------------------------

    def noise(self, u: FloatArray) -> FloatArray:
        """Return the variance of a single reading."""
        tails = _FREEDOM / (_FREEDOM - 2.0) if self.structure.tailed else 1.0
        return tails * self.layout.variances(self.theta, u)

    @property
    def noise_freedom(self) -> float:
        """Degrees of freedom of the noise."""
        at = self.layout.noise
        if self.theta[at] <= self.layout.low[at]:  # no maximum: the fit left no noise
            return max(len(self.problem.points) - self.effective_parameters(), 1.0)
        return _freedom_of(self.covariance[at, at])

    def tailed(self) -> Member:
        """Return the same member with heavy-tailed noise (variational, Bishop 2006, eq. 10.3)."""
        layout = Layout(replace(self.structure, tailed=True), self.problem.parts)
        member = replace(self, layout=layout)
        bound = -np.inf
        for _ in range(_ROUNDS):
            base = member.weighting.base
            tails = (_FREEDOM + 1.0) / (_FREEDOM + member._expected_squares())
            weighting = Weighting(base * tails, base)
            member = Member.fitted(self.problem, layout, weighting, member.theta, 12)
            weighting = replace(weighting, correction=member._student_correction())
            member = replace(member, weighting=weighting)
            before, bound = bound, member.log_posterior + weighting.correction
            if bound - before < 0.1:
                break
        return member

    def _expected_squares(self) -> FloatArray:
        """Return the points' expected squared noise, relative to the variance without tails."""
        solved = self._solved
        ratio = self.weighting.base / self.weighting.weights
        return np.asarray((solved.residual**2 + solved.leverage) * ratio)

    def _student_correction(self) -> float:
        """Return what Student's tails add to the log evidence, which assumes normal residuals."""
        squares = self._expected_squares()
        tails = self.weighting.weights / self.weighting.base
        shape = 0.5 * (_FREEDOM + 1.0)
        constant = 0.5 * _FREEDOM * np.log(0.5 * _FREEDOM) - lgamma(0.5 * _FREEDOM) + lgamma(shape)
        student = constant - shape * np.log(0.5 * (_FREEDOM + squares))
        return float(np.sum(student - 0.5 * (np.log(tails) - tails * squares)))

    # ---- posterior of the curve -----------------------------------------------------------

    def effective_parameters(self) -> float:
        """Return the number of coefficients that the points determine."""
        return float(self._solved.leverage.sum())

    def coefficients(self) -> dict[str, tuple[FloatArray, FloatArray]]:
        """Return shape parameters and posterior mean coefficients of each part in the curve.

        Trend, offset and the difference of both directions are one part, "form".
        """
        solved, trend = self._solved, TRENDS[self.structure.trend]
        form = dict.fromkeys(FORM, 0.0)
        for k, (name, scale) in enumerate(trend.items()):
            form[name] += self.problem.trend_scale * scale * solved.coefficients[k]
        parts = {}
        for block in solved.blocks:
            beta = (solved.scales * solved.coefficients)[block.place]
            part = self.layout.parts[block.name]
            names = getattr(part, "names", ())
            for name, value in zip(names, beta, strict=bool(names)):
                form[name] += value
            if not names and block.name != "drift":
                shape = np.exp(self.theta[self.layout.shape[block.name]])
                parts[block.name] = (np.zeros(0) if part.fixed else shape, beta)
        return {"form": (np.zeros(0), np.array(list(form.values()))), **parts}

    def curve(self, points: Points) -> tuple[FloatArray, FloatArray]:
        """Return the curve's mean and factors F (n, k) of its covariance F Fᵀ."""
        solved, layout = self._solved, self.layout
        columns = [self.problem.trend_columns(self.structure.trend, points.u)]
        moves = np.zeros((len(points), self.theta.size))
        for block in solved.blocks:
            shape = np.exp(self.theta[layout.shape[block.name]])
            values, slopes = layout.parts[block.name].columns(points, shape)
            columns.append(values)
            if slopes is not None:
                beta = (solved.scales * solved.coefficients)[block.place]
                moves[:, layout.shape[block.name]] += np.einsum("nks,k->ns", slopes, beta)
        scaled = np.hstack(columns) * solved.scales
        moves += scaled @ self._coefficient_moves(solved)
        values, vectors = np.linalg.eigh(self.covariance)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        return scaled @ solved.coefficients, np.hstack([scaled @ solved.inverse.T, moves @ root])

    def _coefficient_moves(self, solved: _Solved) -> FloatArray:
        """Return the derivatives of the coefficients β / s by θ, for the columns' own scales.

        They solve the normal equations, differentiated by each parameter: `moves` is the right
        side, `solved.inverse` the factor of the inverse.
        """
        layout, c = self.layout, solved.coefficients
        moves = np.zeros((c.size, self.theta.size))
        for block in solved.blocks:
            own, shapes = block.place, layout.shape[block.name]
            moves[own, layout.amplitude[block.name]] = 2.0 * c[own]
            moves[own, shapes] = 2.0 * (c[own, None] * block.of_scales)
            if block.slopes is not None:  # its columns depend on the shape parameters, too
                for number, parameter in enumerate(range(layout.noise)[shapes]):
                    slopes = block.slopes[:, :, number]
                    moves[:, parameter] -= solved.columns.T @ (slopes @ c[own])
                    moves[own, parameter] += slopes.T @ solved.residual
        moves[:, layout.noise] = -2.0 * c
        if layout.growth is not None:
            share = layout.growth_share(self.theta, self.problem.points.u)
            moves[:, layout.growth] = -2.0 * (solved.columns.T @ (solved.residual * share))
        return np.asarray(solved.inverse.T @ (solved.inverse @ moves))

    def gain_of(self, columns: FloatArray, groups: int) -> FloatArray:
        """Return by how much candidate columns would raise the log evidence, shape (j,).

        Parameters
        ----------
        columns : float64 array of shape (n, groups * j)
            Columns at the points, times their prior scales; the columns of one candidate are j
            apart.
        groups : int
            Number of columns of a candidate.
        """
        # Each candidate's share of the data, less what the present columns explain of it.
        solved = self._solved
        white = self.problem.white(columns) * solved.root[:, None]
        left = solved.inverse @ (solved.columns.T @ white)
        own, explained = (np.moveaxis(v.reshape(len(v), groups, -1), 2, 0) for v in (white, left))
        gram = np.eye(groups) + np.swapaxes(own, 1, 2) @ own
        gram -= np.swapaxes(explained, 1, 2) @ explained
        right = (solved.residual @ white).reshape(groups, -1).T[:, :, None]
        power = np.sum(right * np.linalg.solve(gram, right), axis=(1, 2))
        return np.asarray(0.5 * power - 0.5 * np.linalg.slogdet(gram)[1])
