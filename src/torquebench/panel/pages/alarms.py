"""The page of alarms: event, cause, remedy, and who acknowledged it."""

from __future__ import annotations

from typing import Any

from torquebench.bench.safety.alarms import ALARM_CATALOGUE, AlarmKind
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

HISTORY = 50


class _AlarmsPage:
    def __init__(self, visitor: Visitor) -> None:
        self.visitor, self.text = visitor, visitor.text
        self._shown: Any = None
        self._stood: list[AlarmView] | None = None

    def build(self) -> None:
        with box("div", "stack"):
            self._active = box("div", "stack", role="region", aria_label=self.text("Active alarms"))
            with panel(self.text("Earlier alarms")):
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
                note(self.text("No active alarms. The bench may move."), "good")

    def _acknowledging(self, active: list[AlarmView]) -> None:
        text = self.text
        critical = any(alarm.level == "critical" for alarm in active)
        with panel(), box("div", "spread"):
            words(
                "p",
                text(
                    "The bench is without torque and doesn't move until the cause is removed "
                    "and a person acknowledges the alarm."
                    if critical
                    else "Warnings: the bench continues."
                ),
            )
            name = self.visitor.looker.name
            button(
                text("Acknowledge as {who}", who=name),
                self._acknowledge,
                "primary",
                picture="check",
            )

    def _card(self, alarm: AlarmView) -> None:
        text = self.text
        kind = "bad" if alarm.level == "critical" else "warn"
        with note(text(alarm.found), kind, title=text.alarm(alarm.kind)), box("div", "stack"):
            with box("div", "line small"):
                tag(text("stops the bench" if alarm.level == "critical" else "warning"), kind)
                moment(alarm.raised, seconds=True)
                words("span", text("from {source}", source=text(alarm.source)))
            if alarm.allowed:
                words("p", text("Allowed: {allowed}", allowed=text(alarm.allowed)))
            remedies = [text(ALARM_CATALOGUE[AlarmKind(alarm.kind)].remedy)]
            if alarm.remedy and alarm.kind != "stop requested":  # the core's remedy would repeat it
                remedies.append(text.sentence(alarm.remedy))
            words("p", text("What to do: {remedy}", remedy=" ".join(filter(None, remedies))))

    def _list(self, alarms: list[AlarmView]) -> None:
        text = self.text
        if not alarms:
            empty(text("No earlier alarms since the bench was opened."), "notifications_none")
            return
        rows = [
            (
                alarm.raised,
                text.alarm(alarm.kind),
                text(alarm.found),
                text("acknowledged by {who}", who=alarm.acknowledged_by)
                if alarm.acknowledged_by
                else text("ended by itself"),
            )
            for alarm in sorted(alarms, key=lambda alarm: -alarm.number)[:HISTORY]
        ]
        columns = headings(text, "When (UTC)", "Alarm", "Cause", "How it ended")
        table(text("Earlier alarms"), columns, rows)

    def _acknowledge(self) -> None:
        seen = [alarm.alarm_id for alarm in self._stood or ()]
        self.visitor.act(self.visitor.service.acknowledge, seen)
        self.refresh()


@page("alarms", "/alarms", "Alarms", picture="notifications", place=6)
def alarms_page(visitor: Visitor) -> None:
    """Build the page of the alarms."""
    page = _AlarmsPage(visitor)
    with frame(visitor, "alarms", page.refresh):
        page.build()
