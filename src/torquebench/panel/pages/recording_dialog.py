"""The dialog that starts a recording."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations.recording import TRIGGER_SIGNALS
from torquebench.panel.components.controls import Field, button, typed_number
from torquebench.panel.components.dialogs import foot, sheet
from torquebench.panel.components.elements import box, words
from torquebench.panel.pages.records.column_titles import column_title
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import Actor


def open_recording(visitor: Visitor) -> None:
    """Ask for the data of a recording, and start it."""
    text = visitor.text

    def start() -> None:
        def begin(actor: Actor) -> None:
            request = {"name": name.value.strip(), "note": note.value.strip()}
            request |= _numbers(duration, before) | _beginning(begins, signal, level, way, at)
            visitor.service.jobs.start(actor, "record", request)

        visitor.act(begin, then=dialog.close)

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


def _numbers(duration: Field, before: Field) -> dict[str, Any]:
    numbers: dict[str, Any] = {"before_s": _number(before) if before.value.strip() else 0.0}
    if duration.value.strip():
        numbers["duration_s"] = _number(duration)
    return numbers


def _beginning(begins: Field, signal: Field, level: Field, way: Field, at: Field) -> dict[str, Any]:
    if begins.value == "level":
        trigger = {
            "signal": signal.value,
            "level": _number(level),
            "direction": way.value,
        }
        return {"trigger": trigger}
    if begins.value == "time":
        try:
            moment = datetime.fromisoformat(at.value)
        except ValueError:
            raise InputError("no moment", "date and time at which the recording begins") from None
        return {"at": moment.astimezone(UTC).isoformat()}
    return {}


def _number(field: Field) -> float:
    try:
        return typed_number(field.value)
    except ValueError:
        found = Message("{field}: {value!r}", field.label, field.value)
        raise InputError(found, "a number") from None
