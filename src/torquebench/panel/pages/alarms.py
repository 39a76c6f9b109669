"""The page of alarms: event, cause, remedy, and who acknowledged it."""

from __future__ import annotations

from typing import Any

from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import (
    box,
    empty,
    headings,
    moment,
    note,
    panel,
    refilled,
    table,
    tag,
    words,
)
from torquebench.panel.pages.frame import frame
from torquebench.panel.pages.page import page
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import AlarmView

__all__ = ["alarms_page"]

HISTORY = 50


def _key(alarm: AlarmView) -> str:
    return alarm.kind.replace(" ", "_")


class _AlarmsPage:
    def __init__(self, visitor: Visitor) -> None:
        self.visitor, self.text = visitor, visitor.text
        self._shown: Any = None
        self._stood: list[AlarmView] | None = None

    def build(self) -> None:
        with box("div", "stack"):
            self._active = box("div", "stack", role="region", aria_label=self.text("alarms.now"))
            with panel(self.text("alarms.history")):
                self._history = box("div")

    def refresh(self) -> None:
        alarms = self.visitor.service.alarms()
        if alarms == self._shown:
            return
        self._shown = alarms
        active = [alarm for alarm in alarms if alarm.active]
        if active != self._stood:  # don't rebuild a button that may be about to be pressed
            self._stood = active
            self._show(active)
        with refilled(self._history):
            self._list([alarm for alarm in alarms if not alarm.active])

    def _show(self, active: list[AlarmView]) -> None:
        with refilled(self._active):
            if active:
                self._acknowledging(active)
                for alarm in active:
                    self._card(alarm)
            else:
                note(self.text("alarms.none"), "good")

    def _acknowledging(self, active: list[AlarmView]) -> None:
        text = self.text
        critical = any(alarm.level == "critical" for alarm in active)
        with panel(), box("div", "spread"):
            words("p", text("alarms.latched" if critical else "alarms.warnings"))
            name = self.visitor.looker.name
            button(
                text("alarms.acknowledge", who=name), self._acknowledge, "primary", picture="check"
            )

    def _card(self, alarm: AlarmView) -> None:
        text, key = self.text, _key(alarm)
        kind = "bad" if alarm.level == "critical" else "warn"
        with note(text.core(alarm.found), kind, title=text.alarm(alarm.kind)), box("div", "stack"):
            with box("div", "line small"):
                tag(text(f"alarms.{alarm.level}"), kind)
                moment(alarm.raised, seconds=True)
                words("span", text("alarms.source", source=text.core(alarm.source)))
            if alarm.allowed:
                words("p", text("alarms.allowed", allowed=text.core(alarm.allowed)))
            remedies = [text.maybe(f"alarm.{key}_do", "")]
            if alarm.remedy and key != "stop_requested":  # the core's remedy would repeat it
                remedies.append(text.sentence(alarm.remedy))
            words("p", text("alarms.what_to_do", remedy=" ".join(filter(None, remedies))))

    def _list(self, alarms: list[AlarmView]) -> None:
        text = self.text
        if not alarms:
            empty(text("alarms.no_history"), "notifications_none")
            return
        rows = [
            (
                alarm.raised,
                text.alarm(alarm.kind),
                text.core(alarm.found),
                text("alarms.by", who=alarm.acknowledged_by)
                if alarm.acknowledged_by
                else text("alarms.went"),
            )
            for alarm in sorted(alarms, key=lambda alarm: -alarm.number)[:HISTORY]
        ]
        columns = headings(text, "alarms", "when what cause end")
        table(text("alarms.history"), columns, rows)

    def _acknowledge(self) -> None:
        seen = [alarm.alarm_id for alarm in self._stood or ()]
        self.visitor.act(self.visitor.service.acknowledge, seen)
        self.refresh()


@page("alarms", "/alarms", picture="notifications", place=6)
def alarms_page(visitor: Visitor) -> None:
    """Build the page of the alarms."""
    page = _AlarmsPage(visitor)
    with frame(visitor, "alarms", page.refresh):
        page.build()
