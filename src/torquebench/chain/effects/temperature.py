"""Temperature effect on zero and span."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import ClassVar

import numpy as np

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import FloatArray, Known, Readings
from torquebench.chain.torque import Component, Shapes, by_row
from torquebench.elementwise import Values
from torquebench.uncertainty import Distribution, Shared

_NAMES = ("temperature of zero", "temperature of span")


@register("temperature")
@dataclass(frozen=True)
class Temperature(Effect):
    """Zero and span over temperature, by coefficients within known limits.

    The span is relative to the temperature of the calibration, the zero to that of the zeroing. A
    coefficient within ±c and a change of temperature d ± e, both rectangular, give c/√3·√(d² +
    e²/3): nearly rectangular where d is the larger part, else a product of both.

    Parameters
    ----------
    zero_nm_per_k : float or None
        Limit of the zero's change, N·m/K; None if unknown, and then not in U.
    span_per_k : float or None
        Limit of the span's change, share of the torque per K; None as above.
    calibrated_c : float
        Mean temperature of the transducer during the calibration, °C.
    low_c, high_c : float
        Range of temperatures in which the bench is used, °C, if none is measured.
    deviation_k : float
        Limit of the error of the probe and of the gradient to the transducer, K.
    """

    title: ClassVar[str] = "temperature of zero and span"
    needs: ClassVar[tuple[str, ...]] = ("temperature_c", "zero_temperature_c")
    zero_nm_per_k: float | None = field(metadata={"least": 0.0})
    span_per_k: float | None = field(metadata={"least": 0.0})
    calibrated_c: float = 23.0
    low_c: float = 18.0
    high_c: float = 28.0
    deviation_k: float = field(default=0.5, metadata={"least": 0.0})

    def gaps(self) -> tuple[str, ...]:
        """Name zero and span, as far as their limits are unknown."""
        limits = (self.zero_nm_per_k, self.span_per_k)
        return tuple(name for name, limit in zip(_NAMES, limits, strict=True) if limit is None)

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return zero and span; the coefficients are the same for all readings of a transducer."""
        now, zeroed = readings.temperature_c, readings.zero_temperature_c
        components = []
        if self.zero_nm_per_k:
            half_k = 0.5 * (self.high_c - self.low_c)
            change, shape = self._change(now, zeroed, half_k)
            limit = self.zero_nm_per_k * change
            components.append(_limit(_NAMES[0], Shared.ZEROING, limit, shape))
        if self.span_per_k is not None:
            change, shape = self._change(now, self.calibrated_c, self._reach_k)
            limit = self.span_per_k * change * torque_nm
            components.append(_limit(_NAMES[1], Shared.CALIBRATION, limit, shape))
        return tuple(components)

    @property
    def _reach_k(self) -> float:
        """Largest deviation of the bench's temperatures from that of the calibration, K."""
        return max(abs(self.high_c - self.calibrated_c), abs(self.calibrated_c - self.low_c))

    def _change(self, now: Known, before: Known, unknown_k: float) -> tuple[FloatArray, Shapes]:
        """Return the RMS change of temperature, K, and the distribution of its effect."""
        change = np.subtract(
            np.nan if now is None else now, np.nan if before is None else before, dtype=np.float64
        )
        squared, error = np.square(change), self.deviation_k**2 / 3.0
        shape = by_row(squared > error, Distribution.RECTANGULAR, Distribution.PRODUCT)
        return np.sqrt(np.where(np.isnan(change), unknown_k**2 / 3.0, squared + error)), shape


def _limit(name: str, shared: Shared, limit_nm: FloatArray, shape: Shapes) -> Component:
    return Component(name, shared, limit_nm / sqrt(3.0), distribution=shape)
