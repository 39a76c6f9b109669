"""Scatter of single loadings about the curve: re-seating and repeatability of the transducer."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import ClassVar

from torquebench.chain.effect import Effect
from torquebench.chain.readings import Readings
from torquebench.chain.torque import Component
from torquebench.compensation import CompensationModel
from torquebench.compensation.curve_uncertainty import student_widening
from torquebench.elementwise import Values
from torquebench.uncertainty import Shared


@dataclass(frozen=True)
class Scatter(Effect):
    """Scatter of the calibration's points: new with every loading; a mean of readings keeps it.

    Parameters
    ----------
    model : CompensationModel
        Fitted model: its scatter over the torque, widened for its degrees of freedom, is that of
        one loading.
    """

    title: ClassVar[str] = "scatter of single loadings"
    needs: ClassVar[tuple[str, ...]] = ("loadings",)
    model: CompensationModel

    @cached_property
    def _widening(self) -> float:
        return student_widening(self.model.scatter_freedom)

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the scatter of a mean over a number of loadings."""
        mean = self._widening / sqrt(readings.loadings) * self.model.scatter_at(torque_nm)
        return (Component("scatter", Shared.LOADING, mean),)
