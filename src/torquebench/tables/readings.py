"""Tables of calibrations, readings and empty runs: reading with specific errors, and writing."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.atomic_write import atomic_write
from torquebench.calibration import (
    OPTIONAL_COLUMNS,
    RANGE_MARGIN,
    CalibrationData,
    infer_branch,
    infer_series,
    plainest,
)
from torquebench.chain import EmptyRun, Readings, readings_of_rows, stretches
from torquebench.chain.readings import MEASURED
from torquebench.compensation import BRANCH_WORDS, ReadingScale, StoredModel
from torquebench.errors import InputError, ModelMismatchError
from torquebench.message import Message
from torquebench.tables.conversion import Conversion, MissingSensitivityError, Sensitivity
from torquebench.tables.headers import WORD, Understood, names_header, understand
from torquebench.tables.isolated import Limits
from torquebench.tables.reading import LIMITS, read_table
from torquebench.tables.remarks import reference_in, reference_remarks
from torquebench.tables.table import Table
from torquebench.tables.units import BASE, unit_named
from torquebench.units import UNIT_OF_ENDING

FloatArray = NDArray[np.float64]

NUMERIC_COLUMNS = tuple(
    dict.fromkeys(
        ("reading_nm", "standard_nm", *OPTIONAL_COLUMNS, "time_s", *MEASURED, "standard_error_nm")
    )
)
"""Columns of calibration and reading tables, each in the unit at the end of its name."""
READING_COLUMNS = ("reading_nm", "time_s", *MEASURED, "standard_error_nm")
"""Numeric columns of a file of readings; all but the first are optional."""
ADDED_COLUMNS = ("torque_nm", "additional_torque_nm", "expanded_uncertainty_nm")
"""Columns that compensation adds to a table of readings."""
LABELS = ("series", "branch", "direction")
_STEADY = "steady"
"""Comment in a table of steady means, such as the points of a calibration."""
_TARED = "tared"
"""Comment in a table whose readings have the zero of their series subtracted."""
_WINDOW = "window_s"
"""Comment with the window length of a table's readings."""
_DAY = "measured_on"
"""Comment with the day of a measurement, for the age of the calibration."""
_NEWTON_METRE = unit_named("N·m", "torque")
_SCALE = "reading_scale"
"""Comment with the original unit of the readings, as `ReadingScale.text`."""
_TEXTS = ("side", "transducer_serial", "counter_identity")
_LARGEST_RATIO = 10.0
"""Largest ratio between the largest reading and the largest torque of the standard; beyond it, a
unit or a column is wrong.
"""
_MOST_STEPS = 2000
"""Largest number of points in a loading sequence; larger tables are recordings."""
_DIRECTIONS = {
    **dict.fromkeys(("cw", "clockwise", "+", "+1", "1", "rechts", "im uhrzeigersinn", "顺时针"), 1),
    **dict.fromkeys(("droite", "horaire", "horario", "derecha", "時計回り", "右"), 1),
    **dict.fromkeys(
        (
            *("ccw", "counter-clockwise", "counterclockwise", "-", "-1"),
            *("links", "gegen den uhrzeigersinn", "逆时针"),
            *("gauche", "antihoraire", "anti-horaire", "antihorario", "izquierda"),
            *("反時計回り", "左"),
        ),
        -1,
    ),
}
_ALLOWED = {
    "branch": "up, down or unknown (or +1, -1, 0)",
    "direction": "clockwise or counter-clockwise (cw, ccw)",
}


def _quantity(column: str) -> tuple[str, str, float]:
    """Return a column's name without its unit, its kind, and the factor of its unit.

    >>> _quantity("zero_temperature_c"), _quantity("acceleration_rad_s2")
    (('zero_temperature', 'temperature', 1.0), ('acceleration', 'acceleration', 1.0))
    """
    ending = next(end for end in UNIT_OF_ENDING if column.endswith(end))
    for kind in BASE:
        unit = unit_named(UNIT_OF_ENDING[ending], kind)
        if unit is not None:
            return column.removesuffix(ending), kind, unit.factor
    raise AssertionError(column)


