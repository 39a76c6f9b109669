"""Units: factors between SI and the units that users read and write, each stated once.

Inside, quantities are in N·m, rad, rad/s, s, Hz and °C. A factor's name reads as its unit:
``speed_rpm * RAD_S_PER_RPM`` is a speed in rad/s.
"""

from __future__ import annotations

from math import pi

__all__ = [
    "ARCMIN",
    "ARCSEC",
    "DEGREE",
    "NM_PER_RAD_OF_NM_PER_ARCMIN",
    "RAD_S_PER_RPM",
    "RPM_PER_RAD_S",
    "TURN",
]

TURN = 2.0 * pi
DEGREE = pi / 180.0
ARCMIN = pi / 10800.0
ARCSEC = pi / 648000.0
"""One turn, degree, arcminute and arcsecond, rad."""
RAD_S_PER_RPM = 2.0 * pi / 60.0
RPM_PER_RAD_S = 60.0 / (2.0 * pi)
NM_PER_RAD_OF_NM_PER_ARCMIN = 180.0 * 60.0 / pi
"""1 N·m/arcmin in N·m/rad: 3437.75."""
