"""Zeroing and the daily check: the first press opens the dialog, the second starts."""

from __future__ import annotations

from typing import Any

from torquebench.panel.components.controls import Choice, button
from torquebench.panel.components.dialogs import foot, sheet
from torquebench.panel.components.elements import box, words
from torquebench.panel.pages.visitor import Visitor

__all__ = ["BenchClear", "quick_buttons"]


def quick_buttons(visitor: Visitor) -> None:
    """Offer zeroing and the daily check."""
    text = visitor.text
    with box("div", "line"):
        button(text("quick.zero"), lambda: _dialog(visitor, "zero"), picture="exposure_zero")
        button(text("quick.check"), lambda: _dialog(visitor, "check"), picture="fact_check")


class BenchClear:
    """Asks on a real bench whether it may be loaded; nothing on a simulated one."""

    def __init__(self, visitor: Visitor) -> None:
        self._choice: Choice | None = None
        if not visitor.service.snapshot().simulated:
            text = visitor.text
            options = {"clear": text("prepare.clear_confirmed")}
            self._choice = Choice(text("prepare.clear"), options, several=True)

    def request(self) -> dict[str, bool]:
        """Return the field of a job's request; empty on a simulated bench."""
        return {} if self._choice is None else {"bench_clear": "clear" in self._choice.values}


def _dialog(visitor: Visitor, kind: str) -> None:
    text = visitor.text

    def start() -> None:
        request: dict[str, Any] = {} if side is None else {"side": side.value}
        request |= {} if clear is None else clear.request()
        visitor.start(kind, request, then=dialog.close)

    with sheet(text(f"quick.{kind}")) as dialog:
        words("p", text(f"quick.{kind}_explained"))
        sides = {name: text(f"side.{name}") for name in ("output", "input")}
        side = Choice(text("prepare.side"), sides, "output") if kind == "check" else None
        clear = BenchClear(visitor) if kind == "check" else None
        with foot(text, dialog):
            button(text("job.start"), start, "primary", picture="play_arrow")