_QUANTITIES = {column: _quantity(column) for column in NUMERIC_COLUMNS}
_WANTED: Mapping[str, str] = {
    **{name: kind for name, kind, _ in _QUANTITIES.values()},
    **dict.fromkeys(LABELS, WORD),
}


def check_model(stored: StoredModel, table: Table, columns: TableColumns) -> None:
    """Refuse a table of another transducer, counter, range or unit than a model's.

    Properties that the table doesn't state aren't compared.

    Raises
    ------
    ModelMismatchError
    """
    made, remarks = stored.provenance, table.remarks
    for what, present, wanted in (
        ("transducer", remarks.get("transducer_serial"), made.transducer_serial),
        ("counter", remarks.get("counter_identity"), made.counter_identity),
    ):
        if present and wanted and present != wanted:
            raise ModelMismatchError(
                Message(
                    "{origin}: {what} {present!r}, model of {what} {wanted!r}",
                    table.origin,
                    what,
                    present,
                    wanted,
                ),
                Message("a table of the {what} that was calibrated", what),
                "take the model of this chain, or calibrate it",
            )
    range_nm = _noted_number(table, "range_nm")
    if range_nm is not None and abs(range_nm - made.range_nm) > 1e-6 * made.range_nm:
        raise ModelMismatchError(
            Message(
                "{origin}: range {present:g} N·m, model of range {wanted:g} N·m",
                table.origin,
                range_nm,
                made.range_nm,
            ),
            "a table of the range that was calibrated",
            "take the model of this range, or calibrate it",
        )
    scale, present_scale = _of_signal(stored.scale), _of_signal(columns.scale)
    if (scale is None) != (present_scale is None) and "reading_nm" in columns:
        name = columns.name("reading_nm")
        raise ModelMismatchError(
            Message(
                "{origin}: {name} is a torque, model of readings in {unit}",
                table.origin,
                name,
                scale.unit,
            )
            if scale is not None
            else Message(
                "{origin}: {name} is in {unit}, model of readings in N·m",
                table.origin,
                name,
                "" if present_scale is None else present_scale.unit,
            ),
            "readings in the unit of the calibration",
            "take a model that was fitted to readings in this unit",
        )


def model_conversion(stored: StoredModel, stated: Conversion) -> Conversion:
    """Return the conversion from readings to the torques of a model.

    Raises
    ------
    ModelMismatchError
        A sensitivity is stated, although the model contains that of its calibration.
    """
    if _of_signal(stored.scale) is None:
        return replace(stated, scale=stored.scale)
    if stated.sensitivity is not None:
        raise ModelMismatchError(
            Message("--sensitivity {text!r}, and that of the model", stated.sensitivity.text),
            Message("the model's: {text}", "" if stored.scale is None else stored.scale.stated),
            "leave the option out",
        )
    return replace(stated, scale=stored.scale)


def _of_signal(scale: ReadingScale | None) -> ReadingScale | None:
    return None if scale is None or scale.is_torque else scale


