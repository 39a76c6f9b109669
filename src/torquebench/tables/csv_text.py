"""CSV in common dialects: separators, decimal marks, comments; with line numbers."""

import codecs
import csv
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = [
    "COMMENT",
    "CsvTable",
    "csv_encoding",
    "decode_csv",
    "is_comment",
    "parse_csv",
    "read_csv",
    "remarks_in",
    "what_number",
]

_NUMBER = re.compile(r"[+-]?([0-9]+([.,][0-9]*)?|[.,][0-9]+)([eE][+-]?[0-9]+)?", re.ASCII)
_SEPARATOR_LINE = re.compile(r'"?sep=(.|\\t)?"?', re.IGNORECASE)
_WHOLE = re.compile(r"[+-]?[0-9]+", re.ASCII)
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2}[.,][0-9]{3}", re.ASCII)
_MINUS = str.maketrans({"\N{MINUS SIGN}": "-", "\N{NO-BREAK SPACE}": " "})
_SPREADSHEET_ERROR = re.compile(r'"?#(N/A|NV|[A-ZÄÖÜ0-9/]+[!?])')
"""Error values of spreadsheet cells, in several languages."""
COMMENT = re.compile(r"#\s*([A-Za-z_][A-Za-z0-9_]*)\s*[=:](.*)")
_CONTROL = re.compile(rb"[\x00-\x08\x0b\x0e-\x1f\x7f]")
_HIGH_BYTES = re.compile(rb"[\x80-\xff]+")
_FIRST_BYTES = 4096
_SEPARATOR_NAMES = {",": "comma", ";": "semicolon", "\t": "tab"}


@dataclass(frozen=True, eq=False)
class CsvTable:
    r"""A CSV file as text: its cells and their positions.

    Parameters
    ----------
    origin : str
        Name of the file, for messages.
    separator : str
        ``","``, ``";"`` or a tab.
    header : tuple of str
        Names of the columns, in lower case.
    rows : tuple of tuple of str
        Cells, as many in each row as the header has.
    lines : sequence of int
        Number of the line that each row ends on, from 1.
    remarks : mapping of str to str
        Values of comment lines of the form ``# key = value``.
    counted : str
        Unit of `lines`.
    names : tuple of str
        Names of the columns as the file writes them.

    Examples
    --------
    >>> table = parse_csv("# side = output\nreading_nm;standard_nm\n1,5;1,6\n", "a.csv")
    >>> table.header, table.numbers("reading_nm").tolist(), table.remarks
    (('reading_nm', 'standard_nm'), [1.5], {'side': 'output'})
    """

    origin: str
    separator: str
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    lines: Sequence[int]
    remarks: dict[str, str]
    counted: str = "line"
    names: tuple[str, ...] = ()

    def written(self, column: str) -> str:
        """Return a column's name as the file writes it."""
        return dict(zip(self.header, self.names, strict=False)).get(column, column)

    def place(self, row: int, column: str) -> str:
        """Return the position of a cell, in words, for messages."""
        return Message(
            "{origin}, {counted} {lines}, column {column}",
            self.origin,
            self.counted,
            self.lines[row],
            column,
        )

    def texts(self, column: str) -> list[str]:
        """Return the cells of a column as text."""
        index = self.header.index(column)
        return [row[index] for row in self.rows]

    def numbers(self, column: str) -> NDArray[np.float64]:
        """Return the cells of a column as finite numbers, shape (n,).

        Raises
        ------
        InputError
            Naming the first cell that is empty, isn't a number, or mixes decimal marks with
            those of another cell.
        """
        values = np.empty(len(self.rows), dtype=np.float64)
        for row, text in enumerate(self.texts(column)):
            values[row] = self._number(row, column, text)
        return values

    def _number(self, row: int, column: str, text: str) -> float:
        if not text or text.lower() in ("nan", "n/a", "na", "-"):
            raise InputError(
                Message(
                    "{place}: {text}",
                    self.place(row, column),
                    f"{text!r}" if text else "an empty cell",
                ),
                "a number in every cell",
                "remove the line or measure the point again",
            )
        if not _NUMBER.fullmatch(text):
            raise InputError(
                Message("{place}: {text!r}", self.place(row, column), text), *what_number(text)
            )
        value = float(text.replace(",", "."))
        if not np.isfinite(value):
            raise InputError(
                Message("{place}: {text!r}", self.place(row, column), text), "a finite number"
            )
        return value

    def check_decimal_marks(self, columns: list[str]) -> None:
        """Check that all numbers of these columns have the same decimal mark.

        Raises
        ------
        InputError
            Naming the first cell whose mark differs from that of an earlier cell, or whose mark
            must separate thousands.
        """
        for column in columns:
            self._check_thousands(column)
        first: dict[str, str] = {}
        for row in range(len(self.rows)):
            for column in columns:
                text = self.rows[row][self.header.index(column)]
                if not _NUMBER.fullmatch(text):
                    continue
                for mark in (mark for mark in ",." if mark in text):
                    first.setdefault(mark, f"{text!r} in {self.place(row, column)}")
                    if len(first) == 2:
                        other = "." if mark == "," else ","
                        raise InputError(
                            Message(
                                "decimal commas and points mixed: {first}, but {other}",
                                first[mark],
                                first[other],
                            ),
                            "one decimal mark throughout the file",
                            "save the file again with one number format",
                        )

    def _check_thousands(self, column: str) -> None:
        """Refuse 1,200 after 980: a mark before three digits, where larger numbers have none."""
        texts = self.texts(column)
        marked = [row for row, text in enumerate(texts) if set(text) & {",", "."}]
        whole = [abs(int(text)) for text in texts if _WHOLE.fullmatch(text)]
        if not marked or not whole or not all(_THOUSANDS.fullmatch(texts[row]) for row in marked):
            return
        largest = max(abs(float(texts[row].replace(",", "."))) for row in marked)
        if 100 <= max(whole) < 1000 and 5.0 * largest < max(whole):
            raise InputError(
                Message(
                    "{place}: {texts!r} beside {whole}",
                    self.place(marked[0], column),
                    texts[marked[0]],
                    max(whole),
                ),
                "numbers without thousands separators",
                "save the file without them, or with as many decimals in every cell",
            )


