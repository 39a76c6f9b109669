"""Vibration of the shaft after steps of torque against a fixed flange, and the chain's delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Self

import numpy as np
from numpy.typing import NDArray

from torquebench.dynamics.identification import Inertia, Shaft
from torquebench.dynamics.transfer import TransferFunction
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import TURN

FloatArray = NDArray[np.float64]

_AFTER_STEP_S = 5e-3
_FEWEST_STEPS = 10
_FEWEST_SAMPLES = 40
_HIGHEST_SHARE = 0.4
"""Highest frequency that is searched for, as a share of the rate."""
_LOWEST_HZ = 10.0
_RIPPLE_HZ = (10.0, 120.0)
_LEAST_GAIN = 2.0
"""Smallest variance explained by the vibration per parameter, as a multiple of the noise
variance."""
_LARGEST_RELATIVE = {"frequency": 0.05, "damping": 0.3}
_ONE_MASS = np.array([1e-3, 0.015])
"""Relative standard uncertainty of frequency and damping by the model of one mass on one spring:
deviations of the simulated bench's shafts from this model.
"""
_STEEP_S = 5e-3
_HARMONICS = 3
_REMEDY = (
    "record steps that the drive makes within half a period of the vibration, more of them or "
    "larger ones, in windows of at most a third of its period"
)


@dataclass(frozen=True, eq=False)
class Steps:
    """Readings around steps of torque, one step in each row; a reference fixes the flange.

    Parameters
    ----------
    reading_nm, standard_nm : float64[steps, n]
        Values from the command of a step to the next command.
    """

    interval_s: float
    reading_nm: FloatArray
    standard_nm: FloatArray


@dataclass(frozen=True, eq=False)
class Sine:
    """A sine of torque against a reference.

    Parameters
    ----------
    reading_nm, standard_nm : float64[n]
    """

    interval_s: float
    period_s: float
    reading_nm: FloatArray
    standard_nm: FloatArray


@dataclass(frozen=True)
class Vibration:
    """Vibration of the motor on the shaft with a fixed flange.

    Attributes
    ----------
    covariance : tuple of tuples of float
        Covariance of frequency and damping ratio.
    steps : int
        Number of steps in the identification.
    """

    frequency_hz: float
    damping_ratio: float
    covariance: tuple[tuple[float, float], tuple[float, float]]
    steps: int


@dataclass(frozen=True)
class Delay:
    """Delay of the readings against the torque, s."""

    delay_s: float
    standard_uncertainty_s: float


@dataclass(frozen=True)
class MotorInertia:
    """Moment of inertia of motor and shaft up to the transducer, from data sheets."""

    inertia_kgm2: float
    standard_uncertainty_kgm2: float

    @classmethod
    def stated(cls, inertia_kgm2: float, expanded_percent: float) -> Self:
        """Return the inertia from its expanded uncertainty (k = 2) in %."""
        return cls(inertia_kgm2, 0.005 * expanded_percent * inertia_kgm2)


def identify_vibration(steps: Steps) -> Vibration:
    """Identify frequency and damping of the vibration that follows steps of torque.

    Each step has its own size, drift, settling of the drive, vibration and ripple of the drive; the
    frequencies, the damping and the drive's time constant are common to all steps.

    Raises
    ------
    InputError
        If the steps don't determine a vibration well enough.
    """
    from scipy.optimize import least_squares

    rows = _after(steps)
    count = rows.shape[1]
    time = np.asarray(np.arange(count) * steps.interval_s, np.float64)
    highest = _HIGHEST_SHARE / steps.interval_s

    def residuals(logs: FloatArray, vibrating: bool = True) -> FloatArray:
        basis = np.linalg.qr(_basis(np.asarray(np.exp(logs)), time, vibrating))[0]
        return np.asarray(rows - (rows @ basis) @ basis.T)

    def deviations(logs: FloatArray) -> FloatArray:
        return residuals(logs).ravel()

    drive_s = 6e-3
    best = None
    for ripple_hz in _ripples(rows, steps.interval_s):
        starts = [
            np.log([frequency, 0.06, drive_s, ripple_hz])
            for frequency in np.geomspace(_LOWEST_HZ * 1.1, highest * 0.95, 60)
        ]
        starts.sort(key=lambda start: float(np.sum(np.square(deviations(start)))))
        limits = (
            np.log([_LOWEST_HZ, 2e-3, steps.interval_s, 0.93 * ripple_hz]),
            np.log([highest, 0.8, 0.5 * time[-1], 1.07 * ripple_hz]),
        )
        for start in starts[:2]:
            fitted = least_squares(deviations, start, bounds=limits, x_scale=[0.05, 0.5, 0.3, 0.02])
            if best is None or fitted.cost < best.cost:
                best = fitted
    assert best is not None
    frequency, damping, _, ripple_hz = np.exp(best.x)
    residual = residuals(best.x)
    freedom = residual.size - rows.shape[0] * 9 - 4
    variance = float(np.sum(np.square(residual))) / freedom
    without = float(np.sum(np.square(residuals(best.x, vibrating=False))))
    gain = (without - variance * freedom) / (2.0 * rows.shape[0] * variance)
    scale = np.array([frequency, damping])
    covariance = _covariance(np.asarray(best.jac), residual, variance)[:2, :2] * np.outer(
        scale, scale
    )
    covariance += np.diag(np.square(_ONE_MASS * scale))
    u = np.sqrt(np.diag(covariance))
    what: list[str] = []
    if gain < _LEAST_GAIN:
        what.append(
            Message("no vibration stands out of the noise of {noise_nm:.3g} N·m", sqrt(variance))
        )
    else:
        for name, value, value_u in zip(_LARGEST_RELATIVE, (frequency, damping), u, strict=True):
            if not value_u <= _LARGEST_RELATIVE[name] * value:
                what.append(Message("{name} {value:.4g} with u = {each:.2g}", name, value, value_u))
        if frequency > 0.98 * highest or frequency < 1.02 * _LOWEST_HZ:
            what.append(
                Message(
                    "frequency {frequency:.4g} Hz at the end of {lowest_hz:g}-{highest:.4g}",
                    frequency,
                    _LOWEST_HZ,
                    highest,
                )
            )
    if what:
        raise InputError(
            Message(
                "these steps don't identify the shaft's vibration: {what}",
                Message.joined(what, "; "),
            ),
            "frequency to 5 %, damping to 30 %",
            _REMEDY,
        )
    first, second = covariance.tolist()
    return Vibration(float(frequency), float(damping), (tuple(first), tuple(second)), len(rows))


def _basis(parameters: FloatArray, time: FloatArray, vibrating: bool) -> FloatArray:
    """Return columns over time: drift, drive, ripple and, if wanted, vibration."""
    frequency, damping, drive_s, ripple_hz = parameters
    natural, ripple = TURN * frequency, TURN * ripple_hz * time
    columns = [np.ones(time.size), time - np.mean(time), np.exp(-time / drive_s)]
    columns += [wave(k * ripple) for k in (1, 2) for wave in (np.cos, np.sin)]
    if vibrating:
        swing = natural * sqrt(1.0 - damping**2) * time
        decay = np.exp(-damping * natural * time)
        columns += [decay * np.cos(swing), decay * np.sin(swing)]
    return np.column_stack(columns)


def _ripples(rows: FloatArray, interval_s: float) -> list[float]:
    """Return possible frequencies of the drive's ripple, which remains long after the steps."""
    tail = rows[:, rows.shape[1] // 2 :]
    tail = tail - tail.mean(axis=1, keepdims=True)
    size = 16 * tail.shape[1]
    power = np.sum(np.square(np.abs(np.fft.rfft(tail, size, axis=1))), axis=0)
    frequency = np.fft.rfftfreq(size, interval_s)
    low, high = _RIPPLE_HZ
    peak_hz = float(
        frequency[np.argmax(np.where((frequency > low) & (frequency < high), power, 0.0))]
    )
    return [peak_hz, max(0.5 * peak_hz, low)]


def _after(steps: Steps) -> FloatArray:
    """Return the rows, each from shortly after the steepest sample of its step on."""
    readings = np.asarray(steps.reading_nm, np.float64)
    if readings.ndim != 2 or readings.shape[0] < _FEWEST_STEPS:
        raise InputError(
            Message("{count} steps of torque", readings.shape[0] if readings.ndim == 2 else 0),
            Message("{fewest_samples} at least", _FEWEST_STEPS),
            _REMEDY,
        )
    if not np.isfinite(readings).all():
        raise InputError("steps with gaps", "finite readings", "leave those steps out")
    early = readings[:, : readings.shape[1] // 2]
    begins = np.argmax(np.abs(np.diff(early, axis=1)), axis=1) + 1
    begins += max(1, round(_AFTER_STEP_S / steps.interval_s))
    length = readings.shape[1] - int(np.max(begins))
    if length < _FEWEST_SAMPLES:
        raise InputError(
            Message("{length} readings after each step", max(length, 0)),
            Message("{fewest_samples} at least", _FEWEST_SAMPLES),
            "hold the torque longer after each step, or count shorter windows",
        )
    return np.array([row[begin : begin + length] for row, begin in zip(readings, begins,
                                                                      strict=True)])  # fmt: skip


def _covariance(jacobian: FloatArray, residual: FloatArray, variance: float) -> FloatArray:
    """Return the covariance, with correlated deviations within a step."""
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    plain = variance * inverse
    steps, count = residual.shape
    scores = np.einsum("sjp,sj->sp", jacobian.reshape(steps, count, -1), residual)
    robust = inverse @ (scores.T @ scores) @ inverse
    larger = np.sqrt(np.maximum(np.diag(robust) / np.maximum(np.diag(plain), 1e-300), 1.0))
    return np.asarray(plain * np.outer(larger, larger))


def identify_delay(steps: Steps, sines: Sequence[Sine] = ()) -> Delay:
    """Identify the delay of the readings against the reference's, which may be negative.

    In a step, a late reading deviates by its delay times the torque's rate. Between sines of
    different periods and one size, the phase differs by the delay; hysteresis is the same in both.
    """
    estimates = [_delay_by_steps(steps), *_delay_by_sines(sines)]
    weights = np.array([1.0 / estimate.standard_uncertainty_s**2 for estimate in estimates])
    values = np.array([estimate.delay_s for estimate in estimates])
    mean = float(weights @ values / weights.sum())
    spread = float(weights @ np.square(values - mean)) / max(values.size - 1, 1)
    return Delay(mean, sqrt(max(spread, 1.0) / float(weights.sum())))


def _delay_by_steps(steps: Steps) -> Delay:
    """Fit the reading's delay to the standard in the steep part of each step."""
    reading, standard = steps.reading_nm, steps.standard_nm
    rate = np.gradient(standard, steps.interval_s, axis=1)
    reach = max(2, round(_STEEP_S / steps.interval_s))
    moved, rates = [], []
    for row, standard_nm, slope in zip(reading, standard, rate, strict=True):
        middle = int(np.argmax(np.abs(slope[: slope.size // 2])))
        part = slice(max(middle - reach, 0), middle + reach + 1)
        basis = np.column_stack([np.ones(slope[part].size), standard_nm[part], slope[part]])
        span, _ = np.linalg.qr(basis[:, :2])
        rates.append(basis[:, 2] - span @ (span.T @ basis[:, 2]))
        moved.append(row[part] - span @ (span.T @ row[part]))
    x, y = np.concatenate(rates), np.concatenate(moved)
    power = float(x @ x)
    if not power > 0.0:
        raise InputError("steps in which the reference doesn't change", "steps of torque", _REMEDY)
    slope = float(x @ y) / power
    residual = y - slope * x
    scores = [float(a @ (b - slope * a)) for a, b in zip(rates, moved, strict=True)]
    u = (
        sqrt(
            max(
                float(np.sum(np.square(scores))), float(residual @ residual) / residual.size * power
            )
        )
        / power
    )
    return Delay(-slope, u)


def _delay_by_sines(sines: Sequence[Sine]) -> list[Delay]:
    """Return the delay by the phases' slope over the rate of the sines; none for one period."""
    if len({sine.period_s for sine in sines}) < 2:
        return []
    rate, phase, u = np.array([_phase(sine) for sine in sines]).T
    weight = 1.0 / np.square(u)
    middle = float(weight @ rate / weight.sum())
    power = float(weight @ np.square(rate - middle))
    slope = float(weight @ ((rate - middle) * phase)) / power
    return [Delay(-slope, 1.0 / sqrt(power))]


def _phase(sine: Sine) -> tuple[float, float, float]:
    """Return the angular frequency, the phase of the reading behind the reference, and its u."""
    count = sine.reading_nm.size
    time = (np.arange(count) - 0.5 * count) * sine.interval_s
    rate = TURN / sine.period_s
    columns = [np.ones(count), time]
    columns += [
        wave(k * rate * time) for k in range(1, _HARMONICS + 1) for wave in (np.cos, np.sin)
    ]
    basis = np.column_stack(columns)
    both = np.column_stack([sine.reading_nm, sine.standard_nm])
    weights, *_ = np.linalg.lstsq(basis, both, rcond=None)
    residual = both - basis @ weights
    turned = weights[2] - 1j * weights[3]
    size = np.abs(turned)
    shared = max(1.0, 0.01 / sine.interval_s)  # deviations are correlated over 10 ms
    u = np.sqrt(2.0 * shared * np.mean(np.square(residual), axis=0) / count) / size
    return rate, float(np.angle(turned[0] / turned[1])), float(np.hypot(*u))


def shaft_on_bench(
    vibration: Vibration,
    motor: MotorInertia,
    flange: Inertia,
    delay: Delay,
) -> tuple[TransferFunction, Shaft]:
    """Return the transfer function and shaft of a chain from its vibration with a fixed flange.

    With a fixed flange, the motor's inertia vibrates on the shaft: k = J_m(2πf)². The flange's
    inertia on the same shaft gives the transfer function's resonance. The delay is divided into a
    first-order lag, up to half of it, and a pure delay.

    Raises
    ------
    InputError
        If the uncertainty of the result is too large.
    """
    natural = TURN * vibration.frequency_hz
    sizes = np.array([vibration.frequency_hz, vibration.damping_ratio])
    relative = np.asarray(vibration.covariance) / np.outer(sizes, sizes)
    by_motor = motor.standard_uncertainty_kgm2 / motor.inertia_kgm2
    by_flange = flange.standard_uncertainty_kgm2 / flange.inertia_kgm2
    stiffness = motor.inertia_kgm2 * natural**2
    damping = 2.0 * vibration.damping_ratio * motor.inertia_kgm2 * natural
    shaft = Shaft(
        stiffness,
        stiffness * sqrt(4.0 * relative[0, 0] + by_motor**2),
        damping,
        damping * sqrt(max(relative.sum(), 0.0) + by_motor**2),
    )
    ratio = sqrt(motor.inertia_kgm2 / flange.inertia_kgm2)
    total = max(delay.delay_s, 0.0)
    lag, lag_u = total / 4.0, total / 4.0 / sqrt(3.0)
    values = np.array([ratio * vibration.frequency_hz, ratio * vibration.damping_ratio])
    covariance = np.zeros((4, 4))
    covariance[:2, :2] = (relative + 0.25 * (by_motor**2 + by_flange**2)) * np.outer(values, values)
    covariance[2, 2] = lag_u**2
    covariance[3, 3] = lag_u**2 + delay.standard_uncertainty_s**2
    covariance[2, 3] = covariance[3, 2] = -(lag_u**2)
    transfer = TransferFunction(
        float(values[0]),
        float(values[1]),
        lag,
        total - lag,
        0.0,
        tuple(map(tuple, covariance.tolist())),
    )
    u = transfer.standard_uncertainty("resonance_hz")
    if u > _LARGEST_RELATIVE["frequency"] * transfer.resonance_hz:
        raise InputError(
            Message(
                "resonance {resonance_hz:.4g} Hz with u = {u:.3g} Hz, of which "
                "{by_motor:.2g} % by the motor's inertia and {by_flange:.2g} % by the "
                "flange's",
                transfer.resonance_hz,
                u,
                50.0 * by_motor,
                50.0 * by_flange,
            ),
            "5 %",
            "state the motor's inertia more exactly, or record an empty run with more ramps and "
            "compensate it with the chain's model",
        )
    return transfer, shaft
