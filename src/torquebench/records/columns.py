"""Names of the columns of torque tables, the units in them, and what other names mean."""

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.records.csv_text import CsvTable

__all__ = [
    "NUMERIC_COLUMNS",
    "branches",
    "check_direction",
    "find_columns",
    "quantity",
    "series",
    "word_values",
]

TORQUES = ("reading", "standard", "nominal", "standard_error", "true_torque")
_TORQUE_UNITS = {"nm": 1.0, "knm": 1e3, "mnm": 1e-3}
_OTHERS = {"position": "deg", "speed": "rpm", "temperature": "c", "time": "s"}

NUMERIC_COLUMNS = tuple(f"{name}_nm" for name in TORQUES) + tuple(
    f"{name}_{unit}" for name, unit in _OTHERS.items()
)

_FOREIGN_TORQUE = {
    "lbft": "lbf·ft: 1 lbf·ft is 1.3558179483314004 N·m",
    "lbfft": "lbf·ft: 1 lbf·ft is 1.3558179483314004 N·m",
    "ftlb": "lbf·ft: 1 lbf·ft is 1.3558179483314004 N·m",
    "ftlbf": "lbf·ft: 1 lbf·ft is 1.3558179483314004 N·m",
    "lbin": "lbf·in: 1 lbf·in is 0.1129848290276167 N·m",
    "lbfin": "lbf·in: 1 lbf·in is 0.1129848290276167 N·m",
    "inlb": "lbf·in: 1 lbf·in is 0.1129848290276167 N·m",
    "ozin": "ozf·in: 1 ozf·in is 0.00706155181422604 N·m",
    "kgm": "kgf·m: 1 kgf·m is 9.80665 N·m",
    "kgfm": "kgf·m: 1 kgf·m is 9.80665 N·m",
    "kgcm": "kgf·cm: 1 kgf·cm is 0.0980665 N·m",
    "kgfcm": "kgf·cm: 1 kgf·cm is 0.0980665 N·m",
    "ncm": "N·cm: 1 N·cm is 0.01 N·m",
    "nmm": "N·mm: 1 N·mm is 0.001 N·m",
    "n": "a force: multiply by the lever arm",
    "kn": "a force: multiply by the lever arm",
    **dict.fromkeys(
        ("v", "mv", "uv", "vv", "vpv", "mvv", "mvpv", "hz", "khz", "counts", "raw", "ma"),
        "an electrical signal, not a torque: convert it by the chain's linear sensitivity first",
    ),
    **dict.fromkeys(
        ("percent", "pct", "fs"), "a share, not a torque: multiply by the full scale first"
    ),
}
_FOREIGN_OTHER = {
    "position": {"rad", "turns", "rev", "arcmin"},
    "speed": {"rads", "radpers", "degs", "hz", "rps", "radmin"},
    "temperature": {"k", "f", "degf", "degc", "kelvin", "celsius", "fahrenheit"},
    "time": {"ms", "us", "ns", "min", "h", "hours", "minutes"},
}

_BRANCHES = {
    **dict.fromkeys(
        (
            *("up", "increasing", "inc", "rising", "+1", "1", "1.0"),
            *("auf", "aufwärts", "steigend", "belastung", "加载", "上行", "进程", "升"),
        ),
        1,
    ),
    **dict.fromkeys(
        (
            *("down", "decreasing", "dec", "falling", "-1", "-1.0"),
            *("ab", "abwärts", "fallend", "entlastung", "卸载", "下行", "回程", "降"),
        ),
        -1,
    ),
    **dict.fromkeys(("unknown", "0", "0.0"), 0),
}
_DIRECTIONS = {
    **dict.fromkeys(("cw", "clockwise", "+", "+1", "1", "rechts", "im uhrzeigersinn", "顺时针"), 1),
    **dict.fromkeys(
        (
            *("ccw", "counter-clockwise", "counterclockwise", "-", "-1"),
            *("links", "gegen den uhrzeigersinn", "逆时针"),
        ),
        -1,
    ),
}


def word_values(column: str) -> Mapping[str, int]:
    """Return what each word of a column ``branch`` or ``direction`` means: +1, -1 or 0."""
    return {"branch": _BRANCHES, "direction": _DIRECTIONS}[column]


