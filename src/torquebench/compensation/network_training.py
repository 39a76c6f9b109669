"""The sources' network 1-50-1 (tanh, linear): starts, values, derivatives and both trainings.

Levenberg-Marquardt with Bayesian regularisation follows D. J. C. MacKay, Neural Computation 4
(1992) 415-472; F. D. Foresee, M. T. Hagan, ICNN 1997, 1930-1935; M. T. Hagan, M. B. Menhaj, IEEE
Trans. Neural Networks 5 (1994) 989-993. With fewer points than parameters every system is solved in
the dimension of the points.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import tau

import numpy as np
from scipy.linalg import lapack

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.state import storable

GROUPS = ("input weights", "hidden biases", "output weights and bias")
"""Groups of parameters with a common prior precision."""
_FIRST_DAMPING = 10.0  # factor on the precisions that keeps the first steps close to the start
_LARGEST_DAMPING = 1e10
_LEAST_NOISE_VARIANCE = 1e-12  # in scaled units: avoids division by zero for data without noise


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
        """Rebuild the parameters from `flat`."""
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
    x : float64 array of shape (n,)
        Scaled inputs.
    hidden : float64 array of shape (n, hidden), optional
        Result of `hidden_values`, if already calculated.

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

    With one input, the first two groups share a product: rows of the input weights' part are those
    of the hidden biases' part times x.

    Parameters
    ----------
    x : float64 array of shape (n,)
        Scaled inputs.
    hidden : float64 array of shape (n, hidden)
        From `hidden_values`.

    Returns
    -------
    kernels : float64 array of shape (3, n, n)
        Kernels in the order of `GROUPS`.
    """
    slope = (1.0 - hidden * hidden) * parameters.output_weights
    kernels = np.empty((len(GROUPS), x.size, x.size))
    np.matmul(slope, slope.T, out=kernels[1])
    np.multiply(kernels[1], np.multiply.outer(x, x), out=kernels[0])
    np.matmul(hidden, hidden.T, out=kernels[2])
    kernels[2] += 1.0
    return kernels


def rounding(diagonal: FloatArray) -> float:
    """Return a diagonal term above a matrix's rounding errors, which keeps it positive definite."""
    return float(4.0 * diagonal.size * np.finfo(np.float64).eps * np.max(diagonal))


def descend(
    network: NetworkParameters,
    x: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    rate: float,
    epochs: int,
) -> NetworkParameters:
    """Return a network after epochs of batch gradient descent on the mean square error."""
    flat = network.flat
    hidden = network.input_weights.size
    try:
        from torquebench.compensation.compiled_descent import descend as compiled
    except ModuleNotFoundError:  # Numba isn't installed
        _descend(flat, x, target, weights, rate, epochs)
    else:
        parts = flat[:hidden], flat[hidden : 2 * hidden], flat[2 * hidden : -1]
        flat[-1] = compiled(x, target, weights, *parts, flat[-1], rate, epochs)
    return NetworkParameters.from_flat(flat)


def _descend(
    flat: FloatArray,
    x: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    rate: float,
    epochs: int,
) -> None:
    """Change a network's parameters in place, by gradient descent on the squared errors.

    `first` are the hidden neurons' input weights and biases, `second` the output weights.
    """
    hidden = (flat.size - 1) // 3
    first, second = flat[: 2 * hidden].reshape(2, hidden), flat[2 * hidden : -1]
    inputs = np.stack((x, np.ones_like(x)), axis=1)
    step = 2.0 * rate / x.size
    outputs, squares = np.empty((2, x.size, hidden))
    errors = np.empty((2, x.size))  # by input and by bias
    error = errors[1]
    for _ in range(epochs):
        np.tanh(np.dot(inputs, first, out=outputs), out=outputs)
        np.dot(outputs, second, out=error)
        error += flat[-1] - target
        error *= weights
        np.multiply(error, x, out=errors[0])
        np.multiply(outputs, outputs, out=squares)
        # The derivative of tanh is 1 - tanh².
        back = np.add.reduce(errors, axis=1)
        slope = back[:, None] - np.dot(errors, squares)
        flat[-1] -= step * back[1]
        by_output = np.dot(error, outputs)
        first -= step * second * slope
        second -= step * by_output


