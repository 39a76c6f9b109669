"""Tables of measured reducers: columns by quantity, and the choice of rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.tables.csv_text import CsvTable

__all__ = ["Kind", "read_columns"]

Kind = str
"""As in `records.columns`."""


def read_columns(
    data: Path,
    wanted: Mapping[str, Kind],
    required: Sequence[str],
    mapping: Sequence[str],
    where: Sequence[str],
) -> dict[str, NDArray[np.float64]]:
    """Return columns of a table in N·m, rad, 1/min, s and °C, by quantity.

    Parameters
    ----------
    data : pathlib.Path
        The file, of any format that `read_table` reads.
    wanted, required, mapping
        As of `chosen_columns`.
    where : sequence of str
        ``Header=value,value`` of the rows that are used.

    Raises
    ------
    InputError
        Where a column is missing or unknown, has no or another unit, or no row is left.
    """
    from torquebench.tables.columns import chosen_columns
    from torquebench.tables.files import read_table

    table = read_table(data)
    chosen = chosen_columns(table, wanted, required, mapping)
    table.check_decimal_marks([header for header, _ in chosen.values()])
    rows = _rows(table, where)
    return {name: table.numbers(header)[rows] * factor for name, (header, factor) in chosen.items()}


def _rows(table: CsvTable, where: Sequence[str]) -> NDArray[np.intp]:
    import numpy as np

    kept = np.ones(len(table.rows), dtype=bool)
    for text in where:
        header, equals, values = text.partition("=")
        header = header.strip().lower()
        if not equals or header not in table.header:
            raise InputError(
                Message("--where {text}", text),
                Message("Header=value,value with one of {header}", ", ".join(table.names)),
            )
        try:
            wanted = [float(value) for value in values.split(",")]
        except ValueError:
            raise InputError(
                Message("--where {text}", text), "numbers after the =, separated by commas"
            ) from None
        kept &= np.isin(table.numbers(header), wanted)
    if not np.any(kept):
        raise InputError("no row is left", "rows that every --where keeps", "check the values")
    return np.flatnonzero(kept)
