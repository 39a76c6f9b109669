"""Certificates as tables: CSV files with named columns, read with clear errors."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["CertificateRow", "read_rows"]


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
