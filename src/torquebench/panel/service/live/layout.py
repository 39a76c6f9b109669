"""A user's layout of the live page: channels, scales and time span."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from torquebench.message import Message
from torquebench.panel.service.live.hub import SIGNALS

__all__ = ["DEFAULT_LAYOUT", "BandLayout", "LiveLayout", "Scale", "Span"]

Span = Literal["seconds_10", "minute_1", "minutes_10", "hour_1"]
_SIGNALS = {signal.name: signal for signal in SIGNALS}
BOTH_SIDES = ("N·m", "rpm", "°", "rad/s²")
"""Units with a separate scale per side, because the sides' values differ by the ratio."""
MOST_SCALES = 2
Finite = Annotated[float, Field(allow_inf_nan=False)]


class Scale(BaseModel):
    """Range of an axis: that of the values, of the bench, or fixed.

    Parameters
    ----------
    kind : {"automatic", "range", "fixed"}
    low, high : float
        Ends of a fixed range, in the axis's unit.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: Literal["automatic", "range", "fixed"] = "automatic"
    low: Finite = 0.0
    high: Finite = 0.0

    @model_validator(mode="after")
    def _ordered(self) -> Scale:
        if self.kind == "fixed" and not self.low < self.high:
            raise ValueError(
                Message(
                    "the lower end {low:g} is not below the upper end {high:g}", self.low, self.high
                )
            )
        return self


class BandLayout(BaseModel):
    """A chart of the live page: its signals, and the range of its left scale."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    signals: tuple[str, ...] = ()
    scale: Scale = Scale()

    @model_validator(mode="after")
    def _two_scales(self) -> BandLayout:
        unknown = [name for name in self.signals if name not in _SIGNALS]
        if unknown:
            raise ValueError(Message("there is no signal {name!r}", unknown[0][:80]))
        if len(self.axes) > MOST_SCALES:
            units = ", ".join(dict.fromkeys(unit for unit, _ in self.axes))
            raise ValueError(
                Message(
                    "one chart has {most} scales at most, not more for {units}", MOST_SCALES, units
                )
            )
        return self

    @property
    def axes(self) -> tuple[tuple[str, str], ...]:
        """Unit and side (empty for both) of each scale, the left one first."""
        return tuple(dict.fromkeys(self._axis(name) for name in self.signals))

    def axis(self, name: str) -> int:
        """Return the scale of a signal: 0 is the left one, 1 the right one."""
        return self.axes.index(self._axis(name))

    def _axis(self, name: str) -> tuple[str, str]:
        signal = _SIGNALS[name]
        units = {_SIGNALS[each].unit for each in self.signals}
        apart = len(units) == 1 and signal.unit in BOTH_SIDES
        return signal.unit, signal.side if apart else ""


class LiveLayout(BaseModel):
    """A person's layout of the live page.

    Parameters
    ----------
    span : str
    bands : tuple of BandLayout
        Charts from top to bottom; those without signals aren't drawn.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    span: Span = "seconds_10"
    bands: Annotated[tuple[BandLayout, ...], Field(min_length=1, max_length=4)]

    @model_validator(mode="after")
    def _something(self) -> LiveLayout:
        if not any(band.signals for band in self.bands):
            raise ValueError("no signal is chosen: choose one at least")
        return self


DEFAULT_LAYOUT = LiveLayout(
    bands=(
        BandLayout(signals=("output_torque_nm", "output_raw_nm", "output_reference_nm")),
        BandLayout(signals=("input_torque_nm", "input_raw_nm", "input_reference_nm")),
        BandLayout(signals=("input_speed_rpm", "output_speed_rpm")),
    )
)
