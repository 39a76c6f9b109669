"""Checks of calibration points before a fit: points are accepted, refused or down-weighted."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.compensation.columns import FEATURES, FloatArray
from torquebench.compensation.state import storable
from torquebench.errors import InputError
from torquebench.message import Message

WHOLE_SHARE = 0.9
"""Share of the range from which on a calibration counts as full-scale: readings of the last step
deviate a little from it, and adaptively placed points may end before it.
"""

# An outlier deviates by this many standard deviations from its neighbours; the number grows where
# few points make the standard deviation uncertain. Normal noise gives one in less than 1 of 1000
# data sets.
_OUTLIER_SCALES, _OUTLIER_SCALES_PER_POINT = 6.0, 60.0
# and by at least this share of the largest torque: spline engagement causes real bumps up to 0.05 %
# FS
_OUTLIER_SHARE_OF_LARGEST = 5e-4
_CONTRADICTION_SCALES = 10.0
_CONTRADICTION_SHARE_OF_SPAN = 1e-3
_NEIGHBOURS_PER_SIDE = 3
_FEWEST_FOR_SCATTER = 8


class OutlierWarning(UserWarning):
    """An outlier among the calibration points was found and down-weighted."""


class PointsReducedWarning(UserWarning):
    """More calibration points than a model can use in bounded time were averaged."""


@storable
@dataclass(frozen=True)
class Outlier:
    """A calibration point far from all its neighbours.

    Attributes
    ----------
    row : int
        Index of the point in the given data, from 0.
    series : int
        Series of the point; 0 without that column.
    reading_nm, standard_nm : float
        Readings and standard values, in N·m.
    residual_nm : float
        Deviation of the standard's value from that of its neighbours, in N·m.
    scatter_nm : float
        Standard deviation of the other points about their neighbours, in N·m.
    """

    row: int
    series: int
    reading_nm: float
    standard_nm: float
    residual_nm: float
    scatter_nm: float

    def __str__(self) -> str:
        return Message(
            "series {series}, row {row}: reading {reading_nm:.6g} N·m, standard "
            "{standard_nm:.6g} N·m, residual {residual_nm:+.3g} N·m from its "
            "neighbours, whose scatter is {scatter_nm:.2g} N·m",
            self.series,
            self.row,
            self.reading_nm,
            self.standard_nm,
            self.residual_nm,
            self.scatter_nm,
        )


@dataclass(frozen=True)
class CalibrationPoints:
    """Checked points with their row numbers in the given data.

    Attributes
    ----------
    X : float64 array of shape (n, k)
        Feature columns.
    y : float64 array of shape (n,)
        Torque of the standard in N·m.
    rows : int array of shape (n,)
        Index of each point in the given data.
    """

    X: FloatArray
    y: FloatArray
    rows: NDArray[np.intp]

    @property
    def reading(self) -> FloatArray:
        """Readings in N·m."""
        return self.X[:, 0]

    def sorted(self) -> CalibrationPoints:
        """Return the points in an order that is independent of the order of the rows."""
        columns = [self.y, *(self.X[:, index] for index in reversed(range(self.X.shape[1])))]
        order = np.lexsort(columns)
        return CalibrationPoints(
            np.ascontiguousarray(self.X[order]), self.y[order], self.rows[order]
        )


def check_points(
    points: CalibrationPoints, minimum: int, minimum_distinct: int, model: str
) -> None:
    """Refuse too few points, constant columns and contradictory duplicates.

    Parameters
    ----------
    points : CalibrationPoints
        Sorted points.
    minimum, minimum_distinct : int
        Number of points and of distinct readings that the model needs.
    model : str
        Name of the model for the message.

    Raises
    ------
    InputError
        With the finding.
    """
    count = points.y.size
    distinct = np.unique(points.reading).size
    if count < minimum:
        raise InputError(
            Message(
                "{count} sample{value} (calibration points) for {model}",
                count,
                "s" if count != 1 else "",
                model,
            ),
            Message("at least {limit}", minimum),
            "record more points; the default model takes five",
        )
    for name, values in (("reading", points.reading), ("standard", points.y)):
        if np.ptp(values) == 0.0:
            raise InputError(
                Message(
                    "constant {name} column: {values:.6g} N·m in all {count} points",
                    name,
                    values[0],
                    count,
                ),
                "points spread over the range",
                Message("check that the {name} column is the right one", name),
            )
    if distinct < minimum_distinct:
        raise InputError(
            Message(
                "{count} points at only {distinct} distinct readings for {model}",
                count,
                distinct,
                model,
            ),
            Message("at least {minimum_distinct} distinct readings", minimum_distinct),
            "record points at more torques; the default model takes three",
        )
    _refuse_contradictions(points)


def point_weights(points: CalibrationPoints, outliers: str) -> tuple[FloatArray, list[Outlier]]:
    """Return the weight of every point, and the outliers, treated as requested.

    Parameters
    ----------
    points : CalibrationPoints
        Sorted points.
    outliers : {"downweight", "refuse", "keep"}
        "downweight" warns and raises an outlier's standard deviation to its deviation.

    Returns
    -------
    weights : float64 array of shape (n,)
        1 for good points; noise variance of a point is noise² / weight.
    outlying : list of Outlier

    Raises
    ------
    InputError
        With ``outliers="refuse"``, naming every outlier.
    """
    weights = np.ones(points.y.size)
    if outliers == "keep":
        return weights, []
    positions, outlying = find_outliers(points)
    if not outlying:
        return weights, []
    names = "; ".join(str(point) for point in outlying[:5])
    if len(outlying) > 5:
        names += f"; and {len(outlying) - 5} more"
    if outliers == "refuse":
        raise InputError(
            Message("outlier among the calibration points: {names}", names),
            Message(
                "points within {size:.2g} times the scatter of their neighbours",
                _scales(weights.size),
            ),
            'record the point again, leave it out, or choose outliers="downweight"',
        )
    warnings.warn(
        f"outlier among the calibration points, down-weighted: {names}",
        OutlierWarning,
        stacklevel=3,
    )
    for position, point in zip(positions, outlying, strict=True):
        weights[position] = min(1.0, (point.scatter_nm / point.residual_nm) ** 2)
    # Weights are divisors and can't be 0; a point 10,000 standard deviations away has no influence.
    return np.maximum(weights, 1e-8), outlying


def find_outliers(points: CalibrationPoints) -> tuple[list[int], list[Outlier]]:
    """Find points far outside the values of all their neighbours.

    A robust quadratic per direction with branch terms removes the trend. A point's residual is
    compared with its three neighbours in reading on either side, over all series and branches. An
    outlier is beyond every neighbour by six times the local scatter (more with few points) and by
    0.05 % of the largest torque. A step at torque reversal or an engagement bump isn't an outlier,
    as neighbours have it, too.

    Parameters
    ----------
    points : CalibrationPoints
        Sorted points.

    Returns
    -------
    positions : list of int
        Positions in `points`.
    outlying : list of Outlier
        The outlying points with their rows and deviations.
    """
    outliers: dict[int, Outlier] = {}
    least = _OUTLIER_SHARE_OF_LARGEST * float(np.max(np.abs(points.y)))
    remaining = np.arange(points.y.size)
    for _ in range(5):
        if remaining.size < _FEWEST_FOR_SCATTER:
            break
        residual = trend_free(points.X[remaining], points.y[remaining])
        centre, excess = _against_neighbours(residual)
        scatter = _scatter(residual, centre)
        limit = max(_scales(remaining.size) * scatter, least)
        outlying = np.flatnonzero(excess > limit)
        if outlying.size == 0:
            break
        # A good point next to an outlier can look bad: remove the worst of each neighbourhood
        # first.
        outlying = np.array(
            [i for i in outlying if excess[i] >= np.max(excess[_around(int(i), remaining.size)])]
        )
        for i in outlying:
            outliers[int(remaining[i])] = _name(
                points, int(remaining[i]), residual[i] - centre[i], scatter
            )
        remaining = np.delete(remaining, outlying)
    positions = sorted(outliers)
    return positions, [outliers[position] for position in positions]


def reduce_points(
    points: CalibrationPoints,
    weights: FloatArray,
    maximum: int | None,
    used_features: tuple[str, ...],
) -> tuple[CalibrationPoints, FloatArray]:
    """Average neighbouring readings when there are more points than a model can use.

    Groups have equal numbers of points, so that close steps, where a chain changes fast, stay
    separate. No group is wide, so that single points in sparse regions stay separate, too. Points
    of different branch or series, or at different speed or temperature (eighths of their span), are
    never averaged with each other if the model uses that column.

    Parameters
    ----------
    points : CalibrationPoints
        Sorted points.
    weights : float64 array of shape (n,)
        Their weights.
    maximum : int or None
        Largest number of points that the model takes; None for any number.
    used_features : tuple of str
        Columns that the model uses.

    Returns
    -------
    points : CalibrationPoints
    weights : float64 array of shape (m,)
        Sum of the weights of each bin.

    Warns
    -----
    PointsReducedWarning
        When points were averaged.
    """
    count = points.y.size
    if maximum is None or count <= maximum:
        return points, weights
    group = _neighbours(points.reading, _strata(points.X, used_features), maximum)
    total = np.bincount(group, weights)
    X = np.column_stack([np.bincount(group, weights * column) / total for column in points.X.T])
    y = np.bincount(group, weights * points.y) / total
    rows = np.zeros(total.size, dtype=np.intp)
    rows[group[::-1]] = points.rows[::-1]
    warnings.warn(
        f"{count} calibration points averaged to {total.size} (the model takes {maximum})",
        PointsReducedWarning,
        stacklevel=3,
    )
    order = CalibrationPoints(X, y, np.arange(total.size)).sorted().rows
    return CalibrationPoints(X[order], y[order], rows[order]), np.asarray(total[order], np.float64)


def _neighbours(reading: FloatArray, stratum: NDArray[np.intp], maximum: int) -> NDArray[np.intp]:
    """Return the group number of sorted points: groups of equal size, wide ones divided."""
    width = max(float(reading[-1] - reading[0]), 1e-300)
    group = np.empty(stratum.size, dtype=np.intp)
    first = 0
    for name in np.unique(stratum):
        here = np.flatnonzero(stratum == name)
        half = max(4, maximum * here.size // (2 * stratum.size))
        many = np.arange(here.size) * half // here.size
        position = half * (reading[here] - reading[0]) / width
        starts = np.flatnonzero(np.diff(many, prepend=-1) > 0)
        ends = np.append(starts[1:], here.size) - 1
        wide = np.repeat(position[ends] - position[starts] > 2.0, ends - starts + 1)
        separate = (np.diff(many) > 0) | (wide[1:] & (np.diff(np.floor(position)) > 0))
        group[here] = first + np.concatenate([[0], np.cumsum(separate)])
        first = int(group[here[-1]]) + 1
    return group


def _strata(X: FloatArray, used_features: tuple[str, ...]) -> NDArray[np.intp]:
    """Return the number of each point's set: only points of one set may be averaged."""
    stratum = np.zeros(X.shape[0], dtype=np.intp)
    for index, name in enumerate(FEATURES[: X.shape[1]]):
        if index == 0 or name not in used_features:
            continue
        column = X[:, index]
        if name in ("branch", "series"):
            values = np.sign(column) if name == "branch" else column
            _, level = np.unique(values, return_inverse=True)
        else:  # eight equal parts of the span
            span = float(np.ptp(column)) or 1.0
            level = np.minimum(8 * (column - column.min()) / span, 7).astype(np.intp)
        _, stratum = np.unique(stratum * (int(level.max()) + 1) + level, return_inverse=True)
    return stratum


