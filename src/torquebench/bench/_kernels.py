"""Loops over the samples of a block, which cost less than a NumPy call for each operation."""

import math

import numpy as np
from numpy.typing import NDArray

from torquebench.kernels import kernel

__all__ = ["parabola"]


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
    # orthogonal to a constant and to a line
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
    rest = 0.0
    for i in range(size):
        angle = count_rad * (counts[i] - counts[0])
        rest += (angle - mean - slope * line[i] - curve * bend[i]) ** 2
    noise = math.hypot(math.sqrt(rest / (size - 3)), count_rad / math.sqrt(12.0))
    return curve, noise / math.sqrt(weight)
