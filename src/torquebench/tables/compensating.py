"""Compensation of files of any length, block by block: little memory, two cores, progress."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from torquebench.atomic_write import atomic_file
from torquebench.columns import column_of
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, SHARES, Progress
from torquebench.tables.conversion import Conversion
from torquebench.tables.formats import check_read, check_written, format_of, formats
from torquebench.tables.reading import OpenTable, open_table
from torquebench.tables.readings import ADDED_COLUMNS, ReadingsTable, TableColumns
from torquebench.tables.table import Table, strings_of

Compensate = Callable[[ReadingsTable], tuple[NDArray[np.float64], ...]]
"""Function from readings to torque, additional torque and expanded uncertainty, all in N·m."""

Follow = Callable[[ReadingsTable, ReadingsTable | None], tuple[NDArray[np.float64], ...]]
"""The same function for successive blocks: it gets each block together with the following one."""

_BLOCK_ROWS = 1 << 16
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
        Extremes of the additional torque.
    largest_uncertainty_nm : float
        Largest expanded uncertainty.
    """

    rows: int
    simulated: bool
    lowest_nm: float
    highest_nm: float
    largest_uncertainty_nm: float


class _Encoded(NamedTuple):
    lines: Any
    figures: tuple[int, float, float, float]
    """Rows, extremes of the additional torque, and largest U."""


def compensate_file(
    source: Path,
    target: Path,
    compensate: Compensate,
    *,
    timed: Follow | None = None,
    mapping: Sequence[str] = (),
    conversion: Conversion | None = None,
    check: Callable[[Table, TableColumns], None] = lambda _table, _columns: None,
    progress: Progress = NO_PROGRESS,
) -> CompensatedFile:
    """Compensate a file of readings, and write the result as a new file, atomically.

    The target has all columns of the source, unchanged, and then `ADDED_COLUMNS`. CSV keeps
    separator and decimal mark.

    Parameters
    ----------
    source : pathlib.Path
        File in any readable format; ``-`` is CSV from standard input.
    target : pathlib.Path
        File in any writable format, chosen by its ending; see `atomic_write` for links, pipes and
        ``-``.
    compensate : callable
        Called for each block, in any order, from two threads.
    timed : callable, optional
        Called instead if the file has ``time_s``, for blocks in the order of time.
    mapping : sequence of str
        ``name=Header[unit]`` for columns with other names; see `understand`.
    conversion : Conversion, optional
        Conversion of signals, forces and masses to torques.
    check : callable
        Called with the table without rows, and with its columns, before anything is written; may
        refuse it.
    progress : Progress, optional
        Receives one stage of `SHARES` steps.

    Raises
    ------
    InputError
        A value is unsuitable; the message states file, row and column.
    """
    check_read(source)
    check_written(target)
    with ExitStack() as opened:
        file = open_table(source, opened, rows=_BLOCK_ROWS)
        for name in ADDED_COLUMNS:
            if name in file.empty:
                raise InputError(
                    Message("{origin} has a column {name} already", source, name),
                    "readings without it",
                    "rename or remove it",
                )
        columns = TableColumns(file.empty, ("reading_nm",), mapping, conversion)
        check(file.empty, columns)
        found: list[tuple[int, float, float, float]] = []
        progress.start(Message("Compensating {source}", source), SHARES)
        written = _Written(opened, target, file)

        def readings(raw: Any) -> ReadingsTable | None:
            table = file.piece(raw)
            return None if table is None else ReadingsTable.of(table, columns)

        def encoded(block: ReadingsTable, added: tuple[NDArray[np.float64], ...]) -> _Encoded:
            _, additional, expanded = added
            extremes = (float(np.min(additional)), float(np.max(additional)))
            figures = (additional.size, *extremes, float(np.max(expanded)))
            return _Encoded(written.encoded(block, added), figures)

        def work(raw: Any) -> _Encoded | None:
            block = readings(raw)
            return None if block is None else encoded(block, compensate(block))

        done: Iterator[tuple[_Encoded | None, float]] = _in_order(work, file.raw())
        if timed is not None and "time_s" in columns:
            done = _followed(_in_order(readings, file.raw()), timed, encoded)
        for result, share in done:
            if result is not None:
                written.write(result.lines)
                found.append(result.figures)
            progress.reach(int(SHARES * share))
        if not found:
            raise InputError(
                Message("{origin} holds a header but no values", source), "at least one reading"
            )
        written.close()
    rows, lowest, highest, largest = zip(*found, strict=True)
    return CompensatedFile(sum(rows), file.empty.simulated, min(lowest), max(highest), max(largest))