def determined_parameters(
    network: NetworkParameters,
    start: NetworkParameters,
    x: FloatArray,
    residual: FloatArray,
    weights: FloatArray,
) -> tuple[float, float]:
    """Return the effective number of parameters, and the noise variance of a point of weight 1.

    MacKay's rules are applied to the linearised network, with the change of the weights since the
    start as a measure of their prior variance.
    """
    J = jacobian(network, x) * np.sqrt(weights)[:, None]
    values = np.maximum(np.linalg.eigvalsh(J @ J.T if x.size < J.shape[1] else J.T @ J), 0.0)
    way = float(np.sum((network.flat - start.flat) ** 2))
    squares = float(np.sum(weights * residual**2))
    determined = 0.5 * min(x.size, values.size)
    for _ in range(100):
        noise_variance = max(squares / (x.size - determined), 1e-12)
        precision = determined / max(way, 1e-12)
        before = determined
        determined = float(np.sum(values / (values + noise_variance * precision)))
        if abs(determined - before) < 1e-6:
            break
    return determined, noise_variance


@dataclass(frozen=True)
class NetworkMember:
    """One trained network of the ensemble, in scaled units.

    Attributes
    ----------
    parameters : NetworkParameters
        Parameters at the maximum of the posterior.
    precisions : float64 array of shape (3,)
        Prior precision of input weights, hidden biases, output weights.
    noise_variance : float
        Noise variance of a point of weight 1.
    effective_parameters : float
        γ, the number of parameters that the data determine.
    log_evidence : float
        Logarithm of the marginal likelihood (Laplace).
    iterations : int
        Levenberg-Marquardt steps.
    """

    parameters: NetworkParameters
    precisions: FloatArray
    noise_variance: float
    effective_parameters: float
    log_evidence: float
    iterations: int


class _Problem:
    """Errors and derivatives at the current weights, for the next step and for the evidence.

    With fewer points n than parameters p the systems are solved in n dimensions (Woodbury) with
    the tangent kernels J_g J_gᵀ, else in p dimensions with the Gauss-Newton Hessian.
    """

    def __init__(self, x: FloatArray, target: FloatArray, weights: FloatArray, hidden: int) -> None:
        self.x, self.target = x, target
        self.root_weights = np.sqrt(weights)
        self.count, self.hidden = x.size, hidden
        self.sizes = np.array([hidden, hidden, hidden + 1])
        self.starts = np.array([0, hidden, 2 * hidden])
        self.in_points = self.count < 3 * hidden + 1

    def move_to(self, flat: FloatArray) -> None:
        """Evaluate the network, the errors and their squares at new weights."""
        self.flat = flat
        self.parameters = NetworkParameters.from_flat(flat)
        self.hidden_outputs = hidden_values(self.parameters, self.x)
        output = self.hidden_outputs @ self.parameters.output_weights + flat[-1]
        self.errors = self.root_weights * (self.target - output)
        self.squares = float(self.errors @ self.errors)
        self.weight_squares = np.add.reduceat(flat * flat, self.starts)

    def linearise(self) -> None:
        """Evaluate the Jacobian and Jᵀe, then the tangent kernels in n dimensions, or JᵀJ in p."""
        self.J = jacobian(self.parameters, self.x, self.hidden_outputs)
        self.J *= self.root_weights[:, None]
        self.pull = self.J.T @ self.errors
        if self.in_points:
            kernels = tangent_kernels(self.parameters, self.x, self.hidden_outputs)
            kernels *= np.multiply.outer(self.root_weights, self.root_weights)
            self.kernels = kernels.reshape(len(GROUPS), -1)
        else:
            self.normal = self.J.T @ self.J

    def _factor(self, precisions: FloatArray, noise_variance: float) -> FloatArray:
        """Lower Cholesky factor of K + σ²I, or of JᵀJ/σ² + A."""
        if self.in_points:
            system = ((1.0 / precisions) @ self.kernels).reshape(self.count, self.count)
            system.reshape(-1)[:: self.count + 1] += noise_variance
        else:
            system = self.normal / noise_variance
            system.reshape(-1)[:: self.flat.size + 1] += precisions.repeat(self.sizes)
        diagonal = system.reshape(-1)[:: len(system) + 1]
        diagonal += rounding(diagonal)  # noise-free repeats give equal rows
        factor, info = lapack.dpotrf(system.T, lower=1, clean=1, overwrite_a=1)
        if info != 0:
            raise np.linalg.LinAlgError
        return np.asarray(factor)

    def step(self, precisions: FloatArray, noise_variance: float, damping: float) -> FloatArray:
        """Solve (JᵀJ/σ² + (1 + μ) A) δ = Jᵀe/σ² − A w."""
        right = self.pull / noise_variance - precisions.repeat(self.sizes) * self.flat
        damped = precisions * (1.0 + damping)
        factor = self._factor(damped, noise_variance)
        if not self.in_points:
            return np.asarray(lapack.dpotrs(factor, right, lower=1)[0])
        inverse = (1.0 / damped).repeat(self.sizes)
        shrunk = right * inverse
        solved = lapack.dpotrs(factor, self.J @ shrunk, lower=1)[0]
        return np.asarray(shrunk - inverse * (self.J.T @ solved))

    def determined(self, precisions: FloatArray, noise_variance: float) -> tuple[FloatArray, float]:
        """Return γ of each group and log det(K + σ²I)."""
        factor = self._factor(precisions, noise_variance)
        log_determinant = 2.0 * float(np.log(factor.diagonal()).sum())
        inverse = lapack.dpotri(factor, lower=1, overwrite_c=1)[0]
        diagonal = inverse.diagonal()
        if self.in_points:
            # Σ over both triangles of a symmetric product; only the lower one is filled.
            both = 2.0 * (self.kernels @ inverse.T.reshape(-1))
            both -= self.kernels[:, :: self.count + 1] @ diagonal
            return both / precisions, log_determinant
        gamma = self.sizes - precisions * np.add.reduceat(diagonal, self.starts)
        log_determinant += self.count * np.log(noise_variance)
        log_determinant -= float(self.sizes @ np.log(precisions))
        return gamma, log_determinant


