"""Averaging over structures: a sum of single effects, each one of many candidates or none.

The model is y = Σₖ fₖ + ε with ε of unit covariance (whatever else is in the data has been whitened
into it). Effect k is a group of columns times normal coefficients, and which group of a dictionary
it is isn't known: candidate j has a prior probability, and with the rest of the probability the
effect is absent. The posterior is approximated by a product over the effects, found by coordinate
ascent: each step is the exact posterior of one effect on what the others leave. This is the "sum of
single effects" of G. Wang, A. Sarkar, P. Carbonetto and M. Stephens (J. R. Stat. Soc. B 82 (2020)
1273-1300, iterative Bayesian stepwise selection, Algorithm 1 and eq. 3.6), here with groups of
columns instead of single ones.

The evidence lower bound compares settings of everything outside (noise, smoothness), so that those
are averaged as well.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from torquebench.compensation.columns import FloatArray

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
        How many effects of this kind there may be.
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
    """What doesn't depend on the data: posterior covariances and determinants of candidates."""

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
        Kinds of effects, in the order in which they are first looked for.
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
    fits = np.zeros((len(effects), target.size))
    total = np.zeros(target.size)
    weights: list[FloatArray] = [np.empty(0)] * len(effects)
    coefficients: list[FloatArray] = [np.empty(0)] * len(effects)
    gains, spreads = np.zeros(len(effects)), np.zeros(len(effects))
    absent = np.ones(len(effects))
    before = -np.inf
    for _ in range(sweeps):
        for k, effect in enumerate(effects):
            others = total - fits[k]
            result = _single_effect(
                effect.candidates.columns,
                effect.gram,
                effect.covariance,
                effect.constant,
                effect.trace,
                effect.candidates.log_absent,
                target - others,
            )
            fits[k], weights[k], coefficients[k], gains[k], spreads[k], absent[k] = result
            total = others + fits[k]
        bound = -0.5 * (float(np.sum((target - total) ** 2)) + float(spreads.sum())) + gains.sum()
        if bound - before < tolerance:
            break
        before = bound
    means, moments = [], []
    for effect, weight, mu in zip(effects, weights, coefficients, strict=True):
        means.append(np.einsum("sj,sjp->jp", weight, mu))
        second = np.einsum("sj,sjp,sjq->jpq", weight, mu, mu)
        moments.append(second + np.einsum("sj,sjpq->jpq", weight, effect.covariance))
    return AveragedEffects(
        weights,
        means,
        moments,
        [effect.trace for effect in effects],
        1.0 - absent,
        total,
        float(spreads.sum()),
        float(bound),
    )


def _prepare(kind: Candidates) -> _Prepared:
    columns = kind.columns
    gram: FloatArray = columns @ columns.transpose(0, 2, 1)
    width = columns.shape[1]
    scales = np.broadcast_to(kind.scales.reshape(len(kind.scales), -1), (len(kind.scales), width))
    prior_precision = np.eye(width) / (scales**2)[:, None, :]
    precision = gram[None] + prior_precision[:, None]
    covariance = np.asarray(np.linalg.inv(precision), dtype=np.float64)
    half_log_determinant = 0.5 * np.asarray(np.linalg.slogdet(precision)[1], dtype=np.float64)
    half_log_determinant += np.sum(np.log(scales), axis=1)[:, None]
    constant = np.asarray(kind.log_prior - np.log(len(scales)) - half_log_determinant)
    trace: FloatArray = np.einsum("jpq,sjqp->sj", gram, covariance)
    return _Prepared(kind, gram, covariance, constant, trace)


@njit(cache=True)
def _single_effect(  # type: ignore[no-untyped-def]
    columns, gram, covariance, constant, trace, log_absent, residual
):
    """Return one effect's exact posterior: fit, weights, coefficients, −KL, spread, P(absent)."""
    weights, mu = _log_weights(columns, covariance, constant, residual)
    largest = max(log_absent, weights.max())
    weights = np.exp(weights - largest)
    total = np.exp(log_absent - largest) + weights.sum()
    weights /= total
    fit, spread = _moments(columns, gram, trace, weights, mu)
    cross, power = 0.0, 0.0
    for i in range(residual.size):
        cross += residual[i] * fit[i]
        power += fit[i] * fit[i]
    spread -= power
    # −KL of the effect = log Z − E_q[log likelihood ratio]
    gain = np.log(total) + largest - cross + 0.5 * (power + spread)
    return fit, weights, mu, gain, spread, np.exp(log_absent - largest) / total


@njit(cache=True)
def _log_weights(columns, covariance, constant, residual):  # type: ignore[no-untyped-def]
    """Return unnormalised log posterior probabilities and the coefficients' posterior means."""
    count, width, points = columns.shape
    scales = covariance.shape[0]
    weights = np.empty((scales, count))
    mu = np.zeros((scales, count, width))
    projected = np.empty(width)
    for j in range(count):
        for p in range(width):
            value = 0.0
            for i in range(points):
                value += columns[j, p, i] * residual[i]
            projected[p] = value
        for s in range(scales):
            power = 0.0
            for p in range(width):
                for q in range(width):
                    mu[s, j, p] += covariance[s, j, p, q] * projected[q]
                power += mu[s, j, p] * projected[p]
            weights[s, j] = constant[s, j] + 0.5 * power
    return weights, mu


@njit(cache=True)
def _moments(columns, gram, trace, weights, mu):  # type: ignore[no-untyped-def]
    """Return the mean of an effect at the points, and its second moment summed over them."""
    scales, count, width = mu.shape
    fit = np.zeros(columns.shape[2])
    second = 0.0
    mean = np.empty(width)
    for j in range(count):
        mean[:] = 0.0
        for s in range(scales):
            weight = weights[s, j]
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
    return fit, second
