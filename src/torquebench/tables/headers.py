"""Assignment of a table's columns to quantities and units.

A command states the wanted quantities and their kinds. A column is chosen by the user's assignment
(``speed=Motor[1/min]``), by torquebench's own name (``speed_rpm``), or by its words and unit
(``Drehzahl [1/min]``). If no column or several columns fit, the error asks the user to assign one.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.conversion import TORQUE_ONLY, Conversion
from torquebench.tables.table import Table
from torquebench.tables.units import BASE, SIGNALS, Unit, kinds_of, unit_named, units_named
from torquebench.tables.vocabulary import matches, meanings
from torquebench.units import TURN

Kind = str
"""A key of `BASE`, `LABEL` or `WORD`."""
LABEL = "label"
"""A number without a unit."""
WORD = "word"
"""A word or number that groups rows."""
ENDINGS = {
    "torque": "_nm",
    "angle": "_deg",
    "speed": "_rpm",
    "acceleration": "_rad_s2",
    "time": "_s",
    "temperature": "_c",
}
"""Endings of torquebench's own column names, by kind."""
_OWN_ONLY = ("true_torque",)
"""Quantities of torquebench's own tables, which no words in other tables mean."""
_BRACKETED = re.compile(r"^(.*?)\s*[\[({<]\s*([^\[\](){}<>]*?)\s*[\])}>]\s*$", re.DOTALL)
_JOINED = (
    re.compile(r"^(.*\S)\s+(?:in|en)\s+(\S+(?: \S+)?)$"),
    re.compile(r"^(.*?\S)\s*/\s*(\S+(?: \S+)?)$"),
    re.compile(r"^(.*\S)\s*[,;:]\s*(.+)$"),
)
_LAST_WORD = re.compile(r"^(.*)[\s_]+([^\s_]+)$")
_OF_STANDARD = ("standard", "nominal")
"""Quantities that are never a transducer's signal: there, "std" means a standard deviation."""
_NO_NAMES = ("min", "max", "ms", "in", "std", "tr", "rev", "gf", "mg")
"""Column names that are also units but aren't meant as units."""
_SHARES = ("%", "percent", "pct", "% fs", "%fs", "fs")
_SURE = 8
"""Rank from which on a torque is proposed among several: that of a signal, or by its words."""
_COUNTS = re.compile(r"counts\s*/\s*([0-9.]+(?:e[0-9]+)?)", re.IGNORECASE)


@dataclass(frozen=True)
class Assigned:
    """A column that is assigned to a quantity.

    Parameters
    ----------
    quantity : str
    kind : str
    index : int
        Index of the column in its table.
    name : str
        Name of the column in the file.
    unit : Unit or None
        Unit of its values; None for labels and words.
    factor, offset : float
        A value times factor plus offset is in the base unit of the kind; both include the sign.
    by_words : bool
        Whether the column was chosen by the words of its name, not by torquebench's own name or by
        the user.
    """

    quantity: str
    kind: Kind
    index: int
    name: str
    unit: Unit | None = None
    factor: float = 1.0
    offset: float = 0.0
    by_words: bool = False

    @property
    def described(self) -> dict[str, Any]:
        """Name, quantity, unit and factor, for answers in JSON."""
        unit = None if self.unit is None else self.unit.symbol
        base = BASE.get(self.kind)
        described: dict[str, Any] = {"name": self.name, "quantity": self.quantity, "unit": unit}
        if base is not None:
            described |= {"to": base, "factor": self.factor, "offset": self.offset}
        return described