def read_csv(path: Path) -> CsvTable:
    """Return the table in a CSV file; ``-`` is standard input.

    Raises
    ------
    InputError
        Where the file can't be read or isn't a table.
    """
    origin = "standard input" if str(path) == "-" else str(path)
    try:
        content = sys.stdin.buffer.read() if str(path) == "-" else path.read_bytes()
    except OSError as error:
        raise InputError(
            Message("can't read {source}: {error}", path, error.strerror),
            "a CSV file that exists and may be read",
        ) from error
    return parse_csv(decode_csv(content, origin), origin)


def decode_csv(content: bytes, origin: str) -> str:
    """Return the text of a CSV file; see `csv_encoding`.

    Raises
    ------
    InputError
        Naming the line that isn't text.
    """
    encoding = csv_encoding(content, origin)
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        raise _no_text(content, error, encoding, origin) from error


def csv_encoding(content: bytes, origin: str) -> str:
    """Return the encoding of the beginning of a CSV file.

    UTF-8, or UTF-16 with a byte order mark or with the zero bytes of its digits; otherwise GB 18030
    if all non-ASCII bytes form Chinese characters, and Windows-1252 (Latin-1 and more) if not.

    Raises
    ------
    InputError
        Where it isn't text.

    Examples
    --------
    >>> [csv_encoding(text.encode(code), "a table") for text, code in (
    ...     ("Prüfmoment [N·m]", "utf-8"), ("Prüfmoment [N·m]", "latin-1"), ("扭矩 [Nm]", "gbk")
    ... )]
    ['utf-8-sig', 'cp1252', 'gb18030']
    """
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    head = content[:_FIRST_BYTES]
    zeros = head.count(0)
    for encoding, half in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
        if half.count(0) == zeros and 4 * zeros > len(half):
            return encoding
    try:
        codecs.getincrementaldecoder("utf-8-sig")().decode(content)
        return "utf-8-sig"
    except UnicodeDecodeError as error:
        if _CONTROL.search(content):
            raise _no_text(content, error, "utf-8", origin) from error
    runs = _HIGH_BYTES.findall(content)
    try:
        if all(len(run) % 2 == 0 for run in runs[:-1]):
            b" ".join(runs[:-1] or runs).decode("gb2312")
            return "gb18030"
    except UnicodeDecodeError:
        pass
    return "cp1252"


def _no_text(content: bytes, error: UnicodeDecodeError, encoding: str, origin: str) -> InputError:
    line = content[: error.start].count(b"\n") + 1
    return InputError(
        Message(
            "{origin}, line {line}: byte {byte:#04x} isn't {encoding} text",
            origin,
            line,
            content[error.start],
            encoding.upper(),
        ),
        "a CSV file, best in UTF-8",
        "save it as CSV UTF-8",
    )


