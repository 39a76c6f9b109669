"""Columns of a feature matrix: what is known about a reading beside its value."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError

__all__ = ["FEATURES", "FloatArray", "explain_rejection", "feature_column", "features"]

FloatArray = NDArray[np.float64]

FEATURES = ("reading_nm", "branch", "series", "speed_rpm", "temperature_c")
"""Columns of a feature matrix X, in this order; trailing columns may be missing."""


def features(
    reading_nm: ArrayLike,
    branch: ArrayLike | None = None,
    series: ArrayLike | None = None,
    speed_rpm: ArrayLike | None = None,
    temperature_c: ArrayLike | None = None,
) -> FloatArray:
    """Put known columns together to a feature matrix X.

    Parameters
    ----------
    reading_nm : array of shape (n,)
        Torque reading in N·m, clockwise positive; its sign is the direction.
    branch : array of shape (n,) or scalar, optional
        +1 where the size of the torque grew, -1 where it fell, 0 where that isn't known.
    series : array of shape (n,) or scalar, optional
        Number of the series (0, 1, ...).
    speed_rpm, temperature_c : array of shape (n,) or scalar, optional
        Shaft speed in r/min and transducer temperature in °C.

    Returns
    -------
    X : float64 array of shape (n, k)
        The columns of `FEATURES` up to the last one that is given; a column that isn't given
        but stands before one that is holds 0.

    Raises
    ------
    InputError
        When lengths differ.

    Examples
    --------
    >>> features([10.0, -20.0], branch=[1, -1]).tolist()
    [[10.0, 1.0], [-20.0, -1.0]]
    >>> features([10.0], temperature_c=23.5).tolist()
    [[10.0, 0.0, 0.0, 0.0, 23.5]]
    """
    given = (reading_nm, branch, series, speed_rpm, temperature_c)
    width = max(index for index, column in enumerate(given) if column is not None) + 1
    reading = np.atleast_1d(np.asarray(reading_nm, dtype=np.float64))
    X = np.zeros((reading.size, width))
    for index, column in enumerate(given):
        if column is None:
            continue
        values = np.asarray(column, dtype=np.float64)
        if values.ndim > 1 or (values.ndim == 1 and values.size != reading.size):
            raise InputError(
                f"column {FEATURES[index]} has shape {values.shape}",
                f"one value for each of the {reading.size} readings",
                "give columns of equal length",
            )
        X[:, index] = values
    return X


def feature_column(X: FloatArray, name: str) -> FloatArray:
    """Return one named column of X; zeros where X doesn't have it.

    The column `branch` comes back as its sign, so that it holds -1, 0 and +1 only.

    Parameters
    ----------
    X : float64 array of shape (n, k)
        As from `features`.
    name : str
        One of `FEATURES`.

    Returns
    -------
    column : float64 array of shape (n,)

    Examples
    --------
    >>> feature_column(features([10.0, -20.0], branch=[1, -1]), "branch").tolist()
    [1.0, -1.0]
    >>> feature_column(features([10.0]), "branch").tolist()
    [0.0]
    """
    index = FEATURES.index(name)
    if index >= X.shape[1]:
        return np.zeros(X.shape[0])
    column = np.ascontiguousarray(X[:, index], dtype=np.float64)
    return np.sign(column) if name == "branch" else column


def explain_rejection(problem: ValueError, X: ArrayLike, y: ArrayLike | None = None) -> InputError:
    """Say where NaN or infinity stands, or else what scikit-learn found."""
    names = [*FEATURES, "standard"]
    if any(word in str(problem) for word in ("NaN", "infinity")):
        columns = list(np.asarray(X, dtype=np.float64).T[: len(FEATURES)])
        given = dict(zip(names, columns, strict=False))
        if y is not None:
            given["standard"] = np.asarray(y, dtype=np.float64)
        for name, column in given.items():
            bad = np.flatnonzero(~np.isfinite(column))
            if bad.size:
                what = "NaN" if np.isnan(column[bad[0]]) else "infinity"
                return InputError(
                    f"{what} in column {name}, row {bad[0]} ({bad.size} in all)",
                    "a number in every row",
                    "leave such rows out or measure them again",
                )
    return InputError(" ".join(str(problem).split()), remedy="correct the table")