@dataclass(frozen=True)
class Understood:
    """Columns of a table by quantity.

    Parameters
    ----------
    columns : mapping of str to Assigned
    """

    columns: Mapping[str, Assigned] = field(default_factory=dict)

    def __contains__(self, quantity: str) -> bool:
        return quantity in self.columns

    def name(self, quantity: str) -> str:
        """Return the name of a quantity's column in the file."""
        return self.columns[quantity].name

    def numbers(self, table: Table, quantity: str, per: float = 1.0) -> NDArray[np.float64] | None:
        """Return a quantity, shape (n,); None without a column.

        It is in the base unit of its kind, or in a unit of which the base unit has `per`.

        Raises
        ------
        InputError
            A cell isn't a number; the message names the first one.
        """
        column = self.columns.get(quantity)
        if column is None:
            return None
        read = table.times if column.kind == "time" else table.numbers
        values = read(column.index)
        factor, offset = column.factor / per, column.offset / per
        if factor == 1.0 and offset == 0.0:
            return values
        return np.asarray(values * factor + offset)

    def described(self) -> list[dict[str, Any]]:
        """Return the columns for answers in JSON, in the order of the file."""
        ordered = sorted(self.columns.values(), key=lambda column: column.index)
        return [column.described for column in ordered]

    def sentence(self) -> str:
        """Return how columns with foreign names were assigned, as a sentence; empty without any."""
        parts = []
        for column in sorted(self.columns.values(), key=lambda each: each.index):
            if column.name.lower() == _own_name(column.quantity, column.kind):
                continue
            part = f"{column.quantity} = {column.name}"
            if column.factor not in (1.0, -1.0) or column.offset:
                part += f" × {column.factor:.7g}" + f" + {column.offset:.7g}" * bool(column.offset)
                part += f" {BASE[column.kind]}"
            elif column.factor < 0.0:
                part += " × −1"
            parts.append(part)
        return "; ".join(parts)


def understand(
    table: Table,
    wanted: Mapping[str, Kind],
    required: Sequence[str] = (),
    assigned: Sequence[str] = (),
    conversion: Conversion | None = None,
) -> Understood:
    """Return the columns of the wanted quantities.

    Parameters
    ----------
    table : Table
        Table, of which only the names are used.
    wanted : mapping of str to str
        Kind of each quantity by its name, such as ``{"torque": "torque", "position": "label"}``.
    required : sequence of str
        Quantities that the table must have.
    assigned : sequence of str
        ``name=Header[unit]`` for columns with other names; a minus sign before the header reverses
        the sign, ``counts/N`` is the unit of an encoder with N counts per revolution, ``column 2``
        is the second column of a file without a header.
    conversion : Conversion, optional
        Conversion of signals, forces and masses to torques.

    Raises
    ------
    InputError
        If a column is missing, unknown or assigned twice, or its unit is missing or wrong.

    Examples
    --------
    >>> table = Table("a table", ("speed_rpm", "Drehmoment [N·m]", "Kanal 3"), ([], [], []), ())
    >>> wanted = {"speed": "speed", "torque": "torque", "angle": "angle"}
    >>> found = understand(table, wanted, assigned=["angle=-Kanal 3[rad]"])
    >>> for quantity, column in found.columns.items():
    ...     print(quantity, column.name, column.factor)
    angle Kanal 3 -1.0
    speed speed_rpm 1.0
    torque Drehmoment [N·m] 1.0
    """
    return Understood(_Choice(table, wanted, required, conversion or Conversion()).made(assigned))


def known_name(name: str) -> bool:
    """Return whether the words or the unit in a column's name are known."""
    forms = _forms(name)
    return any(meanings(stem) is not None or (unit and kinds_of(unit)) for stem, unit in forms)


def names_header(text: str, table: Table) -> bool:
    """Return whether an assignment refers to a column of a table."""
    return _located(text.partition("=")[2].strip(), table) is not None


def with_unit(name: str, unit: str, origin: str) -> str:
    """Return a channel's name with the unit that a file states beside it.

    Raises
    ------
    InputError
        If the name states another unit.

    Examples
    --------
    >>> with_unit("Drehmoment", "kN·m", "a file"), with_unit("speed_rpm", "1/min", "a file")
    ('Drehmoment [kN·m]', 'speed_rpm')
    """
    if unit.strip() in ("", "1", "-"):
        return name
    for kind in kinds_of(unit):
        stated = unit_named(unit, kind)
        for _, text in _forms(name):
            own = unit_named(text, kind) if text else None
            if stated is None or own is None:
                continue
            if (own.factor, own.offset) == (stated.factor, stated.offset):
                return name
            raise InputError(
                Message(
                    "{origin}: channel {name} is in {unit} by its properties", origin, name, unit
                ),
                "one unit of a channel",
                "rename it, or correct its unit",
            )
    return f"{name} [{unit}]"


