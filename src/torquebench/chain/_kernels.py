"""Interpolation of measured effects at single readings, without the overhead of NumPy calls."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["rotation", "temperature"]

FloatArray = NDArray[np.float64]


@njit(cache=True)
def _place(nodes: FloatArray, value: float) -> tuple[int, int, float]:
    """Return the nodes around a value and the share of the way between; clamped at the ends."""
    last = nodes.size - 1
    if last == 0:
        return 0, 0, 0.0
    held = min(max(value, nodes[0]), nodes[last])
    below = max(min(np.searchsorted(nodes, held, side="right") - 1, last - 1), 0)
    return below, below + 1, (held - nodes[below]) / (nodes[below + 1] - nodes[below])


@njit(cache=True)
def _on_line(column: FloatArray, place: tuple[int, int, float]) -> float:
    i, j, share = place
    return float(column[i] + share * (column[j] - column[i]))


@njit(cache=True)
def _on_table(
    table: FloatArray, row: tuple[int, int, float], column: tuple[int, int, float]
) -> float:
    i, j, share = row
    low, high = _on_line(table[i], column), _on_line(table[j], column)
    return float(low + share * (high - low))


@njit(cache=True)
def temperature(
    now_c: FloatArray,
    zeroed_c: FloatArray,
    torque_nm: FloatArray,
    nodes: FloatArray,
    curves: FloatArray,
    unknown: tuple[float, float],
    calibrated_c: float,
    correlation_k: float,
) -> FloatArray:
    """Return rows: u of the zero, its correction, u of the span, its correction, place, slope.

    `curves` has the zero, its u, the span, its u, and the slopes of zero and span; the slope of a
    row is that of the reading, N·m/K.
    """
    found = np.zeros((6, now_c.size))
    for k in range(now_c.size):
        warm = now_c[k]
        found[4, k] = (calibrated_c if math.isnan(warm) else warm) / correlation_k
        if math.isnan(warm):
            found[0, k], found[2, k] = unknown[0], unknown[1] * torque_nm[k]
            continue
        at, before = _place(nodes, warm), _place(nodes, zeroed_c[k])
        near = min(abs(warm - zeroed_c[k]) / correlation_k, 1.0)
        u, u_before = _on_line(curves[1], at), _on_line(curves[1], before)
        found[0, k] = near * math.sqrt(u * u + u_before * u_before)
        found[1, k] = _on_line(curves[0], before) - _on_line(curves[0], at)
        if warm < nodes[0] or warm > nodes[-1]:
            found[1, k] = np.nan
        found[2, k] = _on_line(curves[3], at) * torque_nm[k]
        found[3, k] = -_on_line(curves[2], at) * torque_nm[k]
        found[5, k] = _on_line(curves[4], at) + _on_line(curves[5], at) * torque_nm[k]
    return found


@njit(cache=True)
def rotation(
    speed_rpm: FloatArray,
    now_c: FloatArray,
    torque_nm: FloatArray,
    nodes: tuple[FloatArray, FloatArray, FloatArray],
    tables: FloatArray,
    blind: FloatArray,
    columns: FloatArray,
    loads: FloatArray,
    unknown: tuple[float, float],
    limits_rpm: tuple[float, float, float],
) -> FloatArray:
    """Return rows: u of the zero, its correction, u of the drag, its correction, running-in, its u.

    Parameters
    ----------
    tables : float64 array of shape (4, speeds, temperatures)
        Zero over speed and its u, drag and its u.
    blind : float64 array of shape (4, speeds)
        The same where no temperature is known.
    columns : float64 array of shape (4, speeds)
        Span over speed and its u, running-in and its u.
    loads : float64 array of shape (2, speeds, torques)
        Drag by the load and its u; no torques where it wasn't identified.
    limits_rpm : lowest and highest speed, and the largest speed of a standing shaft
    """
    found = np.zeros((6, speed_rpm.size))
    value = np.empty(4)
    for k in range(speed_rpm.size):
        speed, warm = speed_rpm[k], now_c[k]
        if math.isnan(speed):
            found[0, k], found[2, k] = unknown
            continue
        outside = speed < limits_rpm[0] or speed > limits_rpm[1]
        sign = 0.0
        if abs(speed) > limits_rpm[2]:
            sign = 1.0 if speed > 0.0 else -1.0
            outside = outside or warm < nodes[1][0] or warm > nodes[1][-1]
        if outside:
            found[1, k] = np.nan
        if sign == 0.0:
            continue
        row = _place(nodes[0], abs(speed))
        for number in range(4):
            if math.isnan(warm):
                value[number] = _on_line(blind[number], row)
            else:
                value[number] = _on_table(tables[number], row, _place(nodes[1], warm))
        of_span = _on_line(columns[1], row) * torque_nm[k]
        found[0, k] = math.sqrt(value[1] * value[1] + of_span * of_span)
        found[1, k] -= value[0] + _on_line(columns[0], row) * torque_nm[k]
        load, load_u = 0.0, 0.0
        if nodes[2].size:
            column = _place(nodes[2], abs(torque_nm[k]))
            load, load_u = _on_table(loads[0], row, column), _on_table(loads[1], row, column)
        found[2, k] = sign * math.sqrt(value[3] * value[3] + load_u * load_u)
        found[3, k] = -sign * (value[2] + load)
        found[4, k] = sign * _on_line(columns[2], row)
        found[5, k] = sign * _on_line(columns[3], row)
    return found
