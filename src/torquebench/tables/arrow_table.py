"""Arrow tables as readings and calibrations: from Parquet files and data frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.columns import (
    DIRECTION_REMEDY,
    WORDS_ALLOWED,
    of_loading,
    understood,
    word_values,
)
from torquebench.tables.csv_text import CsvTable, what_number
from torquebench.tables.files import cell_texts, headers, remarks_of
from torquebench.tables.readings import READING_COLUMNS, ReadingsTable

__all__ = ["ArrowReadings", "numbers_of"]


class ArrowReadings:
    """Finds the columns of readings in a schema, and reads them batch by batch.

    Parameters
    ----------
    origin : str
        Its name in messages.
    schema : pyarrow.Schema
    mapping : sequence of str
        ``name=Header[unit]`` of columns that have other names; see `columns.understood`.
    """

    def __init__(self, origin: str, schema: Any, mapping: Sequence[str] = ()) -> None:
        self.origin = origin
        self.names = headers(schema, origin)
        self.header = tuple(name.lower() for name in self.names)
        self.remarks = remarks_of(schema)
        self.simulated = self.remarks.get("simulated", "").lower() in ("true", "yes", "1")
        self._table = CsvTable(origin, ",", self.header, (), (), self.remarks, "row", self.names)
        named, self._columns = understood(self._table, ("reading_nm",), mapping)
        self.timed = "time_s" in self._columns
        self._names = named.header

    def readings(self, batch: Any, before: int = 0) -> ReadingsTable:
        """Return the readings of a batch or table.

        Parameters
        ----------
        batch : pyarrow.RecordBatch or pyarrow.Table
        before : int
            Rows before it, for messages.
        """
        numbers = {}
        for key in READING_COLUMNS:
            if key in self._columns:
                header, factor = self._columns[key]
                column = batch.column(self.header.index(header))
                values = self._numbers(column, header, before)
                numbers[key] = values if factor == 1.0 else values * factor
        self._name_branch(batch)
        branch = self._words("branch", batch, before)
        self._check_direction(numbers["reading_nm"], batch, before)
        table = replace(self._table, lines=range(before + 1, before + 1 + batch.num_rows))
        return ReadingsTable(table, numbers, branch, self.simulated)

    def _numbers(self, column: Any, header: str, before: int) -> NDArray[np.float64]:
        try:
            values = numbers_of(pc.cast(column, pa.float64()))
        except pa.ArrowInvalid as error:
            row, word = _first_word(column)
            raise InputError(
                Message(
                    "{origin}, row {row}, column {name}: {word!r}",
                    self.origin,
                    before + row + 1,
                    header,
                    word,
                ),
                *what_number(word),
            ) from error
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            found = "no value" if not column[int(bad[0])].is_valid else str(values[bad[0]])
            raise InputError(
                Message(
                    "{origin}, row {row}, column {name}: {word}",
                    self.origin,
                    before + int(bad[0]) + 1,
                    header,
                    found,
                ),
                "a number in every cell",
                "remove the row or measure the point again",
            )
        return values

    def _name_branch(self, batch: Any) -> None:
        """Use the direction of loading as the branch."""
        if "direction" in self._names and "branch" not in self._names:
            at = self._names.index("direction")
            if of_loading(cell_texts(pc.unique(batch.column(at)))):
                self._names = (*self._names[:at], "branch", *self._names[at + 1 :])

    def _words(self, name: str, batch: Any, before: int) -> NDArray[np.int8] | None:
        if name not in self._names:
            return None
        column = batch.column(self._names.index(name))
        if isinstance(column, pa.ChunkedArray):
            column = column.combine_chunks()
        encoded = column.dictionary_encode(null_encoding="encode")
        meaning = word_values(name)
        words = cell_texts(encoded.dictionary)
        places = numbers_of(encoded.indices)
        for number, word in enumerate(words):
            if word.lower() not in meaning:
                row = before + int(np.argmax(places == number)) + 1
                raise InputError(
                    Message(
                        "{origin}, row {row}, column {name}: {word!r}", self.origin, row, name, word
                    ),
                    WORDS_ALLOWED[name],
                )
        signs = np.array([meaning[word.lower()] for word in words], dtype=np.int8)
        return np.asarray(signs[places])

    def _check_direction(self, reading: NDArray[np.float64], batch: Any, before: int) -> None:
        direction = self._words("direction", batch, before)
        if direction is None:
            return
        for row in np.flatnonzero(direction * np.sign(reading) < 0):
            raise InputError(
                Message(
                    "{origin}, row {before}, column direction: {value} beside {reading:.6g} N·m",
                    self.origin,
                    before + int(row) + 1,
                    "clockwise" if direction[row] > 0 else "counter-clockwise",
                    reading[row],
                ),
                *DIRECTION_REMEDY,
            )


def numbers_of(column: Any) -> NDArray[Any]:
    """Return a column of numbers as NumPy has it, NaN where it has no value.

    `to_numpy` imports pandas if there is one, which takes longer than a file of 10⁶ rows.
    """
    if isinstance(column, pa.ChunkedArray):
        column = column.combine_chunks()
    boolean = pa.types.is_boolean(column.type)
    plain = boolean or pa.types.is_integer(column.type) or pa.types.is_floating(column.type)
    if column.null_count or len(column) == 0 or not plain:
        return np.asarray(column.to_numpy(zero_copy_only=False))
    if not boolean:
        return np.from_dlpack(column)
    bits = np.unpackbits(np.frombuffer(column.buffers()[1], np.uint8), bitorder="little")
    return bits[column.offset : column.offset + len(column)].astype(np.bool_)


def _first_word(column: Any) -> tuple[int, str]:
    """Return row and text of the first cell that isn't a number."""
    for row, text in enumerate(cell_texts(column)):
        try:
            float(text or 0.0)
        except ValueError:
            return row, text
        if text != text.strip() or "_" in text:  # Python reads these, Arrow doesn't
            return row, text
    return 0, str(column[0])
