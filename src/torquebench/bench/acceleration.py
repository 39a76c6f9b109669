"""Angular acceleration of a shaft from the samples of its encoder."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import kernel
from torquebench.units import TURN

LEAST_SPAN_S = 0.03
"""Shortest time over which acceleration is evaluated, s: over a shorter time, encoder counts would
dominate."""
FEWEST_SAMPLES = 5


class Acceleration(NamedTuple):
    """Mean angular acceleration and its standard uncertainty, rad/s²."""

    rad_s2: float
    uncertainty_rad_s2: float


UNKNOWN = Acceleration(float("nan"), float("nan"))


class EncoderAcceleration:
    """Acceleration of each block: the curvature of a parabola through the angle's samples.

    The uncertainty consists of that of the parabola and of a ramp that may begin or end within the
    block: any acceleration between the previous and the present one (rectangular).

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
        nothing = np.zeros(FEWEST_SAMPLES)
        parabola(nothing, 0.0, nothing, 1.0)  # compiled here, so that no block has to wait for it

    def __call__(
        self, time_s: NDArray[np.float64], counts: NDArray[np.number], per_revolution: int
    ) -> Acceleration:
        """Return the acceleration over a block's samples; a short block also uses earlier samples.

        Parameters
        ----------
        time_s : float64 array of shape (n,)
        counts : array of shape (n,)
        """
        before, self._before = self._before, float("nan")
        if time_s.size < FEWEST_SAMPLES:
            return UNKNOWN
        curve, noise = parabola(
            time_s,
            float(np.add.reduce(time_s)) / time_s.size,
            counts.astype(np.float64, copy=False),
            TURN / per_revolution,
        )
        self._before = now = 2.0 * curve
        change = 0.0 if math.isnan(before) else now - before
        return Acceleration(now, math.hypot(2.0 * noise, 0.5 * change / math.sqrt(3.0)))


@kernel(error_model="numpy")
def parabola(
    time_s: NDArray[np.float64], middle_s: float, counts: NDArray[np.float64], count_rad: float
) -> tuple[float, float]:
    """Fit a parabola to angles about the mean of their times.

    Return its square term and the term's standard uncertainty.
    """
    size = time_s.size
    line, bend = np.empty(size), np.empty(size)
    square, cubic = 0.0, 0.0
    for i in range(size):
        line[i] = time_s[i] - middle_s
        bend[i] = line[i] * line[i]
        square += bend[i]
        cubic += line[i] * bend[i]
    # `bend`, the square of the time, is made orthogonal to a constant and to `line`
    share, mean_bend = cubic / square, square / size
    weight, mean, slope, curve = 0.0, 0.0, 0.0, 0.0
    for i in range(size):
        bend[i] -= mean_bend + share * line[i]
        angle = count_rad * (counts[i] - counts[0])
        weight += bend[i] * bend[i]
        mean += angle
        slope += line[i] * angle
        curve += bend[i] * angle
    mean, slope, curve = mean / size, slope / square, curve / weight
    squares = 0.0
    for i in range(size):
        angle = count_rad * (counts[i] - counts[0])
        squares += (angle - mean - slope * line[i] - curve * bend[i]) ** 2
    noise = math.hypot(math.sqrt(squares / (size - 3)), count_rad / math.sqrt(12.0))
    return curve, noise / math.sqrt(weight)
