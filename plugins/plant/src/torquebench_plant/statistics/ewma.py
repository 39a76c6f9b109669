"""Exponentially weighted moving average: a control chart sensitive to small shifts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["EwmaChart", "ewma_chart"]

FROM_RANGES = 1.128
"""d₂ for moving ranges of two."""


@dataclass(frozen=True, eq=False)
class EwmaChart:
    """EWMA chart of values in the order of time.

    Attributes
    ----------
    average : float64[n]
        Weighted average up to each value.
    centre, sigma : float
        Expected value, and standard deviation.
    lower, upper : float64[n]
        Limits of each average.
    outside : tuple of int
        Averages outside their limits, from 0.
    weight, width : float
        Weight of the newest value, and half the width of the limits in standard deviations.
    """

    average: NDArray[np.float64]
    centre: float
    sigma: float
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    outside: tuple[int, ...]
    weight: float
    width: float


def ewma_chart(
    values: ArrayLike,
    *,
    weight: float = 0.2,
    width: float = 2.9,
    centre: float | None = None,
    sigma: float | None = None,
    base: int | None = None,
) -> EwmaChart:
    """Return the EWMA chart of values in the order of time.

    Parameters
    ----------
    values : array of float, shape (n,)
        At least 3.
    weight : float, default 0.2
        Of the newest value, above 0 and up to 1.
    width : float, default 2.9
        Half the width of the limits in standard deviations of the average; with a weight of 0.2
        a false alarm comes once in about 500 values.
    centre, sigma : float, optional
        Expected values; by default mean and mean moving range/1.128 of the base values.
    base : int, optional
        Number of first values from which they are computed; all by default.

    Raises
    ------
    InputError
        Too few values, or a weight or width that isn't one.

    References
    ----------
    D. C. Montgomery, Introduction to Statistical Quality Control, 6th ed., equations 9.22, 9.25
    and 9.26.

    Examples
    --------
    >>> chart = ewma_chart([10.0, 10.2, 9.9, 10.1, 11.5, 11.6], centre=10.0, sigma=0.2)
    >>> chart.outside
    (4, 5)
    """
    x = np.atleast_1d(np.asarray(values, dtype=np.float64))
    count = x.size if base is None else base
    if x.ndim != 1 or not 3 <= count <= x.size or not np.all(np.isfinite(x)):
        raise InputError(
            Message("a control chart over {count} values with {base} as its base", x.size, count),
            "at least 3 finite values, and no more base values than values",
        )
    if not 0.0 < weight <= 1.0 or not width > 0.0:
        raise InputError(
            Message("weight {weight:g}, width {width:g}", weight, width),
            "a weight up to 1 and a width, both above 0",
        )
    middle = float(x[:count].mean()) if centre is None else centre
    spread = float(np.abs(np.diff(x[:count])).mean()) / FROM_RANGES if sigma is None else sigma
    average = np.empty(x.size)
    last = middle
    for k, value in enumerate(x):
        last += weight * (value - last)
        average[k] = last
    ages = 2.0 * np.arange(1, x.size + 1)
    reach = width * spread * np.sqrt(weight / (2.0 - weight) * (1.0 - (1.0 - weight) ** ages))
    outside = tuple(int(k) for k in np.flatnonzero(np.abs(average - middle) > reach))
    return EwmaChart(
        average, middle, spread, middle - reach, middle + reach, outside, weight, width
    )
