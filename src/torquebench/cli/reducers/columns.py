"""Tables of measured reducers: columns by quantity, and the choice of rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.tables import Conversion, Table, Understood

__all__ = ["ReducerColumns", "read_columns"]


@dataclass(frozen=True, eq=False)
class ReducerColumns:
    """Columns of a table by quantity.

    Parameters
    ----------
    numbers : mapping of str to array of float, shape (n,)
        In N·m, rad, 1/min, s and °C.
    rows : array of int, shape (n,)
        Number of each row in the file.
    counted : str
        What the file counts: "line" or "row".
    understood : Understood
    notes : tuple of str
        What the reader passed over.
    """

    numbers: Mapping[str, NDArray[np.float64]]
    rows: NDArray[np.int64]
    counted: str
    understood: Understood
    notes: tuple[str, ...]


def read_columns(
    data: Path,
    wanted: Mapping[str, str],
    required: Sequence[str],
    mapping: Sequence[str],
    where: Sequence[str],
    conversion: Conversion | None = None,
) -> ReducerColumns:
    """Return columns of a table by quantity.

    Parameters
    ----------
    data : pathlib.Path
        The file, of any format that `read_table` reads.
    wanted, required, mapping, conversion
        As of `understand`.
    where : sequence of str
        ``Header=value,value`` of the rows that are used.

    Raises
    ------
    InputError
        Where a column is missing or unknown, has no or another unit, or no row is left.
    """
    import numpy as np

    from torquebench.tables import read_table, understand

    table = read_table(data)
    understood = understand(table, wanted, required, mapping, conversion)
    table = _chosen(table, where)
    numbers, notes = {}, list(table.notes)
    for name, column in understood.columns.items():
        try:
            values = understood.numbers(table, name)
        except InputError as problem:
            if name in required or not column.by_words:
                raise
            notes.append(Message("not used: {problem}", problem.found))
            continue
        if values is not None:
            numbers[name] = values
    return ReducerColumns(numbers, np.asarray(table.rows), table.counted, understood, tuple(notes))


def _chosen(table: Table, where: Sequence[str]) -> Table:
    import numpy as np

    if not where:
        return table
    kept = np.ones(len(table), dtype=bool)
    for text in where:
        header, equals, values = text.partition("=")
        header = header.strip()
        if not equals or header not in table:
            raise InputError(
                Message("--where {text}", text),
                Message("Header=value,value with one of {header}", table.listed()),
            )
        wanted = [value.strip() for value in values.split(",")]
        try:
            kept &= np.isin(table.numbers(header), [float(value) for value in wanted])
        except (ValueError, InputError):
            words = [word.strip().casefold() for word in table.texts(header)]
            kept &= np.isin(words, [word.casefold() for word in wanted])
    if not np.any(kept):
        raise InputError("no row is left", "rows that every --where keeps", "check the values")
    return table.chosen(np.flatnonzero(kept))
