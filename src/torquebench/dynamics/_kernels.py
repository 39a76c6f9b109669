"""Loops of the filters; sums have one order, so that results don't depend on a stream's blocks."""

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import kernel

__all__ = ["convolve", "convolve_uncertain", "correct_uncertain"]

FloatArray = NDArray[np.float64]


@kernel
def convolve(extended: FloatArray, weights: FloatArray) -> FloatArray:
    """Return Σ weights[k]·x[n − k]; ``extended`` begins with the weights.size − 1 values before."""
    past = weights.size - 1
    result = np.zeros(extended.size - past)
    for k in range(weights.size):  # the inner loop runs over samples, so that it vectorises
        weight, start = weights[k], past - k
        for n in range(result.size):
            result[n] += weight * extended[start + n]
    return result


@kernel
def convolve_uncertain(
    past: FloatArray,
    values: FloatArray,
    spread: FloatArray,
    weights: FloatArray,
    factors: FloatArray,
    variances: FloatArray,
    squares: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Filter values; return them with variances due to the weights and to the values.

    Parameters
    ----------
    past : float64[2, m - 1]
        Values before and their variances; changed in place.
    values, spread : float64[n]
        The next ones and their standard uncertainties.
    weights, squares : float64[m]
        Of values, and of their variances.
    factors, variances : float64[r, m], float64[m]
        Factors of the weights' covariance, without rows where they aren't correlated, and their
        variances.
    """
    kept, count = past.shape[1], values.size
    extended, own = np.empty(kept + count), np.empty(kept + count)
    extended[:kept], extended[kept:] = past[0], values
    own[:kept], own[kept:] = past[1], spread * spread
    if factors.shape[0]:
        by_weights = np.zeros(count)
        for row in range(factors.shape[0]):
            part = convolve(extended, factors[row])
            by_weights += part * part
    else:
        by_weights = convolve(extended * extended, variances)
    past[0], past[1] = extended[count:], own[count:]
    return convolve(extended, weights), by_weights, convolve(own, squares)


@kernel
def correct_uncertain(
    past: FloatArray,
    values: FloatArray,
    spread: FloatArray,
    weights: FloatArray,
    factors: FloatArray,
    variances: FloatArray,
    squares: FloatArray,
    rows: FloatArray,
) -> bool:
    """Filter values as `convolve_uncertain` does, and fill in rows about the filter's correction.

    The rows are the correction, u by the weights, and what the filter adds to u of the values.
    False, with nothing changed, if a value or its u isn't a number.
    """
    for i in range(values.size):
        if not (np.isfinite(values[i]) and 0.0 <= spread[i] < np.inf):
            return False
    found, by_weights, by_values = convolve_uncertain(
        past, values, spread, weights, factors, variances, squares
    )
    for i in range(values.size):
        rows[0, i] = found[i] - values[i]
        rows[1, i] = np.sqrt(by_weights[i])
        noise = np.sqrt(by_values[i])
        rows[2, i] = np.sqrt(max(noise * noise - spread[i] * spread[i], 0.0))
    return True
