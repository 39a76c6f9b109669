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

__all__ = ["interrupted_note", "resume_button", "unfinished_notes"]


def unfinished_notes(visitor: Visitor, *, measured_only: bool = False) -> None:
    """List every unfinished run with the possible actions."""
    text, service = visitor.text, visitor.service
    for run in service.unfinished():
        if measured_only and run.state == "interrupted":
            continue
        if run.state == "copy":
            note(f"{text.core(run.found)}: {text.core(run.remedy)}", "warn")
            continue
        said = text("unfinished.found", number=run.run_id)
        with note(said, "warn", title=text(f"unfinished.{run.state.replace(' ', '_')}")):
            if run.state != "interrupted":
                button(text("unfinished.finish"), partial(_finish, visitor, run.run_id),
                       picture="task_alt")  # fmt: skip
            elif (interrupted := service.records.interrupted(run.run_id)) is not None:
                resume_button(visitor, interrupted)
            button(text("unfinished.discard"), partial(_discard, visitor, run.run_id), "quiet")


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
            text("unfinished.discard"),
            text("unfinished.discard_said", number=run_id),
            discard,
            field=text("unfinished.reason"),
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
        "resume.found",
        side=text(f"side.{run.side}"),
        points=run.points,
        total=run.total,
    )
    with note(said, "warn", title=text("resume.title")):
        with box("p"):
            words("span", f"{text('resume.last')} ")
            moment(run.interrupted)
        resume_button(visitor, run)


def resume_button(visitor: Visitor, run: InterruptedView) -> Any:
    """Make the button that continues with an interrupted calibration."""
    return button(visitor.text("resume.button"), lambda: _ask(visitor, run), picture="redo")


def _ask(visitor: Visitor, run: InterruptedView) -> None:
    text, operation = visitor.text, find_operation("resume")

    def started(_result: object) -> None:
        dialog.close()
        ui.navigate.to("/calibrate")

    with ui.context.client.content, sheet(text("resume.button")) as dialog:
        profiles = profile_titles(visitor)
        words("p", profiles.get(run.profile, text.core(run.profile)), "muted")
        words("p", text("resume.explained", kept=run.kept, total=run.total))
        form = OperationForm(visitor, operation, {"run_id": run.run_id}, ("run_id", "models"))
        with foot(text, dialog):
            button(
                text("prepare.start"),
                lambda: begin(visitor, operation, form, then=started),
                "primary",
                picture="play_arrow",
            )
