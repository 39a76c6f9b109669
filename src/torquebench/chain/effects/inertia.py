"""Inertia of the rotating parts between transducer and flange."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from torquebench.chain.effect import Effect, MeasuredPart, register
from torquebench.chain.readings import FloatArray, Readings, known_or, row_of
from torquebench.chain.torque import Component, Shared

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
        Its standard uncertainty.
    largest_rad_s2 : float
        Largest acceleration of the bench, used if none is known.
    """

    title: ClassVar[str] = "inertia between transducer and flange"
    needs: ClassVar[tuple[str, ...]] = ("acceleration_rad_s2",)
    corrects_reading: ClassVar[bool] = True
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
        acceleration = row_of(readings.acceleration_rad_s2, torque_nm.size)
        known = ~np.isnan(acceleration)
        now = np.where(known, acceleration, 0.0)
        of_acceleration = np.where(
            known,
            known_or(readings.acceleration_uncertainty_rad_s2, 0.0),
            self.largest_rad_s2 / np.sqrt(3.0),
        )
        u = np.hypot(self.uncertainty_nm_s2 * now, self.moment_nm_s2 * of_acceleration)
        return (
            Component("inertia", Shared.CALIBRATION, np.copysign(u, now), -self.moment_nm_s2 * now),
        )
