"""Repeatability over loops and output positions: a one-way analysis of variance."""

import numpy as np
from numpy.typing import NDArray

from torquebench.reducers.quantities import Contribution

__all__ = ["over_positions"]


def over_positions(
    values: NDArray[np.float64], position: NDArray[np.float64]
) -> tuple[float, list[Contribution]]:
    """Return the mean over positions, and what loops and positions contribute to it.

    The scatter of loops at one position and the scatter between positions beyond it are separate
    (random effects); with equal numbers of loops the value is the mean of all.

    Parameters
    ----------
    values, position : array of float, shape (n,)
        Value and label of the position of each loop.

    Examples
    --------
    >>> mean, parts = over_positions(np.array([1.0, 1.2, 2.0, 2.2]), np.array([0, 0, 90, 90.0]))
    >>> round(mean, 3), [(part.name, round(part.standard_uncertainty, 3)) for part in parts]
    (1.6, [('loops', 0.071), ('positions', 0.495)])
    """
    names, index = np.unique(position, return_inverse=True)
    count = np.bincount(index)
    means = np.bincount(index, weights=values) / count
    value = float(means.mean())
    freedom = values.size - names.size
    parts = []
    within = 0.0
    if freedom > 0:
        within = float(np.sum((values - means[index]) ** 2)) / freedom
        error = (within * float(np.sum(1.0 / count))) ** 0.5 / names.size
        parts.append(Contribution("loops", error, freedom))
    if names.size > 1:
        between = float(np.var(means, ddof=1)) - within * float(np.mean(1.0 / count))
        error = (max(between, 0.0) / names.size) ** 0.5
        parts.append(Contribution("positions", error, names.size - 1.0))
    return value, parts
