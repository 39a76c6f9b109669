"""Tables of calibrations and readings: read with specific errors, written atomically."""

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
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
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.columns import (
    branches,
    check_direction,
    maps,
    quantity,
    series,
    understood,
)
from torquebench.tables.csv_text import CsvTable, parse_csv
from torquebench.tables.files import read_table
from torquebench.tables.reference_remarks import reference_in, reference_remarks

__all__ = [
    "ReadingsTable",
    "calibration_csv",
    "maps_one",
    "parse_calibration",
    "read_calibration",
    "read_empty_run",
    "read_readings",
    "write_calibration",
]

READING_COLUMNS = ("reading_nm", "time_s", *MEASURED, "standard_error_nm")
"""Numeric columns of a file of readings; all but the first are optional."""
ADDED_COLUMNS = ("torque_nm", "additional_torque_nm", "expanded_uncertainty_nm")
"""Columns that compensation adds to a table of readings."""
_STEADY = "steady"
"""Comment of a table of steady means, as the points of a calibration are."""
_TARED = "tared"
"""Comment of a table whose readings count from the zero of their series already."""
_WINDOW = "window_s"
"""Comment with the length of the windows of a table's readings."""
_DAY = "measured_on"
"""Comment with the day of a measurement, from or to which the age of a calibration counts."""
_TEXTS = ("side", "transducer_serial", "counter_identity")
_MOST_STEPS = 2000
"""Most points of a loading sequence; larger tables are recordings."""


def read_calibration(
    path: Path | str,
    *,
    range_nm: float | None = None,
    both_directions: bool = False,
    side: str = "",
    transducer_serial: str = "",
    counter_identity: str = "",
    remark: Callable[[str], None] | None = None,
    mapping: Sequence[str] = (),
) -> CalibrationData:
    r"""Return the calibration in a CSV file.

    Columns are ``reading_nm`` and ``standard_nm``, and optionally ``series``, ``branch``,
    ``direction``, ``nominal_nm``, ``position_deg``, ``speed_rpm``, ``temperature_c``, ``time_s``,
    ``acceleration_rad_s2``, ``zero_temperature_c``, ``zero_nm``, ``standard_temperature_c``,
    ``standard_error_nm`` and (simulated data only) ``true_torque_nm``, in any order; others are
    passed over. Lines are in measuring order, from which a missing branch follows. Comments such
    as ``# range_nm = 2000`` may give the range, the side, the transducer's serial and the
    counter's identity; arguments take precedence over them. ``# reference_uncertainty = 0.02``
    states U (k = 2) of the standard; see `CertifiedUncertainty.of_text`. ``# measured_on =
    2026-03-31`` states the day, from which the age of the calibration counts. ``# tared = true``
    (or a column ``zero_nm``) states that the readings count from the zero of their series.

    Parameters
    ----------
    path : pathlib.Path or str
        The file.
    range_nm : float, optional
        Full scale in N·m; without it, that of the file, or the largest nominal torque or standard
        value in it.
    both_directions : bool, default False
        Whether clockwise and counter-clockwise torque must both occur.
    side, transducer_serial, counter_identity : str
        The chain, where the file doesn't name it or names it wrongly.
    remark : callable, optional
        Called with a sentence for each of them that the file names differently.
    mapping : sequence of str
        ``name=Header[unit]`` of columns that have other names; see `columns.understood`.

    Raises
    ------
    InputError
        Naming file, line and column of what can't be used, and what to do.
    """
    table = read_table(Path(path))
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
                    "{path} says {name} = {noted}; {value} was given and is taken",
                    path,
                    name,
                    noted,
                    value,
                )
            )
    chained = (side, transducer_serial, counter_identity)
    return calibration_of(table, range_nm, both_directions, chained, mapping)


def parse_calibration(
    text: str,
    origin: str,
    *,
    range_nm: float | None = None,
    transducer_serial: str = "",
    counter_identity: str = "",
) -> CalibrationData:
    r"""Return the calibration in a CSV text; see `read_calibration`.

    Parameters
    ----------
    text : str
    origin : str
        What messages call it.

    Examples
    --------
    >>> data = parse_calibration("reading_nm,standard_nm\n5.1,5.0\n10.2,10.0\n", "a table")
    >>> data.standard_nm.tolist(), data.range_nm
    ([5.0, 10.0], 10.0)
    """
    chain = ("", transducer_serial, counter_identity)
    return calibration_of(parse_csv(text, origin), range_nm, False, chain)


