"""The path of a calibration: times and torques of its points, and scatter that a series shares."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.hybrid.parts import SIDELESS

_SAME_LEVEL = 0.003  # of full scale: torques closer than this are repeats
_SIDED = 0.02  # readings closer to zero scatter to both sides and have no direction of their own
_FEWEST_SERIES = 3  # fewer series can't separate correlated scatter from the curve
_LENGTHS = np.geomspace(0.003, 1.0, 8)
"""Candidate correlation lengths along the path, as shares of full scale."""
_CHANCE = 2.5  # standard errors up to which chance explains the correlation
_LARGEST_SHARE = 0.9
_FEWEST_PAIRS = 1e-9  # largest correlation; a length below all distances is ignored


def count_levels(u: FloatArray) -> int:
    """Return the number of distinct torques, in the direction that has more of them.

    Examples
    --------
    >>> count_levels(np.array([0.5, 1.0, 0.501, -0.2, -0.4, -0.6]))
    3
    """
    sides = (np.sort(u[u > 0]), np.sort(-u[u < 0]))
    steps = [int(np.count_nonzero(np.diff(side) > _SAME_LEVEL)) for side in sides]
    return max(step + min(side.size, 1) for step, side in zip(steps, sides, strict=True))


def path_clock(u: FloatArray, branch: FloatArray, series: FloatArray) -> FloatArray:
    """Return the time of calibration points, derived from their positions on the path.

    A series runs from zero to full scale and back, or through both directions, clockwise first. A
    zero on the falling branch is the last point of its direction.

    Parameters
    ----------
    u, branch, series : float64 array of shape (n,)
        Reading / full scale, branch, number of the series.

    Returns
    -------
    elapsed : float64 array of shape (n,) or (0,)
        Position of each point in the calibration, from 0 to 1 through all series; empty when a
        branch is unknown.

    Examples
    --------
    >>> path_clock(np.array([0.5, 1.0, 0.5]), np.array([1.0, 1.0, -1.0]), np.zeros(3))
    array([0.25, 0.5 , 0.75])
    """
    if np.any(branch == 0.0):
        return np.zeros(0)
    x = np.minimum(np.abs(u), 1.0)
    leg = np.where(branch > 0, 0.5 * x, 1.0 - 0.5 * x)
    keys, sections = _loadings(u, series)
    rank = np.searchsorted(sections, keys).astype(np.float64)
    return np.asarray((rank + leg) / sections.size if sections.size > 1 else leg)


def path_side(u: FloatArray, series: FloatArray) -> FloatArray:
    """Return the direction of the loading that each point belongs to, −1 to 1.

    A point at zero has the direction of its series, and none (0) in a series of both directions.

    Parameters
    ----------
    u, series : float64 array of shape (n,)
        Reading / full scale, number of the series.

    Examples
    --------
    >>> path_side(np.array([0.5, 0.0, -0.5, 1e-9]), np.array([1.0, 1.0, 2.0, 2.0])).tolist()
    [1.0, 1.0, -1.0, -1.0]
    """
    keys, sections = _loadings(u, series)
    both = np.isin(keys, sections) & np.isin(keys ^ 1, sections)
    side = np.where(keys % 2 == 1, -1.0, 1.0)
    return np.where(both, np.tanh(u / SIDELESS), side)


def _loadings(u: FloatArray, series: FloatArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return each point's loading, 2 · series (+ 1 if counter-clockwise), and all loadings."""
    keys = 2 * np.unique(series, return_inverse=True)[1] + (u < 0)
    sections = np.unique(keys[np.abs(u) > _SIDED])
    lone = ~np.isin(keys, sections)  # points near zero on the other side of a one-sided series
    keys[lone] = keys[lone] ^ 1
    return keys, sections


