"""Column names of tables, their units, and synonyms.

One reader for all tables: a command states the wanted quantities and their kinds. A header matches
by its own name (``speed_rpm``), by a name with a unit (``Drehzahl [1/min]``), or by the user's
assignment (``speed=Motor[1/min]``).
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from torquebench.calibration import OPTIONAL_COLUMNS
from torquebench.chain.readings import MEASURED
from torquebench.compensation import BRANCH_WORDS
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.csv_text import CsvTable
from torquebench.units import TURN, UNIT_OF_ENDING, UNITS, plain_unit, unit_of_name

__all__ = [
    "LABEL",
    "NUMERIC_COLUMNS",
    "WORD",
    "Kind",
    "Source",
    "branches",
    "check_direction",
    "chosen_columns",
    "maps",
    "of_loading",
    "quantity",
    "series",
    "understood",
    "unit_of",
    "with_unit",
    "word_values",
]

Kind = str
"""A key of `UNITS`, `LABEL` or `WORD`."""
LABEL = "label"
"""A number without a unit."""
WORD = "word"
"""A word or number that groups rows."""
Source = tuple[str, float]
"""A header, and the factor from its values to the unit of `UNITS`."""

_ENDINGS = {
    kind: next(
        end
        for end, unit in UNIT_OF_ENDING.items()
        if "%" not in unit and plain_unit(unit) == next(iter(units))
    )
    for kind, units in UNITS.items()
}
"""How torquebench's own column names end, such as ``torque_nm``, by kind."""
LABELS = ("series", "branch", "direction")
NUMERIC_COLUMNS = tuple(
    dict.fromkeys(("reading_nm", "standard_nm", *OPTIONAL_COLUMNS, "time_s", *MEASURED))
)
"""Columns of calibration and reading tables, each in the unit that its name ends in."""


def _own_name(name: str, kind: Kind) -> str:
    return f"{name}{_ENDINGS.get(kind, '')}"


def _shown_unit(kind: Kind) -> str:
    """Return the unit of a kind as it is easily typed."""
    return UNIT_OF_ENDING[_ENDINGS[kind]].replace("·", "")


def _quantity(column: str) -> tuple[str, Kind, float]:
    """Return what a column is called without its unit, its kind, and its unit's factor.

    >>> _quantity("zero_temperature_c"), _quantity("acceleration_rad_s2")
    (('zero_temperature', 'temperature', 1.0), ('acceleration', 'acceleration', 1.0))
    """
    ending = next(end for end in UNIT_OF_ENDING if column.endswith(end))
    unit = plain_unit(UNIT_OF_ENDING[ending])
    kind = next(kind for kind, units in UNITS.items() if unit in units)
    return column.removesuffix(ending), kind, UNITS[kind][unit]


_QUANTITIES = {column: _quantity(column) for column in NUMERIC_COLUMNS}
_TABLES: Mapping[str, Kind] = {
    **{name: kind for name, kind, _ in _QUANTITIES.values()},
    **dict.fromkeys(LABELS, WORD),
}

_FOREIGN_TORQUE = {
    **dict.fromkeys(
        ("lbft", "lbfft", "ftlb", "ftlbf"), "lbf·ft: 1 lbf·ft is 1.3558179483314004 N·m"
    ),
    **dict.fromkeys(("lbin", "lbfin", "inlb"), "lbf·in: 1 lbf·in is 0.1129848290276167 N·m"),
    "ozin": "ozf·in: 1 ozf·in is 0.00706155181422604 N·m",
    **dict.fromkeys(("kgm", "kgfm"), "kgf·m: 1 kgf·m is 9.80665 N·m"),
    **dict.fromkeys(("kgcm", "kgfcm"), "kgf·cm: 1 kgf·cm is 0.0980665 N·m"),
    "ncm": "N·cm: 1 N·cm is 0.01 N·m",
    "nmm": "N·mm: 1 N·mm is 0.001 N·m",
    **dict.fromkeys(("n", "kn"), "a force: multiply by the lever arm"),
    **dict.fromkeys(
        ("v", "mv", "uv", "vv", "vpv", "mvv", "mvpv", "hz", "khz", "counts", "raw", "ma"),
        "an electrical signal, not a torque: convert it by the chain's linear sensitivity first",
    ),
    **dict.fromkeys(
        ("percent", "pct", "fs"), "a share, not a torque: multiply by the full scale first"
    ),
}
_FOREIGN_OTHER = {
    "angle": {"turns"},
    "speed": {"radpers", "hz", "rps", "radmin"},
    "temperature": {"k", "f", "degf", "kelvin", "fahrenheit"},
    "time": {"ns", "h", "hours", "minutes"},
    "acceleration": {"rpmpers", "degs", "revs"},
}