class TableColumns:
    """The columns of a calibration or of readings in a table, or in its pieces.

    Parameters
    ----------
    table : Table
        Table, of which only names and remarks are used.
    required : sequence of str
        Columns that the table must have, by names in `NUMERIC_COLUMNS`.
    assigned : sequence of str
        ``name=Header[unit]`` of columns that have other names; see `understand`.
    conversion : Conversion, optional
        Conversion of signals, forces and masses to torques.

    Attributes
    ----------
    understood : Understood
    scale : ReadingScale or None
        Unit of the readings, if it isn't N·m.
    notes : list of str
        Notes on ignored contents.
    """

    def __init__(
        self,
        table: Table,
        required: Sequence[str],
        assigned: Sequence[str] = (),
        conversion: Conversion | None = None,
    ) -> None:
        wanted = [_QUANTITIES[column][0] for column in required]
        self.understood: Understood = understand(table, _WANTED, wanted, assigned, conversion)
        self.notes = list(table.notes)
        self._loading: bool | None = None
        reading = self.understood.columns.get("reading")
        self.scale: ReadingScale | None = None
        if reading is not None and reading.unit is not None and reading.unit != _NEWTON_METRE:
            self.scale = ReadingScale(
                reading.unit.symbol,
                reading.factor,
                reading.offset,
                "" if reading.unit.kind == "torque" else (conversion or Conversion()).text,
            )

    def __contains__(self, column: str) -> bool:
        return _QUANTITIES[column][0] in self.understood

    def name(self, column: str) -> str:
        """Return the name of a column in the file."""
        return self.understood.name(_QUANTITIES[column][0])

    def usable(self, table: Table, column: str) -> NDArray[np.float64] | None:
        """Return an optional column like `numbers`; None with a note if it is unsuitable.

        This applies to a column that was chosen by the words of its name, because its author may
        not have meant it for torquebench.
        """
        try:
            return self.numbers(table, column)
        except InputError as problem:
            if not self.understood.columns[_QUANTITIES[column][0]].by_words:
                raise
            self.notes.append(Message("not used: {problem}", problem.found))
            return None

    def numbers(self, table: Table, column: str) -> NDArray[np.float64] | None:
        """Return a column in the unit of its name, shape (n,); None without one."""
        name, _, own = _QUANTITIES[column]
        return self.understood.numbers(table, name, own)

    def series(self, table: Table) -> NDArray[np.int64] | None:
        """Return the numbers of the series, shape (n,); None without a column.

        Raises
        ------
        InputError
            A cell isn't a whole number; the message names the first one.
        """
        column = self.understood.columns.get("series")
        if column is None:
            return None
        numbers = table.numbers(column.index)
        for row in np.flatnonzero((numbers != np.rint(numbers)) | (np.abs(numbers) > 1e9)):
            raise InputError(
                Message(
                    "{place}: {texts!r}",
                    table.place(int(row), column.name),
                    table.texts(column.index)[row],
                ),
                "the whole number of a series",
            )
        return numbers.astype(np.int64)

    def branch(self, table: Table) -> NDArray[np.int8] | None:
        """Return +1 (up), -1 (down) and 0 (unknown), shape (n,); None without a column.

        A column ``direction`` whose words mean loading and unloading is the branch.

        Raises
        ------
        InputError
            A cell has none of these values; the message names the first one.
        """
        column = self.understood.columns.get("branch")
        if column is None and self._of_loading(table):
            column = self.understood.columns["direction"]
        return (
            None
            if column is None
            else table.meanings(column.index, BRANCH_WORDS, _ALLOWED["branch"])
        )

    def check_direction(self, table: Table, torque_nm: NDArray[np.float64]) -> None:
        """Check that the column ``direction``, if there is one, agrees with the torque's sign.

        Raises
        ------
        InputError
            The columns differ; the message names the first row.
        """
        column = self.understood.columns.get("direction")
        if column is None or ("branch" not in self.understood and self._of_loading(table)):
            return
        words = table.meanings(column.index, _DIRECTIONS, _ALLOWED["direction"])
        for row in np.flatnonzero(words * np.sign(torque_nm) < 0):
            raise InputError(
                Message(
                    "{place}: {texts!r} beside {torque_nm:.6g} N·m",
                    table.place(int(row), column.name),
                    table.texts(column.index)[row],
                    torque_nm[row],
                ),
                "clockwise torque positive, counter-clockwise torque negative",
                "give counter-clockwise torque a minus sign",
            )

    def _of_loading(self, table: Table) -> bool:
        """Return whether the column direction means loading, by the first piece of the table."""
        column = self.understood.columns.get("direction")
        if column is None:
            return False
        if self._loading is None:
            words = {word.strip().lower() for word in table.texts(column.index)}
            self._loading = bool(words & (BRANCH_WORDS.keys() - _DIRECTIONS.keys()))
        return self._loading


@dataclass(frozen=True, eq=False)
class CalibrationTable:
    """A calibration from a table, with the assignment of its columns.

    Parameters
    ----------
    data : CalibrationData
    columns : TableColumns
    """

    data: CalibrationData
    columns: TableColumns


