"""The reference standard of the calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import sqrt
from typing import Any, ClassVar, Self

from torquebench.chain.corrections import standard
from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import FloatArray, Readings
from torquebench.chain.torque import Component, Shared
from torquebench.uncertainty import CertifiedUncertainty, Distribution

__all__ = ["Reference"]


@register("reference standard")
@dataclass(frozen=True)
class Reference(Effect):
    """Error of the reference standard, which all torques of the calibration have in common.

    Parameters
    ----------
    certified : CertifiedUncertainty
        U (k = 2) over the torque, as its certificate states it.
    temperature_of_torque : float, optional
        Limit by which its span may have changed because it had another temperature in the
        calibration than in its own, as a share of the torque; None if it isn't known, and then it
        isn't in U.
    drift_of_torque : float, optional
        Limit of the drift of its span since its own calibration, likewise.
    """

    title: ClassVar[str] = "reference standard"
    LIMITS: ClassVar = {
        "temperature_of_torque": "temperature of standard",
        "drift_of_torque": "drift of standard",
    }
    """Fields with limits as a share of the torque, and their components."""
    certified: CertifiedUncertainty
    temperature_of_torque: float | None = field(default=None, metadata={"least": 0.0})
    drift_of_torque: float | None = field(default=None, metadata={"least": 0.0})

    def gaps(self) -> tuple[str, ...]:
        """Name temperature or drift if no limit of it is known."""
        return tuple(name for each, name in self.LIMITS.items() if getattr(self, each) is None)

    def components(self, readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        """Return half of U, and the limits; a span error affects both directions of torque."""
        half = standard(torque_nm, *self.certified.directions)
        limits = ((name, getattr(self, each)) for each, name in self.LIMITS.items())
        return (
            Component("reference standard", Shared.CALIBRATION, half),
            *(
                Component(
                    name,
                    Shared.CALIBRATION,
                    share / sqrt(3.0) * torque_nm,
                    distribution=Distribution.RECTANGULAR,
                )
                for name, share in limits
                if share
            ),
        )

    def larger(self, other: Reference) -> Reference:
        """Return the effect of two standards whose points are fitted together."""
        records = dict.fromkeys([*self.record.split("; "), *other.record.split("; ")])
        pairs = {each: (getattr(self, each), getattr(other, each)) for each in self.LIMITS}
        limits = {each: None if None in pair else max(pair) for each, pair in pairs.items()}
        return Reference("; ".join(records), self.certified.larger(other.certified), **limits)

    def specification(self) -> dict[str, Any]:
        """Return kind and fields as JSON-ready values."""
        return {
            "kind": self.kind,
            "record": self.record,
            "torque_nm": list(self.certified.torque_nm),
            "expanded_uncertainty_nm": list(self.certified.expanded_nm),
            **{each: getattr(self, each) for each in self.LIMITS},
        }

    @classmethod
    def from_specification(cls, values: Mapping[str, Any]) -> Self:
        """Return the effect that `specification` described."""
        others = dict(values)
        torque, expanded = others.pop("torque_nm", ()), others.pop("expanded_uncertainty_nm", ())
        certified = CertifiedUncertainty(tuple(torque), tuple(expanded))
        return cls(certified=certified, **others)
