"""Columns of anybody's tables: which header is which quantity, in which unit, and which rows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.errors import InputError
from torquebench.units import TURN, UNITS, plain_unit

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from torquebench.records.csv_text import CsvTable

__all__ = ["Kind", "read_columns"]

Kind = str
"""One of the keys of `UNITS`, or ``"label"`` for a number without a unit."""

_UNIT = re.compile(r"\s*[\[(]\s*(.+?)\s*[\])]\s*$")


def read_columns(
    data: Path,
    wanted: Mapping[str, Kind],
    required: Sequence[str],
    mapping: Sequence[str],
    where: Sequence[str],
) -> dict[str, NDArray[np.float64]]:
    """Return columns of a CSV file in N·m, rad, 1/min, s and °C, by quantity.

    Parameters
    ----------
    data : pathlib.Path
        The file.
    wanted : mapping of str to str
        Kind of each quantity by its name, such as ``{"torque": "torque", "position": "label"}``.
    required : sequence of str
        Quantities that there must be.
    mapping : sequence of str
        ``name=Header[unit]`` of headers that don't name quantity and unit themselves; a minus
        sign before the header turns the sign, ``counts/N`` is the unit of an encoder with N
        counts per revolution.
    where : sequence of str
        ``Header=value,value`` of the rows that are used.

    Raises
    ------
    InputError
        Where a column is missing or unknown, has no or another unit, or no row is left.
    """
    from torquebench.records.csv_text import read_csv

    table = read_csv(data)
    chosen: dict[str, tuple[str, float]] = {}
    for text in mapping:
        name, source = _parse(text, table, wanted)
        if name in chosen:
            raise InputError(f"two columns for {name}", "one --column for each", f"drop {text!r}")
        chosen[name] = source
    for name, kind in wanted.items():
        if name not in chosen:
            found = _by_header(table, name, kind)
            if found is not None and found[0] not in {header for header, _ in chosen.values()}:
                chosen[name] = found
    for name in required:
        if name not in chosen:
            units = UNITS.get(wanted[name], {"": 1.0})
            unit = next(iter(units))
            header = f"{name}_{unit}" if unit else name
            taken = {source for source, _ in chosen.values()}
            free = _fitting(table, name, wanted[name], taken)
            shown = "" if free is None else _unit_of(free)
            unit = shown if plain_unit(shown) in units else unit
            example = f"--column '{name}={free or 'Header'}[{unit}]'"
            hint = f"name it: {example}" if free else f"add it, or name it as in {example}"
            raise InputError(
                f"{data} has no column {header}; it has {', '.join(table.header)}",
                f"the columns {', '.join(required)}, each with its unit",
                hint if unit else "add it",
            )
    rows = _rows(table, where)
    return {name: table.numbers(header)[rows] * factor for name, (header, factor) in chosen.items()}


_WORDS = {
    "torque": ("torque", "moment", "nm", "扭矩", "转矩", "力矩"),
    "angle": ("angle", "winkel", "position", "encoder", "角", "twist"),
    "speed": ("speed", "drehzahl", "rpm", "转速", "velocity"),
    "time": ("time", "zeit", "时间"),
    "temperature": ("temp", "温度"),
}
"""Parts of headers that are this kind of quantity."""


def _unit_of(header: str) -> str:
    bracket = _UNIT.search(header)
    return bracket[1] if bracket is not None else header.rpartition("_")[2]


def _fitting(table: CsvTable, name: str, kind: Kind, taken: set[str]) -> str | None:
    """Return the header that is most likely a quantity; None where none is of its kind.

    A header that names a unit of another kind never is: a time is no torque.
    """
    ranked = []
    for header in table.header:
        unit = plain_unit(_unit_of(header))
        kinds = {each for each, units in UNITS.items() if unit in units}
        words = {each for each, parts in _WORDS.items() if any(part in header for part in parts)}
        if header in taken or (kinds and kind not in kinds) or (words and kind not in words):
            continue
        rank = (kind in kinds) + 2 * (kind in words) + 4 * (name.partition("_")[0] in header)
        if rank:
            ranked.append((-rank, header))
    return min(ranked)[1] if ranked else None


def _parse(text: str, table: CsvTable, wanted: Mapping[str, Kind]) -> tuple[str, tuple[str, float]]:
    name, equals, source = text.partition("=")
    name = name.strip().lower()
    if not equals or not source.strip():
        raise InputError(
            f"--column {text}", "NAME=Header[unit], as in --column 'angle=Position[deg]'"
        )
    name = next((known for known in wanted if name in (known, *_with_units(known, wanted))), name)
    if name not in wanted:
        raise InputError(f"--column {text}", f"one of {', '.join(wanted)} before the =")
    source = source.strip().lower()
    sign = 1.0
    if source not in table.header and source.startswith("-"):
        sign, source = -1.0, source[1:].strip()
    unit = _UNIT.search(source)
    header = source
    if header not in table.header and unit is not None:
        header = source[: unit.start()].strip()
    if header not in table.header:
        raise InputError(
            f"--column {text}: {table.origin} has no column {header}",
            f"one of {', '.join(table.header)}",
        )
    kind = wanted[name]
    if kind == "label":
        return name, (header, sign)
    if unit is not None:
        return name, (header, sign * _factor(kind, unit[1], text))
    known = _by_header_unit(header, kind)
    if known is None:
        raise InputError(
            f"--column {text} names no unit",
            f"one of {', '.join(UNITS[kind])} in brackets",
            f"as in --column '{name}={header}[{next(iter(UNITS[kind]))}]'",
        )
    return name, (header, sign * known)


def _with_units(name: str, wanted: Mapping[str, Kind]) -> list[str]:
    return [f"{name}_{unit}" for unit in UNITS.get(wanted[name], {})]


def _factor(kind: Kind, unit: str, text: str) -> float:
    unit = unit.strip().lower()
    counts = re.fullmatch(r"counts\s*/\s*([0-9.]+(?:e[0-9]+)?)", unit)
    if kind == "angle" and counts is not None and float(counts[1]) > 0.0:
        return TURN / float(counts[1])
    plain = plain_unit(unit)
    if plain not in UNITS[kind]:
        more = ", counts/N for N counts per revolution" if kind == "angle" else ""
        raise InputError(
            f"the unit {unit} in --column {text}", f"one of {', '.join(UNITS[kind])}{more}"
        )
    return UNITS[kind][plain]


def _by_header(table: CsvTable, name: str, kind: Kind) -> tuple[str, float] | None:
    """Find a column whose header names quantity and unit: angle_deg, or angle [deg]."""
    if kind == "label":
        return (name, 1.0) if name in table.header else None
    found = None
    for header in table.header:
        stem = _UNIT.sub("", header)
        alone = header == f"{name}_{header.rpartition('_')[2]}" or stem == name != header
        factor = _by_header_unit(header, kind) if alone else None
        if factor is None:
            continue
        if found is not None:
            raise InputError(
                f"{table.origin}: the columns {found[0]} and {header} give one quantity twice",
                f"one column for {name}",
                f"choose one by --column {name}={header}",
            )
        found = (header, factor)
    return found


def _by_header_unit(header: str, kind: Kind) -> float | None:
    bracket = _UNIT.search(header)
    unit = bracket[1] if bracket is not None else header.rpartition("_")[2]
    return UNITS[kind].get(plain_unit(unit))


def _rows(table: CsvTable, where: Sequence[str]) -> NDArray[np.intp]:
    import numpy as np

    kept = np.ones(len(table.rows), dtype=bool)
    for text in where:
        header, equals, values = text.partition("=")
        header = header.strip().lower()
        if not equals or header not in table.header:
            raise InputError(
                f"--where {text}", f"Header=value,value with one of {', '.join(table.header)}"
            )
        try:
            wanted = [float(value) for value in values.split(",")]
        except ValueError:
            raise InputError(
                f"--where {text}", "numbers after the =, separated by commas"
            ) from None
        kept &= np.isin(table.numbers(header), wanted)
    if not np.any(kept):
        raise InputError("no row is left", "rows that every --where keeps", "check the values")
    return np.flatnonzero(kept)
