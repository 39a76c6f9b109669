"""The sources' network 1-50-1 (tanh, linear): starts, values, Jacobian, uncertainty of its curve.

Two trainings share it: plain gradient descent as published (`published_network`) and
Levenberg-Marquardt with Bayesian regularisation (`bayesian_network`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from torquebench.compensation.base import FloatArray
from torquebench.compensation.state import storable

__all__ = [
    "GROUPS",
    "NetworkParameters",
    "SpanScaling",
    "hidden_values",
    "jacobian",
    "network_values",
    "nguyen_widrow_start",
    "posterior_factor",
    "posterior_variance",
    "rounding",
    "small_uniform_start",
    "tangent_kernels",
]

GROUPS = ("input weights", "hidden biases", "output weights and bias")
"""Groups of parameters with a common prior precision."""


@storable
@dataclass(frozen=True)
class SpanScaling:
    """Linear map of a span onto -1 to 1, as MATLAB's mapminmax.

    Attributes
    ----------
    low, high : float
        Ends of the span.

    Examples
    --------
    >>> SpanScaling(0.0, 10.0).to_unit(np.array([0.0, 5.0, 10.0]))
    array([-1.,  0.,  1.])
    """

    low: float
    high: float

    @classmethod
    def of(cls, values: FloatArray) -> SpanScaling:
        """Return the scaling of the span of values; a single value gets the span 1."""
        low, high = float(np.min(values)), float(np.max(values))
        return cls(low, high) if high > low else cls(low - 0.5, high + 0.5)

    @property
    def half_span(self) -> float:
        """Half of the span, in the unit of the values."""
        return 0.5 * (self.high - self.low)

    def to_unit(self, values: FloatArray) -> FloatArray:
        """Map values onto -1 to 1."""
        return (values - 0.5 * (self.low + self.high)) / self.half_span

    def from_unit(self, scaled: FloatArray) -> FloatArray:
        """Map values back."""
        return scaled * self.half_span + 0.5 * (self.low + self.high)


@storable
@dataclass(frozen=True)
class NetworkParameters:
    """Weights and biases of a network with one input, one hidden layer and one output.

    Attributes
    ----------
    input_weights, hidden_biases, output_weights : float64 array of shape (hidden,)
    output_bias : float
    """

    input_weights: FloatArray
    hidden_biases: FloatArray
    output_weights: FloatArray
    output_bias: float

    @property
    def flat(self) -> FloatArray:
        """All 3·hidden + 1 parameters in the order of the attributes."""
        return np.concatenate(
            [self.input_weights, self.hidden_biases, self.output_weights, [self.output_bias]]
        )

    @classmethod
    def from_flat(cls, flat: FloatArray) -> NetworkParameters:
        """Undo `flat`."""
        hidden = (flat.size - 1) // 3
        return cls(
            flat[:hidden].copy(),
            flat[hidden : 2 * hidden].copy(),
            flat[2 * hidden : -1].copy(),
            float(flat[-1]),
        )


def nguyen_widrow_start(
    generator: np.random.Generator, hidden: int, size: float = 1.0
) -> NetworkParameters:
    """Draw start weights that spread the hidden neurons evenly over the input from -1 to 1.

    D. Nguyen, B. Widrow, IJCNN 1990, vol. 3, 21-26: input weights of size 0.7·hidden. MATLAB's
    initnw multiplies them by the half-span 2 of the active region of tansig.

    Parameters
    ----------
    generator : numpy.random.Generator
        Source of the signs and output weights.
    hidden : int
        Number of hidden neurons.
    size : float, default 1
        Factor on the input weights: 2 as in MATLAB, below 1 for a smoother start.

    Returns
    -------
    start : NetworkParameters
    """
    slope = 0.7 * hidden * size
    signs = generator.choice([-1.0, 1.0], hidden)
    positions = np.linspace(-1.0, 1.0, hidden) if hidden > 1 else np.zeros(1)
    output_weights = generator.uniform(-1.0, 1.0, hidden)
    output_bias = float(generator.uniform(-1.0, 1.0))
    return NetworkParameters(slope * signs, slope * positions * signs, output_weights, output_bias)


def small_uniform_start(
    generator: np.random.Generator, hidden: int, half_span: float = 0.5
) -> NetworkParameters:
    """Draw all start weights and biases evenly from a small interval about 0.

    Parameters
    ----------
    generator : numpy.random.Generator
        Source of the draws.
    hidden : int
        Number of hidden neurons.
    half_span : float, default 0.5
        Largest size of a weight.

    Returns
    -------
    start : NetworkParameters
    """
    return NetworkParameters.from_flat(generator.uniform(-half_span, half_span, 3 * hidden + 1))


def hidden_values(parameters: NetworkParameters, x: FloatArray) -> FloatArray:
    """Return the outputs of the hidden neurons, shape (n, hidden), for scaled inputs x."""
    activation = np.multiply.outer(x, parameters.input_weights)
    activation += parameters.hidden_biases
    return np.asarray(np.tanh(activation, out=activation))


def network_values(parameters: NetworkParameters, x: FloatArray) -> FloatArray:
    """Return the outputs of the network, shape (n,), for scaled inputs x.

    Examples
    --------
    >>> one = NetworkParameters(np.ones(1), np.zeros(1), np.array([2.0]), 0.5)
    >>> network_values(one, np.array([0.0])).tolist()
    [0.5]
    """
    # Summed row by row, so that a value doesn't depend on the number of others in the call.
    weighted = hidden_values(parameters, x) * parameters.output_weights
    return np.asarray(weighted.sum(axis=1) + parameters.output_bias)


def jacobian(
    parameters: NetworkParameters, x: FloatArray, hidden: FloatArray | None = None
) -> FloatArray:
    """Return the derivatives of the outputs by all parameters, shape (n, 3·hidden + 1).

    Parameters
    ----------
    parameters : NetworkParameters
    x : float64 array of shape (n,)
        Scaled inputs.
    hidden : float64 array of shape (n, hidden), optional
        From `hidden_values`, where already known.

    Returns
    -------
    derivatives : float64 array
        Columns in the order of `NetworkParameters.flat`.
    """
    t = hidden_values(parameters, x) if hidden is None else hidden
    slope = (1.0 - t * t) * parameters.output_weights
    return np.concatenate([slope * x[:, None], slope, t, np.ones((x.size, 1))], axis=1)


def tangent_kernels(parameters: NetworkParameters, x: FloatArray, hidden: FloatArray) -> FloatArray:
    """Return J_g J_gᵀ of each group of parameters, without forming J.

    One input makes the first two share one product: rows of the input weights' part are those of
    the hidden biases' part times x.

    Parameters
    ----------
    parameters : NetworkParameters
    x : float64 array of shape (n,)
        Scaled inputs.
    hidden : float64 array of shape (n, hidden)
        From `hidden_values`.

    Returns
    -------
    kernels : float64 array of shape (3, n, n)
        In the order of `GROUPS`.
    """
    slope = (1.0 - hidden * hidden) * parameters.output_weights
    kernels = np.empty((len(GROUPS), x.size, x.size))
    np.matmul(slope, slope.T, out=kernels[1])
    np.multiply(kernels[1], np.multiply.outer(x, x), out=kernels[0])
    np.matmul(hidden, hidden.T, out=kernels[2])
    kernels[2] += 1.0
    return kernels


def rounding(diagonal: FloatArray) -> float:
    """Return a matrix's rounding error by its diagonal, which keeps it positive definite."""
    return float(4.0 * diagonal.size * np.finfo(np.float64).eps * np.max(diagonal))


