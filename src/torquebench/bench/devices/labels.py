"""The stamp that states the series and the point to which an event belongs."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass

from bluesky.protocols import HasHints, Hints, Reading
from event_model import DataKey
from ophyd_async.core import AsyncReadable, AsyncStatus, Device

from torquebench.bench.devices.data_keys import data_key


@dataclass(frozen=True)
class Point:
    """Position of a point in a procedure.

    Parameters
    ----------
    series, step : int
        Number of the series, and of the step within it.
    branch : int
        +1 if |torque| grows, −1 if it falls, 0 if neither applies.
    nominal_nm : float
        Nominal torque of the step, N·m.
    position_deg : float
        Rotation of the standard in its seat, degrees.
    group : int
        Number of the repetition (verification group, friction repeat).
    """

    series: int = 0
    step: int = 0
    branch: int = 0
    nominal_nm: float = 0.0
    position_deg: float = 0.0
    group: int = 0


class PointLabel(Device, AsyncReadable, HasHints):
    """Device that adds the present `Point` to every event that reads it.

    `bps.abs_set(devices.point, Point(series=1, step=3, branch=1, nominal_nm=120.0))`, then read
    it together with the steady value. Data keys are `<name>-series` and so on (`key`).
    """

    def __init__(self, name: str = "point") -> None:
        self._point = Point()
        self._time_s = time.time()
        super().__init__(name=name)

    def key(self, field: str) -> str:
        """Return the event data key of a field of `Point`.

        Examples
        --------
        >>> PointLabel().key("series")
        'point-series'
        """
        return f"{self.name}-{field}"

    @AsyncStatus.wrap
    async def set(self, value: Point) -> None:
        """Stamp the following events with this point."""
        self._point = value
        self._time_s = time.time()

    async def read(self) -> dict[str, Reading]:
        """Return the stamp."""
        return {
            self.key(field): Reading(value=value, timestamp=self._time_s)
            for field, value in asdict(self._point).items()
        }

    async def describe(self) -> dict[str, DataKey]:
        """Describe the stamp's fields."""
        return {
            self.key(field): data_key(f"plan://{field}", field, type(value))
            for field, value in asdict(Point()).items()
        }

    @property
    def hints(self) -> Hints:
        """Fields that are worth plotting."""
        return {"fields": [self.key("nominal_nm")]}
