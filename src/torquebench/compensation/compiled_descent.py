"""Batch gradient descent of a network, compiled for the papers' study, which runs it many times.

Without Numba, `network_training.descend` does the same with NumPy in twice the time.
"""

from math import factorial

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import kernel

FloatArray = NDArray[np.float64]

_SERIES = tuple(1.0 / factorial(power) for power in range(13, -1, -1))
"""Taylor's series of the exponential, highest power first."""


@kernel(fastmath=True, error_model="numpy", nogil=True)
def descend(
    x: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    input_weights: FloatArray,
    hidden_biases: FloatArray,
    output_weights: FloatArray,
    output_bias: float,
    rate: float,
    epochs: int,
) -> float:
    """Run epochs of batch gradient descent on the mean square; arrays change in place.

    Return the output's bias.

    The hyperbolic tangent is 1 − 2/(e²ᶻ + 1) with the exponential from Taylor's series at z/32,
    squared six times, so that the compiler can run it on whole vectors: four times as fast.
    """
    hidden = input_weights.size
    t = np.empty((x.size, hidden))
    error = np.empty(x.size)
    step = 2.0 * rate / x.size
    for _ in range(epochs):
        for i in range(x.size):
            output = output_bias
            for h in range(hidden):
                z = input_weights[h] * x[i] + hidden_biases[h]
                r = min(max(z, -20.0), 20.0) / 32.0
                p = 0.0
                for coefficient in _SERIES:
                    p = coefficient + r * p
                p = p * p
                p = p * p
                p = p * p
                p = p * p
                p = p * p
                p = p * p
                t[i, h] = 1.0 - 2.0 / (p + 1.0)
            for h in range(hidden):
                output += t[i, h] * output_weights[h]
            error[i] = weights[i] * (output - target[i])
        by_output, by_bias, by_input = np.zeros(hidden), np.zeros(hidden), np.zeros(hidden)
        for i in range(x.size):
            for h in range(hidden):
                slope = error[i] * (1.0 - t[i, h] * t[i, h])
                by_output[h] += error[i] * t[i, h]
                by_bias[h] += slope
                by_input[h] += slope * x[i]
        output_bias -= step * error.sum()
        for h in range(hidden):
            back = step * output_weights[h]
            input_weights[h] -= back * by_input[h]
            hidden_biases[h] -= back * by_bias[h]
            output_weights[h] -= step * by_output[h]
    return output_bias
