"""Triangle mesh of a section: Delaunay of its outline and a lattice, with every side kept."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from torquebench.errors import InputError
from torquebench.mechanics.outline import Outline

__all__ = ["triangulate"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ROUNDS = 12


def triangulate(outline: Outline, size_m: float) -> tuple[FloatArray, IntArray]:
    """Cut a section into triangles.

    Sides longer than the size are divided; the inside gets a hexagonal lattice of this spacing.
    A side that the Delaunay triangulation doesn't keep is halved until all are kept.

    Parameters
    ----------
    outline : Outline
        The section.
    size_m : float
        Length of a triangle's side inside.

    Returns
    -------
    points : float64[n, 2]
        Corners of the triangles.
    triangles : int64[m, 3]
        Their numbers, counterclockwise.

    Raises
    ------
    InputError
        If the loops cross or touch each other.
    """
    border, sides = _divided(outline, size_m)
    lattice = _lattice(outline, size_m)
    for _ in range(_ROUNDS):
        starts, ends = border[sides[:, 0]], border[sides[:, 1]]
        reach = 0.5 * np.hypot(*(ends - starts).T)
        near = _distance(lattice, 0.5 * (starts + ends)) < 1.02 * reach
        lattice = lattice[~near.any(axis=1)]
        points = np.vstack((border, lattice))
        triangles = Delaunay(points).simplices.astype(np.int64)
        lost = ~_kept(triangles, sides, len(points))
        if not lost.any():
            break
        middle = 0.5 * (starts[lost] + ends[lost])
        fresh = len(border) + np.arange(len(middle))
        halves = np.vstack(
            (np.column_stack((sides[lost, 0], fresh)), np.column_stack((fresh, sides[lost, 1])))
        )
        border, sides = np.vstack((border, middle)), np.vstack((sides[~lost], halves))
    else:
        raise InputError("an outline whose loops cross or touch", "loops that stay apart")
    triangles = triangles[outline.contains(points[triangles].mean(axis=1))]
    triangles, areas = _counterclockwise(points, triangles)
    if not np.isclose(areas.sum(), outline.area_m2, rtol=1e-9):
        raise InputError("an outline whose loops cross", "loops that stay apart")
    triangles = triangles[areas > 1e-12 * areas.sum()]
    used, numbers = np.unique(triangles, return_inverse=True)
    return points[used], numbers.reshape(triangles.shape).astype(np.int64)


def _divided(outline: Outline, size_m: float) -> tuple[FloatArray, IntArray]:
    """Return the corners of all loops with long sides divided, and the sides as index pairs."""
    borders, sides, count = [], [], 0
    for loop in outline.loops:
        parts = []
        for start, end in zip(loop, np.roll(loop, -1, axis=0), strict=True):
            pieces = max(1, int(np.ceil(np.hypot(*(end - start)) / size_m)))
            share = np.arange(pieces)[:, np.newaxis] / pieces
            parts.append(start + share * (end - start))
        corners = np.vstack(parts)
        numbers = count + np.arange(len(corners))
        borders.append(corners)
        sides.append(np.column_stack((numbers, np.roll(numbers, -1))))
        count += len(corners)
    return np.vstack(borders), np.vstack(sides)


def _lattice(outline: Outline, size_m: float) -> FloatArray:
    """Hexagonal lattice inside the section."""
    corners = np.vstack(outline.loops)
    low, high = corners.min(axis=0), corners.max(axis=0)
    rise = 0.5 * np.sqrt(3.0) * size_m
    y = np.arange(low[1] + 0.5 * rise, high[1], rise)
    x = np.arange(low[0], high[0] + size_m, size_m)
    grid_x = x + 0.5 * size_m * (np.arange(len(y)) % 2)[:, np.newaxis]
    grid = np.column_stack((grid_x.ravel(), np.repeat(y, len(x))))
    return grid[outline.contains(grid)]


def _distance(points: FloatArray, others: FloatArray) -> FloatArray:
    gap = points[:, np.newaxis, :] - others[np.newaxis, :, :]
    return np.asarray(np.hypot(gap[..., 0], gap[..., 1]))


def _kept(triangles: IntArray, sides: IntArray, count: int) -> NDArray[np.bool_]:
    """Return which sides are sides of triangles."""
    edges = np.vstack((triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]))
    return np.isin(_key(sides, count), _key(edges, count))


def _key(pairs: IntArray, count: int) -> IntArray:
    ordered = np.sort(pairs, axis=1)
    return np.asarray(ordered[:, 0] * count + ordered[:, 1])


def _counterclockwise(points: FloatArray, triangles: IntArray) -> tuple[IntArray, FloatArray]:
    first, second, third = (points[triangles[:, k]] for k in range(3))
    along, across = second - first, third - first
    doubled = along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0]
    turned = np.where((doubled < 0.0)[:, np.newaxis], triangles[:, ::-1], triangles)
    return turned, 0.5 * np.abs(doubled)