_STEMS = {
    **dict.fromkeys(
        (
            *("anzeige", "messwert", "istwert", "prüfling", "prüfmoment", "aufnehmer"),
            *("istmoment", "messmoment", "indicated", "indicated value", "measured value"),
            *("indication", "indicated torque", "measured torque", "measured", "dut", "uut"),
            *("示值", "读数", "测量值", "测量扭矩", "实测值", "实测扭矩", "被测值", "显示值"),
        ),
        "reading",
    ),
    **dict.fromkeys(
        (
            *("reference", "reference torque", "reference value", "standard torque"),
            *("referenz", "referenzmoment", "referenzwert", "normal", "normalmoment"),
            *("ref", "ref torque", "standard value", "reading of the standard"),
            *("bezug", "bezugsmoment", "bezugswert", "bezugsdrehmoment", "referenzdrehmoment"),
            *("标准", "标准值", "标准扭矩", "标准转矩", "参考值", "参考扭矩", "参考转矩"),
        ),
        "standard",
    ),
    **dict.fromkeys(("soll", "sollwert", "sollmoment", "nominal torque", "标称值"), "nominal"),
    **dict.fromkeys(("stellung", "einbaulage", "位置"), "position"),
    **dict.fromkeys(("drehzahl", "转速"), "speed"),
    **dict.fromkeys(("drehmoment", "扭矩", "转矩", "力矩"), "torque"),
    **dict.fromkeys(("winkel", "drehwinkel", "角度"), "angle"),
    **dict.fromkeys(("temperatur", "temp", "温度"), "temperature"),
    **dict.fromkeys(("zeit", "时间"), "time"),
    **dict.fromkeys(("winkelbeschleunigung", "角加速度"), "acceleration"),
    **dict.fromkeys(("reihe", "messreihe", "序列", "系列"), "series"),
    **dict.fromkeys(("ast", "auf", "up", "belastungsrichtung", "行程", "分支"), "branch"),
    **dict.fromkeys(("load direction", "loading direction", "加载方向"), "direction"),
    **dict.fromkeys(("richtung", "drehrichtung", "方向"), "direction"),
}
"""Names of columns in German, English and Chinese. In a table of readings and standards, "torque"
is ambiguous and matches neither.
"""
_WORDS = {
    "torque": ("torque", "moment", "nm", "扭矩", "转矩", "力矩"),
    "angle": ("angle", "winkel", "position", "encoder", "角", "twist"),
    "speed": ("speed", "drehzahl", "rpm", "转速", "velocity"),
    "time": ("time", "zeit", "时间"),
    "temperature": ("temp", "温度"),
}
"""Parts of headers that identify a quantity."""
_HEADER_UNIT = re.compile(r"\s*[\[(]\s*(.+?)\s*[\])]\s*$|\s*/\s*([^/]+)$|\s+in\s+(\S+)$")
_COUNTS = re.compile(r"counts\s*/\s*([0-9.]+(?:e[0-9]+)?)")

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


WORDS_ALLOWED = {
    "branch": "up, down or unknown (or +1, -1, 0)",
    "direction": "clockwise or counter-clockwise (cw, ccw)",
}
DIRECTION_REMEDY = (
    "clockwise torque positive, counter-clockwise torque negative",
    "give counter-clockwise torque a minus sign",
)


