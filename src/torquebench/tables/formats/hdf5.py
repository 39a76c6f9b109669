"""HDF5, by h5py."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from torquebench.message import Message
from torquebench.tables.formats import (
    Format,
    OpenedTable,
    chosen_part,
    of_channels,
    tables_by_length,
)

MOST_COLUMNS = 256
"""Largest number of columns of a matrix that may be a table."""
_CHUNK = 65_536


def _open(path: Path, part: str, opened: ExitStack) -> OpenedTable:
    import h5py

    file = opened.enter_context(h5py.File(path, "r"))
    return columns_of_file(file, path, part)


def columns_of_file(
    file: Any, path: Path, part: str, *, transposed: bool = False, hidden: str = ""
) -> OpenedTable:
    """Return a table of a file's data sets.

    Parameters
    ----------
    file : h5py.File
    path, part
        As chosen by the user.
    transposed : bool
        Whether matrices are stored by columns, as MATLAB writes them.
    hidden : str
        Prefix of internal groups of another program.
    """
    import h5py

    groups: dict[str, dict[str, Any]] = {}
    unused: list[str] = []
    remarks: dict[str, Any] = {}

    def visit(name: str, item: Any) -> None:
        if hidden and name.startswith(hidden):
            return
        if not isinstance(item, h5py.Dataset) or item.size in (0, None):
            return
        group, _, own = name.rpartition("/")
        matlab = _matlab_class(item)
        if matlab == "char" and 1 in item.shape:
            remarks[own] = "".join(map(chr, item[()].ravel()))
        elif matlab in _MATLAB_ONLY or "MATLAB_empty" in item.attrs:
            unused.append(name)
        elif item.dtype.names:
            groups[name] = {each: item.fields(each) for each in item.dtype.names}
        elif item.ndim in (1, 2) and item.size > 1 and item.dtype.kind in "iufbSO":
            groups.setdefault(group or "/", {}).update(_columns(own, item, transposed))
        elif item.size == 1 and item.dtype.kind in "iufbS":
            value = item[()].ravel()[0]
            remarks[own] = value.decode("utf-8", "replace") if item.dtype.kind == "S" else value
        else:
            unused.append(name)

    file.visititems(visit)
    parts: dict[str, dict[str, Any]] = {}
    for name, group in groups.items():
        parts |= tables_by_length(name, group, _size)
    chosen = chosen_part(path, part, {name: list(each) for name, each in parts.items()}, "group")
    sets = parts[chosen]
    remarks |= dict(file.attrs)
    for name, group in groups.items():
        if next(iter(sets.values())) in group.values() and name in file:
            own = file[name].attrs.items()
            remarks |= {key: value for key, value in own if not key.startswith("MATLAB_")}
    channels = [(name, _unit(data), _slices(data)) for name, data in sets.items()]
    notes = [Message("{path}: not read: {names}", path.name, ", ".join(unused))] if unused else []
    return of_channels(channels, _size(next(iter(sets.values()))), remarks, chosen, notes)


_MATLAB_ONLY = ("cell", "function_handle", "table", "timetable", "datetime", "string", "char")


def _matlab_class(item: Any) -> str:
    """Return the class of a MATLAB 7.3 variable: texts are stored as arrays of numbers."""
    name = item.attrs.get("MATLAB_class", b"")
    return name.decode("ascii", "replace") if isinstance(name, bytes) else str(name)


class _Column:
    """A column of a matrix."""

    def __init__(self, data: Any, number: int, transposed: bool) -> None:
        self.data, self.number, self.transposed = data, number, transposed
        self.attrs = data.attrs
        self.size = data.shape[1 if transposed else 0]

    def __getitem__(self, rows: slice) -> Any:
        return self.data[self.number, rows] if self.transposed else self.data[rows, self.number]


def _columns(name: str, data: Any, transposed: bool) -> dict[str, Any]:
    """Return a data set as one column, or as a column for each column of a matrix."""
    if data.ndim == 1 or 1 in data.shape:
        return {name: data}
    count = data.shape[0 if transposed else 1]
    if count > MOST_COLUMNS:
        return {}
    return {f"{name} {number + 1}": _Column(data, number, transposed) for number in range(count)}


def _size(data: Any) -> int:
    return int(data.size) if hasattr(data, "size") else len(data)


def _slices(data: Any) -> Callable[[int, int], Any]:
    """Return a function that reads parts of a data set, by rows or by columns (MATLAB)."""
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


class _Writer:
    """Writer of one data set for each column, with unit and description, in the group `samples`."""

    def __init__(self, file: IO[bytes], schema: Any, remarks: Mapping[str, str], **_: str) -> None:
        import h5py

        self._file = h5py.File(file, "w")
        self._file.attrs.update(remarks)
        self._group = self._file.create_group("samples")
        self._schema = schema

    def write(self, batch: Any) -> None:
        """Append rows."""
        from torquebench.tables.table import numbers_of

        for field, column in zip(self._schema, batch.columns, strict=True):
            text = not _numeric(field.type)
            values = column.to_pylist() if text else numbers_of(column)
            values = ["" if value is None else str(value) for value in values] if text else values
            if field.name not in self._group:
                self._create(field, values, text)
            data = self._group[field.name]
            before = data.shape[0]
            data.resize(before + len(values), axis=0)
            data[before:] = values

    def _create(self, field: Any, values: Any, text: bool) -> None:
        import h5py

        data = self._group.create_dataset(
            field.name,
            shape=(0,),
            maxshape=(None,),
            chunks=(_CHUNK,),
            dtype=h5py.string_dtype() if text else values.dtype,
            compression="gzip",
        )
        data.attrs.update({k.decode(): v.decode() for k, v in (field.metadata or {}).items()})

    def close(self) -> None:
        """Write the end of the file."""
        self._file.close()


def _numeric(kind: Any) -> bool:
    import pyarrow as pa

    return bool(
        pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind)
    )


FORMAT = Format(
    name="hdf5",
    title="HDF5 (.h5)",
    endings=(".h5", ".hdf5", ".hdf"),
    open=_open,
    begins=(b"\x89HDF\r\n\x1a\n",),
    package="h5py",
    extra="hdf5",
    writer=_Writer,
    parts="group",
)
