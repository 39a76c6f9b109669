"""Zeroing and the daily check: the first press opens the dialog, the second starts."""

from __future__ import annotations

from typing import Any

from torquebench.panel.components.controls import Choice, button
from torquebench.panel.components.dialogs import sheet
from torquebench.panel.components.elements import box, words
from torquebench.panel.pages.visitor import Visitor

__all__ = ["clear_choice", "quick_buttons"]


def quick_buttons(visitor: Visitor) -> None:
    """Offer zeroing and the daily check."""
    text = visitor.text
    with box("div", "line"):
        button(text("quick.zero"), lambda: _dialog(visitor, "zero"), picture="exposure_zero")
        button(text("quick.check"), lambda: _dialog(visitor, "check"), picture="fact_check")


def clear_choice(visitor: Visitor) -> Choice | None:
    """Ask on a real bench whether it may be loaded; None on a simulated one."""
    if visitor.service.snapshot().simulated:
        return None
    text = visitor.text
    return Choice(text("prepare.clear"), {"clear": text("prepare.clear_confirmed")}, several=True)


def _dialog(visitor: Visitor, kind: str) -> None:
    text = visitor.text

    def start() -> None:
        request: dict[str, Any] = {} if side is None else {"side": side.value}
        if clear is not None:
            request["bench_clear"] = "clear" in clear.values
        if visitor.attempt(lambda: visitor.service.jobs.start(visitor.actor, kind, request)):
            dialog.close()

    with sheet(text(f"quick.{kind}")) as dialog:
        words("p", text(f"quick.{kind}_explained"))
        sides = {name: text(f"side.{name}") for name in ("output", "input")}
        side = Choice(text("prepare.side"), sides, "output") if kind == "check" else None
        clear = clear_choice(visitor) if kind == "check" else None
        with box("div", "line end"):
            button(text("frame.close"), dialog.close, "quiet")
            button(text("job.start"), start, "primary", picture="play_arrow")
