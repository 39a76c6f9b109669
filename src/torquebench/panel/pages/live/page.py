"""The live page: both torques in large figures, uncertainty, compensation, and the trend."""

from __future__ import annotations

from datetime import date, datetime
from typing import Any

from torquebench.bench.roles import SIDES, Side
from torquebench.campaign.fitting import model_title
from torquebench.panel.components.elements import (
    box,
    moment,
    panel,
    refilled,
    repeat,
    tag,
    words,
)
from torquebench.panel.pages.effects import EffectsTable
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.live.chart import LiveChart
from torquebench.panel.pages.page import page
from torquebench.panel.pages.records.column_titles import DECIMALS
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import BenchSnapshot, SideSnapshot
from torquebench.panel.text import Text, Texts
from torquebench.units import unit_of_name

PUSH_S = 1.0 / 40.0
"""Interval at which a page requests rows, s; shorter than the rows' interval, so none waits
long."""
FACTS: Texts = {
    "input_speed_rpm": "Input speed",
    "output_speed_rpm": "Output speed",
    "input_angle_deg": "Input angle",
    "output_angle_deg": "Output angle",
    "input_temperature_c": "Input temperature",
    "output_temperature_c": "Output temperature",
    "efficiency_percent": "Efficiency",
}
FACT_DECIMALS = {
    "input_speed_rpm": 2,
    "output_speed_rpm": 3,
    "input_angle_deg": 2,
    "output_angle_deg": 3,
}
EFFECTS_EVERY = 2
"""Page refreshes between two updates of the effects."""


class _Tile:
    """One side's torque."""

    def __init__(self, text: Text, side: Side, range_nm: float) -> None:
        self._text, self._side = text, side
        self.places: dict[str, tuple[Any, int]] = {}
        self._shown: tuple[Any, ...] = ()
        with panel(classes=f"tile {side}"):
            with box("div", "head"):
                words("h2", text("Input torque" if side == "input" else "Output torque"))
                self._state = box("div", "line")
            with box("div", "value number"):
                self._value = words("span", "—")
                words("span", "N·m", "unit")
            self._uncertainty = words("div", "", "uncertainty number")
            with box("div", "pair number"):
                for key, title in (("raw", text("Raw")), ("reference", text("Standard"))):
                    with box("span"):
                        words("span", f"{title} ")
                        self.places[f"{side}_{key}_nm"] = (words("b", "—"), DECIMALS[side])
                        words("span", " N·m")
                with box("span"):
                    before, after = text(
                        "{percent} % of ±{range} N·m", percent="#", range=f"{range_nm:g}"
                    ).split("#")
                    words("span", before)
                    self.places[f"{side}_share"] = (words("span", "—"), 1)
                    words("span", after)
            self._about = box("div", "about small muted")
            self._fault = words("div", "", "bad-text")
        self.places["torque"] = (self._value, DECIMALS[side])

    def refresh(self, side: SideSnapshot) -> None:
        """Update what doesn't change with every reading."""
        text, state = self._text, side.compensation
        uncertainty = side.expanded_uncertainty.value if state is not None else None
        known = (
            state,
            None if uncertainty is None else round(uncertainty, 6),
            side.torque.fault,
        )
        if known == self._shown:
            return
        if self._shown[:1] != known[:1]:
            self._compensation(side)
        self._shown = known
        said = text("Raw reading: no uncertainty is stated")
        if uncertainty is not None:
            said = text("± {value} N·m (k = 2)", value=f"{uncertainty:.{DECIMALS[self._side]}f}")
        self._uncertainty.set_text(said if state is None or uncertainty is not None else "")
        fault = side.torque.fault
        self._fault.set_text(text("No value: {fault}", fault=text(fault)) if fault else "")

    def _compensation(self, side: SideSnapshot) -> None:
        text, state = self._text, side.compensation
        with refilled(self._state):
            with box("span", "stale-note"):
                tag(text("Old values"), "bad", "history_toggle_off")
            if state is None:
                tag(text.title("not compensated"), "warn", "warning")
                with refilled(self._about):
                    words("span", text(side.compensation_problem))
                    words("a", text("Calibrate"), href="/calibrate")
                return
            kind = text(model_title(state.kind))
            self._tell(state.made, state.due, side.transducer_serial)
            if state.valid:
                tag(
                    text("Compensated: {kind}, model {number}", kind=kind, number=state.model_id),
                    "good",
                    "check",
                )
            else:
                tag(text("Calibration expired"), "bad", "event_busy")
                with self._about:
                    words("a", text("Calibrate"), href="/calibrate")

    def _tell(self, made: datetime, due: date | None, serial: str) -> None:
        """State model and transducer; no date is broken across lines."""
        with refilled(self._about):
            words("span", serial)
            for said, at in (("made", made), ("valid until", due)):
                if at is not None:
                    with box("span"):
                        words("span", f"{self._text(said)} ")
                        moment(at)


class _LivePage:
    """Content of an open live page."""

    def __init__(self, visitor: Visitor) -> None:
        self.visitor, self.text = visitor, visitor.text
        self.sides = visitor.service.snapshot().sides
        self.refreshes = 0

    def build(self) -> None:
        """Make the page's elements."""
        text = self.text
        with box("div", "live") as region:
            with box("div", "stack side"):
                with box("div", "tiles"):
                    self.tiles = {
                        side: _Tile(text, side, self.sides[side].range_nm)
                        for side in reversed(SIDES)
                    }
                places: dict[str, tuple[Any, int]] = {}
                for side, tile in self.tiles.items():
                    places |= {key: where for key, where in tile.places.items() if key != "torque"}
                    places[f"{side}_torque"] = tile.places["torque"]
                with panel(classes="facts"), box("dl", "pairs"):
                    for signal, title in FACTS.items():
                        words("dt", text(title))
                        with box("dd", "number"):
                            places[signal] = (words("span", "—"), FACT_DECIMALS.get(signal, 1))
                            words("span", f" {unit_of_name(signal)}", "unit")
            with box("div", "stack"):
                self.chart = LiveChart(self.visitor, places, region)
        with box("div", "stack effects"):
            self.effects = [EffectsTable(self.visitor, side) for side in reversed(SIDES)]

    def push(self) -> None:
        """Send the new rows."""
        self.chart.push(
            {
                side: (
                    f"{side}_{'torque' if snapshot.compensation is not None else 'raw'}_nm",
                    snapshot.range_nm,
                )
                for side, snapshot in self.sides.items()
            }
        )

    def refresh(self) -> None:
        """Update what doesn't change with every reading."""
        snapshot: BenchSnapshot = self.visitor.service.snapshot()
        self.sides = snapshot.sides
        for side, tile in self.tiles.items():
            tile.refresh(snapshot.sides[side])
        self.refreshes += 1
        if self.refreshes % EFFECTS_EVERY == 1:
            for table in self.effects:
                table.refresh()


@page("live", "/", "Live", picture="speed", place=1)
def live_page(visitor: Visitor) -> None:
    """Build the live page."""
    page = _LivePage(visitor)
    with frame(visitor, "live", page.refresh):
        page.build()
        repeat(PUSH_S, page.push)
