"""Reproducibility between mountings: the span changes with each mounting."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import Readings
from torquebench.chain.torque import Component
from torquebench.elementwise import Values
from torquebench.uncertainty import Shared


@register("mounting")
@dataclass(frozen=True)
class Mounting(Effect):
    """Change of span after remounting the part between the flanges.

    Parameters
    ----------
    percent : float
        Standard deviation of the span between mountings, % of the torque.
    """

    title: ClassVar[str] = "reproducibility of mounting"
    percent: float = field(metadata={"least": 0.0})

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return a share of the torque, which all readings of a mounting have in common."""
        return (Component("mounting", Shared.MOUNTING, 1e-2 * self.percent * torque_nm),)
