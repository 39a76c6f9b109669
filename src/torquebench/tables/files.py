"""Tables in files of any format, read completely or in batches.

Parquet, Excel, TDMS, MDF4 and HDF5 become Arrow tables, with units from the channels' properties. A
format's package is imported when such a file is opened.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.columns import with_unit
from torquebench.tables.csv_text import COMMENT, CsvTable, decode_csv, read_csv
from torquebench.tables.formats import format_of, is_csv, split_part
from torquebench.tables.sheet_errors import cell_errors

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "ArrowFile",
    "cell_texts",
    "cells_of",
    "headers",
    "open_table",
    "read_arrow",
    "read_table",
    "remarks_of",
    "table_text",
]

_WHOLE = 1 << 16
_EXACT = 2.0**53
_NEEDED = {
    "excel": ("python_calamine", "excel"),
    "tdms": ("nptdms", "tdms"),
    "mdf4": ("asammdf", "mdf4"),
    "hdf5": ("h5py", "hdf5"),
}
"""Package and extra of each format."""


@dataclass(frozen=True)
class ArrowFile:
    """A table in a binary file.

    Parameters
    ----------
    origin : str
        What messages call it.
    schema : pyarrow.Schema
        Columns, units in the fields' metadata, remarks in the schema's.
    rows : int
    batches : callable
        Yields record batches of at most so many rows.
    before : int, default 0
        Rows of the file before the first, for messages.
    """

    origin: str
    schema: Any
    rows: int
    batches: Callable[[int], Iterator[Any]]
    before: int = 0


def read_table(path: Path | str) -> CsvTable:
    """Return the table in a file, of any format, as cells of text.

    Parameters
    ----------
    path : pathlib.Path or str
        CSV, Parquet, Excel, TDMS, MDF4 or HDF5 by its ending; ``FILE#PART`` chooses a sheet or
        group.

    Raises
    ------
    InputError
        Where the file can't be read, isn't a table, or its format's package isn't installed.
    """
    path = Path(path)
    return read_csv(path) if is_csv(path) else cells_of(*read_arrow(path))


def read_arrow(path: Path) -> tuple[Any, str, int]:
    """Return the Arrow table in a file other than CSV, its name in messages, rows before the first.

    Raises
    ------
    InputError
        As `read_table`.
    """
    check_readable(path)
    import pyarrow as pa

    with ExitStack() as opened:
        file = open_table(path, opened)
        table = pa.Table.from_batches(file.batches(_WHOLE), file.schema)
    if table.num_rows == 0:
        raise InputError(
            Message("{origin} holds a header but no values", path), "at least one line of values"
        )
    return table, file.origin, file.before


def cells_of(table: Any, origin: str, before: int = 0) -> CsvTable:
    """Return an Arrow table as cells of text, which small tables are read from.

    Parameters
    ----------
    table : pyarrow.Table
    origin : str
        What messages call it.
    before : int, default 0
        Rows of its file before the first, for messages.
    """
    columns = [cell_texts(each) for each in table]
    names = headers(table.schema, origin)
    return CsvTable(
        origin,
        ",",
        tuple(name.lower() for name in names),
        tuple(zip(*columns, strict=True)),
        range(before + 1, before + 1 + table.num_rows),
        remarks_of(table.schema),
        "row",
        names,
    )


def headers(schema: Any, origin: str) -> tuple[str, ...]:
    """Return the columns' names with the units that their metadata state."""
    return tuple(
        with_unit(field.name.strip(), (field.metadata or {}).get(b"unit", b"").decode(), origin)
        for field in schema
    )


def cell_texts(column: Any) -> list[str]:
    """Return cells as text, whole numbers without a decimal point: they may be words for branches.

    >>> import pyarrow as pa
    >>> cell_texts(pa.array([1.0, 0.1, None]))
    ['1', '0.1', '']
    """
    return [
        f"{cell:.0f}"
        if isinstance(cell, float) and cell.is_integer() and abs(cell) < _EXACT
        else ("" if cell is None else str(cell))
        for cell in column.to_pylist()
    ]


def remarks_of(schema: Any) -> dict[str, str]:
    """Return a schema's metadata of the whole table."""
    notes = {key.decode(): value.decode() for key, value in (schema.metadata or {}).items()}
    own = ("ARROW:schema", "pandas")
    return {key: value for key, value in notes.items() if key not in own and "\n" not in value}


