"""Inverse filters: from the reading back to the torque at the flange, with a larger bandwidth."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, log, sqrt

import numpy as np
from numpy.typing import NDArray

from torquebench.dynamics.filters import UncertainFilter
from torquebench.dynamics.transfer import TransferFunction
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import TURN

FloatArray = NDArray[np.float64]

GAIN_OF_BANDWIDTH = 3.3
"""Default bandwidth, as a multiple of the raw chain's."""
HIGHEST_SHARE = 0.3
"""Largest bandwidth as a share of the sampling rate."""
_REGULARISATION = 1e-6
_WIDTH = 3.6  # half length of the filter, in standard deviations of the Gaussian low-pass
_GRID = 1024
_FINE = 40  # steps of a simulated signal per sample


@dataclass(frozen=True)
class StepResponse:
    """Response to a step of torque.

    Attributes
    ----------
    overshoot : float
        Largest value above the step, share of the step.
    rise_time_s : float
        Time from 10 % to 90 %.
    bandwidth_hz : float
        First frequency at which the response has fallen by 3 dB.
    """

    overshoot: float
    rise_time_s: float
    bandwidth_hz: float


@dataclass(frozen=True, eq=False)
class InverseFilter:
    """A filter that reconstructs the torque from the reading, up to a bandwidth.

    Attributes
    ----------
    filter : UncertainFilter
        Filter, whose covariance follows from that of the transfer function.
    interval_s : float
        Sample interval of the filter.
    delay_s : float
        Delay of its output relative to the torque: chain and filter together.
    bandwidth_hz : float
        Frequency at which the response has fallen by 3 dB.
    transfer : TransferFunction
        The inverted transfer function.
    """

    filter: UncertainFilter
    interval_s: float
    delay_s: float
    bandwidth_hz: float
    transfer: TransferFunction

    @property
    def noise_gain(self) -> float:
        """Ratio of the standard uncertainties of white noise after and before the filter."""
        return float(np.sqrt(np.sum(np.square(self.filter.weights))))

    @property
    def raw(self) -> StepResponse:
        """Step response without the filter."""
        return step_response(self.transfer, self.interval_s)

    @property
    def compensated(self) -> StepResponse:
        """Step response with the filter."""
        return step_response(self.transfer, self.interval_s, self.filter)


def design_inverse(
    transfer: TransferFunction, interval_s: float, bandwidth_hz: float | None = None
) -> InverseFilter:
    """Design the inverse of a chain, regularised by a low-pass without overshoot.

    The filter makes chain and filter together a bell-shaped (Gaussian) low-pass with a delay, by
    least squares over all frequencies; a penalty on the size of its coefficients limits the noise
    at frequencies that the chain blocks. Slow torques aren't changed: the sum of the coefficients
    is 1.

    Parameters
    ----------
    interval_s : float
        Sample interval of the readings.
    bandwidth_hz : float, optional
        Frequency at which the low-pass has fallen by 3 dB; by default 3.3 times the chain's own
        bandwidth, as far as the sample rate allows.

    Raises
    ------
    InputError
        A bandwidth that the sample rate doesn't allow, or one that isn't above the chain's own.

    Examples
    --------
    >>> found = design_inverse(TransferFunction(500.0, 0.3, 50e-6, 160e-6, 1e-4), 1e-4)
    >>> found.compensated.bandwidth_hz > 3.0 * found.raw.bandwidth_hz
    True
    >>> found.raw.overshoot > 0.3, found.compensated.overshoot < 0.05
    (True, True)
    """
    if not interval_s > 0.0:
        raise InputError(Message("a sample interval of {interval_s} s", interval_s), "above 0")
    own, most = transfer.bandwidth_hz(0.5 / interval_s), HIGHEST_SHARE / interval_s
    wanted = min(GAIN_OF_BANDWIDTH * own, most) if bandwidth_hz is None else bandwidth_hz
    if not 0.0 < wanted <= most:
        raise InputError(
            Message(
                "a bandwidth of {wanted:.5g} Hz at {interval_s:.5g} readings a second",
                wanted,
                1.0 / interval_s,
            ),
            Message("up to {most:.5g} Hz", most),
            "count shorter windows",
        )
    if wanted <= own:
        raise InputError(
            Message(
                "a bandwidth of {wanted:.5g} Hz, where the chain itself has {own:.5g} Hz",
                wanted,
                own,
            ),
            Message("above {own:.5g} Hz, at most {most:.5g} Hz at this rate", own, most),
            "use shorter counter windows, or don't filter",
        )
    bell_s = sqrt(log(2.0)) / (TURN * wanted)
    side = ceil(_WIDTH * bell_s / interval_s)
    middle = side + round((transfer.delay_s + transfer.lag_s) / interval_s)
    # the inverse of the damping decays with k/c, that of the window within a few windows
    echo_s = 12.0 * transfer.damping_ratio / (TURN * transfer.resonance_hz)
    taps = middle + side + ceil(max(4.0 * transfer.window_s, echo_s, 4.0 * interval_s) / interval_s)
    weights = _solve(transfer, interval_s, wanted, middle, taps)
    parameters, moves = transfer.values, []
    for k, value in enumerate(parameters):
        step = 1e-4 * max(value, 0.01 * interval_s if k > 1 else 0.0)
        either = []
        for sign in (1.0, -1.0):
            changed = parameters.copy()
            changed[k] = max(value + sign * step, 0.0)
            moved = _solve(transfer.with_values(changed), interval_s, wanted, middle, taps)
            either.append((changed[k], moved))
        (above, upper), (below, lower) = either
        moves.append((upper - lower) / (above - below))
    slopes = np.array(moves)
    covariance = slopes.T @ np.asarray(transfer.covariance) @ slopes
    return InverseFilter(
        UncertainFilter(weights, covariance=covariance),
        interval_s,
        middle * interval_s,
        wanted,
        transfer,
    )


