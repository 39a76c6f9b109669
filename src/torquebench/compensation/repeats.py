"""Repeated points of a calibration: steps, their scatter, and folds that hold out whole steps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.compensation.checks import trend_free
from torquebench.compensation.columns import FloatArray
from torquebench.errors import InputError
from torquebench.message import Message

IntArray = NDArray[np.intp]

_SAME_STEP_SHARE_OF_SPAN = 0.003
_FEWEST_GROUPS = 5


@dataclass(frozen=True)
class NoiseFloor:
    """Scatter of repeated points, which limits the accuracy of every model.

    Attributes
    ----------
    standard_deviation_nm : float
        Pooled standard deviation of points of the same step and branch, in N·m.
    """

    standard_deviation_nm: float
    degrees_of_freedom: int


def repeat_groups(reading_nm: ArrayLike) -> IntArray:
    """Return the step of every point: points within 0.3 % of the span belong to one step.

    Parameters
    ----------
    reading_nm : array of shape (n,)
        Readings in N·m, in any order.

    Returns
    -------
    group : int array of shape (n,)
        Number of the step of each point, from the lowest reading to the highest. Readings without
        gaps, as of a slow ramp, are cut into fifty steps of equal width.

    Examples
    --------
    >>> repeat_groups([0.0, 100.0, 200.0, 100.1, 0.05]).tolist()
    [0, 1, 2, 1, 0]
    """
    reading = np.asarray(reading_nm, dtype=np.float64)
    order = np.argsort(reading, kind="stable")
    span = float(np.ptp(reading)) or 1.0
    step = np.diff(reading[order]) > _SAME_STEP_SHARE_OF_SPAN * span
    group = np.empty(reading.size, dtype=np.intp)
    group[order] = np.concatenate([[0], np.cumsum(step)])
    starts = np.flatnonzero(np.r_[True, step])
    ends = np.r_[starts[1:] - 1, reading.size - 1]
    widest = float(np.max(reading[order[ends]] - reading[order[starts]]))
    if widest > 3 * _SAME_STEP_SHARE_OF_SPAN * span:
        bins = np.minimum((50 * (reading - reading.min()) / span).astype(np.intp), 49)
        group = np.unique(bins, return_inverse=True)[1].astype(np.intp)
    return group


def noise_floor(X: FloatArray, y: FloatArray, groups: IntArray | None = None) -> NoiseFloor | None:
    """Estimate the noise from repeats: points of the same step and branch.

    Parameters
    ----------
    X : float64 array of shape (n, k)
        Feature columns; without a branch column hysteresis counts as noise.
    y : float64 array of shape (n,)
        Torque of the standard in N·m.
    groups : int array of shape (n,), optional
        Step of each point; from `repeat_groups` when None.

    Returns
    -------
    noise : NoiseFloor or None
        None without repeats.

    Examples
    --------
    >>> x = np.repeat(np.linspace(0.0, 100.0, 12), 2)
    >>> y = x + np.tile([-0.1, 0.1], 12)
    >>> noise_floor(x[:, None], y).degrees_of_freedom
    12
    """
    groups = repeat_groups(X[:, 0]) if groups is None else groups
    residual = trend_free(X, y)
    branch = np.sign(X[:, 1]).astype(np.intp) if X.shape[1] > 1 else np.zeros(y.size, np.intp)
    cell = np.unique(3 * groups + branch + 1, return_inverse=True)[1]
    counts = np.bincount(cell)
    freedom = int(np.sum(counts - 1))
    if freedom == 0:
        return None
    means = np.bincount(cell, residual) / counts
    squares = float(np.sum((residual - means[cell]) ** 2))
    return NoiseFloor(float(np.sqrt(squares / freedom)), freedom)


def spread_folds(step: IntArray, folds: int) -> tuple[IntArray, int]:
    """Assign the steps to folds so that a step and its neighbours are in different folds.

    Parameters
    ----------
    step : int array of shape (n,)
        Step of each point, numbered in the order of the readings.
    folds : int
        Wanted number of folds; one for every step where there are fewer than twice as many.

    Returns
    -------
    fold : int array of shape (n,)
        Fold of each point, -1 in the outermost steps, which are never held out.
    count : int
        Number of folds.

    Raises
    ------
    InputError
        When there are too few steps.

    Examples
    --------
    >>> fold, count = spread_folds(np.arange(6), 2)
    >>> fold.tolist(), count
    ([-1, 0, 1, 0, 1, -1], 2)
    """
    steps = int(step.max()) + 1
    if steps < _FEWEST_GROUPS:
        raise InputError(
            Message("{steps} different steps", steps),
            Message("at least {limit}", _FEWEST_GROUPS),
            "record more torques",
        )
    inner = steps - 2
    count = inner if inner < 2 * folds else folds
    fold_of_step = np.full(steps, -1, dtype=np.intp)
    fold_of_step[1:-1] = np.arange(inner) % count
    return fold_of_step[step], count