def word_values(column: str) -> Mapping[str, int]:
    """Return the meaning of each word of a column ``branch`` or ``direction``: +1, -1 or 0."""
    return {"branch": BRANCH_WORDS, "direction": _DIRECTIONS}[column]


def of_loading(words: Iterable[str]) -> bool:
    """Return whether a column ``direction`` means loading and unloading, so that it is ``branch``.

    >>> of_loading(["increasing"]), of_loading(["Links", "-1"])
    (True, False)
    """
    return any(each.lower() in BRANCH_WORDS.keys() - _DIRECTIONS.keys() for each in words)


def chosen_columns(
    table: CsvTable,
    wanted: Mapping[str, Kind],
    required: Sequence[str] = (),
    mapping: Sequence[str] = (),
) -> dict[str, Source]:
    r"""Return each quantity's column in a table, and the factor to its unit in `UNITS`.

    `mapping` takes precedence over headers, and torquebench's own names over others. A quantity in
    a unit that isn't known is refused by name, because a column that is silently passed over is a
    guess.

    Parameters
    ----------
    table : CsvTable
    wanted : mapping of str to str
        Kind of each quantity by its name, such as ``{"torque": "torque", "position": "label"}``.
    required : sequence of str
        Quantities that there must be.
    mapping : sequence of str
        ``name=Header[unit]`` for headers with other names; a minus sign before the header turns the
        sign, ``counts/N`` is the unit of an encoder with N counts per revolution.

    Raises
    ------
    InputError
        Where a column is missing or unknown, given twice, or has no or another unit.

    Examples
    --------
    >>> from torquebench.tables.csv_text import parse_csv
    >>> table = parse_csv("speed_rpm;Drehmoment [N·m];Kanal 3\n1;2;3\n", "a table")
    >>> wanted = {"speed": "speed", "torque": "torque", "angle": "angle"}
    >>> for source in chosen_columns(table, wanted, mapping=["angle=-Kanal 3[rad]"]).items():
    ...     print(*source)
    angle ('kanal 3', -1.0)
    speed ('speed_rpm', 1.0)
    torque ('drehmoment [n·m]', 1.0)
    """
    found: dict[str, Source] = {}
    for text in mapping:
        name, source = _mapped(text, table, wanted)
        if name in found:
            raise InputError(
                Message("two columns for {name}", _own_name(name, wanted[name])),
                "one --column for each",
                Message("drop {text!r}", text),
            )
        found[name] = source
    free = [each for each in table.header if each not in {header for header, _ in found.values()}]
    for understand in (_by_own_name, _by_other_name):
        before = frozenset(found)
        for header in free:
            known = understand(header, wanted)
            if known is None or known[0] in before:
                continue
            name, factor = known
            if name in found:
                raise InputError(
                    Message(
                        "{origin}: the columns {found} and {header} give one quantity twice",
                        table.origin,
                        table.written(found[name][0]),
                        table.written(header),
                    ),
                    Message("one of them, {name} by preference", _own_name(name, wanted[name])),
                    Message(
                        "remove one of them, or choose one by --column '{name}={header}'",
                        name,
                        table.written(header),
                    ),
                )
            found[name] = (header, factor)
    taken = {header for header, _ in found.values()}
    for header in free:
        if header not in taken:
            _refuse_foreign_unit(header, table.origin, wanted, found)
    for name in required:
        if name not in found:
            names = [_own_name(each, wanted[each]) for each in required]
            raise InputError(
                Message(
                    "{origin} has no column {name}; it has {header}",
                    table.origin,
                    _own_name(name, wanted[name]),
                    ", ".join(table.names),
                ),
                Message("the columns {names}, or others with their unit", ", ".join(names)),
                _remedy(table, name, wanted[name], taken - _optional(found, required, wanted)),
            )
    return found


def _optional(
    found: Mapping[str, Source],
    required: Sequence[str],
    wanted: Mapping[str, Kind],
) -> set[str]:
    """Return headers that match optional columns by a synonym."""
    headers = {header for name, (header, _) in found.items() if name not in required}
    return {each for each in headers if _by_own_name(each, wanted) is None}