def read_calibration_table(
    path: Path | str,
    *,
    range_nm: float | None = None,
    both_directions: bool = False,
    side: str = "",
    transducer_serial: str = "",
    counter_identity: str = "",
    remark: Callable[[str], None] | None = None,
    mapping: Sequence[str] = (),
    conversion: Conversion | None = None,
    model: StoredModel | None = None,
    limits: Limits = LIMITS,
) -> CalibrationTable:
    r"""Read the calibration in a file; return it with the assignment of its columns.

    Columns are ``reading_nm`` and ``standard_nm``, and optionally ``series``, ``branch``,
    ``direction``, ``nominal_nm``, ``position_deg``, ``speed_rpm``, ``temperature_c``, ``time_s``,
    ``acceleration_rad_s2``, ``zero_temperature_c``, ``zero_nm``, ``standard_temperature_c``,
    ``standard_error_nm`` and (simulated data only) ``true_torque_nm``, in any order, in any unit of
    their kind, or by the usual words in six languages; other columns are ignored. Rows are in
    measuring order, from which a missing branch follows. Comments such as ``# range_nm = 2000`` may
    give the range, the side, the transducer's serial and the counter's identity; arguments take
    precedence over them. ``# reference_uncertainty = 0.02`` states U (k = 2) of the standard; see
    `CertifiedUncertainty.of_text`. ``# measured_on = 2026-03-31`` states the day, from which the
    age of the calibration counts. ``# tared = true`` (or a column ``zero_nm``) states that the zero
    of their series is subtracted from the readings.

    Parameters
    ----------
    path : pathlib.Path or str
        The file; see `read_table`.
    range_nm : float, optional
        Full scale in N·m; by default that stated in the file, or its largest nominal torque or
        standard value.
    both_directions : bool, default False
        Whether clockwise and counter-clockwise torque must both occur.
    side, transducer_serial, counter_identity : str
        Identity of the chain, if the file doesn't state it or states it wrongly.
    remark : callable, optional
        Called with a sentence for each of them that the file states differently.
    mapping : sequence of str
        ``name=Header[unit]`` of columns that have other names; see `understand`.
    conversion : Conversion, optional
        Conversion of signals, forces and masses to torques.
    model : StoredModel, optional
        Model to be used with it: its range is used, and a table of another transducer, counter,
        range or unit is refused.
    limits : Limits

    Raises
    ------
    InputError
        Naming file, row and column of what can't be used, and what to do.
    ModelMismatchError
        As `check_model`.
    """
    table = read_table(path, limits=limits)
    chain = {
        "side": side,
        "transducer_serial": transducer_serial,
        "counter_identity": counter_identity,
    }
    for name, value in chain.items():
        noted = table.remarks.get(name, value)
        if value and remark is not None and noted != value:
            remark(
                Message(
                    "{path} states {name} = {noted}; the given {value} is used",
                    path,
                    name,
                    noted,
                    value,
                )
            )
    chained = (side, transducer_serial, counter_identity)
    return calibration_of(table, range_nm, both_directions, chained, mapping, conversion, model)


def read_calibration(path: Path | str, **options: Any) -> CalibrationData:
    """Return the calibration in a file; parameters and errors as in `read_calibration_table`."""
    return read_calibration_table(path, **options).data


