"""Data of the mounting, entered before a run, and whether the bench is clear."""

from __future__ import annotations

from typing import Any

from torquebench.bench.mounting_record import COAXIALITY_LIMIT_MM, MOUNTING_WORDS
from torquebench.panel.components.controls import Field
from torquebench.panel.components.elements import box, words
from torquebench.panel.pages.quick import BenchClear
from torquebench.panel.pages.visitor import Visitor

__all__ = ["MountingForm"]

NUMBERS = {
    "coaxiality_mm": (MOUNTING_WORDS["coaxiality"], "mm"),
    "clamp_pressure_bar": (MOUNTING_WORDS["clamp_pressure"], "bar"),
    "duration_min": (MOUNTING_WORDS["mounting_time"], "min"),
    "lubricant_amount_g": ("Amount of lubricant", "g"),
    "lubricant_hours": ("Lubricant in use for", "h"),
}


class MountingForm:
    """Collapsed at first; empty fields aren't recorded. Below it, a real bench has to be clear."""

    def __init__(self, visitor: Visitor) -> None:
        text = visitor.text
        with box("details"):
            words("summary", text("mounting_record.title"))
            with box("div", "stack"):
                words("p", text("mounting_record.explained"), "small muted")
                with box("div", "columns"):
                    self._fields = {
                        name: Field(
                            text.core(label),
                            kind="number",
                            unit=unit,
                            hint=text("mounting_record.limit", limit=f"{COAXIALITY_LIMIT_MM:g}")
                            if name == "coaxiality_mm"
                            else "",
                            min="0",
                            step="any",
                        )
                        for name, (label, unit) in NUMBERS.items()
                    }
                    self._fields["lubricant"] = Field(
                        text.core("Lubricant"), maxlength="100", autocomplete="off"
                    )
        self._clear = BenchClear(visitor)

    def request(self) -> dict[str, Any]:
        """Return the fields of a job's request; empty without entries."""
        found: dict[str, Any] = {
            name: float(field.value) if name in NUMBERS else field.value.strip()
            for name, field in self._fields.items()
            if field.value.strip()
        }
        return ({"mounting": found} if found else {}) | self._clear.request()
