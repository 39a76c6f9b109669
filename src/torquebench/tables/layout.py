"""Layout of a foreign file: title block, header, row of units, first row of values.

The header is the row of words above the columns of numbers. Title blocks, preambles of scopes and
loggers, and rows with a date may precede it; a row of units may follow it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.units import kinds_of

HEAD_ROWS = 400
"""Number of rows from the beginning of a file in which the header is searched."""
_NUMBER = re.compile(
    r"[+-]?(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)(?:[eE][+-]?[0-9]+)?|[+-]?inf|nan", re.IGNORECASE
)
_MOMENT = re.compile(r"\d{1,4}[-/.]\d\d?[-/.]\d{1,4}([T ].*)?|\d\d?:\d\d(:\d\d.*)?")
_NO_UNIT = ("", "-", "–", "—", "(none)", "none", "1", "n/a", "%", "-/-", "[-]", "(-)")
_BRACKETS = "[](){}<>"
_NAMED_SHARE = 0.6
"""Smallest share of the columns with numbers that a header must name."""
_SCOPE_ROWS = ("symbolcomment", "data-type", "datatype", "sampletime", "sampletime[ms]")
"""First cells of the rows below the names in an export of TwinCAT's scope."""
_FILETIME = 1e16
"""Times above this are ticks of 100 ns since 1601, as in Windows."""


@dataclass(frozen=True)
class Layout:
    """Structure of the table in a file's rows.

    Parameters
    ----------
    names : tuple of str
        Names of all columns of the file, with units from a row below.
    first : int
        Index of the first row of values.
    columns : tuple of int
        Columns of the file that belong to the table, in order.
    ticks : int or None
        Column with times in ticks of 100 ns.
    notes : tuple of str
        Notes on ignored contents.
    partial : bool
        Whether rows also have other cells, which are ignored.
    """

    names: tuple[str, ...]
    first: int
    columns: tuple[int, ...]
    ticks: int | None = None
    notes: tuple[str, ...] = field(default=())
    partial: bool = False


def find_layout(
    rows: Sequence[Sequence[str]],
    numbers: Sequence[int],
    *,
    counted: str,
    known: Callable[[str], bool],
    commented: Sequence[str] = (),
) -> Layout:
    """Return the position of the header and of the values.

    Parameters
    ----------
    rows : sequence of sequence of str
        Cells of the first rows that aren't empty, at most `HEAD_ROWS` rows.
    numbers : sequence of int
        Numbers of these rows in the file.
    counted : str
        Word for a place in the file, such as "line", for notes.
    known : callable
        Function that returns whether a column's name is known.
    commented : sequence of str
        Cells of a comment directly above the first row, which may be the header.

    Examples
    --------
    >>> rows = [["Report", ""], ["Date", "2026-03-02"], ["F", "x"], ["Nm", "s"], ["1", "2"]]
    >>> layout = find_layout(rows, [1, 2, 4, 5, 6], counted="line", known=lambda name: False)
    >>> layout.names, layout.first, layout.notes
    (('F [Nm]', 'x [s]'), 4, ('lines 1 to 2 above the header are passed over',))
    """
    width = max(map(len, rows))
    scope = _scope_header(rows)
    if scope is not None:
        return _of_scope(rows, scope)
    numeric = _numeric_columns(rows, width)
    header = _header(rows, numeric, known)
    if header is None:
        names = [*commented, *[""] * (width - len(commented))] if commented else [""] * width
        if len(commented) > width or len([name for name in names if name]) < len(numeric):
            names = [""] * width
        return Layout(_completed(names), 0, tuple(range(width)))
    names = [" ".join(cell.split()) for cell in rows[header]]
    while len(names) > 1 and not names[-1]:
        names.pop()
    first = header + 1
    if first < len(rows) - 1 and _is_units(rows[first], numeric):
        names = _with_units(names, rows[first])
        first += 1
        while first < len(rows) - 1 and _repeats(rows[first], rows[header], numeric):
            first += 1
    notes: tuple[str, ...] = ()
    if header > 0:
        notes = (
            Message(
                "{counted}s {first} to {last} above the header are passed over",
                counted,
                numbers[0],
                numbers[header - 1],
            )
            if header > 1
            else Message("{counted} {first} above the header is passed over", counted, numbers[0]),
        )
    return Layout(_completed(names), first, tuple(range(len(names))), notes=notes)


def _is_number(cell: str) -> bool:
    return _NUMBER.fullmatch(cell.strip()) is not None


def _is_value(cell: str) -> bool:
    return _is_number(cell) or _MOMENT.fullmatch(cell.strip()) is not None


