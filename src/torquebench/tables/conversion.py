"""Conversion of a signal, a force or a mass to a torque: sensitivity, lever arm, gravity."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.compensation import ReadingScale
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.units import SIGNALS, STANDARD_GRAVITY, Unit, unit_named

FloatArray = NDArray[np.float64]
TORQUE_ONLY = ("force", "mass", *SIGNALS)
"""Kinds of quantities that become a torque only by a conversion."""
_PAIR = re.compile(r"\s*([-+0-9.,eE]+)\s*(\S.*?)\s*(?:at|=|@|bei|→)\s*([-+0-9.,eE]+)\s*(\S.*?)\s*")
_SLOPE = re.compile(r"\s*([-+0-9.,eE]+)\s*(\S.*?)\s*(?:per|pro)\s*(\S.*?)\s*")
_EXAMPLES = "'2.0015 mV/V at 500 N·m', or two points: '10 kHz at 0 N·m; 15 kHz at 500 N·m'"
_GRAVITIES = (9.7, 9.9)


class MissingSensitivityError(InputError):
    """The readings are an electrical signal, and its sensitivity isn't stated."""

    signal: Unit | None = None
    """Unit of the readings."""


@dataclass(frozen=True)
class Sensitivity:
    """Torque as a straight line over a transducer's signal.

    Parameters
    ----------
    kind : str
        Kind of the signal, one of `SIGNALS`.
    nm_per_unit : float
        N·m per base unit of the signal.
    zero : float
        Signal at 0 N·m, in its base unit.
    text : str
        The sensitivity as it was stated.

    Examples
    --------
    >>> Sensitivity.of_text("2 mV/V at 500 N·m").nm_per_unit
    250.0
    >>> frequency = Sensitivity.of_text("10 kHz at 0 Nm; 15 kHz at 500 Nm")
    >>> frequency.zero, frequency.nm_per_unit
    (10000.0, 0.1)
    >>> Sensitivity.of_text("50 Nm per V").nm_per_unit
    50.0
    """

    kind: str
    nm_per_unit: float
    zero: float = 0.0
    text: str = ""

    @classmethod
    def of_text(cls, text: str) -> Sensitivity:
        """Parse a stated sensitivity: one or two points, or a slope.

        Raises
        ------
        InputError
            The text has none of these forms.
        """
        slope = _SLOPE.fullmatch(text)
        if slope is not None:
            torque, signal = unit_named(slope[2], "torque"), _signal(slope[3])
            if torque is not None and signal is not None:
                return cls(
                    signal.kind, _number(slope[1], text) * torque.factor / signal.factor, 0.0, text
                )
        pairs = [_PAIR.fullmatch(part) for part in re.split(r";|,(?=\s)", text)]
        if not 1 <= len(pairs) <= 2 or None in pairs:
            raise _unclear(text)
        points = []
        for pair in pairs:
            assert pair is not None
            values = (pair[1], pair[2]), (pair[3], pair[4])
            if unit_named(pair[2], "torque") is not None:  # stated in the reverse order
                values = values[1], values[0]
            (number, unit), (nm, torque_unit) = values
            signal, torque = _signal(unit), unit_named(torque_unit, "torque")
            if signal is None or torque is None:
                raise _unclear(text)
            points.append(
                (signal, _number(number, text) * signal.factor, _number(nm, text) * torque.factor)
            )
        if len(points) == 1:
            points.insert(0, (points[0][0], 0.0, 0.0))
        (kind, low, low_nm), (other, high, high_nm) = points
        if kind.kind != other.kind or high == low or high_nm == low_nm:
            raise _unclear(text)
        nm_per_unit = (high_nm - low_nm) / (high - low)
        return cls(kind.kind, nm_per_unit, low - low_nm / nm_per_unit, text)

    @classmethod
    def estimated(cls, unit: Unit, signal: FloatArray, torque_nm: FloatArray) -> Sensitivity | None:
        """Return the sensitivity that a table shows, as two points; None if it shows none.

        Examples
        --------
        >>> signal, torque = np.array([0.01, 1.01, 2.01]), np.array([0.0, 250.0, 500.0])
        >>> Sensitivity.estimated(unit_named("mV/V", "bridge"), signal, torque).text
        '0.01 mV/V at 0 N·m; 2.01 mV/V at 500 N·m'
        """
        if signal.size < 2 or np.ptp(signal) == 0.0 or np.ptp(torque_nm) == 0.0:
            return None
        slope, zero_nm = np.polyfit(signal, torque_nm, 1)
        largest = float(f"{np.max(np.abs(torque_nm)):.3g}")
        points = ((torque - zero_nm) / slope / unit.factor for torque in (0.0, largest))
        low, high = (float(f"{point:.5g}") for point in points)
        text = f"{low:g} {unit.symbol} at 0 N·m; {high:g} {unit.symbol} at {largest:g} N·m"
        return None if low == high else cls.of_text(text)


def _signal(text: str) -> Unit | None:
    return next((unit for kind in SIGNALS if (unit := unit_named(text, kind)) is not None), None)


