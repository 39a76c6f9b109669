"""A measured record: columns of equal length over time, and a buffer of its most recent rows."""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals.faults import PulseTrainFault, SignalFaultKind

Column = NDArray[Any]


class Record:
    """Measured values in time order: equal-length columns by the names of `torquebench.columns`.

    The column `time_s` is the time axis that some methods use; `fault` holds codes of
    `SignalFaultKind`. A column may have further axes beside its rows.

    Parameters
    ----------
    columns : mapping of str to array_like
        Arrays of one length, or single values for all rows.

    Raises
    ------
    InputError
        Columns of different lengths.

    Examples
    --------
    >>> record = Record({"time_s": [0.0, 0.1, 0.2], "speed_rpm": 5.0})
    >>> len(record), record["speed_rpm"].tolist(), record.window(0.1, 0.2)["time_s"].tolist()
    (3, [5.0, 5.0, 5.0], [0.1])
    """

    __slots__ = ("_columns", "_size")

    def __init__(self, columns: Mapping[str, Any]) -> None:
        arrays = {name: np.asarray(values) for name, values in columns.items()}
        sizes = {values.shape[0] for values in arrays.values() if values.ndim}
        if len(sizes) > 1:
            raise InputError(
                Message("columns of {sizes} rows", ", ".join(str(size) for size in sorted(sizes))),
                "columns of one length",
            )
        self._size = sizes.pop() if sizes else 0
        self._columns: dict[str, Column] = {
            name: values if values.ndim else np.full(self._size, values)
            for name, values in arrays.items()
        }

    @classmethod
    def unchecked(cls, columns: dict[str, Column], size: int) -> Record:
        """Return a record of arrays that are known to have one length."""
        record = cls.__new__(cls)
        record._columns, record._size = columns, size
        return record

    def __len__(self) -> int:
        return self._size

    def __contains__(self, name: str) -> bool:
        return name in self._columns

    def __getitem__(self, name: str) -> Column:
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    @property
    def time_s(self) -> NDArray[np.float64]:
        """The time axis, s."""
        return self._columns["time_s"]

    def get(self, name: str) -> Column | None:
        """Return a column; None if the record doesn't have it."""
        return self._columns.get(name)

    def at(self, rows: slice | NDArray[Any]) -> Record:
        """Return the selected rows."""
        columns = {name: values[rows] for name, values in self._columns.items()}
        return Record.unchecked(columns, next(iter(columns.values())).shape[0] if columns else 0)

    def window(self, start_s: float, stop_s: float) -> Record:
        """Return the rows whose times lie in [start, stop)."""
        first, stop = self.time_s.searchsorted((start_s, stop_s)).tolist()
        return self.at(slice(first, stop))

    def with_columns(self, **columns: Column) -> Record:
        """Return the record with added or replaced columns, which have its length."""
        return Record.unchecked({**self._columns, **columns}, self._size)

    @classmethod
    def join(cls, records: Sequence[Record]) -> Record:
        """Concatenate records of the same columns."""
        first = records[0]
        if len(records) == 1:
            return first
        return cls.unchecked(
            {name: np.concatenate([record._columns[name] for record in records]) for name in first},
            sum(map(len, records)),
        )

    # -- faults -----------------------------------------------------------------------------

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether each row is without a fault."""
        return np.equal(self["fault"], np.uint8(SignalFaultKind.NONE))

    def marked(self, rows: NDArray[np.bool_], kind: SignalFaultKind, *values: str) -> Record:
        """Return the record with a fault in more rows, and NaN in some columns there."""
        new = rows & self.valid
        if not new.any():
            return self
        columns = {name: np.where(new, np.nan, self._columns[name]) for name in values}
        return self.with_columns(fault=np.where(new, np.uint8(kind), self["fault"]), **columns)

    def raise_on_fault(self, channel: str = "signal") -> Record:
        """Return the record itself if no row has a fault.

        Raises
        ------
        PulseTrainFault
            If a row has a fault; with its kind and time, and the number of faulty rows.
        """
        faulty = np.flatnonzero(self["fault"])
        if faulty.size:
            first = int(faulty[0])
            kind = SignalFaultKind(int(self["fault"][first]))
            raise PulseTrainFault(
                kind,
                Message(
                    "{channel}: {description} at {time_s:.6g} s ({size} of {count} windows faulty)",
                    channel,
                    kind.description,
                    self.time_s[first],
                    faulty.size,
                    len(self),
                ),
            )
        return self


class History:
    """Buffer of the most recent rows of a record, for one writer and many readers.

    Parameters
    ----------
    capacity : int
        Largest number of rows.
    """

    def __init__(self, capacity: int) -> None:
        self.capacity = capacity
        self._columns: dict[str, Column] = {}
        self._wide: list[str] = []  # columns with further axes
        self._size = self._next = 0  # number of rows, and index of the next one
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return self._size

    def append(self, record: Record) -> None:
        """Append rows that follow the earlier ones in time; other columns restart the buffer."""
        if not len(record):
            return
        if len(record) > self.capacity:
            record = record.at(slice(-self.capacity, None))
        new, count = record._columns, len(record)
        with self._lock:
            if new.keys() != self._columns.keys() or (
                self._wide
                and any(new[name].shape[1:] != self._columns[name].shape[1:] for name in self._wide)
            ):
                self._begin(new)
            begin = self._next
            if count == 1:  # a live block's only window
                for name, values in self._columns.items():
                    values[begin] = new[name][0]
            elif begin + count <= self.capacity:
                rows = slice(begin, begin + count)
                for name, values in self._columns.items():
                    values[rows] = new[name]
            else:
                first = self.capacity - begin
                for name, values in self._columns.items():
                    values[begin:] = new[name][:first]
                    values[: count - first] = new[name][first:]
            self._next = (begin + count) % self.capacity
            self._size = min(self._size + count, self.capacity)

    def _begin(self, columns: Mapping[str, Column]) -> None:
        """Restart the buffer with these columns."""
        self._columns = {
            name: np.empty((self.capacity, *values.shape[1:]), values.dtype)
            for name, values in columns.items()
        }
        self._wide = [name for name, values in columns.items() if values.ndim > 1]
        self._size = self._next = 0

    def _segments(self) -> tuple[slice, ...]:
        """Return slices of the buffer with the rows in the order of their times."""
        if self._size < self.capacity or not self._next:
            return (slice(0, self._size),)
        return slice(self._next, self.capacity), slice(0, self._next)

    def _copied(self, parts: Sequence[slice]) -> Record:
        """Return a copy of these rows, so that the writer can go on."""
        if len(parts) == 1:
            rows = parts[0]
            columns = {name: values[rows].copy() for name, values in self._columns.items()}
        else:
            columns = {
                name: np.concatenate([values[part] for part in parts])
                for name, values in self._columns.items()
            }
        return Record.unchecked(columns, sum(part.stop - part.start for part in parts))

    def window(self, start_s: float, stop_s: float) -> Record | None:
        """Return the rows whose times lie in [start, stop); None before any row was appended."""
        with self._lock:
            if not self._size:
                return None
            time_s, parts = self._columns["time_s"], []
            for segment in self._segments():
                first, stop = time_s[segment].searchsorted((start_s, stop_s)).tolist()
                parts.append(slice(segment.start + first, segment.start + max(first, stop)))
            return self._copied(parts)

    def latest(self, count: int = 1) -> Record | None:
        """Return the newest rows, at most `count`; None before any row was appended."""
        with self._lock:
            if not self._size:
                return None
            wanted, parts = min(count, self._size), []
            for segment in reversed(self._segments()):
                first = max(segment.stop - wanted, segment.start)
                parts.append(slice(first, segment.stop))
                wanted -= segment.stop - first
            return self._copied(parts[::-1])
