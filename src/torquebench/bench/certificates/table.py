"""Certificates as tables: CSV files with named columns, read with clear errors."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["CertificateRow", "check_columns", "read_rows"]


@dataclass(frozen=True)
class CertificateRow:
    """One line of a certificate.

    Parameters
    ----------
    place : str
        File and line.
    cells : mapping
        Texts by column.
    """

    place: str
    cells: dict[str, str]

    def number(self, column: str) -> float:
        """Return the number in a column.

        Raises
        ------
        InputError
            The cell is missing or isn't a number.
        """
        try:
            return float(self.cells[column])
        except (TypeError, ValueError):
            raise InputError(
                Message("{place}: {column} = {cells!r}", self.place, column, self.cells[column]),
                "a number with a decimal point",
                "correct the line",
            ) from None


def check_columns(kind: str, least: int, *columns: NDArray[np.float64]) -> None:
    """Refuse columns of a certificate that aren't finite numbers of enough points.

    Parameters
    ----------
    kind : str
        Name of the certificate in errors.
    least : int
        Number of points that it has to have.
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


def read_rows(
    path: Path | str, columns: tuple[str, ...], kind: str, remedy: str
) -> list[CertificateRow]:
    """Read all lines of a certificate.

    Parameters
    ----------
    path : path
        CSV file with a header.
    columns : tuple of str
        Columns that have to be there.
    kind : str
        Name of the file in errors.
    remedy : str
        Place where the file's name is set.

    Raises
    ------
    InputError
        The file can't be read, is empty, or has no such columns.
    """
    file = Path(path)
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(stream))
    except OSError as error:
        raise InputError(
            Message("{kind} {file}: {strerror}", kind, file, error.strerror),
            "a readable CSV file",
            remedy,
        ) from error
    missing = [column for column in columns if not rows or column not in rows[0]]
    if missing:
        raise InputError(
            Message("{kind} {file}: no column {missing}", kind, file, ", ".join(missing)),
            Message("columns {columns}", ", ".join(columns)),
            "add the columns with their units in the header",
        )
    return [
        CertificateRow(f"{kind} {file} line {line}", row) for line, row in enumerate(rows, start=2)
    ]