def parse_csv(text: str, origin: str, *, before: int = 0) -> CsvTable:
    """Return the table in a CSV text.

    The separator (comma, semicolon or tab) is that of the header line. Lines that begin with ``#``
    are comments, unless it is a spreadsheet's error such as ``#DIV/0!``; blank lines are skipped.

    Parameters
    ----------
    text : str
        Content of the file.
    origin : str
        Name of the file, for messages.
    before : int, default 0
        Number of lines of the file before the text, for messages.

    Raises
    ------
    InputError
        Where the text is empty, has no header or no row, names a column twice, or has a row with
        another number of cells than the header.
    """
    if "\0" in text:
        line = text[: text.index("\0")].count("\n") + 1
        raise InputError(
            Message("{origin}, line {line}: a NUL character", origin, line),
            "a CSV file, not a binary one",
        )
    text = text.removeprefix("\N{ZERO WIDTH NO-BREAK SPACE}")
    remarks = dict(remarks_in(text))
    content = _uncommented(text)
    first = next((n for n, line in enumerate(content) if line.strip()), None)
    if first is not None and _SEPARATOR_LINE.fullmatch(content[first].strip()):
        content[first] = ""  # written and removed by spreadsheets themselves
    head = next((line for line in content if line.strip()), None)
    if head is None:
        raise InputError(
            Message("{origin} is empty", origin), "a header line and at least one line of values"
        )
    separator = next((mark for mark in "\t;" if mark in head), ",")
    records = _records(content, separator, origin, before)
    _, names = records[0]
    header, width = _header(names, origin)
    if len(records) == 1:
        raise InputError(
            Message("{origin} holds a header but no values", origin), "at least one line of values"
        )
    rows = [
        _row(cells, header, width, separator, f"{origin}, line {n}") for n, cells in records[1:]
    ]
    return CsvTable(
        origin=origin,
        separator=separator,
        header=header,
        rows=tuple(rows),
        lines=tuple(number for number, _ in records[1:]),
        remarks=remarks,
        names=tuple(names[: len(header)]),
    )


def remarks_in(text: str) -> Iterator[tuple[str, str]]:
    """Yield names, in lower case, and values of a table's comments."""
    for line in text.splitlines():
        match = COMMENT.match(line.strip())
        if match:
            yield match[1].lower(), match[2].rstrip(",; \t").lstrip()


def is_comment(line: str) -> bool:
    """Return whether a line is a comment; a spreadsheet's error such as ``#DIV/0!`` isn't."""
    line = line.lstrip()
    return line.startswith("#") and _SPREADSHEET_ERROR.match(line) is None


def _uncommented(text: str) -> list[str]:
    """Return the lines with comments blanked, which keeps the file's line numbers."""
    return [
        "" if is_comment(line) else line
        for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    ]


def _records(
    lines: list[str], separator: str, origin: str, before: int
) -> list[tuple[int, list[str]]]:
    reader = csv.reader((line + "\n" for line in lines), delimiter=separator, strict=True)
    records: list[tuple[int, list[str]]] = []
    try:
        for cells in reader:
            cleaned = [cell.translate(_MINUS).strip() for cell in cells]
            if any(cleaned):
                records.append((before + reader.line_num, cleaned))
    except csv.Error as error:
        raise InputError(
            Message("{origin}, line {before}: {error}", origin, before + reader.line_num, error),
            "cells with matching quotation marks",
        ) from error
    if not records:
        raise InputError(
            Message("{origin} is empty", origin), "a header line and at least one line of values"
        )
    return records


def _header(names: list[str], origin: str) -> tuple[tuple[str, ...], int]:
    """Return the columns' names and the largest number of cells of a row (unnamed at the end)."""
    header = [name.lower() for name in names]
    while header and not header[-1]:
        header.pop()
    seen: set[str] = set()
    for index, name in enumerate(header):
        if not name:
            raise InputError(
                Message("{origin}: column {number} has no name", origin, index + 1),
                "a name for each column",
            )
        if name in seen:
            raise InputError(
                Message("{origin}: two columns are called {name}", origin, name),
                "each name once",
                "rename one of them",
            )
        seen.add(name)
    return tuple(header), len(names)


def _row(
    cells: list[str], header: tuple[str, ...], width: int, separator: str, place: str
) -> tuple[str, ...]:
    n = len(header)
    if len(cells) < n or any(cells[n:]) or len(cells) > max(width, n):
        remedy = "complete the line, or remove it"
        if separator == "," and len(cells) > n:
            remedy = (
                "with decimal commas, separate the columns by semicolons or tabs, "
                "or write decimal points"
            )
        raise InputError(
            Message(
                "{place}: {count} values in a table of {n} columns separated by {separator_names}",
                place,
                len(cells),
                n,
                _SEPARATOR_NAMES[separator],
            ),
            Message("{n} values in each line", n),
            remedy,
        )
    return tuple(cells[:n])


def what_number(text: str) -> tuple[str, str]:
    """Return what is allowed in the place of a text that isn't a number, and what to do.

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
