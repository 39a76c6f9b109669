"""Charts of curves and points, in the colours of the theme."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from nicegui import ui

from torquebench.panel.components.elements import box, icon
from torquebench.panel.text import Text

COLOURS = ("--series-1", "--series-2", "--series-3", "--series-4", "--warn", "--ink")
"""Custom properties of the style sheet, with colours that colour-blind readers can distinguish, in
the order of `torquebench.figures.COLOURS`."""
SIDE_COLOURS = {"input": COLOURS[0], "output": COLOURS[1]}


def palette(side: str = "") -> tuple[str, ...]:
    """Return the colours of curves in order, as `torquebench.figures.palette` does on paper."""
    return (SIDE_COLOURS[side], *COLOURS[3:]) if side in SIDE_COLOURS else COLOURS


@dataclass(frozen=True)
class Line:
    """One named line or cloud of points.

    Parameters
    ----------
    title : str
    x, y : sequence of float
        Coordinates; with names along the axis, x is the names' index from 0, or empty for one value
        per name.
    colour : str
        Custom property of the style sheet.
    points : bool
        Whether to draw symbols instead of a line.
    dashed : bool
    symbol : str
        ECharts' name of the symbol.
    hollow : bool
        Whether the symbols are outlines.
    labels : sequence of str
        Labels beside the points, if any.
    beside : str
        Side of the points: "left", "right", "top" or "bottom".
    """

    title: str
    x: Sequence[float]
    y: Sequence[float]
    colour: str = "--series-1"
    points: bool = False
    dashed: bool = False
    symbol: str = "circle"
    hollow: bool = False
    labels: Sequence[str] = ()
    beside: str = "right"


def limit_lines(title: str, low_x: float, high_x: float, low: float, high: float) -> Line:
    """Return two horizontal limits as one dashed line with one legend entry."""
    gap = math.nan
    return Line(
        title,
        [low_x, high_x, gap, low_x, high_x],
        [low, low, gap, high, high],
        "--bad",
        dashed=True,
    )


def error_bars(title: str, values: Sequence[float], u: Sequence[float]) -> Line:
    """Return vertical error bars of values with names along the axis."""
    x: list[float] = []
    y: list[float] = []
    for place, (value, half) in enumerate(zip(values, u, strict=True)):
        x += [place, place, math.nan]
        y += [value - half, value + half, math.nan]
    return Line(title, x, y, "--series-3")


def _colour(name: str) -> str:
    return f"cssColour({name!r})"


def _axis(
    title: str, *, vertical: bool, names: Sequence[str] = (), kind: str = "value"
) -> dict[str, Any]:
    axis: dict[str, Any] = {
        "type": "category" if names else kind,
        "name": title,
        "nameLocation": "end" if vertical else "middle",
        "nameGap": 10 if vertical else 34,
        "nameTextStyle": {
            "fontSize": 13,
            "align": "left" if vertical else "center",
            "padding": [0, 0, 0, -56] if vertical else 0,
            ":color": _colour("--muted"),
        },
        "axisLabel": {"fontSize": 13, ":color": _colour("--muted"), "hideOverlap": True},
        "axisLine": {
            "show": not vertical,
            "onZero": False,
            "lineStyle": {":color": _colour("--line")},
        },
        "splitLine": {"show": True, "lineStyle": {":color": _colour("--line")}},
        "scale": True,
    }
    if names:
        axis["data"] = list(names)
    elif kind == "time":
        axis["axisLabel"][":formatter"] = "(value) => chartMoment(value)"
        axis |= {":min": "chartFirst", ":max": "chartLast", "splitNumber": 4}
    else:
        axis["axisLabel"][":formatter"] = "(value) => chartNumber(value)"
        if not vertical and kind == "value":
            axis |= {":min": "chartLow", ":max": "chartHigh"}
    return axis


def _series(line: Line, per_x: float) -> dict[str, Any]:
    data: list[Any] = (
        [_number(value) for value in line.y]
        if not len(line.x)
        else [[_number(per_x * x), _number(y)] for x, y in zip(line.x, line.y, strict=True)]
    )
    if line.labels:
        data = [{"value": pair, "name": name} for pair, name in zip(data, line.labels, strict=True)]
    return {
        "type": "scatter" if line.points else "line",
        "name": line.title,
        "data": data,
        "symbol": line.symbol if line.points else "none",
        "symbolSize": 7,
        "label": {
            "show": bool(line.labels),
            "formatter": "{b}",
            "position": line.beside,
            "fontSize": 13,
            ":color": _colour("--ink"),
        },
        "labelLayout": {"hideOverlap": False, "moveOverlap": "shiftY"},
        "animation": False,
        "clip": False,  # values may be slightly outside the axis
        "lineStyle": {
            "width": 2,
            "type": "dashed" if line.dashed else "solid",
            ":color": _colour(line.colour),
        },
        "itemStyle": {
            ":borderColor": _colour(line.colour),
            "borderWidth": 1.5 if line.hollow else 0,
            **({"color": "transparent"} if line.hollow else {":color": _colour(line.colour)}),
        },
    }


def _number(value: float) -> float | None:
    number = float(value)
    return number if number == number else None


WRAPPED = 3
"""Largest number of names in a legend that fit into two rows on a phone."""


def named(lines: Sequence[Line]) -> bool:
    """Return whether a chart needs a legend; a single line needs none: the axis names it."""
    return len(lines) != 1


def _legend(lines: Sequence[Line]) -> dict[str, Any]:
    names = {line.title for line in lines}
    return {"show": named(lines), "type": "plain" if len(names) <= WRAPPED else "scroll"}


class Chart:
    """A chart with two axes and a description for screen readers.

    Parameters
    ----------
    label : str
        Description for screen readers.
    x_title, y_title : str
        Titles of the axes, with units.
    lines : sequence of Line
    names : sequence of str
        Names along the horizontal axis instead of numbers.
    tall : bool
    logarithmic : str
        Logarithmic axes: "", "x", "y" or "xy"; their values are above 0.
    moments : bool
        Whether the horizontal axis is time, s since 1970.
    level : bool, optional
        Whether to leave room for a legend, so that charts beside each other are level.
    on_span : callable, optional
        Called with the ends of a span that was drawn with the mouse.
    """

    def __init__(
        self,
        label: str,
        x_title: str,
        y_title: str,
        lines: Sequence[Line] = (),
        *,
        names: Sequence[str] = (),
        tall: bool = False,
        logarithmic: str = "",
        moments: bool = False,
        level: bool | None = None,
        on_span: Callable[[float, float], Any] | None = None,
    ) -> None:
        level = named(lines) if level is None else level
        self._per_x = 1000.0 if moments else 1.0  # a time axis counts in ms
        kinds = {axis: "log" if axis in logarithmic else "value" for axis in "xy"}
        options: dict[str, Any] = {
            "animation": False,
            "textStyle": {":fontFamily": "getComputedStyle(document.body).fontFamily"},
            "grid": {"left": 72, "right": 26, "top": 76 if level else 32, "bottom": 54},
            "legend": {
                "top": 0,
                "left": 0,
                **_legend(lines),
                "itemWidth": 18,
                "itemHeight": 10,
                "textStyle": {"fontSize": 13, ":color": _colour("--ink")},
                ":pageIconColor": _colour("--ink"),
            },
            "tooltip": {"trigger": "axis", "confine": True},
            "xAxis": _axis(
                x_title, vertical=False, names=names, kind="time" if moments else kinds["x"]
            ),
            "yAxis": _axis(y_title, vertical=True, kind=kinds["y"]),
            "series": self._lines(lines),
        }
        with box("figure", "figure"):
            self.element = ui.echart(options).classes("chart tall" if tall else "chart")
            self.element.props["role"] = "img"
            self.element.props["aria-label"] = label
            if on_span is not None:
                self._let_draw_spans(on_span)
            with box("div", "figure-tools"):
                self._tool("image", "picture", label)
                self._tool("table_view", "table", label)

    def _let_draw_spans(self, on_span: Callable[[float, float], Any]) -> None:
        """Call the function after a span was drawn; its tool needs a place, and gets no size."""
        zoom = {
            "yAxisIndex": "none",
            "filterMode": "none",
            "icon": {"zoom": "none", "back": "none"},
        }
        self.element.options["toolbox"] = {"itemSize": 0, "feature": {"dataZoom": zoom}}
        self.element.on(
            "chart:finished", js_handler=f"() => window.drawSpans({self.element.html_id!r})"
        )
        self.element.on(
            "chart:datazoom",
            lambda event: on_span(float(event.args[0]), float(event.args[1])),
            js_handler="""(event) => {
                const {startValue: from, endValue: to} = event.batch?.[0] ?? {};
                if (from < to) emit([from, to]);
            }""",
        )

    def _tool(self, picture: str, kind: str, label: str) -> None:
        """Add a button with which the browser saves the chart; `panel.js` sets the file's name."""
        made = box("button", "control small quiet", type="button", data_chart_tool=kind)
        made.props["data-chart"] = self.element.html_id
        made.props["aria-label"] = label
        with made:
            icon(picture)

    def _lines(self, lines: Sequence[Line]) -> list[dict[str, Any]]:
        return [_series(line, self._per_x) for line in lines]

    def show(self, lines: Sequence[Line]) -> None:
        """Show other lines."""
        self.element.options["series"] = self._lines(lines)
        self.element.options["legend"] |= _legend(lines)
        self.element.update()


def error_chart(text: Text, label: str, lines: Sequence[Line] = (), *, tall: bool = False) -> Chart:
    """Make a chart of errors over the standard's torque; `label` is the key of its description."""
    axes = text("standard, N·m"), text("error, N·m")
    return Chart(text(label), *axes, lines, tall=tall)
