"""The standard templates for torque transducers, as tables of fields.

Layout after the public overviews of the standard's templates. The basic sheet and template 33 are
tested on a third-party memory image; no such image was available for templates 40 to 42.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from torquebench_teds.bits import (
    Constant,
    Day,
    Enumeration,
    Letters,
    Logarithmic,
    Number,
    Single,
    Whole,
)

__all__ = [
    "BASIC",
    "BRIDGE",
    "CALIBRATION_CURVE",
    "CALIBRATION_TABLE",
    "FREQUENCY_RESPONSE",
    "TEMPLATES",
    "TORQUE",
    "Array",
    "Field",
    "Template",
]

BRIDGE, CALIBRATION_TABLE, CALIBRATION_CURVE, FREQUENCY_RESPONSE = 33, 40, 41, 42
TORQUE = "N·m"

_MEASURANDS = (
    "K", "°C", "strain", "µstrain", "N", "lbf", "kgf", "m/s²", "g", "N·m/rad", TORQUE, "ozf·in",
    "Pa", "psi", "kg", "gram", "m", "mm", "inch", "m/s", "mph", "ft/s", "rad", "°", "rad/s",
    "1/min", "Hz", "g/L", "kg/L", "mol/m³", "mol/L", "m³/m³", "L/L", "kg/s", "m³/s", "m³/h",
    "gal/min", "ft³/min", "L/min", "% RH", "%", "V", "V RMS", "A", "A RMS", "W",
)  # fmt: skip


@dataclass(frozen=True)
class Field:
    """One property of a sheet.

    Attributes
    ----------
    name : str
        Name in a sheet.
    kind : Number
        Data type.
    label : str
        Description, with unit.
    """

    name: str
    kind: Number
    label: str


@dataclass(frozen=True)
class Array:
    """Fields that repeat; a count of `width` bits comes first."""

    name: str
    width: int
    fields: tuple[Field | Array, ...]
    label: str


@dataclass(frozen=True)
class Template:
    """A template of the standard."""

    number: int
    title: str
    fields: tuple[Field | Array, ...]


BASIC = (
    Field("manufacturer", Whole(14, 17, 16381), "manufacturer's number"),
    Field("model", Whole(15), "model number"),
    Field("version_letter", Letters(1), "version letter"),
    Field("version", Whole(6), "version number"),
    Field("serial", Whole(24), "serial number"),
)
"""The basic sheet: 64 bits."""

_CALIBRATED = (
    Field("calibration_date", Day(), "date of calibration"),
    Field("calibration_initials", Letters(3), "initials of who calibrated"),
    Field("calibration_period_days", Whole(12), "calibration period, days"),
)

_SPAN_STEP = 100.0 / ((1 << 16) - 2)
_START_STEP = 100.0 / ((1 << 13) - 2)
_DEVIATION = Constant(21, -100.0, 1e-4)
_DOMAIN = Enumeration(1, ("electrical", "physical"))

TEMPLATES: Mapping[int, Template] = {
    template.number: template
    for template in (
        Template(
            BRIDGE,
            "bridge sensor",
            (
                Field("measurand", Enumeration(6, _MEASURANDS), "unit of the measurand"),
                Field("min_physical", Single(), "lowest value of the measurand"),
                Field("max_physical", Single(), "highest value of the measurand"),
                # of the three precisions of electrical values only the full one is known
                Field("electrical_precision", Whole(2, 2, 2), "precision of electrical values"),
                Field("min_electrical", Single(), "electrical value at the lowest, V/V"),
                Field("max_electrical", Single(), "electrical value at the highest, V/V"),
                Field("bridge", Enumeration(2, ("quarter", "half", "full")), "bridge"),
                Field("impedance_ohm", Constant(18, 1.0, 0.1), "impedance, Ω"),
                Field("response_time_s", Logarithmic(6, 1e-6, 0.146), "response time, s"),
                Field("excitation_v", Constant(9, 0.1, 0.1), "nominal excitation, V"),
                Field("min_excitation_v", Constant(9, 0.1, 0.1), "lowest excitation, V"),
                Field("max_excitation_v", Constant(9, 0.1, 0.1), "highest excitation, V"),
                *_CALIBRATED,
                Field("location", Whole(11), "measurement location"),
            ),
        ),
        Template(
            CALIBRATION_TABLE,
            "calibration table",
            (
                Field("domain", _DOMAIN, "what the points are given at"),
                Array(
                    "points",
                    7,
                    (
                        Field("at_percent", Constant(16, 0.0, _SPAN_STEP), "point, % of span"),
                        Field("deviation_percent", _DEVIATION, "deviation, % of span"),
                    ),
                    "points",
                ),
                *_CALIBRATED,
            ),
        ),
        Template(
            CALIBRATION_CURVE,
            "calibration curve",
            (
                Field("domain", _DOMAIN, "what the curve is a function of"),
                Array(
                    "segments",
                    8,
                    (
                        Field("start_percent", Constant(13, 0.0, _START_STEP), "start, % of span"),
                        Array(
                            "terms",
                            7,
                            (
                                Field("power", Constant(7, -32.0, 0.5), "power"),
                                Field("coefficient", Single(), "coefficient, % of span"),
                            ),
                            "terms of the polynomial",
                        ),
                    ),
                    "segments",
                ),
                *_CALIBRATED,
            ),
        ),
        Template(
            FREQUENCY_RESPONSE,
            "frequency response",
            (
                Array(
                    "points",
                    7,
                    (
                        Field("frequency_hz", Logarithmic(15, 1.0, 0.000215), "frequency, Hz"),
                        Field("amplitude_percent", _DEVIATION, "deviation of amplitude, %"),
                    ),
                    "points",
                ),
                *_CALIBRATED,
            ),
        ),
    )
}
"""The supported templates, by their numbers."""
