"""Check of the bench with a standard reducer: choose, start, read error and repeatability."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from torquebench.panel.components.charts import COLOURS, Chart, Line
from torquebench.panel.components.controls import Field, button, tolerance_field
from torquebench.panel.components.elements import box, panel, table, words
from torquebench.panel.pages.mounting_form import MountingForm
from torquebench.panel.pages.reducer.types import reducer_titles
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.text import Text
from torquebench.reports.errors_table import number

__all__ = ["STANDARD", "StandardForm", "standard_result"]

STANDARD = "standard-reducer"


class StandardForm:
    """The mounted reducer, and the tolerance."""

    def __init__(self, visitor: Visitor, on_start: Callable[[], None]) -> None:
        self._visitor, self._on_start = visitor, on_start

    def build(self) -> None:
        """Make the form's elements."""
        text, visitor = self._visitor.text, self._visitor
        certified = {
            name: title
            for name, title in reducer_titles(visitor).items()
            if visitor.service.settings.get("reducers", name).document.get("certified_friction")
        }
        if visitor.service.snapshot().simulated:
            certified = {"": text("standard.simulated"), **certified}
        with panel(text.core("Check the bench with a standard reducer")), box("div", "stack"):
            words("p", text("standard.explained"), "muted")
            if not certified:
                words("p", text("standard.none"), "muted")
                return
            with box("div", "columns"):
                self._reducer = Field(
                    text("standard.reducer"), next(iter(certified)), options=certified
                )
                self._tolerance = tolerance_field(text)
                repeats = {count: count for count in ("2", "3", "5", "10")}
                self._repeats = Field(text("standard.repeats"), "3", options=repeats)
            self._mounting = MountingForm(visitor)
            with box("div", "line"):
                button(text("standard.start"), self._start, picture="play_arrow")

    def _start(self) -> None:
        tolerance = self._tolerance.number()
        if tolerance is None:
            return
        request: dict[str, Any] = {
            "tolerance_percent_fs": tolerance,
            "repeats": int(self._repeats.value),
            **self._mounting.request(),
        }
        if self._reducer.value:
            request["reducer"] = self._reducer.value
        self._visitor.start(STANDARD, request)
        self._on_start()


def standard_result(text: Text, details: Mapping[str, Any]) -> None:
    """Show known against measured friction, and both verdicts."""
    points = details["points"]
    repeats = max(len(point["measured_nm"]) for point in points)
    limit = f"{details['tolerance_percent_fs']:g} % FS"
    with panel(text("standard.found")), box("div", "stack"):
        words("p", f"{text.core(details['reducer'])}: {text.core(details['compensation'])}")
        for what in ("error", "repeatability"):
            value = details[f"{what}_percent_fs"]
            kept = value <= details["tolerance_percent_fs"]
            said = text(f"standard.{'kept' if kept else 'not_kept'}", limit=limit)
            words("p", f"{text(f'standard.{what}')}: {number(value)} % FS, {said}", "number")
        speed = [point["speed_rpm"] for point in points]
        lines = [Line(text("standard.known"), speed, [p["known_nm"] for p in points], "--ink")]
        for k, colour in zip(range(repeats), COLOURS, strict=False):
            measured = [
                (p["speed_rpm"], p["measured_nm"][k]) for p in points if len(p["measured_nm"]) > k
            ]
            lines.append(
                Line(
                    f"{text('standard.run')} {k + 1}",
                    [speed_rpm for speed_rpm, _ in measured],
                    [torque_nm for _, torque_nm in measured],
                    colour,
                    points=True,
                )
            )
        Chart(text("standard.chart"), text("standard.speed"), text("standard.torque"), lines)
        rows = [
            (
                f"{point['speed_rpm']:g}",
                number(point["known_nm"], 4),
                number(point["known_u_nm"], 2),
                *(number(value, 4) for value in point["measured_nm"]),
                *["—"] * (repeats - len(point["measured_nm"])),
                number(point["error_percent"], 2),
                number(point["spread_percent"], 2),
            )
            for point in points
        ]
        runs = [f"{text('standard.run')} {k + 1}, N·m" for k in range(repeats)]
        titles = ["rpm", f"{text('standard.known')}, N·m", "U, N·m", *runs,
                  f"{text('standard.error')}, % FS",
                  f"{text('standard.repeatability')}, % FS"]  # fmt: skip
        table(text("standard.found"), [(title, True) for title in titles], rows)
