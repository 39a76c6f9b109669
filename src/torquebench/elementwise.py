"""Functions for formulas that are fast both for many readings and for one, as in a live block.

A call of NumPy takes as long as some thirty operations of Python's floats. A formula that takes its
functions from `elementwise` calculates many readings as arrays and a single one as floats, with
identical results.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
Values = FloatArray | float
"""Many readings as an array, or a single one as a float."""


class _Floats:
    """Versions of NumPy's functions for single floats; the first argument may be NaN."""

    all = any = staticmethod(bool)
    copysign = staticmethod(math.copysign)
    isnan = staticmethod(math.isnan)
    maximum = staticmethod(max)
    minimum = staticmethod(min)
    sqrt = staticmethod(math.sqrt)

    @staticmethod
    def fmax(value: float, limit: float) -> float:
        return value if value >= limit else limit

    @staticmethod
    def fmin(value: float, limit: float) -> float:
        return value if value <= limit else limit

    @staticmethod
    def where(condition: bool, yes: Any, no: Any) -> Any:
        return yes if condition else no


_FLOATS = _Floats()


def functions_for(values: Values) -> Any:
    """Return NumPy for an array; for a float, an object with some of its functions."""
    return np if isinstance(values, np.ndarray) else _FLOATS


def elementwise(like: Values, *values: Values | None) -> tuple[Any, list[Any]]:
    """Return functions for arrays, or for floats if `like` is a float, and their arguments.

    Parameters
    ----------
    like : float64[n] or float
        The readings of a formula.
    values : float64[n], float or None
        One value for each reading or for all of them; None becomes NaN.

    Returns
    -------
    functions
        As `functions_for` returns them.
    values : list of float64[n] or float
        Floats if `like` is one.

    Examples
    --------
    >>> functions, (length,) = elementwise(1.0, np.array([-4.0]))
    >>> functions.sqrt(abs(length))
    2.0
    """
    if isinstance(like, np.ndarray):
        return np, [np.nan if value is None else value for value in values]
    return _FLOATS, [
        math.nan if value is None else value.item() if isinstance(value, np.ndarray) else value
        for value in values
    ]


def in_rows(like: Values, *values: Values) -> Any:
    """Return values of the readings `like` as the rows of an array; floats as they are."""
    if not isinstance(like, np.ndarray):
        return values
    rows = np.empty((len(values), like.size))
    for row, value in zip(rows, values, strict=True):
        row[:] = value
    return rows


def in_columns(like: Values, *values: Values) -> FloatArray:
    """Return values of the readings `like` as the columns of an array; floats as its only row."""
    if not isinstance(like, np.ndarray):
        return np.array([values])
    columns = np.empty((like.size, len(values)))
    for number, value in enumerate(values):
        columns[:, number] = value
    return columns


class NodePosition(NamedTuple):
    """Positions of values between nodes: both adjacent nodes, and the share of the interval.

    The members are two integers and a float for one value, arrays for many.
    """

    below: Any
    above: Any
    share: Any


def located(nodes: FloatArray, values: FloatArray | float) -> NodePosition:
    """Return the positions of values; those outside are treated as the nearest node."""
    last = nodes.size - 1
    if last == 0:
        none = 0 if isinstance(values, float) else np.zeros(np.shape(values), dtype=np.intp)
        return NodePosition(none, none, 0.0 * none)
    if isinstance(values, float):
        at: Any = nodes.data  # its items are floats
        inside = at[0] if values < at[0] else at[last] if values > at[last] else values
        below: Any = min(bisect_right(at, inside), last) - 1
        low = at[below]
        return NodePosition(below, below + 1, (inside - low) / (at[below + 1] - low))
    within = np.minimum(np.maximum(values, nodes[0]), nodes[last])
    below = np.minimum(np.maximum(nodes.searchsorted(within, side="right") - 1, 0), last - 1)
    return NodePosition(
        below, below + 1, (within - nodes[below]) / (nodes[below + 1] - nodes[below])
    )


def on_lines(curves: FloatArray, position: NodePosition) -> Any:
    """Interpolate curves, one in each row; return a list for one position, rows for many."""
    below, above, share = position
    if isinstance(below, int):
        lines = curves[:, below : above + 1].tolist()
        return [line[0] + share * (line[-1] - line[0]) for line in lines]
    low = curves[:, below]
    return low + share * (curves[:, above] - low)


def on_tables(tables: FloatArray, row: NodePosition, column: NodePosition) -> Any:
    """Interpolate tables along their rows and columns; return values as `on_lines` does."""
    (i, j, share), (left, right, part) = row, column
    if isinstance(i, int) and isinstance(left, int):
        cells = tables[:, i : j + 1, left : right + 1].tolist()
        lines = [[line[0] + part * (line[-1] - line[0]) for line in cell] for cell in cells]
        return [line[0] + share * (line[-1] - line[0]) for line in lines]
    low, high = tables[:, i, left], tables[:, j, left]
    low = low + part * (tables[:, i, right] - low)
    high = high + part * (tables[:, j, right] - high)
    return low + share * (high - low)
