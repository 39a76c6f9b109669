"""The live page's chart with channels, scales, markers, spectrum and histogram."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from torquebench.bench.roles import Side
from torquebench.columns import Column
from torquebench.errors import InputError, TorquebenchError
from torquebench.message import Message
from torquebench.panel.components.charts import Chart, Line
from torquebench.panel.components.controls import Choice, Field, button, typed_number
from torquebench.panel.components.dialogs import ask, foot, sheet
from torquebench.panel.components.elements import box, note, on_press, panel, refilled, words
from torquebench.panel.components.trend import Band, Trace, Trend
from torquebench.panel.pages.recording_dialog import open_recording
from torquebench.panel.pages.records.column_titles import column_title
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import (
    DEFAULT_LAYOUT,
    SIGNALS,
    TORQUE_SIGNALS,
    BandLayout,
    LiveHub,
    LiveLayout,
    Scale,
    histogram,
    spectrum,
)
from torquebench.units import minus_signs
from torquebench.validation import words_of

__all__ = ["SPANS", "LiveChart"]

MOST_ROWS = 300
"""Largest number of new rows sent singly; a page that lacks more gets the reduced past again."""
MOST_POINTS = 600
MOST_LINES = 1200
"""Largest number of values of a spectrum; more would slow the browser down."""
SPANS = {"seconds_10": 10.0, "minute_1": 60.0, "minutes_10": 600.0, "hour_1": 3600.0}
CHARTS = 3
WHOLE_RANGE_UNITS = ("N·m", "rpm")
COLOURS = {
    "raw_nm": "--series-raw",
    "reference_nm": "--series-3",
    "expanded_uncertainty_nm": "--series-4",
    "input": "--series-1",
    "output": "--series-2",
    "percent": "--series-4",
}
DASHED = ("raw_nm", "reference_nm", "expanded_uncertainty_nm")
DECIMALS: dict[Side, int] = {"input": 3, "output": 2}
FLOORS = {
    "rpm": (1.0, 0.1),
    "rad/s²": (1.0, 0.1),
    "°": (1.0, 0.1),
    "°C": (0.5, 0.5),
    "%": (1.0, 1.0),
}
"""Smallest span of the left and the right scale, by unit."""
TOOLS = (
    "tools",
    "more",
    "live",
    "zoom_in",
    "zoom_out",
    "earlier",
    "later",
    "cursors",
    "cursor",
    "peaks",
    "picture",
    "table",
    "values",
    "shown",
    "between",
    "minimum",
    "maximum",
    "mean",
    "lowest",
    "highest",
)
_BY_NAME = {signal.name: signal for signal in SIGNALS}


class LiveChart:
    """The live chart with its controls.

    Parameters
    ----------
    visitor : Visitor
    places : mapping of signal name to (element, decimals)
    region : element
        Element that turns grey without new data.
    """

    def __init__(
        self, visitor: Visitor, places: Mapping[str, tuple[Any, int]], region: Any
    ) -> None:
        self.visitor, self.text = visitor, visitor.text
        self.layout = visitor.service.layout(visitor.looker)
        self._hub: LiveHub | None = None
        self._sequence = 0
        self._marks = -1
        with panel(classes="live-chart"):
            said = {key: self.text(f"chart.{key}") for key in TOOLS}
            self.trend = Trend(
                self.text("live.trend_label"), said, "torquebench-live", places, region, self._finer
            )
            self._controls()
            self._arrange()

    # -- controls ---------------------------------------------------------------------------

    def _controls(self) -> None:
        text = self.text
        with self.trend:
            with box("span", "group", role="group", aria_label=text("live.window")):
                self._spans = {key: self._span_button(key) for key in SPANS}
            button(
                text("record.start"),
                lambda: open_recording(self.visitor),
                "small",
                picture="fiber_manual_record",
            )
        with self.trend.add_slot("menu"):
            for key, action, picture in (
                ("channels_short", self._open_channels, "tune"),
                ("marker", self._open_marker, "bookmark_add"),
                ("spectrum_short", self._open_analysis, "equalizer"),
            ):
                button(text(f"live.{key}"), action, "quiet small", picture=picture)

    def _span_button(self, key: str) -> Any:
        pressed = "true" if key == self.layout.span else "false"
        made = words(
            "button", self.text(f"live.{key}"), "control small", type="button", aria_pressed=pressed
        )
        on_press(made, lambda: self.choose(key))
        return made

    def choose(self, key: str) -> None:
        """Show another time span, and store it as the user's choice."""
        for name, made in self._spans.items():
            made.props["aria-pressed"] = "true" if name == key else "false"
            made.update()
        self._keep(self.layout.model_copy(update={"span": key}))

    def _keep(self, layout: LiveLayout) -> None:
        self.visitor.attempt(lambda: self.visitor.service.keep_layout(self.visitor.looker, layout))
        self.layout = layout
        self._arrange()
        self._restart()

    # -- what is drawn ----------------------------------------------------------------------

    @property
    def _names(self) -> list[str]:
        return list(dict.fromkeys(name for band in self.layout.bands for name in band.signals))

    def _title(self, signal: Column) -> str:
        return column_title(self.text, signal.name)

    def _arrange(self) -> None:
        drawn = [band for band in self.layout.bands if band.signals]
        traces = [
            self._trace(_BY_NAME[name], place, band.axis(name))
            for place, band in enumerate(drawn)
            for name in dict.fromkeys(band.signals)
        ]
        self.trend.arrange(traces, [self._band(band) for band in drawn])

    def _trace(self, signal: Column, grid: int, axis: int) -> Trace:
        kind = next((end for end in COLOURS if signal.name.endswith(end)), "")
        side = signal.side or "percent"
        return Trace(
            signal.name,
            self._title(signal),
            signal.unit,
            grid,
            COLOURS[kind or side],
            dashed=signal.name.endswith(DASHED),
            axis=axis,
            decimals=DECIMALS[signal.side or "output"] if signal.unit == "N·m" else 2,
        )

    def _band(self, band: BandLayout) -> Band:
        titles, floors = [], []
        for place, (unit, side) in enumerate(band.axes):
            titles.append(f"{self.text(f'side.{side}')}, {unit}" if side else unit)
            floors.append(self._floor(band, unit, side, place))
        if len(titles) == 1 and titles[0] == band.axes[0][0]:
            sides = {_BY_NAME[name].side for name in band.signals}
            only = sides.pop() if len(sides) == 1 else None
            if only is not None:
                titles[0] = f"{self.text(f'side.{only}')}, {titles[0]}"
        return Band(
            titles[0],
            floors[0],
            titles[1] if len(titles) > 1 else "",
            floors[1] if len(floors) > 1 else 1.0,
            self._ends(band),
            aligned=all(unit in WHOLE_RANGE_UNITS for unit, _ in band.axes),
        )

    def _floor(self, band: BandLayout, unit: str, side: str, place: int) -> float:
        if unit != "N·m":
            return FLOORS[unit][place]
        return 1e-3 * self._limit(band, unit, side)

    def _limit(self, band: BandLayout, unit: str, side: str) -> float:
        """Return the largest range of a unit over both sides."""
        snapshots = self.visitor.service.snapshot().sides
        sides = [side] if side else {_BY_NAME[name].side or "output" for name in band.signals}
        shown = [snapshots[name] for name in sides]  # type: ignore[index]  # sides as strings
        return max(side.range_nm if unit == "N·m" else side.limit_rpm for side in shown)

    def _ends(self, band: BandLayout) -> tuple[float, float] | None:
        scale, (unit, side) = band.scale, band.axes[0]
        if scale.kind == "fixed":
            return scale.low, scale.high
        if scale.kind == "range" and unit in WHOLE_RANGE_UNITS:
            limit = self._limit(band, unit, side)
            return -limit, limit
        return None

    # -- rows -------------------------------------------------------------------------------

    def _restart(self) -> None:
        hub = self._hub = self.visitor.service.live
        seconds = SPANS[self.layout.span]
        past = hub.trend(seconds, self._names)
        self._sequence = past.sequence
        self.trend.reset(seconds, past, hub.clock_offset_s)
        self._marks = -1

    def _finer(self, start_s: float, stop_s: float) -> None:
        if not (math.isfinite(start_s) and math.isfinite(stop_s)):
            return
        hub = self.visitor.service.live
        self.trend.finer(start_s, stop_s, hub.between(start_s, stop_s, self._names, MOST_POINTS))

    def push(self, share: Mapping[Side, tuple[str, float]]) -> None:
        """Send the new rows; `share` names each side's torque signal and its range."""
        hub = self.visitor.service.live
        if hub is not self._hub:  # the first call, or the bench was reopened
            self._restart()
            return
        if hub.sequence == self._sequence or not self.trend.ready:
            return
        if hub.sequence - self._sequence > MOST_ROWS:  # the page was hidden or slow
            self._restart()
        increment = hub.since(self._sequence, self._names)
        self._sequence = increment.sequence
        latest = hub.latest()
        numbers: dict[str, float | None] = {
            name: latest[name].value if not latest[name].stale else None for name in _BY_NAME
        }
        for side, (chosen, range_nm) in share.items():
            torque = numbers[f"{side}_torque"] = numbers[chosen]
            numbers[f"{side}_share"] = None if torque is None else 100.0 * torque / range_nm
        self.trend.push(increment, numbers, hub.clock_offset_s)
        markers = self.visitor.service.markers.all()
        newest = markers[-1].number if markers else 0
        if newest != self._marks:
            self._marks = newest
            self.trend.marks((marker.bench_time_s, marker.note) for marker in markers)

    # -- dialogs ----------------------------------------------------------------------------

    def _open_channels(self) -> None:
        text = self.text
        bands = (*self.layout.bands, *(BandLayout() for _ in range(CHARTS)))[:CHARTS]
        places = {str(place): text("live.chart_number", number=place) for place in (1, 2, 3)}
        chosen = {name: str(k) for k, band in enumerate(bands, 1) for name in band.signals}

        def apply() -> None:
            try:
                layout = LiveLayout(
                    span=self.layout.span,
                    bands=tuple(
                        BandLayout(
                            signals=tuple(n for n, f in fields.items() if f.value == str(k)),
                            scale=_scale(kind.value, low.value, high.value),
                        )
                        for k, (kind, low, high) in enumerate(scales, 1)
                    ),
                )
            except (ValidationError, InputError) as error:
                wrong.set_text(
                    text.core(words_of(error.errors()[0]))
                    if isinstance(error, ValidationError)
                    else text.refusal_line(error)
                )
                return
            self._keep(layout)
            dialog.close()

        def usual() -> None:
            self._keep(DEFAULT_LAYOUT)
            dialog.close()

        with sheet(text("live.channels")) as dialog:
            with box("div", "columns narrow"):
                fields = {
                    signal.name: Field(
                        self._title(signal),
                        chosen.get(signal.name, ""),
                        unit=signal.unit,
                        options={"": text("live.not_shown")} | places,
                    )
                    for signal in SIGNALS
                }
            scales = []
            for k, band in enumerate(bands, 1):
                words("h3", text("live.scale_of", number=k))
                fixed = band.scale.kind == "fixed"
                with box("div", "columns narrow"):
                    kinds = {
                        key: text(f"live.scale_{key}") for key in ("automatic", "range", "fixed")
                    }
                    kind = Field(text("live.scale"), band.scale.kind, options=kinds)
                    low = Field(text("live.lowest"), f"{band.scale.low:g}" if fixed else "")
                    high = Field(text("live.highest"), f"{band.scale.high:g}" if fixed else "")
                scales.append((kind, low, high))
            wrong = words("div", "", "bad-text", role="alert")
            with box("div", "line end"):
                button(text("live.usual"), usual, "quiet")
                button(text("frame.close"), dialog.close, "quiet")
                button(text("live.apply"), apply, "primary")

    def _open_marker(self) -> None:
        text, service = self.text, self.visitor.service
        now_s = service.live.bench_time_s
        moment_s = now_s if self.trend.view is None else min(sum(self.trend.view) / 2.0, now_s)

        def put(said: str) -> bool:
            return self.visitor.act(service.mark, said, moment_s)

        ask(
            text,
            text("live.marker"),
            text("live.marker_explained" if self.trend.view is None else "live.marker_held"),
            put,
            confirm=text("live.marker_put"),
            field=text("live.marker_note"),
        )

    # -- spectrum and histogram -------------------------------------------------------------

    def _open_analysis(self) -> None:
        text = self.text
        with sheet(text("live.spectrum")) as dialog:
            dialog.classes("wide")
            latest = self.visitor.service.live.latest()
            there = [name for name in TORQUE_SIGNALS if latest[name].value is not None]
            options = sorted(there or TORQUE_SIGNALS, key=lambda name: name not in self._names)
            self._signal = Choice(
                text("live.signal"),
                {name: self._title(_BY_NAME[name]) for name in options},
                options[0],
                on_change=self._analyse,
            )
            self._found = box("div", "stack")
            with foot(text, dialog):
                button(text("live.again"), self._analyse, picture="refresh")
        self._analyse()

    def _analyse(self) -> None:
        text, hub = self.text, self.visitor.service.live
        newest_s = hub.bench_time_s
        start_s, stop_s = self.trend.view or (newest_s - SPANS[self.layout.span], newest_s)
        windows = hub.windows(self._signal.value, start_s, stop_s)
        with refilled(self._found):
            try:
                lines = spectrum(windows.time_s, windows.value_nm)
                classes = histogram(windows.value_nm)
            except TorquebenchError as error:
                found, more = text.refusal(error)
                note(more, "warn", title=found)
                return
            words(
                "p",
                text(
                    "live.analysed",
                    seconds=f"{windows.time_s[-1] - windows.time_s[0]:.2f}",
                    count=windows.time_s.size,
                    mean=minus_signs(f"{classes.mean_nm:.4f}"),
                    deviation=f"{classes.deviation_nm:.4f}",
                    resolution=f"{lines.resolution_hz:.3g}",
                    rate=f"{2.0 * lines.frequency_hz[-1]:.4g}",
                ),
                "number",
            )
            step = max(1, math.ceil(lines.frequency_hz.size / MOST_LINES))
            with box("div", "columns"):
                frequency, amplitude = _reduced(lines.frequency_hz, lines.amplitude_nm, step)
                title = self._title(_BY_NAME[self._signal.value])
                Chart(
                    text("live.spectrum_label"),
                    text("live.frequency"),
                    text("live.amplitude"),
                    [Line(title, frequency, amplitude)],
                )
                Chart(
                    text("live.histogram_label"),
                    text("live.torque"),
                    text("live.count"),
                    [Line(title, classes.centre_nm.tolist(), classes.count.tolist())],
                )


def _reduced(x: Any, y: Any, step: int) -> tuple[list[float], list[float]]:
    """Keep the largest value of each group of neighbours."""
    if step == 1:
        return x.tolist(), y.tolist()
    places = [k + int(y[k : k + step].argmax()) for k in range(0, x.size, step)]
    return x[places].tolist(), y[places].tolist()


def _scale(kind: str, low: str, high: str) -> Scale:
    if kind != "fixed":
        return Scale(kind=kind)  # type: ignore[arg-type]  # one of the options
    try:
        ends = typed_number(low), typed_number(high)
    except ValueError:
        raise InputError(
            Message("ends {low!r} and {high!r}", low, high), "two numbers in the unit of the scale"
        ) from None
    return Scale(kind="fixed", low=ends[0], high=ends[1])
