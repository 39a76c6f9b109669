"""Names of the columns of torque tables, the units in them, and what other names mean."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from torquebench.compensation import BRANCH_WORDS
from torquebench.errors import InputError
from torquebench.records.csv_text import CsvTable, read_csv
from torquebench.units import DEGREE, UNITS, plain_unit

__all__ = [
    "NUMERIC_COLUMNS",
    "branches",
    "check_direction",
    "find_columns",
    "maps",
    "maps_one",
    "quantity",
    "series",
    "word_values",
]

TORQUES = ("reading", "standard", "nominal", "standard_error", "true_torque")
_TORQUE_UNITS = {"nm": 1.0, "knm": 1e3, "mnm": 1e-3}
_OTHERS = {
    "position": "deg",
    "speed": "rpm",
    "temperature": "c",
    "time": "s",
    "acceleration": "rad_s2",
}

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
    "acceleration": {"rpms", "rpmpers", "degs2", "revs2"},
}

LABELS = ("series", "branch", "direction")
_STEMS = {
    **dict.fromkeys(
        (
            "anzeige",
            "messwert",
            "indication",
            "indicated torque",
            "measured torque",
            "示值",
            "读数",
            "测量值",
        ),
        "reading",
    ),
    **dict.fromkeys(
        (
            "reference",
            "reference torque",
            "referenz",
            "referenzmoment",
            "normal",
            "normalmoment",
            "bezugsmoment",
            "标准",
            "标准值",
            "标准扭矩",
            "参考值",
            "参考扭矩",
        ),
        "standard",
    ),
    **dict.fromkeys(("soll", "sollwert", "sollmoment", "nominal torque", "标称值"), "nominal"),
    **dict.fromkeys(("stellung", "einbaulage", "位置"), "position"),
    **dict.fromkeys(("drehzahl", "转速"), "speed"),
    **dict.fromkeys(("temperatur", "temp", "温度"), "temperature"),
    **dict.fromkeys(("zeit", "时间"), "time"),
    **dict.fromkeys(("winkelbeschleunigung", "角加速度"), "acceleration"),
    **dict.fromkeys(("reihe", "messreihe", "序列", "系列"), "series"),
    **dict.fromkeys(("ast", "belastungsrichtung", "行程", "分支"), "branch"),
    **dict.fromkeys(("richtung", "drehrichtung", "方向"), "direction"),
}
"""What columns are called in German, English and Chinese; torques that may be either reading or
reference aren't here."""
_TORQUE_WORDS = ("moment", "torque", "扭矩", "转矩", "力矩")
_KINDS = {
    **dict.fromkeys(TORQUES, "torque"),
    "position": "angle",
    "speed": "speed",
    "temperature": "temperature",
    "time": "time",
    "acceleration": "acceleration",
}
_HEADER_UNIT = re.compile(r"\s*[\[(]\s*(.+?)\s*[\])]\s*$|\s*/\s*([^/]+)$|\s+in\s+(\S+)$")

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
    return {"branch": BRANCH_WORDS, "direction": _DIRECTIONS}[column]


def understood(
    table: CsvTable, required: tuple[str, ...], mapping: Sequence[str] = ()
) -> tuple[CsvTable, dict[str, tuple[str, float]]]:
    r"""Return a table whose label columns have their own names, and its numeric columns.

    Parameters
    ----------
    table : CsvTable
    required : tuple of str
        Columns that there must be, as of `find_columns`.
    mapping : sequence of str
        ``name=Header[unit]`` for headers that don't say what they are; a minus sign before the
        header turns the sign.

    Raises
    ------
    InputError
        As `find_columns`; where a mapping can't be used.

    Examples
    --------
    >>> from torquebench.records.csv_text import parse_csv
    >>> table = parse_csv("Anzeige [N·m];Normal in kNm;Ast\n1;0,001;auf\n", "a table")
    >>> table, columns = understood(table, ("reading_nm", "standard_nm"))
    >>> columns["standard_nm"], table.header[2]
    (('normal in knm', 1000.0), 'branch')
    """
    named: dict[str, tuple[str, float]] = {}
    for text in mapping:
        key, source = _mapped(text, table)
        if key in named:
            raise InputError(f"two columns for {key}", "one --column for each", f"drop {text!r}")
        named[key] = source
    taken = {header for header, _ in named.values()}
    for header in table.header:
        if header in taken or header in NUMERIC_COLUMNS or header in LABELS:
            continue
        found = _by_stem(header)
        if found is not None and found[0] not in named and found[0] not in table.header:
            named[found[0]] = (header, found[1])
    labels = {named.pop(name)[0]: name for name in LABELS if name in named}
    renamed = tuple(labels.get(header, header) for header in table.header)
    table = replace(table, header=renamed)
    return table, find_columns(table, required, named)


