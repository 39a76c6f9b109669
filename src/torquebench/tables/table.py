"""A table in memory: named columns of cells, and the position of each cell in its file."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message

if TYPE_CHECKING:
    import pyarrow as pa

Cells: TypeAlias = "list[str] | NDArray[np.float64] | pa.Array | pa.ChunkedArray"
"""Cells of a column: texts of a small text file, numbers, or an Arrow array of any type."""

_DIGITS = r"(?:[0-9]+(?:[.,][0-9]*)?|[.,][0-9]+)"
_NUMBER = re.compile(rf"[+-]?{_DIGITS}(?:[eE][+-]?[0-9]+)?", re.ASCII)
_NUMBERS = re.compile(rf"(?:[+-]?{_DIGITS}(?:[eE][+-]?[0-9]+)?\n)*+", re.ASCII)
_WHOLE = re.compile(r"[+-]?[0-9]+", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}", re.ASCII)
_SPREADSHEET_ERROR = re.compile(r'"?#(N/A|NV|[A-ZÄÖÜ0-9/]+[!?])')
_MINUS = str.maketrans({"\N{MINUS SIGN}": "-", "\N{NO-BREAK SPACE}": " "})
_EXACT = 2.0**53
_NONE = -128
_MOST_LISTED = 12


@dataclass(frozen=True, eq=False)
class Table:
    r"""A table, or a piece of one.

    Parameters
    ----------
    origin : str
        Name of the file, with the sheet or group, for messages.
    names : tuple of str
        Names of the columns in the file, with units from a row below.
    cells : tuple of Cells
        A column of cells for each name.
    rows : sequence of int
        Number of each row in the file, for messages.
    counted : str
        What these numbers count: "line" in a text, otherwise "row".
    remarks : mapping of str to str
        Values of comments such as ``# range_nm = 20``, by their names in lower case.
    notes : tuple of str
        Notes on contents that the reader ignored.
    separator : str
        Separator of a text file.
    quoted : bool
        Whether a cell may need quotation marks in a text with this separator.
    shared : dict
        State that the pieces of one file share: the first cell with each decimal mark, the first
        moment.

    Examples
    --------
    >>> table = Table("a.csv", ("reading_nm", "note"), (["1,5", "2"], ["", "x"]), range(2, 4))
    >>> len(table), table.numbers("reading_nm").tolist(), table.place(1, "note")
    (2, [1.5, 2.0], 'a.csv, line 3, column note')
    """

    origin: str
    names: tuple[str, ...]
    cells: tuple[Cells, ...]
    rows: Sequence[int] | NDArray[np.integer[Any]]
    counted: str = "line"
    remarks: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    separator: str = ","
    quoted: bool = True
    shared: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def simulated(self) -> bool:
        """Whether the file states that it is simulated."""
        return self.stated("simulated")

    def stated(self, name: str) -> bool:
        """Return whether a comment of this name is true."""
        return self.remarks.get(name, "").lower() in ("true", "yes", "1")

    def column(self, name: str | int) -> Cells:
        """Return the cells of a column by its name, in any case, or its index."""
        return self.cells[self.index(name)]

    def index(self, name: str | int) -> int:
        """Return the index of a column by its name, in any case."""
        if isinstance(name, int):
            return name
        if name in self.names:
            return self.names.index(name)
        return [each.casefold() for each in self.names].index(name.casefold())

    def __contains__(self, name: str) -> bool:
        return name.casefold() in (each.casefold() for each in self.names)

    def listed(self) -> str:
        """Return the names for messages; of many names, only the first ones."""
        more = len(self.names) - _MOST_LISTED
        listed = ", ".join(self.names[:_MOST_LISTED])
        return Message("{columns} and {count} more", listed, more) if more > 0 else listed

    def place(self, row: int, column: str) -> str:
        """Return the position of a cell for messages; `row` counts from 0."""
        return Message(
            "{origin}, {counted} {lines}, column {column}",
            self.origin,
            self.counted,
            int(self.rows[row]),
            column,
        )

    def texts(self, name: str | int) -> list[str]:
        """Return the cells of a column as text; those without a value are empty."""
        return _texts(self.column(name))

    def numbers(self, name: str | int) -> NDArray[np.float64]:
        """Return the cells of a column as finite numbers, shape (n,).

        Raises
        ------
        InputError
            With the first cell that is empty, isn't a number or isn't finite, or has another
            decimal mark than an earlier cell.
        """
        index = self.index(name)
        cells, name = self.cells[index], self.names[index]
        if not isinstance(cells, list | np.ndarray):
            cells = self._of_arrow(cells, name)
        if isinstance(cells, np.ndarray):
            bad = np.flatnonzero(~np.isfinite(cells))
            if bad.size:
                self._refuse(int(bad[0]), name, "" if np.isnan(cells[bad[0]]) else "inf")
            return cells
        return self._of_texts(cells, name)

    def times(self, name: str | int) -> NDArray[np.float64]:
        """Return the cells of a column as times in its unit, or in s since the first moment.

        Raises
        ------
        InputError
            As `numbers`.
        """
        moments = _moments(self.column(name))
        if moments is None:
            return self.numbers(name)
        ticks, per_s = moments
        start = self.shared.setdefault(f"start of {name}", 0 if per_s < 0 else ticks[0])
        return np.asarray((ticks - start) * abs(per_s), dtype=np.float64)

    def has_moments(self, name: str | int) -> bool:
        """Return whether a column contains moments or durations instead of numbers."""
        return _moments(self.column(name)[:1]) is not None

    def meanings(
        self, name: str | int, meaning: Mapping[str, int], allowed: str
    ) -> NDArray[np.int8]:
        """Return the meanings of the words in a column, shape (n,).

        Raises
        ------
        InputError
            A cell's word has no meaning; the message names the first one.
        """
        cells = self.column(name)
        places: NDArray[np.intp] | None = None
        if not isinstance(cells, list | np.ndarray):
            import pyarrow as pa

            whole = cells.combine_chunks() if isinstance(cells, pa.ChunkedArray) else cells
            if not pa.types.is_dictionary(whole.type):
                whole = whole.dictionary_encode(null_encoding="encode")
            places, cells = numbers_of(whole.indices.fill_null(-1)), whole.dictionary
        words = [word.strip().lower() for word in _texts(cells)]
        found = np.array([*(meaning.get(word, _NONE) for word in words), _NONE], dtype=np.int8)
        found = found[:-1] if places is None else found[places]
        for row in np.flatnonzero(found == _NONE):
            text = _texts(self.column(name)[int(row) : int(row) + 1])[0]
            word = f"{text!r}" if text else "an empty cell"
            place = self.place(int(row), self.names[self.index(name)])
            raise InputError(Message("{place}: {found}", place, word), allowed)
        return np.asarray(found)

    def chosen(self, rows: NDArray[np.intp]) -> Table:
        """Return the table with the selected rows."""
        cells = tuple(
            [column[row] for row in rows] if isinstance(column, list) else _taken(column, rows)
            for column in self.cells
        )
        return replace(self, cells=cells, rows=np.asarray(self.rows)[rows])

    @staticmethod
    def joined(pieces: Sequence[Table]) -> Table:
        """Join the pieces of a table, in order."""
        if len(pieces) == 1:
            return pieces[0]
        columns = zip(*(piece.cells for piece in pieces), strict=True)
        rows = np.concatenate([np.asarray(piece.rows) for piece in pieces])
        return replace(pieces[0], cells=tuple(map(_joined, columns)), rows=rows)

    def _of_arrow(self, cells: Any, name: str) -> NDArray[np.float64] | list[str]:
        """Return an Arrow column as numbers, or as texts if some aren't plain numbers."""
        import pyarrow as pa
        import pyarrow.compute as pc

        if pa.types.is_dictionary(cells.type):
            cells = pc.cast(cells, cells.type.value_type)
        kind = cells.type
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            return self._of_arrow_texts(cells, name)
        numeric = (
            pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)
        )
        if not numeric and not pa.types.is_null(kind):
            raise InputError(
                Message("{origin}: column {name} holds {kind}", self.origin, name, _words_of(kind)),
                "numbers",
                Message("choose another column for it"),
            )
        return numbers_of(pc.cast(cells, pa.float64())).astype(np.float64, copy=False)

    def _of_arrow_texts(self, cells: Any, name: str) -> NDArray[np.float64] | list[str]:
        """Return plain numbers with one decimal mark, or the texts if any isn't such a number."""
        import pyarrow as pa
        import pyarrow.compute as pc

        if cells.null_count:
            return _texts(cells)
        if not {",", "."} & self.shared.keys():
            self._remember_first(cells, name)
        comma = "," in self.shared
        if comma and ("." in self.shared or pc.any(pc.match_substring(cells, ".")).as_py()):
            return _texts(cells)
        plain = pc.replace_substring(cells, ",", ".") if comma else cells
        for prepare in (lambda texts: texts, pc.utf8_trim_whitespace):
            try:
                values = numbers_of(pc.cast(prepare(plain), pa.float64()))
            except pa.ArrowInvalid:
                continue
            return values if np.isfinite(values).all() else _texts(cells)
        return _texts(cells)

    def _remember_first(self, cells: Any, name: str) -> None:
        """Record the decimal marks in the first column of texts that has one."""
        import pyarrow.compute as pc

        for mark in ",.":
            marked = pc.match_substring(cells, mark)
            first = pc.index(marked, True).as_py()
            if first >= 0:
                self.shared[mark] = f"{cells[first].as_py().strip()!r} in {self.place(first, name)}"
                if not pc.all(marked).as_py():  # it may be a thousands separator
                    self._check_thousands([text.strip() for text in cells.to_pylist()], name)

    def _of_texts(self, cells: list[str], name: str) -> NDArray[np.float64]:
        text = "\n".join(cells)
        if not text.isascii():
            cells = [cell.translate(_MINUS).strip() for cell in cells]
            text = "\n".join(cells)
        if not _NUMBERS.fullmatch(text + "\n") or text.count("\n") != len(cells) - 1:
            for row, cell in enumerate(cells):
                if not _NUMBER.fullmatch(cell.strip()):
                    self._refuse(row, name, cell.strip())
            cells = [cell.strip() for cell in cells]
            text = "\n".join(cells)
        for mark in ".,":
            if mark in text:
                self._remember(mark, cells, name)
        self._check_thousands(cells, name)
        values = np.array(text.replace(",", ".").split("\n"), dtype=np.float64)
        for bad in np.flatnonzero(~np.isfinite(values)):
            raise InputError(
                Message("{place}: {text!r}", self.place(int(bad), name), cells[bad]),
                "a finite number",
            )
        return values

    def _refuse(self, row: int, name: str, text: str) -> None:
        if not text or text.lower() in ("nan", "n/a", "na", "-", "none", "null"):
            raise InputError(
                Message(
                    "{place}: {text}",
                    self.place(row, name),
                    repr(text) if text else "an empty cell",
                ),
                "a number in every cell",
                "remove the line or measure the point again",
            )
        raise InputError(
            Message("{place}: {text!r}", self.place(row, name), text), *what_number(text)
        )

    def _remember(self, mark: str, cells: list[str], name: str) -> None:
        """Record a decimal mark; refuse one that differs from that of earlier cells."""
        other = "." if mark == "," else ","
        if mark in self.shared and other not in self.shared:
            return
        row = next(row for row, cell in enumerate(cells) if mark in cell)
        self.shared.setdefault(mark, f"{cells[row]!r} in {self.place(row, name)}")
        if other in self.shared:
            raise InputError(
                Message(
                    "decimal commas and points mixed: {first}, but {other}",
                    self.shared[mark],
                    self.shared[other],
                ),
                "one decimal mark throughout the file",
                "save the file again with one number format",
            )

    def _check_thousands(self, cells: list[str], name: str) -> None:
        """Refuse 1,200 after 980: a mark before three digits, if larger numbers have none."""
        marked = [row for row, cell in enumerate(cells) if "," in cell or "." in cell]
        if not marked or len(marked) == len(cells):
            return
        whole = [abs(int(cell)) for cell in cells if _WHOLE.fullmatch(cell) and len(cell) < 20]
        if not whole or not all(_THOUSANDS.fullmatch(cells[row]) for row in marked):
            return
        largest = max(abs(float(cells[row].replace(",", "."))) for row in marked)
        if 100 <= max(whole) < 1000 and 5.0 * largest < max(whole):
            raise InputError(
                Message(
                    "{place}: {texts!r} in a column with {whole}",
                    self.place(marked[0], name),
                    cells[marked[0]],
                    max(whole),
                ),
                "numbers without thousands separators",
                "save the file without them, or with as many decimals in every cell",
            )


