"""Units: factors between SI and the units of users, each defined once.

Internally, quantities are in N·m, rad, rad/s, s, Hz and °C. The name of a factor states its unit:
``speed_rpm * RAD_S_PER_RPM`` is a speed in rad/s.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import pi

__all__ = [
    "ARCMIN",
    "ARCSEC",
    "DAY",
    "DAYS_PER_YEAR",
    "DEGREE",
    "DEG_PER_RAD",
    "DEG_PER_TURN",
    "DEG_S_PER_RPM",
    "HOUR",
    "HOURS_PER_DAY",
    "HOURS_PER_YEAR",
    "KHZ",
    "MINUTE",
    "MS_PER_S",
    "NM_PER_RAD_OF_NM_PER_ARCMIN",
    "RAD_S_PER_RPM",
    "RPM_PER_RAD_S",
    "TURN",
    "UNITS",
    "UNIT_OF_ENDING",
    "minus_signs",
    "name_without_unit",
    "title_of_name",
    "unit_of_name",
]

TURN = 2.0 * pi
DEGREE = pi / 180.0
ARCMIN = pi / 10800.0
ARCSEC = pi / 648000.0
"""One turn, degree, arcminute and arcsecond, rad."""
DEG_PER_RAD = 180.0 / pi
DEG_PER_TURN = 360.0
MINUTE = 60
HOUR = 3600
DAY = 86400
"""One minute, hour and day, s."""
DAYS_PER_YEAR = 365.25
HOURS_PER_DAY = 24.0
HOURS_PER_YEAR = HOURS_PER_DAY * DAYS_PER_YEAR
MS_PER_S = 1e3
KHZ = 1e3
"""One kilohertz, Hz."""
RAD_S_PER_RPM = TURN / MINUTE
RPM_PER_RAD_S = MINUTE / TURN
DEG_S_PER_RPM = DEG_PER_TURN / MINUTE
NM_PER_RAD_OF_NM_PER_ARCMIN = 180.0 * 60.0 / pi
"""1 N·m/arcmin in N·m/rad: 3437.75."""

UNITS: Mapping[str, Mapping[str, float]] = {
    "torque": {"nm": 1.0, "knm": 1e3, "mnm": 1e-3},
    "angle": {
        "deg": DEGREE,
        "rad": 1.0,
        "mrad": 1e-3,
        "arcmin": ARCMIN,
        "arcsec": ARCSEC,
        "rev": TURN,
    },
    "speed": {"rpm": 1.0, "rads": RPM_PER_RAD_S, "degs": 1.0 / DEG_S_PER_RPM, "revs": MINUTE},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": MINUTE},
    "temperature": {"degc": 1.0, "c": 1.0},
    "acceleration": {"rads2": 1.0, "rpms": RAD_S_PER_RPM},
}
"""Factors to N·m, rad, 1/min, s, °C and rad/s²; names without separators.

The first of a kind is the unit of torquebench's own files.
"""

UNIT_OF_ENDING: Mapping[str, str] = {
    "_percent_per_1000rpm": "%/(1000 rpm)",
    "_percent_per_10k": "%/(10 K)",
    "_percent_per_year": "%/a",
    "_percent_reading": "% of reading",
    "_percent_per_h": "%/h",
    "_arcmin_per_nm": "arcmin/(N·m)",
    "_nm_per_arcmin": "N·m/arcmin",
    "_percent_fs": "% FS",
    "_nm_per_s": "N·m/s",
    "_rpm_per_s": "rpm/s",
    "_hz_per_nm": "Hz/(N·m)",
    "_arcmin": "arcmin",
    "_arcsec": "arcsec",
    "_rad_s2": "rad/s²",
    "_percent": "%",
    "_counts": "counts",
    "_rad_s": "rad/s",
    "_kgm2": "kg·m²",
    "_days": "d",
    "_rpm": "rpm",
    "_rad": "rad",
    "_deg": "°",
    "_khz": "kHz",
    "_ppm": "ppm",
    "_mm": "mm",
    "_kw": "kW",
    "_hz": "Hz",
    "_nm": "N·m",
    "_s": "s",
    "_v": "V",
    "_h": "h",
    "_c": "°C",
    "_k": "K",
    "_j": "J",
}
"""Unit of a quantity by the end of its name, the longest ending first."""

_SPELLED = {"°": "deg", "′": "arcmin", "″": "arcsec", "°c": "degc", "℃": "degc", "µs": "us"}
_SPELLED |= dict.fromkeys(("1/min", "min-1", "min⁻¹", "min^-1", "r/min", "u/min", "rev/min"), "rpm")


def unit_of_name(name: str) -> str:
    """Return the unit at the end of a name; empty if there is none.

    Examples
    --------
    >>> unit_of_name("torque_nm"), unit_of_name("torque_rate_nm_per_s"), unit_of_name("clock")
    ('N·m', 'N·m/s', '')
    """
    return next((unit for end, unit in UNIT_OF_ENDING.items() if name.endswith(end)), "")


def name_without_unit(name: str) -> str:
    """Return a name without the unit at its end.

    Examples
    --------
    >>> name_without_unit("step_percent"), name_without_unit("clock")
    ('step', 'clock')
    """
    ending = next((end for end in UNIT_OF_ENDING if name.endswith(end)), "")
    return name.removesuffix(ending) or name


def title_of_name(name: str) -> str:
    """Return a name as words, without its unit.

    Examples
    --------
    >>> title_of_name("step_percent"), title_of_name("run_id")
    ('Step', 'Run id')
    """
    words = re.sub(r"_+", " ", name_without_unit(name))
    return words[:1].upper() + words[1:]


def minus_signs(text: str) -> str:
    """Return a text with minus signs before its numbers; exponents, dates and names keep hyphens.

    Examples
    --------
    >>> minus_signs("-3.2e-07 N·m in 2026-11-29/-1")
    '−3.2e-07 N·m in 2026-11-29/-1'
    """
    return re.sub(r"(?<![\w/.-])-(?=\d|inf)", "−", text)
