"""Outlines of sections: polygons with holes, and builders of the usual ones."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicSpline

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import TURN

__all__ = [
    "Outline",
    "annulus",
    "circle",
    "closed_curve",
    "polygon",
    "rectangle",
    "rectangles",
    "spline_shaft",
]

FloatArray = NDArray[np.float64]

_SEGMENTS = 120  # of a full circle


@dataclass(frozen=True, eq=False)
class Outline:
    """Boundary of a section: closed polygons in metres that enclose the material.

    Attributes
    ----------
    loops : tuple of float64[n, 2]
        Corners of each polygon, without repeating the first. A point belongs to the section if an
        odd number of loops surrounds it, so a loop inside another one is a hole.

    Raises
    ------
    InputError
        If a loop has fewer than 3 corners, repeats a corner, isn't finite or has no area.

    Examples
    --------
    >>> box = Outline((np.array([[0, 0], [2, 0], [2, 1], [0, 1.0]]),))
    >>> box.area_m2
    2.0
    """

    loops: tuple[FloatArray, ...]

    def __post_init__(self) -> None:
        checked = tuple(_checked(loop) for loop in self.loops)
        if not checked:
            raise InputError("an outline without a loop", "at least one closed polygon")
        object.__setattr__(self, "loops", checked)

    @property
    def area_m2(self) -> float:
        """Area of the material, m²."""
        total = 0.0
        for k, loop in enumerate(self.loops):
            others = [other for j, other in enumerate(self.loops) if j != k]
            depth = sum(bool(_surrounds(other, loop[:1])[0]) for other in others)
            total += (-1.0) ** depth * abs(_signed_area(loop))
        return total

    @property
    def perimeter_m(self) -> float:
        """Length of all loops, m."""
        return float(sum(np.hypot(*(np.roll(a, -1, axis=0) - a).T).sum() for a in self.loops))

    def contains(self, points: FloatArray) -> NDArray[np.bool_]:
        """Return which points (n, 2) are in the material."""
        inside = np.zeros(len(points), dtype=np.bool_)
        for loop in self.loops:
            inside ^= _surrounds(loop, points)
        return inside


def _signed_area(loop: FloatArray) -> float:
    x, y = loop.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _checked(loop: ArrayLike) -> FloatArray:
    corners = np.array(loop, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise InputError(
            Message("a loop of shape {shape}", corners.shape), "(n, 2) with at least 3 corners"
        )
    if not np.isfinite(corners).all():
        raise InputError("a corner that isn't finite", "finite coordinates in metres")
    sides = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    if not sides.min() > 1e-9 * sides.sum():
        raise InputError(
            Message("a repeated corner (number {argmin})", int(sides.argmin()) + 1),
            "every corner once",
            "leave out the closing corner",
        )
    if not abs(_signed_area(corners)) > 1e-12 * sides.sum() ** 2:
        raise InputError("a loop without area", "a closed polygon that surrounds something")
    corners.setflags(write=False)
    return corners


def _surrounds(loop: FloatArray, points: FloatArray) -> NDArray[np.bool_]:
    """Even-odd rule: count crossings of the ray to +x."""
    x, y = points[:, :1], points[:, 1:]
    x0, y0 = loop.T
    x1, y1 = np.roll(loop, -1, axis=0).T
    between = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    crossing = x0 + (y - y0) / rise * (x1 - x0)
    return np.asarray((between & (x < crossing)).sum(axis=1) % 2 == 1)


def polygon(corners_m: ArrayLike, holes_m: Sequence[ArrayLike] = ()) -> Outline:
    """Build a section from its corners.

    Parameters
    ----------
    corners_m : array_like (n, 2)
        Corners of the outside in metres, in either sense, first not repeated.
    holes_m : sequence of array_like (n, 2)
        Corners of each hole.

    Returns
    -------
    Outline
        The section.

    Raises
    ------
    InputError
        See `Outline`.

    Examples
    --------
    >>> polygon([[0, 0], [4, 0], [0, 3]]).area_m2
    6.0
    """
    return Outline((_checked(corners_m), *(_checked(hole) for hole in holes_m)))


def rectangle(width_m: float, height_m: float) -> Outline:
    """Build a solid rectangle.

    Parameters
    ----------
    width_m, height_m : float
        Sides in metres.

    Returns
    -------
    Outline
        The section.

    Raises
    ------
    InputError
        If a side isn't positive.

    Examples
    --------
    >>> rectangle(0.2, 0.1).area_m2.__round__(6)
    0.02
    """
    return rectangles([(0.0, 0.0, width_m, height_m)])


def rectangles(boxes_m: Sequence[tuple[float, float, float, float]]) -> Outline:
    """Build the union of upright rectangles: angles, tees, crosses, frames, separate bars.

    Parameters
    ----------
    boxes_m : sequence of (left, bottom, right, top)
        Rectangles in metres; they may overlap and touch along sides.

    Returns
    -------
    Outline
        Boundary of the union, holes included.

    Raises
    ------
    InputError
        If a rectangle has no area, or parts of the union meet in a corner only.

    Examples
    --------
    >>> tee = rectangles([(0, 4, 6, 5), (2.5, 0, 3.5, 4)])
    >>> tee.area_m2, len(tee.loops)
    (10.0, 1)
    """
    boxes = np.array(boxes_m, dtype=np.float64).reshape(-1, 4)
    if not (len(boxes) and np.all(boxes[:, 2:] > boxes[:, :2])):
        raise InputError(
            Message("rectangles {boxes_m!r}", boxes_m),
            "left < right and bottom < top, at least one rectangle",
        )
    x = np.unique(boxes[:, [0, 2]])
    y = np.unique(boxes[:, [1, 3]])
    filled = np.zeros((len(x) + 1, len(y) + 1), dtype=np.bool_)  # with an empty rim
    for left, bottom, right, top in boxes:
        columns = slice(np.searchsorted(x, left) + 1, np.searchsorted(x, right) + 1)
        filled[columns, np.searchsorted(y, bottom) + 1 : np.searchsorted(y, top) + 1] = True
    following: dict[tuple[int, int], tuple[int, int]] = {}
    for i in range(1, len(x)):
        for j in range(1, len(y)):
            if not filled[i, j]:
                continue
            low, high = (i - 1, j - 1), (i, j)
            sides = (
                (filled[i, j - 1], low, (i, j - 1)),
                (filled[i + 1, j], (i, j - 1), high),
                (filled[i, j + 1], high, (i - 1, j)),
                (filled[i - 1, j], (i - 1, j), low),
            )
            for neighbour, start, stop in sides:
                if neighbour:
                    continue
                if start in following:
                    raise InputError(
                        Message(
                            "rectangles that meet in the corner ({x}, {y}) only",
                            x[start[0]],
                            y[start[1]],
                        ),
                        "parts that overlap, touch along a side or stay apart",
                    )
                following[start] = stop
    return Outline(tuple(_trace(following, x, y)))


def _trace(
    following: dict[tuple[int, int], tuple[int, int]], x: FloatArray, y: FloatArray
) -> list[FloatArray]:
    """Follow a map from corner to corner into loops, without corners on straight sides."""
    loops = []
    while following:
        corner = next(iter(following))
        loop = []
        while corner in following:
            loop.append((x[corner[0]], y[corner[1]]))
            corner = following.pop(corner)
        corners = np.array(loop)
        before = corners - np.roll(corners, 1, axis=0)
        after = np.roll(corners, -1, axis=0) - corners
        loops.append(corners[before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0] != 0.0])
    return loops


def _equal_area_circle(radius_m: float) -> FloatArray:
    """Return the regular polygon with the circle's area, whose torsion is the circle's to 1e-6."""
    step = TURN / _SEGMENTS
    angle = step * np.arange(_SEGMENTS)
    radius = radius_m * np.sqrt(step / np.sin(step))
    return np.asarray(radius * np.column_stack((np.cos(angle), np.sin(angle))))


def circle(diameter_m: float) -> Outline:
    """Build a solid circle.

    Parameters
    ----------
    diameter_m : float
        Diameter in metres.

    Returns
    -------
    Outline
        A polygon of the circle's area.

    Raises
    ------
    InputError
        If the diameter isn't positive.

    Examples
    --------
    >>> round(circle(2.0).area_m2, 12) == round(np.pi, 12)
    True
    """
    return annulus(diameter_m, 0.0)


def annulus(outer_diameter_m: float, inner_diameter_m: float) -> Outline:
    """Build a hollow circle.

    Parameters
    ----------
    outer_diameter_m, inner_diameter_m : float
        Diameters in metres, 0 ≤ inner < outer.

    Returns
    -------
    Outline
        Two polygons of the circles' areas.

    Raises
    ------
    InputError
        If the diameters aren't in this order.

    Examples
    --------
    >>> len(annulus(0.09, 0.03).loops)
    2
    """
    if not 0.0 <= inner_diameter_m < outer_diameter_m < np.inf:
        raise InputError(
            Message(
                "diameters {outer_diameter_m} m and {inner_diameter_m} m",
                outer_diameter_m,
                inner_diameter_m,
            ),
            "0 <= inner < outer",
        )
    outside = _equal_area_circle(0.5 * outer_diameter_m)
    if inner_diameter_m == 0.0:
        return Outline((outside,))
    return Outline((outside, _equal_area_circle(0.5 * inner_diameter_m)))


def spline_shaft(
    major_diameter_m: float,
    minor_diameter_m: float,
    teeth: int,
    tooth_width_m: float,
    bore_m: float = 0.0,
) -> Outline:
    """Build a straight-sided spline shaft (ISO 14 form, without fillets).

    Parameters
    ----------
    major_diameter_m, minor_diameter_m : float
        Diameters over the teeth and at their roots.
    teeth : int
        Number of teeth, at least 3.
    tooth_width_m : float
        Width of a tooth between its parallel flanks.
    bore_m : float
        Diameter of a bore, 0 for none.

    Returns
    -------
    Outline
        The section.

    Raises
    ------
    InputError
        If the teeth don't fit.

    Examples
    --------
    >>> shaft = spline_shaft(0.032, 0.026, 6, 0.006)
    >>> bool(np.pi * 0.013**2 < shaft.area_m2 < np.pi * 0.016**2)
    True
    """
    tooth = TURN / max(teeth, 1)
    fits = (
        teeth >= 3
        and 0.0 <= bore_m < minor_diameter_m < major_diameter_m < np.inf
        and 0.0 < tooth_width_m < minor_diameter_m * np.sin(0.5 * tooth)
    )
    if not fits:
        raise InputError(
            Message(
                "{teeth} teeth of {tooth_width_m} m on {minor_diameter_m} to "
                "{major_diameter_m} m, bore {bore_m} m",
                teeth,
                tooth_width_m,
                minor_diameter_m,
                major_diameter_m,
                bore_m,
            ),
            "at least 3 teeth with gaps between, bore < minor < major diameter",
        )
    root, tip = 0.5 * minor_diameter_m, 0.5 * major_diameter_m
    at_root, at_tip = (np.arcsin(0.5 * tooth_width_m / radius) for radius in (root, tip))
    over = np.linspace(-at_tip, at_tip, 5)
    between = np.linspace(at_root, tooth - at_root, 7)
    radius = np.concatenate((np.full(5, tip), np.full(7, root)))
    angle = np.concatenate((over, between)) + tooth * np.arange(teeth)[:, np.newaxis]
    outside = np.column_stack(((radius * np.cos(angle)).ravel(), (radius * np.sin(angle)).ravel()))
    if bore_m == 0.0:
        return Outline((outside,))
    return Outline((outside, _equal_area_circle(0.5 * bore_m)))


def closed_curve(points_m: ArrayLike, segments: int = _SEGMENTS) -> Outline:
    """Build a section bounded by a smooth closed curve through points (periodic cubic spline).

    Parameters
    ----------
    points_m : array_like (n, 2)
        Points in metres in order, first not repeated, at least 4.
    segments : int
        Sides of the polygon that approximates the curve.

    Returns
    -------
    Outline
        The section.

    Raises
    ------
    InputError
        If there are fewer than 4 points, or by `Outline`.

    Examples
    --------
    >>> angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    >>> curve = closed_curve(np.column_stack((np.cos(angle), np.sin(angle))))
    >>> round(curve.area_m2, 2)
    3.14
    """
    points = _checked(points_m)
    if len(points) < 4 or segments < 8:
        raise InputError(
            Message("{count} points and {segments} segments", len(points), segments),
            "at least 4 points and 8 segments",
        )
    closed = np.vstack((points, points[:1]))
    length = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))))
    spline = CubicSpline(length, closed, bc_type="periodic")
    place = np.linspace(0.0, length[-1], segments, endpoint=False)
    return Outline((np.asarray(spline(place), dtype=np.float64),))
