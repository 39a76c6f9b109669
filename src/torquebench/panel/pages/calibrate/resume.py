"""Go on with a calibration: one that was interrupted, or one of the records."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from torquebench.panel.components.controls import button
from torquebench.panel.components.elements import box, note, words
from torquebench.panel.pages.quick import clear_choice
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import InterruptedView

__all__ = ["interrupted_note", "resume_button", "take_up"]


def take_up(visitor: Visitor, calibration_id: int) -> None:
    """Open a registered calibration in the wizard."""
    if visitor.attempt(lambda: visitor.service.recall(visitor.actor, calibration_id)):
        ui.navigate.to("/calibrate")


def interrupted_note(visitor: Visitor) -> None:
    """Offer to go on where the newest calibration was interrupted."""
    found = visitor.service.interrupted()
    if found is None:
        return
    text = visitor.text
    said = text(
        "resume.found",
        side=text(f"side.{found.side}"),
        when=f"{found.interrupted:%Y-%m-%d %H:%M}",
        points=found.points,
        total=found.total,
    )
    with note(said, "warn", title=text("resume.title")):
        resume_button(visitor, found)


def resume_button(visitor: Visitor, found: InterruptedView) -> Any:
    """Make the button that goes on with an interrupted calibration."""
    return button(visitor.text("resume.button"), lambda: _ask(visitor, found), picture="redo")


def _ask(visitor: Visitor, found: InterruptedView) -> None:
    text = visitor.text
    dialog = ui.dialog()
    dialog.props["aria-label"] = text("resume.button")
    dialog.on_value_change(lambda event: None if event.value else dialog.delete())

    def start() -> None:
        request: dict[str, Any] = {"run_id": found.run_id}
        if clear is not None:
            request["bench_clear"] = "clear" in clear.values
        if visitor.attempt(
            lambda: visitor.service.jobs.start(visitor.actor, "resume-calibration", request)
        ):
            dialog.close()
            ui.navigate.to("/calibrate")

    with ui.context.client.content, dialog, box("div", "sheet"):
        words("h2", text("resume.button"))
        words("p", text.core(found.profile), "muted")
        words("p", text("resume.explained", kept=found.kept, total=found.total))
        clear = clear_choice(visitor)
        with box("div", "line end"):
            button(text("frame.close"), dialog.close, "quiet")
            button(text("prepare.start"), start, "primary", picture="play_arrow")
    dialog.open()
