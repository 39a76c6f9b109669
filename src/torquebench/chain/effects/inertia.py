"""Inertia of the rotating parts between transducer and flange."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import ClassVar

import numpy as np

from torquebench.chain.corrections import inertia
from torquebench.chain.effect import Effect, MeasuredPart, register
from torquebench.chain.readings import FloatArray, Readings, row_of
from torquebench.chain.torque import Component, Shared, by_row
from torquebench.uncertainty import Distribution

__all__ = ["Inertia"]


@register("inertia")
@dataclass(frozen=True)
class Inertia(Effect):
    """Torque that accelerates the flange and the other rotating parts after the transducer.

    Parameters
    ----------
    moment_nm_s2 : float
        Change of a reading per acceleration, N·m per rad/s²: the moment of inertia in kg·m², with
        the sign of the mounting.
    uncertainty_nm_s2 : float
        Standard uncertainty of the moment.
    largest_rad_s2 : float
        Largest acceleration of the bench, used if none is known.
    """

    title: ClassVar[str] = "inertia between transducer and flange"
    needs: ClassVar[tuple[str, ...]] = ("acceleration_rad_s2",)
    corrects_reading: ClassVar[bool] = True
    of_turning: ClassVar[bool] = True
    moment_nm_s2: float
    uncertainty_nm_s2: float = field(default=0.0, metadata={"least": 0.0})
    largest_rad_s2: float = field(default=0.0, metadata={"least": 0.0})

    def identified(self, range_nm: float) -> tuple[MeasuredPart, ...]:
        """Return the torque at the largest acceleration."""
        most = self.largest_rad_s2
        size, u = self.moment_nm_s2 * most, self.uncertainty_nm_s2 * most
        return (MeasuredPart.of("inertia", size, u, range_nm, f"up to {most:.3g} rad/s²"),)

    def components(self, readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        """Return the inertia's torque at the acceleration of each reading."""
        count = torque_nm.size
        acceleration = row_of(readings.acceleration_rad_s2, count)
        u, added = inertia(
            acceleration,
            row_of(readings.acceleration_uncertainty_rad_s2, count, 0.0),
            (self.moment_nm_s2, self.uncertainty_nm_s2),
            self.largest_rad_s2 / sqrt(3.0),
        )
        shape = by_row(np.isnan(acceleration), Distribution.RECTANGULAR, Distribution.NORMAL)
        return (Component("inertia", Shared.CALIBRATION, u, added, distribution=shape),)
