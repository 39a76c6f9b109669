"""Tables of measured reducers: columns by quantity, and the choice of rows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.units import BASE, kinds_of

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.tables import Table, Understood


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
        Word for a place in the file: "line" or "row".
    notes : tuple of str
        Notes about content that the reader ignored.
    """

    numbers: Mapping[str, NDArray[np.float64]]
    rows: NDArray[np.int64]
    counted: str
    understood: Understood
    notes: tuple[str, ...]


def read_columns(
    files: Sequence[Path],
    wanted: Mapping[str, str],
    required: Sequence[str],
    mapping: Sequence[str],
    where: Sequence[str],
) -> ReducerColumns:
    """Return columns of a table, or of several one after another, by quantity.

    A needed quantity without a column is taken from a comment of its file (``# speed_rpm = 300``),
    or from the only value of its kind in the file's name (``drag 300rpm.csv``). Of several files
    the rows count through all of them, and each is a run of its own.

    Parameters
    ----------
    files : sequence of pathlib.Path
        Files of any format that `read_table` reads.
    wanted, required, mapping
        As of `understand`.
    where : sequence of str
        ``Header=value,value`` of the rows that are used.

    Raises
    ------
    InputError
        Where a column is missing or unknown, has no or another unit, or no row is left.
    """
    import numpy as np

    parts = [_read(file, wanted, required, mapping, where) for file in files]
    if len(parts) == 1:
        return parts[0]
    common = [name for name in parts[0].numbers if all(name in part.numbers for part in parts)]
    columns = {name: np.concatenate([part.numbers[name] for part in parts]) for name in common}
    sizes = [part.rows.size for part in parts]
    if wanted.get("run") == "label":
        number = np.repeat(np.arange(len(parts)), sizes)
        pairs = np.column_stack([number, columns.get("run", np.zeros(number.size))])
        runs = np.unique(pairs, axis=0, return_inverse=True)[1].ravel()
        columns["run"] = 1.0 + runs.astype(np.float64)
    ends = np.cumsum(sizes)
    spans = [
        f"{file.name} {end - size + 1}-{end}"
        for file, size, end in zip(files, sizes, ends, strict=True)
    ]
    notes = [note for part in parts for note in part.notes]
    notes.append(Message("rows count through all files: {spans}", ", ".join(spans)))
    left = sorted({name for part in parts for name in part.numbers} - set(common))
    if left:
        notes.append(Message("not used, because not in all files: {columns}", ", ".join(left)))
    rows = np.arange(1, int(ends[-1]) + 1)
    return ReducerColumns(columns, rows, "row", parts[0].understood, tuple(notes))


def _read(
    data: Path,
    wanted: Mapping[str, str],
    required: Sequence[str],
    mapping: Sequence[str],
    where: Sequence[str],
) -> ReducerColumns:
    """Read the columns of a reducer test from a table, with constants that its headers state."""
    import numpy as np

    from torquebench.tables import read_table, understand

    table = read_table(data)
    named = [text.partition("=")[0].strip() for text in mapping]
    constants: dict[str, float] = {}
    present = understand(table, wanted, named, mapping)
    missing = [name for name in required if name not in present and name not in named]
    for name in missing:
        alone = [wanted[other] for other in missing].count(wanted[name]) == 1
        constants |= _stated_once(table, data, name, wanted[name], in_name=alone)
    needed = [name for name in required if name not in constants]
    understood = understand(table, wanted, needed, mapping)
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
    for name, value in constants.items():
        numbers[name] = np.full(len(table), value)
        notes.append(
            Message(
                "{name} = {value:.6g} {unit} in all rows, by a comment or the name of {file}",
                name,
                value,
                BASE[wanted[name]],
                data.name,
            )
        )
    return ReducerColumns(numbers, np.asarray(table.rows), table.counted, understood, tuple(notes))


_VALUE = re.compile(r"[+-]?[0-9]+(?:[.,][0-9]+)?")
_IN_NAME = re.compile(r"(?:(?<![A-Za-z0-9])[+-])?(?<![0-9.,])[0-9]+(?:[.,][0-9]+)?")
_UNIT_BEHIND = re.compile(r"[ ]?([^\s\d_,;()+-]+)(-[A-Za-z]+)?")


def _stated_once(
    table: Table, data: Path, name: str, kind: str, *, in_name: bool
) -> dict[str, float]:
    """Return a quantity that a comment states, or the only value of its kind in a file's name."""
    from torquebench.tables import Table, understand

    settings: list[tuple[str, str]] = []
    for remark, value in table.remarks.items():
        number = _VALUE.match(value)
        if number and (remark == name or remark.startswith((f"{name}_", f"{name} "))):
            unit = value[number.end() :].strip()
            settings.append((f"{remark} [{unit}]" if unit else remark, number[0]))
    if not settings and in_name:
        for number in _IN_NAME.finditer(data.stem):
            behind = _UNIT_BEHIND.match(data.stem, number.end())
            units = (behind[0].strip(), behind[1]) if behind else ()
            stated = [unit for unit in units if kind in kinds_of(unit)]
            settings += [(f"{name} [{unit}]", number[0]) for unit in stated[:1]]
    if len(settings) != 1:
        return {}
    ((header, text),) = settings
    once = Table(data.name, (header,), ([text],), (1,))
    values = understand(once, {name: kind}).numbers(once, name)
    return {} if values is None else {name: float(values[0])}


def _chosen(table: Table, where: Sequence[str]) -> Table:
    """Return the rows of a table that meet all conditions of `--where`."""
    import numpy as np

    if not where:
        return table
    rows = np.ones(len(table), dtype=bool)
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
            rows &= np.isin(table.numbers(header), [float(value) for value in wanted])
        except (ValueError, InputError):
            words = [word.strip().casefold() for word in table.texts(header)]
            rows &= np.isin(words, [word.casefold() for word in wanted])
    if not np.any(rows):
        raise InputError("no row is left", "a row that meets every --where", "check the values")
    return table.chosen(np.flatnonzero(rows))
