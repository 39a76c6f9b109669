"""Temperature effect on zero and span, as measured on one chain."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from math import sqrt
from typing import Any, ClassVar

import numpy as np

from torquebench.chain.effect import Effect, MeasuredPart, Refusal, register
from torquebench.chain.effects.temperature import Temperature
from torquebench.chain.grid import Numbers, between
from torquebench.chain.readings import FloatArray, Known, Readings, known_or, row_of, unknown
from torquebench.chain.torque import Component, by_row
from torquebench.elementwise import Values, elementwise, in_columns, in_rows, located, on_lines
from torquebench.message import Message
from torquebench.uncertainty import Distribution, Shared

CORRELATION_K = 10.0
"""Distance in temperature from which on errors of the curves are treated as independent."""


@register("measured temperature")
@dataclass(frozen=True)
class MeasuredTemperature(Effect):
    """Zero and span over temperature, from empty runs and calibrations at several temperatures.

    Both are relative to the calibration's temperature. A zero that was taken at another temperature
    already contains the change up to that temperature. Outside the measured temperatures, up to the
    ends of the table, the curves are extrapolated with a larger uncertainty.

    Parameters
    ----------
    calibrated_c : float
        Temperature of the static curve, °C.
    low_c, high_c : float
        Temperatures between which it was measured, °C.
    at_c : tuple of float
        Nodes of the curves, °C; a temperature outside them is refused.
    zero_nm, zero_uncertainty_nm : tuple of float
        Change of the zero and its standard uncertainty, N·m.
    span, span_uncertainty : tuple of float
        Change of the span and its standard uncertainty, share of the torque; empty if not
        identified.
    deviation_k : float
        Limit of the change in the difference between probe and transducer since these measurements,
        K: while the temperature changes, the shaft has a gradient.
    """

    title: ClassVar[str] = "temperature of zero and span, measured"
    needs: ClassVar[tuple[str, ...]] = ("temperature_c", "zero_temperature_c")
    corrects_reading: ClassVar[bool] = True
    of_turning: ClassVar[bool] = True
    influence: ClassVar[str] = "temperature"
    calibrated_c: float
    low_c: float
    high_c: float
    at_c: Numbers
    zero_nm: Numbers
    zero_uncertainty_nm: Numbers
    span: Numbers = ()
    span_uncertainty: Numbers = ()
    deviation_k: float = field(default=0.5, metadata={"least": 0.0})

    def identified(self, range_nm: float) -> tuple[MeasuredPart, ...]:
        """Return the largest changes of zero and span between the measured temperatures."""
        here = (self._nodes >= self.low_c) & (self._nodes <= self.high_c)
        zero, zero_u, span, span_u = self._curves[:, here]
        where = Message("{lowest_c:.3g} to {highest_c:.3g} °C", self.low_c, self.high_c)
        parts = [MeasuredPart.of("zero over temperature", zero, zero_u, range_nm, where)]
        if self.span:
            parts.append(MeasuredPart.of("span over temperature", span, span_u, 1.0, where))
        return tuple(parts)

    @cached_property
    def _nodes(self) -> FloatArray:
        return np.array(self.at_c)

    @cached_property
    def _curves(self) -> FloatArray:
        """Rows over temperature: zero and its u, span and its u."""
        nothing = np.zeros(len(self.at_c))
        curves = (self.zero_nm, self.zero_uncertainty_nm, self.span, self.span_uncertainty)
        return np.array([curve or nothing for curve in curves])

    @cached_property
    def _curves_and_slopes(self) -> FloatArray:
        """The curves, and the slopes of zero and span per kelvin."""
        slopes = np.gradient(self._curves[::2], self._nodes, axis=1)
        return np.concatenate([self._curves, slopes])

    @cached_property
    def _unknown(self) -> tuple[float, float]:
        """Standard uncertainties of zero (N·m) and span at an unknown temperature: rectangular."""
        measured = located(self._nodes, between(self._nodes, self.low_c, self.high_c))
        zero, zero_u, span, span_u = on_lines(self._curves, measured)
        root = np.sqrt(3.0)
        return (
            float(np.max(np.hypot(zero / root, zero_u))),
            float(np.max(np.hypot(span / root, span_u))),
        )

    def outside(self, readings: Readings) -> Refusal | None:
        """Return the readings whose temperature is outside the curves."""
        now = row_of(readings.temperature_c, readings.reading_nm.size)
        rows = (now < self.at_c[0]) | (now > self.at_c[-1])
        if not rows.any():
            return None
        allowed = Message("{lowest_c:.4g} to {highest_c:.4g} °C", self.at_c[0], self.at_c[-1])
        return Refusal(rows, Message("temperature {now:.4g} °C", now[rows][0]), allowed)

    def gaps(self) -> tuple[str, ...]:
        """Name the span if it wasn't identified."""
        return () if self.span else ("temperature of span",)

    def left_of(self, limit: Effect) -> Effect | None:
        """Return the limit of the span, if the span wasn't identified."""
        assert isinstance(limit, Temperature)
        if self.span or limit.span_per_k is None:
            return None
        return replace(limit, zero_nm_per_k=0.0, calibrated_c=self.calibrated_c)

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return zero, span and the effect of a gradient, at the temperature of each reading."""
        now_c = readings.temperature_c
        zero_u, zero, span_u, span, place, slope = self._contributions(
            now_c, readings.zero_temperature_c, torque_nm
        )
        where = in_columns(torque_nm, place)
        shape = by_row(unknown(now_c), Distribution.RECTANGULAR, Distribution.NORMAL)
        parts = [Component("temperature of zero", Shared.ZEROING, zero_u, zero, where, shape)]
        if self.span:
            parts.append(
                Component("temperature of span", Shared.CALIBRATION, span_u, span, where, shape)
            )
        gradient = self.deviation_k / sqrt(3.0) * slope
        parts.append(
            Component(
                "temperature gradient",
                Shared.LOADING,
                gradient,
                distribution=Distribution.RECTANGULAR,
            )
        )
        return tuple(parts)

    def _contributions(self, now_c: Known, zeroed_c: Known, torque_nm: Values) -> Any:
        """Return rows: u of the zero, its correction, u of the span, its correction, place, slope.

        The place is a temperature in correlation lengths; the slope is that of the reading, N·m/K.
        """
        before_c = known_or(zeroed_c, self.calibrated_c)
        number, (now, zeroed, torque) = elementwise(torque_nm, now_c, before_c, torque_nm)
        nodes, curves, (zero_range, span_range) = (
            self._nodes,
            self._curves_and_slopes,
            self._unknown,
        )
        nowhere = number.isnan(now)
        warm = number.where(nowhere, self.calibrated_c, now)
        zero, of_zero, span, of_span, zero_slope, span_slope = on_lines(
            curves, located(nodes, warm)
        )
        before, of_before = on_lines(curves[:2], located(nodes, zeroed))
        near = number.minimum(abs(warm - zeroed) / CORRELATION_K, 1.0)
        zero_u = near * number.sqrt(of_zero * of_zero + of_before * of_before)
        outside = (warm < nodes.item(0)) | (warm > nodes.item(-1))
        shift = number.where(outside, np.nan, before - zero)
        return in_rows(
            torque_nm,
            number.where(nowhere, zero_range, zero_u),
            number.where(nowhere, 0.0, shift),
            number.where(nowhere, span_range, of_span) * torque,
            number.where(nowhere, 0.0, -span * torque),
            warm / CORRELATION_K,
            number.where(nowhere, 0.0, zero_slope + span_slope * torque),
        )
