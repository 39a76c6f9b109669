"""Text: CSV in common dialects, with separators, decimal marks, comments and line numbers.

A small file is read without any package; plain pieces of a large file are read by Arrow.
"""

from __future__ import annotations

import codecs
import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.formats import Format, OpenedTable, table_schema
from torquebench.tables.headers import known_name
from torquebench.tables.layout import HEAD_ROWS, find_layout
from torquebench.tables.table import Table

BLOCK_BYTES = 1 << 21
_SMALL_BYTES = 1 << 17
_LONGEST_LINE = 1 << 24
_FIRST_BYTES = 4096
_SEPARATORS = ("\t", ";", ",", "|", " ")
_SEPARATOR_NAMES = {
    ",": "comma",
    ";": "semicolon",
    "\t": "tab",
    "|": "vertical bar",
    " ": "blank",
}
_ENDS = ("eof", "end", "[eof]", "end of file", "end of data")
"""Last lines that some programs write after a table."""
_SEPARATOR_LINE = re.compile(r'"?sep=(.|\\t)?"?', re.IGNORECASE)
_COMMENT = re.compile(r"#\s*([A-Za-z_][A-Za-z0-9_]*)\s*[=:](.*)")
_SPREADSHEET_ERROR = re.compile(r'"?#(N/A|NV|[A-ZÄÖÜ0-9/]+[!?])')
_CONTROL = re.compile(rb"[\x00-\x08\x0b\x0e-\x1f\x7f]")
_HIGH_BYTES = re.compile(rb"[\x80-\xff]+")
_NOTHING = re.compile(rb"(?:[ \t\r]*+(?:#[ \t][^\n]*+)?+\n)*+[ \t\r]*+")
"""Lines without a cell."""
_NUMERIC = re.compile(r"[-+]?[0-9.,]+(?:[eE][-+]?[0-9]+)?")
_COMPRESSED = (b"\x1f\x8b", b"BZh91AY", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd", b"7z\xbc\xaf")
"""First bytes of gzip, bzip2, xz, Zstandard and 7-Zip."""
_MINUS = str.maketrans({"\N{MINUS SIGN}": "-", "\N{NO-BREAK SPACE}": " "})


def text_encoding(content: bytes, origin: str) -> str:
    """Return the encoding of a text file from its first bytes.

    UTF-8, or UTF-16 with a byte order mark or with the zero bytes of its digits; otherwise GB 18030
    if all non-ASCII bytes form Chinese characters, else Windows-1252 (an extended Latin-1).

    Raises
    ------
    InputError
        The content isn't text.

    Examples
    --------
    >>> [text_encoding(text.encode(code), "a table") for text, code in (
    ...     ("Prüfmoment [N·m]", "utf-8"), ("Prüfmoment [N·m]", "latin-1"), ("扭矩 [Nm]", "gbk")
    ... )]
    ['utf-8-sig', 'cp1252', 'gb18030']
    """
    if content.startswith(_COMPRESSED):
        raise InputError(
            Message("{origin} is compressed", origin), "a CSV file, best in UTF-8", "unpack it"
        )
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


def decode_text(content: bytes, origin: str) -> str:
    """Return the text of a file; see `text_encoding`.

    Raises
    ------
    InputError
        A line isn't text; the message names it.
    """
    encoding = text_encoding(content, origin)
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        raise _no_text(content, error, encoding, origin) from error


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


def remarks_in(text: str) -> Iterator[tuple[str, str]]:
    """Yield names, in lower case, and values in a table's comments."""
    for line in text.splitlines():
        match = _COMMENT.match(line.strip())
        if match:
            yield match[1].lower(), match[2].rstrip(",; \t").lstrip()


def is_comment(line: str) -> bool:
    """Return whether a line is a comment; a spreadsheet error such as ``#DIV/0!`` isn't."""
    line = line.lstrip()
    return line.startswith("#") and _SPREADSHEET_ERROR.match(line) is None


class TextFile:
    """A text file, read in pieces of complete lines.

    Parameters
    ----------
    origin : str
        Name of the file in messages.
    file : binary file
    size : int
        Size of the file, B; 0 if unknown.
    most : int, optional
        Largest number of bytes that are read.
    """

    def __init__(self, origin: str, file: IO[bytes], size: int, most: int | None = None) -> None:
        self.origin, self._file, self._size, self._most = origin, file, size, most
        self._read, self._ended, self._raw = 0, False, b""
        first = self._more()
        self._encoding = text_encoding(first, origin)
        self._decoder = codecs.getincrementaldecoder(self._encoding)()
        self._plain = self._encoding == "utf-8-sig"
        self._old_ends = b"\r" in first and b"\n" not in first
        self._rest = self._text(first, start=True)
        self._before = 0
        self._begin()

    def _more(self) -> bytes:
        wanted = (
            BLOCK_BYTES if self._most is None else min(BLOCK_BYTES, self._most + 1 - self._read)
        )
        content = bytearray()
        while len(content) < wanted:
            part = self._file.read(wanted - len(content))
            if not part:
                self._ended = True
                break
            content += part
        self._read += len(content)
        if self._most is not None and self._read > self._most:
            raise InputError(
                Message("{origin}: more than {size} MB", self.origin, self._most >> 20),
                Message("at most {size} MB of text", self._most >> 20),
                "take fewer rows, or state them in a binary format such as Parquet",
            )
        return bytes(content)

    def _text(self, raw: bytes, *, start: bool = False) -> bytes:
        """Return bytes of the file, converted to UTF-8 with line feeds."""
        if not self._plain:
            try:
                raw = self._decoder.decode(raw, final=self._ended).encode()
            except UnicodeDecodeError as error:
                raise _no_text(raw, error, self._encoding, self.origin) from error
        elif start:
            raw = raw.removeprefix(codecs.BOM_UTF8)
        return raw.replace(b"\r", b"\n") if self._old_ends else raw

    def _begin(self) -> None:
        """Find the header, and keep the lines after it as unread."""
        while not self._ended and not _end_of_lines(self._rest):
            self._lengthen()
        content = self._rest if self._ended else self._rest[: _end_of_lines(self._rest)]
        text = self._decoded(content, 0)
        lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        self.remarks = dict(remarks_in(text))
        head: list[tuple[int, str]] = []
        comment = ""
        for number, line in enumerate(lines, 1):
            if not line.strip() or is_comment(line):
                comment = line if is_comment(line) and not head else comment
                continue
            if not head and _SEPARATOR_LINE.fullmatch(line.strip()):
                lines[number - 1] = ""  # a line that spreadsheets write and remove themselves
                continue
            head.append((number, line))
            if len(head) == HEAD_ROWS:
                break
        self.separator = _separator([line for _, line in head])
        last = head[-1][0] if head else 0
        shown = _uncommented("\n".join(lines[:last]))
        cut = "".join(shown).count('"') % 2 == 1 and last < len(lines)
        records = list(_records(shown, self.separator, self.origin, 0, forgiving=cut))
        if cut and not records:  # one cell spans all these lines
            records = list(_records(shown, self.separator, self.origin, 0))
        if not records:
            raise InputError(
                Message("{origin} is empty", self.origin),
                "a header line and at least one line of values",
            )
        commented = _split(comment.lstrip("# ").strip(), self.separator) if comment else []
        layout = find_layout(
            [cells for cells, *_ in records],
            [number for _, number, _ in records],
            counted="line",
            known=known_name,
            commented=commented if len(commented) > 1 else (),
        )
        self._layout = layout
        begins = records[layout.first - 1][2] + 1 if layout.first else records[0][1]
        lead = "\n".join(lines[: begins - 1])
        skipped = len((lead + "\n").encode()) if begins > 1 else 0
        self._before = begins - 1
        self._rest = ("\n".join(lines).encode() + self._rest[len(content) :])[skipped:]
        self.names, self.notes = layout.names, layout.notes
        self.shared: dict[str, Any] = {}

    def _decoded(self, content: bytes, before: int) -> str:
        if b"\0" in content:
            line = before + content[: content.index(b"\0")].count(b"\n") + 1
            raise InputError(
                Message("{origin}, line {line}: a NUL character", self.origin, line),
                "a CSV file, not a binary one",
            )
        try:
            return content.decode()
        except UnicodeDecodeError as error:
            line = before + content[: error.start].count(b"\n") + 1
            raise InputError(
                Message(
                    "{origin}, line {line}: byte {byte:#04x} isn't {encoding} text",
                    self.origin,
                    line,
                    content[error.start],
                    "UTF-8",
                ),
                "one encoding throughout the file",
                "save it as CSV UTF-8",
            ) from error

    def _lengthen(self) -> None:
        """Read more of the file; refuse a line that doesn't end."""
        if len(self._rest) > _LONGEST_LINE:
            raise InputError(
                Message(
                    "{origin}: a line of more than {size} MB", self.origin, _LONGEST_LINE >> 20
                ),
                "lines of a table",
            )
        self._rest += self._text(self._more())

    @property
    def empty(self) -> Table:
        """The table without its rows."""
        return Table(
            self.origin,
            self.names,
            tuple([] for _ in self.names),
            range(0),
            "line",
            self.remarks,
            self.notes,
            self.separator,
            shared=self.shared,
        )

    def raw(self) -> Iterator[tuple[tuple[bytes, int], float]]:
        """Yield complete lines, the number of lines before them, and the share read."""
        before = self._before
        while True:
            end = len(self._rest) if self._ended else _end_of_lines(self._rest)
            piece, self._rest = self._rest[:end], self._rest[end:]
            if piece:
                share = self._read / self._size if self._size else 0.0
                yield (piece, before), min(share, 1.0)
                before += piece.count(b"\n")
            if self._ended:
                return
            self._lengthen()

    def piece(self, raw: tuple[bytes, int]) -> Table | None:
        """Return the rows of a piece, None if it has none. Any thread may call it."""
        content, before = raw
        if _NOTHING.fullmatch(content):
            return None
        table = self._by_arrow(content, before) if len(content) > _SMALL_BYTES else None
        table = table or self._by_lines(content, before)
        return table and replace(table, quoted=b'"' in content)

    def whole(self) -> Table:
        """Return the whole table.

        Raises
        ------
        InputError
            The file has no rows, or a row that doesn't fit the table.
        """
        pieces = [table for raw, _ in self.raw() if (table := self.piece(raw)) is not None]
        if not pieces:
            raise InputError(
                Message("{origin} holds a header but no values", self.origin),
                "at least one line of values",
            )
        return Table.joined(pieces)

    def _by_arrow(self, content: bytes, before: int) -> Table | None:
        """Read a plain piece by Arrow; return None if it isn't plain."""
        layout = self._layout
        if content.startswith(b"#") or b"\n#" in content or b"\0" in content:
            return None
        if (
            layout.ticks is not None
            or self.separator == " "
            or layout.columns[-1] + 1 != len(layout.columns)
            or layout.partial
        ):
            return None
        import pyarrow as pa
        import pyarrow.csv

        numbers = [str(index) for index in range(len(self.names))]
        try:
            cells = pyarrow.csv.read_csv(
                pa.BufferReader(content),
                pyarrow.csv.ReadOptions(
                    use_threads=False, column_names=numbers, block_size=max(len(content), 1)
                ),
                pyarrow.csv.ParseOptions(
                    delimiter=self.separator,
                    ignore_empty_lines=False,
                    newlines_in_values=b'"' in content,
                ),
                pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(numbers, pa.string())),
            )
        except pa.ArrowInvalid:
            return None
        if content.rstrip(b"\r\n").count(b"\n") + 1 != cells.num_rows:  # lines aren't rows
            return None
        rows = range(before + 1, before + 1 + cells.num_rows)
        return replace(self.empty, cells=tuple(cells.columns), rows=rows)

    def _by_lines(self, content: bytes, before: int) -> Table | None:
        """Read a piece line by line."""
        lines = _uncommented(self._decoded(content, before))
        width, layout = len(self.names), self._layout
        whole = width == layout.columns[-1] + 1 and not layout.partial
        rows, numbers = [], []
        for cells, number, _ in _records(lines, self.separator, self.origin, before):
            fitting: list[str] | None = [
                cells[index] if index < len(cells) else "" for index in layout.columns
            ]
            if layout.partial and not any(fitting or ()):
                continue  # only a channel that was sampled at other times continues
            if whole or cells[0].lower() in _ENDS:
                fitting = self._fitting(cells, number)
            if fitting is not None:
                rows.append(fitting)
                numbers.append(number)
        if not rows:
            return None
        columns: list[Any] = [list(column) for column in zip(*rows, strict=True)]
        table = replace(self.empty, cells=tuple(columns), rows=numbers)
        if layout.ticks is not None:
            columns[layout.ticks] = self._seconds(columns[layout.ticks], table)
            table = replace(table, cells=tuple(columns))
        return table

    def _fitting(self, cells: list[str], number: int) -> list[str] | None:
        """Return a row's cells, as many as the header has; None for a line that ends the table."""
        n = len(self.names)
        if n > 1 and not any(cells[1:]) and cells[0].lower() in _ENDS:
            return None
        if len(cells) < n or any(cells[n:]):
            remedy = "complete the line, or remove it"
            if self.separator == "," and len(cells) > n:
                remedy = (
                    "with decimal commas, separate the columns by semicolons or tabs, "
                    "or write decimal points"
                )
            raise InputError(
                Message(
                    "{place}: {count} values in a table of {n} columns separated by "
                    "{separator_names}",
                    f"{self.origin}, line {number}",
                    len(cells),
                    n,
                    _SEPARATOR_NAMES[self.separator],
                ),
                Message("{n} values in each line", n),
                remedy,
            )
        return cells[:n]

    def _seconds(self, cells: list[str], table: Table) -> NDArray[np.float64]:
        """Convert ticks of 100 ns to seconds since the first."""
        try:
            ticks = [int(cell) for cell in cells]
        except ValueError:
            return table.numbers(0)  # raises an error with the cell's place
        start = self.shared.setdefault("first tick", ticks[0])
        return np.array([(tick - start) * 1e-7 for tick in ticks])


