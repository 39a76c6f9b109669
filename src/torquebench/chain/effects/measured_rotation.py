"""Measured zero over speed and bearing drag, with the influence of load and running-in."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import sqrt
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from torquebench.chain.effect import Effect, MeasuredPart, Refusal, register
from torquebench.chain.effects.rotation import STANDSTILL_RPM
from torquebench.chain.grid import Numbers, Table, between
from torquebench.chain.readings import FloatArray, Readings, row_of, unknown
from torquebench.chain.torque import Component, by_row
from torquebench.elementwise import (
    NodePosition,
    Values,
    elementwise,
    in_columns,
    in_rows,
    located,
    on_lines,
    on_tables,
)
from torquebench.message import Message
from torquebench.uncertainty import Distribution, Shared

UNKNOWN_LUBRICATION = 0.2 / 3.0**0.5
"""Standard uncertainty of the drag's factor if no run shows it: within ±20 %, rectangular."""
CORRELATION_RPM = 300.0
CORRELATION_K = 10.0
"""Distance in temperature from which on errors are treated as independent."""


@register("measured rotation")
@dataclass(frozen=True)
class MeasuredRotation(Effect):
    """Tables over speed and temperature (empty runs) and over speed and load (rotating reference).

    The zero's shift is the part that is equal in both directions, the drag the part that changes
    sign with the speed. The drag by the load opposes the speed and grows with the magnitude of the
    torque; the change of span is proportional to the torque. Running-in is a part of the drag that
    decays with time.

    Parameters
    ----------
    calibrated_c : float
        Temperature of the static curve, °C, used if a reading has none.
    low_rpm, high_rpm : float
        Speeds between which it was measured, 1/min; speeds beyond them by more than a tenth are
        refused.
    low_c, high_c : float
        Temperatures between which it was measured, °C; the tables' ends limit its use.
    speeds_rpm, at_c : tuple of float
        Nodes of the tables: size of the speed, 1/min, and temperature, °C.
    even_nm, even_uncertainty_nm, odd_nm, odd_uncertainty_nm : table
        Shift of the zero, drag (N·m at positive speed), and their standard uncertainties.
    load_at_nm : tuple of float
        Nodes of the torque's size, N·m; empty if no calibration against a rotating reference
        identified the load-dependent part.
    load_nm, load_uncertainty_nm : table
        Drag by the load over speed and torque, N·m.
    span, span_uncertainty : tuple of float
        Change of the span over the speed's nodes, share of the torque.
    running_in_s : float
        Time in which running-in falls to 1/e, s; 0 for none.
    running_in_nm, running_in_uncertainty_nm : tuple of float
        Additional drag at time 0 over the speed's nodes, N·m.
    noise_nm : tuple of float
        Additional standard deviation of single readings in the empty runs over that of the
        calibration's points, over the speed's nodes, N·m: by transducer, drive and misalignment.
    window_s : float
        Length of the empty runs' windows, s: shorter windows are noisier. 0 if unknown.
    lubrication, lubrication_uncertainty : float
        Factor on the drag by the present state of the lubricant, and its standard uncertainty.
    """

    title: ClassVar[str] = "rotation, measured"
    needs: ClassVar[tuple[str, ...]] = ("speed_rpm", "temperature_c", "time_s")
    corrects_reading: ClassVar[bool] = True
    of_turning: ClassVar[bool] = True
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
    noise_nm: Numbers = ()
    window_s: float = 0.0
    lubrication: float = field(default=1.0, metadata={"least": 0.0})
    lubrication_uncertainty: float = field(default=UNKNOWN_LUBRICATION, metadata={"least": 0.0})

    def identified(self, range_nm: float) -> tuple[MeasuredPart, ...]:
        """Return the largest values of each table between the measured temperatures."""
        nodes = np.array(self.at_c)
        here = (nodes >= self.low_c - 2.0) & (nodes <= self.high_c + 2.0)
        where = Message("{low:.4g} to {high:.4g} 1/min", self.low_rpm, self.high_rpm)
        even, even_u, odd, odd_u = self._tables[:, :, here]
        parts = [
            MeasuredPart.of("zero over speed", even, even_u, range_nm, where),
            MeasuredPart.of(
                "bearing drag",
                self.lubrication * odd,
                np.hypot(self.lubrication * odd_u, self.lubrication_uncertainty * odd),
                range_nm,
                where,
            ),
        ]
        if self.load_at_nm:
            load, load_u = self.load_nm, self.load_uncertainty_nm
            parts.append(MeasuredPart.of("drag over load", load, load_u, range_nm, where))
        if self.span:
            span, span_u = self.span, self.span_uncertainty
            parts.append(MeasuredPart.of("span over speed", span, span_u, 1.0, where))
        if self.running_in_s:
            drag, drag_u = self.running_in_nm, self.running_in_uncertainty_nm
            over = Message("over {running_in_s:.3g} s", self.running_in_s)
            parts.append(MeasuredPart.of("running-in", drag, drag_u, range_nm, over))
        return tuple(parts)

    @cached_property
    def _tables(self) -> FloatArray:
        return np.array([self.even_nm, self.even_uncertainty_nm, self.odd_nm,
                         self.odd_uncertainty_nm])  # fmt: skip

    @cached_property
    def _columns(self) -> FloatArray:
        """Rows over speed: span and its u, running-in and its u, noise."""
        columns = (self.span, self.span_uncertainty, self.running_in_nm,
                   self.running_in_uncertainty_nm, self.noise_nm)  # fmt: skip
        return np.array([column or np.zeros(len(self.speeds_rpm)) for column in columns])

    @cached_property
    def _loads(self) -> FloatArray:
        """Tables of the drag by the load and its u over speed and torque."""
        shape = (2, len(self.speeds_rpm), len(self.load_at_nm))
        return np.array(
            [self.load_nm, self.load_uncertainty_nm] if self.load_at_nm else []
        ).reshape(shape)

    @cached_property
    def _at_unknown_temperature(self) -> FloatArray:
        """Tables for an unknown temperature: those of the calibration's, with a larger u."""
        nodes = self._nodes[1]
        rows = np.arange(float(len(self.speeds_rpm)))
        around = np.array(
            [
                on_tables(self._tables, located(rows, rows), located(nodes, celsius))
                for celsius in (self.calibrated_c, *between(nodes, self.low_c, self.high_c))
            ]
        )
        tables, spread = around[0], np.max(np.abs(around - around[0]), axis=0) / np.sqrt(3.0)
        tables[1], tables[3] = np.hypot(tables[1], spread[0]), np.hypot(tables[3], spread[2])
        return np.asarray(tables)

    @cached_property
    def _nodes(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return np.array(self.speeds_rpm), np.array(self.at_c), np.array(self.load_at_nm)

    @cached_property
    def _at_unknown_speed(self) -> FloatArray:
        """U of zero, drag, span and running-in at an unknown speed, and the largest drag."""
        even, even_u, odd, odd_u = self._tables
        span, span_u, running, running_u, _ = self._columns
        pairs = ((even, even_u), (odd, odd_u), (span, span_u), (running, running_u))
        return np.array([*(np.max(_within(*pair)) for pair in pairs), np.max(np.abs(odd))])

    @cached_property
    def _load_at_unknown_speed(self) -> FloatArray:
        """U of the drag by the load at an unknown speed, and its largest value, over the torque."""
        load, load_u = self._loads
        return np.array([np.max(_within(load, load_u), axis=0), np.max(np.abs(load), axis=0)])

    @cached_property
    def _limits_rpm(self) -> tuple[float, float]:
        return 1.1 * min(self.low_rpm, 0.0), 1.1 * max(self.high_rpm, 0.0)

    def gaps(self) -> tuple[str, ...]:
        """Name load-dependent parts if no rotating reference identified them."""
        return () if self.load_at_nm else ("drag over load, span over speed",)

    def outside(self, readings: Readings) -> Refusal | None:
        """Return the readings whose speed or temperature is outside the tables."""
        speed = row_of(readings.speed_rpm, readings.reading_nm.size)
        low, high = self._limits_rpm
        rows = (speed < low) | (speed > high)
        if rows.any():
            allowed = Message("{low:.4g} to {high:.4g} 1/min", low, high)
            return Refusal(rows, Message("speed {speed:.4g} 1/min", speed[rows][0]), allowed)
        now = row_of(readings.temperature_c, readings.reading_nm.size)
        rows = self._refused(speed, now)
        if not rows.any():
            return None
        allowed = Message(
            "{lowest_c:.4g} to {highest_c:.4g} °C while it turns", self.at_c[0], self.at_c[-1]
        )
        return Refusal(rows, Message("temperature {now:.4g} °C", now[rows][0]), allowed)

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the effects of rotation at each reading's speed, temperature, load and time."""
        zero_u, zero, drag_u, drag, lubrication, noise, running, running_u, *place = (
            self._contributions(readings, torque_nm)
        )
        where = in_columns(torque_nm, *place)
        shape = by_row(unknown(readings.speed_rpm), Distribution.RECTANGULAR, Distribution.NORMAL)
        stated = self.lubrication_uncertainty == UNKNOWN_LUBRICATION
        state = Distribution.RECTANGULAR if stated else Distribution.NORMAL
        parts = [
            Component("zero over speed", Shared.CALIBRATION, zero_u, zero, where, shape),
            Component("bearing drag", Shared.MOUNTING, drag_u, drag, where, shape),
            Component("lubrication", Shared.MOUNTING, lubrication, distribution=state),
        ]
        if self.noise_nm:
            parts.append(Component("noise in a window", Shared.NOTHING, noise))
        if self.running_in_s > 0.0:
            parts.append(self._running_in(readings, running, running_u))
        return tuple(parts)

    def _contributions(self, readings: Readings, torque_nm: Values) -> Any:
        """Return one row for each contribution to the torque, and the place.

        The rows are u and correction of the zero, u and correction of the drag, u by the
        lubrication, the noise, the running-in's drag at time 0 and its u, and the place over speed
        and temperature in correlation lengths.
        """
        window_s = readings.window_s
        number, (speed, celsius, torque) = elementwise(
            torque_nm, readings.speed_rpm, readings.temperature_c, torque_nm
        )
        nodes_rpm, nodes_c, nodes_nm = self._nodes
        size = abs(speed)
        nowhere, cold = number.isnan(speed), number.isnan(celsius)
        turns = size > STANDSTILL_RPM
        size = number.where(nowhere, nodes_rpm.item(-1), size)
        warm = number.where(cold, self.calibrated_c, celsius)
        row = located(nodes_rpm, size)
        zero, zero_u, drag, drag_u = on_tables(self._tables, row, located(nodes_c, warm))
        if number.any(cold):
            unknown_c = on_lines(self._at_unknown_temperature, row)
            zero, zero_u, drag, drag_u = (
                number.where(cold, *pair)
                for pair in zip(unknown_c, (zero, zero_u, drag, drag_u), strict=True)
            )
        span, span_u, running, running_u, noise = on_lines(self._columns, row)
        span_u = span_u * torque
        zero_u = number.sqrt(zero_u * zero_u + span_u * span_u)
        column = located(nodes_nm, abs(torque)) if nodes_nm.size else None
        if column is not None:
            load, load_u = on_tables(self._loads, row, column)
            drag, drag_u = drag + load, number.sqrt(drag_u * drag_u + load_u * load_u)
        sign = number.where(turns, number.copysign(1.0, speed), 0.0)
        low, high = self._limits_rpm
        outside = (speed < low) | (speed > high)
        outside |= turns & ((celsius < nodes_c.item(0)) | (celsius > nodes_c.item(-1)))
        shift = number.where(turns, -(zero + span * torque), 0.0)
        drag = -(sign * drag)
        rows = [
            number.where(turns, zero_u, 0.0),
            number.where(outside, np.nan, shift),
            self.lubrication * (sign * drag_u),
            self.lubrication * drag,
            self.lubrication_uncertainty * drag,
            sign * running_u,
        ]
        if number.any(nowhere):
            largest = self._over_all_speeds(number, torque, column)
            rows = [number.where(nowhere, *pair) for pair in zip(largest, rows, strict=True)]
        longer = self.window_s / window_s if self.window_s and window_s else 1.0
        return in_rows(
            torque_nm,
            *rows[:5],
            sqrt(longer) * noise,
            sign * running,
            rows[5],
            number.where(nowhere, 0.0, size) / CORRELATION_RPM,
            warm / CORRELATION_K,
        )

    def _over_all_speeds(
        self, number: Any, torque: Any, column: NodePosition | None
    ) -> tuple[Any, ...]:
        """Return zero, drag and lubrication at an unknown speed, and u of the running-in.

        Corrections are then 0, and the uncertainties hold for all measured speeds.
        """
        zero_u, drag_u, span_u, running_u, most = self._at_unknown_speed.tolist()
        span_u = span_u * torque
        if column is not None:
            load_u, load = on_lines(self._load_at_unknown_speed, column)
            drag_u, most = number.sqrt(drag_u * drag_u + load_u * load_u), most + load
        return (
            number.sqrt(zero_u * zero_u + span_u * span_u),
            0.0,
            self.lubrication * drag_u,
            0.0,
            self.lubrication_uncertainty * most,
            running_u,
        )

    def _running_in(self, readings: Readings, start: Values, start_u: Values) -> Component:
        """Return the effect of running-in; at an unknown time, between none and all of it."""
        if readings.time_s is None or readings.of_bench:
            u = np.copysign(np.hypot(start / np.sqrt(3.0), start_u), start_u)
            return Component(
                "running-in", Shared.MOUNTING, u, distribution=Distribution.RECTANGULAR
            )
        share = np.exp(-np.maximum(readings.time_s, 0.0) / self.running_in_s)
        return Component("running-in", Shared.MOUNTING, start_u * share, -start * share)

    def _refused(self, speed: FloatArray, celsius: FloatArray) -> NDArray[np.bool_]:
        """Return the readings beyond the speeds, or while turning beyond the temperatures."""
        low, high = self._limits_rpm
        cold_or_hot = (celsius < self.at_c[0]) | (celsius > self.at_c[-1])
        turns = np.abs(speed) > STANDSTILL_RPM
        return np.asarray((speed < low) | (speed > high) | (turns & cold_or_hot))


def _within(size: FloatArray, u: FloatArray) -> FloatArray:
    """Return u of a value anywhere within ± a size (rectangular), combined with another u."""
    return np.asarray(np.hypot(size / np.sqrt(3.0), u))
