"""Radial-basis network trained by a particle swarm and Levenberg-Marquardt."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral
from typing import ClassVar

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.discrepancy import FormModel
from torquebench.compensation.estimator import Between, parameter
from torquebench.compensation.kinds import register
from torquebench.compensation.network_training import SpanScaling
from torquebench.compensation.state import storable
from torquebench.message import Message
from torquebench.progress import SHARES, Progress

_WIDTH_LIMITS = (0.03, 2.0)  # width of Gaussians over -1 ... 1
_RIDGE_LIMITS = (1e-8, 1.0)
# Constriction coefficients of M. Clerc, J. Kennedy, IEEE Trans. Evol. Comp. 6 (2002) 58-73.
_INERTIA, _PULL = 0.7298, 1.4962


@storable
@dataclass(frozen=True)
class RadialBasis:
    """Gaussians in the scaled reading with their linear output layer.

    Attributes
    ----------
    centres, log_widths, amplitudes : float64 array of shape (neurons,)
    ridge : float
        Weight decay of the amplitudes, relative to the noise variance.
    """

    centres: FloatArray
    log_widths: FloatArray
    amplitudes: FloatArray
    bias: float
    ridge: float

    def neurons(self, x: FloatArray) -> FloatArray:
        """Return the Gaussians at scaled inputs x, shape (n, neurons)."""
        return _gaussians(x, self.centres, self.log_widths)

    def __call__(self, x: FloatArray) -> FloatArray:
        """Evaluate the network at scaled inputs x."""
        return np.asarray((self.neurons(x) * self.amplitudes).sum(axis=1) + self.bias)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Return the derivatives by centres, log widths, amplitudes and bias."""
        neurons = self.neurons(x)
        distance = (x[:, None] - self.centres) * np.exp(-self.log_widths)
        by_centre = self.amplitudes * neurons * distance * np.exp(-self.log_widths)
        by_width = self.amplitudes * neurons * distance**2
        return np.concatenate([by_centre, by_width, neurons, np.ones((x.size, 1))], axis=1)

    @property
    def flat(self) -> FloatArray:
        """All parameters in the order of `jacobian`."""
        return np.concatenate([self.centres, self.log_widths, self.amplitudes, [self.bias]])

    def moved(self, flat: FloatArray) -> RadialBasis:
        """Return the network with other parameters and the same ridge."""
        count = self.centres.size
        centres, log_widths, amplitudes = flat[:-1].reshape(3, count)
        log_widths = np.clip(log_widths, *np.log(_WIDTH_LIMITS))
        return RadialBasis(
            centres.copy(), log_widths, amplitudes.copy(), float(flat[-1]), self.ridge
        )


def _gaussians(x: FloatArray, centres: FloatArray, log_widths: FloatArray) -> FloatArray:
    """Return the neurons' outputs at x, (..., points, neurons), for one network or for many."""
    distance = (x[:, None] - centres[..., None, :]) * np.exp(-log_widths)[..., None, :]
    return np.asarray(np.exp(-0.5 * distance * distance))


@dataclass(frozen=True)
class _Solved:
    """Output layers of many networks at once, with their leave-one-out errors."""

    amplitudes: FloatArray
    biases: FloatArray
    left_out_squares: FloatArray


def _solve_outputs(
    x: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    centres: FloatArray,
    log_widths: FloatArray,
    ridge: FloatArray,
) -> _Solved:
    """Solve the ridge regression of the output layer for each of p networks.

    The mean square of the leave-one-out errors e/(1 − h) comes from the same factor.
    """
    root = np.sqrt(weights)
    design = np.concatenate(
        [_gaussians(x, centres, log_widths), np.ones((centres.shape[0], x.size, 1))], axis=2
    )
    design *= root[:, None]
    normal = design.transpose(0, 2, 1) @ design
    count = centres.shape[1]
    index = np.arange(count)
    normal[:, index, index] += ridge[:, None]
    normal[:, count, count] += 1e-9 * x.size
    solved = np.linalg.solve(normal, design.transpose(0, 2, 1))
    coefficients = solved @ (root * target)
    residual = root * target - (design @ coefficients[:, :, None])[:, :, 0]
    leverage = np.einsum("pnk,pkn->pn", design, solved)
    left_out = residual / np.maximum(1.0 - leverage, 1e-3)
    return _Solved(coefficients[:, :-1], coefficients[:, -1], np.mean(left_out**2, axis=1))


