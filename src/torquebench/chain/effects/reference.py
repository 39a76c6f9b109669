"""The reference standard of the calibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import sqrt
from typing import Any, ClassVar, Self

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import Readings
from torquebench.chain.torque import Component
from torquebench.elementwise import Values, functions_for
from torquebench.uncertainty import CertifiedUncertainty, Distribution, Shared


@register("reference standard")
@dataclass(frozen=True)
class Reference(Effect):
    """Error of the reference standard, which is common to all torques of the calibration.

    Parameters
    ----------
    certified : CertifiedUncertainty
        U (k = 2) over the torque, as its certificate states it.
    temperature_of_torque : float, optional
        Limit of the change of its span because its temperature differed from that of its own
        calibration, as a share of the torque; None if unknown, and then not in U.
    drift_of_torque : float, optional
        Limit of the drift of its span since its own calibration, as above.
    """

    title: ClassVar[str] = "reference standard"
    LIMITS: ClassVar = {
        "temperature_of_torque": "temperature of standard",
        "drift_of_torque": "drift of standard",
    }
    """Fields with limits as a share of the torque, and the components that belong to them."""
    certified: CertifiedUncertainty
    temperature_of_torque: float | None = field(default=None, metadata={"least": 0.0})
    drift_of_torque: float | None = field(default=None, metadata={"least": 0.0})

    def gaps(self) -> tuple[str, ...]:
        """Name temperature and drift, as far as their limits are unknown."""
        return tuple(
            name for attribute, name in self.LIMITS.items() if getattr(self, attribute) is None
        )

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return half of U, and the limits; an error of the span affects both directions."""
        half = functions_for(torque_nm).copysign(0.5 * self.certified.at(torque_nm), torque_nm)
        parts = [Component("reference standard", Shared.CALIBRATION, half)]
        for limit, name in self.LIMITS.items():
            if share := getattr(self, limit):
                u = share / sqrt(3.0) * torque_nm
                parts.append(
                    Component(name, Shared.CALIBRATION, u, distribution=Distribution.RECTANGULAR)
                )
        return tuple(parts)

    def larger(self, other: Reference) -> Reference:
        """Return the effect for points of two standards: the larger uncertainties count."""
        records = dict.fromkeys([*self.record.split("; "), *other.record.split("; ")])
        pairs = {limit: (getattr(self, limit), getattr(other, limit)) for limit in self.LIMITS}
        limits = {limit: None if None in pair else max(pair) for limit, pair in pairs.items()}
        return Reference("; ".join(records), self.certified.larger(other.certified), **limits)

    def specification(self) -> dict[str, Any]:
        """Return kind and fields as JSON-ready values."""
        return {
            "kind": self.kind,
            "record": self.record,
            "torque_nm": list(self.certified.torque_nm),
            "expanded_uncertainty_nm": list(self.certified.expanded_nm),
            **{limit: getattr(self, limit) for limit in self.LIMITS},
        }

    @classmethod
    def from_specification(cls, values: Mapping[str, Any]) -> Self:
        """Rebuild the effect from its `specification`."""
        others = dict(values)
        torque, expanded = others.pop("torque_nm", ()), others.pop("expanded_uncertainty_nm", ())
        certified = CertifiedUncertainty(tuple(torque), tuple(expanded))
        return cls(certified=certified, **others)
