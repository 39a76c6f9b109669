"""Angular acceleration of a shaft from the samples of its encoder."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["UNKNOWN", "Acceleration", "EncoderAcceleration"]

LEAST_SPAN_S = 0.03
"""Samples of at least so much time: of fewer, one count of the encoder would be seen."""
FEWEST_SAMPLES = 5


class Acceleration(NamedTuple):
    """Mean angular acceleration and its standard uncertainty, rad/s²."""

    rad_s2: float
    uncertainty_rad_s2: float


UNKNOWN = Acceleration(float("nan"), float("nan"))


class EncoderAcceleration:
    """Acceleration block by block: the bend of a parabola through the angle's samples.

    The uncertainty is that of the parabola, and what a ramp that begins or ends within the block
    leaves open: anything between the acceleration before and now (rectangular).

    Examples
    --------
    >>> time_s = 0.001 * np.arange(50)
    >>> counts = np.round(360_000 / (2.0 * np.pi) * 15.0 * time_s**2).astype(np.int64)
    >>> shaft = EncoderAcceleration()
    >>> first, second = shaft(time_s, counts, 360_000), shaft(time_s, counts, 360_000)
    >>> round(first.rad_s2, 1), second.uncertainty_rad_s2 < 0.02
    (30.0, True)
    """

    def __init__(self) -> None:
        self._before = float("nan")

    def __call__(
        self, time_s: NDArray[np.float64], counts: NDArray[np.number], per_revolution: int
    ) -> Acceleration:
        """Return the acceleration over the samples of a block and, if it is short, those before.

        Parameters
        ----------
        time_s : float64 array of shape (n,)
        counts : array of shape (n,)
        per_revolution : int
        """
        if time_s.size < FEWEST_SAMPLES:
            self._before = float("nan")
            return UNKNOWN
        count_rad = 2.0 * np.pi / per_revolution
        at = time_s - time_s.mean()
        angle = count_rad * (counts - counts[0])
        square = at @ at
        bend = at * at
        bend -= bend.mean() + (at @ bend) / square * at
        weight = bend @ bend
        curve = (bend @ angle) / weight
        rest = angle - angle.mean() - (at @ angle) / square * at - curve * bend
        noise = np.hypot(np.sqrt((rest @ rest) / (time_s.size - 3)), count_rad / np.sqrt(12.0))
        now, before = 2.0 * float(curve), self._before
        self._before = now
        change = 0.0 if np.isnan(before) else now - before
        own = 2.0 * float(noise) / float(np.sqrt(weight))
        return Acceleration(now, float(np.hypot(own, 0.5 * change / np.sqrt(3.0))))