def calibration_of(
    table: Table,
    range_nm: float | None,
    both_directions: bool,
    chain: tuple[str, str, str],
    mapping: Sequence[str] = (),
    conversion: Conversion | None = None,
    model: StoredModel | None = None,
) -> CalibrationTable:
    """Return the calibration in a table; `chain` is side, transducer and counter."""
    side, transducer_serial, counter_identity = chain
    if model is not None:
        conversion = model_conversion(model, conversion or Conversion())
    try:
        columns = TableColumns(table, ("reading_nm", "standard_nm"), mapping, conversion)
    except MissingSensitivityError as problem:
        raise _with_estimate(problem, table, mapping, conversion) from None
    if model is not None:
        check_model(model, table, columns)
        range_nm = model.provenance.range_nm
    reading, standard = (columns.numbers(table, key) for key in ("reading_nm", "standard_nm"))
    assert reading is not None
    assert standard is not None
    _check_sizes(table, columns, reading, standard)
    columns.check_direction(table, standard)
    numbers = columns.series(table)
    branch = columns.branch(table)
    if numbers is None:
        numbers = np.ones(reading.size, dtype=np.int64)
        loaded = standard[standard != 0.0]
        if loaded.size <= _MOST_STEPS and np.unique(loaded).size < loaded.size:
            numbers = infer_series(standard)
    nominal = columns.usable(table, "nominal_nm")
    named = nominal is not None and np.max(np.abs(standard)) <= (1 + RANGE_MARGIN) * np.max(
        np.abs(nominal)
    )
    scale = _range(table, range_nm, nominal if named and nominal is not None else standard)
    _check_range(table, columns.name("standard_nm"), standard, scale)
    for key, values in (("reading_nm", reading), ("standard_nm", standard)):
        if values.size > 2 and np.ptp(values) == 0.0:
            raise InputError(
                Message(
                    "{origin}: constant column {name}, {value:.6g} N·m in all {count} lines",
                    table.origin,
                    columns.name(key),
                    values[0],
                    values.size,
                ),
                "points spread over the range",
                Message("check that {columns} is the right column", columns.name(key)),
            )
    noted = table.remarks
    optional: dict[str, Any] = {name: columns.usable(table, name) for name in OPTIONAL_COLUMNS}
    data = CalibrationData(
        reading_nm=reading,
        standard_nm=standard,
        series=numbers,
        branch=infer_branch(standard, numbers) if branch is None else branch,
        range_nm=scale,
        side=side or noted.get("side", ""),
        transducer_serial=transducer_serial or noted.get("transducer_serial", ""),
        counter_identity=counter_identity or noted.get("counter_identity", ""),
        **optional,
        simulated=table.simulated,
        reference=reference_in(noted, scale, table.origin),
        measured_on=_measured_on(table),
        scale=columns.scale or _noted_scale(table),
        tared=table.stated(_TARED) or "zero_nm" in columns,
        row=np.asarray(table.rows),
    )
    _check_duplicates(table, data)
    if both_directions:
        _check_both_directions(table, data)
    return CalibrationTable(data, columns)


def _check_sizes(
    table: Table, columns: TableColumns, reading: FloatArray, standard: FloatArray
) -> None:
    """Refuse columns, chosen by their words, whose sizes don't fit one torque."""
    chosen = columns.understood.columns
    largest = [float(np.max(np.abs(values))) for values in (reading, standard)]
    by_words = chosen["reading"].by_words or chosen["standard"].by_words
    if not by_words or _of_signal(columns.scale) is not None or 0.0 in largest:
        return
    if max(largest) / min(largest) > _LARGEST_RATIO:
        raise InputError(
            Message(
                "{origin}: readings up to {reading:.4g} N·m ({name}) and a standard up to "
                "{standard:.4g} N·m ({other})",
                table.origin,
                largest[0],
                chosen["reading"].name,
                largest[1],
                chosen["standard"].name,
            ),
            "columns and units of one torque",
            "if they are right, say so: --column 'reading=…' --column 'standard=…'",
        )


def _with_estimate(
    problem: MissingSensitivityError,
    table: Table,
    mapping: Sequence[str],
    conversion: Conversion | None,
) -> InputError:
    """Return the error for signals without sensitivity; it states what their table shows."""
    signal = problem.signal
    if signal is None or (conversion is not None and conversion.sensitivity is not None):
        return problem
    plain = replace(conversion or Conversion(), sensitivity=Sensitivity(signal.kind, 1.0))
    try:
        columns = TableColumns(table, ("reading_nm", "standard_nm"), mapping, plain)
        reading, standard = (columns.numbers(table, key) for key in ("reading_nm", "standard_nm"))
        assert reading is not None
        assert standard is not None
        shown = Sensitivity.estimated(signal, reading, standard)
    except InputError:
        return problem
    if shown is None:
        return problem
    return InputError(
        problem.found,
        problem.allowed,
        Message(
            "take it from the data sheet, or from this table: --sensitivity '{text}'", shown.text
        ),
    )


