"""Sums of the filters in a fixed order, so that results don't depend on a stream's blocks."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_BLOCK = 4096
"""Number of samples whose sums fit a processor's cache."""


def convolve(extended: FloatArray, weights: FloatArray) -> FloatArray:
    """Return Σ weights[k]·x[n − k] of rows with their own weights.

    Parameters
    ----------
    extended : float64 array of shape (rows, m - 1 + n)
        Begins with the m − 1 values before.
    weights : float64 array of shape (rows, m)

    Returns
    -------
    float64 array of shape (rows, n)
    """
    rows, past = len(weights), weights.shape[1] - 1
    count = extended.shape[1] - past
    if count <= past + 1:  # terms in rows of samples; `accumulate` adds them one by one
        contiguous = np.ascontiguousarray(extended)
        along, step = contiguous.strides
        shape = (rows, count, past + 1)
        windows: FloatArray = np.ndarray(shape, np.float64, contiguous, 0, (along, step, step))
        terms = windows[..., ::-1] * weights[:, None]
        return np.asarray(np.add.accumulate(terms, axis=2)[..., -1])
    result = np.zeros((rows, count))
    for total, values, row in zip(result, extended, weights.tolist(), strict=True):
        for first in range(0, count, _BLOCK):
            part = total[first : first + _BLOCK]
            for k, weight in enumerate(row):
                start = first + past - k
                part += weight * values[start : start + part.size]
    return result


def convolve_uncertain(
    past: FloatArray,
    values: FloatArray,
    spread: FloatArray,
    weights: FloatArray,
    factors: FloatArray,
) -> tuple[FloatArray, ...]:
    """Filter values; return them with the variances due to the weights and to the values.

    Parameters
    ----------
    past : float64[2, m - 1]
        Earlier values and their variances; changed in place.
    values, spread : float64[n]
        The next values and their standard uncertainties.
    weights : float64[3, m]
        Weights of the values, those of their variances, and the weights' own variances.
    factors : float64[r, m]
        Factors of the weights' covariance (no rows if the weights aren't correlated).
    """
    remembered = past.shape[1]
    extended = np.empty((3, remembered + values.size))
    extended[:2, :remembered] = past
    extended[0, remembered:], extended[1, remembered:] = values, spread * spread
    past[:] = extended[:2, values.size :]
    np.multiply(extended[0], extended[0], out=extended[2])
    value, noise, by_weights = convolve(extended, weights)
    if factors.shape[0]:
        repeated = np.broadcast_to(extended[0], (len(factors), extended.shape[1]))
        by_weights = np.add.accumulate(np.square(convolve(repeated, factors)), axis=0)[-1]
    return value, by_weights, noise
