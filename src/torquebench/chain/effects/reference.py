"""The reference standard of the calibration."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import FloatArray, Readings
from torquebench.chain.torque import Component, Shared

__all__ = ["Reference"]


@register("reference standard")
@dataclass(frozen=True)
class Reference(Effect):
    """Error of the reference standard, which all torques of the calibration have in common.

    Parameters
    ----------
    expanded_uncertainty_nm : float
        U (k = 2) that its certificate states in N·m: a share of its range.
    from_nm : float
        Smallest certified torque. The standard is zeroed, so that below it the uncertainty falls
        in proportion to the torque.
    expanded_uncertainty_of_torque : float
        U (k = 2) as a share of the torque, where the certificate states it so.
    """

    title: ClassVar[str] = "reference standard"
    expanded_uncertainty_nm: float = field(default=0.0, metadata={"least": 0.0})
    from_nm: float = field(default=0.0, metadata={"least": 0.0})
    expanded_uncertainty_of_torque: float = field(default=0.0, metadata={"least": 0.0})

    def components(self, readings: Readings, torque_nm: FloatArray) -> tuple[Component, ...]:
        """Return half of U; a span error affects both directions of torque."""
        size = np.abs(torque_nm)
        certified = np.minimum(size / self.from_nm, 1.0) if self.from_nm > 0.0 else 1.0
        fixed = self.expanded_uncertainty_nm * certified
        half = 0.5 * np.hypot(fixed, self.expanded_uncertainty_of_torque * size)
        return (Component("reference standard", Shared.CALIBRATION, np.copysign(half, torque_nm)),)