def _numeric_columns(rows: Sequence[Sequence[str]], width: int) -> tuple[int, ...]:
    """Return the columns that contain numbers in most of the later rows."""
    later = rows[-max(1, len(rows) // 2) :]
    columns = []
    for column in range(width):
        cells = [row[column] for row in later if column < len(row) and row[column].strip()]
        if cells and 2 * sum(map(_is_number, cells)) >= len(cells) and 3 * len(cells) >= len(later):
            columns.append(column)
    return tuple(columns)


def _cell(row: Sequence[str], column: int) -> str:
    return row[column].strip() if column < len(row) else ""


def _header(
    rows: Sequence[Sequence[str]], numeric: tuple[int, ...], known: Callable[[str], bool]
) -> int | None:
    """Return the index of the header; None if no row names the columns."""
    if not numeric:
        return 0
    least = max(1.0, _NAMED_SHARE * len(numeric))

    def names(row: Sequence[str]) -> bool:
        cells = [_cell(row, column) for column in numeric]
        return not any(map(_is_value, cells)) and sum(map(bool, cells)) >= least

    def holds_values(row: Sequence[str]) -> bool:
        cells = [_cell(row, column) for column in numeric]
        values = sum(map(_is_value, cells))
        return 2 * values >= len(numeric) and (_is_value(cells[0]) or 2 * values > len(numeric))

    candidates = [index for index, row in enumerate(rows) if names(row)]
    begin = next((index for index, row in enumerate(rows) if holds_values(row)), len(rows))
    above = [index for index in candidates if index < begin]
    if not above:  # numbers in a title block may precede the header
        return next(
            (index for index in candidates if index > begin and index < len(rows) - 1), None
        )
    above = [
        index for index in above if index == above[0] or not _is_units(rows[index], numeric)
    ] or above
    scores = {index: sum(1 for cell in rows[index] if cell and known(cell)) for index in above}
    return max(above, key=lambda index: (scores[index], index))


def _is_units(row: Sequence[str], numeric: tuple[int, ...]) -> bool:
    """Return whether a row contains units: most of its non-empty cells are known units."""
    cells = [cell.strip().strip(_BRACKETS) for cell in row if cell.strip()]
    named = [cell for cell in cells if cell.lower() not in _NO_UNIT]
    if not named or any(_is_value(_cell(row, column)) for column in numeric):
        return False
    understood = [cell for cell in named if kinds_of(cell)]
    return 2 * len(understood) >= len(named) and all(len(cell) <= 12 for cell in named)


def _with_units(names: list[str], row: Sequence[str]) -> list[str]:
    completed = []
    for column, name in enumerate(names):
        unit = _cell(row, column)
        bare = unit.strip(_BRACKETS).strip()
        plain = not unit or bare.lower() in _NO_UNIT or unit.lower() in _NO_UNIT
        completed.append(name if plain else f"{name} [{bare}]")
    return completed


def _repeats(row: Sequence[str], header: Sequence[str], numeric: tuple[int, ...]) -> bool:
    """Return whether a row repeats names or units instead of holding values."""
    if any(_is_value(_cell(row, column)) for column in numeric):
        return False
    cells = {cell.strip() for cell in row if cell.strip()}
    return bool(cells) and (cells <= {cell.strip() for cell in header} or _is_units(row, numeric))


def _completed(names: Sequence[str]) -> tuple[str, ...]:
    """Return the names, with numbered names for columns that the file doesn't name."""
    return tuple(name or f"column {number}" for number, name in enumerate(names, 1))


# -- TwinCAT's scope ------------------------------------------------------------------------


def _scope_header(rows: Sequence[Sequence[str]]) -> int | None:
    """Return the row of names in a scope's export, which rows of properties follow."""
    first = [_cell(row, 0).lower() for row in rows]
    for index, cell in reversed(list(enumerate(first[:-1]))):  # a scope has a name, too
        if cell == "name" and any(each in _SCOPE_ROWS for each in first[index + 1 : index + 4]):
            return index
    return None


def _last(row: Sequence[str]) -> int:
    return max((at for at, cell in enumerate(row, 1) if cell.strip()), default=0)


def _of_scope(rows: Sequence[Sequence[str]], header: int) -> Layout:
    """Return the channels with the most frequent sample time, and the times of the first."""
    properties: dict[str, Sequence[str]] = {}
    for row in rows[header + 1 :]:
        properties.setdefault(_cell(row, 0).lower(), row)
    first = next(
        index
        for index in range(header + 1, len(rows) + 1)
        if index == len(rows) or _is_number(_cell(rows[index], 0))
    )
    cells = [" ".join(cell.split()) for cell in rows[header]]
    units, steps = (
        next((properties[key] for key in keys if key in properties), ())
        for keys in (("unit",), ("sampletime[ms]", "sampletime"))
    )
    for row in filter(None, (steps, *rows[first : first + 1])):
        if _last(row) != _last(rows[header]):
            raise InputError(
                Message(
                    "an export of TwinCAT's scope with {count} names and {found} cells from "
                    "{cell!r} on",
                    _last(rows[header]),
                    _last(row),
                    _cell(row, 0),
                ),
                "a separator that isn't the decimal mark and stands in no name",
                "export with tabs or semicolons",
            )
    channels = [at for at, name in enumerate(cells) if name and name.lower() != "name"]
    step_of = {at: _cell(steps, at) for at in channels}
    step = max(step_of.values(), key=list(step_of.values()).count, default="")
    others = [at for at in channels if step_of[at] != step]
    values = (
        [float(cell.replace(",", ".")) for cell in rows[first][:1]] if first < len(rows) else []
    )
    ticks = 0 if values and values[0] > _FILETIME else None
    names: list[str] = []
    columns: list[int] = []
    for column, name in enumerate(cells):
        time = name.lower() == "name"
        if time and (columns or step_of.get(column + 1, step) != step):
            continue  # every channel has times, of which those of the first are used
        if column in others:
            continue
        unit = _cell(units, column).partition(" (")[0].strip(_BRACKETS)  # for example V (Voltage)
        if time:
            name = "time [s]" if ticks is not None else "time [ms]"
        elif unit and unit.lower() not in _NO_UNIT:
            name = f"{name} [{unit}]"
        if name:
            names.append(name)
            columns.append(column)
    notes: list[str] = []
    if sum(cell.lower() == "name" for cell in cells) > 1 + bool(others):
        notes.append(
            Message("times of {columns} channels are taken as one", len(channels) - len(others))
        )
    if others:
        left = ", ".join(cells[at] for at in others)
        notes.append(Message("not read, because sampled at other times: {names}", left))
    return Layout(tuple(names), first, tuple(columns), ticks, tuple(notes), bool(others))