def _taken(column: Any, rows: NDArray[np.intp]) -> Any:
    return column[rows] if isinstance(column, np.ndarray) else column.take(list(map(int, rows)))


def _joined(parts: Sequence[Any]) -> Cells:
    """Join the cells of a column from several pieces."""
    if all(isinstance(part, np.ndarray) for part in parts):
        return np.concatenate(parts)
    if all(isinstance(part, list) for part in parts):
        return [cell for part in parts for cell in part]
    import pyarrow as pa

    chunks = [strings_of(part) if isinstance(part, list) else part for part in parts]
    chunks = [each.combine_chunks() if hasattr(each, "chunks") else each for each in chunks]
    if pa.types.is_dictionary(chunks[0].type):
        return pa.chunked_array(chunks).unify_dictionaries()
    return pa.chunked_array(chunks)


def _texts(cells: Cells) -> list[str]:
    """Return cells as text, whole numbers without decimal point, because they may be branches.

    >>> _texts(np.array([1.0, 0.1, np.nan]))
    ['1', '0.1', '']
    """
    if isinstance(cells, list):
        return cells
    values = cells.tolist() if isinstance(cells, np.ndarray) else cells.to_pylist()
    return [_text(value) for value in values]


def _text(value: Any) -> str:
    if isinstance(value, float):
        if value != value:
            return ""
        return f"{value:.0f}" if value.is_integer() and abs(value) < _EXACT else repr(value)
    return "" if value is None else str(value)