def _followed(
    blocks: Iterable[tuple[ReadingsTable | None, float]],
    follow: Follow,
    encoded: Callable[[ReadingsTable, tuple[NDArray[np.float64], ...]], _Encoded],
) -> Iterator[tuple[_Encoded, float]]:
    """Compensate blocks in order, each as soon as the following one has been read."""
    waiting: ReadingsTable | None = None
    reached = 0.0
    for block, share in blocks:
        if block is None:
            continue
        if waiting is not None:
            yield encoded(waiting, follow(waiting, block)), reached
        waiting, reached = block, share
    if waiting is not None:
        yield encoded(waiting, follow(waiting, None)), 1.0


def _in_order(
    work: Callable[[Any], Any], pieces: Iterable[tuple[Any, float]]
) -> Iterator[tuple[Any, float]]:
    """Process pieces in two threads; yield the results in the order of the pieces."""
    waiting: deque[tuple[Future[Any], float]] = deque()
    iterator = iter(pieces)
    for piece, share in iterator:  # the first piece alone, because it compiles the kernels
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


class _Written:
    """The target file: columns of the source, unchanged, and the added ones."""

    def __init__(self, opened: ExitStack, target: Path, file: OpenTable) -> None:
        self._opened, self._target, self._file = opened, target, file
        self._format = format_of(target) or formats()[0]
        self._writer: Any = None
        self._schema: Any = None

    def encoded(self, block: ReadingsTable, added: tuple[NDArray[np.float64], ...]) -> Any:
        """Return a block in the target's format; the first block determines the types."""
        cells = [_arrow(each) for each in block.table.cells]
        text = self._format.name == "csv"
        if self._writer is None:
            self._begin(block.table, cells, text)
        if not text:
            cells = [
                self._cast(each, field) for each, field in zip(cells, self._schema, strict=False)
            ]
        table = pa.table([*cells, *map(_numbers, added)], schema=self._schema)
        return self._writer.encoded(table, quoted=block.table.quoted) if text else table

    def _begin(self, table: Table, cells: Sequence[Any], text: bool) -> None:
        comma = table.separator != "," and "," in table.shared
        fields = []
        for index, (name, column) in enumerate(zip(table.names, cells, strict=True)):
            kind, metadata = column.type, None
            if self._file.schema is not None:
                metadata = self._file.schema.field(index).metadata
                name = self._file.schema.field(index).name if not text else name
            elif not text and pa.types.is_string(kind):
                kind = _settled(column)
            fields.append(pa.field(name, kind, metadata=metadata))
        fields += [
            pa.field(name, pa.float64(), metadata=column_of(name).attributes)
            for name in ADDED_COLUMNS
        ]
        self._schema = pa.schema(fields)
        assert self._format.writer is not None
        self._writer = self._format.writer(
            self._opened.enter_context(atomic_file(self._target)),
            self._schema,
            table.remarks,
            separator=table.separator.replace(" ", "\t"),
            decimal="," if comma else ".",
        )

    def _cast(self, column: Any, field: Any) -> Any:
        try:
            return column.cast(field.type)
        except pa.ArrowInvalid as error:
            raise InputError(
                Message(
                    "{origin}: a column of numbers contains other values ({error})",
                    self._file.empty.origin,
                    error,
                ),
                "one kind of value in each column",
                "correct the column, or write CSV",
            ) from error

    def write(self, encoded: Any) -> None:
        """Append the result of `encoded`."""
        self._writer.write(encoded)

    def close(self) -> None:
        """Write the end of the file."""
        self._writer.close()


def _settled(column: Any) -> Any:
    """Return the type of a text column: float64 if all its cells are numbers."""
    try:
        pc.cast(column, pa.float64())
    except pa.ArrowInvalid:
        return column.type
    return pa.float64()


def _arrow(cells: Any) -> Any:
    if isinstance(cells, list):
        return pa.chunked_array([strings_of(cells)])
    if isinstance(cells, np.ndarray):
        return pa.chunked_array([_numbers(cells)])
    return cells if isinstance(cells, pa.ChunkedArray) else pa.chunked_array([cells])


def _numbers(values: NDArray[np.float64]) -> Any:
    """Return numbers as Arrow without a copy; `pyarrow.array` would import pandas."""
    buffer = pa.py_buffer(np.ascontiguousarray(values, dtype=np.float64))
    return pa.Array.from_buffers(pa.float64(), values.size, [None, buffer])
