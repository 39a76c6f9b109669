"""A user's layout of the live page: channels, scales and time span."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from torquebench.columns import Column, Side
from torquebench.message import Message
from torquebench.panel.service.live.formulas import RESULT_UNITS, computed, names_in
from torquebench.panel.service.live.hub import SIGNALS, LiveTrend

View = Literal["time", "xy", "digits"]
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


class ComputedChannel(BaseModel):
    """A channel that is computed from the mean values of each row.

    Parameters
    ----------
    title : str
    formula : str
        Expression over live signals, as in `formulas.computed`.
    unit : str
        Its unit, one of `formulas.RESULT_UNITS`.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", str_strip_whitespace=True)

    title: Annotated[str, Field(min_length=1, max_length=40)]
    formula: Annotated[str, Field(min_length=1, max_length=200)]
    unit: str

    @model_validator(mode="after")
    def _computable(self) -> ComputedChannel:
        if self.unit not in RESULT_UNITS:
            raise ValueError(Message("there is no unit {name!r}", self.unit[:80]))
        computed(self.formula, self.unit, dict.fromkeys(_SIGNALS, np.ones(2)), 1.0)
        return self

    @property
    def name(self) -> str:
        """Name beside the live signals'."""
        return f"={self.title}"

    @property
    def side(self) -> Side:
        """No side."""
        return ""


class LoopLayout(BaseModel):
    """An XY plot: the horizontal signal, and the vertical ones."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    x: str = "output_angle_deg"
    signals: tuple[str, ...] = ("output_torque_nm", "output_raw_nm")


class LiveLayout(BaseModel):
    """A person's layout of the live page.

    Parameters
    ----------
    view : {"time", "xy", "digits"}
        Charts over time, an XY plot, or large numbers.
    span : str
    bands : tuple of BandLayout
        Charts from top to bottom; those without signals aren't drawn.
    xy : LoopLayout
    digits : tuple of str
        Signals shown as large numbers.
    computed : tuple of ComputedChannel
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    view: View = "time"
    span: Span = "seconds_10"
    bands: Annotated[tuple[BandLayout, ...], Field(min_length=1, max_length=4)] = (
        BandLayout(signals=("output_torque_nm", "output_raw_nm", "output_reference_nm")),
        BandLayout(signals=("input_torque_nm", "input_raw_nm", "input_reference_nm")),
        BandLayout(signals=("input_speed_rpm", "output_speed_rpm")),
    )
    xy: LoopLayout = LoopLayout()
    digits: Annotated[tuple[str, ...], Field(max_length=12)] = (
        "output_torque_nm",
        "input_torque_nm",
        "output_speed_rpm",
        "efficiency_percent",
    )
    computed: Annotated[tuple[ComputedChannel, ...], Field(max_length=12)] = ()

    @model_validator(mode="after")
    def _drawable(self) -> LiveLayout:
        names = [channel.name for channel in self.computed]
        if len(set(names)) < len(names):
            raise ValueError("two computed channels have the same name: give each its own")
        charts = [band.signals for band in self.bands]
        if not any(charts) or not self.xy.signals or not self.digits:
            raise ValueError("no signal is chosen: choose one at least")
        for name in (*(name for chart in charts for name in chart), *self.xy.signals, self.xy.x,
                     *self.digits):  # fmt: skip
            if name not in self.signals:
                raise ValueError(Message("there is no signal {name!r}", name[:80]))
        for chart in (*charts, self.xy.signals):
            if len(self.axes(chart)) > MOST_SCALES:
                units = ", ".join(dict.fromkeys(unit for unit, _ in self.axes(chart)))
                raise ValueError(
                    Message(
                        "one chart has {most} scales at most, not more for {units}",
                        MOST_SCALES,
                        units,
                    )
                )
        return self

    @property
    def signals(self) -> Mapping[str, Column | ComputedChannel]:
        """Live signals and computed channels by name."""
        return _SIGNALS | {channel.name: channel for channel in self.computed}

    @property
    def charts(self) -> tuple[BandLayout, ...]:
        """What the present view draws, without empty charts."""
        if self.view == "digits":
            return ()
        bands = self.bands if self.view == "time" else (BandLayout(signals=self.xy.signals),)
        return tuple(band for band in bands if band.signals)

    @property
    def shown(self) -> tuple[str, ...]:
        """Names of all signals of the present view."""
        names = [name for band in self.charts for name in band.signals]
        names += {"time": (), "xy": (self.xy.x,), "digits": self.digits}[self.view]
        return tuple(dict.fromkeys(names))

    @property
    def sources(self) -> list[str]:
        """Live signals that the present view shows or computes with."""
        channels = {channel.name: names_in(channel.formula) for channel in self.computed}
        return list(
            dict.fromkeys(source for name in self.shown for source in channels.get(name, (name,)))
        )

    def axes(self, names: Sequence[str]) -> tuple[tuple[str, str], ...]:
        """Return unit and side (empty for both) of each scale of a chart, the left one first."""
        signals = [self.signals[name] for name in names]
        apart = len({signal.unit for signal in signals}) == 1
        return tuple(
            dict.fromkeys(
                (signal.unit, signal.side if apart and signal.unit in BOTH_SIDES else "")
                for signal in signals
            )
        )

    def axis(self, names: Sequence[str], name: str) -> int:
        """Return the scale of a chart's signal: 0 is the left one, 1 the right one."""
        signal = self.signals[name]
        return next(
            place
            for place, (unit, side) in enumerate(self.axes(names))
            if unit == signal.unit and side in ("", signal.side)
        )

    def including(self, channel: ComputedChannel) -> LiveLayout:
        """Return the layout with another computed channel, shown where there is room for it."""
        known = self.model_dump() | {"computed": (*self.computed, channel)}
        if self.view == "digits":
            known["digits"] = (*self.digits, channel.name)
        added = LiveLayout.model_validate(known)
        for place in reversed(range(len(self.bands) if self.view == "time" else 0)):
            bands = added.model_dump()["bands"]
            bands[place]["signals"] += (channel.name,)
            with contextlib.suppress(ValidationError):  # the chart has two other scales
                return LiveLayout.model_validate(added.model_dump() | {"bands": bands})
        return added

    def without(self, channel: ComputedChannel) -> LiveLayout:
        """Return the layout without a computed channel."""
        kept = self.model_dump() | {"computed": [c for c in self.computed if c != channel]}
        defaults = LiveLayout()
        for band in kept["bands"]:
            band["signals"] = [name for name in band["signals"] if name != channel.name]
        if not any(band["signals"] for band in kept["bands"]):
            kept["bands"] = defaults.bands
        kept["digits"] = [n for n in self.digits if n != channel.name] or defaults.digits
        y = tuple(name for name in self.xy.signals if name != channel.name)
        kept["xy"] = defaults.xy if not y or self.xy.x == channel.name else self.xy
        if y and self.xy.x != channel.name:
            kept["xy"] = LoopLayout(x=self.xy.x, signals=y)
        return LiveLayout.model_validate(kept)

    def complete(self, trend: LiveTrend, ratio: float) -> LiveTrend:
        """Return rows with the computed channels of the present view, from the rows' means."""
        if not self.computed:
            return trend
        extra = {
            channel.name: np.atleast_1d(
                computed(channel.formula, channel.unit, trend.values, ratio)
                * np.ones(trend.time_s.size)
            )
            for channel in self.computed
            if channel.name in self.shown
        }
        values, low, high = ({**part, **extra} for part in (trend.values, trend.low, trend.high))
        return replace(trend, values=values, low=low, high=high)
