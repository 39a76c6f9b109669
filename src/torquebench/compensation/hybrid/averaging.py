"""Averaging over structures: a sum of single effects, each one of many candidates or none.

The model is y = Σₖ fₖ + ε with ε of unit covariance (the data are whitened). Effect k is a group of
columns times normal coefficients, and which group of a dictionary it is, is unknown: candidate j
has a prior probability, the effect's absence the remaining one. The posterior is approximated by a
product over the effects, found by coordinate ascent: each step is the exact posterior of one effect
given the residuals of the others. This is the "sum of single effects" of G. Wang, A. Sarkar, P.
Carbonetto and M. Stephens (J. R. Stat. Soc. B 82 (2020) 1273-1300, iterative Bayesian stepwise
selection, Algorithm 1 and eq. 3.6), here with groups of columns instead of single ones.

The evidence lower bound compares settings of everything outside (noise, smoothness), so that those
are averaged as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.kernels import inner, kernel

__all__ = ["AveragedEffects", "Candidates", "average_effects"]


@dataclass(frozen=True)
class Candidates:
    """The dictionary of one kind of effect, on whitened data.

    Attributes
    ----------
    columns : float64 array of shape (J, q, n)
        The q columns of each of J candidates at the n points.
    scales : float64 array of shape (S,) or (S, q)
        Candidate prior standard deviations of the coefficients, equally probable; one for all
        columns or one for each.
    log_prior : float64 array of shape (J,)
        Log prior probability of each candidate; they and the absence add up to one.
    log_absent : float
        Log prior probability that the effect is absent.
    copies : int
        Largest number of effects of this kind.
    """

    columns: FloatArray
    scales: FloatArray
    log_prior: FloatArray
    log_absent: float
    copies: int = 1


@dataclass(frozen=True)
class AveragedEffects:
    """Posterior of all effects.

    Attributes
    ----------
    weights : list of float64 array of shape (S, J)
        For each effect: posterior probability of each scale and candidate.
    means : list of float64 array of shape (J, q)
        For each effect: posterior mean of the coefficients, absence included.
    moments : list of float64 array of shape (J, q, q)
        For each effect: posterior second moments of the coefficients.
    traces : list of float64 array of shape (S, J)
        For each effect: number of coefficients that the data determine, by candidate.
    present : float64 array of shape (effects,)
        Posterior probability that each effect is there.
    fit : float64 array of shape (n,)
        Posterior mean of the sum of effects, whitened.
    spread : float
        Posterior variance of the sum of effects, summed over the points.
    log_evidence : float
        Evidence lower bound without the terms that don't depend on the effects,
        −½ n log 2π and the whitening's log determinant.
    """

    weights: list[FloatArray]
    means: list[FloatArray]
    moments: list[FloatArray]
    traces: list[FloatArray]
    present: FloatArray
    fit: FloatArray
    spread: float
    log_evidence: float


@dataclass(frozen=True)
class _Prepared:
    """Quantities independent of the data: posterior covariances and determinants of candidates."""

    candidates: Candidates
    gram: FloatArray
    covariance: FloatArray
    constant: FloatArray
    trace: FloatArray


def average_effects(
    target: FloatArray,
    kinds: list[Candidates],
    sweeps: int = 30,
    tolerance: float = 1e-3,
) -> AveragedEffects:
    """Find the posterior of a sum of single effects.

    Parameters
    ----------
    target : float64 array of shape (n,)
        Whitened data.
    kinds : list of Candidates
        Kinds of effects, in the order of the first search.
    sweeps : int, default 30
        Largest number of passes over all effects.
    tolerance : float, default 1e-3
        Stop when the evidence's lower bound rises by less.

    Returns
    -------
    posterior : AveragedEffects
        Effects in the order of the kinds, copies next to each other.

    Examples
    --------
    >>> points = np.linspace(0, 1, 50)
    >>> columns = np.array([[np.sin(f * points)] for f in (10.0, 20.0, 40.0)])
    >>> kind = Candidates(columns, np.array([5.0]), np.log(np.full(3, 0.3)), np.log(0.1))
    >>> posterior = average_effects(4 * np.sin(20 * points), [kind])
    >>> posterior.weights[0].round(3).tolist()
    [[0.0, 1.0, 0.0]]
    """
    prepared = [_prepare(kind) for kind in kinds]
    effects = [kind for kind in prepared for _ in range(kind.candidates.copies)]
    weights = [np.zeros_like(effect.trace) for effect in effects]
    coefficients = [np.zeros(effect.covariance.shape[:3]) for effect in effects]
    total, spread, present, bound = _ascend(
        np.ascontiguousarray(target), effects, weights, coefficients, sweeps, tolerance
    )
    means, moments = [], []
    for effect, weight, mu in zip(effects, weights, coefficients, strict=True):
        mean, moment = _coefficient_moments(weight, mu, effect.covariance)
        means.append(mean)
        moments.append(moment)
    return AveragedEffects(
        weights,
        means,
        moments,
        [effect.trace for effect in effects],
        present,
        total,
        spread,
        bound,
    )


def _prepare(kind: Candidates) -> _Prepared:
    width = kind.columns.shape[1]
    scales = np.array(  # a view that can't be written would be compiled for once more
        np.broadcast_to(kind.scales.reshape(len(kind.scales), -1), (len(kind.scales), width)),
        order="C",
    )
    columns = np.ascontiguousarray(kind.columns)
    gram, covariance, half_log_determinant, trace = _posterior_spreads(columns, scales)
    constant = np.asarray(kind.log_prior - np.log(len(scales)) - half_log_determinant)
    return _Prepared(replace(kind, columns=columns), gram, covariance, constant, trace)


@kernel
def _posterior_spreads(columns, scales):  # type: ignore[no-untyped-def] # Numba infers
    """Return Gram matrices, and for every scale posterior covariance, ½ log determinant, trace."""
    count, width, _ = columns.shape
    gram = np.empty((count, width, width))
    covariance = np.zeros((scales.shape[0], count, width, width))
    half_log_determinant = np.zeros((scales.shape[0], count))
    trace = np.zeros((scales.shape[0], count))
    precision, inverse = np.empty((width, width)), np.zeros((width, width))
    for j in range(count):
        _fill_gram(columns[j], gram[j])
        for s in range(scales.shape[0]):
            for p in range(width):
                for q in range(width):
                    precision[p, q] = gram[j, p, q]
                precision[p, p] += 1.0 / scales[s, p] ** 2
                half_log_determinant[s, j] += np.log(scales[s, p])
            half_log_determinant[s, j] += _invert_factor(precision, inverse)
            for p in range(width):
                for q in range(width):
                    for k in range(max(p, q), width):
                        covariance[s, j, p, q] += inverse[k, p] * inverse[k, q]
                    trace[s, j] += gram[j, p, q] * covariance[s, j, p, q]
    return gram, covariance, half_log_determinant, trace


@inner
def _fill_gram(columns, gram):  # type: ignore[no-untyped-def] # Numba infers
    for p in range(columns.shape[0]):
        for q in range(p + 1):
            total = 0.0
            for i in range(columns.shape[1]):
                total += columns[p, i] * columns[q, i]
            gram[p, q] = gram[q, p] = total


@inner
def _invert_factor(matrix, inverse):  # type: ignore[no-untyped-def] # Numba infers
    """Replace a matrix by its Cholesky factor, fill in the inverse; return Σ log diagonal."""
    log_diagonal = 0.0
    for p in range(matrix.shape[0]):
        for q in range(p + 1):
            total = matrix[p, q]
            for k in range(q):
                total -= matrix[p, k] * matrix[q, k]
            matrix[p, q] = np.sqrt(total) if p == q else total / matrix[q, q]
        log_diagonal += np.log(matrix[p, p])
        inverse[p, p] = 1.0 / matrix[p, p]
        for q in range(p):
            total = 0.0
            for k in range(q, p):
                total -= matrix[p, k] * inverse[k, q]
            inverse[p, q] = total / matrix[p, p]
    return log_diagonal


@kernel
def _coefficient_moments(weights, mu, covariance):  # type: ignore[no-untyped-def] # Numba infers
    """Return posterior means and second moments of the coefficients, absence included."""
    scales, count, width = mu.shape
    means, moments = np.zeros((count, width)), np.zeros((count, width, width))
    for s in range(scales):
        for j in range(count):
            weight = weights[s, j]
            for p in range(width):
                means[j, p] += weight * mu[s, j, p]
                for q in range(width):
                    moments[j, p, q] += weight * (
                        mu[s, j, p] * mu[s, j, q] + covariance[s, j, p, q]
                    )
    return means, moments


def _ascend(
    target: FloatArray,
    effects: list[_Prepared],
    weights: list[FloatArray],
    coefficients: list[FloatArray],
    sweeps: int,
    tolerance: float,
) -> tuple[FloatArray, float, FloatArray, float]:
    """Update the effects in turn until the bound converges; fill in weights and coefficients.

    Returns
    -------
    total, spread, present, bound
        Sum of the effects, its variance, probability of each effect, and the lower bound.
    """
    count = len(effects)
    fits = np.zeros((count, target.size))
    gains, spreads, present = np.zeros(count), np.zeros(count), np.zeros(count)
    residual = target.copy()
    before, bound = -np.inf, -np.inf
    for _ in range(sweeps):
        for k, effect in enumerate(effects):
            residual += fits[k]
            gains[k], spreads[k], present[k] = _single_effect(
                effect.candidates.columns,
                effect.gram,
                effect.covariance,
                effect.constant,
                effect.trace,
                effect.candidates.log_absent,
                residual,
                fits[k],
                weights[k],
                coefficients[k],
            )
            residual -= fits[k]
        bound = float(-0.5 * (residual @ residual + spreads.sum()) + gains.sum())
        if bound - before < tolerance:
            break
        before = bound
    return fits.sum(axis=0), float(spreads.sum()), present, bound


@kernel
def _single_effect(  # type: ignore[no-untyped-def] # Numba infers
    columns, gram, covariance, constant, trace, log_absent, residual, fit, weights, mu
):
    """Fill in one effect's exact posterior; return −KL, spread and probability of presence."""
    _log_weights(columns, covariance, constant, residual, weights, mu)
    largest = log_absent
    for s in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            largest = max(largest, weights[s, j])
    total = np.exp(log_absent - largest)
    absent = total
    for s in range(weights.shape[0]):
        for j in range(weights.shape[1]):
            weights[s, j] = np.exp(weights[s, j] - largest)
            total += weights[s, j]
    weights /= total
    spread = _moments(columns, gram, trace, weights, mu, fit)
    cross, power = 0.0, 0.0
    for i in range(residual.size):
        cross += residual[i] * fit[i]
        power += fit[i] * fit[i]
    spread -= power
    # −KL of the effect = log Z − E_q[log likelihood ratio]
    gain = np.log(total) + largest - cross + 0.5 * (power + spread)
    return gain, spread, 1.0 - absent / total


