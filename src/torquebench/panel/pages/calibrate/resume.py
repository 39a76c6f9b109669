"""Continue a calibration: an interrupted one, or one of the records."""

from __future__ import annotations

from functools import partial
from typing import Any

from nicegui import ui

from torquebench.panel.components.controls import button
from torquebench.panel.components.dialogs import ask, sheet
from torquebench.panel.components.elements import box, moment, note, words
from torquebench.panel.pages.quick import BenchClear
from torquebench.panel.pages.records.table_import import all_profile_titles
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.service import InterruptedView

__all__ = ["interrupted_note", "resume_button", "take_up", "unfinished_notes"]


def take_up(visitor: Visitor, calibration_id: int) -> None:
    """Open a registered calibration in the wizard."""
    if visitor.attempt(lambda: visitor.service.recall(visitor.actor, calibration_id)):
        ui.navigate.to("/calibrate")


def unfinished_notes(visitor: Visitor, *, measured_only: bool = False) -> None:
    """List every unfinished run with the possible actions."""
    text, service = visitor.text, visitor.service
    for run in service.unfinished():
        if measured_only and run.state == "interrupted":
            continue
        said = text("unfinished.found", number=run.run_id)
        with note(said, "warn", title=text(f"unfinished.{run.state.replace(' ', '_')}")):
            if run.state != "interrupted":
                button(text("unfinished.finish"), partial(_finish, visitor, run.run_id),
                       picture="task_alt")  # fmt: skip
            elif (interrupted := service.interrupted(run.run_id)) is not None:
                resume_button(visitor, interrupted)
            button(text("unfinished.discard"), partial(_discard, visitor, run.run_id), "quiet")


def _finish(visitor: Visitor, run_id: str) -> None:
    jobs = visitor.service.jobs
    if visitor.attempt(lambda: jobs.start(visitor.actor, "finish-run", {"run_id": run_id})):
        ui.navigate.to("/calibrate" if "-calibrate-" in run_id else "/records")


def _discard(visitor: Visitor, run_id: str) -> None:
    text, jobs = visitor.text, visitor.service.jobs

    def discard(reason: str) -> bool:
        request = {"run_id": run_id, "reason": reason}
        done = visitor.attempt(lambda: jobs.start(visitor.actor, "discard-run", request))
        if done:
            ui.navigate.to("/records")
        return bool(done)

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
    found = visitor.service.interrupted()
    if found is None:
        return
    text = visitor.text
    said = text(
        "resume.found",
        side=text(f"side.{found.side}"),
        points=found.points,
        total=found.total,
    )
    with note(said, "warn", title=text("resume.title")):
        with box("p"):
            words("span", f"{text('resume.last')} ")
            moment(found.interrupted)
        resume_button(visitor, found)


def resume_button(visitor: Visitor, found: InterruptedView) -> Any:
    """Make the button that continues with an interrupted calibration."""
    return button(visitor.text("resume.button"), lambda: _ask(visitor, found), picture="redo")


def _ask(visitor: Visitor, found: InterruptedView) -> None:
    text = visitor.text

    def start() -> None:
        request = {"run_id": found.run_id, **clear.request()}
        if visitor.attempt(
            lambda: visitor.service.jobs.start(visitor.actor, "resume-calibration", request)
        ):
            dialog.close()
            ui.navigate.to("/calibrate")

    with ui.context.client.content, sheet(text("resume.button")) as dialog:
        profiles = all_profile_titles(visitor)
        words("p", profiles.get(found.profile, text.core(found.profile)), "muted")
        words("p", text("resume.explained", kept=found.kept, total=found.total))
        clear = BenchClear(visitor)
        with box("div", "line end"):
            button(text("frame.close"), dialog.close, "quiet")
            button(text("prepare.start"), start, "primary", picture="play_arrow")