@register("radial-basis")
class RadialBasisModel(FormModel):
    """Gaussian radial-basis network, trained by a particle swarm, then by Levenberg-Marquardt.

    Each particle holds the centres and widths of all neurons and the weight decay of the output
    layer; the output layer is solved exactly. The swarm minimises the error at held-out points, not
    at the fitted points.

    Parameters
    ----------
    neurons : int, default 12
        Number of Gaussians; never more than a quarter of the points.
    particles : int, default 30
        Size of the swarm.
    swarm_steps : int, default 80
        Moves of the swarm.
    iterations : int, default 20
        Levenberg-Marquardt steps after it.
    random_state : int, default 0
        Seed of the swarm.
    range_nm, range_margin, outliers
        See `CompensationModel`.

    Attributes
    ----------
    left_out_rms_nm_ : float
        Root mean square error at held-out points, in N·m.

    Notes
    -----
    After the same group's later article, Computational Intelligence and Neuroscience 2022, 8155818
    (radial-basis network, particle swarm, Levenberg-Marquardt). The leave-one-out criterion is an
    addition.

    Examples
    --------
    >>> import numpy as np
    >>> reading = np.linspace(-2000.0, 2000.0, 41)
    >>> standard = reading + 2.0 + 1e-3 * reading + 1e-6 * reading**2
    >>> model = RadialBasisModel().fit(reading[:, None], standard)
    >>> model.predict([[1000.0]]).round(1)
    array([1004.])
    """

    neurons: int = parameter(Between(Integral, 1, 200), default=12)
    particles: int = parameter(Between(Integral, 2, 1000), default=30)
    swarm_steps: int = parameter(Between(Integral, 1), default=80)
    iterations: int = parameter(Between(Integral, 0), default=20)
    random_state: int = parameter(Between(Integral, 0), default=0)

    complexity: ClassVar[int] = 35

    def _minimum_points(self) -> int:
        return 8

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, progress: Progress) -> None:
        """Search widths and centres by a swarm, then by descent; keep the better network."""
        reading = X[:, 0]
        self.input_scaling_ = SpanScaling.of(reading)
        self.output_scaling_ = SpanScaling.of(y - reading)
        x = self.input_scaling_.to_unit(reading)
        target = self.output_scaling_.to_unit(y - reading)
        swarm_best = self._swarm(x, target, weights, progress)
        finished = self._descend(swarm_best, x, target, weights)
        self.network_, left_out = min(
            (self._with_outputs(network, x, target, weights) for network in (swarm_best, finished)),
            key=lambda candidate: candidate[1],
        )
        self.left_out_rms_nm_ = float(np.sqrt(left_out) * self.output_scaling_.half_span)
        self._count_parameters(x, target, weights)

    def _swarm(
        self, x: FloatArray, target: FloatArray, weights: FloatArray, progress: Progress
    ) -> RadialBasis:
        """Return the network with the least leave-one-out error in a particle swarm."""
        generator = np.random.default_rng(self.random_state)
        count = min(self.neurons, max(1, x.size // 4))
        low = np.concatenate(
            [
                np.full(count, -1.1),
                np.full(count, np.log(_WIDTH_LIMITS[0])),
                [np.log(_RIDGE_LIMITS[0])],
            ]
        )
        high = np.concatenate(
            [
                np.full(count, 1.1),
                np.full(count, np.log(_WIDTH_LIMITS[1])),
                [np.log(_RIDGE_LIMITS[1])],
            ]
        )
        position = low + (high - low) * generator.random((self.particles, low.size))
        # Evenly spread centres with one common width are a good start.
        spread = np.linspace(-1.0, 1.0, count)
        position[:, :count] = 0.5 * (spread + np.sort(position[:, :count], axis=1))
        position[:, count:-1] = np.log(np.geomspace(0.1, 1.0, self.particles))[:, None]
        velocity = 0.1 * (high - low) * generator.standard_normal(position.shape)
        own_best, own_value = position.copy(), np.full(self.particles, np.inf)
        for step in range(self.swarm_steps):
            value = _solve_outputs(
                x,
                target,
                weights,
                position[:, :count],
                position[:, count:-1],
                np.exp(position[:, -1]),
            ).left_out_squares
            better = value < own_value
            own_best[better], own_value[better] = position[better], value[better]
            best = own_best[int(np.argmin(own_value))]
            to_own, to_best = generator.random((2, *position.shape))
            velocity = (
                _INERTIA * velocity
                + _PULL * to_own * (own_best - position)
                + _PULL * to_best * (best - position)
            )
            position = position + velocity
            outside = (position < low) | (position > high)
            velocity[outside] *= -0.5
            position = np.clip(position, low, high)
            if step % 10 == 9:
                progress.reach(
                    SHARES * (step + 1) // self.swarm_steps, Message("swarm, step {step}", step + 1)
                )
        best = own_best[int(np.argmin(own_value))]
        network = RadialBasis(
            best[:count], best[count:-1], np.zeros(count), 0.0, float(np.exp(best[-1]))
        )
        return self._with_outputs(network, x, target, weights)[0]

    @staticmethod
    def _with_outputs(
        network: RadialBasis, x: FloatArray, target: FloatArray, weights: FloatArray
    ) -> tuple[RadialBasis, float]:
        """Solve the output layer of one network; return it and its leave-one-out mean square."""
        solved = _solve_outputs(
            x,
            target,
            weights,
            network.centres[None],
            network.log_widths[None],
            np.array([network.ridge]),
        )
        complete = RadialBasis(
            network.centres,
            network.log_widths,
            solved.amplitudes[0],
            float(solved.biases[0]),
            network.ridge,
        )
        return complete, float(solved.left_out_squares[0])

    def _descend(
        self, network: RadialBasis, x: FloatArray, target: FloatArray, weights: FloatArray
    ) -> RadialBasis:
        """Optimise all parameters by Levenberg-Marquardt on squared errors plus weight decay."""
        root, damping = np.sqrt(weights), 1e-2
        decay = self._decay(network)
        errors = root * (target - network(x))
        objective = errors @ errors + decay @ network.flat**2
        for _ in range(self.iterations):
            J = network.jacobian(x) * root[:, None]
            right = J.T @ errors - decay * network.flat
            hessian = J.T @ J + np.diag(decay)
            while damping < 1e8:
                step = np.linalg.solve(hessian + damping * np.eye(right.size), right)
                trial = network.moved(network.flat + step)
                trial_errors = root * (target - trial(x))
                reached = trial_errors @ trial_errors + decay @ trial.flat**2
                if reached < objective:
                    break
                damping *= 10.0
            else:
                break
            small = objective - reached < 1e-6 * objective
            network, errors, objective = trial, trial_errors, reached
            damping = max(0.1 * damping, 1e-10)
            if small:
                break
        return network

    @staticmethod
    def _decay(network: RadialBasis) -> FloatArray:
        """Return each parameter's prior precision times noise variance, 0 except for amplitudes."""
        count = network.centres.size
        return np.concatenate([np.zeros(2 * count), np.full(count, network.ridge), [0.0]])

    def _count_parameters(self, x: FloatArray, target: FloatArray, weights: FloatArray) -> None:
        """Set the effective number of parameters and the noise, from the linearised network."""
        J = self.network_.jacobian(x)
        residual = target - self.network_(x)
        squares = float(np.sum(weights * residual**2))
        normal = (J.T * weights) @ J
        count = self.network_.centres.size
        # Prior standard deviations: two gaps for the centres, a factor e for the widths.
        gap = 2.0 / count
        determined = 0.25 * x.size
        for _ in range(50):
            noise_variance = max(squares / max(x.size - determined, 1.0), 1e-12)
            prior = self._decay(self.network_)
            prior[:count] = noise_variance / (2.0 * gap) ** 2
            prior[count : 2 * count] = noise_variance
            prior[-1] = noise_variance * 1e-2
            before = determined
            determined = float(np.trace(np.linalg.solve(normal + np.diag(prior), normal)))
            if abs(determined - before) < 1e-6:
                break
        self.effective_parameters_ = determined
        self.noise_nm_ = float(np.sqrt(noise_variance) * self.output_scaling_.half_span)

    def _predict(self, X: FloatArray) -> FloatArray:
        reading = X[:, 0]
        curve = self.network_(self.input_scaling_.to_unit(reading))
        return np.asarray(reading + self.output_scaling_.from_unit(curve))
