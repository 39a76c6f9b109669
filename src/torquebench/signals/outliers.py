"""Outliers: single samples caused by a converter or a disturbance, not by the torque."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.signals._kernels import mark_isolated, running_median

__all__ = ["isolated", "median", "outliers"]

# Samples in the running median: it tolerates up to three outliers.
_WINDOW = 7
# Threshold of an outlier, in robust spreads of the steps between samples.
_LIMIT = 8.0
# More outliers in a row than this are a change of the signal.
_LONGEST_RUN = 2
# Multiples of the limit that are checked, so that a huge value within a fast change, whose own
# samples exceed the limit as well, is still a single one.
_HEIGHTS = (1.0, 10.0, 100.0, 1000.0)
# Ratio of standard deviation to median absolute deviation of normal noise.
_SPREAD = 1.4826


def outliers(value: ArrayLike, limit: float = _LIMIT) -> NDArray[np.bool_]:
    """Find single values that deviate from their neighbours.

    A value is an outlier when it is farther from the running median of seven samples than `limit`
    times the robust spread of the steps from one sample to the next, and at most two such
    values follow each other. Steps, ramps and ripple have no outliers.

    Parameters
    ----------
    value : array_like, shape (n,)
        Samples in their order.
    limit : float
        Distance from which a value is an outlier, in robust standard deviations of the steps.

    Returns
    -------
    bool array, shape (n,)
        True at outliers.

    Examples
    --------
    >>> outliers([5.0, 5.1, 4.9, -8388608.0, 5.0, 5.1, 5.0]).nonzero()
    (array([3]),)
    """
    samples = np.asarray(value, dtype=np.float64)
    if samples.size < _WINDOW:
        return np.zeros(samples.size, dtype=np.bool_)
    distance = np.abs(samples - running_median(samples, _WINDOW))
    steps = np.abs(np.diff(samples))
    # Where most samples repeat, the smallest step is the resolution.
    moved = steps[steps > 0]
    spread = max(_SPREAD * median(steps), float(moved.min()) if moved.size else 0.0)
    found = np.zeros(samples.size, dtype=np.bool_)
    for times in _HEIGHTS:
        far = distance > times * limit * spread
        if not far.any():
            break
        found |= isolated(far)
    return found


def median(values: NDArray[np.float64]) -> float:
    """Return the median of some finite values, as NumPy does in ten times the time for a few."""
    ordered = np.sort(values)
    middle = ordered.size // 2
    if ordered.size % 2:
        return float(ordered[middle])
    return float(ordered[middle - 1] + ordered[middle]) / 2.0


def isolated(far: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Keep only marks that stand alone or in pairs."""
    return np.asarray(mark_isolated(far, _LONGEST_RUN))
