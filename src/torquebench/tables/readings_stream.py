"""Compensation of readings of any length, block by block: little memory, two cores, progress."""

from __future__ import annotations

import codecs
import sys
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any, NamedTuple, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq
from numpy.typing import NDArray

from torquebench.atomic_write import atomic_file
from torquebench.columns import column_of
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, SHARES, Progress
from torquebench.tables.arrow_table import ArrowReadings, numbers_of
from torquebench.tables.columns import understood, word_values
from torquebench.tables.csv_text import csv_encoding, is_comment, parse_csv
from torquebench.tables.files import ArrowFile, open_table
from torquebench.tables.formats import check_read, check_written, is_csv, is_parquet
from torquebench.tables.readings import (
    ADDED_COLUMNS,
    READING_COLUMNS,
    ReadingsTable,
    readings_of,
)

__all__ = ["CompensatedFile", "compensate_file"]

Compensate = Callable[[ReadingsTable], tuple[NDArray[np.float64], ...]]
"""Function from readings to torque, additional torque and expanded uncertainty, all in N·m."""

Follow = Callable[[ReadingsTable, ReadingsTable | None], tuple[NDArray[np.float64], ...]]
"""The same for successive blocks, each with the block that follows it."""

_BLOCK_BYTES = 1 << 21
_BLOCK_ROWS = 1 << 16
_GROUP_ROWS = 1 << 18  # rows of a row group: while one is written, the threads compute the next
_LOOKED_AT_ROWS = 10_000
_HEAD_LINES = 6
_WORKERS = 2
_WAITING = 1


@dataclass(frozen=True)
class CompensatedFile:
    """Result of `compensate_file`.

    Parameters
    ----------
    rows : int
    simulated : bool
        Whether the readings' file states that they are simulated.
    lowest_nm, highest_nm : float
        Additional torque.
    largest_uncertainty_nm : float
        Largest expanded uncertainty.
    """

    rows: int
    simulated: bool
    lowest_nm: float
    highest_nm: float
    largest_uncertainty_nm: float


class _Block(NamedTuple):
    cells: Any  # pyarrow.Table
    readings: ReadingsTable
    plain: bool = False  # no cell needs quotation marks


_Encoded = tuple[Any, tuple[int, float, float, float]]
"""Target's cells; rows, extremes of the additional torque and largest U."""


class _Source(Protocol):
    """A file of readings: `pieces` in file order, each converted to a block independently."""

    header: tuple[str, ...]
    names: tuple[str, ...]  # as written
    remarks: dict[str, str]
    simulated: bool
    timed: bool

    def pieces(self) -> Iterator[tuple[Any, float]]:
        """Yield pieces and the share of the file that is read with each."""

    def block(self, piece: Any) -> _Block | None:
        """Return the block of a piece, None where it holds no row; any thread may call it."""


def compensate_file(
    source: Path,
    target: Path,
    compensate: Compensate,
    *,
    timed: Follow | None = None,
    mapping: Sequence[str] = (),
    progress: Progress = NO_PROGRESS,
) -> CompensatedFile:
    """Compensate a file of readings into another, whole or not at all.

    All columns of the source come first, as they are, then `ADDED_COLUMNS`. CSV keeps separator
    and decimal mark.

    Parameters
    ----------
    source : pathlib.Path
        CSV, Parquet, Excel, TDMS, MDF4 or HDF5; ``-`` is CSV from standard input.
    target : pathlib.Path
        CSV or Parquet by its ending; see `atomic_write` for links, pipes and ``-``.
    compensate : callable
        Called for one block after the other and from two threads.
    timed : callable, optional
        Called instead where the file has ``time_s``, for blocks in the order of time.
    mapping : sequence of str
        ``name=Header[unit]`` of columns that have other names; see `columns.understood`.
    progress : Progress, optional
        Told one stage of `SHARES` steps.

    Raises
    ------
    InputError
        Naming file, line and column of what can't be used.
    """
    check_read(source)
    check_written(target)
    with ExitStack() as opened:
        readings = _open(source, opened, mapping)
        for name in ADDED_COLUMNS:
            if name in readings.header:
                raise InputError(
                    Message("{origin} has a column {name} already", source, name),
                    "readings without it",
                    "rename or remove it",
                )
        kind = _ParquetSink if is_parquet(target) else _CsvSink
        sink = kind(opened.enter_context(atomic_file(target)), readings)
        found: list[tuple[int, float, float, float]] = []
        progress.start(Message("Compensating {source}", source), SHARES)

        def encoded(block: _Block, added: tuple[NDArray[np.float64], ...]) -> _Encoded:
            _, additional, expanded = added
            extremes = (float(np.min(additional)), float(np.max(additional)))
            figures = (additional.size, *extremes, float(np.max(expanded)))
            return sink.encoded(block, added), figures

        def work(piece: Any) -> _Encoded | None:
            block = readings.block(piece)
            return None if block is None else encoded(block, compensate(block.readings))

        done: Iterator[tuple[_Encoded | None, float]] = _in_order(work, readings.pieces())
        if timed is not None and readings.timed:
            blocks = _in_order(readings.block, readings.pieces())
            done = _followed(blocks, timed, encoded)
        for result, share in done:
            if result is not None:
                sink.write(result[0])
                found.append(result[1])
            progress.reach(int(SHARES * share))
        if not found:
            raise InputError(
                Message("{origin} holds a header but no values", source), "at least one reading"
            )
        sink.close()
    rows, lowest, highest, largest = zip(*found, strict=True)
    return CompensatedFile(sum(rows), readings.simulated, min(lowest), max(highest), max(largest))


