"""The sources' network as published: 1-50-1 trained by plain batch gradient descent."""

from __future__ import annotations

import math
from numbers import Integral, Real
from typing import ClassVar

import numpy as np

from torquebench.compensation.base import CompensationModel, FloatArray
from torquebench.compensation.estimator import Between, OneOf, parameter
from torquebench.compensation.kinds import register
from torquebench.compensation.network import (
    NetworkParameters,
    SpanScaling,
    jacobian,
    network_values,
    nguyen_widrow_start,
    posterior_factor,
    posterior_variance,
    small_uniform_start,
)
from torquebench.errors import InputError
from torquebench.kernels import kernel
from torquebench.message import Message
from torquebench.progress import SHARES, Progress

__all__ = ["PublishedNetworkModel"]

_CURVE_EPOCHS = (1, 2, 5, 10, 20, 50, 100, 200, 500)
_EPOCHS_PER_POINT = 500
"""Interval in epochs, after the first ones, at which the training error is compared with its
target.
"""
_MATLAB_ACTIVE_HALF_SPAN = 2.0

_LOG2_E = 1.4426950408889634
_LN2_HIGH = 0.693145751953125  # ln 2 in two parts (W. J. Cody, W. Waite): high part is exact
_LN2_LOW = 1.42860682030941723212e-6