@inner
def _log_weights(columns, covariance, constant, residual, weights, mu):  # type: ignore[no-untyped-def] # Numba infers
    """Fill in unnormalised log posterior probabilities and the coefficients' posterior means."""
    count, width, points = columns.shape
    projected = np.empty(width)
    for j in range(count):
        for p in range(width):
            value = 0.0
            for i in range(points):
                value += columns[j, p, i] * residual[i]
            projected[p] = value
        for s in range(covariance.shape[0]):
            power = 0.0
            for p in range(width):
                value = 0.0
                for q in range(width):
                    value += covariance[s, j, p, q] * projected[q]
                mu[s, j, p] = value
                power += value * projected[p]
            weights[s, j] = constant[s, j] + 0.5 * power


@inner
def _moments(columns, gram, trace, weights, mu, fit):  # type: ignore[no-untyped-def] # Numba infers
    """Fill in the mean of an effect at the points; return its second moment summed over them."""
    scales, count, width = mu.shape
    fit[:] = 0.0
    second = 0.0
    mean = np.empty(width)
    for j in range(count):
        mean[:] = 0.0
        for s in range(scales):
            weight = weights[s, j]
            if weight < 1e-12:
                continue
            square = trace[s, j]
            for p in range(width):
                mean[p] += weight * mu[s, j, p]
                for q in range(width):
                    square += mu[s, j, p] * gram[j, p, q] * mu[s, j, q]
            second += weight * square
        for p in range(width):
            if abs(mean[p]) > 1e-14:
                for i in range(fit.size):
                    fit[i] += mean[p] * columns[j, p, i]
    return second
