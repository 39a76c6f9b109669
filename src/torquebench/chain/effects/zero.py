"""The measured zero and its drift."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import ClassVar

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import Readings, known_or
from torquebench.chain.torque import Component
from torquebench.elementwise import Values
from torquebench.uncertainty import Distribution, Shared


@register("zero")
@dataclass(frozen=True)
class Zero(Effect):
    """Uncertainty of the zero in use, and its drift within a limit that grows with time.

    Parameters
    ----------
    drift_nm_per_h : float or None
        Limit of the change, N·m per hour; None if unknown, and then not in U.
    interval_h : float
        Longest time from one zeroing to the next, h: the largest age of a zero, used if its age is
        unknown.
    zero_nm : float
        Standard uncertainty of a zero when it is taken, N·m.
    """

    title: ClassVar[str] = "zero since zeroing"
    needs: ClassVar[tuple[str, ...]] = ("zero_age_h", "zero_nm")
    drift_nm_per_h: float | None = field(metadata={"least": 0.0})
    interval_h: float = field(default=1.0, metadata={"least": 0.0})
    zero_nm: float = field(default=0.0, metadata={"least": 0.0})

    def gaps(self) -> tuple[str, ...]:
        """Name the drift if its limit is unknown."""
        return ("zero drift",) if self.drift_nm_per_h is None else ()

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the zero, and the drift's limit at its age as a rectangular distribution."""
        zero = Component("zero", Shared.ZEROING, known_or(readings.zero_nm, self.zero_nm))
        if self.drift_nm_per_h is None:
            return (zero,)
        limit = self.drift_nm_per_h * known_or(readings.zero_age_h, self.interval_h)
        return (
            zero,
            Component(
                "zero drift",
                Shared.ZEROING,
                limit / sqrt(3.0),
                distribution=Distribution.RECTANGULAR,
            ),
        )
