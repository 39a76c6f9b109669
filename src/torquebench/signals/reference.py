"""Reference implementation of the counters in plain NumPy, window by window.

Independent of the integer sums in the hot loops: floating point, textbook formulas. For tests and
for reading; use `torquebench.signals.count_windows` for work.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals.edges import as_ticks
from torquebench.signals.windows import CounterMethod

__all__ = ["reference_frequency"]

Edges = NDArray[np.float64]


def reference_frequency(
    ticks: ArrayLike,
    starts: ArrayLike,
    stops: ArrayLike,
    method: CounterMethod,
    *,
    timebase_hz: float,
) -> NDArray[np.float64]:
    """Frequency of each window [start, stop) in Hz, NaN where it has too few edges.

    Parameters
    ----------
    ticks : array_like of int, shape (m,)
        Edges, strictly increasing.
    starts, stops : array_like of int, shape (n,)
        Windows in ticks.
    method : {"gated", "reciprocal", "regression", "triangular"}
        The counter.
    timebase_hz : float
        Timebase in Hz.

    Examples
    --------
    >>> reference_frequency([10, 20, 30, 40, 50], [0], [60], "regression", timebase_hz=100e6)
    array([10000000.])
    """
    if method not in _PERIODS:
        raise InputError(Message("counter {method!r}", method), ", ".join(_PERIODS))
    edges = as_ticks(ticks)
    borders = zip(as_ticks(starts).tolist(), as_ticks(stops).tolist(), strict=True)
    fewest = 1 if method == "gated" else 2
    result = []
    for start, stop in borders:
        inside = edges[(edges >= start) & (edges < stop)] - start
        if inside.size < fewest:
            result.append(np.nan)
        else:
            result.append(timebase_hz / _PERIODS[method](inside.astype(np.float64), stop - start))
    return np.array(result)


def _gated(edges: Edges, length: float) -> float:
    return length / edges.size


def _reciprocal(edges: Edges, length: float) -> float:  # noqa: ARG001 - one signature for all
    return float(edges[-1] - edges[0]) / (edges.size - 1)


def _regression(edges: Edges, length: float) -> float:  # noqa: ARG001
    """Slope of the edges' times against their number."""
    number = np.arange(edges.size) - (edges.size - 1) / 2
    return float(number @ (edges - edges.mean()) / (number @ number))


def _triangular(edges: Edges, length: float) -> float:  # noqa: ARG001
    """Difference of the mean times of the last and the first half of the edges."""
    half = edges.size // 2
    return float(edges[-half:].mean() - edges[:half].mean()) / (edges.size - half)


_PERIODS: dict[CounterMethod, Callable[[Edges, float], float]] = {
    "gated": _gated,
    "reciprocal": _reciprocal,
    "regression": _regression,
    "triangular": _triangular,
}
