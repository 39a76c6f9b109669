"""MATLAB's .mat: version 5 to 7 by SciPy, 7.3 (HDF5) by h5py."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.formats import (
    Format,
    OpenedTable,
    chosen_part,
    of_channels,
    tables_by_length,
)
from torquebench.tables.formats.hdf5 import MOST_COLUMNS, columns_of_file

_HDF5 = b"\x89HDF"
_OBJECTS = ("None", "__function_workspace__")
"""Names under which SciPy returns objects, such as timetables, which only MATLAB can read."""


def _open(path: Path, part: str, opened: ExitStack) -> OpenedTable:
    with path.open("rb") as file:
        head = file.read(4)
        file.seek(512)
        if _HDF5 in (head, file.read(4)):
            return _open_hdf5(path, part, opened)
    from scipy.io import loadmat

    content = loadmat(path, appendmat=False, struct_as_record=True)
    groups: dict[str, dict[str, Any]] = {"": {}}
    remarks: dict[str, str] = {}
    notes: list[str] = []
    unused: list[str] = []
    for name, value in content.items():
        if name in _OBJECTS:
            if name == "None":
                notes.append(
                    Message(
                        "{path}: a table, timetable or object, which only MATLAB can read, isn't "
                        "read: save its columns as arrays",
                        path.name,
                    )
                )
        elif not name.startswith("__"):
            _sort(name, value, groups, remarks, unused)
    parts: dict[str, dict[str, Any]] = {}
    for name, group in groups.items():
        parts |= tables_by_length(name, group, len)
    if not parts and notes:
        raise InputError(
            notes[0],
            "arrays of numbers, one a quantity",
            "in MATLAB: time = t.Time; torque = t.Torque; save('data.mat', 'time', 'torque')",
        )
    if unused:
        notes.append(Message("{path}: not read: {names}", path.name, ", ".join(unused)))
    chosen = chosen_part(path, part, {name: list(each) for name, each in parts.items()}, "variable")
    columns = parts[chosen]
    channels = [(name, "", _reader(values)) for name, values in columns.items()]
    return of_channels(channels, len(next(iter(columns.values()))), remarks, chosen, notes)


def _reader(values: Any) -> Any:
    return lambda start, count: values[start : start + count]


def _sort(
    name: str,
    value: Any,
    groups: dict[str, dict[str, Any]],
    remarks: dict[str, str],
    unused: list[str],
) -> None:
    """Assign a variable to columns, to remarks, or to the columns of a structure."""
    if value.dtype.names and value.size == 1:
        for field in value.dtype.names:
            inner = value[field].item()
            if not hasattr(inner, "dtype") or not _sort_array(
                field, inner, groups.setdefault(name, {}), remarks
            ):
                unused.append(f"{name}.{field}")
    elif value.dtype.names or not _sort_array(name, value, groups[""], remarks):
        unused.append(name)


def _sort_array(name: str, value: Any, columns: dict[str, Any], remarks: dict[str, str]) -> bool:
    """Use an array as columns or as a remark; return whether it is suitable."""
    kind = value.dtype.kind
    if (kind in "US" and value.size == 1) or (kind in "iufb" and value.size == 1):
        remarks[name] = str(value.item())
    elif kind in "iufb" and value.ndim == 2 and value.size:
        columns.update(_columns(name, value))
    else:
        return False
    return True


def _columns(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if 1 in value.shape:
        yield name, value.ravel()
    elif value.shape[1] <= MOST_COLUMNS:
        for number in range(value.shape[1]):
            yield f"{name} {number + 1}", value[:, number]


def _open_hdf5(path: Path, part: str, opened: ExitStack) -> OpenedTable:
    try:
        import h5py
    except ImportError:
        raise InputError(
            Message("{name}: MATLAB 7.3 without the package h5py", path.name),
            "MATLAB 7 (save -v7), or the package",
            'install it: pip install "torquebench[hdf5]"',
        ) from None

    file = opened.enter_context(h5py.File(path, "r"))
    return columns_of_file(file, path, part, transposed=True, hidden="#")


class _Writer:
    """Writer of version 5, one array for each column; it keeps the table in memory."""

    def __init__(self, file: IO[bytes], schema: Any, remarks: Mapping[str, str], **_: str) -> None:
        self._file, self._schema, self._remarks = file, schema, remarks
        self._batches: list[Any] = []

    def write(self, batch: Any) -> None:
        """Store rows."""
        import pyarrow as pa

        self._batches.append(batch if isinstance(batch, pa.Table) else pa.table(batch))

    def close(self) -> None:
        """Write the file."""
        import re

        import numpy as np
        import pyarrow as pa
        from scipy.io import savemat

        from torquebench.tables.table import numbers_of

        table = pa.concat_tables(self._batches) if self._batches else self._schema.empty_table()
        content: dict[str, Any] = {}
        for name, column in zip(self._schema.names, table.columns, strict=True):
            numeric = not (pa.types.is_string(column.type) or pa.types.is_nested(column.type))
            values = numbers_of(column) if numeric else np.array(column.to_pylist(), dtype=object)
            variable = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_")[:31] or "column"
            content[variable if variable[0].isalpha() else f"c_{variable}"[:31]] = values
        content |= {re.sub(r"\W", "_", k)[:31]: v for k, v in self._remarks.items()}
        savemat(self._file, content, oned_as="column")  # type: ignore[arg-type] # a file, too


FORMAT = Format(
    name="matlab",
    title="MATLAB (.mat)",
    endings=(".mat",),
    open=_open,
    begins=(b"MATLAB",),
    writer=_Writer,
    parts="variable",
)
