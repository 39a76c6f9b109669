"""Formats of tables: one file for each format, which reads and writes it.

Each module of this package is a format. It defines `FORMAT`, and imports the format's package only
when a table is opened or written, so that endings can be listed quickly. All formats except text
are read in a separate process (`torquebench.tables.isolated`).
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

from torquebench.atomic_write import atomic_file
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = [
    "Format",
    "OpenedTable",
    "TableWriter",
    "check_installed",
    "check_kept",
    "check_read",
    "check_written",
    "chosen_part",
    "endings",
    "format_of",
    "format_of_content",
    "formats",
    "of_channels",
    "property_text",
    "reads",
    "split_part",
    "table_schema",
    "tables_by_length",
    "write_table",
    "written",
]


@dataclass(frozen=True)
class OpenedTable:
    """An opened table: its schema and remarks, and its rows in batches.

    Parameters
    ----------
    schema : pyarrow.Schema
        Columns; units in the fields' metadata, remarks in the schema's.
    batches : callable
        Function that yields record batches of at most a given number of rows.
    rows : int or None
        Number of rows, if the file states it.
    before : int
        Number of rows in the file before the first one of the table.
    part : str
        Chosen sheet or group, if the file has several.
    notes : tuple of str
        Notes on ignored contents.
    numbered : bool
        Whether the last column contains the number of each row.
    counted, separator : str
        As in a `Table`.
    """

    schema: Any
    batches: Callable[[int], Iterator[Any]]
    rows: int | None = None
    before: int = 0
    part: str = ""
    notes: tuple[str, ...] = ()
    numbered: bool = False
    counted: str = "row"
    separator: str = ","


class TableWriter(Protocol):
    """Writes a table in batches."""

    def write(self, batch: Any) -> None:
        """Append a record batch or table."""

    def close(self) -> None:
        """Write the end of the file."""


@dataclass(frozen=True)
class Format:
    """A format of tables.

    Parameters
    ----------
    name : str
    title : str
        Title for messages, with the usual endings.
    endings : tuple of str
        Of file names.
    open : callable
        Opens a file, of which a sheet or group may be chosen; the `ExitStack` closes it.
    begins : tuple of bytes
        First bytes of such a file.
    package, extra : str
        Package for the format, and the extra that installs it.
    writer : callable, optional
        Returns a `TableWriter` by binary file, schema (with units and descriptions of the fields)
        and remarks; `separator` and `decimal` are those of a text.
    parts : str
        Name of a file's parts, such as "sheet".
    """

    name: str
    title: str
    endings: tuple[str, ...]
    open: Callable[[Path, str, ExitStack], OpenedTable]
    begins: tuple[bytes, ...] = ()
    package: str = ""
    extra: str = ""
    writer: Callable[..., TableWriter] | None = None
    parts: str = ""
    order: int = field(default=5, compare=False)


@cache
def formats() -> tuple[Format, ...]:
    """Return all formats, text first."""
    names = [module.name for module in pkgutil.iter_modules(__path__)]
    found = [import_module(f"{__name__}.{name}").FORMAT for name in names]
    return tuple(sorted(found, key=lambda each: (each.order, each.name)))


def endings(*, written: bool = False) -> tuple[str, ...]:
    """Return the endings of all formats that are read, or of those that are written, too."""
    known = (each for each in formats() if each.writer is not None or not written)
    return tuple(ending for each in known for ending in each.endings)


def reads() -> str:
    """Return the formats that are read, for messages."""
    return ", ".join(each.title for each in formats())


def written() -> str:
    """Return the formats that are written, for messages."""
    return ", ".join(each.title for each in formats() if each.writer is not None)


def format_of(path: Path) -> Format | None:
    """Return the format that a file's name states; None if it states none.

    Examples
    --------
    >>> format_of(Path("readings.MF4")).name, format_of(Path("readings.xlsx#Sheet 2")).name
    ('mdf4', 'excel')
    """
    ending = split_part(path)[0].suffix.lower()
    return next((each for each in formats() if ending in each.endings), None)


def format_of_content(path: Path, head: bytes) -> Format:
    """Return the format of a file by its first bytes, else by its name, else text."""
    text = formats()[0]
    for each in formats():
        if any(head.startswith(begin) for begin in each.begins):
            stated = format_of(path)
            return stated if stated is not None and stated.begins == each.begins else each
    stated = format_of(path)
    return text if stated is None or not head else stated


def split_part(path: Path) -> tuple[Path, str]:
    """Return the file and the sheet or group in ``FILE#PART``.

    Examples
    --------
    >>> split_part(Path("bench.tdms#Torque"))[1], split_part(Path("bench #2.csv"))[1]
    ('Torque', '')
    """
    file, mark, part = str(path).rpartition("#")
    if not mark or path.exists():
        return path, ""
    ending = Path(file).suffix.lower()
    if any(ending in each.endings and each.parts for each in formats()):
        return Path(file), part
    return path, ""


def check_read(path: Path) -> None:
    """Refuse a file whose ending isn't that of a readable format.

    Raises
    ------
    InputError
        Naming the formats.
    """
    if path.suffix and str(path) != "-" and format_of(path) is None:
        raise InputError(path.name, reads(), "choose one of these endings")


def check_kept(path: Path) -> None:
    """Refuse a table that can't be read twice, where the result keeps it or its hash.

    Raises
    ------
    InputError
        The path is standard input or a pipe.
    """
    if str(path) == "-" or (path.exists() and not path.is_file()):
        raise InputError(
            "a table from standard input or a pipe", "a file: it is kept", "save it as a file first"
        )


def check_written(path: Path) -> None:
    """Refuse a file whose ending isn't that of a writable format, before any work is done.

    Raises
    ------
    InputError
        Naming the formats.

    Examples
    --------
    >>> check_written(Path("torque.xls"))
    Traceback (most recent call last):
    torquebench.errors.InputError: torque.xls; allowed: CSV (.csv, .txt, .tsv), ...
    """
    found = formats()[0] if not path.suffix else format_of(path)
    if found is None or found.writer is None:
        raise InputError(path.name, written(), "choose one of these endings")
    check_installed(found, path.name)


def write_table(path: Path, columns: Mapping[str, Sequence[Any]]) -> None:
    """Write columns of one length in the format that the ending of the file's name states.

    Raises
    ------
    InputError
        The ending names no format that is written, or the file can't be written.
    """
    check_written(path)
    import pyarrow as pa

    table = pa.table({name: list(values) for name, values in columns.items()})
    chosen = format_of(path) or formats()[0]
    assert chosen.writer is not None
    with atomic_file(path) as file:
        writer = chosen.writer(file, table.schema, {})
        writer.write(table)
        writer.close()


def check_installed(chosen: Format, name: str) -> None:
    """Refuse a format whose package isn't installed.

    Raises
    ------
    InputError
        A package is missing; the message states the command that installs it.
    """
    if chosen.package and find_spec(chosen.package) is None:
        raise InputError(
            Message("{name}: this format without the package {package}", name, chosen.package),
            "CSV or Parquet, or a format whose package is installed",
            Message(
                'install it: pip install "torquebench[{extra}]", or all: "torquebench[tables]"',
                chosen.extra,
            ),
        )


def chosen_part(path: Path, part: str, parts: Mapping[str, Sequence[str]], called: str) -> str:
    """Return the named sheet or group, or the only one.

    Raises
    ------
    InputError
        The file has no part, none of this name, or several of which none was chosen.
    """
    if not parts:
        raise InputError(
            Message("{path}: no {called} with columns", path, called),
            "a table of columns of one length",
        )
    if part:
        if part not in parts:
            raise InputError(
                Message("{path} has no {called} {part}", path, called, part),
                Message("one of {list}", ", ".join(parts)),
            )
        return part
    if len(parts) > 1:
        listed = "; ".join(
            f"{name} ({', '.join(list(columns)[:8])}{', …' * (len(columns) > 8)})"
            if columns
            else name
            for name, columns in list(parts.items())[:20]
        )
        raise InputError(
            Message("{path} holds {count} tables", path, len(parts)),
            Message("one {called} of {listed}", called, listed),
            Message("choose one: '{path}#{sheet}'", path, next(iter(parts))),
        )
    return next(iter(parts))


# -- what formats share ---------------------------------------------------------------------


ROW = "row number"
"""Name of the last column of a numbered table."""
Channel = tuple[str, str, Callable[[int, int], Any]]
"""Name and unit of a channel, and a function that reads a number of values from an index on."""


def table_schema(
    columns: Sequence[tuple[str, str, Any]],
    remarks: Mapping[str, Any],
    *,
    numbered: bool = False,
) -> Any:
    """Return an Arrow schema of columns with name, unit and type."""
    import pyarrow as pa

    fields = [
        pa.field(name, kind, metadata={"unit": unit} if unit else None)
        for name, unit, kind in columns
    ]
    if numbered:
        fields.append(pa.field(ROW, pa.int64()))
    texts = {str(key).lower(): property_text(value) for key, value in remarks.items()}
    return pa.schema(fields, metadata={k: v for k, v in texts.items() if "\n" not in v} or None)


def property_text(value: Any) -> str:
    """Return a property of a file as text."""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def of_channels(
    channels: Sequence[Channel],
    rows: int,
    remarks: Mapping[str, Any],
    part: str = "",
    notes: Sequence[str] = (),
) -> OpenedTable:
    """Return the table of channels of one length."""
    import pyarrow as pa

    columns = [(name, unit, _array(read(0, min(1, rows))).type) for name, unit, read in channels]
    schema = table_schema(columns, remarks)

    def batches(count: int) -> Iterator[Any]:
        for start in range(0, rows, count):
            size = min(count, rows - start)
            arrays = [
                _array(read(start, size)).cast(kind)
                for (*_, read), (*_, kind) in zip(channels, columns, strict=True)
            ]
            yield pa.RecordBatch.from_arrays(arrays, schema=schema)

    return OpenedTable(schema, batches, rows, part=part, notes=tuple(notes))


def _array(values: Any) -> Any:
    import numpy as np
    import pyarrow as pa

    values = np.asarray(values)
    if values.dtype.kind in "OSU":
        return pa.array([property_text(value) for value in values.tolist()], pa.string())
    if values.dtype.kind in "Vc":
        return pa.array([str(value) for value in values.tolist()], pa.string())
    return pa.array(np.ascontiguousarray(values.astype(values.dtype.newbyteorder("="), copy=False)))


def tables_by_length(
    name: str, channels: Mapping[str, Any], length: Callable[[Any], int]
) -> dict[str, dict[str, Any]]:
    """Return the tables in a group: channels of one length belong together."""
    tables: dict[int, dict[str, Any]] = {}
    for channel, content in channels.items():
        if length(content):
            tables.setdefault(length(content), {})[channel] = content
    if len(tables) == 1:
        return {name: next(iter(tables.values()))}
    return {f"{name} {rows}".strip(): table for rows, table in tables.items()}
