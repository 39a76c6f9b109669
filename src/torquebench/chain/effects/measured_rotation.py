"""Zero over speed, bearing drag and what load and running-in make of them, as measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from torquebench.chain.effect import Effect, Refusal, register
from torquebench.chain.effects.rotation import STANDSTILL_RPM
from torquebench.chain.grid import (
    Numbers,
    Place,
    Table,
    between,
    bilinear,
    linear,
    located,
    numbers,
)
from torquebench.chain.readings import FloatArray, Readings, known_or
from torquebench.chain.torque import Component, Shared

__all__ = ["MeasuredRotation"]

CORRELATION_RPM = 300.0
CORRELATION_K = 10.0
"""Errors at speeds or temperatures farther apart count as independent."""


@register("measured rotation")
@dataclass(frozen=True)
class MeasuredRotation(Effect):
    """Tables over speed and temperature by empty runs, over speed and load by a turning reference.

    The zero's shift is the part that is the same in both directions, the drag the part that turns
    round with the speed. Drag that grows with the load is a share of the torque's size against the
    speed, the span over speed a share of the torque. Running-in is a part of the drag that dies
    away with time.

    Parameters
    ----------
    calibrated_c : float
        Temperature of the static curve, °C: what counts where none is known.
    low_rpm, high_rpm : float
        Speeds between which it was measured, 1/min; one farther out by more than a tenth is
        refused.
    low_c, high_c : float
        Temperatures between which it was measured, °C; the tables' ends limit its use.
    speeds_rpm, at_c : tuple of float
        Nodes of the tables: size of the speed, 1/min, and temperature, °C.
    even_nm, even_uncertainty_nm, odd_nm, odd_uncertainty_nm : table
        Shift of the zero, drag (N·m at positive speed), and their standard uncertainties.
    load_at_nm : tuple of float
        Nodes of the torque's size, N·m; empty where no calibration against a turning reference
        identified what grows with the load.
    load_nm, load_uncertainty_nm : table
        Drag by the load over speed and torque, N·m.
    span, span_uncertainty : tuple of float
        Change of the span over the speed's nodes, share of the torque.
    running_in_s : float
        Time in which running-in falls to 1/e, s; 0 for none.
    running_in_nm, running_in_uncertainty_nm : tuple of float
        Additional drag at time 0 over the speed's nodes, N·m.
    """

    title: ClassVar[str] = "rotation, measured"
    needs: ClassVar[tuple[str, ...]] = ("speed_rpm", "temperature_c", "time_s")
    corrects_reading: ClassVar[bool] = True
    influence: ClassVar[str] = "rotation"
    calibrated_c: float
    low_rpm: float
    high_rpm: float
    low_c: float
    high_c: float
    speeds_rpm: Numbers
    at_c: Numbers
    even_nm: Table
    even_uncertainty_nm: Table
    odd_nm: Table
    odd_uncertainty_nm: Table
    load_at_nm: Numbers = ()
    load_nm: Table = ()
    load_uncertainty_nm: Table = ()
    span: Numbers = ()
    span_uncertainty: Numbers = ()
    running_in_s: float = 0.0
    running_in_nm: Numbers = ()
    running_in_uncertainty_nm: Numbers = ()

    @classmethod
    def from_specification(cls, values: Mapping[str, Any]) -> Self:
        """Return the effect that `specification` described."""

        def plain(value: Any) -> Any:
            if not isinstance(value, list | tuple):
                return value
            if value and isinstance(value[0], list | tuple):
                return tuple(numbers(row) for row in value)
            return numbers(value)

        return cls(**{name: plain(value) for name, value in values.items()})

    @cached_property
    def _tables(self) -> tuple[FloatArray, ...]:
        return tuple(
            np.array(each)
            for each in (
                self.even_nm,
                self.even_uncertainty_nm,
                self.odd_nm,
                self.odd_uncertainty_nm,
            )
        )

    @cached_property
    def _columns(self) -> tuple[FloatArray, ...]:
        nothing = np.zeros(len(self.speeds_rpm))
        return tuple(
            np.array(each) if each else nothing
            for each in (
                self.span,
                self.span_uncertainty,
                self.running_in_nm,
                self.running_in_uncertainty_nm,
            )
        )

    @cached_property
    def _loads(self) -> tuple[FloatArray, FloatArray]:
        return np.array(self.load_nm), np.array(self.load_uncertainty_nm)

    @cached_property
    def _limits_rpm(self) -> tuple[float, float]:
        return 1.1 * min(self.low_rpm, 0.0), 1.1 * max(self.high_rpm, 0.0)

    def gaps(self) -> tuple[str, ...]:
        """Name what grows with the load, where no turning reference identified it."""
        return () if self.load_at_nm else ("drag over load, span over speed",)

    def outside(self, readings: Readings) -> Refusal | None:
        """Return which speeds and temperatures the tables don't reach."""
        shape = readings.reading_nm.shape
        speed = np.broadcast_to(known_or(readings.speed_rpm, np.nan), shape)
        low, high = self._limits_rpm
        rows = (speed < low) | (speed > high)
        if rows.any():
            allowed = f"{low:.4g} to {high:.4g} 1/min"
            return Refusal(rows, f"speed {speed[rows][0]:.4g} 1/min", allowed)
        now = np.broadcast_to(known_or(readings.temperature_c, np.nan), shape)
        rows = self._refused(speed, now)
        if not rows.any():
            return None
        allowed = f"{self.at_c[0]:.4g} to {self.at_c[-1]:.4g} °C while it turns"
        return Refusal(rows, f"temperature {now[rows][0]:.4g} °C", allowed)

    def components(self, readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        """Return what turning adds at the speed, temperature, load and time of each reading."""
        even, even_u, odd, odd_u = self._tables
        span, span_u, running, running_u = self._columns
        shape = torque_nm.shape
        speed = np.broadcast_to(known_or(readings.speed_rpm, np.nan), shape)
        known = ~np.isnan(speed)
        sign = np.where(np.abs(speed) > STANDSTILL_RPM, np.sign(speed), 0.0)
        sign = np.where(known, sign, 0.0)
        turns = np.abs(sign)
        row = located(np.array(self.speeds_rpm), np.where(known, np.abs(speed), 0.0))
        celsius = np.broadcast_to(known_or(readings.temperature_c, np.nan), shape)
        warm = ~np.isnan(celsius)
        column = located(np.array(self.at_c), np.where(warm, celsius, self.calibrated_c))
        refused = self._refused(speed, celsius)
        unknown = [
            float(np.max(np.hypot(v / np.sqrt(3.0), u))) for v, u in ((even, even_u), (odd, odd_u))
        ]
        place = np.column_stack(
            [
                np.where(known, speed, 0.0) / CORRELATION_RPM,
                np.where(warm, celsius, self.calibrated_c) / CORRELATION_K,
            ]
        )
        shift, shift_u = self._at(even, even_u, row, column, warm)
        drag, drag_u = self._at(odd, odd_u, row, column, warm)
        span_now, span_now_u = linear(span, row), linear(span_u, row)
        load, load_u = self._by_load(row, np.abs(torque_nm))
        found = [
            Component(
                "zero over speed",
                Shared.CALIBRATION,
                np.where(known, turns * np.hypot(shift_u, span_now_u * torque_nm), unknown[0]),
                np.where(refused, np.nan, -turns * (shift + span_now * torque_nm)),
                place,
            ),
            Component(
                "bearing drag",
                Shared.MOUNTING,
                np.where(known, sign * np.hypot(drag_u, load_u), unknown[1]),
                -sign * (drag + load),
                place,
            ),
        ]
        if self.running_in_s > 0.0:
            found.append(self._running_in(readings, sign, row, running, running_u))
        return tuple(found)

    def _by_load(self, row: Place, size_nm: FloatArray) -> tuple[FloatArray, FloatArray]:
        if not self.load_at_nm:
            nothing = np.zeros(size_nm.shape)
            return nothing, nothing
        column = located(np.array(self.load_at_nm), size_nm)
        value, uncertainty = self._loads
        return bilinear(value, row, column), bilinear(uncertainty, row, column)

    def _running_in(
        self, readings: Readings, sign: FloatArray, row: Place, value: FloatArray, u: FloatArray
    ) -> Component:
        """Return what running-in adds; at an unknown time anything from nothing to all of it."""
        start, start_u = linear(value, row), linear(u, row)
        if readings.time_s is None:
            return Component(
                "running-in", Shared.MOUNTING, sign * np.hypot(start / np.sqrt(3.0), start_u)
            )
        left = np.exp(-np.maximum(readings.time_s, 0.0) / self.running_in_s)
        return Component("running-in", Shared.MOUNTING, sign * start_u * left, -sign * start * left)

    def _at(
        self,
        value: FloatArray,
        uncertainty: FloatArray,
        row: Place,
        column: Place,
        warm: NDArray[np.bool_],
    ) -> tuple[FloatArray, FloatArray]:
        """Return a table's value and uncertainty; without a temperature over all measured ones."""
        u = bilinear(uncertainty, row, column)
        if not warm.all():
            nodes = np.array(self.at_c)
            around = [
                bilinear(value, row, located(nodes, np.full(u.shape, celsius)))
                for celsius in (self.calibrated_c, *between(nodes, self.low_c, self.high_c))
            ]
            spread = np.max(np.abs(np.array(around) - around[0]), axis=0) / np.sqrt(3.0)
            u = np.where(warm, u, np.hypot(u, spread))
        return bilinear(value, row, column), u

    def _refused(self, speed: FloatArray, celsius: FloatArray) -> NDArray[np.bool_]:
        low, high = self._limits_rpm
        cold_or_hot = (celsius < self.at_c[0]) | (celsius > self.at_c[-1])
        turns = np.abs(speed) > STANDSTILL_RPM
        return np.asarray((speed < low) | (speed > high) | (turns & cold_or_hot))
