"""The live page's table of each effect's present contribution in the measuring chains."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from torquebench.bench.roles import Side
from torquebench.chain import EffectState
from torquebench.panel.components.elements import (
    box,
    headings,
    on_press,
    refilled,
    scrolling,
    tag,
    words,
)
from torquebench.panel.pages.visitor import Visitor
from torquebench.panel.text import Texts
from torquebench.units import minus_signs

KINDS = {"holds": "good", "outside": "bad", "unmeasured": "warn", "off": "warn", "missing": "warn"}
ICONS = {
    "holds": "check",
    "outside": "error",
    "unmeasured": "help",
    "off": "toggle_off",
    "missing": "warning",
}
STATES: Texts = {
    "holds": "Within its range",
    "outside": "Outside: {detail}",
    "unmeasured": "In U only, not measured: {detail}",
    "missing": "Not in U, because no record exists",
    "off": "Switched off, in U",
}
TITLES: Texts = {"input": "Effects on the input torque", "output": "Effects on the output torque"}
NUMBERS = ("Contribution, N·m", "u, N·m")
DECIMALS: dict[Side, int] = {"input": 4, "output": 3}


class EffectsTable:
    """One side's effects: correction, uncertainty, validity and switch of each.

    Parameters
    ----------
    visitor : Visitor
    side : {"input", "output"}
    """

    def __init__(self, visitor: Visitor, side: Side) -> None:
        self._visitor, self._side, self._text = visitor, side, visitor.text
        self._numbers: dict[str, tuple[Any, Any]] = {}
        self._shown: tuple[Any, ...] | None = None
        self._open = False
        with box("details", "panel fold") as fold:
            words("summary", self._text(TITLES[side]))
            self._place = box("div", "stack")
        fold.on("toggle", self._toggled, js_handler="(event) => emit(event.target.open)")

    def _toggled(self, event: Any) -> None:
        self._open = bool(event.args)
        self.refresh()

    def refresh(self) -> None:
        """Show the newest window if the table is open; rebuild it only if a state has changed."""
        if not self._open:
            return
        states = [state for state in self._visitor.service.effects(self._side) if _says(state)]
        may = self._visitor.has_role("metrologist")
        shown = (may, *((state.name, state.state, _kind_of(state)) for state in states))
        if shown != self._shown:
            self._shown = shown
            self._build(states, may=may)
        for state in states:
            added, uncertainty = self._numbers[state.name]
            added.set_text(self._number(state.contribution_nm, sign=True))
            uncertainty.set_text(self._number(state.uncertainty_nm))

    def _number(self, value: float | None, *, sign: bool = False) -> str:
        decimals = DECIMALS[self._side]
        if value is None:
            return "–"
        return minus_signs(f"{value:{'+' if sign else ''}.{decimals}f}")

    def _build(self, states: Sequence[EffectState], *, may: bool) -> None:
        text, label = self._text, self._text(TITLES[self._side])
        self._numbers.clear()
        with refilled(self._place):
            if not states:
                words("p", text("Not compensated: only the raw reading is available."), "muted")
                return
            with scrolling(label), box("table", "data compact"):
                words("caption", label, "hidden-visually")
                with box("thead"), box("tr"):
                    for heading, numeric in headings(
                        text, "Effect", *NUMBERS, "State", "Correction", numbers=NUMBERS
                    ):
                        words("th", heading, "number" if numeric else "", scope="col")
                with box("tbody"):
                    for state in states:
                        self._row(state, may=may)
            words(
                "p",
                text(
                    "Corrections that are switched off remain off until the bench is closed. U "
                    "contains their effect."
                ),
                "small muted",
            )

    def _row(self, state: EffectState, *, may: bool) -> None:
        text, name = self._text, self._text(state.name)
        with box("tr", data_effect=state.name):
            words("th", name, scope="row", title=text(state.record))
            self._numbers[state.name] = (words("td", "", "number"), words("td", "", "number"))
            detail = text(state.detail)
            if state.state == "unmeasured":
                detail = ", ".join(text(quantity) for quantity in state.detail.split(", "))
            with box("td"):
                said = text(STATES[state.state], detail=detail)
                tag(said, KINDS[state.state], ICONS[state.state])
            with box("td"):
                if state.switch and may:
                    word = text("Switch on" if state.state == "off" else "Switch off")
                    button = words(
                        "button", word, "control small", type="button",
                        aria_label=f"{word}: {name}",
                    )  # fmt: skip
                    on_press(button, lambda: self._switch(state.switch, name))

    def _switch(self, switch: str, name: str) -> None:
        """Toggle one correction, and keep the others."""
        service, said = (
            self._visitor.service,
            self._text("{name}: the correction was changed.", name=name),
        )
        off = {state.switch for state in service.effects(self._side) if state.state == "off"}
        off ^= {switch}
        self._visitor.act(
            service.switch_off, self._side, sorted(off), success=said, then=self.refresh
        )


def _says(state: EffectState) -> bool:
    """Return whether an effect is listed: it contributes, can be switched off, or has a problem."""
    return bool(
        state.uncertainty_nm != 0.0
        or state.contribution_nm
        or state.switch
        or state.state == "outside"
    )


def _kind_of(state: EffectState) -> str:
    """Return the detail of an unmeasured effect, which doesn't change with every window."""
    return state.detail if state.state == "unmeasured" else ""