def _number(text: str, whole: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        raise _unclear(whole) from None


def _unclear(text: str) -> InputError:
    return InputError(
        Message("--sensitivity {text!r}", text),
        Message("signal and torque, as in {examples}", _EXAMPLES),
        "take it from the transducer's data sheet or certificate",
    )


@dataclass(frozen=True)
class Conversion:
    """A user's statements about signals, forces and masses.

    Parameters
    ----------
    sensitivity : Sensitivity, optional
    arm_m : float, optional
        Lever arm, m.
    gravity : float
        Local acceleration of free fall, m/s².
    scale : ReadingScale, optional
        Unit of the readings of the applied model, which is used for readings.
    """

    sensitivity: Sensitivity | None = None
    arm_m: float | None = None
    gravity: float = STANDARD_GRAVITY
    scale: ReadingScale | None = None

    @classmethod
    def of_options(
        cls, sensitivity: str | None, arm: str | None, gravity: float | None
    ) -> Conversion:
        """Return the conversion that options state.

        Raises
        ------
        InputError
            An option can't be parsed.
        """
        return cls(
            None if sensitivity is None else Sensitivity.of_text(sensitivity),
            None if arm is None else arm_m(arm),
            STANDARD_GRAVITY if gravity is None else gravity_m_s2(gravity),
        )

    def to_torque(self, unit: Unit, quantity: str, name: str, origin: str) -> tuple[float, float]:
        """Return factor and offset from values in a unit to N·m.

        Raises
        ------
        InputError
            A value that the conversion needs isn't stated.
        """
        if self.scale is not None and quantity == "reading":
            own = unit_named(self.scale.unit, unit.kind)
            if own is not None:
                return unit.factor / own.factor * self.scale.nm_per_unit, self.scale.offset_nm
        if unit.kind in ("force", "mass"):
            if self.arm_m is None:
                raise InputError(
                    Message(
                        "{origin}: column {name} is a {kind} in {unit}, not a torque",
                        origin,
                        name,
                        unit.kind,
                        unit.symbol,
                    ),
                    "a torque, or the lever arm",
                    "give the arm: --arm 0.5m",
                )
            weight = self.gravity if unit.kind == "mass" else 1.0
            return unit.factor * weight * self.arm_m, 0.0
        if self.sensitivity is None or self.sensitivity.kind != unit.kind:
            stated = self.sensitivity
            missing = MissingSensitivityError(
                Message(
                    "{origin}: column {name} is an electrical signal in {unit}, not a torque",
                    origin,
                    name,
                    unit.symbol,
                )
                if stated is None
                else Message(
                    "{origin}: column {name} is in {unit}, the sensitivity is {text!r}",
                    origin,
                    name,
                    unit.symbol,
                    stated.text,
                ),
                "a torque, or the sensitivity of its transducer",
                Message("give it as --sensitivity {examples}", _EXAMPLES),
            )
            missing.signal = unit
            raise missing
        if quantity in ("standard", "nominal"):
            raise InputError(
                Message(
                    "{origin}: the {quantity} {name} is in {unit}",
                    origin,
                    quantity,
                    name,
                    unit.symbol,
                ),
                "the standard's torque; --sensitivity is that of the transducer under calibration",
                "convert the standard's signal by its own certificate",
            )
        factor = unit.factor * self.sensitivity.nm_per_unit
        return factor, -self.sensitivity.zero * self.sensitivity.nm_per_unit

    @property
    def text(self) -> str:
        """The stated values in words."""
        if self.scale is not None and not self.scale.is_torque:
            return self.scale.stated
        parts = [] if self.sensitivity is None else [self.sensitivity.text]
        if self.arm_m is not None:
            parts.append(f"arm {self.arm_m:g} m, g = {self.gravity:g} m/s²")
        return ", ".join(parts)


def arm_m(text: str) -> float:
    """Return a lever arm in m.

    Raises
    ------
    InputError
        The text isn't a length above 0 with its unit.

    Examples
    --------
    >>> arm_m("500 mm"), round(arm_m("20in"), 4)
    (0.5, 0.508)
    """
    found = re.fullmatch(r"\s*([0-9.,eE+-]+)\s*(\S.*?)\s*", text)
    unit = None if found is None else unit_named(found[2], "length")
    try:
        value = float(found[1].replace(",", ".")) * unit.factor if found and unit else 0.0
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e3:
        raise InputError(
            Message("--arm {text!r}", text), "a length with its unit, above 0 m", "as in --arm 0.5m"
        )
    return value


def gravity_m_s2(value: float) -> float:
    """Check a local acceleration of free fall, and return it.

    Raises
    ------
    InputError
        The value doesn't occur on Earth.
    """
    low, high = _GRAVITIES
    if not low <= value <= high:
        raise InputError(
            Message("--gravity {value:g} m/s²", value),
            Message("{low:g} to {high:g} m/s², as anywhere on Earth", low, high),
            Message("leave it out for the standard {standard} m/s²", STANDARD_GRAVITY),
        )
    return value
