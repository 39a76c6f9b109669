"""Units as people write them: their quantities and conversions.

Prefixes are case-sensitive: ``mN·m`` is a thousandth, ``MN·m`` a million. Other letters may have
any case if the unit stays unambiguous.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

from torquebench.units import (
    ARCMIN,
    ARCSEC,
    DAY,
    DEG_PER_TURN,
    DEGREE,
    HOUR,
    MINUTE,
    RAD_S_PER_RPM,
    RPM_PER_RAD_S,
    TURN,
)

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall, m/s² (third CGPM), for kgf, gf, lbf and ozf."""
_POUND = 0.45359237
"""One avoirdupois pound, kg, by definition."""
_OUNCE = _POUND / 16.0
_INCH = 0.0254
_FOOT = 0.3048

BASE = {
    "torque": "N·m",
    "force": "N",
    "mass": "kg",
    "length": "m",
    "angle": "rad",
    "speed": "rpm",
    "acceleration": "rad/s²",
    "time": "s",
    "temperature": "°C",
    "bridge": "mV/V",
    "voltage": "V",
    "current": "mA",
    "frequency": "Hz",
    "counts": "counts",
}
"""Base unit to which values of each kind are converted."""
SIGNALS = ("bridge", "voltage", "current", "frequency", "counts")
"""Kinds of a transducer's electrical signal."""


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: its value times `factor` plus `offset` is in the base unit of its kind.

    Parameters
    ----------
    symbol : str
        Printed symbol.
    kind : str
        A key of `BASE`.
    factor, offset : float
    """

    symbol: str
    kind: str
    factor: float
    offset: float = 0.0


_PREFIXES = {"": 1.0, "k": 1e3, "M": 1e6, "m": 1e-3, "μ": 1e-6, "da": 1e1, "d": 1e-1, "c": 1e-2}
_FORCES: dict[str, tuple[str, float]] = {
    **{f"{prefix}N": (f"{prefix}N", factor) for prefix, factor in _PREFIXES.items()},
    **dict.fromkeys(("lbf", "lb", "lbs", "#"), ("lbf", _POUND * STANDARD_GRAVITY)),
    **dict.fromkeys(("ozf", "oz"), ("ozf", _OUNCE * STANDARD_GRAVITY)),
    **dict.fromkeys(("kgf", "kp", "kg"), ("kgf", STANDARD_GRAVITY)),
    **dict.fromkeys(("gf", "p", "g"), ("gf", 1e-3 * STANDARD_GRAVITY)),
    "dyn": ("dyn", 1e-5),
}
"""Symbol and newtons of each spelling of a force within a torque, where kg and lb are forces."""
_LENGTHS: dict[str, tuple[str, float]] = {
    "m": ("m", 1.0),
    "dm": ("dm", 0.1),
    "cm": ("cm", 0.01),
    "mm": ("mm", 1e-3),
    "μm": ("µm", 1e-6),
    **dict.fromkeys(("in", "inch", "inches"), ("in", _INCH)),
    **dict.fromkeys(("ft", "foot", "feet"), ("ft", _FOOT)),
}
_REVERSED = {"lbf", "ozf", "kgf"}
"""Forces that are also written after the length: ft-lb, in-oz, m-kg."""
_TORQUE_WORDS = {
    "newtonmetre": 1.0,
    "newtonmetres": 1.0,
    "newtonmeter": 1.0,
    "newtonmeters": 1.0,
    "牛米": 1.0,
    "牛顿米": 1.0,
    "千牛米": 1e3,
    "毫牛米": 1e-3,
}
_POUND_WORDS = {"footpound": "ftlb", "inchpound": "inlb", "poundfoot": "lbft", "poundinch": "lbin"}


def _torques() -> Iterator[tuple[str, Unit]]:
    for force, (force_symbol, newton) in _FORCES.items():
        for length, (length_symbol, metre) in _LENGTHS.items():
            if force == "p" or (force == "g" and length == "m"):
                continue
            unit = Unit(f"{force_symbol}·{length_symbol}", "torque", newton * metre)
            yield force + length, unit
            if force_symbol in _REVERSED:
                yield length + force, unit
    for word, factor in _TORQUE_WORDS.items():
        yield word, Unit({1e3: "kN·m", 1e-3: "mN·m"}.get(factor, "N·m"), "torque", factor)
    plain = _simple_torques()
    for words, spelling in _POUND_WORDS.items():
        yield words, plain[spelling]
        yield f"{words}s", plain[spelling]


def _simple_torques() -> dict[str, Unit]:
    pound = _POUND * STANDARD_GRAVITY
    foot, inch = (
        Unit("lbf·ft", "torque", pound * _FOOT),
        Unit("lbf·in", "torque", pound * _INCH),
    )
    return {"ftlb": foot, "lbft": foot, "inlb": inch, "lbin": inch}


_OTHERS: dict[str, dict[str, tuple[str, float]]] = {
    # kind: spellings, separated by blanks: symbol and factor
    "angle": {
        "deg ° degree degrees Grad 度": ("°", DEGREE),
        "rad radian radians": ("rad", 1.0),
        "mrad": ("mrad", 1e-3),
        "μrad": ("µrad", 1e-6),
        "arcmin ′ ' arcminute arcminutes minofarc 分": ("′", ARCMIN),
        'arcsec ″ " arcsecond arcseconds secofarc 秒': ("″", ARCSEC),
        "rev revs turn turns U Umdr tr rot revolution revolutions 转 圈": ("rev", TURN),
        "gon": ("gon", DEGREE * 0.9),
    },
    "speed": {
        "rpm 1/min /min r/min rev/min revs/min U/min Upm tr/min t/min rot/min revpermin "
        "转/分 转/分钟 回転/分 回/分": ("rpm", 1.0),
        "krpm": ("krpm", 1e3),
        "rps 1/s /s r/s rev/s revs/s revs revpersec U/s tr/s tps turns/s Hz 转/秒": (
            "rev/s",
            float(MINUTE),
        ),
        "rad/s rads radps radpers": ("rad/s", RPM_PER_RAD_S),
        "mrad/s": ("mrad/s", 1e-3 * RPM_PER_RAD_S),
        "rad/min radpermin": ("rad/min", RPM_PER_RAD_S / MINUTE),
        "deg/s degs degps degpers dps °/s Grad/s": ("°/s", MINUTE / DEG_PER_TURN),
        "deg/min °/min": ("°/min", 1.0 / DEG_PER_TURN),
    },
    "acceleration": {
        "rad/s2 rads2 rad/s/s": ("rad/s²", 1.0),
        "deg/s2 degs2 °/s2": ("°/s²", DEGREE),
        "rev/s2 revs2": ("rev/s²", TURN),
        "rpm/s rpms rpmpers": ("rpm/s", RAD_S_PER_RPM),
    },
    "time": {
        "s sec secs second seconds Sek Sekunden 秒": ("s", 1.0),
        "ms msec millisecond milliseconds 毫秒": ("ms", 1e-3),
        "μs μsec": ("µs", 1e-6),
        "ns nsec": ("ns", 1e-9),
        "min minute minutes Minuten 分 分钟": ("min", float(MINUTE)),
        "h hr hrs hour hours Std": ("h", float(HOUR)),
        "d day days": ("d", float(DAY)),
    },
    "force": {
        **{f"{prefix}N": (f"{prefix}N", factor) for prefix, factor in _PREFIXES.items()},
        "newton newtons": ("N", 1.0),
        "lbf": ("lbf", _POUND * STANDARD_GRAVITY),
        "ozf": ("ozf", _OUNCE * STANDARD_GRAVITY),
        "kgf kp": ("kgf", STANDARD_GRAVITY),
        "gf": ("gf", 1e-3 * STANDARD_GRAVITY),
        "dyn": ("dyn", 1e-5),
    },
    "mass": {
        "kg kilogram kilograms": ("kg", 1.0),
        "g gram grams": ("g", 1e-3),
        "mg": ("mg", 1e-6),
        "t": ("t", 1e3),
        "lb lbs lbm pound pounds": ("lb", _POUND),
        "oz": ("oz", _OUNCE),
    },
    "length": {
        "m metre metres meter meters": ("m", 1.0),
        "dm": ("dm", 0.1),
        "cm": ("cm", 0.01),
        "mm": ("mm", 1e-3),
        "μm": ("µm", 1e-6),
        'in inch inches "': ("in", _INCH),
        "ft foot feet '": ("ft", _FOOT),
    },
    "bridge": {
        "mV/V mVV mVperV": ("mV/V", 1.0),
        "μV/V μVV": ("µV/V", 1e-3),
        "V/V VV VperV volts/volt": ("V/V", 1e3),
    },
    "voltage": {
        "V volt volts": ("V", 1.0),
        "mV": ("mV", 1e-3),
        "μV": ("µV", 1e-6),
        "kV": ("kV", 1e3),
    },
    "current": {"mA": ("mA", 1.0), "A amp amps ampere amperes": ("A", 1e3), "μA": ("µA", 1e-3)},
    "frequency": {"Hz hertz": ("Hz", 1.0), "kHz": ("kHz", 1e3), "MHz": ("MHz", 1e6)},
    "counts": {
        "counts count cts digits digit LSB incr increments ticks raw adc": ("counts", 1.0),
    },
}
_TEMPERATURES = {
    "°C degC C celsius 摄氏度 度": Unit("°C", "temperature", 1.0),
    "K kelvin degK": Unit("K", "temperature", 1.0, -273.15),
    "°F degF F fahrenheit": Unit("°F", "temperature", 5.0 / 9.0, -160.0 / 9.0),
}
_AMBIGUOUS = {
    ("angle", "grad"): (Unit("°", "angle", DEGREE), Unit("gon", "angle", DEGREE * 0.9)),
}
"""Units with the same spelling in two languages: German Grad is a degree, English grad is a gon."""

_SIGNS = str.maketrans(
    {"º": "°", "˚": "°", "″": '"', "′": "'", "’": "'", "”": '"', "µ": "μ", "−": "-", "⁻": "-"}
)
_SEPARATORS = re.compile(r"[\s·.*⋅∙•×_-]+")
_POWER = re.compile(r"([A-Za-z]+)\^?-([12])$")


def _normal(text: str) -> str:
    """Return a unit without separators, with an exponent -1 as a slash.

    >>> _normal("N · m"), _normal("min⁻¹"), _normal("rad.s-2"), _normal("mV_per_V")
    ('Nm', '/min', 'rad/s2', 'mV/V')
    """
    text = text.strip().translate(_SIGNS)
    text = unicodedata.normalize("NFKC", text).translate(_SIGNS).replace("^", "")
    text = re.sub(r"(?i)[\s_]per[\s_]", "/", text)
    text = _POWER.sub(lambda found: "/" + found[1] + found[2].replace("1", ""), text)
    text = _SEPARATORS.sub("", text)
    if text.startswith("u") and text not in _KEPT_U:
        text = "μ" + text[1:]
    return text


_KEPT_U = ("u", "u/min", "u/s", "umdr", "upm")


@cache
def _spellings(kind: str) -> dict[str, Unit]:
    found: dict[str, Unit] = {}
    if kind == "torque":
        found.update(_torques())
    if kind == "temperature":
        for names, unit in _TEMPERATURES.items():
            found |= dict.fromkeys((_normal(name) for name in names.split()), unit)
    for names, (symbol, factor) in _OTHERS.get(kind, {}).items():
        unit = Unit(symbol, kind, factor)
        found |= dict.fromkeys((_normal(name) for name in names.split()), unit)
    return found


@cache
def _folded(kind: str) -> dict[str, tuple[Unit, ...]]:
    """Return the units of each spelling, regardless of case."""
    found: dict[str, dict[float, Unit]] = {}
    for spelling, unit in _spellings(kind).items():
        found.setdefault(spelling.casefold(), {}).setdefault(unit.factor, unit)
    return {spelling: tuple(units.values()) for spelling, units in found.items()}


def units_named(text: str, kind: str) -> tuple[Unit, ...]:
    """Return the units of a kind that a text may mean: none, one, or several.

    Examples
    --------
    >>> [unit.symbol for unit in units_named("lbf-in", "torque")]
    ['lbf·in']
    >>> units_named("MN·m", "torque")[0].factor, units_named("mN·m", "torque")[0].factor
    (1000000.0, 0.001)
    >>> [unit.symbol for unit in units_named("MNM", "torque")]
    ['MN·m', 'mN·m']
    """
    spelling = _normal(text)
    if not spelling:
        return ()
    if (kind, spelling) in _AMBIGUOUS:
        return _AMBIGUOUS[kind, spelling]
    exact = _spellings(kind).get(spelling)
    if exact is not None:
        return (exact,)
    units = _folded(kind).get(spelling.casefold(), ())
    if len(units) > 1 and spelling != spelling.upper():
        # the case of the first letter counts: "mnm" in a column's name is mN·m
        first = [unit for unit in units if unit.symbol[0] == spelling[0]]
        units = tuple(first) or units
    return units


def unit_named(text: str, kind: str) -> Unit | None:
    """Return the unit of a kind that a text means; None if there is none, or more than one.

    Examples
    --------
    >>> unit_named("°F", "temperature")
    Unit(symbol='°F', kind='temperature', factor=0.5555555555555556, offset=-17.77777777777778)
    >>> unit_named("V", "torque") is None
    True
    """
    units = units_named(text, kind)
    return units[0] if len(units) == 1 else None


def kinds_of(text: str) -> tuple[str, ...]:
    """Return the kinds of which a text is a unit.

    Examples
    --------
    >>> kinds_of("Hz"), kinds_of("kg"), kinds_of("raw data")
    (('speed', 'frequency'), ('mass',), ())
    """
    return tuple(kind for kind in BASE if units_named(text, kind))