@kernel(fastmath=True, error_model="numpy", nogil=True)
def _descend(
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

    The hyperbolic tangent is 1 − 2/(e²ᶻ + 1) with the exponential from a polynomial and a shifted
    exponent, so that the compiler can run it on whole vectors: within 3e-16 of the library's.
    """
    hidden = input_weights.size
    t = np.empty(hidden)
    exponent_bits = np.empty(hidden, np.int64)
    exponent = exponent_bits.view(np.float64)
    gradient_input = np.empty(hidden)
    gradient_hidden = np.empty(hidden)
    gradient_output = np.empty(hidden)
    step = 2.0 * rate / x.size
    for _ in range(epochs):
        for h in range(hidden):
            gradient_input[h] = 0.0
            gradient_hidden[h] = 0.0
            gradient_output[h] = 0.0
        gradient_bias = 0.0
        for i in range(x.size):
            for h in range(hidden):
                z = 2.0 * (input_weights[h] * x[i] + hidden_biases[h])
                z = min(max(z, -60.0), 60.0)
                k = math.floor(z * _LOG2_E + 0.5)
                r = (z - k * _LN2_HIGH) - k * _LN2_LOW
                p = 1.0 / 3628800 + r * (1.0 / 39916800)
                p = 1.0 / 5040 + r * (1.0 / 40320 + r * (1.0 / 362880 + r * p))
                p = 1.0 / 24 + r * (1.0 / 120 + r * (1.0 / 720 + r * p))
                t[h] = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6 + r * p)))
                exponent_bits[h] = (np.int64(k) + 1023) << 52
            output = output_bias
            for h in range(hidden):
                t[h] = 1.0 - 2.0 / (t[h] * exponent[h] + 1.0)
                output += t[h] * output_weights[h]
            error = weights[i] * (output - target[i])
            gradient_bias += error
            for h in range(hidden):
                slope = error * output_weights[h] * (1.0 - t[h] * t[h])
                gradient_output[h] += error * t[h]
                gradient_hidden[h] += slope
                gradient_input[h] += slope * x[i]
        output_bias -= step * gradient_bias
        for h in range(hidden):
            input_weights[h] -= step * gradient_input[h]
            hidden_biases[h] -= step * gradient_hidden[h]
            output_weights[h] -= step * gradient_output[h]
    return output_bias


def _next_noted(done: int) -> int:
    """Return the next epoch at which the training error is stored."""
    following = next((epoch for epoch in _CURVE_EPOCHS if epoch > done), None)
    return following or (done // _EPOCHS_PER_POINT + 1) * _EPOCHS_PER_POINT


@register("published-network")
class PublishedNetworkModel(CompensationModel):
    """The source papers' back-propagation network with its published training, for comparison.

    Input and target are scaled to -1 to 1; 50 hidden neurons with tanh, one linear output, batch
    gradient descent on the mean square error. The articles give neither learning rate nor epochs
    nor start. The result of plain gradient descent depends on the start: from the usual
    Nguyen-Widrow weights it doesn't become smooth between the points, from small weights it does,
    slowly.

    Parameters
    ----------
    mapping : {"residual", "direct"}, default "residual"
        Output is the additional torque (2021 article) or the standard torque (2022 article).
    start : {"nguyen-widrow", "small-uniform"}, default "nguyen-widrow"
        Start weights as MATLAB's initnw draws them, or evenly within ±0.5.
    learning_rate : float, default 0.01
        MATLAB's default for traingd.
    epochs : int, default 50000
        Steps of gradient descent, at most.
    target_error_nm : float, optional
        Training ends when the root mean square of the residuals falls below it, N·m.
    hidden : int, default 50
        Hidden neurons.
    random_state : int, default 0
        Seed of the start weights.
    range_nm, range_margin, outliers
        See `CompensationModel`.

    Attributes
    ----------
    parameters_ : NetworkParameters
        Weights and biases, for scaled input and output.
    training_rms_nm_ : float
        Root mean square of the residuals, in N·m.
    training_curve_ : float64[n, 2]
        Epoch, and root mean square of the residuals after it in N·m, to the end of the training.

    Notes
    -----
    Sources: Z. Yu, Y. Zhang, Journal of Sensors, 2021; Z. Yu, Y. Zhang, W. Yu, X. Liu, Measurement
    and Control, 2022, doi 10.1177/00202940221103308. The uncertainty is an addition: the network is
    linearised after training, with the weights' change as a measure of their prior variance.

    Examples
    --------
    >>> import numpy as np
    >>> reading = np.linspace(-2000.0, 2000.0, 41)
    >>> standard = reading + 2.0 + 1e-3 * reading + 1e-6 * reading**2
    >>> model = PublishedNetworkModel(start="small-uniform", epochs=5000)
    >>> model.fit(reading[:, None], standard).training_rms_nm_ < 0.2
    True
    """

    mapping: str = parameter("residual", OneOf(frozenset({"residual", "direct"})))
    start: str = parameter("nguyen-widrow", OneOf(frozenset({"nguyen-widrow", "small-uniform"})))
    learning_rate: float = parameter(0.01, Between(Real, 0, open_low=True))
    epochs: int = parameter(50_000, Between(Integral, 1))
    target_error_nm: float | None = parameter(None, None, Between(Real, 0, open_low=True))
    hidden: int = parameter(50, Between(Integral, 1, 1000))
    random_state: int = parameter(0, Between(Integral, 0))

    complexity: ClassVar[int] = 30
    maximum_points: int | None = 600
    doubtful: ClassVar[bool] = True

    parameters_: NetworkParameters
    input_scaling_: SpanScaling
    output_scaling_: SpanScaling
    training_curve_: FloatArray

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, progress: Progress) -> None:
        reading = X[:, 0]
        target = y - reading if self.mapping == "residual" else y
        self.input_scaling_ = SpanScaling.of(reading)
        self.output_scaling_ = SpanScaling.of(target)
        x, scaled_target = (
            self.input_scaling_.to_unit(reading),
            self.output_scaling_.to_unit(target),
        )
        mean_weight = float(np.mean(weights))
        weights = weights / mean_weight
        start = self._start()
        self.parameters_ = self._train(start, x, scaled_target, weights, progress)
        residual = scaled_target - network_values(self.parameters_, x)
        self.training_rms_nm_ = float(self.training_curve_[-1, 1])
        self._estimate_uncertainty(start, x, residual, weights)
        self.noise_nm_ *= np.sqrt(mean_weight)  # of one point; bins hold several

    def shortcoming(self, left_out_rms_nm: float) -> str:
        """State whether the start or the number of epochs causes errors at held-out points."""
        unstated = "the articles state neither start nor epochs"
        training, points = self.training_rms_nm_, self.training_inputs_.size
        if training < 0.5 * left_out_rms_nm:
            other = ", start='small-uniform'" if self.start == "nguyen-widrow" else ""
            return Message(
                "the network misses its own {points} points by {training:.3g} N·m RMS "
                "and steps left out by {left_out_rms_nm:.3g} N·m: from the start "
                "{start!r} it doesn't get smooth between them ({unstated}); take more "
                "points{other} or another model",
                points,
                training,
                left_out_rms_nm,
                self.start,
                unstated,
                other,
            )
        return Message(
            "after {epochs} epochs of gradient descent the network still misses its "
            "own {points} points by {training:.3g} N·m RMS ({unstated}); take more "
            "epochs or another model",
            self.epochs,
            points,
            training,
            unstated,
        )

    def _start(self) -> NetworkParameters:
        generator = np.random.default_rng(self.random_state)
        if self.start == "nguyen-widrow":
            return nguyen_widrow_start(generator, self.hidden, _MATLAB_ACTIVE_HALF_SPAN)
        return small_uniform_start(generator, self.hidden)

    def _train(
        self,
        start: NetworkParameters,
        x: FloatArray,
        target: FloatArray,
        weights: FloatArray,
        progress: Progress,
    ) -> NetworkParameters:
        now = NetworkParameters.from_flat(start.flat)
        arrays = (now.input_weights, now.hidden_biases, now.output_weights)
        bias, done = now.output_bias, 0
        curve: list[tuple[float, float]] = []
        while done < self.epochs:
            count = min(_next_noted(done), self.epochs) - done
            bias = float(
                _descend(x, target, weights, *arrays, bias, float(self.learning_rate), count)
            )
            done += count
            if not np.isfinite(bias) or abs(bias) > 1e6:
                raise InputError(
                    Message(
                        "gradient descent diverged with learning_rate {learning_rate:g}",
                        self.learning_rate,
                    ),
                    Message(
                        "less than about {error:.2g} for {neurons} neurons",
                        1.0 / (self.hidden + 1),
                        self.hidden,
                    ),
                    "lower learning_rate",
                )
            residual = target - network_values(NetworkParameters(*arrays, bias), x)
            rms = float(np.sqrt(np.mean(weights * residual**2)) * self.output_scaling_.half_span)
            curve.append((done, rms))
            if self.target_error_nm is not None and rms < self.target_error_nm:
                break
            progress.reach(
                SHARES * done // self.epochs, Message("gradient descent, epoch {done}", done)
            )
        self.training_curve_ = np.array(curve)
        return NetworkParameters(*arrays, bias)

    def _estimate_uncertainty(
        self, start: NetworkParameters, x: FloatArray, residual: FloatArray, weights: FloatArray
    ) -> None:
        """Set noise and prior variance by MacKay's rules on the trained, linearised network."""
        J = jacobian(self.parameters_, x) * np.sqrt(weights)[:, None]
        kernel_values = np.maximum(
            np.linalg.eigvalsh(J @ J.T if x.size < J.shape[1] else J.T @ J), 0
        )
        way = float(np.sum((self.parameters_.flat - start.flat) ** 2))
        squares = float(np.sum(weights * residual**2))
        determined = 0.5 * min(x.size, kernel_values.size)
        for _ in range(100):
            noise_variance = max(squares / (x.size - determined), 1e-12)
            precision = determined / max(way, 1e-12)
            before = determined
            determined = float(np.sum(kernel_values / (kernel_values + noise_variance * precision)))
            if abs(determined - before) < 1e-6:
                break
        self.effective_parameters_ = determined
        self.precision_ = precision
        self.noise_nm_ = float(np.sqrt(noise_variance) * self.output_scaling_.half_span)
        self.noise_variance_ = noise_variance
        self.training_inputs_, self.training_weights_ = x, weights
        self._after_restore()

    def _after_restore(self) -> None:
        self._factor = posterior_factor(
            self.parameters_,
            self.training_inputs_,
            self.training_weights_,
            np.full(3, self.precision_),
            self.noise_variance_,
        )

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        reading = X[:, 0]
        x = self.input_scaling_.to_unit(reading)
        torque = self.output_scaling_.from_unit(network_values(self.parameters_, x))
        if self.mapping == "residual":
            torque = torque + reading
        if not return_std:
            return torque, None
        variance = posterior_variance(self.parameters_, self._factor, x)
        return torque, np.sqrt(variance) * self.output_scaling_.half_span
