"""The network 1-50-1 by Levenberg-Marquardt with Bayesian regularisation, as a small ensemble."""

from __future__ import annotations

from dataclasses import dataclass
from math import tau
from numbers import Integral, Real
from typing import ClassVar

import numpy as np
from scipy.linalg import lapack

from torquebench.compensation.base import CompensationModel, FloatArray
from torquebench.compensation.estimator import Between, OneOf, parameter
from torquebench.compensation.kinds import register
from torquebench.compensation.network import (
    GROUPS,
    NetworkParameters,
    SpanScaling,
    hidden_values,
    jacobian,
    network_values,
    nguyen_widrow_start,
    posterior_factor,
    posterior_variance,
    rounding,
    small_uniform_start,
    tangent_kernels,
)
from torquebench.compensation.state import storable
from torquebench.message import Message
from torquebench.progress import SHARES, Progress

__all__ = ["BayesianNetworkModel", "NetworkMember", "train_member"]

_FIRST_DAMPING = 10.0  # times the precisions: keeps the first steps close to the start
_LARGEST_DAMPING = 1e10
_LEAST_NOISE_VARIANCE = 1e-12  # in scaled units: avoids division by zero for data without noise
_NEGLIGIBLE_EVIDENCE = -20.0  # nats below the best start
_START_SIZES = (1.0, 0.25)  # in units of Nguyen and Widrow's: from fine to smooth


@storable
@dataclass(frozen=True)
class NetworkMember:
    """One trained network of the ensemble, in scaled units.

    Attributes
    ----------
    parameters : NetworkParameters
        Where the posterior has its maximum.
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
    """State at the current weights for the next step and the evidence.

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
        """Evaluate the Jacobian and its products."""
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

    Returns
    -------
    member : NetworkMember
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


@register("bayesian-network")
class BayesianNetworkModel(CompensationModel):
    """The source papers' network 1-50-1 with Bayesian regularisation.

    Levenberg-Marquardt with an analytic Jacobian, Bayesian regularisation, and a few starts of
    different smoothness, averaged by their evidence. More neurons than points do no harm: the
    effective number of parameters is inferred.

    Parameters
    ----------
    ensemble : int, default 3
        Number of starts whose curves are averaged.
    start : {"nguyen-widrow", "small-uniform"}, default "nguyen-widrow"
        Start weights: evenly spread neurons, with input weights from Nguyen and Widrow's size down
        to a quarter of it over the ensemble; or all within ±0.5.
    hidden : int, default 50
        Hidden neurons.
    iterations : int, default 20
        Largest number of Levenberg-Marquardt steps of each start. Hundreds more raise the evidence
        a little further, but not the accuracy.
    tolerance : float, default 1e-3
        Relative change of objective, precisions and noise below which training ends.
    random_state : int, default 0
        Seed of the starts.
    range_nm, range_margin, outliers
        See `CompensationModel`.

    Attributes
    ----------
    members_ : list of NetworkMember
        The trained networks; starts with negligible evidence relative to the best are dropped.
    shares_ : float64 array
        Share of each member, in proportion to its evidence.
    log_evidence_ : float
        Largest log evidence of the members.

    Notes
    -----
    D. J. C. MacKay, Neural Computation 4 (1992) 415-472; F. D. Foresee, M. T. Hagan, ICNN 1997,
    1930-1935; M. T. Hagan, M. B. Menhaj, IEEE Trans. Neural Networks 5 (1994) 989-993. With fewer
    points than parameters every system is solved in the dimension of the points. The curve's
    variance is gᵀH⁻¹g of each member plus the members' spread about their mean.

    Examples
    --------
    >>> import numpy as np
    >>> reading = np.linspace(-2000.0, 2000.0, 41)
    >>> standard = reading + 2.0 + 1e-3 * reading + 1e-6 * reading**2
    >>> model = BayesianNetworkModel().fit(reading[:, None], standard)
    >>> model.predict([[1000.0]]).round(1)
    array([1004.])
    """

    ensemble: int = parameter(3, Between(Integral, 1, 100))
    start: str = parameter("nguyen-widrow", OneOf(frozenset({"nguyen-widrow", "small-uniform"})))
    hidden: int = parameter(50, Between(Integral, 1, 1000))
    iterations: int = parameter(20, Between(Integral, 1))
    tolerance: float = parameter(1e-3, Between(Real, 0, 1, open_high=True))
    random_state: int = parameter(0, Between(Integral, 0))

    complexity: ClassVar[int] = 30
    maximum_points: int | None = 600

    members_: list[NetworkMember]
    input_scaling_: SpanScaling
    output_scaling_: SpanScaling

    def _minimum_points(self) -> int:
        return 5

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, progress: Progress) -> None:
        reading = X[:, 0]
        self.input_scaling_ = SpanScaling.of(reading)
        self.output_scaling_ = SpanScaling.of(y - reading)
        self.training_inputs_ = self.input_scaling_.to_unit(reading)
        self.training_weights_ = weights
        target = self.output_scaling_.to_unit(y - reading)
        members = []
        for number, start in enumerate(self._starts()):
            members.append(
                train_member(
                    self.training_inputs_, target, weights, start, self.iterations, self.tolerance
                )
            )
            done = number + 1
            progress.reach(
                SHARES * done // self.ensemble,
                Message("start {done} of {ensemble}", done, self.ensemble),
            )
        self.log_evidence_ = max(member.log_evidence for member in members)
        self.members_ = [
            member
            for member in members
            if member.log_evidence - self.log_evidence_ >= _NEGLIGIBLE_EVIDENCE
        ]
        odds = np.exp([member.log_evidence - self.log_evidence_ for member in self.members_])
        self.shares_ = odds / np.sum(odds)
        gamma = np.array([member.effective_parameters for member in self.members_])
        noise_variance = np.array([member.noise_variance for member in self.members_])
        self.effective_parameters_ = float(self.shares_ @ gamma)
        self.noise_nm_ = float(
            np.sqrt(self.shares_ @ noise_variance) * self.output_scaling_.half_span
        )
        self._after_restore()

    def _starts(self) -> list[NetworkParameters]:
        generator = np.random.default_rng(self.random_state)
        if self.start == "small-uniform":
            return [small_uniform_start(generator, self.hidden) for _ in range(self.ensemble)]
        sizes = np.geomspace(*_START_SIZES, self.ensemble)
        if self.ensemble == 1:
            sizes = np.sqrt(np.prod(_START_SIZES, keepdims=True))
        return [nguyen_widrow_start(generator, self.hidden, float(size)) for size in sizes]

    def _after_restore(self) -> None:
        self._factors = [
            posterior_factor(
                member.parameters,
                self.training_inputs_,
                self.training_weights_,
                member.precisions,
                member.noise_variance,
            )
            for member in self.members_
        ]

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        reading = X[:, 0]
        x = self.input_scaling_.to_unit(reading)
        curves = np.array([network_values(member.parameters, x) for member in self.members_])
        curve = np.sum(curves * self.shares_[:, None], axis=0)
        torque = reading + self.output_scaling_.from_unit(curve)
        if not return_std:
            return torque, None
        variances = np.array(
            [
                posterior_variance(member.parameters, factor, x)
                for member, factor in zip(self.members_, self._factors, strict=True)
            ]
        )
        variance = self.shares_ @ (variances + (curves - curve) ** 2)
        return torque, np.sqrt(variance) * self.output_scaling_.half_span