def _own_name(quantity: str, kind: Kind) -> str:
    return f"{quantity}{ENDINGS.get(kind, '')}"


def _forms(name: str) -> Iterator[tuple[str, str]]:
    """Yield possible divisions of a name into words and unit, the most probable first.

    >>> list(_forms("Speed rad/s"))
    [('Speed rad', 's'), ('Speed', 'rad/s'), ('', 'Speed rad/s'), ('Speed rad/s', '')]
    """
    bracketed = _BRACKETED.match(name)
    if bracketed is not None:
        yield bracketed[1], bracketed[2]
        yield bracketed[1], ""
        return
    for pattern in (*_JOINED, _LAST_WORD):
        joined = pattern.match(name)
        if joined is not None:
            yield joined[1], joined[2]
    parts = name.split("_")
    for count in (2, 3):  # for example rad_s2, volts_per_volt
        if len(parts) > count:
            yield "_".join(parts[:-count]), "_".join(parts[-count:])
    if len(name) > 1 and name.casefold() not in _NO_NAMES:
        yield "", name
    yield name, ""


def _located(source: str, table: Table) -> tuple[int, str, float] | None:
    """Return the column to which a text refers, the unit in the text, and the sign."""
    folded = [name.casefold() for name in table.names]
    for text, sign in ((source, 1.0), (source.removeprefix("-").strip(), -1.0)):
        if text.casefold() in folded:
            return folded.index(text.casefold()), "", sign
        bracketed = _BRACKETED.match(text)
        joined = [] if bracketed else [pattern.match(text) for pattern in _JOINED[:2]]
        for match in (bracketed, *joined):
            if match is None:
                continue
            stem, unit = match[1].casefold(), match[2]
            if stem in folded:
                return folded.index(stem), unit, sign
            if stem.isdigit() and 0 < int(stem) <= len(folded):
                return int(stem) - 1, unit, sign
            alike = _called(stem, table.names)
            if len(alike) == 1:
                return alike[0], unit, sign
        alike = _called(text.casefold(), table.names)
        if len(alike) == 1:
            return alike[0], "", sign
        if not source.startswith("-"):
            break
    return None


def _called(stem: str, names: Sequence[str]) -> list[int]:
    """Return the columns whose names without unit equal a text."""
    return [
        index
        for index, name in enumerate(names)
        if any(each.casefold() == stem for each, unit in _forms(name) if unit)
    ]