def understood(
    table: CsvTable, required: tuple[str, ...], mapping: Sequence[str] = ()
) -> tuple[CsvTable, dict[str, Source]]:
    r"""Return a table of readings whose label columns have their own names, and its numbers.

    Parameters
    ----------
    table : CsvTable
    required : tuple of str
        Columns that there must be, by names of `NUMERIC_COLUMNS`.
    mapping : sequence of str
        As of `chosen_columns`.

    Returns
    -------
    CsvTable
    dict
        Header and factor to the unit of the key, by names of `NUMERIC_COLUMNS`.

    Raises
    ------
    InputError
        As `chosen_columns`.

    Examples
    --------
    >>> from torquebench.tables.csv_text import parse_csv
    >>> table = parse_csv("Anzeige [N·m];Normal in kNm;Ast\n1;0,001;auf\n", "a table")
    >>> table, columns = understood(table, ("reading_nm", "standard_nm"))
    >>> columns["standard_nm"], table.header[2]
    (('normal in knm', 1000.0), 'branch')
    """
    wanted = [_QUANTITIES[column][0] for column in required]
    chosen = chosen_columns(table, _TABLES, wanted, mapping)
    labels = {chosen.pop(name)[0]: name for name in LABELS if name in chosen}
    for header, name in labels.items():
        if name == "direction" and "branch" not in labels.values():
            labels[header] = "branch" if of_loading(table.texts(header)) else name
    renamed = tuple(labels.get(header, header) for header in table.header)
    numbers = {
        column: (chosen[name][0], chosen[name][1] / own)
        for column, (name, _, own) in _QUANTITIES.items()
        if name in chosen
    }
    return replace(table, header=renamed), numbers


def with_unit(name: str, unit: str, origin: str) -> str:
    """Return the header of a channel whose unit a file states beside its name.

    Raises
    ------
    InputError
        Where the name states another unit.

    Examples
    --------
    >>> with_unit("Drehmoment", "kN·m", "a file"), with_unit("speed_rpm", "1/min", "a file")
    ('Drehmoment [kN·m]', 'speed_rpm')
    """
    if unit in ("", "1", "-"):
        return name
    own = plain_unit(unit_of_name(name.lower()) or unit_of(name.lower()))
    known = {each for units in UNITS.values() for each in units}
    if own not in known or name.lower() == own:
        return name if own == plain_unit(unit) else f"{name} [{unit}]"
    if own != plain_unit(unit) and any(plain_unit(unit) in units for units in UNITS.values()):
        raise InputError(
            Message("{origin}: channel {name} is in {unit} by its properties", origin, name, unit),
            "one unit of a channel",
            "rename it, or correct its unit",
        )
    return name


def unit_of(header: str) -> str:
    """Return the unit in a header, or the text after its last underscore."""
    unit = _HEADER_UNIT.search(header)
    return next(filter(None, unit.groups())) if unit else header.rpartition("_")[2]


def _by_own_name(header: str, wanted: Mapping[str, Kind]) -> tuple[str, float] | None:
    """Match ``speed_rpm``, or ``series``."""
    if wanted.get(header) in (LABEL, WORD):
        return header, 1.0
    for name in sorted(wanted, key=len, reverse=True):
        if header.startswith(f"{name}_"):
            factor = UNITS.get(wanted[name], {}).get(_plain(header.removeprefix(f"{name}_")))
            if factor is not None:
                return name, factor
    return None


def _plain(unit: str) -> str:
    """Return a unit as in column names; a digit there, as in rad_s2, is an exponent."""
    return plain_unit(unit) if re.fullmatch(r"[a-z_]+2?", unit) else ""


