"""Corrections of readings and their uncertainties, from measured tables."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["goes_on", "inertia", "rotation", "standard", "temperature"]

FloatArray = NDArray[np.float64]
Place = tuple[NDArray[np.intp], NDArray[np.intp], FloatArray]


def _place(nodes: FloatArray, values: FloatArray) -> Place:
    """Return the nodes around values and the share of the distance between; clamped at the ends."""
    last = nodes.size - 1
    if last == 0:
        none = np.zeros(values.size, dtype=np.intp)
        return none, none, np.zeros(values.size)
    held = np.minimum(np.maximum(values, nodes[0]), nodes[last])
    below = np.minimum(np.maximum(nodes.searchsorted(held, side="right") - 1, 0), last - 1)
    return below, below + 1, (held - nodes[below]) / (nodes[below + 1] - nodes[below])


def _between(curves: FloatArray, place: Place) -> FloatArray:
    """Return interpolated values of curves, given as rows."""
    i, j, share = place
    low = curves[:, i]
    return np.asarray(low + share * (curves[:, j] - low))


def _on_tables(tables: FloatArray, row: Place, column: Place) -> FloatArray:
    """Return interpolated values of stacked tables."""
    (i, j, share), (left, right, part) = row, column
    low, high = tables[:, i, left], tables[:, j, left]
    low = low + part * (tables[:, i, right] - low)
    high = high + part * (tables[:, j, right] - high)
    return np.asarray(low + share * (high - low))


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
    nowhere = np.isnan(now_c)
    found[4] = np.where(nowhere, calibrated_c, now_c) / correlation_k
    some: Any = ~nowhere
    if some.all():
        some = slice(None)
    else:
        found[0, nowhere], found[2, nowhere] = unknown[0], unknown[1] * torque_nm[nowhere]
    warm, zeroed, torque = now_c[some], zeroed_c[some], torque_nm[some]
    near = np.minimum(np.abs(warm - zeroed) / correlation_k, 1.0)
    zero, of_zero, span, of_span, zero_slope, span_slope = _between(curves, _place(nodes, warm))
    before, of_before = _between(curves[:2], _place(nodes, zeroed))
    found[0, some] = near * np.sqrt(of_zero * of_zero + of_before * of_before)
    outside = (warm < nodes[0]) | (warm > nodes[-1])
    found[1, some] = np.where(outside, np.nan, before - zero)
    found[2, some] = of_span * torque
    found[3, some] = -span * torque
    found[5, some] = zero_slope + span_slope * torque
    return found


def goes_on(time_s: FloatArray, before_s: float, interval_s: float, allowed_s: float) -> bool:
    """Return whether times continue from an earlier time at a given interval."""
    steps = np.diff(time_s, prepend=before_s)
    return bool((np.abs(steps - interval_s) <= allowed_s).all())


def inertia(
    acceleration: FloatArray, uncertainty: FloatArray, moment: tuple[float, float], unknown: float
) -> FloatArray:
    """Return rows: u of the inertia's torque, with the acceleration's sign, and the correction.

    `moment` holds the moment of inertia and its u; `unknown` is the u of an unknown acceleration.
    """
    nothing = np.isnan(acceleration)
    now = np.where(nothing, 0.0, acceleration)
    of_now = np.where(nothing, unknown, uncertainty)
    of_torque = np.copysign(np.hypot(moment[1] * now, moment[0] * of_now), now)
    return np.array((of_torque, -moment[0] * now))


def standard(torque_nm: FloatArray, down: FloatArray, up: FloatArray) -> FloatArray:
    """Return half of a standard's U (k = 2), with the torque's sign.

    `down` and `up` hold magnitudes of the certified torques and their U, for each direction.
    """
    size = np.abs(torque_nm)
    expanded = []
    for side in (down, up):
        within = np.minimum(np.maximum(size, side[0, 0]), side[0, -1])
        expanded.append(np.interp(within, side[0], side[1]) * (size / within))
    return np.asarray(np.copysign(0.5 * np.where(torque_nm < 0.0, *expanded), torque_nm))


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
    """Return rows of the components, and the positions of the readings in correlation lengths.

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
    size = np.abs(speed_rpm)
    anything, cold = np.isnan(speed_rpm), np.isnan(now_c)
    place[:, 0] = np.where(anything, 0.0, size) / places[0]
    place[:, 1] = np.where(cold, places[2], now_c) / places[1]
    if noise.size:
        found[5] = widening * np.interp(np.where(anything, nodes[0][-1], size), nodes[0], noise)
    if anything.any():
        torque = torque_nm[anything]
        load_u, most = np.zeros(torque.size), np.full(torque.size, unknown[4])
        if nodes[2].size:
            load_u, largest = _between(load_unknown, _place(nodes[2], np.abs(torque)))
            most += largest
        found[0, anything] = np.sqrt(unknown[0] * unknown[0] + np.square(unknown[2] * torque))
        found[2, anything] = lubrication[0] * np.sqrt(unknown[1] * unknown[1] + load_u * load_u)
        found[4, anything] = lubrication[1] * most
        found[7, anything] = unknown[3]
    turns = size > limits_rpm[2]
    outside = (speed_rpm < limits_rpm[0]) | (speed_rpm > limits_rpm[1])
    outside |= turns & ((now_c < nodes[1][0]) | (now_c > nodes[1][-1]))
    found[1, outside] = np.nan
    if not turns.any():
        return found, place
    sign, torque, cold = np.sign(speed_rpm[turns]), torque_nm[turns], cold[turns]
    row = _place(nodes[0], size[turns])
    warm = _place(nodes[1], np.where(cold, nodes[1][0], now_c[turns]))
    zero, of_zero, drag, of_drag = np.where(
        cold, _between(blind, row), _on_tables(tables, row, warm)
    )
    span, of_span, running_in, of_running_in = _between(columns, row)
    of_span = of_span * torque
    found[0, turns] = np.sqrt(of_zero * of_zero + of_span * of_span)
    found[1, turns] -= zero + span * torque
    if nodes[2].size:
        load, load_u = _on_tables(loads, row, _place(nodes[2], np.abs(torque)))
        drag, of_drag = drag + load, np.sqrt(of_drag * of_drag + load_u * load_u)
    found[2, turns] = lubrication[0] * (sign * of_drag)
    found[3, turns] = lubrication[0] * (-sign * drag)
    found[4, turns] = lubrication[1] * (-sign * drag)
    found[6, turns] = sign * running_in
    found[7, turns] = sign * of_running_in
    return found, place
