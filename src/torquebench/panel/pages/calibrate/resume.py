"""Unfinished runs: finish, discard or resume them."""

from __future__ import annotations

from functools import partial
from typing import Any

from nicegui import ui

from torquebench.operations import find_operation
from torquebench.panel.components.controls import button
from torquebench.panel.components.dialogs import ask, foot, sheet
from torquebench.panel.components.elements import box, moment, note, words
from torquebench.panel.pages.operations.form import OperationForm
from torquebench.panel.pages.operations.page import begin
from torquebench.panel.pages.visitor import Visitor, profile_titles
from torquebench.panel.service import InterruptedView
from torquebench.panel.text import Texts

UNFINISHED: Texts = {
    "left open": "A run was left open",
    "sealed": "A run isn't in the registry yet",
    "measured": "A run is measured, but its result isn't registered",
    "interrupted": "A calibration was interrupted",
}


def unfinished_notes(visitor: Visitor, *, measured_only: bool = False) -> None:
    """List every unfinished run with the possible actions."""
    text, service = visitor.text, visitor.service
    for run in service.unfinished():
        if measured_only and run.state == "interrupted":
            continue
        if run.state == "copy":
            note(f"{text(run.found)}: {text(run.remedy)}", "warn")
            continue
        said = text("Run {number}", number=run.run_id)
        with note(said, "warn", title=text(UNFINISHED[run.state])):
            if run.state != "interrupted":
                button(text("Finish it without measuring"), partial(_finish, visitor, run.run_id),
                       picture="task_alt")  # fmt: skip
            elif (interrupted := service.records.interrupted(run.run_id)) is not None:
                resume_button(visitor, interrupted)
            button(text("Discard it"), partial(_discard, visitor, run.run_id), "quiet")


def _finish(visitor: Visitor, run_id: str) -> None:
    page = "/calibrate" if "-calibrate-" in run_id else "/records"
    visitor.start("records finish", {"run_id": run_id}, then=lambda: ui.navigate.to(page))


def _discard(visitor: Visitor, run_id: str) -> None:
    text = visitor.text

    def discard(reason: str) -> bool:
        request = {"run_id": run_id, "reason": reason}
        return visitor.start("records discard", request, then=lambda: ui.navigate.to("/records"))

    with ui.context.client.content:
        ask(
            text,
            text("Discard it"),
            text(
                "Run {number} gets no result. Its folder is kept, and the reason is recorded.",
                number=run_id,
            ),
            discard,
            field=text("Reason"),
            danger=True,
        )


def interrupted_note(visitor: Visitor) -> None:
    """Offer to finish measured runs, and to resume the newest calibration."""
    unfinished_notes(visitor, measured_only=True)
    run = visitor.service.records.interrupted()
    if run is None:
        return
    text = visitor.text
    said = text(
        "{side}: {points} of {total} points.",
        side=text.title(run.side),
        points=run.points,
        total=run.total,
    )
    with note(said, "warn", title=text("A calibration was interrupted")):
        with box("p"):
            words("span", f"{text('The last one:')} ")
            moment(run.interrupted)
        resume_button(visitor, run)


def resume_button(visitor: Visitor, run: InterruptedView) -> Any:
    """Make the button that continues with an interrupted calibration."""
    return button(visitor.text("Go on with it"), lambda: _ask(visitor, run), picture="redo")


def _ask(visitor: Visitor, run: InterruptedView) -> None:
    text, operation = visitor.text, find_operation("resume")

    def started(_result: object) -> None:
        dialog.close()
        ui.navigate.to("/calibrate")

    with ui.context.client.content, sheet(text("Go on with it")) as dialog:
        profiles = profile_titles(visitor)
        words("p", profiles.get(run.profile, text(run.profile)), "muted")
        words(
            "p",
            text(
                "Preload and zero are done again; {kept} of {total} points stay, the "
                "interrupted series is measured again.",
                kept=run.kept,
                total=run.total,
            ),
        )
        form = OperationForm(visitor, operation, {"run_id": run.run_id}, ("run_id", "models"))
        with foot(text, dialog):
            button(
                text("Start calibration"),
                lambda: begin(visitor, operation, form, then=started),
                "primary",
                picture="play_arrow",
            )
