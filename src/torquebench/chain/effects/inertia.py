"""Inertia of the rotating parts between transducer and flange."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import ClassVar

from torquebench.chain.effect import Effect, MeasuredPart, register
from torquebench.chain.readings import Readings, known_or, unknown
from torquebench.chain.torque import Component, by_row
from torquebench.elementwise import Values, elementwise, in_rows
from torquebench.uncertainty import Distribution, Shared


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

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the inertia's torque at the acceleration of each reading."""
        number, (acceleration, uncertainty) = elementwise(
            torque_nm,
            readings.acceleration_rad_s2,
            known_or(readings.acceleration_uncertainty_rad_s2, 0.0),
        )
        nowhere = number.isnan(acceleration)
        now = number.where(nowhere, 0.0, acceleration)
        of_now = number.where(nowhere, self.largest_rad_s2 / sqrt(3.0), uncertainty)
        by_moment, by_now = self.uncertainty_nm_s2 * now, self.moment_nm_s2 * of_now
        size = number.sqrt(by_moment * by_moment + by_now * by_now)
        u, added = in_rows(torque_nm, number.copysign(size, now), -self.moment_nm_s2 * now)
        shape = by_row(
            unknown(readings.acceleration_rad_s2), Distribution.RECTANGULAR, Distribution.NORMAL
        )
        return (Component("inertia", Shared.CALIBRATION, u, added, distribution=shape),)