def _refuse_contradictions(points: CalibrationPoints) -> None:
    """Refuse equal readings whose standard values differ by far more than the scatter."""
    keys = np.delete(points.X, 2, axis=1) if points.X.shape[1] > 2 else points.X
    if np.all(np.diff(points.reading) > 0):
        return
    group = np.unique(keys, axis=0, return_inverse=True)[1]
    span = float(np.ptp(points.y))
    limit = 1e-2 * span
    if points.y.size >= _FEWEST_FOR_SCATTER:
        residual = trend_free(points.X, points.y)
        scatter = _scatter(residual, _against_neighbours(residual)[0])
        limit = max(_CONTRADICTION_SCALES * scatter, _CONTRADICTION_SHARE_OF_SPAN * span)
    order = np.lexsort([points.y, group])
    starts = np.flatnonzero(np.r_[True, np.diff(group[order]) > 0])
    for start, stop in zip(starts, np.r_[starts[1:], group.size], strict=True):
        values = points.y[order[start:stop]]
        near_median = np.abs(values - np.median(values)) <= limit
        # With three or more values, a majority identifies the outlier; with two it can't be
        # identified.
        if values[-1] - values[0] > limit and 2 * np.count_nonzero(near_median) <= values.size + (
            values.size == 2
        ):
            reading = points.reading[order[start]]
            raise InputError(
                Message(
                    "contradictory points: reading {reading:.6g} N·m has standard values "
                    "{values} N·m",
                    reading,
                    ", ".join(f"{value:.6g}" for value in values[:6]),
                ),
                Message(
                    "a spread of at most {limit:.2g} N·m, {contradiction_scales:g} times the "
                    "scatter of the other points",
                    limit,
                    _CONTRADICTION_SCALES,
                ),
                "find out which of them is right and leave the others out",
            )


