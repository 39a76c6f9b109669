"""Columns of a feature matrix: the quantities of a reading."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

FloatArray = NDArray[np.float64]

FEATURES = ("reading_nm", "branch", "series", "speed_rpm", "temperature_c")
"""Columns of a feature matrix X, in this order; trailing columns may be missing."""

BRANCH_WORDS: Mapping[str, int] = {
    **dict.fromkeys(
        (
            *("up", "increasing", "inc", "rising", "+1", "1", "1.0"),
            *("ascending", "loading", "upwards", "↑"),
            *("auf", "aufwärts", "aufsteigend", "steigend", "zunehmend", "belastung"),
            *("加载", "上行", "进程", "正行程", "升程", "增载", "递增", "升", "上升"),
        ),
        1,
    ),
    **dict.fromkeys(
        (
            *("down", "decreasing", "dec", "falling", "-1", "-1.0"),
            *("descending", "unloading", "downwards", "↓"),
            *("ab", "abwärts", "absteigend", "fallend", "abnehmend", "entlastung"),
            *("卸载", "下行", "回程", "反行程", "降程", "减载", "递减", "降", "下降"),
        ),
        -1,
    ),
    **dict.fromkeys(("unknown", "0", "0.0"), 0),
}
"""Meaning of each word in a column ``branch``: +1, -1 or 0."""


def branch_values(branch: ArrayLike) -> FloatArray:
    """Return branches as +1, -1 and 0, whether they are words or numbers.

    Raises
    ------
    InputError
        Naming the first word that isn't known.

    Examples
    --------
    >>> branch_values(["up", "down", "unknown"]).tolist()
    [1.0, -1.0, 0.0]
    >>> float(branch_values("down"))
    -1.0
    """
    values = np.asarray(branch)
    if np.issubdtype(values.dtype, np.number) or values.dtype == np.bool_:
        return values.astype(np.float64)
    numbers = np.empty(values.shape)
    for position, word in np.ndenumerate(values):
        word = str(word)
        meaning = BRANCH_WORDS.get(word.strip().lower())
        if meaning is None:
            row = Message(", row {place}", position[0]) if position else ""
            raise InputError(
                Message("branch {word!r}{row}", word, row), "up, down or unknown (or +1, -1, 0)"
            )
        numbers[position] = meaning
    return numbers


def by_names(X: ArrayLike, columns: int | None = None) -> ArrayLike:
    """Return a data frame's columns in the order of `FEATURES`; other arrays are unchanged.

    A frame of pandas, polars or pyarrow is read by the names of its columns, in any order; other
    columns are ignored. A frame without any of these names is read by position, as scikit-learn
    does.

    Parameters
    ----------
    X : data frame or array of shape (n, k)
    columns : int, optional
        Number of columns of `FEATURES`; by default up to the first missing one.

    Raises
    ------
    InputError
        Where a column is missing.

    Examples
    --------
    >>> import pyarrow
    >>> by_names(pyarrow.table({"branch": ["up", "down"], "reading_nm": [1.0, 2.0]})).tolist()
    [[1.0, 1.0], [2.0, -1.0]]
    """
    if isinstance(X, np.ndarray | list | tuple):
        return X
    import narwhals as nw

    frame = nw.from_native(X, eager_only=True, pass_through=True)
    if not isinstance(frame, nw.DataFrame):
        return X
    present = [name for name in FEATURES if name in frame.columns]
    if not present:
        return X
    leading = next((k for k, name in enumerate(FEATURES) if name not in present), len(FEATURES))
    width = max(leading, 1) if columns is None else columns
    missing = [name for name in FEATURES[:width] if name not in present]
    if missing:
        raise InputError(
            Message(
                "a frame without the column {missing}; it has {columns}",
                missing[0],
                ", ".join(frame.columns),
            ),
            Message("the columns {features}", ", ".join(FEATURES[:width])),
            "use these column names",
        )
    given = {name: frame[name].to_numpy() for name in FEATURES[:width]}
    return features(**given)


def features(
    reading_nm: ArrayLike,
    branch: ArrayLike | None = None,
    series: ArrayLike | None = None,
    speed_rpm: ArrayLike | None = None,
    temperature_c: ArrayLike | None = None,
) -> FloatArray:
    """Combine known columns to a feature matrix X.

    Parameters
    ----------
    reading_nm : array of shape (n,)
        Torque reading in N·m, clockwise positive; its sign is the direction.
    branch : array of shape (n,) or scalar, optional
        +1 or "up" where the size of the torque grew, -1 or "down" where it fell, 0 where that
        isn't known.
    series : array of shape (n,) or scalar, optional
        Number of the series (0, 1, ...).
    speed_rpm, temperature_c : array of shape (n,) or scalar, optional
        Shaft speed in r/min and transducer temperature in °C.

    Returns
    -------
    X : float64 array of shape (n, k)
        The columns of `FEATURES` up to the last given one; columns missing before it hold 0.

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
    quantities = (reading_nm, branch, series, speed_rpm, temperature_c)
    width = max(index for index, column in enumerate(quantities) if column is not None) + 1
    reading = np.atleast_1d(np.asarray(reading_nm, dtype=np.float64))
    X = np.zeros((reading.size, width))
    for index, column in enumerate(quantities):
        if column is None:
            continue
        values = (
            branch_values(column)
            if FEATURES[index] == "branch"
            else np.asarray(column, dtype=np.float64)
        )
        if values.ndim > 1 or (values.ndim == 1 and values.size != reading.size):
            raise InputError(
                Message("column {name} has shape {shape}", FEATURES[index], values.shape),
                Message("one value for each of the {size} readings", reading.size),
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
    """Report the place of NaN or infinity, otherwise scikit-learn's message."""
    names = [*FEATURES, "standard"]
    if any(word in str(problem) for word in ("NaN", "infinity")):
        columns = list(np.asarray(X, dtype=np.float64).T[: len(FEATURES)])
        values = dict(zip(names, columns, strict=False))
        if y is not None:
            values["standard"] = np.asarray(y, dtype=np.float64)
        for name, column in values.items():
            bad = np.flatnonzero(~np.isfinite(column))
            if bad.size:
                what = "NaN" if np.isnan(column[bad[0]]) else "infinity"
                return InputError(
                    Message(
                        "{what} in column {name}, row {bad} ({size} in all)",
                        what,
                        name,
                        bad[0],
                        bad.size,
                    ),
                    "a number in every row",
                    "leave such rows out or measure them again",
                )
    return InputError(" ".join(str(problem).split()), remedy="correct the table")
