"""Tables over speed and temperature, linear between their nodes."""

from __future__ import annotations

import numpy as np

from torquebench.chain.readings import FloatArray

Numbers = tuple[float, ...]
Table = tuple[Numbers, ...]
"""Table with one row for each node of the first quantity."""


def between(nodes: FloatArray, low: float, high: float) -> FloatArray:
    """Return both limits and the nodes between: there a piecewise line has its extremes."""
    return np.concatenate([[low, high], nodes[(nodes > low) & (nodes < high)]])


def numbers(values: object) -> Numbers:
    """Return the numbers of an array as a tuple."""
    return tuple(float(value) for value in np.asarray(values, dtype=np.float64).reshape(-1))