def _words_of(kind: Any) -> str:
    """Return the content of an Arrow type in words."""
    import pyarrow as pa

    words: tuple[tuple[Callable[[Any], bool], str], ...] = (
        (pa.types.is_boolean, "truth values (true, false)"),
        (pa.types.is_timestamp, "moments (dates with times)"),
        (pa.types.is_date, "dates"),
        (pa.types.is_time, "times of day"),
        (pa.types.is_duration, "durations"),
        (pa.types.is_nested, "lists or structures"),
    )
    return next((name for matches, name in words if matches(kind)), str(kind))


def numbers_of(column: Any) -> NDArray[Any]:
    """Return an Arrow column of numbers as a NumPy array, with NaN for missing values.

    `to_numpy` would import pandas if it is installed, which takes longer than reading 10⁶ rows.
    """
    import pyarrow as pa

    if isinstance(column, pa.ChunkedArray):
        column = column.combine_chunks()
    boolean = pa.types.is_boolean(column.type)
    plain = boolean or pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
    if column.null_count or len(column) == 0 or not plain:
        return np.asarray(column.to_numpy(zero_copy_only=False))
    if not boolean:
        return np.from_dlpack(column)
    bits = np.unpackbits(np.frombuffer(column.buffers()[1], np.uint8), bitorder="little")
    return bits[column.offset : column.offset + len(column)].astype(np.bool_)


