"""A motor with ramps and a watchdog, by the wall's clock."""

import math
import threading
import time


class Ramp:
    """A set point that goes to its target at a rate."""

    def __init__(self) -> None:
        self._from = self.target = 0.0
        self._rate = math.inf
        self._since = time.monotonic()
        self._covered = 0.0

    @property
    def present(self) -> float:
        reach = self._rate * (time.monotonic() - self._since)
        distance = self.target - self._from
        return (
            self.target if abs(distance) <= reach else self._from + math.copysign(reach, distance)
        )

    @property
    def covered(self) -> float:
        """Integral of the set point over the time since it was 0 and at rest."""
        elapsed, distance = time.monotonic() - self._since, self.target - self._from
        ramp_s = min(elapsed, abs(distance) / self._rate if distance else 0.0)
        reached = self._from + math.copysign(min(self._rate * ramp_s, abs(distance)), distance)
        ramped = 0.5 * (self._from + reached) * ramp_s if ramp_s else 0.0
        return self._covered + ramped + self.target * (elapsed - ramp_s)

    def go(self, target: float, rate: float) -> None:
        self._covered = self.covered
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
        self._turned = 0.0

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
            self._stop()

    def reset(self) -> None:
        self.power(False)
        self.tripped = False

    def look(self) -> None:
        self.largest_torque = max(self.largest_torque, abs(self.torque.present))
        if self.on and self.watchdog_s and time.monotonic() - self._fed > self.watchdog_s:
            self.power_lost()

    def power_lost(self) -> None:
        self.on, self.tripped = False, True
        self._stop()

    def _stop(self) -> None:
        self._turned = self.angle_rad
        self.torque, self.speed = Ramp(), Ramp()

    @property
    def angle_rad(self) -> float:
        """Angle since it was made."""
        return self._turned + self.speed.covered

    @property
    def ramping(self) -> bool:
        return any(ramp.present != ramp.target for ramp in (self.torque, self.speed))