def _followed(
    blocks: Iterable[tuple[_Block | None, float]],
    follow: Follow,
    encoded: Callable[[_Block, tuple[NDArray[np.float64], ...]], _Encoded],
) -> Iterator[tuple[_Encoded, float]]:
    """Compensate blocks in order, each when the next one is known."""
    waiting: _Block | None = None
    reached = 0.0
    for block, share in blocks:
        if block is None:
            continue
        if waiting is not None:
            yield encoded(waiting, follow(waiting.readings, block.readings)), reached
        waiting, reached = block, share
    if waiting is not None:
        yield encoded(waiting, follow(waiting.readings, None)), 1.0


def _in_order(
    work: Callable[[Any], Any], pieces: Iterable[tuple[Any, float]]
) -> Iterator[tuple[Any, float]]:
    """Process pieces in two threads; yield results in the order of the pieces."""
    waiting: deque[tuple[Future[Any], float]] = deque()
    iterator = iter(pieces)
    for piece, share in iterator:  # the first one alone, as it compiles the kernels
        yield work(piece), share
        break
    with ThreadPoolExecutor(_WORKERS) as threads:
        try:
            for piece, share in iterator:
                waiting.append((threads.submit(work, piece), share))
                if len(waiting) > _WORKERS + _WAITING:
                    future, reached = waiting.popleft()
                    yield future.result(), reached
            while waiting:
                future, reached = waiting.popleft()
                yield future.result(), reached
        finally:
            for future, _ in waiting:
                future.cancel()


def _open(path: Path, opened: ExitStack, mapping: Sequence[str]) -> _Source:
    try:
        if not is_csv(path):
            return _ArrowSource(open_table(path, opened), mapping)
        if str(path) == "-":
            return _CsvSource("standard input", sys.stdin.buffer, 0, mapping)
        return _CsvSource(
            str(path), opened.enter_context(path.open("rb")), path.stat().st_size, mapping
        )
    except (OSError, pa.ArrowInvalid) as error:
        raise InputError(
            Message(
                "can't read {source}: {error}", path, getattr(error, "strerror", None) or error
            ),
            "a file of readings that exists and may be read",
        ) from error