def table_text(path: Path, called: str = "") -> str:
    """Return the text of a table's file; a binary format as CSV.

    Raises
    ------
    InputError
        As `read_table`.
    """
    if is_csv(path):
        try:
            return decode_csv(path.read_bytes(), called or str(path))
        except OSError as error:
            raise InputError(
                Message("can't read {source}: {error}", path, error.strerror), "a table's file"
            ) from error
    table = read_table(path)
    text = io.StringIO()
    for name, value in table.remarks.items():
        text.write(f"# {name} = {value}\n")
    csv.writer(text, lineterminator="\n").writerows([table.names, *table.rows])
    return text.getvalue()


def check_readable(path: Path) -> None:
    """Refuse a file that isn't there, or whose format's package isn't, before anything long.

    Raises
    ------
    InputError
    """
    file, _ = split_part(path)
    try:
        file.open("rb").close()
    except OSError as error:
        raise InputError(
            Message("can't read {source}: {error}", file, error.strerror),
            "a file that exists and may be read",
        ) from error
    package, extra = _NEEDED.get(format_of(path), ("", ""))
    if package and find_spec(package) is None:
        raise InputError(
            Message("{name}: this format without the package {package}", file.name, package),
            "CSV or Parquet, or a format whose package is installed",
            Message(
                'install it: pip install "torquebench[{extra}]", or all: "torquebench[tables]"',
                extra,
            ),
        )


def open_table(path: Path, opened: ExitStack) -> ArrowFile:
    """Open a table in a binary file; `opened` closes it.

    Raises
    ------
    InputError
        If the file isn't of its ending's format, or has several tables and none is chosen.
    """
    check_readable(path)
    file, part = split_part(path)
    openers = {
        "parquet": _open_parquet,
        "excel": _open_excel,
        "tdms": _open_tdms,
        "mdf4": _open_mdf4,
        "hdf5": _open_hdf5,
    }
    kind = format_of(path)
    try:
        return openers[kind](file, part, opened)
    except InputError:
        raise
    except Exception as error:  # each library raises its own errors and those of struct
        raise InputError(
            Message("can't read {source}: {error}", file, error),
            "a file of the kind that its ending names",
        ) from error


def _open_parquet(path: Path, _: str, opened: ExitStack) -> ArrowFile:
    import pyarrow.parquet as pq

    file = opened.enter_context(pq.ParquetFile(path, pre_buffer=False))

    def batches(rows: int) -> Iterator[Any]:
        return iter(file.iter_batches(rows))

    return ArrowFile(str(path), file.schema_arrow, file.metadata.num_rows, batches)


def _open_excel(path: Path, part: str, _: ExitStack) -> ArrowFile:
    import pyarrow as pa
    from python_calamine import CalamineWorkbook

    book = CalamineWorkbook.from_path(path)
    sheets = {
        name: rows
        for name in book.sheet_names
        if (rows := book.get_sheet_by_name(name).to_python(skip_empty_area=False))
    }
    sheet = _chosen(path, part, dict.fromkeys(sheets, ()), "sheet")
    rows = _with_errors(sheets[sheet], path, sheet)
    remarks: dict[str, str] = {}
    before = 0  # rows above the header: comments and empty ones
    while before < len(rows) - 1:
        first = str(rows[before][0]).strip()
        comment = COMMENT.match(first)
        if comment is not None:
            remarks[comment[1].lower()] = comment[2].strip()
        elif any(cell != "" for cell in rows[before]) and not first.startswith("# "):
            break
        before += 1
    names = [str(cell).strip() for cell in rows[before]]
    while names and not names[-1]:
        names.pop()
    body = [row[: len(names)] for row in rows[before + 1 :]]
    while body and all(cell == "" for cell in body[-1]):
        body.pop()
    columns = [_of_cells(column) for column in zip(*body, strict=True)] if body else []
    if not columns:
        columns = [pa.array([], pa.float64()) for _ in names]
    _check_names(names, path)
    table = pa.Table.from_arrays(columns, names).replace_schema_metadata(remarks or None)

    def batches(count: int) -> Iterator[Any]:
        return iter(table.to_batches(count))

    origin = str(path) if len(book.sheet_names) == 1 else f"{path}#{sheet}"
    return ArrowFile(origin, table.schema, table.num_rows, batches, before + 1)


def _with_errors(rows: list[list[Any]], path: Path, sheet: str) -> list[list[Any]]:
    """Return a sheet's rows with the errors of its cells, which are read as empty, as text."""
    if all(cell != "" for row in rows for cell in row):
        return rows
    for (row, column), text in cell_errors(path, sheet).items():
        if row < len(rows) and column < len(rows[row]):
            rows[row][column] = text
    return rows


