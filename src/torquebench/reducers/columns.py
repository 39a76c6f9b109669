"""Checks of the input columns of evaluations."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["finite_columns", "labels"]


def finite_columns(least: int, **columns: ArrayLike) -> tuple[NDArray[np.float64], ...]:
    """Return columns as equally long rows of finite numbers.

    Parameters
    ----------
    least : int
        Least number of values.
    **columns : array_like
        By name, for messages.

    Raises
    ------
    InputError
        Where lengths differ, there are too few values, or one isn't finite (named with its row).

    Examples
    --------
    >>> finite_columns(1, torque_nm=[1.0, float("nan")])
    Traceback (most recent call last):
    torquebench.errors.InputError: torque_nm is nan in row 2; allowed: finite numbers; ...
    """
    rows = tuple(np.atleast_1d(np.asarray(column, dtype=np.float64)) for column in columns.values())
    size = rows[0].size
    for name, row in zip(columns, rows, strict=True):
        if row.ndim != 1 or row.size != size:
            raise InputError(
                Message("{name} of shape {shape}", name, row.shape),
                Message("one value for each of {size} in {name}", size, next(iter(columns))),
            )
        bad = np.flatnonzero(~np.isfinite(row))
        if bad.size:
            raise InputError(
                Message(
                    "{name} is {row} in row {bad}{size}",
                    name,
                    row[bad[0]],
                    bad[0] + 1,
                    Message(" and {size} others", bad.size - 1) if bad.size > 1 else "",
                ),
                "finite numbers",
                "remove these rows, or measure them again",
            )
    if size < least:
        raise InputError(
            Message("{size} values of {name}", size, next(iter(columns))),
            Message("at least {limit}", least),
        )
    return rows


def labels(values: ArrayLike | None, size: int, default: float, name: str) -> NDArray[np.float64]:
    """Return labels, shape (size,); by default the same for all.

    Raises
    ------
    InputError
        Where the length differs or a label isn't finite.
    """
    if values is None:
        return np.full(size, default)
    row = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if row.shape != (size,):
        raise InputError(
            Message("{name} of shape {shape}", name, row.shape), Message("{size} labels", size)
        )
    if not np.all(np.isfinite(row)):
        raise InputError(Message("a {name} that isn't finite", name), "a finite label in each row")
    return row