def calibration_of(
    table: CsvTable,
    range_nm: float | None,
    both_directions: bool,
    chain: tuple[str, str, str],
    mapping: Sequence[str] = (),
) -> CalibrationData:
    """Return the calibration in a table; `chain` is side, transducer and counter."""
    side, transducer_serial, counter_identity = chain
    table, columns = understood(table, ("reading_nm", "standard_nm"), mapping)
    table.check_decimal_marks([name for name, _ in columns.values()])
    reading, standard = (quantity(table, columns, key) for key in ("reading_nm", "standard_nm"))
    assert reading is not None
    assert standard is not None
    check_direction(table, standard)
    numbers = series(table)
    branch = branches(table)
    if numbers is None:
        numbers = np.ones(reading.size, dtype=np.int64)
        loaded = standard[standard != 0.0]
        if loaded.size <= _MOST_STEPS and np.unique(loaded).size < loaded.size:
            numbers = infer_series(standard)
    nominal = quantity(table, columns, "nominal_nm")
    named = nominal is not None and np.max(np.abs(standard)) <= (1 + RANGE_MARGIN) * np.max(
        np.abs(nominal)
    )
    scale = _range(table, range_nm, nominal if named and nominal is not None else standard)
    _check_range(table, columns["standard_nm"][0], standard, scale)
    for key, values in (("reading_nm", reading), ("standard_nm", standard)):
        if values.size > 2 and np.ptp(values) == 0.0:
            raise InputError(
                Message(
                    "{origin}: constant column {name}, {value:.6g} N·m in all {count} lines",
                    table.origin,
                    columns[key][0],
                    values[0],
                    values.size,
                ),
                "points spread over the range",
                Message("check that {columns} is the right column", columns[key][0]),
            )
    noted = table.remarks
    optional: dict[str, Any] = {name: quantity(table, columns, name) for name in OPTIONAL_COLUMNS}
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
        simulated=is_simulated(noted),
        reference=reference_in(noted, scale, table.origin),
        measured_on=_measured_on(table),
        tared=_is_stated(noted, _TARED) or "zero_nm" in columns,
        row=np.array(table.lines),
    )
    _check_duplicates(table, data)
    if both_directions:
        _check_both_directions(table, data)
    return data


@dataclass(frozen=True, eq=False)
class ReadingsTable:
    """Readings to compensate, with all other cells of their file.

    Parameters
    ----------
    table : CsvTable
        The file's original cells, which `write_torque_csv` repeats.
    columns : mapping of str to array of float, shape (n,)
        Columns out of `READING_COLUMNS` by name.
    branch : array of int8, shape (n,), or None
        +1, -1, or 0 where unknown.
    simulated : bool
        Whether the file states that its readings are simulated.
    """

    table: CsvTable
    columns: Mapping[str, NDArray[np.float64]]
    branch: NDArray[np.int8] | None
    simulated: bool

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
        their windows is unknown, unless a comment states ``window_s``, and their day, unless one
        states ``measured_on``.

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
            steady=_is_stated(self.table.remarks, _STEADY),
            window_s=_window_s(self.table),
            zero_age_h=zero_age_h,
            zero_temperature_c=zero_temperature_c,
            measured_on=_measured_on(self.table),
        )

    def place(self, row: int) -> str:
        """Return the position of a reading in its file, for messages."""
        return self.table.place(row, "reading_nm")


def read_readings(path: Path | str) -> ReadingsTable:
    """Return the readings in a CSV file, to be compensated.

    The file has a column ``reading_nm`` and optionally ``branch``, ``series``, ``speed_rpm``,
    ``temperature_c`` and ``standard_error_nm``; all others are kept as they are.

    Raises
    ------
    InputError
        Naming file, line and column of what can't be used, and what to do.
    """
    return readings_of(read_table(Path(path)))


def readings_of(table: CsvTable, mapping: Sequence[str] = ()) -> ReadingsTable:
    """Return the readings in a table; see `read_readings`."""
    table, columns = understood(table, ("reading_nm",), mapping)
    table.check_decimal_marks([columns[name][0] for name in READING_COLUMNS if name in columns])
    read = {name: quantity(table, columns, name) for name in READING_COLUMNS}
    numbers = {name: values for name, values in read.items() if values is not None}
    check_direction(table, numbers["reading_nm"])
    series(table)  # refuses other than whole numbers
    return ReadingsTable(table, numbers, branches(table), is_simulated(table.remarks))


