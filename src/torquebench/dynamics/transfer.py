"""Transfer function from the torque at the flange to the reading."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import TURN

FloatArray = NDArray[np.float64]

PARAMETERS = ("resonance_hz", "damping_ratio", "lag_s", "delay_s")
"""Identified parameters of a transfer function, in the order of its covariance."""

_SEARCHED = 20_000


@dataclass(frozen=True)
class TransferFunction:
    r"""Shaft resonance, lag and delay of the transducer, and the counter's window.

    The flange's inertia J acts against the stiffness k and damping c of transducer and shaft, so
    that the transducer measures (cs + k)/(Js² + cs + k) of the torque. The transducer's bandwidth
    is a first-order lag with a delay, and a window of the counter is a mean.

    Parameters
    ----------
    resonance_hz : float
        √(k/J)/2π.
    damping_ratio : float
        c/(2√(kJ)).
    lag_s, delay_s : float
        Lag and delay of the transducer.
    window_s : float
        Length of the counter's window; 0 if a reading is a sample. The window is known, not
        identified.
    covariance : tuple of 4 tuples of 4 float
        Covariance of `PARAMETERS`; zeros for exact values.

    Examples
    --------
    >>> chain = TransferFunction(500.0, 0.4, 50e-6)
    >>> abs(chain.response([0.0, 500.0])).round(3).tolist()
    [1.0, 1.581]
    >>> round(chain.bandwidth_hz())
    846
    """

    resonance_hz: float
    damping_ratio: float
    lag_s: float = 0.0
    delay_s: float = 0.0
    window_s: float = 0.0
    covariance: tuple[tuple[float, ...], ...] = ((0.0,) * 4,) * 4

    def __post_init__(self) -> None:
        for name, least in (("resonance_hz", 1e-3), ("damping_ratio", 1e-4)):
            value = getattr(self, name)
            if not (isfinite(value) and value >= least):
                raise InputError(
                    Message("{name} = {value}", name, value), Message("{limit:g} or more", least)
                )
        for name in ("lag_s", "delay_s", "window_s"):
            value = getattr(self, name)
            if not (isfinite(value) and value >= 0.0):
                raise InputError(Message("{name} = {value}", name, value), "0 or more")
        matrix = np.asarray(self.covariance, np.float64)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise InputError(
                Message("a covariance of shape {shape}", matrix.shape), "(4, 4), finite"
            )
        object.__setattr__(self, "covariance", tuple(map(tuple, matrix.tolist())))

    @property
    def values(self) -> FloatArray:
        """Values of `PARAMETERS`."""
        return np.array([getattr(self, name) for name in PARAMETERS])

    def standard_uncertainty(self, name: str) -> float:
        """Return the standard uncertainty of one of `PARAMETERS`."""
        number = PARAMETERS.index(name)
        return sqrt(max(self.covariance[number][number], 0.0))

    def with_values(self, values: ArrayLike) -> TransferFunction:
        """Return the function with other, exact values of `PARAMETERS` and the same window."""
        resonance, damping, lag, delay = np.asarray(values, np.float64).tolist()
        return TransferFunction(resonance, damping, lag, delay, self.window_s)

    def response(self, frequency_hz: ArrayLike) -> NDArray[np.complex128]:
        """Return the complex response at frequencies."""
        frequency = np.asarray(frequency_hz, np.float64)
        s = 2j * np.pi * frequency
        natural = TURN * self.resonance_hz
        damping = 2.0 * self.damping_ratio * natural
        shaft = (damping * s + natural**2) / (s * s + damping * s + natural**2)
        lag = np.exp(-s * self.delay_s) / (1.0 + s * self.lag_s)
        return np.asarray(shaft * lag * np.sinc(frequency * self.window_s))

    def bandwidth_hz(self, highest_hz: float | None = None) -> float:
        """Return the first frequency at which the response has fallen by 3 dB."""
        highest = 50.0 * self.resonance_hz if highest_hz is None else highest_hz
        frequency = np.linspace(0.0, highest, _SEARCHED)
        below = np.abs(self.response(frequency)) < sqrt(0.5)
        return float(frequency[np.argmax(below)]) if below.any() else highest

    @property
    def group_delay_s(self) -> float:
        """Delay of slow signals: the time by which the reading of a ramp lags."""
        natural = TURN * self.resonance_hz
        step = 1e-4 * natural / TURN
        return float(-np.angle(self.response(step)) / (TURN * step))