class _Choice:
    """Chooses the columns of one table."""

    def __init__(
        self,
        table: Table,
        wanted: Mapping[str, Kind],
        required: Sequence[str],
        conversion: Conversion,
    ) -> None:
        self._table, self._wanted, self._required = table, wanted, required
        self._conversion = conversion
        self._found: dict[str, Assigned] = {}

    def made(self, assigned: Sequence[str]) -> dict[str, Assigned]:
        for text in assigned:
            self._assign(text)
        taken = {column.index for column in self._found.values()}
        free = [index for index in range(len(self._table.names)) if index not in taken]
        for understand_name in (self._by_own_name, self._by_words):
            before = frozenset(self._found)
            candidates: dict[str, list[tuple[int, Assigned]]] = {}
            for index in free:
                for fit, column in understand_name(index):
                    if column.quantity not in before:
                        candidates.setdefault(column.quantity, []).append((fit, column))
            for quantity in sorted(candidates, key=self._precedence):
                taken = {column.index for column in self._found.values()}
                fitting = [each for each in candidates[quantity] if each[1].index not in taken]
                if fitting:
                    best = max(fit for fit, _ in fitting)
                    self._take(quantity, [column for fit, column in fitting if fit == best], best)
            taken = {column.index for column in self._found.values()}
            free = [index for index in free if index not in taken]
        for quantity in self._required:
            if quantity not in self._found:
                raise self._missing(quantity)
        return self._found

    def _precedence(self, quantity: str) -> tuple[bool, bool]:
        """Return a sort key: needed quantities get a column first, labels last."""
        return quantity not in self._required, self._wanted[quantity] in (LABEL, WORD)

    def _take(self, quantity: str, columns: list[Assigned], fit: int) -> None:
        if len(columns) > 1:
            if fit == 1 and quantity not in self._required:
                return
            own = _own_name(quantity, self._wanted[quantity])
            first, second = columns[0].name, columns[1].name
            if first == second:
                first, second = (f"{column.name} ({column.index + 1})" for column in columns[:2])
            raise InputError(
                Message(
                    "{origin}: the columns {found} and {header} give one quantity twice",
                    self._table.origin,
                    first,
                    second,
                ),
                Message("one of them, {name} by preference", own),
                Message(
                    "remove one of them, or choose one by --column '{name}={header}'",
                    quantity,
                    columns[1].name,
                ),
            )
        self._found[quantity] = columns[0]

    def _by_own_name(self, index: int) -> Iterator[tuple[int, Assigned]]:
        """Match ``speed_rpm``, or ``series``."""
        name = self._table.names[index]
        lower = name.lower()
        for quantity in sorted(self._wanted, key=len, reverse=True):
            kind = self._wanted[quantity]
            if kind in (LABEL, WORD):
                if lower == quantity:
                    yield 2, Assigned(quantity, kind, index, name)
                    return
                continue
            for prefix in (f"{quantity}_", f"{quantity} "):
                if lower.startswith(prefix) or lower.startswith((f"{quantity}[", f"{quantity}(")):
                    text = name[len(quantity) :].strip("_ []()")
                    column = self._converted(quantity, index, text, 1.0)
                    if column is not None:
                        yield 2, column
                        return

    def _by_words(self, index: int) -> Iterator[tuple[int, Assigned]]:
        """Match ``Drehzahl [1/min]``, ``speed [rpm]`` or ``Reihe``."""
        name = self._table.names[index]
        matched = False
        for stem, unit in _forms(name):
            if matched:
                return
            found = meanings(stem)
            if found is None and unit == name:  # a name that is a unit, such as rpm
                found = frozenset(kinds_of(unit))
            if found is None:
                continue
            for quantity, kind in self._wanted.items():
                if quantity in _OWN_ONLY or quantity in self._found:
                    continue
                fit = matches(found, quantity, kind)
                if not fit:
                    continue
                column: Assigned | None = None
                signal = quantity in _OF_STANDARD and set(kinds_of(unit)) & set(SIGNALS)
                if kind in (LABEL, WORD) and (not unit or kinds_of(unit)):
                    column = Assigned(quantity, kind, index, name)
                elif kind not in (LABEL, WORD) and unit and not signal:
                    column = self._converted(quantity, index, unit, 1.0)
                if column is not None:
                    matched = True
                    yield fit, replace(column, by_words=True)

    def _converted(self, quantity: str, index: int, text: str, sign: float) -> Assigned | None:
        """Return a column whose unit converts to that of its quantity; None otherwise.

        Raises
        ------
        InputError
            The unit is ambiguous, or its conversion needs a value that isn't stated.
        """
        kind, name = self._wanted[quantity], self._table.names[index]
        units = units_named(text, kind)
        if len(units) > 1:
            raise InputError(
                Message(
                    "{origin}: the unit {text} of column {name}", self._table.origin, text, name
                ),
                Message(
                    "{units}: the case of the prefix decides", " or ".join(u.symbol for u in units)
                ),
                Message(
                    "name it: --column '{name}={header}[{unit}]'", quantity, name, units[-1].symbol
                ),
            )
        if units:
            unit = units[0]
            return Assigned(
                quantity, kind, index, name, unit, sign * unit.factor, sign * unit.offset
            )
        if kind != "torque":
            return None
        for other in ("force", "mass", *SIGNALS):
            signal = unit_named(text, other)
            if signal is not None:
                factor, offset = self._conversion.to_torque(
                    signal, quantity, name, self._table.origin
                )
                return Assigned(quantity, kind, index, name, signal, sign * factor, sign * offset)
        return None

    def _assign(self, text: str) -> None:
        """Use a column that the user has assigned."""
        quantity, equals, source = text.partition("=")
        quantity, source = quantity.strip().lower(), source.strip()
        if quantity not in self._wanted:
            own = (each for each, kind in self._wanted.items() if quantity == _own_name(each, kind))
            quantity = next(own, quantity)
        if not equals or not source or quantity not in self._wanted:
            raise InputError(
                Message("--column {text}", text),
                Message("NAME=Header[unit] with NAME one of {wanted}", ", ".join(self._wanted)),
                "as in --column 'reading=Drehmoment[Nm]'",
            )
        if quantity in self._found:
            raise InputError(
                Message("two columns for {name}", _own_name(quantity, self._wanted[quantity])),
                "one --column for each",
                Message("drop {text!r}", text),
            )
        located = _located(source, self._table)
        if located is None:
            header = source.removeprefix("-").strip()
            bracketed = _BRACKETED.match(header)
            raise InputError(
                Message(
                    "--column {text}: {origin} has no column {header}",
                    text,
                    self._table.origin,
                    bracketed[1] if bracketed else header,
                ),
                Message("one of {list}", self._table.listed()),
            )
        index, unit, sign = located
        other = next((q for q, column in self._found.items() if column.index == index), None)
        if other is not None:
            raise InputError(
                Message(
                    "--column {text}: {header} is {quantity} already",
                    text,
                    self._table.names[index],
                    other,
                ),
                "another column for each quantity",
                Message("drop {text!r}", text),
            )
        self._found[quantity] = self._of_option(text, quantity, index, unit, sign)

    def _of_option(self, text: str, quantity: str, index: int, unit: str, sign: float) -> Assigned:
        kind, name = self._wanted[quantity], self._table.names[index]
        if kind == WORD and sign < 0.0:
            raise InputError(
                Message("--column {text}", text),
                Message("words for {name}, which have no sign", quantity),
                "drop the -",
            )
        if kind in (LABEL, WORD):
            return Assigned(quantity, kind, index, name, None, sign)
        counts = _COUNTS.fullmatch(unit)
        if kind == "angle" and counts is not None and float(counts[1]) > 0.0:
            per_count = Unit(unit, kind, TURN / float(counts[1]))
            return Assigned(quantity, kind, index, name, per_count, sign * per_count.factor)
        stated = self._stated_unit(name, kind)
        column = self._converted(quantity, index, unit or stated, sign)
        if column is None and kind == "time" and self._table.has_moments(index):
            column = Assigned(quantity, kind, index, name, unit_named("s", "time"), sign)
        if column is None:
            raise self._unknown_unit(text, quantity, name, unit or stated)
        if unit and stated and (_BRACKETED.match(name) or units_named(stated, kind)):
            self._check_contradiction(text, column, stated)
        return column

    def _stated_unit(self, name: str, kind: Kind) -> str:
        """Return the unit in a header for a quantity of a kind; empty without one."""
        fitting = (kind, *TORQUE_ONLY) if kind == "torque" else (kind,)
        bracketed = _BRACKETED.match(name)
        if bracketed is not None:
            lone = len(bracketed[2]) == 1 and name.rstrip().endswith(")") and bracketed[2] != "V"
            return "" if lone or not kinds_of(bracketed[2]) else bracketed[2]
        for each in fitting:
            for _, text in _forms(name):
                if text and units_named(text, each):
                    return text
        return ""

    def _check_contradiction(self, text: str, column: Assigned, stated: str) -> None:
        kinds = kinds_of(stated)
        assert column.unit is not None
        same = column.unit.kind in kinds and any(
            (unit.factor, unit.offset) == (column.unit.factor, column.unit.offset)
            for unit in units_named(stated, column.unit.kind)
        )
        if same:
            return
        raise InputError(
            Message(
                "--column {text}: the header {header} is in {stated}, the option in {unit}",
                text,
                column.name,
                stated,
                column.unit.symbol,
            ),
            "one unit of a column",
            Message("drop [{unit}] from the option, or correct the header", column.unit.symbol),
        )

    def _unknown_unit(self, text: str, quantity: str, name: str, unit: str) -> InputError:
        kind = self._wanted[quantity]
        shown = BASE[kind].replace("·", "")
        more = ", counts/N for N counts per revolution" if kind == "angle" else ""
        bracketed = _BRACKETED.match(name)
        unit = unit or (bracketed[2] if bracketed else "")
        return InputError(
            Message("the unit {stated} in {text}", unit, text)
            if unit
            else Message("--column {text} names no unit", text),
            Message("a unit of {kind} such as {unit}{more} in brackets", kind, BASE[kind], more),
            Message(
                "as in --column '{name}={header}[{shown_units}]'",
                quantity,
                bracketed[1] if bracketed else name,
                shown,
            ),
        )

    def _missing(self, quantity: str) -> InputError:
        """Return the error for a missing quantity, with the most probable remedy."""
        table, names = self._table, [_own_name(each, self._wanted[each]) for each in self._required]
        return InputError(
            Message(
                "{origin} has no column {name}; it has {header}",
                table.origin,
                _own_name(quantity, self._wanted[quantity]),
                table.listed(),
            ),
            Message("the columns {names}, or others with their unit", ", ".join(names)),
            self._remedy(quantity),
        )

    def _remedy(self, quantity: str) -> str:
        kind = self._wanted[quantity]
        if kind in (LABEL, WORD):
            return Message("add it, or name it: --column '{name}=Header'", quantity)
        shown, scale = BASE[kind].replace("·", ""), self._conversion.scale
        if quantity == "reading" and scale is not None:
            shown = scale.unit
        index = self._likeliest(quantity)
        if index is None:
            return Message(
                "add it, or name it as in --column '{name}=Header[{shown_units}]'", quantity, shown
            )
        name = self._table.names[index]
        if kind == "torque" and any(text.lower() in _SHARES for _, text in _forms(name)):
            return Message("{name} is a share, not a torque: multiply by the full scale", name)
        if name.lower() == quantity:
            return Message(
                "a header names its unit: rename {name} to {own} if it is in that unit, "
                "or --column '{quantity}={name}[{shown_units}]'",
                name,
                _own_name(quantity, kind),
                quantity,
                shown,
            )
        stated = self._stated_unit(name, kind)
        bracketed = _BRACKETED.match(name)
        if bracketed is None and stated:
            fitting = (kind, *TORQUE_ONLY) if kind == "torque" else (kind,)
            stated = next(unit.symbol for each in fitting for unit in units_named(stated, each))
        return Message(
            "name the column and its unit: --column '{name}={stem}[{shown}]'",
            quantity,
            bracketed[1] if bracketed else name,
            stated or shown,
        )

    def _likeliest(self, quantity: str) -> int | None:
        """Return the column that is most probably a quantity; None if none is of its kind.

        A column whose words mean another wanted quantity is never proposed: for example, the
        reference isn't the reading.
        """
        kind = self._wanted[quantity]
        taken = {
            column.index
            for column in self._found.values()
            if column.quantity in self._required or column.name.lower().startswith(column.quantity)
        }
        ranked: list[tuple[int, int]] = []
        for index, name in enumerate(self._table.names):
            if index in taken or name.startswith("column "):
                continue
            rank = self._rank(quantity, kind, name)
            if rank > 0:
                ranked.append((-rank, index))
        ranked.sort()
        if not ranked or (kind == "torque" and len(ranked) > 1 and -ranked[0][0] < _SURE):
            return None
        return ranked[0][1]

    def _rank(self, quantity: str, kind: Kind, name: str) -> int:
        units = {each for _, text in _forms(name) if text for each in kinds_of(text)}
        bracketed = _BRACKETED.match(name)
        fitting = {kind}
        if kind == "torque":
            fitting.update(SIGNALS if quantity == "reading" else ("force", "mass"))
        if bracketed is not None and units and not fitting & units:
            return 0
        words = {found for stem, _ in _forms(name) if (found := meanings(stem)) is not None}
        rank = 1 if fitting & units else 0
        if quantity == "reading" and units & set(SIGNALS):
            rank += _SURE  # if there is a signal, a torque is the standard's
        for found in words:
            if matches(found, quantity, kind):
                return 2 * _SURE + rank
            others = (q for q in self._wanted if q != quantity)
            if any(matches(found, each, self._wanted[each]) for each in others):
                if not (quantity == "standard" and "nominal" in found):
                    return 0
                rank += 2
            if kind in found:
                rank += 4
        if not words and kind == "torque" and name.lower() in ("t", "m", "torque"):
            rank += 2
        return rank