def _of_cells(cells: Sequence[Any]) -> Any:
    """Return a column of a sheet: numbers if all cells are, otherwise text."""
    import pyarrow as pa

    if all(isinstance(cell, int | float) or cell == "" for cell in cells):
        return pa.array([None if cell == "" else float(cell) for cell in cells], pa.float64())
    return pa.array([None if cell == "" else _text(cell) for cell in cells], pa.string())


def _text(cell: Any) -> str:
    return f"{cell:.0f}" if isinstance(cell, float) and cell.is_integer() else str(cell)


def _open_tdms(path: Path, part: str, opened: ExitStack) -> ArrowFile:
    from nptdms import TdmsFile

    file = opened.enter_context(TdmsFile.open(path))
    groups: dict[str, dict[str, Any]] = {}
    for group in file.groups():
        groups |= _by_length(group.name, {each.name: each for each in group.channels()}, len)
    name = _chosen(path, part, groups, "group")
    channels = groups[name]
    first = next(iter(channels.values()))

    def values(channel: Any) -> Callable[[int, int], NDArray[Any]]:
        return lambda start, count: channel.read_data(start, count)

    columns = [
        (name, str(each.properties.get("unit_string", "")), values(each))
        for name, each in channels.items()
    ]
    steps = {each.properties.get("wf_increment") for each in channels.values()}
    if len(steps) == 1 and (step := steps.pop()) and not any(_is_time(n) for n in channels):
        start = first.properties.get("wf_start_offset", 0.0)
        columns.insert(0, ("time_s", "s", _even_times(float(start), float(step))))
    remarks = {**file.properties, **file[first.group_name].properties}
    return _of_columns(path, columns, len(first), remarks)


def _is_time(name: str) -> bool:
    return name.lower().startswith(("time", "zeit", "时间"))


def _even_times(start: float, step: float) -> Callable[[int, int], NDArray[Any]]:
    """Return the times of a waveform, for which TDMS states a step."""
    import numpy as np

    return lambda first, count: start + step * np.arange(first, first + count)


def _open_mdf4(path: Path, part: str, opened: ExitStack) -> ArrowFile:
    from asammdf import MDF

    file: Any = MDF(path)
    opened.callback(file.close)
    groups: dict[str, int] = {}
    for number, each in enumerate(file.groups):
        if each.channel_group.cycles_nr and len(each.channels) > 1:
            name = each.channel_group.acq_name or str(number)
            groups[name if name not in groups else f"{name} {number}"] = number
    names = {
        name: [channel.name for channel in file.groups[number].channels]
        for name, number in groups.items()
    }
    number = groups[_chosen(path, part, names, "group")]
    group = file.groups[number]

    def values(index: int) -> Callable[[int, int], NDArray[Any]]:
        def read(start: int, count: int) -> NDArray[Any]:
            samples, invalid = file.get(
                group=number,
                index=index,
                record_offset=start,
                record_count=count,
                samples_only=True,
                ignore_invalidation_bits=True,
            )
            return _without(samples, invalid)

        return read

    columns = []
    for index, channel in enumerate(group.channels):
        unit = str(file.get_channel_unit(group=number, index=index) or "")
        read = values(index)
        if read(0, 1).ndim == 1 and read(0, 1).dtype.names is None:
            columns.append((channel.name, unit, read))
    return _of_columns(
        path, columns, group.channel_group.cycles_nr, _mdf_remarks(file.header.comment)
    )


def _without(samples: NDArray[Any], invalid: Any) -> NDArray[Any]:
    """Return samples, with NaN for invalid ones."""
    import numpy as np

    if invalid is None or not np.any(invalid):
        return samples
    return np.where(np.asarray(invalid, dtype=bool), np.nan, samples)


def _mdf_remarks(comment: str) -> dict[str, str]:
    """Return the properties in an MDF file's header comment."""
    from xml.etree import ElementTree

    try:
        tree = ElementTree.fromstring(comment)
    except ElementTree.ParseError:
        return {}
    entries = [each for each in tree.iter() if each.tag.endswith("e") and "name" in each.attrib]
    return {each.attrib["name"]: each.text or "" for each in entries}


