"""Read tables of calibrations and readings from paths, data frames and mappings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeAlias

import narwhals as nw
import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from torquebench import tables
from torquebench.calibration import CalibrationData
from torquebench.errors import InputError
from torquebench.message import Message

Columns: TypeAlias = Mapping[str, str]
"""Header of each column in the source: ``{"reading": "Drehmoment[kNm]"}``."""
_OPTION = re.compile(r"--column '(\w+)=([^']+)'")


def read_calibration(
    source: Any,
    *,
    range_nm: float | None = None,
    columns: Columns | None = None,
    transducer_serial: str = "",
    counter_identity: str = "",
) -> CalibrationData:
    """Return a calibration from a file, a data frame or a mapping of columns.

    Columns are identified by their names, in any order: ``reading_nm`` and ``standard_nm``, and
    optionally ``series``, ``branch`` ("up", "down"), ``nominal_nm``, ``temperature_c`` and the
    other columns of a calibration's file.

    Parameters
    ----------
    source : path, pandas, polars or pyarrow frame, or mapping of str to column
        A file (CSV, Parquet, Excel, TDMS, MDF4, HDF5), or a table in memory; rows in measuring
        order.
    range_nm : float, optional
        Full scale in N·m; by default that in the file, or the largest torque.
    columns : mapping of str to str, optional
        Headers with other names, and their unit: ``{"reading": "Anzeige[kNm]"}``; a minus sign
        before the header reverses the sign.
    transducer_serial, counter_identity : str
        Transducer and counter of the chain, if the source doesn't state them.

    Raises
    ------
    InputError
        A value can't be used; the message names its row and column, and the remedy.

    Examples
    --------
    >>> import torquebench as tb
    >>> tb.read_calibration({"standard_nm": [0.0, 5.0, 10.0], "reading_nm": [0.1, 5.2, 10.1]})
    CalibrationData(3 points, 10 N·m)
    """
    mapping = mapping_of(columns)
    try:
        if isinstance(source, str | Path):
            return tables.read_calibration(
                source,
                range_nm=range_nm,
                transducer_serial=transducer_serial,
                counter_identity=counter_identity,
                mapping=mapping,
            )
        table = tables.table_of_arrow(arrow_table(source), "the table")
        chain = ("", transducer_serial, counter_identity)
        return tables.calibration_of(table, range_nm, False, chain, mapping).data
    except InputError as problem:
        raise in_python(problem) from None


def mapping_of(columns: Columns | None) -> tuple[str, ...]:
    """Convert headers to the form of the commands' options."""
    return tuple(f"{name}={header}" for name, header in (columns or {}).items())


def in_python(problem: InputError) -> InputError:
    """Replace command options in an error's texts by the Python parameter."""
    texts = (problem.found, problem.allowed, problem.remedy)
    return InputError(*(_OPTION.sub(r'columns={"\1": "\2"}', text) for text in texts))


def arrow_table(source: Any) -> Any:
    """Convert a source to an Arrow table.

    Raises
    ------
    InputError
        The source can't be read, or isn't a table.
    """
    if isinstance(source, str | Path):
        return _of_file(Path(source))
    if isinstance(source, Mapping):
        return pa.table({name: pa.array(np.asarray(each)) for name, each in source.items()})
    frame = nw.from_native(source, eager_only=True, pass_through=True)
    if isinstance(frame, nw.DataFrame):
        return frame.to_arrow()
    if hasattr(source, "__arrow_c_stream__"):
        return pa.table(source)
    raise InputError(
        Message("a {name} instead of a table", type(source).__name__),
        "a path, a frame of pandas, polars or pyarrow, or a mapping of names to columns",
    )


def _of_file(path: Path) -> Any:
    table = tables.read_table(path)
    columns: list[Any] = []
    for index, cells in enumerate(table.cells):
        if not isinstance(cells, list):
            columns.append(cells if not isinstance(cells, np.ndarray) else pa.array(cells))
            continue
        try:
            columns.append(pa.array(table.numbers(index)))
        except InputError:
            columns.append(pa.array(cells, pa.string()))
    made = pa.Table.from_arrays(columns, list(table.names))
    return made.replace_schema_metadata(dict(table.remarks) or None)


def with_columns(source: Any, added: Mapping[str, NDArray[np.float64]]) -> Any:
    """Add columns to a frame and return the same kind; return other sources as Arrow.

    Raises
    ------
    InputError
        The source already has a column with such a name.
    """
    frame = nw.from_native(source, eager_only=True, pass_through=True)
    if not isinstance(frame, nw.DataFrame):
        frame = nw.from_native(arrow_table(source), eager_only=True)
    for name in added:
        if name in frame.columns:
            raise InputError(
                Message("readings with a column {name} already", name),
                "readings without it",
                "rename it",
            )
    backend = frame.implementation
    columns = [nw.new_series(name, values, backend=backend) for name, values in added.items()]
    if backend.is_pandas():
        index = nw.maybe_get_index(frame)
        columns = [nw.maybe_set_index(each, index=index) for each in columns]
    return frame.with_columns(*columns).to_native()