def correlated_covariance(
    u: FloatArray, branch: FloatArray, series: FloatArray, target: FloatArray
) -> FloatArray | None:
    """Return the covariance of correlated scatter, relative to an independent scatter of 1.

    Parts that re-seat with every loading shift the points of one series to the same side. More
    series average this shift, more points of one series don't (GUM 4.2.7). If such points were
    treated as independent, the curve's uncertainty would be too small, and scatter of one loading
    would be identified as effects of the chain.

    Points of different series at the same torque and branch differ by scatter alone. Its
    correlation within a series is modelled as m·exp(−d/ℓ) over the distance d between two points
    along the path; m and ℓ are fitted by least squares over all pairs.

    Parameters
    ----------
    u, branch, series, target : float64 array of shape (n,)
        Reading / full scale, branch, number of the series, additional torque.

    Returns
    -------
    covariance : float64 array of shape (n, n) or None
        m/(1 − m)·exp(−d/ℓ) within a series and direction, 0 elsewhere; None for fewer than three
        series, or where chance explains the correlation.

    Examples
    --------
    >>> u, series = np.tile(np.linspace(0.1, 0.4, 30), 6), np.repeat(np.arange(6.0), 30)
    >>> common = np.repeat([1.0, -1.0, 0.5, -0.5, 2.0, -2.0], 30)
    >>> scatter = np.random.default_rng(1).normal(size=180)
    >>> correlated_covariance(u, np.ones(180), series, scatter) is None
    True
    >>> float(correlated_covariance(u, np.ones(180), series, scatter + common).max().round(1))
    4.4
    """
    if np.unique(series).size < _FEWEST_SERIES:
        return None
    scatter = _scatter(u, branch, series, target)
    courses = list(_courses(u, branch, series))
    pairs = [_pairs(scatter, *course) for course in courses]
    distance, product = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    share, length = _fitted(distance, product)
    if share == 0.0:
        return None
    covariance = np.zeros((u.size, u.size))
    for rows, position in courses:
        distance = np.abs(position[:, None] - position[None, :])
        covariance[np.ix_(rows, rows)] = share / (1.0 - share) * np.exp(-distance / length)
    return covariance


def _side(u: FloatArray) -> FloatArray:
    """Return the direction of torques; 0 near zero."""
    return np.where(np.abs(u) < SIDELESS, 0.0, np.sign(u))


def _scatter(
    u: FloatArray, branch: FloatArray, series: FloatArray, target: FloatArray
) -> FloatArray:
    """Return the deviation of each point from the others at its level; NaN without others."""
    scatter = np.full(u.size, np.nan)
    for side, leg in np.unique(np.column_stack([_side(u), branch]), axis=0):
        rows = np.flatnonzero((_side(u) == side) & (branch == leg))
        rows = rows[np.argsort(u[rows])]
        levels = round(rows.size / np.unique(series[rows]).size)
        gaps = np.argsort(np.diff(u[rows]))[::-1][: levels - 1]
        for level in np.split(rows, np.sort(gaps) + 1):
            spread = np.std(target[level])
            if np.unique(series[level]).size >= _FEWEST_SERIES and spread > 0.0:
                scatter[level] = (target[level] - np.mean(target[level])) / spread
    return scatter


def _courses(
    u: FloatArray, branch: FloatArray, series: FloatArray
) -> Iterator[tuple[NDArray[np.intp], FloatArray]]:
    """Yield the points of each series and direction, and their positions along its path."""
    for number, side in np.unique(np.column_stack([series, np.sign(u)]), axis=0):
        rows = np.flatnonzero((series == number) & (np.sign(u) == side))
        x = np.abs(u[rows])
        yield rows, np.where(branch[rows] < 0, 2.0 * np.max(x) - x, x)


def _pairs(
    scatter: FloatArray, rows: NDArray[np.intp], position: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return distances and products of scatter for all pairs of points with known scatter."""
    finite = np.isfinite(scatter[rows])
    first, second = np.triu_indices(int(np.count_nonzero(finite)), k=1)
    values, places = scatter[rows][finite], position[finite]
    return np.abs(places[first] - places[second]), values[first] * values[second]


def _fitted(distance: FloatArray, product: FloatArray) -> tuple[float, float]:
    """Fit share · exp(-distance / length) to products of scatter; share 0 if not significant."""
    if distance.size == 0:
        return 0.0, 1.0
    shapes = np.exp(-distance / _LENGTHS[:, None])
    power = np.sum(shapes**2, axis=1)
    reaching = power > _FEWEST_PAIRS
    if not np.any(reaching):
        return 0.0, 1.0
    lengths, shapes, power = _LENGTHS[reaching], shapes[reaching], power[reaching]
    shares = shapes @ product / power
    gains = shares**2 * power * np.sign(shares)
    best = int(np.argmax(gains))
    error = 1.0 / np.sqrt(power[best])
    if not shares[best] > _CHANCE * error:
        return 0.0, 1.0
    return float(min(shares[best], _LARGEST_SHARE)), float(lengths[best])
