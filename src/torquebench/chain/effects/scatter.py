"""Scatter of single loadings about the curve: re-seating and repeatability of the transducer."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import ClassVar

from torquebench.chain.effect import Effect
from torquebench.chain.readings import FloatArray, Readings
from torquebench.chain.torque import Component, Shared

__all__ = ["Scatter"]


@dataclass(frozen=True)
class Scatter(Effect):
    """Scatter of the calibration's points: new with every loading, not reduced by averaging.

    Parameters
    ----------
    standard_uncertainty_nm : float
        Of one loading, widened for its degrees of freedom, N·m.
    """

    title: ClassVar[str] = "scatter of single loadings"
    needs: ClassVar[tuple[str, ...]] = ("loadings",)
    standard_uncertainty_nm: float

    def components(self, readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        """Return the scatter of a mean over the loadings."""
        mean = self.standard_uncertainty_nm / sqrt(readings.loadings)
        return (Component("scatter", Shared.LOADING, mean),)