def _solve(
    transfer: TransferFunction, interval_s: float, bandwidth_hz: float, middle: int, taps: int
) -> FloatArray:
    """Return coefficients of sum 1 whose product with the chain is the delayed Gaussian."""
    frequency = np.linspace(0.0, 0.5 / interval_s, _GRID)
    delays = np.exp(-2j * np.pi * np.outer(frequency, np.arange(taps)) * interval_s)
    chain = transfer.response(frequency)[:, None] * delays
    bell = 2.0 ** (-0.5 * np.square(frequency / bandwidth_hz))
    wanted = bell * np.exp(-2j * np.pi * frequency * middle * interval_s)
    rows = np.concatenate([chain.real, chain.imag])
    normal = rows.T @ rows / _GRID + _REGULARISATION * np.eye(taps)
    right = rows.T @ np.concatenate([wanted.real, wanted.imag]) / _GRID
    both = np.linalg.solve(normal, np.column_stack([right, np.ones(taps)]))
    free, unit = both.T
    return np.asarray(free + unit * (1.0 - free.sum()) / unit.sum())


def step_response(
    transfer: TransferFunction, interval_s: float, behind: UncertainFilter | None = None
) -> StepResponse:
    """Simulate steps of torque at all times between two samples.

    Parameters
    ----------
    interval_s : float
        Sample interval.
    behind : UncertainFilter, optional
        Filter after the chain.
    """
    from scipy.signal import residue

    natural = TURN * transfer.resonance_hz
    damping = 2.0 * transfer.damping_ratio * natural
    lag_s = max(transfer.lag_s, 1e-3 * interval_s)
    below = np.polymul([1.0, damping, natural**2], [lag_s, 1.0])
    # integral of the step response; its differences over a window are the counter's means
    slow = min(transfer.damping_ratio, 0.7) * natural
    length = ceil((8.0 / slow + transfer.delay_s + transfer.window_s) / interval_s)
    length = min(length + (0 if behind is None else behind.weights.size), 200_000)
    window = max(1, round(_FINE * transfer.window_s / interval_s))
    fine_s = interval_s / _FINE
    time = np.arange(-window, length * _FINE) * fine_s
    later = np.maximum(time - transfer.delay_s, 0.0)
    total = np.zeros(time.size, np.complex128)
    shares, poles, _ = residue([damping, natural**2], np.polymul(below, [1.0, 0.0]))
    for share, pole in zip(shares, poles, strict=True):
        if abs(pole) < 1e-6 * natural:
            total += share * later
        else:
            total += share / pole * np.expm1(pole * later)
    step = (total[window:] - total[:-window]).real / (window * fine_s)
    shown = step
    if behind is not None:
        spread = np.zeros((behind.weights.size - 1) * _FINE + 1)
        spread[::_FINE] = behind.weights  # all phases of the step between two samples
        from scipy.signal import fftconvolve

        shown = fftconvolve(step, spread)[: step.size]
    rising = [float(np.argmax(shown >= share)) * fine_s for share in (0.1, 0.9)]
    frequency = np.linspace(0.0, 0.5 / interval_s, 20_000)
    response = np.abs(transfer.response(frequency))
    if behind is not None:
        response = response * np.abs(behind.response(frequency, interval_s))
    lost = response < sqrt(0.5)
    return StepResponse(
        float(np.max(shown)) - 1.0,
        rising[1] - rising[0],
        float(frequency[np.argmax(lost)]) if lost.any() else float(frequency[-1]),
    )