def trend_free(X: FloatArray, y: FloatArray) -> FloatArray:
    """Subtract a robust quadratic per direction, with branch terms, from the standard's values.

    Parameters
    ----------
    X : float64 array of shape (n, k)
        Feature columns.
    y : float64 array of shape (n,)
        Torque of the standard in N·m.

    Returns
    -------
    residual : float64 array of shape (n,)
        Residuals in N·m.
    """
    reading = X[:, 0]
    u = reading / np.max(np.abs(reading))
    columns = [np.ones_like(u), u]
    if u.size >= 16:
        columns += [u * u, u * np.abs(u)]
    if X.shape[1] > 1 and u.size >= 24:
        branch = np.sign(X[:, 1])
        columns += [branch * u, branch * u * np.abs(u)]
    basis = np.column_stack(columns)
    weights, before = np.ones_like(u), np.inf
    for _ in range(12):  # re-weighted iteratively towards least absolute deviations
        solution = np.linalg.lstsq(basis * weights[:, None], y * weights, rcond=None)[0]
        residual = y - basis @ solution
        scale = float(np.median(np.abs(residual)))
        if scale == 0.0 or abs(scale - before) < 1e-3 * scale:
            break
        before = scale
        weights = 1.0 / np.sqrt(1.0 + np.abs(residual) / scale)
    return np.asarray(residual, dtype=np.float64)


