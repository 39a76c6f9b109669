"""Certificates as tables, in any supported format: columns by quantity, with clear errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.tables import Table, Understood


def check_columns(kind: str, least: int, *columns: NDArray[np.float64]) -> None:
    """Refuse columns of a certificate that have too few points or values that aren't finite.

    Parameters
    ----------
    kind : str
        Name of the certificate in errors.
    least : int
        Smallest number of points.
    *columns : ndarray of float64, shape (n,)

    Raises
    ------
    InputError
        Different lengths, fewer points, NaN.
    """
    first = columns[0]
    if len({column.shape for column in columns}) != 1 or first.ndim != 1:
        raise InputError(Message("{kind} with columns of different length", kind), "equal lengths")
    if first.size < least:
        raise InputError(
            Message("{kind} with {size} points", kind, first.size),
            Message("at least {least} points", least),
        )
    if not all(np.isfinite(column).all() for column in columns):
        raise InputError(Message("{kind} with a value that isn't a number", kind), "finite values")


def read_columns(
    path: Path | str,
    wanted: Mapping[str, str],
    required: Sequence[str],
    kind: str,
    remedy: str,
) -> tuple[Table, Understood]:
    """Return the table of a certificate, and its columns by quantity.

    Parameters
    ----------
    path : path
        File of any format that `read_table` reads.
    wanted, required
        As in `understand`.
    kind : str
        Name of the certificate in errors.
    remedy : str
        Place where the file's name is set.

    Raises
    ------
    InputError
        The file can't be read, is empty, or has no such columns.
    """
    from torquebench.tables import read_table, understand

    try:
        table = read_table(path)
        return table, understand(table, wanted, required)
    except InputError as error:
        message = Message("{kind}: {found}", kind, error.found)
        own = "" if "--column" in error.remedy else error.remedy
        raise InputError(message, error.allowed, own or remedy) from error
