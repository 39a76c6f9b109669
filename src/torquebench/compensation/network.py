"""The source papers' network 1-50-1, with its published or a Bayesian training."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any, ClassVar

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.discrepancy import FormModel
from torquebench.compensation.estimator import Between, OneOf, parameter
from torquebench.compensation.kinds import NETWORKS, register
from torquebench.compensation.network_training import (
    NetworkParameters,
    SpanScaling,
    descend,
    determined_parameters,
    network_values,
    nguyen_widrow_start,
    small_uniform_start,
    train_member,
)
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.progress import SHARES, Progress

_NEGLIGIBLE_EVIDENCE = -20.0  # nats below the best start
_START_SIZES = (1.0, 0.25)  # in units of Nguyen and Widrow's start: from fine to smooth
_MATLAB_ACTIVE_HALF_SPAN = 2.0
_CURVE_EPOCHS = (1, 2, 5, 10, 20, 50, 100, 200, 500)
_EPOCHS_PER_POINT = 500
"""Interval in epochs, after the first ones, at which the training error is compared with its
target.
"""
_OF_BAYESIAN = frozenset({"ensemble", "iterations", "tolerance"})
_OF_DESCENT = frozenset({"learning_rate", "epochs", "target_error_nm"})
_DESCENT = "gradient-descent"


@register("network")
class NetworkModel(FormModel):
    """The source papers' back-propagation network 1-50-1 (tanh, linear).

    As published it is trained by batch gradient descent on the mean square error, for comparison.
    The articles state neither learning rate nor epochs nor start, and the result depends on the
    start: from the usual Nguyen-Widrow weights the curve doesn't become smooth between the points,
    from small weights it does so slowly. The default training is Levenberg-Marquardt with Bayesian
    regularisation from a few starts of different smoothness, averaged by their evidence: the
    effective number of parameters is inferred, and more neurons than points do no harm.

    Parameters
    ----------
    training : {"levenberg-marquardt", "gradient-descent"}, default "levenberg-marquardt"
    mapping : {"residual", "direct"}, default "residual"
        Output is the additional torque (2021 article) or the standard torque (2022 article).
    start : {"nguyen-widrow", "small-uniform"}, default "nguyen-widrow"
        Start weights as MATLAB's initnw draws them, or evenly within ±0.5. Levenberg-Marquardt uses
        input weights from Nguyen and Widrow's size down to a quarter of it.
    hidden : int, default 50
        Hidden neurons.
    random_state : int, default 0
        Seed of the starts.
    ensemble : int, default 3
        Number of starts whose curves are averaged; Levenberg-Marquardt.
    iterations : int, default 20
        Largest number of steps of each start; Levenberg-Marquardt. Hundreds more raise the evidence
        a little further, but not the accuracy.
    tolerance : float, default 1e-3
        Relative change of objective, precisions and noise below which training ends;
        Levenberg-Marquardt.
    learning_rate : float, default 0.01
        MATLAB's default for traingd; gradient descent.
    epochs : int, default 50000
        Steps of gradient descent, at most.
    target_error_nm : float, optional
        Gradient descent ends when the root mean square of the residuals falls below it, N·m.
    range_nm, range_margin, outliers
        See `CompensationModel`.

    Attributes
    ----------
    networks_ : list of NetworkParameters
        The trained networks, in scaled input and output.
    shares_ : float64 array
        Share of each network, in proportion to its evidence.
    training_rms_nm_ : float
        Root mean square of the residuals, in N·m.
    training_curve_ : float64[n, 2]
        Epoch, and root mean square of the residuals after it in N·m, to the end of gradient
        descent; empty for the other training.

    Notes
    -----
    Sources: Z. Yu, Y. Zhang, Journal of Sensors, 2021; Z. Yu, Y. Zhang, W. Yu, X. Liu, Measurement
    and Control, 2022, doi 10.1177/00202940221103308.

    Examples
    --------
    >>> import numpy as np
    >>> reading = np.linspace(-2000.0, 2000.0, 41)
    >>> standard = reading + 2.0 + 1e-3 * reading + 1e-6 * reading**2
    >>> NetworkModel().fit(reading[:, None], standard).predict([[1000.0]]).round(1)
    array([1004.])
    >>> published = NetworkModel(training="gradient-descent", start="small-uniform", epochs=5000)
    >>> published.fit(reading[:, None], standard).training_rms_nm_ < 0.2
    True
    """

    training: str = parameter(
        OneOf(frozenset({"levenberg-marquardt", _DESCENT})), default="levenberg-marquardt"
    )
    mapping: str = parameter(OneOf(frozenset({"residual", "direct"})), default="residual")
    start: str = parameter(
        OneOf(frozenset({"nguyen-widrow", "small-uniform"})), default="nguyen-widrow"
    )
    hidden: int = parameter(Between(Integral, 1, 1000), default=50)
    random_state: int = parameter(Between(Integral, 0), default=0)
    ensemble: int = parameter(Between(Integral, 1, 100), default=3)
    iterations: int = parameter(Between(Integral, 1), default=20)
    tolerance: float = parameter(Between(Real, 0, 1, open_high=True), default=1e-3)
    learning_rate: float = parameter(Between(Real, 0, open_low=True), default=0.01)
    epochs: int = parameter(Between(Integral, 1), default=50_000)
    target_error_nm: float | None = parameter(None, Between(Real, 0, open_low=True), default=None)

    complexity: ClassVar[int] = 30
    maximum_points = 600
    descent: dict[int, NetworkParameters] | None = None
    """Networks of one gradient descent by epoch, which several trainings of the same points, start
    and learning rate share: they differ only in the epoch at which they end.
    """

    @property
    def doubtful(self) -> bool:
        """Whether the model may be worse than the raw reading."""
        return self.training == _DESCENT

    @property
    def name(self) -> str:
        """Name of the training, as `make_model` takes it."""
        return next(name for name, training in NETWORKS.items() if training == self.training)

    @property
    def kind_parameters(self) -> dict[str, Any]:
        """Parameters of this training, by name."""
        others = _OF_BAYESIAN if self.training == _DESCENT else _OF_DESCENT
        return {name: value for name, value in self.get_params().items() if name not in others}

    def _minimum_points(self) -> int:
        return 5

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, progress: Progress) -> None:
        """Scale the points to ±1, train the network, and keep its noise."""
        reading = X[:, 0]
        target = y - reading if self.mapping == "residual" else y
        self.input_scaling_ = SpanScaling.of(reading)
        self.output_scaling_ = SpanScaling.of(target)
        x, scaled = self.input_scaling_.to_unit(reading), self.output_scaling_.to_unit(target)
        self.training_curve_ = np.zeros((0, 2))
        train = self._fit_descent if self.training == _DESCENT else self._fit_bayesian
        determined, noise_variance = train(x, scaled, weights, progress)
        self.effective_parameters_ = determined
        self.noise_nm_ = float(np.sqrt(noise_variance) * self.output_scaling_.half_span)
        self.training_rms_nm_ = self._rms_nm(scaled - self._curve(x), weights)

    def _fit_bayesian(
        self, x: FloatArray, target: FloatArray, weights: FloatArray, progress: Progress
    ) -> tuple[float, float]:
        """Train by Levenberg-Marquardt; return effective parameters and noise variance."""
        members = []
        for done, start in enumerate(self._starts(), 1):
            members.append(train_member(x, target, weights, start, self.iterations, self.tolerance))
            progress.reach(
                SHARES * done // self.ensemble,
                Message("start {done} of {ensemble}", done, self.ensemble),
            )
        best = max(member.log_evidence for member in members)
        members = [m for m in members if m.log_evidence - best >= _NEGLIGIBLE_EVIDENCE]
        odds = np.exp([member.log_evidence - best for member in members])
        self.shares_ = odds / np.sum(odds)
        self.networks_ = [member.parameters for member in members]
        gamma = np.array([member.effective_parameters for member in members])
        noise_variance = np.array([member.noise_variance for member in members])
        return float(self.shares_ @ gamma), float(self.shares_ @ noise_variance)

    def _starts(self) -> list[NetworkParameters]:
        """Return the weights from which each training begins."""
        generator = np.random.default_rng(self.random_state)
        count = 1 if self.training == _DESCENT else self.ensemble
        if self.start == "small-uniform":
            return [small_uniform_start(generator, self.hidden) for _ in range(count)]
        if self.training == _DESCENT:
            return [nguyen_widrow_start(generator, self.hidden, _MATLAB_ACTIVE_HALF_SPAN)]
        sizes = np.geomspace(*_START_SIZES, count)
        if count == 1:
            sizes = np.sqrt(np.prod(_START_SIZES, keepdims=True))
        return [nguyen_widrow_start(generator, self.hidden, float(size)) for size in sizes]

    def _fit_descent(
        self, x: FloatArray, target: FloatArray, weights: FloatArray, progress: Progress
    ) -> tuple[float, float]:
        """Train by gradient descent; return effective parameters and noise variance."""
        mean_weight = float(np.mean(weights))
        weights = weights / mean_weight
        (start,) = self._starts()
        network, done = start, 0
        descent = {} if self.descent is None else self.descent  # networks by epoch, perhaps shared
        curve: list[tuple[float, float]] = []
        while done < self.epochs:
            count = min(_next_noted(done), self.epochs) - done
            done += count
            if done not in descent:
                rate = float(self.learning_rate)
                descent[done] = descend(network, x, target, weights, rate, count)
            network = descent[done]
            if not np.isfinite(network.output_bias) or abs(network.output_bias) > 1e6:
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
            rms = self._rms_nm(target - network_values(network, x), weights)
            curve.append((done, rms))
            if self.target_error_nm is not None and rms < self.target_error_nm:
                break
            progress.reach(
                SHARES * done // self.epochs, Message("gradient descent, epoch {done}", done)
            )
        self.networks_, self.shares_ = [network], np.ones(1)
        self.training_curve_ = np.array(curve)
        residual = target - network_values(network, x)
        determined, noise_variance = determined_parameters(network, start, x, residual, weights)
        # The noise is that of one point; bins hold several.
        return determined, mean_weight * noise_variance

    def _rms_nm(self, residual: FloatArray, weights: FloatArray) -> float:
        mean_square = np.mean(weights * residual**2) / np.mean(weights)
        return float(np.sqrt(mean_square) * self.output_scaling_.half_span)

    def shortcoming(self, left_out_rms_nm: float) -> str:
        """Explain errors at held-out points by the start or by the number of epochs."""
        if self.training != _DESCENT:
            return ""
        unstated = "the articles state neither start nor epochs"
        training = self.training_rms_nm_
        if training < 0.5 * left_out_rms_nm:
            other = ", start='small-uniform'" if self.start == "nguyen-widrow" else ""
            return Message(
                "the network misses its own {points} points by {training:.3g} N·m RMS "
                "and steps left out by {left_out_rms_nm:.3g} N·m: from the start "
                "{start!r} it doesn't get smooth between them ({unstated}); take more "
                "points{other} or another model",
                self.points_,
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
            self.points_,
            training,
            unstated,
        )

    def _curve(self, x: FloatArray) -> FloatArray:
        curves = np.array([network_values(network, x) for network in self.networks_])
        return np.asarray(np.sum(curves * self.shares_[:, None], axis=0))

    def _predict(self, X: FloatArray) -> FloatArray:
        reading = X[:, 0]
        curve = self._curve(self.input_scaling_.to_unit(reading))
        torque = self.output_scaling_.from_unit(curve)
        return np.asarray(torque + reading if self.mapping == "residual" else torque)


def _next_noted(done: int) -> int:
    """Return the next epoch at which the training error is stored."""
    following = next((epoch for epoch in _CURVE_EPOCHS if epoch > done), None)
    return following or (done // _EPOCHS_PER_POINT + 1) * _EPOCHS_PER_POINT
