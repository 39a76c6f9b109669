"""A motor with ramps and a watchdog, by the wall's clock."""

import math
import threading
import time


class Ramp:
    """A set point that goes to its target at a rate."""

    def __init__(self) -> None:
        self._from = self.target = 0.0
        self._rate = math.inf
        self._since = 0.0

    @property
    def present(self) -> float:
        reach = self._rate * (time.monotonic() - self._since)
        distance = self.target - self._from
        return (
            self.target if abs(distance) <= reach else self._from + math.copysign(reach, distance)
        )

    def go(self, target: float, rate: float) -> None:
        self._from, self._since = self.present, time.monotonic()
        self.target, self._rate = target, rate

    def zero(self, within_s: float) -> None:
        present = self.present
        self.go(0.0, abs(present) / within_s if within_s > 0.0 and present else math.inf)


class Motor:
    """Torque and speed of one drive; `look` first, so that its watchdog has acted."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self.on = False
        self.tripped = False
        self.watchdog_s = 0.0
        self.torque, self.speed = Ramp(), Ramp()
        self.largest_torque = 0.0
        self._fed = 0.0

    def feed(self) -> None:
        self.look()
        self._fed = time.monotonic()

    def starve(self, duration_s: float) -> None:
        """Behave as if it had last been fed so much earlier."""
        self._fed -= duration_s

    def power(self, on: bool) -> None:
        self.look()
        if on and not self.tripped and not self.on:
            self._fed = time.monotonic()
            self.on = True
        elif not on:
            self.on = False
            self.torque, self.speed = Ramp(), Ramp()

    def reset(self) -> None:
        self.power(False)
        self.tripped = False

    def look(self) -> None:
        self.largest_torque = max(self.largest_torque, abs(self.torque.present))
        if self.on and self.watchdog_s and time.monotonic() - self._fed > self.watchdog_s:
            self.power_lost()

    def power_lost(self) -> None:
        self.on, self.tripped = False, True
        self.torque, self.speed = Ramp(), Ramp()

    @property
    def ramping(self) -> bool:
        return any(ramp.present != ramp.target for ramp in (self.torque, self.speed))
