"""Ring buffers for live signals at several levels, from fine and short to coarse and long."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, nan

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Rows:
    """Rows of one level: time and, for every signal, lowest, highest and mean value.

    Parameters
    ----------
    time_s : float64[n]
        End of each row in bench time, s.
    low, high, mean : float64[signals, n]
        Values; NaN marks a missing value in a row.
    """

    time_s: Array
    low: Array
    high: Array
    mean: Array


class LevelRing:
    """The newest rows of one level; the owner's lock protects writing and copying.

    Parameters
    ----------
    signals : int
    capacity : int
        Largest number of rows.

    Examples
    --------
    >>> ring = LevelRing(signals=1, capacity=3)
    >>> for second in range(5):
    ...     value = np.array([10.0 * second])
    ...     ring.append(float(second), value, value, value)
    >>> ring.count, ring.newest(2).time_s, ring.newest(9).time_s
    (5, array([3., 4.]), array([2., 3., 4.]))
    """

    def __init__(self, signals: int, capacity: int) -> None:
        self.capacity = capacity
        self.count = 0
        self._time = np.full(capacity, np.nan)
        self._values = np.full((3, signals, capacity), np.nan)

    def append(self, time_s: float, low: Array, high: Array, mean: Array) -> None:
        """Add a row, which replaces the oldest one if the ring is full."""
        place = self.count % self.capacity
        self._time[place] = time_s
        self._values[0, :, place] = low
        self._values[1, :, place] = high
        self._values[2, :, place] = mean
        self.count += 1

    def newest(self, rows: int) -> Rows:
        """Return a copy of the newest rows, up to a number, oldest first."""
        rows = max(0, min(rows, self.count, self.capacity))
        places = np.arange(self.count - rows, self.count) % self.capacity
        values = self._values[:, :, places]
        return Rows(self._time[places], values[0], values[1], values[2])

    def last_s(self, seconds: float) -> Rows:
        """Return a copy of the rows of the last seconds before the newest one."""
        return self.between(self.newest_s - seconds, np.inf)

    def between(self, start_s: float, stop_s: float) -> Rows:
        """Return a copy of the rows that end within a span of bench time."""
        kept = self.newest(self.capacity)
        part = slice(
            int(np.searchsorted(kept.time_s, start_s)),
            int(np.searchsorted(kept.time_s, stop_s, side="right")),
        )
        return Rows(kept.time_s[part], kept.low[:, part], kept.high[:, part], kept.mean[:, part])

    @property
    def newest_s(self) -> float:
        """End of the newest row, s; 0 before the first."""
        return float(self._time[(self.count - 1) % self.capacity]) if self.count else 0.0

    @property
    def oldest_s(self) -> float:
        """End of the oldest stored row, s; 0 before the first."""
        place = max(0, self.count - self.capacity)
        return float(self._time[place % self.capacity]) if self.count else 0.0

    @property
    def covered_s(self) -> float:
        """Bench time between the oldest and the newest row, s."""
        return self.newest_s - self.oldest_s

    @property
    def full(self) -> bool:
        """Whether another row would replace the oldest one."""
        return self.count >= self.capacity


class TrendMemory:
    """Rows at several levels; a coarser level keeps lowest and highest values of the finer one.

    A spike of a single window is therefore visible in a trend of an hour.

    Parameters
    ----------
    signals : int
    capacity : int
        Rows kept at each level.
    factors : sequence of int
        Number of rows of a level in one row of the next.
    """

    def __init__(self, signals: int, capacity: int, factors: tuple[int, ...]) -> None:
        self.levels = [LevelRing(signals, capacity) for _ in range(len(factors) + 1)]
        self._factors = factors

    def append(self, time_s: float, low: Array, high: Array, mean: Array) -> None:
        """Add a row to the finest level, and to coarser levels when enough rows are complete."""
        self.levels[0].append(time_s, low, high, mean)
        for level, factor in enumerate(self._factors):
            finer = self.levels[level]
            if finer.count % factor:
                return
            part = finer.newest(factor)
            self.levels[level + 1].append(
                float(part.time_s[-1]),
                np.fmin.reduce(part.low, axis=1),
                np.fmax.reduce(part.high, axis=1),
                nan_mean(part.mean),
            )

    def last_s(self, seconds: float) -> Rows:
        """Return the last seconds from the finest level that covers them, or from the coarsest."""
        for level in self.levels:
            if level.covered_s >= seconds or not level.full:
                return level.last_s(seconds)
        return self.levels[-1].last_s(seconds)

    def between(self, start_s: float, stop_s: float) -> Rows:
        """Return rows of a span from the finest level with its beginning, or the coarsest."""
        for level in self.levels:
            if not level.full or level.oldest_s <= start_s:
                return level.between(start_s, stop_s)
        return self.levels[-1].between(start_s, stop_s)


def extremes_and_mean(values: Array) -> tuple[float, float, float]:
    """Return lowest, highest and mean value without NaN; NaN if there are only NaN.

    Examples
    --------
    >>> extremes_and_mean(np.array([1.0, np.nan, 3.0]))
    (1.0, 3.0, 2.0)
    """
    kept = [value for value in values.tolist() if isfinite(value)]
    # for a block's few values faster than NumPy
    return (min(kept), max(kept), sum(kept) / len(kept)) if kept else (nan, nan, nan)


def nan_mean(values: Array) -> Array:
    """Return the mean over the last axis without NaN; NaN if there are only NaN.

    Examples
    --------
    >>> nan_mean(np.array([[1.0, np.nan, 3.0], [np.nan, np.nan, np.nan]]))
    array([ 2., nan])
    """
    there = np.isfinite(values)
    number = there.sum(axis=-1)
    total = np.where(there, values, 0.0).sum(axis=-1)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def envelope(rows: Rows, points: int) -> Rows:
    """Merge neighbouring rows into at most `points` rows, keeping every extreme.

    Parameters
    ----------
    rows : Rows
    points : int
        At least 1.

    Examples
    --------
    >>> time = np.arange(6.0)
    >>> spike = np.array([[0.0, 0.0, 9.0, 0.0, 0.0, 0.0]])
    >>> joined = envelope(Rows(time, spike, spike, spike), 2)
    >>> joined.time_s, joined.high, joined.low
    (array([2., 5.]), array([[9., 0.]]), array([[0., 0.]]))
    """
    count = rows.time_s.size
    if count <= points:
        return rows
    starts = (np.arange(points) * count) // points
    ends = np.append(starts[1:], count) - 1
    there = np.isfinite(rows.mean)
    number = np.add.reduceat(there, starts, axis=1)
    total = np.add.reduceat(np.where(there, rows.mean, 0.0), starts, axis=1)
    return Rows(
        rows.time_s[ends],
        np.fmin.reduceat(rows.low, starts, axis=1),
        np.fmax.reduceat(rows.high, starts, axis=1),
        np.where(number > 0, total / np.maximum(number, 1), np.nan),
    )