def _open_hdf5(path: Path, part: str, opened: ExitStack) -> ArrowFile:
    import h5py

    file = opened.enter_context(h5py.File(path, "r"))
    groups: dict[str, dict[str, Any]] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and _is_column(item):
            if item.dtype.names:
                groups[name] = {each: item.fields(each) for each in item.dtype.names}
            else:
                place, _, own = name.rpartition("/")
                groups.setdefault(place or "/", {})[own] = item

    file.visititems(visit)
    parts: dict[str, dict[str, Any]] = {}
    for name, group in groups.items():
        parts |= _by_length(name, group, _size)
    sets = parts[_chosen(path, part, parts, "group")]
    first = next(iter(sets.values()))
    columns = [(name, _unit(data), _slices(data)) for name, data in sets.items()]
    remarks = dict(file.attrs)
    for name, group in groups.items():
        if first in group.values():
            remarks |= dict(file[name].attrs)
    return _of_columns(path, columns, _size(first), remarks)


def _is_column(data: Any) -> bool:
    return sum(length != 1 for length in data.shape) <= 1 and data.ndim in (1, 2) and data.size > 0


def _size(data: Any) -> int:
    return len(data) if not hasattr(data, "size") else int(data.size)


def _slices(data: Any) -> Callable[[int, int], NDArray[Any]]:
    """Return a reader of parts of a data set, by rows or by columns (as written by MATLAB)."""
    shape = getattr(data, "shape", (0,))
    if len(shape) == 2 and shape[0] == 1:
        return lambda start, count: data[0, start : start + count]
    if len(shape) == 2:
        return lambda start, count: data[start : start + count, 0]
    return lambda start, count: data[start : start + count]


def _unit(data: Any) -> str:
    properties = getattr(data, "attrs", {})
    found = next((properties[key] for key in ("unit", "units", "Unit") if key in properties), "")
    return found.decode() if isinstance(found, bytes) else str(found)


def _of_columns(
    path: Path,
    columns: Sequence[tuple[str, str, Callable[[int, int], NDArray[Any]]]],
    rows: int,
    remarks: Mapping[str, Any],
) -> ArrowFile:
    """Return the table of channels with name, unit and a reader of parts."""
    import pyarrow as pa

    _check_names([name for name, *_ in columns], path)
    fields = [
        pa.field(name, _arrow(read(0, 1)).type, metadata={"unit": unit} if unit else None)
        for name, unit, read in columns
    ]
    texts = {str(key).lower(): _of_property(value) for key, value in remarks.items()}
    schema = pa.schema(fields, metadata=texts or None)

    def batches(count: int) -> Iterator[Any]:
        for start in range(0, rows, count):
            size = min(count, rows - start)
            parts = [_arrow(read(start, size)) for *_, read in columns]
            yield pa.RecordBatch.from_arrays(parts, schema=schema)

    return ArrowFile(str(path), schema, rows, batches)


def _of_property(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _arrow(values: NDArray[Any]) -> Any:
    import numpy as np
    import pyarrow as pa

    if values.dtype.kind in "OSU":
        return pa.array([_of_property(each) for each in values.tolist()], pa.string())
    if values.dtype.kind == "V":
        return pa.array([str(each) for each in values.tolist()], pa.string())
    return pa.array(np.ascontiguousarray(values.astype(values.dtype.newbyteorder("="), copy=False)))


def _chosen(path: Path, part: str, parts: Mapping[str, Iterable[str]], called: str) -> str:
    """Return the named sheet or group, or the only one."""
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
            f"{name} ({', '.join(columns)})" if (columns := list(each)) else name
            for name, each in parts.items()
        )
        raise InputError(
            Message("{path} holds {count} tables", path, len(parts)),
            Message("one {called} of {listed}", called, listed),
            Message("choose one: '{path}#{sheet}'", path, next(iter(parts))),
        )
    return next(iter(parts))


def _by_length(
    name: str, channels: Mapping[str, Any], length: Callable[[Any], int]
) -> dict[str, dict[str, Any]]:
    """Return the tables in a group: channels of one length belong together."""
    tables: dict[int, dict[str, Any]] = {}
    for each, channel in channels.items():
        if length(channel):
            tables.setdefault(length(channel), {})[each] = channel
    if len(tables) == 1:
        return dict.fromkeys((name,), next(iter(tables.values())))
    return {f"{name} {rows}": table for rows, table in tables.items()}


def _check_names(names: Sequence[str], path: Path) -> None:
    seen: set[str] = set()
    for number, name in enumerate(names):
        if not name.strip():
            raise InputError(
                Message("{origin}: column {number} has no name", path, number + 1),
                "a name for each column",
            )
        if name.strip().lower() in seen:
            raise InputError(
                Message("{origin}: two columns are called {name}", path, name.strip().lower()),
                "each name once",
                "rename one of them",
            )
        seen.add(name.strip().lower())