def _noted_scale(table: Table) -> ReadingScale | None:
    noted = table.remarks.get(_SCALE)
    if noted is None:
        return None
    try:
        return ReadingScale.of_text(noted)
    except ValueError as error:
        raise InputError(
            Message("{origin}: the comment says {name} = {stated!r}", table.origin, _SCALE, noted),
            "unit, N·m by it and N·m at 0, as torquebench writes it",
            "remove the comment",
        ) from error


@dataclass(frozen=True, eq=False)
class ReadingsTable:
    """Readings to be compensated, with all other cells of their file.

    Parameters
    ----------
    table : Table
        Original cells of the file, which are written again with the result.
    names : TableColumns
    columns : mapping of str to array of float, shape (n,)
        Columns in `READING_COLUMNS`, by name.
    branch : array of int8, shape (n,), or None
        +1, -1, or 0 where unknown.
    """

    table: Table
    names: TableColumns
    columns: Mapping[str, NDArray[np.float64]]
    branch: NDArray[np.int8] | None

    @classmethod
    def of(cls, table: Table, names: TableColumns) -> ReadingsTable:
        """Return the readings in a table, or in a piece of it."""
        read = {name: names.numbers(table, name) for name in READING_COLUMNS}
        numbers = {name: values for name, values in read.items() if values is not None}
        names.check_direction(table, numbers["reading_nm"])
        names.series(table)  # refuses values other than whole numbers
        return cls(table, names, numbers, names.branch(table))

    @property
    def simulated(self) -> bool:
        """Whether the file states that its readings are simulated."""
        return self.table.simulated

    @property
    def reading_nm(self) -> NDArray[np.float64]:
        """Readings in N·m, shape (n,)."""
        return self.columns["reading_nm"]

    def __len__(self) -> int:
        return int(self.reading_nm.size)

    def readings(
        self, *, zero_age_h: float | None = None, zero_temperature_c: float | None = None
    ) -> Readings:
        """Return the rows as readings of a measuring chain; see `readings_of_rows`.

        They are single readings, unless the file's comments state ``steady = true``. The length of
        their windows is unknown unless a comment states ``window_s``, and their day unless a
        comment states ``measured_on``.

        Parameters
        ----------
        zero_age_h, zero_temperature_c : float, optional
            Time since the zero was taken and the transducer's temperature then.

        Raises
        ------
        InputError
            A comment that isn't a time or a day.
        """
        return readings_of_rows(
            {**self.columns, "branch": self.branch},
            steady=self.table.stated(_STEADY),
            window_s=_window_s(self.table),
            zero_age_h=zero_age_h,
            zero_temperature_c=zero_temperature_c,
            measured_on=_measured_on(self.table),
        )

    def place(self, row: int) -> str:
        """Return the position of a reading in its file, for messages."""
        return self.table.place(row, self.names.name("reading_nm"))


def read_readings(
    path: Path | str, mapping: Sequence[str] = (), conversion: Conversion | None = None
) -> ReadingsTable:
    """Return the readings to be compensated in a file.

    The file has a column ``reading_nm`` and optionally ``branch``, ``series``, ``speed_rpm``,
    ``temperature_c`` and ``standard_error_nm``, by these names or the usual words; all other
    columns are kept unchanged.

    Raises
    ------
    InputError
        Naming file, row and column of what can't be used, and what to do.
    """
    table = read_table(path)
    return ReadingsTable.of(table, TableColumns(table, ("reading_nm",), mapping, conversion))