def _end_of_lines(content: bytes) -> int:
    """Return the end of the last complete line outside of quotation marks."""
    end = content.rfind(b"\n") + 1
    while end and content.count(b'"', 0, end) % 2:
        end = content.rfind(b"\n", 0, end - 1) + 1
    return end


def _uncommented(text: str) -> list[str]:
    """Return the lines with blanked comments, which preserves the file's line numbers."""
    return [
        "" if line.startswith("#") and is_comment(line) else line
        for line in text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    ]


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error:
        return []


def _separator(lines: Sequence[str]) -> str:
    """Return the separator that gives most lines the same number of cells, mostly numbers."""
    best, most = ",", 0.0
    for separator in _SEPARATORS:
        if not any(separator in line for line in lines):
            continue
        rows = [_split(line, separator) for line in lines if separator != " " or "\t" not in line]
        widths = [len(row) for row in rows if len(row) > 1]
        if not widths:
            continue
        width = max(set(widths), key=lambda each: (widths.count(each), each))
        fitting = [row for row in rows if len(row) == width]
        numbers = sum(_NUMERIC.fullmatch(c.strip()) is not None for row in fitting for c in row)
        score = len(fitting) + numbers / width
        if separator == " " and 2 * numbers < width * len(fitting):
            continue  # words contain blanks, too
        if score > most:
            best, most = separator, score
    return best


