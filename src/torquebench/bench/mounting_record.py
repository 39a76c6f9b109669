"""The record of a mounting: measurements and actions of a person at the bench.

A person reads dial gauge, the clamp pump's gauge and a watch, and enters the values. A run stores
them; its report and the certificate state them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, field_validator

from torquebench.message import Message

COAXIALITY_LIMIT_MM = 0.03
"""Largest coaxiality error that the source papers allow, mm."""


class MountingRecord(BaseModel):
    """Measurements at a mounting; unknown ones are left out.

    Attributes
    ----------
    coaxiality_mm : float or None
        Offset of the axes of the two modules, mm; `COAXIALITY_LIMIT_MM` at most.
    clamp_pressure_bar : float or None
        Pressure of the hydraulic clamp, bar.
    duration_min : float or None
        Time to mount and align, min.
    lubricant : str
        Lubricant of the mounted part.
    lubricant_amount_g, lubricant_hours : float or None
        Amount that was filled in, g, and operating hours since then, h.
    by : str
        The person who measured it, if different from the operator of the run.

    Examples
    --------
    >>> found = MountingRecord(coaxiality_mm=0.041, lubricant="grease", lubricant_hours=12)
    >>> found.stated()["coaxiality"]
    '0.041 mm (> 0.03 mm)'
    >>> found.within_limit
    False
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    coaxiality_mm: Annotated[
        float | None, Field(ge=0, le=10, title="Coaxiality found", description="mm")
    ] = None
    clamp_pressure_bar: Annotated[
        float | None, Field(gt=0, le=1000, title="Clamp pressure", description="bar")
    ] = None
    duration_min: Annotated[
        float | None, Field(ge=0, le=10_000, title="Time to mount", description="min")
    ] = None
    lubricant: Annotated[str, Field(max_length=100)] = ""
    lubricant_amount_g: Annotated[
        float | None, Field(gt=0, le=1e5, title="Amount of lubricant", description="g")
    ] = None
    lubricant_hours: Annotated[
        float | None, Field(ge=0, le=1e6, title="Lubricant in use for", description="h")
    ] = None
    by: Annotated[str, Field(title="Mounted by", max_length=100)] = ""

    # Pydantic converts a ValueError to a message about the field, but raises a TypeError.
    @field_validator("*", mode="before")
    @classmethod
    def _no_flag(cls, value: Any) -> Any:
        if isinstance(value, bool):
            raise ValueError("a measured value, not true or false")  # noqa: TRY004 - as above
        return value

    @property
    def within_limit(self) -> bool | None:
        """Whether the coaxiality is within its limit; None if it wasn't entered."""
        if self.coaxiality_mm is None:
            return None
        return self.coaxiality_mm <= COAXIALITY_LIMIT_MM

    @property
    def doubt(self) -> str:
        """Warning if the coaxiality exceeds its limit; else empty."""
        if self.within_limit is not False:
            return ""
        return Message(
            "coaxiality of {found:g} mm, more than {limit:g} mm: align the modules; otherwise the "
            "record states it",
            self.coaxiality_mm,
            COAXIALITY_LIMIT_MM,
        )

    def entered(self) -> dict[str, Any]:
        """Return the entered values by name."""
        return self.model_dump(exclude_defaults=True)

    def stated(self) -> dict[str, str]:
        """Return its statements by key, as figures that need no translation."""
        facts: dict[str, str] = {}
        if self.coaxiality_mm is not None:
            sign = "≤" if self.within_limit else ">"
            facts["coaxiality"] = f"{self.coaxiality_mm:g} mm ({sign} {COAXIALITY_LIMIT_MM:g} mm)"
        if self.clamp_pressure_bar is not None:
            facts["clamp_pressure"] = f"{self.clamp_pressure_bar:g} bar"
        if self.duration_min is not None:
            facts["mounting_time"] = f"{self.duration_min:g} min"
        lubrication = [
            self.lubricant,
            "" if self.lubricant_amount_g is None else f"{self.lubricant_amount_g:g} g",
            "" if self.lubricant_hours is None else f"{self.lubricant_hours:g} h",
        ]
        if any(lubrication):
            facts["lubrication"] = ", ".join(filter(None, lubrication))
        if self.by:
            facts["mounted_by"] = self.by
        return facts

    @classmethod
    def of_run(cls, metadata: Mapping[str, Any]) -> MountingRecord | None:
        """Return the record of a run's mounting; None if none was entered."""
        mounted = metadata.get(MOUNTED)
        return None if not mounted else cls.model_validate(mounted)

    def metadata(self) -> dict[str, Any]:
        """Return its entry in a run's record."""
        return {MOUNTED: self.entered()}


MOUNTED = "mounting_record"
MOUNTING_WORDS: Mapping[str, str] = {
    "coaxiality": "Coaxiality found",
    "clamp_pressure": "Clamp pressure",
    "mounting_time": "Time to mount",
    "lubrication": "Lubrication",
    "mounted_by": "Mounted by",
}
"""Label of each statement of a mounting."""


def mounting_facts(record: MountingRecord | None) -> tuple[tuple[str, str], ...]:
    """Return the report's lines about a mounting; empty if nothing was entered."""
    stated = {} if record is None else record.stated()
    return tuple((MOUNTING_WORDS[key], value) for key, value in stated.items())
