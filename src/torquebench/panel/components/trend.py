"""The live chart: receives new rows and is painted by the browser once per frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import nicegui.elements.echart  # noqa: F401 - puts ECharts within the component's reach
from nicegui.element import Element

MOST_AHEAD = 12
"""Largest number of messages that the browser hasn't painted yet: those of a third of a second."""
PATIENCE_S = 2.0
"""Time after which the next message is sent without the browser's answer, which may be lost, s."""


@dataclass(frozen=True)
class Trace:
    """A line of the live chart.

    Parameters
    ----------
    name : str
        Name of the signal.
    title, unit : str
    grid : int
        Index of its band.
    colour : str
        Custom property of the style sheet.
    dashed : bool
    under : bool
        Whether it is a broad line beneath the others.
    axis : int
        Scale: 0 is the left one, 1 the right one.
    decimals : int
        Decimals of its values.
    """

    name: str
    title: str
    unit: str
    grid: int
    colour: str
    dashed: bool = False
    under: bool = False
    axis: int = 0
    decimals: int = 2


@dataclass(frozen=True)
class Band:
    """One of several charts above each other, with a left and a right scale.

    Parameters
    ----------
    title, second : str
        Titles of the left and the right scale; empty hides a scale.
    floor, secondFloor : float
        Smallest spans of the left and the right scale.
    ends : (float, float) or None
        Fixed ends of the left scale.
    aligned : bool
        Whether zero has the same height on both scales.
    """

    title: str
    floor: float
    second: str = ""
    secondFloor: float = 1.0  # noqa: N815 - a property of the browser's component
    ends: tuple[float, float] | None = None
    aligned: bool = False


class Trend(Element, component="trend.js"):  # type: ignore[call-arg]  # NiceGUI's is skipped
    """The live chart with its tools, table of values and numbers.

    Parameters
    ----------
    label : str
        Description for screen readers.
    said : mapping of str to str
        Texts of its buttons and headings.
    name : str
        Name of saved files.
    places : mapping of signal name to (element, decimals)
        Elements whose text is the newest number.
    region : element
        Element that turns grey without new data.
    on_view : callable
        Called with start and end (bench time, s) of a zoomed span, for which finer rows are needed.
    on_hold : callable
        Called after another span is held, or none.
    """

    def __init__(
        self,
        label: str,
        said: Mapping[str, str],
        name: str,
        places: Mapping[str, tuple[Any, int]],
        region: Any,
        on_view: Callable[[float, float], Any],
        on_hold: Callable[[], Any],
    ) -> None:
        super().__init__()
        self.props["label"] = label
        self.props["words"] = dict(said)
        self.props["name"] = name
        self.props["series"] = []
        self.props["grids"] = []
        self.props["places"] = {
            name: {"id": element.html_id, "decimals": decimals}
            for name, (element, decimals) in places.items()
        }
        self.props["region"] = region.html_id
        self._on_hold = on_hold
        self.view: tuple[float, float] | None = None
        """Ends of the span that is held, bench time in s; None while the chart follows."""
        self._sent = self._painted = 0
        self._sent_at = 0.0
        self.on("painted", self._answered)
        self.on("zoomed", self._zoomed)
        self.on("view", lambda event: on_view(event.args["start"], event.args["stop"]))

    def arrange(
        self,
        traces: Sequence[Trace],
        bands: Sequence[Band],
        x: Trace | None = None,
        digits: Sequence[Trace] = (),
    ) -> None:
        """Replace the lines; `x` is the horizontal signal of an XY plot, `digits` are numbers."""
        self.props["x"] = None if x is None else asdict(x)
        self.props["digits"] = [asdict(trace) for trace in digits]
        self.props["series"] = [asdict(trace) for trace in traces]
        self.props["grids"] = [asdict(band) for band in bands]

    def _zoomed(self, event: Any) -> None:
        held = event.args
        self.view = None if held is None else (float(held["start"]), float(held["stop"]))
        self._on_hold()

    def _answered(self, event: Any) -> None:
        self._painted = min(max(self._painted, int(event.args)), self._sent)

    @property
    def ready(self) -> bool:
        """Whether the browser keeps up; otherwise it gets fewer and larger messages."""
        if self._sent - self._painted < MOST_AHEAD:
            return True
        return time.monotonic() - self._sent_at > PATIENCE_S

    def reset(self, seconds: float, trend: Any, clock_offset_s: float) -> None:
        """Show another time span, beginning with the server's stored rows."""
        self.run_method(
            "reset",
            seconds,
            *_rows(trend),
            clock_offset_s,
        )

    def finer(self, start_s: float, stop_s: float, trend: Any) -> None:
        """Send finer rows of a zoomed span."""
        self.run_method("finer", start_s, stop_s, *_rows(trend))

    def marks(self, markers: Iterable[tuple[float, str]]) -> None:
        """Show markers: bench time in s, and note."""
        self.run_method("marks", [{"time": time_s, "note": note} for time_s, note in markers])

    def push(
        self, increment: Any, numbers: Mapping[str, float | None], clock_offset_s: float
    ) -> None:
        """Send new rows, and the newest numbers."""
        self._sent += 1
        self._sent_at = time.monotonic()
        self.run_method(
            "push",
            {
                "t": increment.time_s.round(4).tolist(),
                "l": _lists(increment.low),
                "h": _lists(increment.high),
                "v": _lists(increment.values),
                "n": numbers,
                "i": self._sent,
                "o": clock_offset_s,
            },
        )


def _rows(trend: Any) -> tuple[Any, ...]:
    """Convert times, lowest, highest and mean values for the browser."""
    return trend.time_s.tolist(), _lists(trend.low), _lists(trend.high), _lists(trend.values)


def _lists(columns: Mapping[str, Any]) -> dict[str, list[float]]:
    return {name: values.round(5).tolist() for name, values in columns.items()}
