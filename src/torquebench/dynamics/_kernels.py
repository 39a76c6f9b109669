"""Loops of the filters; sums have one order, so that results don't depend on a stream's blocks."""

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import inner, kernel

__all__ = ["convolve", "convolve_uncertain", "correct_uncertain", "run_recursive"]

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


@inner
def _dot(left: FloatArray, right: FloatArray) -> float:
    total = 0.0
    for i in range(left.size):
        total += left[i] * right[i]
    return total


@kernel
def _form(vector: FloatArray, matrix: FloatArray) -> float:
    total = 0.0
    for i in range(vector.size):
        total += vector[i] * _dot(matrix[i], vector)
    return total


@inner
def _shift(matrix: FloatArray, row: FloatArray) -> None:
    """Move all rows up by one, and write the last."""
    for i in range(matrix.shape[0] - 1):
        matrix[i] = matrix[i + 1]
    matrix[matrix.shape[0] - 1] = row


@kernel
def run_recursive(
    numerator: FloatArray,
    denominator: FloatArray,
    covariance: FloatArray,
    state: FloatArray,
    derivative: FloatArray,
    spread: FloatArray,
    values: FloatArray,
    uncertainty: FloatArray,
    filtered: FloatArray,
    of_coefficients: FloatArray,
    of_noise: FloatArray,
) -> None:
    """Run a recursive filter in state space with its uncertainty.

    Link and Elster, Meas. Sci. Technol. 20 (2009) 055104, equations 6, 7, 12, 13 and 15-18. The
    system matrix is a shift with −a in its last row, so that products with it are shifts too.

    Parameters
    ----------
    numerator, denominator : float64[p + 1]
        b and a of one length, a[0] = 1.
    covariance : float64[2p + 1, 2p + 1]
        Of (a₁ … a_p, b₀ … b_p); empty for exact coefficients.
    state, derivative, spread : float64[p], float64[p, p], float64[p, p]
        State, its derivatives with respect to a, its covariance by noise; changed in place.
    values, uncertainty : float64[n]
        Input with its standard uncertainties.
    filtered, of_coefficients, of_noise : float64[n]
        Output and its two variances, written.
    """
    p = state.size
    b0 = numerator[0]
    output, last = np.empty(p), np.empty(p)
    for i in range(p):
        last[i] = -denominator[p - i]
        output[i] = numerator[p - i] - b0 * denominator[p - i]
    sensitivity, row = np.zeros(2 * p + 1), np.empty(p)
    turned = np.empty((p, p))
    for n in range(values.size):
        filtered[n] = _dot(output, state) + b0 * values[n]
        of_noise[n] = _form(output, spread) + (b0 * uncertainty[n]) ** 2
        of_coefficients[n] = 0.0
        if covariance.size:
            for k in range(p):
                sensitivity[k] = _dot(output, derivative[:, k]) - b0 * state[p - 1 - k]
                sensitivity[p + 1 + k] = state[p - 1 - k]
            sensitivity[p] = _dot(last, state) + values[n]
            of_coefficients[n] = _form(sensitivity, covariance)
        if p:
            for k in range(p):
                row[k] = _dot(last, derivative[:, k]) - state[p - 1 - k]
            _shift(derivative, row)
            for k in range(p):
                row[k] = _dot(last, spread[:, k])
            turned[:] = spread
            _shift(turned, row)
            for k in range(p):
                row[k] = _dot(last, turned[k])
            spread[:, : p - 1] = turned[:, 1:]
            spread[:, p - 1] = row
            spread[p - 1, p - 1] += uncertainty[n] ** 2
            entered = _dot(last, state) + values[n]
            state[: p - 1] = state[1:]
            state[p - 1] = entered
