"""Open and read tables in any format."""

from __future__ import annotations

import csv
import io
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.formats import (
    check_installed,
    format_of_content,
    reads,
    split_part,
)
from torquebench.tables.formats.text import TextFile, decode_text
from torquebench.tables.headers import with_unit
from torquebench.tables.isolated import BATCHES, Limits, check_cells, open_isolated
from torquebench.tables.table import Table

LIMITS = Limits()
"""Limits for tables that are read as a whole."""
_WHOLE = 1 << 16
_HEAD_BYTES = 16


@dataclass(frozen=True)
class OpenTable:
    """A table that is read in pieces.

    Parameters
    ----------
    empty : Table
        The table without rows: its names, remarks and notes.
    raw : callable
        Function that yields raw pieces in the order of the file, and the share of the file read so
        far.
    piece : callable
        Function that returns the rows of a raw piece, None if it has none; any thread may call it.
    schema : pyarrow.Schema or None
        Types of the columns; None for a text file.
    """

    empty: Table
    raw: Callable[[], Iterator[tuple[Any, float]]]
    piece: Callable[[Any], Table | None]
    schema: Any = None


def read_table(
    path: Path | str,
    *,
    limits: Limits = LIMITS,
    called: str = "",
) -> Table:
    """Return the table in a file of any format; ``-`` is text from standard input.

    Parameters
    ----------
    path : pathlib.Path or str
        File, whose format follows from its content or else its ending; ``FILE#PART`` chooses a
        sheet, group or variable.
    limits : Limits
        Limits of memory, time and size.
    called : str
        Name of the file in messages; by default its path.

    Raises
    ------
    InputError
        Where the file can't be read, isn't a table, is larger than the limits, or its format's
        package isn't installed.
    """
    with ExitStack() as opened:
        file = open_table(Path(path), opened, limits=limits, rows=_WHOLE, called=called)
        pieces, rows = [], 0
        for raw, _ in file.raw():
            if (piece := file.piece(raw)) is not None:
                pieces.append(piece)
                rows += len(piece)
                check_cells(piece.origin, rows, len(piece.names), limits)
    if not pieces:
        raise InputError(
            Message("{origin} holds a header but no values", called or path),
            "at least one line of values",
        )
    return Table.joined(pieces)