class _CsvSource:
    """A CSV file in pieces of whole lines.

    Arrow reads a piece without special cases; anything else (comments, unusual numbers, errors)
    goes through the reader of small tables, which states line and column.
    """

    def __init__(self, origin: str, file: IO[bytes], size: int, mapping: Sequence[str]) -> None:
        self.origin, self._file, self._size = origin, file, size
        self._rest = file.read(_BLOCK_BYTES)
        self._read = len(self._rest)
        self._encoding = csv_encoding(self._rest, origin)
        self._decoder = codecs.getincrementaldecoder(self._encoding)()
        self._plain = self._encoding in ("utf-8", "utf-8-sig")
        self._rest = self._text(self._rest, final=False)
        more = self._read == _BLOCK_BYTES
        head, self._before = _head(self._rest[: _end_of_lines(self._rest)] if more else self._rest)
        self._head_text = head.decode("utf-8", "replace")
        self._table = parse_csv(self._head_text, origin)
        self._header_line, self._rest = _after_header(self._rest, self._before)
        self.header, self.names = self._table.header, self._table.names
        self.remarks = self._table.remarks
        self._mapping = mapping
        named, self._columns = understood(self._table, ("reading_nm",), mapping)
        self.timed = "time_s" in self._columns
        self._names = named.header  # with labels by their own names
        self._comma = self._table.separator != "," and any(
            "," in cell for cell in self._table.texts(self._columns["reading_nm"][0])
        )
        self.simulated = readings_of(self._table, mapping).simulated

    @property
    def separator(self) -> str:
        return self._table.separator

    @property
    def decimal_comma(self) -> bool:
        return self._comma

    def _text(self, raw: bytes, *, final: bool) -> bytes:
        """Return bytes of the file in UTF-8 with line feeds."""
        if not self._plain:
            raw = self._decoder.decode(raw, final).encode()
        elif self._read == len(raw):
            raw = raw.removeprefix(codecs.BOM_UTF8)
        return raw

    def pieces(self) -> Iterator[tuple[tuple[bytes, int], float]]:
        """Yield whole lines and the number of lines before them."""
        before = self._before + 1
        first, ended = True, False
        while not ended:
            if not first:
                more = self._file.read(_BLOCK_BYTES)
                self._read += len(more)
                self._rest += self._text(more, final=not more)
                ended = not more
            first = False
            end = len(self._rest) if ended else _end_of_lines(self._rest)
            piece, self._rest = self._rest[:end], self._rest[end:]
            if piece:
                yield (piece, before), self._read / self._size if self._size else 0.0
                before += piece.count(b"\n")

    def block(self, piece: tuple[bytes, int]) -> _Block | None:
        """Return the rows of a piece."""
        content, before = piece
        return self._fast(content, before) or self._careful(content, before)

    def _fast(self, content: bytes, before: int) -> _Block | None:
        """Read a plain piece with Arrow; None if it isn't plain."""
        if content.startswith(b"#") or b"\n#" in content or not content.strip():
            return None
        text = pa.string()
        try:
            cells = pyarrow.csv.read_csv(
                pa.BufferReader(content),
                pyarrow.csv.ReadOptions(use_threads=False, column_names=list(self.header)),
                pyarrow.csv.ParseOptions(
                    delimiter=self.separator, newlines_in_values=b'"' in content
                ),
                pyarrow.csv.ConvertOptions(column_types=dict.fromkeys(self.header, text)),
            )
            numbers = {
                key: self._numbers(cells, key) for key in READING_COLUMNS if key in self._columns
            }
            branch = self._words(cells, "branch")
        except (pa.ArrowInvalid, ValueError):
            return None
        if content.rstrip().count(b"\n") + 1 != cells.num_rows:  # then lines aren't rows
            return None
        if not self._labels_are_fine(cells, numbers["reading_nm"]):
            return None
        table = replace(self._table, lines=range(before + 1, before + 1 + cells.num_rows))
        readings = ReadingsTable(table, numbers, branch, self.simulated)
        return _Block(cells, readings, b'"' not in content)

    def _labels_are_fine(self, cells: Any, reading: NDArray[np.float64]) -> bool:
        try:
            direction = self._words(cells, "direction")
            if "series" in self._names:
                series = cells.column(self._names.index("series"))
                pc.cast(pc.utf8_trim_whitespace(series), pa.int64())
        except (pa.ArrowInvalid, ValueError):
            return False
        return direction is None or not np.any(direction * np.sign(reading) < 0)

    def _numbers(self, cells: Any, key: str) -> NDArray[np.float64]:
        name, factor = self._columns[key]
        column = cells[name]
        if self._comma:
            if pc.any(pc.match_substring(column, ".")).as_py():
                raise ValueError
            column = pc.replace_substring(column, ",", ".")
        values = numbers_of(pc.cast(pc.utf8_trim_whitespace(column), pa.float64()))
        if not np.isfinite(values).all():
            raise ValueError
        return np.asarray(values if factor == 1.0 else values * factor)

    def _words(self, cells: Any, column: str) -> NDArray[np.int8] | None:
        if column not in self._names:
            return None
        meaning = word_values(column)
        found = cells.column(self._names.index(column))
        words = pc.utf8_lower(pc.utf8_trim_whitespace(found))
        found = pc.index_in(words, pa.array(list(meaning)))
        if found.null_count:
            raise ValueError
        signs = np.array(list(meaning.values()), dtype=np.int8)
        return np.asarray(signs[numbers_of(found)])

    def _careful(self, content: bytes, before: int) -> _Block | None:
        """Read a piece cell by cell, as small tables are."""
        try:
            text = content.decode()
        except UnicodeDecodeError as error:
            line = before + 1 + content[: error.start].count(b"\n")
            raise InputError(
                Message(
                    "{origin}, line {line}: byte {content:#04x} isn't UTF-8 text",
                    self.origin,
                    line,
                    content[error.start],
                ),
                "one encoding throughout the file",
                "save it as CSV UTF-8",
            ) from error
        if not any(line.strip() and not is_comment(line) for line in text.splitlines()):
            return None
        table = parse_csv(f"{self._header_line}\n{text}", self.origin, before=before - 1)
        first = replace(self._table, rows=self._table.rows[:1], lines=self._table.lines[:1])
        both = replace(table, rows=first.rows + table.rows, lines=[*first.lines, *table.lines])
        both.check_decimal_marks(
            [self._columns[key][0] for key in READING_COLUMNS if key in self._columns]
        )
        columns = zip(*table.rows, strict=True)
        cells = pa.table(
            {name: list(cells) for name, cells in zip(self.header, columns, strict=True)}
        )
        readings = readings_of(table, self._mapping)
        return _Block(cells, replace(readings, simulated=self.simulated))