def read_empty_run(
    path: Path | str, mapping: Sequence[str] = (), model: StoredModel | None = None
) -> EmptyRun:
    """Return the empty run in a file.

    Columns are ``time_s``, ``reading_nm``, ``speed_rpm``, ``temperature_c`` and optionally
    ``acceleration_rad_s2`` and ``angle_deg``, at an even rate. A comment ``# zero_nm = -0.012``
    states the zero of the readings, so that runs with different zeros can be combined.

    Parameters
    ----------
    path : pathlib.Path or str
    mapping : sequence of str
        ``name=Header[unit]`` for columns with other names; headers that aren't in the file are
        ignored, because they belong to another table.
    model : StoredModel, optional
        As in `read_calibration_table`.

    Raises
    ------
    InputError
        Naming file, row and column of what can't be used, and what to do.
    ModelMismatchError
        As `check_model`.
    """
    table = read_table(path)
    wanted = ("time_s", "reading_nm", "speed_rpm", "temperature_c")
    assigned = [text for text in mapping if names_header(text, table)]
    conversion = None if model is None else model_conversion(model, Conversion())
    columns = TableColumns(table, wanted, assigned, conversion)
    if model is not None:
        check_model(model, table, columns)
    values = [columns.numbers(table, name) for name in wanted]
    time_s, reading, speed, temperature = (each for each in values if each is not None)
    return EmptyRun(
        Path(path).name,
        time_s,
        reading,
        speed,
        temperature,
        columns.numbers(table, "acceleration_rad_s2"),
        _noted_number(table, "zero_nm"),
        columns.numbers(table, "angle_rad"),
    )


def maps_one(mapping: Sequence[str], first: Path, others: Sequence[Path]) -> list[str]:
    """Return the mappings for a table, without those whose headers only other tables have."""
    tables = [read_table(path) for path in (first, *others)] if others and mapping else []
    return [
        text
        for text in mapping
        if not tables
        or names_header(text, tables[0])
        or not any(names_header(text, each) for each in tables)
    ]


def write_calibration(
    path: Path, data: CalibrationData, remarks: Mapping[str, str] | None = None
) -> None:
    """Write a calibration as a CSV file that `read_calibration` reads back exactly.

    Parameters
    ----------
    path : pathlib.Path
        File to be written, atomically.
    data : CalibrationData
        The calibration.
    remarks : mapping of str to str, optional
        More comment lines, such as the profile's name.

    Raises
    ------
    InputError
        Where the file can't be written.
    """
    atomic_write(path, calibration_csv(data, remarks))


def calibration_csv(data: CalibrationData, remarks: Mapping[str, str] | None = None) -> str:
    """Return a calibration as CSV text; see `write_calibration`.

    Examples
    --------
    >>> data = CalibrationData([5.1], [5.0], [1], [1], 10.0)
    >>> print(calibration_csv(data), end="")
    # range_nm = 10.0
    # steady = true
    reading_nm,standard_nm,series,branch
    5.1,5.0,1,up
    """
    notes = {"range_nm": repr(data.range_nm)}
    notes |= {key: getattr(data, key) for key in _TEXTS if getattr(data, key)}
    notes |= reference_remarks(data.reference)
    if data.simulated:
        notes["simulated"] = "true"
    if data.tared:
        notes[_TARED] = "true"
    if data.measured_on is not None:
        notes[_DAY] = data.measured_on.isoformat()
    if data.steady:
        notes[_STEADY] = "true"
    if data.scale is not None:
        notes[_SCALE] = data.scale.text
    text = io.StringIO()
    for key, value in {**notes, **(remarks or {})}.items():
        text.write(f"# {key} = {value}\n")
    extra = [name for name in OPTIONAL_COLUMNS if getattr(data, name) is not None]
    text.write(_line(("reading_nm", "standard_nm", "series", "branch", *extra), ","))
    words = {1: "up", -1: "down", 0: "unknown"}
    for row in range(len(data)):
        numbers = [repr(float(getattr(data, name)[row])) for name in extra]
        text.write(
            _line(
                (
                    repr(float(data.reading_nm[row])),
                    repr(float(data.standard_nm[row])),
                    str(int(data.series[row])),
                    words[int(data.branch[row])],
                    *numbers,
                ),
                ",",
            )
        )
    return text.getvalue()


def _line(cells: tuple[str, ...], separator: str) -> str:
    quoted = [
        '"' + cell.replace('"', '""') + '"'
        if any(mark in cell for mark in f'{separator}"\n')
        else cell
        for cell in cells
    ]
    return separator.join(quoted) + "\n"