def _records(
    lines: list[str], separator: str, origin: str, before: int, *, forgiving: bool = False
) -> Iterator[tuple[list[str], int, int]]:
    """Yield rows that aren't empty, with the numbers of their first and last lines."""
    if separator == " ":
        for number, line in enumerate(lines, before + 1):
            if cells := line.translate(_MINUS).split():
                yield cells, number, number
        return
    reader = csv.reader((line + "\n" for line in lines), delimiter=separator, strict=True)
    number = 1
    try:
        for row in reader:
            cells = [cell.translate(_MINUS).strip() for cell in row]
            if any(cells):
                yield cells, before + number, before + reader.line_num
            number = reader.line_num + 1
    except csv.Error as error:
        if forgiving:
            return
        raise InputError(
            Message("{origin}, line {before}: {error}", origin, before + number, error),
            Message(
                "cells of at most {most} characters, with matching quotation marks",
                csv.field_size_limit(),
            ),
        ) from error


# -- in the reader's process ----------------------------------------------------------------


def _open(path: Path, _: str, opened: ExitStack) -> OpenedTable:
    import pyarrow as pa

    size = path.stat().st_size
    table = TextFile(str(path), opened.enter_context(path.open("rb")), size).whole()
    arrays = [
        pa.array(cells, None if isinstance(cells, np.ndarray) else pa.string())
        if isinstance(cells, list | np.ndarray)
        else cells
        for cells in table.cells
    ]
    columns = [(name, "", each.type) for name, each in zip(table.names, arrays, strict=True)]
    schema = table_schema(columns, table.remarks, numbered=True)
    whole = pa.table([*arrays, pa.array(np.asarray(table.rows, np.int64))], schema=schema)
    return OpenedTable(
        schema,
        whole.to_batches,
        len(table),
        notes=table.notes,
        numbered=True,
        counted="line",
        separator=table.separator,
    )


