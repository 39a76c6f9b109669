"""Creep of the transducer under load."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import ClassVar

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import Readings
from torquebench.chain.torque import Component
from torquebench.elementwise import Values
from torquebench.uncertainty import Distribution, Shared


@register("creep")
@dataclass(frozen=True)
class Creep(Effect):
    """Change of a reading under a constant load, within the limit of the data sheet.

    The duration of a load isn't recorded, so that the whole limit counts, in both directions: a
    reading creeps with the load, and back after it is removed.

    Parameters
    ----------
    percent : float
        Limit of the change after the data sheet's time, % of the torque.
    """

    title: ClassVar[str] = "creep under load"
    percent: float = field(metadata={"least": 0.0})

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the limit as a rectangular distribution, independent for every loading."""
        return (
            Component(
                "creep",
                Shared.LOADING,
                1e-2 * self.percent / sqrt(3.0) * torque_nm,
                distribution=Distribution.RECTANGULAR,
            ),
        )