def train_member(
    x: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    start: NetworkParameters,
    iterations: int,
    tolerance: float,
) -> NetworkMember:
    """Train one network by Levenberg-Marquardt, re-estimating precisions and noise at every step.

    Minimises Σ w e²/σ² + Σ_g α_g‖w_g‖² and sets α_g = γ_g/‖w_g‖², σ² = Σ w e²/(n − Σγ_g) after
    every accepted step (MacKay's rules in the Gauss-Newton form of Foresee and Hagan), with a
    separate precision for each group of weights.

    Parameters
    ----------
    x, target, weights : float64 array of shape (n,)
        Scaled inputs and targets, weights of the points.
    start : NetworkParameters
        Start weights.
    iterations : int
        Largest number of steps.
    tolerance : float
        Ends when objective, precisions and noise change by less than this share.
    """
    hidden = start.input_weights.size
    problem, trial = (_Problem(x, target, weights, hidden) for _ in range(2))
    problem.move_to(start.flat)
    problem.linearise()
    precisions = 0.5 * problem.sizes / np.maximum(problem.weight_squares, 1e-12)
    noise_variance = max(problem.squares / x.size, 1e-3)
    damping, done = _FIRST_DAMPING, 0
    gamma, log_determinant = problem.determined(precisions, noise_variance)
    while done < iterations:
        objective = float(problem.squares / noise_variance + precisions @ problem.weight_squares)
        improvement, rejected = 0.0, False
        while damping <= _LARGEST_DAMPING:
            trial.move_to(problem.flat + problem.step(precisions, noise_variance, damping))
            reached = float(trial.squares / noise_variance + precisions @ trial.weight_squares)
            if reached <= objective:
                improvement = (objective - reached) / objective
                break
            damping, rejected = 10.0 * damping, True
        else:
            break
        done += 1
        if not rejected:
            damping = max(0.1 * damping, 1e-12)
        problem, trial = trial, problem
        problem.linearise()
        gamma, log_determinant = problem.determined(precisions, noise_variance)
        before = np.append(precisions, noise_variance)
        precisions = np.maximum(gamma, 1e-3) / np.maximum(problem.weight_squares, 1e-12)
        freedom = max(x.size - float(np.sum(gamma)), 0.5)
        noise_variance = max(problem.squares / freedom, _LEAST_NOISE_VARIANCE)
        change = np.max(np.abs(np.log(np.append(precisions, noise_variance) / before)))
        if improvement < tolerance and change < tolerance:
            break
    gamma, log_determinant = problem.determined(precisions, noise_variance)
    fit = problem.squares / noise_variance + precisions @ problem.weight_squares
    log_evidence = -0.5 * float(fit + log_determinant + x.size * np.log(tau))
    return NetworkMember(
        parameters=problem.parameters,
        precisions=precisions,
        noise_variance=float(noise_variance),
        effective_parameters=float(np.sum(gamma)),
        log_evidence=log_evidence,
        iterations=done,
    )