def read_empty_run(path: Path | str, mapping: Sequence[str] = ()) -> EmptyRun:
    """Return the empty run in a CSV file.

    Columns are ``time_s``, ``reading_nm``, ``speed_rpm``, ``temperature_c`` and optionally
    ``acceleration_rad_s2`` and ``angle_deg``, at an even rate. A comment ``# zero_nm = -0.012``
    states the zero of the readings, so that runs with different zeros can be combined.

    Parameters
    ----------
    path : pathlib.Path or str
    mapping : sequence of str
        ``name=Header[unit]`` of columns that have other names; those whose header isn't in the
        file are passed over, as they are another table's.

    Raises
    ------
    InputError
        Naming file, line and column of what can't be used, and what to do.
    """
    table = read_table(Path(path))
    wanted = ("time_s", "reading_nm", "speed_rpm", "temperature_c")
    table, columns = understood(table, wanted, [text for text in mapping if maps(text, table)])
    table.check_decimal_marks([name for name, _ in columns.values()])
    values = [quantity(table, columns, name) for name in wanted]
    time_s, reading, speed, temperature = (each for each in values if each is not None)
    acceleration = quantity(table, columns, "acceleration_rad_s2")
    noted = table.remarks.get("zero_nm")
    try:
        zero_nm = None if noted is None else float(noted)
    except ValueError:
        raise InputError(
            Message("{path}: zero_nm = {noted}", path, noted), "a number, in N·m"
        ) from None
    angle = quantity(table, columns, "angle_rad")
    return EmptyRun(
        Path(path).name,
        time_s,
        reading,
        speed,
        temperature,
        acceleration,
        zero_nm,
        angle,
    )


def maps_one(mapping: Sequence[str], first: Path, others: Sequence[Path]) -> list[str]:
    """Return the mappings for a table, less those that name a header of another table only."""
    tables = [read_table(path) for path in (first, *others)] if others and mapping else []
    return [
        text
        for text in mapping
        if not tables or maps(text, tables[0]) or not any(maps(text, each) for each in tables)
    ]


def write_calibration(
    path: Path, data: CalibrationData, remarks: Mapping[str, str] | None = None
) -> None:
    """Write a calibration as a CSV file that `read_calibration` reads back exactly.

    Parameters
    ----------
    path : pathlib.Path
        File to write; it is written whole or not at all.
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


def is_simulated(remarks: Mapping[str, str]) -> bool:
    return _is_stated(remarks, "simulated")


def _is_stated(remarks: Mapping[str, str], name: str) -> bool:
    return remarks.get(name, "").lower() in ("true", "yes", "1")


def _measured_on(table: CsvTable) -> date | None:
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


def _window_s(table: CsvTable) -> float | None:
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


def _range(table: CsvTable, given: float | None, torque: NDArray[np.float64]) -> float:
    if given is not None:
        return given
    noted = table.remarks.get("range_nm")
    if noted is not None:
        try:
            return float(noted)
        except ValueError as error:
            raise InputError(
                Message("{origin}: the comment says range_nm = {range!r}", table.origin, noted),
                "a number in N·m",
            ) from error
    if not np.any(torque):
        raise InputError(
            Message("{origin}: all standard values are 0 N·m", table.origin), "a loaded chain"
        )
    return plainest(float(np.max(np.abs(torque))), 1e-3)  # a standard never shows it exactly


def _check_range(table: CsvTable, name: str, values: NDArray[np.float64], range_nm: float) -> None:
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


def _check_duplicates(table: CsvTable, data: CalibrationData) -> None:
    """Refuse two points at one standard value of one series, branch, direction and position.

    A ramp recorded point by point repeats values, and so may a series at another speed or
    temperature. A series in both directions passes zero several times.
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
            Message("repeats line {lines}", table.lines[before])
            if same
            else Message(
                "reads {reading_nm:.9g} N·m where line {lines} reads {data_reading_nm:.9g} N·m",
                data.reading_nm[row],
                table.lines[before],
                data.reading_nm[before],
            )
        )
        raise InputError(
            Message(
                "{origin}, line {lines} {found}, at {standard_nm:.9g} N·m of series "
                "{series} on the same branch",
                table.origin,
                table.lines[row],
                found,
                data.standard_nm[row],
                data.series[row],
            ),
            "each step once in each series and branch",
            "remove the line, or number repeated series in a column series",
        )


def _check_both_directions(table: CsvTable, data: CalibrationData) -> None:
    for sign, missing in ((1, "clockwise (positive)"), (-1, "counter-clockwise (negative)")):
        if not np.any(data.direction == sign):
            raise InputError(
                Message("{origin} has no {direction} torque", table.origin, missing),
                "both directions",
                "measure it too, or add --one-direction if only one is loaded",
            )
