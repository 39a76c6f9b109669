"""Tables over speed and temperature, linear between their nodes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from torquebench.chain.readings import FloatArray

__all__ = ["Place", "Table", "between", "bilinear", "linear", "located", "numbers"]

Numbers = tuple[float, ...]
Table = tuple[Numbers, ...]
"""Table with one row for each node of the first quantity."""


class Place(NamedTuple):
    """Positions between nodes: the node below, and the share of the distance to the next."""

    node: NDArray[np.intp]
    share: FloatArray


def located(nodes: FloatArray, values: FloatArray) -> Place:
    """Return the positions of values; values outside are clamped to the nearest node."""
    if nodes.size == 1:
        return Place(np.zeros(np.shape(values), dtype=np.intp), np.zeros(np.shape(values)))
    node = np.clip(np.searchsorted(nodes, values, side="right") - 1, 0, nodes.size - 2)
    share = (values - nodes[node]) / (nodes[node + 1] - nodes[node])
    return Place(node, np.clip(share, 0.0, 1.0))


def linear(table: FloatArray, at: Place) -> FloatArray:
    """Return a column, interpolated between its nodes."""
    following = np.minimum(at.node + 1, table.size - 1)
    return np.asarray(table[at.node] + at.share * (table[following] - table[at.node]))


def bilinear(table: FloatArray, row: Place, column: Place) -> FloatArray:
    """Return a table, interpolated between its nodes."""
    last_row, last_column = table.shape[0] - 1, table.shape[1] - 1
    below, above = row.node, np.minimum(row.node + 1, last_row)
    left, right = column.node, np.minimum(column.node + 1, last_column)
    low = table[below, left] + column.share * (table[below, right] - table[below, left])
    high = table[above, left] + column.share * (table[above, right] - table[above, left])
    return np.asarray(low + row.share * (high - low))


def between(nodes: FloatArray, low: float, high: float) -> FloatArray:
    """Return both limits and the nodes between: there a piecewise line has its extremes."""
    return np.concatenate([[low, high], nodes[(nodes > low) & (nodes < high)]])


def numbers(values: object) -> Numbers:
    """Return the numbers of an array as a tuple."""
    return tuple(float(each) for each in np.asarray(values, dtype=np.float64).reshape(-1))
