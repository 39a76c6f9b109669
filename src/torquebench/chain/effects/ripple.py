"""Ripple within a revolution over the shaft's angle, as identified from empty runs."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from torquebench.chain.effect import Effect, MeasuredPart, register
from torquebench.chain.effects.rotation import STANDSTILL_RPM
from torquebench.chain.grid import Numbers, Table
from torquebench.chain.readings import FloatArray, Readings, row_of
from torquebench.chain.torque import Component
from torquebench.elementwise import Values
from torquebench.message import Message
from torquebench.uncertainty import Shared
from torquebench.units import MINUTE, TURN

_ALIKE_TURNS = 0.25
"""Share of a turn over which the torque of a ripple keeps its sign."""


def speed_terms(speed_rpm: FloatArray, largest_rpm: float) -> FloatArray:
    """Return the powers of the speed on which the amplitude of an order depends, shape (5, n)."""
    share = speed_rpm / largest_rpm
    turns = np.where(np.abs(speed_rpm) > STANDSTILL_RPM, 1.0, 0.0)
    return np.array([turns * share**power for power in range(5)])


@register("ripple")
@dataclass(frozen=True)
class Ripple(Effect):
    """Torque that repeats with every turn of the shaft: misalignment, unbalance.

    Each order is a cosine and a sine of a multiple of the angle, whose amplitudes are polynomials
    of the speed. A reading is the mean over a window, in which the orders average out in part. A
    reading without an angle isn't corrected, and U contains the size of the ripple in its window,
    which falls for means over more than a quarter turn.

    Parameters
    ----------
    largest_rpm : float
        Largest speed of the empty runs, 1/min: the unit of speed in the polynomials.
    window_s : float
        Windows of the empty runs, s; used if the windows of the readings are unknown.
    orders : tuple of float
        Periods of each order in a turn.
    cosine_nm, sine_nm : table
        Coefficients of `speed_terms` for each order, N·m.
    speeds_rpm, uncertainty_nm : tuple of float
        Nodes of the speed's magnitude, and the standard uncertainty of the correction there, root
        mean square over a turn.
    """

    title: ClassVar[str] = "ripple within a revolution"
    expected: ClassVar[bool] = False  # a window's noise contains it if no run shows it
    needs: ClassVar[tuple[str, ...]] = ("angle_rad", "speed_rpm")
    corrects_reading: ClassVar[bool] = True
    of_turning: ClassVar[bool] = True
    largest_rpm: float = field(metadata={"least": 1e-9})
    window_s: float = field(metadata={"least": 0.0})
    orders: Numbers
    cosine_nm: Table
    sine_nm: Table
    speeds_rpm: Numbers
    uncertainty_nm: Numbers

    def identified(self, range_nm: float) -> tuple[MeasuredPart, ...]:
        """Return the largest root mean square over a revolution at any speed."""
        where = Message("orders {orders}", ", ".join(f"{order:g}" for order in self.orders))
        u = self.uncertainty_nm
        return (MeasuredPart.of("ripple by angle", self.largest_nm, u, range_nm, where),)

    @cached_property
    def largest_nm(self) -> float:
        """Largest root mean square over a revolution, in windows of the empty runs, N·m."""
        cosine, sine = self._waves(np.array(self.speeds_rpm), self.window_s)
        return float(np.max(np.sqrt(0.5 * np.sum(cosine**2 + sine**2, axis=0))))

    @cached_property
    def _coefficients(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        orders = np.array(self.orders)[:, None]
        return orders, np.array(self.cosine_nm), np.array(self.sine_nm)

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the ripple at each reading's angle; without an angle, its size as u."""
        count = len(readings)
        speed, angle = row_of(readings.speed_rpm, count), row_of(readings.angle_rad, count)
        turning = np.where(np.isnan(speed), self.largest_rpm, speed)
        window_s = self.window_s if readings.window_s is None else readings.window_s
        cosine, sine = self._waves(turning, window_s)
        measured = ~np.isnan(angle) & ~np.isnan(speed)
        if measured.all():
            u = np.interp(np.abs(turning), self.speeds_rpm, self.uncertainty_nm)
            added = -self._sum(cosine, sine, angle)
        else:
            own = np.interp(np.abs(turning), self.speeds_rpm, self.uncertainty_nm)
            size = np.sqrt(0.5 * np.sum(cosine**2 + sine**2, axis=0) + own**2)
            u = np.where(measured, own, size)
            added = np.where(
                measured, -self._sum(cosine, sine, np.where(measured, angle, 0.0)), 0.0
            )
        place = self._turns(readings, speed, angle)[:, None] / _ALIKE_TURNS
        return (Component("ripple by angle", Shared.LOADING, u, added, place),)

    def _waves(self, speed_rpm: FloatArray, window_s: float) -> tuple[FloatArray, FloatArray]:
        """Return cosine and sine amplitudes of the orders at speeds, as a window averages them."""
        orders, cosine, sine = self._coefficients
        terms = speed_terms(speed_rpm, self.largest_rpm)
        endless = np.isinf(window_s)
        attenuation = 0.0 if endless else np.sinc(orders * speed_rpm / MINUTE * window_s)
        return attenuation * (cosine @ terms), attenuation * (sine @ terms)

    def _sum(self, cosine: FloatArray, sine: FloatArray, angle_rad: FloatArray) -> FloatArray:
        turned = self._coefficients[0] * angle_rad
        return np.asarray(np.sum(cosine * np.cos(turned) + sine * np.sin(turned), axis=0))

    @staticmethod
    def _turns(readings: Readings, speed: FloatArray, angle: FloatArray) -> FloatArray:
        """Return the turns at each reading by its angle, else by speed and time, else one apart."""
        time_s = row_of(readings.time_s, angle.size)
        apart = np.arange(float(angle.size))  # readings a turn apart have independent errors
        timed = np.isfinite(time_s)
        turns = np.where(timed, np.nan_to_num(speed) / MINUTE * np.where(timed, time_s, 0.0), apart)
        return np.where(np.isnan(angle), turns, angle / TURN)