def _by_other_name(header: str, wanted: Mapping[str, Kind]) -> tuple[str, float] | None:
    """Match ``Drehzahl [1/min]``, ``speed [rpm]`` or ``Reihe``."""
    unit = _HEADER_UNIT.search(header)
    stem = header[: unit.start()].strip() if unit else header
    name = stem.replace(" ", "_") if unit else ""
    if name not in wanted:
        name = _STEMS.get(stem, "")
    kind = wanted.get(name)
    if kind in (LABEL, WORD):
        return name, 1.0
    if kind is None or unit is None:
        return None
    factor = UNITS[kind].get(plain_unit(next(filter(None, unit.groups()))))
    return None if factor is None else (name, factor)


def maps(text: str, table: CsvTable) -> bool:
    """Return whether a mapping names a header of a table."""
    return _find(text.partition("=")[2].strip().lower(), table) is not None


def _find(source: str, table: CsvTable) -> tuple[str, str | None, float] | None:
    """Return the header that a text refers to, the unit in the text, and the sign."""
    for text, sign in ((source, 1.0), (source.removeprefix("-").strip(), -1.0)):
        if text in table.header:
            return text, None, sign
        unit = _HEADER_UNIT.search(text)
        stem = text[: unit.start()].strip() if unit else text
        stated = next(filter(None, unit.groups())) if unit else None
        if stem in table.header:
            return stem, stated, sign
        alike = [each for each in table.header if _HEADER_UNIT.sub("", each) == stem]
        if len(alike) == 1:
            return alike[0], stated, sign
        if not source.startswith("-"):
            break
    return None


def _mapped(text: str, table: CsvTable, wanted: Mapping[str, Kind]) -> tuple[str, Source]:
    name, equals, source = text.partition("=")
    name, source = name.strip().lower(), source.strip().lower()
    if name not in wanted:
        known = _by_own_name(name, wanted)
        name = known[0] if known else name
    if not equals or not source or name not in wanted:
        raise InputError(
            Message("--column {text}", text),
            Message("NAME=Header[unit] with NAME one of {wanted}", ", ".join(wanted)),
            "as in --column 'reading=Drehmoment[Nm]'",
        )
    found = _find(source, table)
    if found is None:
        header = _HEADER_UNIT.sub("", source).removeprefix("-").strip()
        raise InputError(
            Message("--column {text}: {origin} has no column {header}", text, table.origin, header),
            Message("one of {list}", ", ".join(table.names)),
        )
    header, unit, sign = found
    kind = wanted[name]
    if kind == WORD and sign < 0.0:
        raise InputError(
            Message("--column {text}", text),
            Message("words for {name}, which have no sign", name),
            "drop the -",
        )
    if kind in (LABEL, WORD):
        return name, (header, sign)
    stated = unit or unit_of(header)
    counts = _COUNTS.fullmatch(stated)
    if kind == "angle" and counts is not None and float(counts[1]) > 0.0:
        return name, (header, sign * TURN / float(counts[1]))
    factors = UNITS[kind]
    if plain_unit(stated) not in factors:
        more = ", counts/N for N counts per revolution" if kind == "angle" else ""
        named = unit is not None or _HEADER_UNIT.search(header) is not None
        raise InputError(
            Message("the unit {stated} in {text}", stated, text)
            if named
            else Message("--column {text} names no unit", text),
            Message("one of {factors}{more} in brackets", ", ".join(factors), more),
            Message(
                "as in --column '{name}={header}[{shown_units}]'",
                name,
                table.written(header),
                _shown_unit(kind),
            ),
        )
    return name, (header, sign * factors[plain_unit(stated)])


def _refuse_foreign_unit(
    header: str, origin: str, wanted: Mapping[str, Kind], found: Mapping[str, Source]
) -> None:
    for name, kind in wanted.items():
        if name in found or kind in (LABEL, WORD) or not header.startswith(name):
            continue
        unit = re.sub(r"[^a-z]", "", header.removeprefix(name))
        own = _own_name(name, kind)
        if kind == "torque" and unit in _FOREIGN_TORQUE:
            raise InputError(
                Message(
                    "{origin}: the unit of column {header} is {foreign_torque}",
                    origin,
                    header,
                    _FOREIGN_TORQUE[unit],
                ),
                Message("{name}_nm in N·m, {name}_knm in kN·m or {name}_mnm in mN·m", name),
                "convert the values and rename the column",
            )
        if unit in _FOREIGN_OTHER.get(kind, ()):
            raise InputError(
                Message(
                    "{origin}: column {header} has another unit than {own}", origin, header, own
                ),
                Message(
                    "{own}, or {name}[unit] with one of {units}", own, name, ", ".join(UNITS[kind])
                ),
                "convert the values and rename the column",
            )


