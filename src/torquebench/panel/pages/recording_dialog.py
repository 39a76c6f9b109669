"""The dialog that starts a recording."""

from __future__ import annotations

from torquebench.operations import parameters
from torquebench.operations.recording import TRIGGER_SIGNALS, RecordRequest
from torquebench.panel.components.controls import Field, button
from torquebench.panel.components.dialogs import foot, sheet
from torquebench.panel.components.elements import box, words
from torquebench.panel.pages.operations.form import field_value, fields_suit
from torquebench.panel.pages.records.column_titles import column_title
from torquebench.panel.pages.visitor import Visitor


def open_recording(visitor: Visitor) -> None:
    """Ask for the data of a recording, and start it."""
    text = visitor.text
    asked = {each.name: each for each in parameters(RecordRequest)}

    def start() -> None:
        fields = {"name": name, "note": note, "duration_s": duration, "before_s": before}
        entered = {key: field_value(asked[key], field.value) for key, field in fields.items()}
        request = {key: value for key, value in entered.items() if value not in (None, "")}
        if begins.value == "level":
            passed = field_value(asked["duration_s"], level.value)
            request["trigger"] = {"signal": signal.value, "level": passed, "direction": way.value}
        elif begins.value == "time":
            request["at"] = at.value
        if fields_suit(text, RecordRequest, request, fields | {"trigger.level": level, "at": at}):
            visitor.act(visitor.service.jobs.start, "record", request, then=dialog.close)

    def shown(kind: str) -> None:
        for field in (signal, level, way):
            field.frame.set_visibility(kind == "level")
        at.frame.set_visibility(kind == "time")

    with sheet(text("Record all signals")) as dialog:
        words(
            "p",
            text(
                "Nothing is moved, and calibrations and tests go on beside it. Every "
                "sample of torque, angle, speed and temperature goes into a run of the "
                "records."
            ),
        )
        name = Field(text("Name"), maxlength="80", autocomplete="off")
        note = Field(text("Note"), maxlength="500", autocomplete="off")
        with box("div", "columns narrow"):
            duration = Field(
                text("Length"),
                unit="s",
                hint=text("Empty: until you finish it."),
                inputmode="decimal",
            )
            before = Field(
                text("Also record before the start"),
                "0",
                unit="s",
                hint=text("Up to 60 s."),
                inputmode="decimal",
            )
        options = {
            "now": text("At once"),
            "level": text("When a signal passes a level"),
            "time": text("At a time"),
        }
        begins = Field(text("When it starts"), "now", options=options, on_change=shown)
        with box("div", "columns narrow"):
            signals: dict[str, str] = {name: column_title(text, name) for name in TRIGGER_SIGNALS}
            signal = Field(text("Signal"), TRIGGER_SIGNALS[0], options=signals)
            ways = {"rising": text("Rising signal"), "falling": text("Falling signal")}
            way = Field(text("Direction"), "rising", options=ways)
            level = Field(text("Level"), hint=text("N·m or rpm"), inputmode="decimal")
        at = Field(text("Date and time"), kind="datetime-local", step="1")
        shown("now")
        with foot(text, dialog):
            button(text("Record signals"), start, "primary", picture="fiber_manual_record")
    # The browser's time is local; the server needs the time zone.
    at.control.on(
        "change",
        lambda event: setattr(at, "value", str(event.args)),
        js_handler="(event) => emit(new Date(event.target.value).toISOString())",
    )
