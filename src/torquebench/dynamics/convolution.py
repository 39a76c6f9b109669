"""Sums of the filters in a fixed order, so that results don't depend on a stream's blocks."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["convolve", "convolve_uncertain"]

FloatArray = NDArray[np.float64]

_BLOCK = 4096
"""Number of samples whose sums fit a processor's cache."""


def convolve(extended: FloatArray, weights: FloatArray) -> FloatArray:
    """Return Σ weights[k]·x[n − k]; `extended` begins with the weights.size − 1 earlier values."""
    past = weights.size - 1
    count = extended.size - past
    if count <= weights.size:  # terms in rows of samples; `accumulate` adds them one by one
        shape = (count, weights.size)
        windows: FloatArray = np.ndarray(shape, np.float64, extended, 0, extended.strides * 2)
        return np.add.accumulate(windows[:, ::-1] * weights, axis=1)[:, -1].copy()
    result = np.zeros(count)
    for first in range(0, count, _BLOCK):
        part = result[first : first + _BLOCK]
        for k, weight in enumerate(weights.tolist()):
            start = first + past - k
            part += weight * extended[start : start + part.size]
    return result


def convolve_uncertain(
    past: FloatArray,
    values: FloatArray,
    spread: FloatArray,
    weights: FloatArray,
    factors: FloatArray,
    variances: FloatArray,
    squares: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Filter values; return them with the variances due to the weights and to the values.

    Parameters
    ----------
    past : float64[2, m - 1]
        Earlier values and their variances; changed in place.
    values, spread : float64[n]
        The next values and their standard uncertainties.
    weights, squares : float64[m]
        Weights of the values, and of their variances.
    factors, variances : float64[r, m], float64[m]
        Factors of the weights' covariance (no rows if the weights aren't correlated), and their
        variances.
    """
    extended = np.concatenate((past[0], values))
    own = np.concatenate((past[1], spread * spread))
    if factors.shape[0]:
        by_weights = np.zeros(values.size)
        for row in factors:
            by_weights += np.square(convolve(extended, row))
    else:
        by_weights = convolve(extended * extended, variances)
    past[0], past[1] = extended[values.size :], own[values.size :]
    return convolve(extended, weights), by_weights, convolve(own, squares)
