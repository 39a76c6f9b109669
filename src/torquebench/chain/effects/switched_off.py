"""Corrections that a person has switched off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, Self

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import Readings
from torquebench.chain.torque import Component
from torquebench.elementwise import Values
from torquebench.errors import InputError
from torquebench.message import Message

Switch = Literal["hysteresis", "temperature", "rotation", "inertia", "ripple"]
SWITCHES: Mapping[str, tuple[str, ...]] = {
    "hysteresis": ("hysteresis",),
    "temperature": ("temperature of zero", "temperature of span"),
    "rotation": ("zero over speed", "bearing drag", "running-in"),
    "inertia": ("inertia",),
    "ripple": ("ripple by angle",),
}
"""Corrections that can be switched off, and the components of each."""


@register("switched off")
@dataclass(frozen=True)
class SwitchedOff(Effect):
    """Components that aren't corrected: their possible size is a standard uncertainty instead.

    Parameters
    ----------
    names : tuple of str
        Names of components.
    """

    title: ClassVar[str] = "corrections switched off"
    expected: ClassVar[bool] = False
    names: tuple[str, ...] = ()

    @classmethod
    def of(cls, record: str, *switches: str) -> Self:
        """Return the effect for names of `SWITCHES`; raises `InputError` for other names."""
        for switch in switches:
            if switch not in SWITCHES:
                raise InputError(Message("nothing called {each!r}", switch), ", ".join(SWITCHES))
        return cls(record, tuple(name for switch in switches for name in SWITCHES[switch]))

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return no components: `MeasuringChain` omits the correction of the named ones."""
        return ()