def find_columns(table: CsvTable, required: tuple[str, ...]) -> dict[str, tuple[str, float]]:
    """Find the numeric columns of a torque table and the factor to their SI unit.

    Torques may also be in kN·m (``reading_knm``) or mN·m (``reading_mnm``); any other unit is
    refused by name, because a column that is silently passed over is a guess.

    Parameters
    ----------
    table : CsvTable
        The table.
    required : tuple of str
        Columns that there must be.

    Returns
    -------
    dict
        Name of the column in the file and factor to the unit of the key, by names of
        `NUMERIC_COLUMNS`.

    Raises
    ------
    InputError
        Where a required column is missing, a quantity is given twice, or in another unit.
    """
    found: dict[str, tuple[str, float]] = {}
    for name in table.header:
        known = _known(name)
        if known is None:
            _refuse_foreign_unit(name, table.origin)
            continue
        key, factor = known
        if key in found:
            raise InputError(
                f"{table.origin}: the columns {found[key][0]} and {name} give one quantity twice",
                f"one of them, {key} by preference",
                "remove one of them",
            )
        found[key] = (name, factor)
    for key in required:
        if key not in found:
            raise InputError(
                f"{table.origin} has no column {key}; it has {', '.join(table.header)}",
                f"the columns {', '.join(required)}",
                _missing_remedy(key, table.header),
            )
    return found


def _known(name: str) -> tuple[str, float] | None:
    if name in NUMERIC_COLUMNS:
        return name, 1.0
    stem, _, unit = name.rpartition("_")
    if stem in TORQUES and unit in _TORQUE_UNITS:
        return f"{stem}_nm", _TORQUE_UNITS[unit]
    return None


def _refuse_foreign_unit(name: str, origin: str) -> None:
    for stem in TORQUES:
        unit = _unit_after(stem, name)
        if unit in _FOREIGN_TORQUE:
            raise InputError(
                f"{origin}: the unit of column {name} is {_FOREIGN_TORQUE[unit]}",
                f"{stem}_nm in N·m, {stem}_knm in kN·m or {stem}_mnm in mN·m",
                "convert the values and rename the column",
            )
    for stem, unit in _OTHERS.items():
        if _unit_after(stem, name) in _FOREIGN_OTHER[stem]:
            raise InputError(
                f"{origin}: column {name} has another unit than {stem}_{unit}",
                f"{stem}_{unit}",
                "convert the values and rename the column",
            )


def _unit_after(stem: str, name: str) -> str:
    if not name.startswith(stem):
        return ""
    return re.sub(r"[^a-z]", "", name.removeprefix(stem))


def _missing_remedy(key: str, header: tuple[str, ...]) -> str:
    stem, _, unit = key.rpartition("_")
    alike = [name for name in header if name.startswith(stem)]
    if alike:
        return f"rename {alike[0]} to {key} if it is in that unit: a header names its unit"
    return f"add it, with the unit {unit} in its header"


def quantity(
    table: CsvTable, columns: dict[str, tuple[str, float]], key: str
) -> NDArray[np.float64] | None:
    """Return a numeric column in its SI unit, shape (n,), or None where there is none."""
    if key not in columns:
        return None
    name, factor = columns[key]
    values = table.numbers(name)
    return values if factor == 1.0 else values * factor


def series(table: CsvTable) -> NDArray[np.int64] | None:
    """Return the column ``series`` as whole numbers, shape (n,), or None.

    Raises
    ------
    InputError
        Naming the first cell that isn't a whole number.
    """
    if "series" not in table.header:
        return None
    numbers = table.numbers("series")
    for row in np.flatnonzero((numbers != np.rint(numbers)) | (np.abs(numbers) > 1e9)):
        raise InputError(
            f"{table.place(int(row), 'series')}: {table.texts('series')[row]!r}",
            "the whole number of a series",
        )
    return numbers.astype(np.int64)


def branches(table: CsvTable) -> NDArray[np.int8] | None:
    """Return the column ``branch`` as +1 (up), -1 (down) and 0 (unknown), shape (n,), or None.

    Raises
    ------
    InputError
        Naming the first cell that is none of these.
    """
    return _words(table, "branch", _BRANCHES, "up, down or unknown (or +1, -1, 0)")


def check_direction(table: CsvTable, torque_nm: NDArray[np.float64]) -> None:
    """Check that the column ``direction``, where there is one, agrees with the torque's sign.

    Raises
    ------
    InputError
        Naming the first line where it doesn't.
    """
    words = _words(table, "direction", _DIRECTIONS, "clockwise or counter-clockwise (cw, ccw)")
    if words is None:
        return
    for row in np.flatnonzero(words * np.sign(torque_nm) < 0):
        raise InputError(
            f"{table.place(int(row), 'direction')}: {table.texts('direction')[row]!r} "
            f"beside {torque_nm[row]:.6g} N·m",
            "clockwise torque positive, counter-clockwise torque negative",
            "give counter-clockwise torque a minus sign",
        )


def _words(
    table: CsvTable, column: str, meaning: dict[str, int], allowed: str
) -> NDArray[np.int8] | None:
    if column not in table.header:
        return None
    values = np.empty(len(table.rows), dtype=np.int8)
    for row, text in enumerate(table.texts(column)):
        if text.lower() not in meaning:
            found = f"{text!r}" if text else "an empty cell"
            raise InputError(f"{table.place(row, column)}: {found}", allowed)
        values[row] = meaning[text.lower()]
    return values