_MOMENT = re.compile(r"\d{4}[-/.]\d\d?[-/.]\d\d?[T ]|\d\d?:\d\d:\d\d")


def strings_of(cells: Sequence[str]) -> Any:
    """Return texts as Arrow; `pyarrow.array` would import pandas."""
    import pyarrow as pa

    encoded = [cell.encode("utf-8", "replace") for cell in cells]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(
        len(encoded), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded))
    )


def _moments(cells: Cells) -> tuple[NDArray[Any], float] | None:
    """Return the ticks of moments and the tick in s, negative for durations; None for others."""
    if isinstance(cells, list):
        return _moments_of_texts(cells)
    if isinstance(cells, np.ndarray):
        return None
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = cells.type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        first = _moments_of_texts(_texts(cells[:1]))
        return first and _moments_of_texts(_texts(cells))
    moment = pa.types.is_timestamp(kind) or pa.types.is_time(kind)
    if cells.null_count or not (moment or pa.types.is_duration(kind)):
        return None
    per_s = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit]
    ticks = pc.cast(cells, pa.int32() if kind.bit_width == 32 else pa.int64())
    return numbers_of(ticks), per_s if moment else -per_s


def _moments_of_texts(cells: list[str]) -> tuple[NDArray[Any], float] | None:
    """Return texts such as 2024-07-11 15:51:51.25 as µs; None if one can't be parsed."""
    if not cells or not _MOMENT.match(cells[0].strip()):
        return None
    from datetime import UTC, datetime, timedelta

    epoch = datetime(2000, 1, 1, tzinfo=UTC)
    ticks = []
    for cell in cells:
        text = cell.strip().replace("/", "-")
        try:
            moment = datetime.fromisoformat(text if "-" in text else f"2000-01-01 {text}")
        except ValueError:
            return None
        zoned = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        ticks.append((zoned - epoch) // timedelta(microseconds=1))
    return np.array(ticks, dtype=np.int64), 1e-6


def what_number(text: str) -> tuple[str, str]:
    """Return the allowed value and the remedy for a text that isn't a number.

    >>> what_number("#REF!")[0]
    "a number: this is a spreadsheet's error"
    """
    if _SPREADSHEET_ERROR.match(text):
        return "a number: this is a spreadsheet's error", "correct its formula, or remove the line"
    if re.fullmatch(r"[+-]?[0-9][0-9.,'’ \u2009\u202f]*", text):
        return (
            "one decimal comma or point and no thousands separators",
            "save the file without thousands separators",
        )
    if re.fullmatch(r"[+-]?(inf|infinity)", text, re.IGNORECASE):
        return "a finite number", "remove the line or measure the point again"
    return "a number", "correct the cell; units belong into the header"
