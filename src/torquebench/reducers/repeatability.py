"""Repeatability over loops and output positions, and over repeats of a running test."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.uncertainty import BudgetLine


def over_positions(
    values: NDArray[np.float64], position: NDArray[np.float64], *, noise: float = 0.0
) -> tuple[float, list[BudgetLine]]:
    """Return the mean over positions, and the contributions of loops and positions.

    The scatter of loops at one position and the additional scatter between positions are separate
    random effects; with equal numbers of loops the value is the mean of all. `noise` is the
    standard uncertainty of a loop's value by the noise of its samples: it is used for a single
    loop, and it is the smallest scatter that several loops are given.

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
    within = float(np.sum((values - means[index]) ** 2)) / freedom if freedom else 0.0
    parts = []
    mean_of = float(np.sum(1.0 / count)) ** 0.5 / names.size
    if within > noise**2:
        parts.append(BudgetLine("loops", within**0.5 * mean_of, freedom))
    else:
        within = noise**2
        parts.append(BudgetLine("noise", noise * mean_of))
    if names.size > 1:
        between = float(np.var(means, ddof=1)) - within * float(np.mean(1.0 / count))
        error = (max(between, 0.0) / names.size) ** 0.5
        parts.append(BudgetLine("positions", error, names.size - 1.0))
    return value, parts


def errors_of_means(
    values: ArrayLike, point: ArrayLike, direction: ArrayLike, repeat: ArrayLike
) -> tuple[float, float]:
    """Return the smallest mean of a test's points, and the standard error of such a mean.

    Each repeat gives one mean over both directions at each point. The scatter between repeats is
    pooled over the points and includes errors common to a whole repeat.

    Parameters
    ----------
    values : array of float, shape (n,)
    point, direction, repeat : array of float, shape (n,)
        Labels: which point, which direction, which repeat.

    Returns
    -------
    smallest, standard_error : float
        In the unit of `values`; the error is infinite without repeats.

    Examples
    --------
    >>> smallest, error = errors_of_means(
    ...     [1.0, 1.2, 1.1, 1.3], [100] * 4, [1, -1, 1, -1], [1, 1, 2, 2]
    ... )
    >>> round(smallest, 3), round(error, 3)
    (1.15, 0.05)
    """
    value = np.asarray(values, dtype=np.float64)
    place, sign, number = (np.asarray(labels) for labels in (point, direction, repeat))
    smallest, squares, freedom, fewest = np.inf, 0.0, 0, 0
    for name in np.unique(place):
        here = place == name
        means = np.array(
            [
                np.mean([value[here & (number == k) & (sign == s)].mean() for s in signs])
                for k in np.unique(number[here])
                if (signs := np.unique(sign[here & (number == k)])).size
            ]
        )
        smallest = min(smallest, float(means.mean()))
        squares += float(np.sum((means - means.mean()) ** 2))
        freedom += means.size - 1
        fewest = means.size if fewest == 0 else min(fewest, means.size)
    if freedom < 1:
        return smallest, np.inf
    return smallest, float(np.sqrt(squares / freedom / fewest))