# -- writing --------------------------------------------------------------------------------


class _Writer:
    """Writer of CSV, with separator and decimal mark of the source if that is text, too."""

    def __init__(
        self,
        file: IO[bytes],
        schema: Any,
        remarks: Mapping[str, str],
        *,
        separator: str = ",",
        decimal: str = ".",
    ) -> None:
        self._file, self._separator, self._decimal = file, separator, decimal
        comments = [f"# {key} = {value}\n" for key, value in remarks.items()]
        header = separator.join(map(self._quoted, schema.names))
        file.write(("".join(comments) + header + "\n").encode())

    def _quoted(self, name: str) -> str:
        quoted = any(mark in name for mark in (self._separator, '"', "\n"))
        return '"' + name.replace('"', '""') + '"' if quoted else name

    def encoded(self, batch: Any, *, quoted: bool = True) -> Any:
        """Return a batch as lines of text; any thread may call it.

        With `quoted` False, no cell needs quotation marks.
        """
        import pyarrow as pa
        import pyarrow.compute as pc
        import pyarrow.csv

        columns, plain = [], True
        for column in batch.columns:
            kind = column.type
            if pa.types.is_nested(kind) or pa.types.is_dictionary(kind):
                column = pa.array(
                    [None if v is None else str(v) for v in column.to_pylist()], pa.string()
                )
            elif self._decimal == "," and pa.types.is_floating(kind):
                column = pc.replace_substring(pc.cast(column, pa.string()), ".", ",")
            if quoted and (
                pa.types.is_string(column.type) or pa.types.is_large_string(column.type)
            ):
                marks = f'[{re.escape(self._separator)}"\r\n]'
                plain = plain and not pc.any(pc.match_substring_regex(column, marks)).as_py()
            columns.append(column)
        if not plain:
            return self._joined(columns)
        lines = pa.BufferOutputStream()
        options = pyarrow.csv.WriteOptions(
            include_header=False, delimiter=self._separator, quoting_style="none"
        )
        names = [str(index) for index in range(len(columns))]
        pyarrow.csv.write_csv(pa.table(columns, names=names), lines, options)
        return lines.getvalue()

    def _joined(self, columns: Sequence[Any]) -> bytes:
        """Return lines of text, with quotation marks for cells that need them."""
        import pyarrow as pa
        import pyarrow.compute as pc

        marks = f'[{re.escape(self._separator)}"\r\n]'
        cells = []
        for column in columns:
            text = pc.fill_null(pc.cast(column, pa.string()), "")
            quoted = pc.binary_join_element_wise(
                '"', pc.replace_substring(text, '"', '""'), '"', ""
            )
            cells.append(pc.if_else(pc.match_substring_regex(text, marks), quoted, text))
        lines = pc.binary_join_element_wise(*cells, self._separator)
        return ("\n".join(lines.to_pylist()) + "\n").encode()

    def write(self, batch: Any) -> None:
        """Append a batch, or the result of `encoded` for it."""
        self._file.write(self.encoded(batch) if hasattr(batch, "columns") else batch)

    def close(self) -> None:
        """Do nothing: all data are written."""


FORMAT = Format(
    name="csv",
    title="CSV (.csv, .txt, .tsv)",
    endings=(".csv", ".txt", ".tsv", ".dat", ".asc", ".log"),
    open=_open,
    writer=_Writer,
    order=0,
)