def _head(content: bytes) -> tuple[bytes, int]:
    """Return the lines up to the first few rows, and the number of lines before the header."""
    lines = content.split(b"\n", _BLOCK_BYTES)
    for number, line in enumerate(lines):
        if line.strip() and not line.lstrip().startswith(b"#"):
            return b"\n".join(lines[: number + _HEAD_LINES]), number
    return content, len(lines)


def _after_header(content: bytes, before: int) -> tuple[str, bytes]:
    lines = content.split(b"\n", before + 1)
    rest = lines[before + 1] if len(lines) > before + 1 else b""
    return lines[before].decode("utf-8", "replace").rstrip("\r"), rest


def _end_of_lines(content: bytes) -> int:
    """Return the end of the last whole line, outside of quotation marks."""
    end = content.rfind(b"\n") + 1
    while end and content.count(b'"', 0, end) % 2:
        end = content.rfind(b"\n", 0, end - 1) + 1
    return end


class _ArrowSource:
    """A file of any other format, in batches."""

    def __init__(self, file: ArrowFile, mapping: Sequence[str]) -> None:
        self.origin, self._file = file.origin, file
        self._columns = ArrowReadings(file.origin, file.schema, mapping)
        self.header, self.names = self._columns.header, self._columns.names
        self.remarks = self._columns.remarks
        self.simulated, self.timed = self._columns.simulated, self._columns.timed

    def pieces(self) -> Iterator[tuple[tuple[Any, int], float]]:
        """Yield batches and the number of rows before them."""
        before, total = self._file.before, max(self._file.rows, 1)
        for batch in self._file.batches(_BLOCK_ROWS):
            read = before + batch.num_rows
            yield (batch, before), (read - self._file.before) / total
            before = read

    def block(self, piece: tuple[Any, int]) -> _Block | None:
        """Return a batch with its readings."""
        batch, before = piece
        if not batch.num_rows:
            return None
        return _Block(pa.Table.from_batches([batch]), self._columns.readings(batch, before))


def _numbers(values: NDArray[np.float64]) -> Any:
    """Return numbers as Arrow without a copy; `pyarrow.array` would import pandas."""
    buffer = pa.py_buffer(np.ascontiguousarray(values, dtype=np.float64))
    return pa.Array.from_buffers(pa.float64(), values.size, [None, buffer])


