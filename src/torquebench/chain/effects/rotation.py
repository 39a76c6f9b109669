"""Rotation: zero over speed, and drag of the bearings between transducer and flange."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import sqrt
from typing import ClassVar

import numpy as np

from torquebench.chain.effect import Effect, register
from torquebench.chain.readings import Readings, known_or
from torquebench.chain.torque import Component
from torquebench.elementwise import Values
from torquebench.uncertainty import Distribution, Shared

STANDSTILL_RPM = 0.5
"""Largest speed that counts as standstill: it is noise of the encoder.

`SafetyDescription.at_standstill` decides whether a side of the bench is at standstill.
"""


@register("rotation")
@dataclass(frozen=True)
class Rotation(Effect):
    """Effect of rotation on a chain that was calibrated and zeroed at standstill.

    The zero's shift is equal in both directions, and the drag reverses with the speed; the signs of
    their components show this. An empty run measures their sum.

    Parameters
    ----------
    zero_nm_per_1000rpm : float
        Limit of the zero's shift, N·m per 1000 rpm.
    drag_nm : float
        Limit of the drag of bearings between transducer and flange, N·m.
    largest_rpm : float
        Largest speed of the bench, 1/min, used if none is measured.
    """

    title: ClassVar[str] = "rotation"
    needs: ClassVar[tuple[str, ...]] = ("speed_rpm",)
    zero_nm_per_1000rpm: float = field(metadata={"least": 0.0})
    drag_nm: float = field(metadata={"least": 0.0})
    largest_rpm: float = field(default=0.0, metadata={"least": 0.0})

    def components(self, readings: Readings, torque_nm: Values) -> tuple[Component, ...]:
        """Return the zero's shift and the drag at the speed of each reading."""
        speed = known_or(readings.speed_rpm, self.largest_rpm)
        turning = np.where(np.abs(speed) > STANDSTILL_RPM, speed, 0.0)
        shift = self.zero_nm_per_1000rpm * np.abs(turning) / 1000.0
        return (
            Component(
                "zero over speed",
                Shared.CALIBRATION,
                shift / sqrt(3.0),
                distribution=Distribution.RECTANGULAR,
            ),
            Component(
                "bearing drag",
                Shared.MOUNTING,
                self.drag_nm / sqrt(3.0) * np.sign(turning),
                distribution=Distribution.RECTANGULAR,
            ),
        )