def _scales(count: int) -> float:
    """Return the number of scatters from which on one of `count` points is an outlier."""
    return _OUTLIER_SCALES + _OUTLIER_SCALES_PER_POINT / count


def _around(index: int, count: int) -> slice:
    """Return the rows of a point and its neighbours."""
    return slice(max(0, index - _NEIGHBOURS_PER_SIDE), min(count, index + _NEIGHBOURS_PER_SIDE + 1))


def _against_neighbours(residual: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the median of each point's neighbours, and the point's distance beyond their range."""
    reach = _NEIGHBOURS_PER_SIDE
    padded = np.pad(residual, reach, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1)
    neighbours = np.delete(windows, reach, axis=1)
    centre = np.nanmedian(neighbours, axis=1)
    excess = np.maximum(
        residual - np.nanmax(neighbours, axis=1), np.nanmin(neighbours, axis=1) - residual
    )
    return centre, np.maximum(excess, 0.0)


def _scatter(residual: FloatArray, centre: FloatArray) -> float:
    """Robust standard deviation of the points about their neighbours."""
    return float(1.4826 * np.median(np.abs(residual - centre)))


def _name(
    points: CalibrationPoints, position: int, residual_nm: float, scatter_nm: float
) -> Outlier:
    """Return an outlier with its row, series, values and deviation."""
    series = int(points.X[position, 2]) if points.X.shape[1] > 2 else 0
    return Outlier(
        row=int(points.rows[position]),
        series=series,
        reading_nm=float(points.reading[position]),
        standard_nm=float(points.y[position]),
        residual_nm=float(residual_nm),
        scatter_nm=float(scatter_nm),
    )
