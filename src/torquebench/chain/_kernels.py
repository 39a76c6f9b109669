"""Effects at single readings, without the overhead of NumPy calls."""

import math

import numpy as np
from numpy.typing import NDArray

from torquebench.compensation.piecewise import interpolated
from torquebench.kernels import inner, kernel

__all__ = ["goes_on", "inertia", "rotation", "standard", "temperature"]

FloatArray = NDArray[np.float64]


@inner
def _place(nodes: FloatArray, value: float) -> tuple[int, int, float]:
    """Return the nodes around a value and the share of the way between; clamped at the ends."""
    last = nodes.size - 1
    if last == 0:
        return 0, 0, 0.0
    held = min(max(value, nodes[0]), nodes[last])
    below = max(min(np.searchsorted(nodes, held, side="right") - 1, last - 1), 0)
    return below, below + 1, (held - nodes[below]) / (nodes[below + 1] - nodes[below])


@inner
def _on_line(column: FloatArray, place: tuple[int, int, float]) -> float:
    i, j, share = place
    return float(column[i] + share * (column[j] - column[i]))


@inner
def _on_table(
    table: FloatArray, row: tuple[int, int, float], column: tuple[int, int, float]
) -> float:
    i, j, share = row
    low, high = _on_line(table[i], column), _on_line(table[j], column)
    return float(low + share * (high - low))


@kernel
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


@kernel
def goes_on(time_s: FloatArray, before_s: float, interval_s: float, allowed_s: float) -> bool:
    """Return whether times follow an earlier one, and each other, at an interval."""
    for k in range(time_s.size):
        if not abs(time_s[k] - before_s - interval_s) <= allowed_s:
            return False
        before_s = time_s[k]
    return True


@kernel
def inertia(
    acceleration: FloatArray, uncertainty: FloatArray, moment: tuple[float, float], unknown: float
) -> FloatArray:
    """Return rows: u of the inertia's torque with the acceleration's sign, and its correction.

    `moment` is followed by its u; `unknown` is the u of an acceleration that isn't known.
    """
    found = np.empty((2, acceleration.size))
    for k in range(acceleration.size):
        now, of_now = acceleration[k], uncertainty[k]
        if math.isnan(now):
            now, of_now = 0.0, unknown
        found[0, k] = math.copysign(math.hypot(moment[1] * now, moment[0] * of_now), now)
        found[1, k] = -moment[0] * now
    return found


@kernel
def standard(torque_nm: FloatArray, down: FloatArray, up: FloatArray) -> FloatArray:
    """Return half of a standard's U with the torque's sign.

    `down` and `up` have the sizes of the certified torques of each direction, and U.
    """
    found = np.empty(torque_nm.size)
    for k in range(torque_nm.size):
        side = down if torque_nm[k] < 0.0 else up
        size = abs(torque_nm[k])
        within = min(max(size, side[0, 0]), side[0, -1])
        expanded = interpolated(within, side[0], side[1]) * (size / within)
        found[k] = math.copysign(0.5 * expanded, torque_nm[k])
    return found


@kernel
def rotation(
    speed_rpm: FloatArray,
    now_c: FloatArray,
    torque_nm: FloatArray,
    nodes: tuple[FloatArray, FloatArray, FloatArray],
    tables: FloatArray,
    blind: FloatArray,
    columns: FloatArray,
    loads: FloatArray,
    noise: FloatArray,
    unknown: FloatArray,
    load_unknown: FloatArray,
    limits_rpm: tuple[float, float, float],
    lubrication: tuple[float, float],
    widening: float,
    places: tuple[float, float, float],
) -> tuple[FloatArray, FloatArray]:
    """Return rows of the components, and the readings' places.

    The rows are u of the zero, its correction, u of the drag, its correction, u of the lubrication,
    noise, running-in, its u.

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
    noise : float64 array of shape (speeds,)
        Noise in a window of the empty runs; empty if unknown.
    unknown : float64 array of shape (5,)
        At an unknown speed: u of the zero, of the drag, of the span (share of the torque) and of
        running-in, and the largest drag.
    load_unknown : float64 array of shape (2, torques)
        At an unknown speed: u of the drag by the load, and its largest value.
    limits_rpm : lowest and highest speed, and the largest speed of a standing shaft
    lubrication : factor on the drag, and its u
    widening : noise of a reading's window by that of the empty runs' windows
    places : correlation lengths of speed and temperature, and the temperature if none is known
    """
    found, place = np.zeros((8, speed_rpm.size)), np.empty((speed_rpm.size, 2))
    value = np.empty(4)
    for k in range(speed_rpm.size):
        speed, warm = speed_rpm[k], now_c[k]
        place[k, 0] = (0.0 if math.isnan(speed) else abs(speed)) / places[0]
        place[k, 1] = (places[2] if math.isnan(warm) else warm) / places[1]
        if noise.size:
            size = nodes[0][-1] if math.isnan(speed) else abs(speed)
            found[5, k] = widening * interpolated(size, nodes[0], noise)
        if math.isnan(speed):
            of_span, load_u, most = unknown[2] * torque_nm[k], 0.0, unknown[4]
            if nodes[2].size:
                column = _place(nodes[2], abs(torque_nm[k]))
                load_u = _on_line(load_unknown[0], column)
                most += _on_line(load_unknown[1], column)
            found[0, k] = math.sqrt(unknown[0] * unknown[0] + of_span * of_span)
            found[2, k] = lubrication[0] * math.sqrt(unknown[1] * unknown[1] + load_u * load_u)
            found[4, k] = lubrication[1] * most
            found[7, k] = unknown[3]
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
        drag = -sign * (value[2] + load)
        found[2, k] = lubrication[0] * (sign * math.sqrt(value[3] * value[3] + load_u * load_u))
        found[3, k] = lubrication[0] * drag
        found[4, k] = lubrication[1] * drag
        found[6, k] = sign * _on_line(columns[2], row)
        found[7, k] = sign * _on_line(columns[3], row)
    return found, place