def posterior_factor(
    parameters: NetworkParameters,
    x: FloatArray,
    weights: FloatArray,
    precisions: FloatArray,
    noise_variance: float,
) -> FloatArray:
    """Return the Cholesky factor of the Gauss-Newton Hessian JᵀWJ/σ² + A of the posterior.

    Parameters
    ----------
    parameters : NetworkParameters
        Where the posterior has its maximum.
    x, weights : float64 array of shape (n,)
        Scaled inputs and weights of the calibration points.
    precisions : float64 array of shape (3,)
        Prior precision of each of `GROUPS`.
    noise_variance : float
        σ² of a point of weight 1, in scaled units.

    Returns
    -------
    factor : float64 array of shape (3·hidden + 1, 3·hidden + 1)
        Lower triangular.
    """
    J = jacobian(parameters, x)
    hessian = (J.T * (weights / noise_variance)) @ J
    hidden = parameters.input_weights.size
    diagonal = hessian.reshape(-1)[:: len(hessian) + 1]
    diagonal += np.repeat(precisions, [hidden, hidden, hidden + 1])
    diagonal += rounding(diagonal)
    return np.asarray(np.linalg.cholesky(hessian), dtype=np.float64)


def posterior_variance(
    parameters: NetworkParameters, factor: FloatArray, x: FloatArray
) -> FloatArray:
    """Return the variance of the network's curve at scaled inputs x, in scaled units squared.

    Parameters
    ----------
    parameters : NetworkParameters
    factor : float64 array
        From `posterior_factor`.
    x : float64 array of shape (n,)

    Returns
    -------
    variance : float64 array of shape (n,)
        gᵀ H⁻¹ g with the gradient g of the output (D. J. C. MacKay, Neural Computation 4 (1992)
        448-472).
    """
    whitened = solve_triangular(factor, jacobian(parameters, x).T, lower=True)
    return np.asarray(np.sum(whitened**2, axis=0))
