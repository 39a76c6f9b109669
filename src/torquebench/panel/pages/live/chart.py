"""The live page's chart with channels, scales, markers, spectrum and histogram."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, get_args
from urllib.parse import urlencode

from nicegui import ui
from pydantic import ValidationError

from torquebench.bench.roles import Side
from torquebench.errors import InputError, TorquebenchError
from torquebench.panel.components.charts import Chart, Line
from torquebench.panel.components.controls import Choice, Field, button
from torquebench.panel.components.dialogs import ask, foot, sheet
from torquebench.panel.components.elements import (
    box,
    dated,
    icon,
    note,
    on_press,
    panel,
    refilled,
    words,
)
from torquebench.panel.components.trend import Band, Trace, Trend
from torquebench.panel.pages.live.channels import open_channels, open_computed
from torquebench.panel.pages.recording_dialog import open_recording
from torquebench.panel.pages.records.column_titles import DECIMALS, column_title
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import (
    TORQUE_SIGNALS,
    BandLayout,
    LiveHub,
    LiveLayout,
    LiveTrend,
    View,
    computed,
    histogram,
    spectrum,
)
from torquebench.panel.text import Texts
from torquebench.units import minus_signs

MOST_ROWS = 300
"""Largest number of new rows sent singly; a page that lacks more gets the reduced past again."""
MOST_POINTS = 600
MOST_LINES = 1200
"""Largest number of values of a spectrum; more would slow the browser down."""
SPANS = {"seconds_10": 10.0, "minute_1": 60.0, "minutes_10": 600.0, "hour_1": 3600.0}
SPAN_TITLES: Texts = {
    "seconds_10": "10 s",
    "minute_1": "1 min",
    "minutes_10": "10 min",
    "hour_1": "1 h",
}
LATEST_TIME = """(event) => {
    const at = new Date(), [hour, minute, second = 0] = event.target.value.split(":");
    at.setHours(hour, minute, second, 0);
    if (at > Date.now()) at.setDate(at.getDate() - 1);
    emit(event.target.value && at.toISOString());
}"""
"""Script that sends the latest moment of a typed time by the reader's clock."""
VIEWS: Mapping[View, str] = {"time": "show_chart", "xy": "timeline", "digits": "pin"}
"""Icon of each view."""
VIEW_TITLES: Texts = {
    "time": "Charts over time",
    "xy": "XY plot",
    "digits": "Large numbers",
}
WHOLE_RANGE_UNITS = ("N·m", "rpm")
COLOURS = {
    "raw_nm": "--series-raw",
    "reference_nm": "--series-3",
    "expanded_uncertainty_nm": "--series-4",
    "input": "--series-1",
    "output": "--series-2",
    "percent": "--series-4",
}
DASHED = ("reference_nm", "expanded_uncertainty_nm")
UNDER = "raw_nm"
"""Ends of the names of signals that are drawn dashed, and as a broad line beneath the others."""
FLOORS = {
    "rpm": (1.0, 0.1),
    "rad/s²": (1.0, 0.1),
    "°": (1.0, 0.1),
    "°C": (0.5, 0.5),
    "%": (1.0, 1.0),
}
"""Smallest span of the left and the right scale, by unit; other units have none."""
COMPUTED_COLOURS = ("--series-4", "--series-3", "--warn", "--ink", "--series-1", "--series-2")
TOOLS: Texts = {
    "tools": "Chart tools",
    "more": "More",
    "live": "Live",
    "zoom_in": "Zoom in",
    "zoom_out": "Zoom out",
    "earlier": "Earlier",
    "later": "Later",
    "cursors": "Cursors",
    "cursor": "Cursor",
    "peaks": "Peak hold",
    "picture": "Picture",
    "table": "CSV",
    "values": "Values of the shown span",
    "shown": "Shown: {seconds} s",
    "between": "B − A: {seconds} s",
    "newest": "Newest",
    "minimum": "Minimum",
    "maximum": "Maximum",
    "mean": "Mean",
    "lowest": "Lowest held",
    "highest": "Highest held",
    "joint": ", ",
}
"""Texts that the chart's script shows."""


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
        self.layout = _addressed(visitor.query, visitor.service.layout(visitor.looker))
        self._held = _span_of(visitor.query)
        self._ratio = visitor.service.station.description.bench.reducer_ratio
        self._address = ""
        self._hub: LiveHub | None = None
        self._sequence = 0
        self._marks = -1
        with panel(classes="live-chart"):
            said = {key: self.text(title) for key, title in TOOLS.items()}
            label = self.text(
                "Chart of torque and speed over time. The numbers above are the newest values."
            )
            self.trend = Trend(
                label, said, "torquebench-live", places, region,
                self._finer, self._remember,
            )  # fmt: skip
            self._controls()
            self._arrange()

    # -- controls ---------------------------------------------------------------------------

    def _controls(self) -> None:
        text = self.text
        with self.trend:
            with box("span", "group views", role="group", aria_label=text("View")):
                self._views = {view: self._view_button(view) for view in get_args(View)}
            with box("span", "group spans", role="group", aria_label=text("Span of time")):
                self._spans = {key: self._span_button(key) for key in SPANS}
            button(
                text("Record"),
                lambda: open_recording(self.visitor),
                "small record",
                picture="fiber_manual_record",
            )
        with self.trend.add_slot("menu"):
            for title, action, picture in (
                (text("Channels"), lambda: open_channels(self), "tune"),
                (text("Computed channels"), lambda: open_computed(self), "calculate"),
                (text("Marker"), self._open_marker, "bookmark_add"),
                (text("Spectrum"), self._open_analysis, "equalizer"),
                (text("Span of time"), self._open_span, "schedule"),
            ):
                button(title, action, "quiet small", picture=picture)

    def _span_button(self, key: str) -> Any:
        pressed = "true" if key == self.layout.span else "false"
        made = words(
            "button",
            self.text(SPAN_TITLES[key]),
            "control small",
            type="button",
            aria_pressed=pressed,
        )
        on_press(made, lambda: self.choose(key))
        return made

    def _view_button(self, view: View) -> Any:
        title = self.text(VIEW_TITLES[view])
        pressed = "true" if view == self.layout.view else "false"
        made = box(
            "button", "control small", type="button", aria_pressed=pressed, aria_label=title,
            title=title,
        )  # fmt: skip
        with made:
            icon(VIEWS[view])
        on_press(made, lambda: self.keep(self.layout.model_copy(update={"view": view})))
        return made

    def choose(self, key: str) -> None:
        """Show another time span, and store it as the user's choice."""
        self.keep(self.layout.model_copy(update={"span": key}))

    def keep(self, layout: LiveLayout) -> None:
        """Show another layout, and store it as the user's choice."""
        self.visitor.attempt(lambda: self.visitor.service.keep_layout(self.visitor.looker, layout))
        self.layout = layout
        for made, chosen in (
            *((made, name == layout.span) for name, made in self._spans.items()),
            *((made, name == layout.view) for name, made in self._views.items()),
        ):
            made.props["aria-pressed"] = "true" if chosen else "false"
            made.update()
        self._arrange()
        self._restart()
        self._remember()

    def _remember(self) -> None:
        """Keep view, layout and held span in the address."""
        other = self.layout.model_dump_json(exclude_defaults=True, exclude={"view", "span"})
        query: dict[str, str] = {"view": self.layout.view, "span": self.layout.span}
        query |= {} if other == "{}" else {"layout": other}
        if self.trend.view is not None:
            offset_s = self.visitor.service.live.clock_offset_s
            for key, time_s in zip(("from", "to"), self.trend.view, strict=True):
                moment = datetime.fromtimestamp(time_s + offset_s, UTC)
                query[key] = moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
        address = f"/?{urlencode(query, safe=':')}"
        if address != self._address:
            self._address = address
            ui.navigate.history.replace(address)

    # -- what is drawn ----------------------------------------------------------------------

    @property
    def _names(self) -> list[str]:
        """Live signals that the layout shows or computes with."""
        return self.layout.sources

    def title(self, name: str) -> str:
        """Return the title of a signal or computed channel."""
        signal = self.layout.signals[name]
        return signal.title if name.startswith("=") else column_title(self.text, name)

    def _arrange(self) -> None:
        charts = self.layout.charts
        traces = [
            self._trace(name, place, self.layout.axis(band.signals, name))
            for place, band in enumerate(charts)
            for name in dict.fromkeys(band.signals)
        ]
        xy, digits = self.layout.view == "xy", self.layout.view == "digits"
        self.trend.arrange(
            traces,
            [self._band(band) for band in charts],
            self._trace(self.layout.xy.x, 0, 0) if xy else None,
            [self._trace(name, 0, 0) for name in self.layout.digits] if digits else [],
        )

    def _trace(self, name: str, grid: int, axis: int) -> Trace:
        signal = self.layout.signals[name]
        kind = next((end for end in COLOURS if name.endswith(end)), "")
        colour = COLOURS[kind or signal.side or "percent"]
        decimals = DECIMALS[signal.side or "output"] if signal.unit == "N·m" else 2
        if name.startswith("="):
            place = [channel.name for channel in self.layout.computed].index(name)
            colour, decimals = COMPUTED_COLOURS[place % len(COMPUTED_COLOURS)], 3
        unit = "" if signal.unit == "1" else signal.unit
        return Trace(
            name, self.title(name), unit, grid, colour,
            dashed=name.endswith(DASHED), under=name.endswith(UNDER), axis=axis, decimals=decimals,
        )  # fmt: skip

    def _band(self, band: BandLayout) -> Band:
        titles, floors = [], []
        axes = self.layout.axes(band.signals)
        signals = self.layout.signals
        for place, (unit, side) in enumerate(axes):
            titles.append(self.text.title(side) + self.text(", ") + unit if side else unit)
            floors.append(self._floor(band, unit, side, place))
        if len(titles) == 1 and titles[0] == axes[0][0]:
            sides = {signals[name].side for name in band.signals}
            only = sides.pop() if len(sides) == 1 else ""
            if only:
                titles[0] = self.text.title(only) + self.text(", ") + titles[0]
        return Band(
            titles[0],
            floors[0],
            titles[1] if len(titles) > 1 else "",
            floors[1] if len(floors) > 1 else 1.0,
            self._ends(band),
            aligned=all(unit in WHOLE_RANGE_UNITS for unit, _ in axes),
        )

    def _floor(self, band: BandLayout, unit: str, side: str, place: int) -> float:
        if unit != "N·m":
            return FLOORS.get(unit, (0.0, 0.0))[place]
        return 1e-3 * self._limit(band, unit, side)

    def _limit(self, band: BandLayout, unit: str, side: str) -> float:
        """Return the largest range of a unit over both sides."""
        snapshots = self.visitor.service.snapshot().sides
        sides = (
            [side]
            if side
            else {self.layout.signals[name].side or "output" for name in band.signals}
        )
        shown = [snapshots[name] for name in sides]  # type: ignore[index]  # sides as strings
        return max(side.range_nm if unit == "N·m" else side.limit_rpm for side in shown)

    def _ends(self, band: BandLayout) -> tuple[float, float] | None:
        scale, (unit, side) = band.scale, self.layout.axes(band.signals)[0]
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
        self.trend.reset(seconds, self._complete(past), hub.clock_offset_s)
        self._marks = -1
        if self._held is not None:
            start, stop = (time_s - hub.clock_offset_s for time_s in self._held)
            self.trend.run_method("hold", start, stop)
            self._held = None

    def _complete(self, trend: LiveTrend) -> LiveTrend:
        return self.layout.complete(trend, self._ratio)

    def _finer(self, start_s: float, stop_s: float) -> None:
        if not (math.isfinite(start_s) and math.isfinite(stop_s)):
            return
        hub = self.visitor.service.live
        rows = hub.between(start_s, stop_s, self._names, MOST_POINTS)
        self.trend.finer(start_s, stop_s, self._complete(rows))

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
            name: latest[name].value if not latest[name].stale else None for name in latest
        }
        numbers |= self._computed(numbers)
        for side, (chosen, range_nm) in share.items():
            torque = numbers[f"{side}_torque"] = numbers[chosen]
            numbers[f"{side}_share"] = None if torque is None else 100.0 * torque / range_nm
        self.trend.push(self._complete(increment), numbers, hub.clock_offset_s)
        markers = self.visitor.service.markers.all()
        newest = markers[-1].number if markers else 0
        if newest != self._marks:
            self._marks = newest
            self.trend.marks((marker.bench_time_s, marker.note) for marker in markers)

    def _computed(self, numbers: Mapping[str, float | None]) -> dict[str, float | None]:
        """Compute the newest number of each channel from the newest values."""
        signals = {name: math.nan if value is None else value for name, value in numbers.items()}
        values = {
            channel.name: float(computed(channel.formula, channel.unit, signals, self._ratio))
            for channel in self.layout.computed
        }
        return {name: value if math.isfinite(value) else None for name, value in values.items()}

    # -- dialogs ----------------------------------------------------------------------------

    def _open_marker(self) -> None:
        text, service = self.text, self.visitor.service
        now_s = service.live.bench_time_s
        moment_s = now_s if self.trend.view is None else min(sum(self.trend.view) / 2.0, now_s)

        def put(said: str) -> bool:
            return self.visitor.act(service.mark, said, moment_s)

        ask(
            text,
            text("Marker"),
            text(
                "The marker is set at this moment. Every page shows it, the log contains "
                "it, and runs that are being recorded keep it."
                if self.trend.view is None
                else "The marker is set at the middle of the shown span. Every page shows it, "
                "the log contains it, and runs that are being recorded keep it."
            ),
            put,
            confirm=text("Set the marker"),
            field=text("Note"),
        )

    def _open_span(self) -> None:
        """Ask for the ends of a span by the clock, and hold it."""
        text, hub = self.text, self.visitor.service.live

        def show() -> None:
            try:
                ends = [datetime.fromisoformat(end.value).timestamp() for end in (start, stop)]
            except ValueError:
                ends = [0.0, 0.0]
            first_s, last_s = (end - hub.clock_offset_s for end in ends)
            if not (first_s < last_s and hub.oldest_s < last_s and first_s < hub.bench_time_s):
                error = InputError("no readings in this span", "a start before its end, both kept")
                self.visitor.messages.problem(error)
                return
            self.trend.run_method("hold", first_s, last_s)
            dialog.close()

        with sheet(text("Span of time")) as dialog:
            kept = datetime.fromtimestamp(hub.oldest_s + hub.clock_offset_s, UTC)
            dated(text("Readings since # are kept."), kept)
            with box("div", "columns narrow"):
                start, stop = (
                    Field(text(title), kind="time", step="1") for title in ("Span from", "Span to")
                )
            with foot(text, dialog):
                button(text("Show span"), show, "primary", picture="zoom_in")
        for end in (start, stop):
            end.control.on(
                "change",
                lambda event, end=end: setattr(end, "value", str(event.args)),
                js_handler=LATEST_TIME,
            )

    # -- spectrum and histogram -------------------------------------------------------------

    def _open_analysis(self) -> None:
        text = self.text
        with sheet(text("Spectrum and histogram")) as dialog:
            dialog.classes("wide")
            latest = self.visitor.service.live.latest()
            there = [name for name in TORQUE_SIGNALS if latest[name].value is not None]
            options = sorted(there or TORQUE_SIGNALS, key=lambda name: name not in self._names)
            self._signal = Choice(
                text("Signal"),
                {name: column_title(text, name) for name in options},
                options[0],
                on_change=self._analyse,
            )
            self._found = box("div", "stack")
            with foot(text, dialog):
                button(text("Analyse the shown span again"), self._analyse, picture="refresh")
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
                    "{count} readings of {seconds} s, {rate} a second: mean {mean} N·m, "
                    "standard deviation {deviation} N·m. Frequencies closer than {resolution} "
                    "Hz are not separated. Two minutes of single readings are kept.",
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
                title = self.title(self._signal.value)
                Chart(
                    text("Amplitude of the signal over frequency, without its mean."),
                    text("Frequency, Hz"),
                    text("Amplitude (peak), N·m"),
                    [Line(title, frequency, amplitude)],
                )
                Chart(
                    text("Number of readings over torque."),
                    text("Torque, N·m"),
                    text("Readings"),
                    [Line(title, classes.centre_nm.tolist(), classes.count.tolist())],
                )


def _reduced(x: Any, y: Any, step: int) -> tuple[list[float], list[float]]:
    """Keep the largest value of each group of neighbours."""
    if step == 1:
        return x.tolist(), y.tolist()
    places = [k + int(y[k : k + step].argmax()) for k in range(0, x.size, step)]
    return x[places].tolist(), y[places].tolist()


def _addressed(query: Mapping[str, str], kept: LiveLayout) -> LiveLayout:
    """Return the layout in a page's address, else the person's own."""
    given = {key: query[key] for key in ("view", "span") if key in query}
    if not given:
        return kept
    try:
        layout = LiveLayout.model_validate_json(query.get("layout", "{}"))
        return LiveLayout.model_validate(layout.model_dump() | given)
    except ValidationError:  # a cut address, or one of another version
        return kept


def _span_of(query: Mapping[str, str]) -> tuple[float, float] | None:
    """Return the ends of the span in a page's address, s since 1970."""
    try:
        start, stop = (datetime.fromisoformat(query[key]).timestamp() for key in ("from", "to"))
    except (KeyError, ValueError):
        return None
    return (start, stop) if start < stop else None
