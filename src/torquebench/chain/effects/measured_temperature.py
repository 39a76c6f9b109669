"""Temperature of zero and span as it was measured on one chain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from torquebench.chain.effect import Effect, Refusal, register
from torquebench.chain.grid import Numbers, between, linear, located, numbers
from torquebench.chain.readings import FloatArray, Readings, known_or
from torquebench.chain.torque import Component, Shared

__all__ = ["MeasuredTemperature"]

CORRELATION_K = 10.0
"""Errors of the curves at temperatures farther apart count as independent."""


@register("measured temperature")
@dataclass(frozen=True)
class MeasuredTemperature(Effect):
    """Zero and span over temperature, by empty runs and calibrations at several temperatures.

    Both count from the calibration's temperature. A zero that was taken at another temperature
    takes its own change with it. Between the temperatures that were measured and the ends of the
    table the curves are extrapolated, with the uncertainty that this has.

    Parameters
    ----------
    calibrated_c : float
        Temperature that the static curve holds at, °C.
    low_c, high_c : float
        Temperatures between which it was measured, °C.
    at_c : tuple of float
        Nodes of the curves, °C; a temperature outside them is refused.
    zero_nm, zero_uncertainty_nm : tuple of float
        Change of the zero and its standard uncertainty, N·m.
    span, span_uncertainty : tuple of float
        The same of the span, share of the torque; empty where it wasn't identified.
    """

    title: ClassVar[str] = "temperature of zero and span, measured"
    needs: ClassVar[tuple[str, ...]] = ("temperature_c", "zero_temperature_c")
    corrects_reading: ClassVar[bool] = True
    influence: ClassVar[str] = "temperature"
    calibrated_c: float
    low_c: float
    high_c: float
    at_c: Numbers
    zero_nm: Numbers
    zero_uncertainty_nm: Numbers
    span: Numbers = ()
    span_uncertainty: Numbers = ()

    @classmethod
    def from_specification(cls, values: Mapping[str, Any]) -> Self:
        """Return the effect that `specification` described."""
        plain: dict[str, Any] = {
            name: numbers(value) if isinstance(value, list | tuple) else value
            for name, value in values.items()
        }
        return cls(**plain)

    @cached_property
    def _nodes(self) -> FloatArray:
        return np.array(self.at_c)

    @cached_property
    def _curves(self) -> tuple[FloatArray, ...]:
        nothing = np.zeros(len(self.at_c))
        return tuple(
            np.array(each) if each else nothing
            for each in (self.zero_nm, self.zero_uncertainty_nm, self.span, self.span_uncertainty)
        )

    @cached_property
    def _unknown(self) -> tuple[float, float]:
        """What an unknown temperature makes of zero (N·m) and span: rectangular."""
        measured = located(self._nodes, between(self._nodes, self.low_c, self.high_c))
        zero, zero_u, span, span_u = (linear(curve, measured) for curve in self._curves)
        root = np.sqrt(3.0)
        return (
            float(np.max(np.hypot(zero / root, zero_u))),
            float(np.max(np.hypot(span / root, span_u))),
        )

    def outside(self, readings: Readings) -> Refusal | None:
        """Return which temperatures the curves don't reach."""
        now = np.broadcast_to(known_or(readings.temperature_c, np.nan), readings.reading_nm.shape)
        rows = (now < self.at_c[0]) | (now > self.at_c[-1])
        if not rows.any():
            return None
        allowed = f"{self.at_c[0]:.4g} to {self.at_c[-1]:.4g} °C"
        return Refusal(rows, f"temperature {now[rows][0]:.4g} °C", allowed)

    def gaps(self) -> tuple[str, ...]:
        """Name the span, where it wasn't identified."""
        return () if self.span else ("temperature of span",)

    def components(self, readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        """Return zero and span at the temperature of each reading."""
        zero, zero_u, span, span_u = self._curves
        now = np.broadcast_to(known_or(readings.temperature_c, np.nan), torque_nm.shape)
        known = ~np.isnan(now)
        at = located(self._nodes, np.where(known, now, self.calibrated_c))
        refused = known & ((now < self.at_c[0]) | (now > self.at_c[-1]))
        zeroed = known_or(readings.zero_temperature_c, self.calibrated_c)
        before = located(self._nodes, zeroed)
        shift = linear(zero, at) - linear(zero, before)
        near = np.minimum(np.abs(now - zeroed) / CORRELATION_K, 1.0)
        shift_u = near * np.hypot(linear(zero_u, at), linear(zero_u, before))
        factor, factor_u = linear(span, at), linear(span_u, at)
        unknown_zero, unknown_span = self._unknown
        place = (np.where(known, now, self.calibrated_c) / CORRELATION_K)[:, None]
        return (
            Component(
                "temperature of zero",
                Shared.ZEROING,
                np.where(known, shift_u, unknown_zero),
                np.where(refused, np.nan, np.where(known, -shift, 0.0)),
                place,
            ),
            Component(
                "temperature of span",
                Shared.CALIBRATION,
                np.where(known, factor_u, unknown_span) * torque_nm,
                np.where(known, -factor, 0.0) * torque_nm,
                place,
            ),
        )
