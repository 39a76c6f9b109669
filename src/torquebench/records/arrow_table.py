"""Columns of Arrow as readings and calibrations: of Parquet files and of data frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.records.columns import understood, word_values
from torquebench.records.csv_text import CsvTable
from torquebench.records.tables import READING_QUANTITIES, ReadingsTable

__all__ = ["NUMBERS", "ArrowReadings", "cells_of"]

NUMBERS = ("reading_nm", *READING_QUANTITIES)
"""Columns of numbers that readings may have."""


def cells_of(table: Any, origin: str) -> CsvTable:
    """Return an Arrow table as cells of text, which small tables are read from.

    Parameters
    ----------
    table : pyarrow.Table
    origin : str
        What messages call it.
    """
    columns = [["" if cell is None else str(cell) for cell in each.to_pylist()] for each in table]
    return CsvTable(
        origin,
        ",",
        tuple(str(name).strip().lower() for name in table.column_names),
        tuple(zip(*columns, strict=True)),
        range(1, table.num_rows + 1),
        _remarks(table.schema),
        "row",
    )


def _remarks(schema: Any) -> dict[str, str]:
    notes = {key.decode(): value.decode() for key, value in (schema.metadata or {}).items()}
    own = ("ARROW:schema", "pandas")
    return {key: value for key, value in notes.items() if key not in own and "\n" not in value}


class ArrowReadings:
    """Finds the columns of readings in a schema, and reads them batch by batch.

    Parameters
    ----------
    origin : str
        What messages call it.
    schema : pyarrow.Schema
    mapping : sequence of str
        ``name=Header[unit]`` of columns that have other names; see `columns.understood`.
    """

    def __init__(self, origin: str, schema: Any, mapping: Sequence[str] = ()) -> None:
        self.origin = origin
        self.header = tuple(name.lower() for name in schema.names)
        self.remarks = _remarks(schema)
        self.simulated = self.remarks.get("simulated", "").lower() in ("true", "yes", "1")
        self._table = CsvTable(origin, ",", self.header, (), (), self.remarks, "row")
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
        for key in NUMBERS:
            if key in self._columns:
                header, factor = self._columns[key]
                column = batch.column(self.header.index(header))
                numbers[key] = self._numbers(column, header, before) * factor
        branch = None
        if "branch" in self._names:
            branch = self._branch(batch.column(self._names.index("branch")), before)
        return ReadingsTable(
            replace(self._table, lines=range(before + 1, before + 1 + batch.num_rows)),
            numbers["reading_nm"],
            branch,
            None,
            numbers.get("speed_rpm"),
            numbers.get("temperature_c"),
            numbers.get("standard_error_nm"),
            numbers.get("time_s"),
            numbers.get("acceleration_rad_s2"),
            self.simulated,
        )

    def _numbers(self, column: Any, header: str, before: int) -> NDArray[np.float64]:
        try:
            values = np.asarray(pc.cast(column, pa.float64()).to_numpy(zero_copy_only=False))
        except pa.ArrowInvalid as error:
            raise InputError(f"{self.origin}, column {header}: {error}", "numbers") from error
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            found = "no value" if not column[int(bad[0])].is_valid else str(values[bad[0]])
            raise InputError(
                f"{self.origin}, row {before + int(bad[0]) + 1}, column {header}: {found}",
                "a number in every cell",
                "remove the row or measure the point again",
            )
        return values

    def _branch(self, column: Any, before: int) -> NDArray[np.int8]:
        meaning = word_values("branch")
        words = [str(word).lower() for word in column.to_pylist()]
        for row, word in enumerate(words):
            if word not in meaning:
                raise InputError(
                    f"{self.origin}, row {before + row + 1}, column branch: {word!r}",
                    "up, down or unknown (or +1, -1, 0)",
                )
        return np.array([meaning[word] for word in words], dtype=np.int8)