def open_table(
    path: Path,
    opened: ExitStack,
    *,
    rows: int,
    limits: Limits = BATCHES,
    called: str = "",
) -> OpenTable:
    """Open a table to be read in pieces; `opened` closes it.

    Parameters
    ----------
    path, limits, called
        As in `read_table`.
    rows : int
        Largest number of rows in a piece; pieces of text have a fixed size in bytes instead.

    Raises
    ------
    InputError
        As `read_table`.
    """
    most = None if limits.mb is None else limits.mb << 20
    if str(path) == "-":
        return _of_text(TextFile("standard input", sys.stdin.buffer, 0, most))
    file, part = split_part(path)
    content, size = _opened(file, opened)
    head = b"" if size is None else content.read(_HEAD_BYTES)
    chosen = format_of_content(file, head)
    if size is not None:
        content.seek(0)
    if chosen.name == "csv":
        _refuse_markup(file, head)
        return _of_text(TextFile(called or str(file), content, size or 0, most))
    check_installed(chosen, file.name)
    stream = opened.enter_context(open_isolated(file, part, chosen.name, rows, limits, called))
    header, schema = stream.header, stream.schema
    numbered = bool(header["numbered"])
    shared: dict[str, Any] = {}
    fields = list(schema)[: -1 if numbered else None]
    names = tuple(
        with_unit(
            " ".join(field.name.split()) or f"column {number}",
            (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace"),
            header["origin"],
        )
        for number, field in enumerate(fields, 1)
    )
    notes = tuple(n if isinstance(n, str) else Message.restored(n) for n in header["notes"])
    remarks = _remarks(schema)

    def table(batch: Any, before: int) -> Table:
        columns = batch.columns
        numbers: Any = range(before + 1, before + 1 + batch.num_rows)
        if numbered:
            numbers = columns[-1].to_numpy()
        return Table(
            header["origin"],
            names,
            tuple(columns[: len(names)]),
            numbers,
            header["counted"],
            remarks,
            notes,
            header["separator"],
            shared=shared,
        )

    def raw() -> Iterator[tuple[Any, float]]:
        before = done = int(header["before"])
        total = max(int(header["rows"] or 0), 1)
        for batch in stream.batches():
            yield (batch, done), min((done - before + batch.num_rows) / total, 1.0)
            done += batch.num_rows

    def piece(batch: tuple[Any, int]) -> Table | None:
        return table(*batch) if batch[0].num_rows else None

    import pyarrow as pa

    plain = pa.schema(fields)
    none = pa.RecordBatch.from_pylist([], schema=schema)
    return OpenTable(table(none, 0), raw, piece, plain)


def _of_text(file: TextFile) -> OpenTable:
    return OpenTable(file.empty, file.raw, file.piece)


def _opened(file: Path, opened: ExitStack) -> tuple[IO[bytes], int | None]:
    """Return an opened file and its size; None for a pipe or a device."""
    try:
        content = opened.enter_context(file.open("rb"))
        return content, file.stat().st_size if file.is_file() else None
    except (
        OSError,
        ValueError,
        RuntimeError,
    ) as error:  # a name with NUL, a loop of links
        raise InputError(
            Message(
                "can't read {source}: {error}", file, getattr(error, "strerror", None) or error
            ),
            "a file that exists and may be read",
        ) from error


def _reason(error: Exception) -> object:
    return getattr(error, "strerror", None) or error


def _refuse_markup(file: Path, head: bytes) -> None:
    """Refuse files that programs export with the ending of a table but that aren't tables."""
    start = head.lstrip(b"\xef\xbb\xbf \r\n\t").lower()
    for mark, name in ((b"<!doctype", "HTML"), (b"<html", "HTML"), (b"<table", "HTML"),
                       (b"<?xml", "XML"), (b"{", "JSON"), (b"%pdf", "PDF")):  # fmt: skip
        if start.startswith(mark):
            raise InputError(
                Message("{file} is {format}", file, name), reads(), "save it as CSV or .xlsx"
            )


def _remarks(schema: Any) -> dict[str, str]:
    """Return the metadata in a schema that belong to the whole table."""
    notes = {
        key.decode("utf-8", "replace"): value.decode("utf-8", "replace")
        for key, value in (schema.metadata or {}).items()
    }
    own = ("ARROW:schema", "pandas", "torquebench:table")
    return {key: value for key, value in notes.items() if key not in own and "\n" not in value}


def table_text(path: Path, *, called: str = "", limits: Limits = LIMITS) -> str:
    """Return a table as text: a text file unchanged, any other file as CSV.

    Raises
    ------
    InputError
        As `read_table`.
    """
    with ExitStack() as opened:
        content, _ = _opened(split_part(path)[0], opened)
        if format_of_content(path, content.read(_HEAD_BYTES)).name == "csv":
            content.seek(0)
            return decode_text(content.read(), called or str(path))
    table = read_table(path, limits=limits, called=called)
    text = io.StringIO()
    for name, value in table.remarks.items():
        text.write(f"# {name} = {value}\n")
    columns = [table.texts(index) for index in range(len(table.names))]
    rows = zip(*columns, strict=True)
    csv.writer(text, lineterminator="\n").writerows([table.names, *rows])
    return text.getvalue()


def table_of_arrow(table: Any, origin: str) -> Table:
    """Return an Arrow table as a table in memory, for example from a data frame.

    Examples
    --------
    >>> import pyarrow as pa
    >>> table_of_arrow(pa.table({"reading_nm": [1.5, None]}), "a frame").texts("reading_nm")
    ['1.5', '']
    """
    names = tuple(
        with_unit(field.name.strip(), (field.metadata or {}).get(b"unit", b"").decode(), origin)
        for field in table.schema
    )
    rows = range(1, 1 + table.num_rows)
    return Table(origin, names, tuple(table.columns), rows, "row", _remarks(table.schema))
