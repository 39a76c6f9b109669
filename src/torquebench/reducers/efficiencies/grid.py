"""Linear interpolation over scattered torques and speeds, also if they are collinear."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

__all__ = ["interpolated", "weights_at"]

Floats = NDArray[np.float64]
SLACK = 0.01
"""Share of the range by which a point may lie outside."""


def weights_at(speed: Floats, torque: Floats, at_speed: float, at_torque: float) -> Floats | None:
    """Return weights of the points that interpolate linearly at a place; None outside.

    Examples
    --------
    >>> speed, torque = np.array([1.0, 1.0, 3.0, 3.0]), np.array([5.0, 9.0, 5.0, 9.0])
    >>> round(float(weights_at(speed, torque, 2.0, 6.0) @ (speed + torque)), 9)
    8.0
    >>> weights_at(speed, torque, 5.0, 6.0) is None
    True
    """
    if speed.size == 0:
        return None
    found = _weights(speed, torque, np.array([at_speed]), np.array([at_torque]))[0]
    return None if np.isnan(found[0]) else found


def interpolated(
    speed: Floats, torque: Floats, value: Floats, speeds: Floats, torques: Floats
) -> Floats:
    """Return values at all torques × speeds, shape (m, n); NaN outside the points."""
    places = np.meshgrid(speeds, torques)
    weight = _weights(speed, torque, places[0].ravel(), places[1].ravel())
    return np.asarray((weight @ value).reshape(torques.size, speeds.size))


def _weights(speed: Floats, torque: Floats, at_speed: Floats, at_torque: Floats) -> Floats:
    """Return weights, shape (places, points); rows of NaN outside."""
    axes: list[Floats | None] = []
    places: list[Floats] = []
    for column, place in ((speed, at_speed), (torque, at_torque)):
        width = float(np.ptp(column))
        if width <= SLACK * float(np.abs(column).max()):
            middle = float(column.mean())
            outside = np.abs(place - middle) > SLACK * abs(middle)
            places.append(np.where(outside, np.nan, 0.0))
            axes.append(None)
            continue
        scaled = (place - column.min()) / width
        scaled = np.where((scaled < -SLACK) | (scaled > 1 + SLACK), np.nan, np.clip(scaled, 0, 1))
        places.append(scaled)
        axes.append((column - column.min()) / width)
    outside = np.isnan(places[0]) | np.isnan(places[1])
    result = np.full((at_speed.size, speed.size), np.nan)
    inside = np.flatnonzero(~outside)
    both = [axis for axis in axes if axis is not None]
    if not both:
        result[inside] = 1.0 / speed.size
    elif len(both) == 1:
        place = places[0] if axes[0] is not None else places[1]
        result[inside] = _along(both[0], place[inside])
    else:
        result[inside] = _across(np.column_stack(both), np.column_stack(places)[inside])
    return result


def _along(axis: Floats, place: Floats) -> Floats:
    order = np.argsort(axis, kind="stable")
    units = np.eye(axis.size)[order]
    columns = [np.interp(place, axis[order], units[:, k]) for k in range(axis.size)]
    return np.column_stack(columns)


def _across(points: Floats, places: Floats) -> Floats:
    try:
        mesh = Delaunay(points)
    except QhullError:  # all points on one oblique line
        far = points[np.argmax(np.ptp(points, axis=0))]
        return _along(points @ far, places @ far)
    simplex = mesh.find_simplex(places, tol=1e-9)
    weight = np.full((places.shape[0], points.shape[0]), np.nan)
    for row in np.flatnonzero(simplex >= 0):
        transform = mesh.transform[simplex[row]]
        part = transform[:2] @ (places[row] - transform[2])
        weight[row] = 0.0
        weight[row, mesh.simplices[simplex[row]]] = [*part, 1.0 - part.sum()]
    return weight
