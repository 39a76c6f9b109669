"""Angular acceleration of a shaft from the samples of its encoder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["UNKNOWN", "Acceleration", "BlockSamples", "EncoderAcceleration"]

LEAST_SPAN_S = 0.03
"""Shortest time over which acceleration is evaluated, s: over less, encoder counts would show."""
FEWEST_SAMPLES = 5


BlockSamples = tuple[NDArray[np.float64], NDArray[np.number]]
"""Times and counts of one block's samples."""


class Acceleration(NamedTuple):
    """Mean angular acceleration and its standard uncertainty, rad/s²."""

    rad_s2: float
    uncertainty_rad_s2: float


UNKNOWN = Acceleration(float("nan"), float("nan"))


class EncoderAcceleration:
    """Acceleration block by block: the bend of a parabola through the angle's samples.

    The uncertainty consists of the parabola's and of a ramp that may begin or end within the block:
    any acceleration between the previous and the present one (rectangular).

    Examples
    --------
    >>> time_s = 0.001 * np.arange(50)
    >>> counts = np.round(360_000 / (2.0 * np.pi) * 15.0 * time_s**2).astype(np.int64)
    >>> shaft = EncoderAcceleration()
    >>> first, second = shaft(time_s, counts, 360_000), shaft(time_s, counts, 360_000)
    >>> round(first.rad_s2, 1), second.uncertainty_rad_s2 < 0.02
    (30.0, True)
    """

    def __init__(self) -> None:
        self._before = float("nan")

    def __call__(
        self, time_s: NDArray[np.float64], counts: NDArray[np.number], per_revolution: int
    ) -> Acceleration:
        """Return the acceleration over a block's samples; a short block uses earlier samples too.

        Parameters
        ----------
        time_s : float64 array of shape (n,)
        counts : array of shape (n,)
        per_revolution : int
        """
        return self.of_blocks([(time_s, counts)], per_revolution)[0]

    def of_blocks(self, blocks: Sequence[BlockSamples], per_revolution: int) -> list[Acceleration]:
        """Return the accelerations over blocks that follow each other, as one call a block does."""
        found = []
        for size, group in groupby(blocks, key=lambda block: block[0].size):
            parts = list(group)
            if size < FEWEST_SAMPLES:
                self._before = float("nan")
                found += [UNKNOWN] * len(parts)
                continue
            curves, noises = _parabolas(
                np.array([time_s for time_s, _ in parts]),
                np.array([counts for _, counts in parts], dtype=np.float64),
                2.0 * np.pi / per_revolution,
            )
            for curve, noise in zip(curves.tolist(), noises.tolist(), strict=True):
                now, before = 2.0 * curve, self._before
                self._before = now
                change = 0.0 if math.isnan(before) else now - before
                around = float(np.hypot(2.0 * noise, 0.5 * change / np.sqrt(3.0)))
                found.append(Acceleration(now, around))
        return found


def _parabolas(
    time_s: NDArray[np.float64], counts: NDArray[np.float64], count_rad: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit a parabola to each row's angles; return its square term and the term's uncertainty."""
    count = time_s.shape[1]
    at = time_s - _mean(time_s)
    angle = count_rad * (counts - counts[:, :1])
    square = _dot(at, at)
    bend = at * at
    bend -= _mean(bend) + _dot(at, bend) / square * at
    weight = _dot(bend, bend)
    curve = _dot(bend, angle) / weight
    rest = angle - _mean(angle) - _dot(at, angle) / square * at - curve * bend
    noise = np.hypot(np.sqrt(_dot(rest, rest) / (count - 3)), count_rad / np.sqrt(12.0))
    return curve[:, 0], (noise / np.sqrt(weight))[:, 0]


def _mean(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.add.reduce(rows, axis=1, keepdims=True) / rows.shape[1])


def _dot(first: NDArray[np.float64], second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the products of two tables' rows as a column, the same as for each row alone."""
    return np.asarray(np.vecdot(first, second)[:, None])
