"""Drift of the zero since it was taken."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import FloatArray, Readings, known_or
from torquebench.chain.torque import Component, Shared
from torquebench.uncertainty import Distribution

__all__ = ["Zero"]


@register("zero")
@dataclass(frozen=True)
class Zero(Effect):
    """Change of zero since it was taken, within a limit that grows with time.

    Parameters
    ----------
    drift_nm_per_h : float
        Limit of the change, N·m an hour.
    interval_h : float
        Longest time from one zeroing to the next, h: the age of a zero is at most that, and counts
        as that where it isn't known.
    """

    title: ClassVar[str] = "zero since zeroing"
    needs: ClassVar[tuple[str, ...]] = ("zero_age_h",)
    drift_nm_per_h: float = field(metadata={"least": 0.0})
    interval_h: float = field(default=1.0, metadata={"least": 0.0})

    def components(self, readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        """Return the limit at the age of the zero, as a rectangle."""
        limit = self.drift_nm_per_h * known_or(readings.zero_age_h, self.interval_h)
        return (
            Component(
                "zero drift",
                Shared.ZEROING,
                limit / np.sqrt(3.0),
                distribution=Distribution.RECTANGULAR,
            ),
        )