class _CsvSink:
    """Writes blocks as CSV in the format of their source."""

    def __init__(self, file: IO[bytes], source: Any) -> None:
        self._file = file
        self._separator = getattr(source, "separator", ",")
        self._comma = getattr(source, "decimal_comma", False)
        remarks = [f"# {key} = {value}\n" for key, value in source.remarks.items()]
        header = self._separator.join(map(self._quoted, (*source.names, *ADDED_COLUMNS)))
        file.write(("".join(remarks) + header + "\n").encode())

    def _quoted(self, name: str) -> str:
        quoted = any(mark in name for mark in (self._separator, '"', "\n"))
        return '"' + name.replace('"', '""') + '"' if quoted else name

    def encoded(self, block: _Block, added: tuple[NDArray[np.float64], ...]) -> Any:
        """Return a block as lines of text."""
        columns = list(block.cells.columns)
        for values in added:
            column = _numbers(values)
            if self._comma:
                column = pc.replace_substring(pc.cast(column, pa.string()), ".", ",")
            columns.append(column)
        if not block.plain:
            return self._joined(columns)
        lines = pa.BufferOutputStream()
        options = pyarrow.csv.WriteOptions(
            include_header=False, delimiter=self._separator, quoting_style="none"
        )
        names = [*block.cells.column_names, *ADDED_COLUMNS]
        pyarrow.csv.write_csv(pa.table(columns, names=names), lines, options)
        return lines.getvalue()

    def _joined(self, columns: list[Any]) -> bytes:
        """Return lines with quotation marks where cells need them."""
        marks = f'[{self._separator}"\r\n]'
        cells = []
        for column in columns:
            text = pc.fill_null(pc.cast(column, pa.string()), "")
            quoted = pc.binary_join_element_wise(
                '"', pc.replace_substring(text, '"', '""'), '"', ""
            )
            cells.append(pc.if_else(pc.match_substring_regex(text, marks), quoted, text))
        lines = pc.binary_join_element_wise(*cells, self._separator)
        return ("\n".join(lines.to_pylist()) + "\n").encode()

    def write(self, lines: Any) -> None:
        """Append the result of `encoded`."""
        self._file.write(lines)

    def close(self) -> None:
        """No data remain to be written."""


class _ParquetSink:
    """Writes blocks as row groups of a Parquet file; text that holds numbers becomes numbers."""

    def __init__(self, file: IO[bytes], source: Any) -> None:
        self._file, self._source = file, source
        self._writer: Any = None
        self._schema: Any = None
        self._waiting: list[Any] = []

    def encoded(self, block: _Block, added: tuple[NDArray[np.float64], ...]) -> Any:
        """Return a block as a table."""
        table = block.cells
        if self._schema is None:
            self._schema = self._settled(table)
        try:
            table = table.cast(self._schema)
        except pa.ArrowInvalid as error:
            raise InputError(
                Message(
                    "{origin}: a column of numbers contains other values ({error})",
                    self._source.origin,
                    error,
                ),
                "one kind of value in each column",
                "correct the column, or write CSV",
            ) from error
        for name, values in zip(ADDED_COLUMNS, added, strict=True):
            field = pa.field(name, pa.float64(), metadata=column_of(name).attributes)
            table = table.append_column(field, _numbers(values))
        return table

    def _settled(self, table: Any) -> Any:
        """Return the schema: text of the first block becomes numbers where all of it can."""
        fields = []
        for field, column in zip(table.schema, table.columns, strict=True):
            kind = field.type
            if kind == pa.string():
                try:
                    pc.cast(column, pa.float64())
                    kind = pa.float64()
                except pa.ArrowInvalid:
                    pass
            fields.append(field.with_type(kind))
        return pa.schema(fields, metadata=self._source.remarks or None)

    def write(self, table: Any) -> None:
        """Append rows; they are written when they fill a row group."""
        self._waiting.append(table)
        if sum(each.num_rows for each in self._waiting) >= _GROUP_ROWS:
            self._write_group()

    def _write_group(self) -> None:
        group = pa.concat_tables(self._waiting)
        if self._writer is None:
            # where values hardly repeat, a dictionary costs time and saves nothing
            first = group.slice(0, _LOOKED_AT_ROWS)
            repeating = [
                name
                for name, column in zip(first.column_names, first.columns, strict=True)
                if 2 * pc.count_distinct(column).as_py() < len(column)
            ]
            self._writer = pq.ParquetWriter(self._file, group.schema, use_dictionary=repeating)
        self._writer.write_table(group, row_group_size=_GROUP_ROWS)
        self._waiting = []

    def close(self) -> None:
        """Write the remaining data and the end of the Parquet file."""
        if self._waiting:
            self._write_group()
        self._writer.close()