def _measured_on(table: Table) -> date | None:
    noted = table.remarks.get(_DAY)
    if noted is None:
        return None
    try:
        return date.fromisoformat(noted)
    except ValueError as error:
        raise InputError(
            Message("{origin}: the comment says {name} = {stated!r}", table.origin, _DAY, noted),
            "a day as 2026-03-31",
            "correct the comment",
        ) from error


def _noted_number(table: Table, name: str) -> float | None:
    noted = table.remarks.get(name)
    try:
        return None if noted is None else float(noted)
    except ValueError as error:
        raise InputError(
            Message("{origin}: the comment says {name} = {stated!r}", table.origin, name, noted),
            "a number in N·m",
            "correct the comment",
        ) from error


def _window_s(table: Table) -> float | None:
    noted = table.remarks.get(_WINDOW)
    if noted is None:
        return None
    try:
        window_s = float(noted)
    except ValueError:
        window_s = float("nan")
    if not window_s > 0.0:
        raise InputError(
            Message("{origin}: the comment says {name} = {stated!r}", table.origin, _WINDOW, noted),
            "a time in s, longer than 0 s",
            "correct the comment",
        )
    return window_s


def _range(table: Table, given: float | None, torque: NDArray[np.float64]) -> float:
    if given is not None:
        return given
    noted = _noted_number(table, "range_nm")
    if noted is not None:
        return noted
    if not np.any(torque):
        raise InputError(
            Message("{origin}: all standard values are 0 N·m", table.origin), "a loaded chain"
        )
    return plainest(
        float(np.max(np.abs(torque))), 1e-3
    )  # standards rarely show the exact full scale


def _check_range(table: Table, name: str, values: NDArray[np.float64], range_nm: float) -> None:
    limit = range_nm * (1 + RANGE_MARGIN)
    for row in np.flatnonzero(np.abs(values) > limit):
        raise InputError(
            Message(
                "{place}: {value:.6g} N·m exceeds the range",
                table.place(int(row), name),
                values[row],
            ),
            Message(
                "±{limit:.6g} N·m (range {range:.6g} N·m and {percent:.0f} %)",
                limit,
                range_nm,
                100 * RANGE_MARGIN,
            ),
            "check the range that you gave, or remove the line",
        )


def _check_duplicates(table: Table, data: CalibrationData) -> None:
    """Refuse two points at one standard value in one series, branch, direction and position.

    Repeats are allowed in a ramp that is recorded point by point, in a series with several speeds
    or temperatures, and at zero in a series in both directions.
    """
    if len(data) > _MOST_STEPS:
        return
    direction = data.loading_direction()
    position = np.zeros(len(data)) if data.position_deg is None else data.position_deg
    stretch = np.broadcast_to(stretches(data.speed_rpm, data.temperature_c), (len(data),))
    seen: dict[tuple[float, ...], int] = {}
    for row in np.flatnonzero(data.standard_nm).tolist():
        key = (
            float(data.standard_nm[row]),
            float(data.series[row]),
            float(data.branch[row]),
            float(direction[row]),
            float(position[row]),
            float(stretch[row]),
        )
        before = seen.setdefault(key, row)
        if before == row:
            continue
        same = data.reading_nm[before] == data.reading_nm[row]
        found = (
            Message("repeats line {lines}", table.rows[before])
            if same
            else Message(
                "reads {reading_nm:.9g} N·m where line {lines} reads {data_reading_nm:.9g} N·m",
                data.reading_nm[row],
                table.rows[before],
                data.reading_nm[before],
            )
        )
        raise InputError(
            Message(
                "{origin}, line {lines} {found}, at {standard_nm:.9g} N·m of series "
                "{series} on the same branch",
                table.origin,
                table.rows[row],
                found,
                data.standard_nm[row],
                data.series[row],
            ),
            "each step once in each series and branch",
            "remove the line, or number repeated series in a column series",
        )


def _check_both_directions(table: Table, data: CalibrationData) -> None:
    for sign, missing in ((1, "clockwise (positive)"), (-1, "counter-clockwise (negative)")):
        if not np.any(data.direction == sign):
            raise InputError(
                Message("{origin} has no {direction} torque", table.origin, missing),
                "both directions",
                "measure it too, or add --one-direction if only one is loaded",
            )
