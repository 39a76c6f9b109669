"""Long-term drift of the span since the calibration."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import ClassVar

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import Readings
from torquebench.chain.torque import Component
from torquebench.elementwise import Values
from torquebench.uncertainty import Distribution, Shared
from torquebench.units import HOURS_PER_YEAR


@register("drift")
@dataclass(frozen=True)
class Drift(Effect):
    """Change of span since the calibration, within a limit that grows with time.

    Parameters
    ----------
    percent_per_year : float
        Limit of the change, % of the torque per year.
    interval_h : float
        Calibration interval, h: used if the age is unknown.
    """

    title: ClassVar[str] = "drift since calibration"
    needs: ClassVar[tuple[str, ...]] = ("calibration_age_h",)
    percent_per_year: float = field(metadata={"least": 0.0})
    interval_h: float = field(default=HOURS_PER_YEAR, metadata={"least": 0.0})

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the limit at the calibration's age, as a rectangular distribution."""
        age = self.interval_h if readings.calibration_age_h is None else readings.calibration_age_h
        limit = 1e-2 * self.percent_per_year * age / HOURS_PER_YEAR
        return (
            Component(
                "drift",
                Shared.CALIBRATION,
                limit / sqrt(3.0) * torque_nm,
                distribution=Distribution.RECTANGULAR,
            ),
        )