def _remedy(table: CsvTable, name: str, kind: Kind, taken: set[str]) -> str:
    """Return the remedy for a quantity without a header."""
    own = _own_name(name, kind)
    if kind in (LABEL, WORD):
        return Message("add it, or name it: --column '{name}=Header'", name)
    if name in table.header:
        return Message(
            "rename {name} to {own} if it is in that unit: a header names its unit, "
            "or --column '{name}={name}[{shown_units}]'",
            name,
            own,
            _shown_unit(kind),
        )
    header = _fitting(table, name, kind, taken)
    if header is None:
        return Message(
            "add it, or name it as in --column '{name}=Header[{shown_units}]'",
            name,
            _shown_unit(kind),
        )
    header = table.written(header)
    unit = unit_of(header)
    known = plain_unit(unit) in UNITS[kind] and plain_unit(unit) != next(iter(UNITS[kind]))
    shown = unit if known else _shown_unit(kind)
    stem = _HEADER_UNIT.sub("", header)
    return Message(
        "name the column and its unit: --column '{name}={stem}[{shown}]'", name, stem, shown
    )


def _fitting(table: CsvTable, name: str, kind: Kind, taken: set[str]) -> str | None:
    """Return the header that most likely is a quantity; None if none is of its kind.

    A header with a unit of another kind never matches: a time isn't a torque.
    """
    ranked = []
    for header in table.header:
        unit = plain_unit(unit_of(header))
        kinds = {each for each, units in UNITS.items() if unit in units}
        words = {each for each, parts in _WORDS.items() if any(part in header for part in parts)}
        called = _STEMS.get(_HEADER_UNIT.sub("", header)) == name
        if header in taken or (kinds and kind not in kinds):
            continue
        if words and kind not in words and not called:
            continue
        rank = (kind in kinds) + 2 * (kind in words) + 4 * (name.partition("_")[0] in header)
        rank += 8 * called
        if rank:
            ranked.append((-rank, header))
    return min(ranked)[1] if ranked else None


def quantity(
    table: CsvTable, columns: Mapping[str, Source], key: str
) -> NDArray[np.float64] | None:
    """Return a numeric column in the unit of its name, shape (n,), or None if there is none."""
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
            Message(
                "{place}: {texts!r}", table.place(int(row), "series"), table.texts("series")[row]
            ),
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
    return _words(table, "branch")


def check_direction(table: CsvTable, torque_nm: NDArray[np.float64]) -> None:
    """Check that the column ``direction``, if there is one, agrees with the torque's sign.

    Raises
    ------
    InputError
        Naming the first line where it doesn't.
    """
    words = _words(table, "direction")
    if words is None:
        return
    for row in np.flatnonzero(words * np.sign(torque_nm) < 0):
        raise InputError(
            Message(
                "{place}: {texts!r} beside {torque_nm:.6g} N·m",
                table.place(int(row), "direction"),
                table.texts("direction")[row],
                torque_nm[row],
            ),
            *DIRECTION_REMEDY,
        )


def _words(table: CsvTable, column: str) -> NDArray[np.int8] | None:
    if column not in table.header:
        return None
    meaning, allowed = word_values(column), WORDS_ALLOWED[column]
    values = np.empty(len(table.rows), dtype=np.int8)
    for row, text in enumerate(table.texts(column)):
        if text.lower() not in meaning:
            found = f"{text!r}" if text else "an empty cell"
            raise InputError(Message("{place}: {found}", table.place(row, column), found), allowed)
        values[row] = meaning[text.lower()]
    return values