def _by_stem(header: str) -> tuple[str, float] | None:
    unit = _HEADER_UNIT.search(header)
    stem = header[: unit.start()].strip() if unit else header
    name = _STEMS.get(stem, stem if unit and stem in _KINDS else None)
    if name in LABELS:
        return str(name), 1.0
    if name is None or unit is None:
        return None
    factors = UNITS[_KINDS[name]]
    factor = factors.get(plain_unit(next(filter(None, unit.groups()))))
    return None if factor is None else (_key(name), factor / _scale(name))


def _key(name: str) -> str:
    return f"{name}_nm" if name in TORQUES else f"{name}_{_OTHERS[name]}"


def _scale(name: str) -> float:
    return DEGREE if name == "position" else 1.0


def maps(text: str, table: CsvTable) -> bool:
    """Return whether a mapping names a header of a table."""
    source = text.partition("=")[2].strip().lower().removeprefix("-").strip()
    unit = _HEADER_UNIT.search(source)
    return source in table.header or bool(unit and source[: unit.start()].strip() in table.header)


def maps_one(mapping: Sequence[str], first: Path, others: Sequence[Path]) -> list[str]:
    """Return the mappings for a table, less those that name a header of another table only."""
    tables = [read_csv(path) for path in (first, *others)] if others else []
    return [
        text
        for text in mapping
        if not tables or maps(text, tables[0]) or not any(maps(text, each) for each in tables)
    ]


def _mapped(text: str, table: CsvTable) -> tuple[str, tuple[str, float]]:
    name, equals, source = text.partition("=")
    name, source = name.strip().lower(), source.strip().lower()
    name = next((each for each in _KINDS if name == _key(each)), name)
    if not equals or not source or name not in (*_KINDS, *LABELS):
        raise InputError(
            f"--column {text}",
            f"NAME=Header[unit] with NAME one of {', '.join((*_KINDS, *LABELS))}",
            "as in --column 'reading=Drehmoment[Nm]'",
        )
    sign = 1.0
    if source not in table.header and source.startswith("-"):
        sign, source = -1.0, source[1:].strip()
    unit = _HEADER_UNIT.search(source)
    header = source
    if header not in table.header and unit is not None:
        header = source[: unit.start()].strip()
    if header not in table.header:
        raise InputError(
            f"--column {text}: {table.origin} has no column {header}",
            f"one of {', '.join(table.header)}",
        )
    if name in LABELS:
        return name, (header, 1.0)
    unit = unit or _HEADER_UNIT.search(header)
    word = next(filter(None, unit.groups())) if unit else header.rpartition("_")[2]
    factors = UNITS[_KINDS[name]]
    if plain_unit(word) not in factors:
        raise InputError(
            f"--column {text} names no unit" if unit is None else f"the unit {word} in {text}",
            f"one of {', '.join(factors)} in brackets",
            f"as in --column '{name}={header}[{next(iter(factors))}]'",
        )
    return _key(name), (header, sign * factors[plain_unit(word)] / _scale(name))


def find_columns(
    table: CsvTable,
    required: tuple[str, ...],
    named: Mapping[str, tuple[str, float]] | None = None,
) -> dict[str, tuple[str, float]]:
    """Find the numeric columns of a torque table and the factor to their SI unit.

    Torques may also be in kN·m (``reading_knm``) or mN·m (``reading_mnm``); any other unit is
    refused by name, because a column that is silently passed over is a guess.

    Parameters
    ----------
    table : CsvTable
        The table.
    required : tuple of str
        Columns that there must be.
    named : mapping, optional
        Columns that are known already, in the form of what is returned.

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
    found: dict[str, tuple[str, float]] = dict(named or {})
    taken = {name for name, _ in found.values()}
    for name in table.header:
        if name in taken:
            continue
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
    words = [name for name in header if any(word in name for word in _TORQUE_WORDS)]
    words += [name for name in header if _STEMS.get(_HEADER_UNIT.sub("", name)) == stem]
    if not alike and words and stem in TORQUES:
        shown = _HEADER_UNIT.sub("", words[-1])
        return f"name the column and its unit: --column '{stem}={shown}[Nm]'"
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
    return _words(table, "branch", BRANCH_WORDS, "up, down or unknown (or +1, -1, 0)")


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
    table: CsvTable, column: str, meaning: Mapping[str, int], allowed: str
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
