"""Set points that this computer steps to their targets, for drives that don't ramp."""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from torquebench.bench.drivers.base import DriveLimits, DriveState
from torquebench.bench.drivers.links import Link, check_drive_order
from torquebench.errors import BenchError
from torquebench.message import Message

PERIOD_S = 0.01
LONGEST_STEP_S = 0.02
"""A computer that stood for longer continues its ramp later, instead of jumping ahead."""


class Stepper:
    """A set point on its way to a target at a rate, written every 10 ms by a thread of its own.

    While the watchdog isn't fed, it stays where it is: the drive's watchdog acts.
    """

    def __init__(self, watchdog_s: float) -> None:
        self._watchdog_s = watchdog_s
        self._lock = threading.Lock()
        self._write: Callable[[float], None] | None = None
        self._present = self._target = self._rate = 0.0
        self._fed_s = -math.inf
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        self._failure: BenchError | None = None

    def go(
        self, write: Callable[[float], None], present: float, target: float, rate: float
    ) -> None:
        """Step from the present set point to a target; `write` commands a set point."""
        with self._lock:
            self._write, self._present, self._target, self._rate = write, present, target, rate
        if self._thread is None and not self._ending.is_set():
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Write nothing until the next target."""
        with self._lock:
            self._write = None

    def feed(self) -> None:
        """Allow steps for the watchdog's time."""
        self._fed_s = time.monotonic()

    def check(self) -> None:
        """Raise the failure of the last step, once."""
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _run(self) -> None:
        """Move the set point in steps until stopped; hold it when the watchdog wasn't fed."""
        before_s = time.monotonic()
        while not self._ending.wait(PERIOD_S):
            now_s = time.monotonic()
            passed_s, before_s = min(now_s - before_s, LONGEST_STEP_S), now_s
            if now_s - self._fed_s > self._watchdog_s:
                continue
            try:
                self._step(passed_s)
            except BenchError as error:
                self._failure = error
                self.stop()

    def _step(self, passed_s: float) -> None:
        """Write the next set point on the ramp from the present one to the target."""
        with self._lock:
            if self._write is None or self._present == self._target:
                return
            left = self._target - self._present
            step = math.copysign(min(abs(left), self._rate * passed_s), left)
            self._present = self._target if step == left else self._present + step
            self._write(self._present)

    def close(self) -> None:
        """End the thread. A second call does nothing."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join()


class SteppedDrive(ABC):
    """A drive whose torque or speed this computer steps, by a thread of its own.

    Set point, controlled quantity and power change under one lock, so that the threads that feed
    and step never send the value of one quantity as the other, nor anything after a stop.

    Parameters
    ----------
    limits : DriveLimits
        Largest set points.
    stepped_s : float
        Time without feeding after which the set point stays where it is, s.
    """

    def __init__(self, link: Link[Any], limits: DriveLimits, stepped_s: float) -> None:
        self._name, self._closes = link.name, link.close
        self._limits = limits
        self._sending = threading.RLock()
        self._set_point = 0.0  # N·m or rad/s
        self._speed_control = self._on = False
        self._stepper = Stepper(stepped_s)

    @abstractmethod
    def state(self) -> DriveState:
        """Request the active set point and the fault state."""

    @abstractmethod
    def _command(self) -> None:
        """Send the present set point of the controlled quantity; the lock is held."""

    @abstractmethod
    def _switch_off(self) -> None:
        """Send the stop; the lock is held."""

    def limits(self) -> DriveLimits:
        """Return the described limits."""
        return self._limits

    def disable(self) -> None:
        """Switch off the motor's power, after which no set point is sent."""
        self._stepper.stop()
        with self._sending:
            self._on = False
            self._switch_off()

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        """Step to a torque at a limited rate and keep it."""
        check_drive_order(self._name, torque_nm, ramp_nm_per_s, self._limits.torque_nm, "N·m")
        self._step(torque_nm, ramp_nm_per_s, speed=False)

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        """Step to a speed at a limited rate and keep it."""
        most = self._limits.speed_rad_s
        check_drive_order(self._name, speed_rad_s, ramp_rad_per_s2, most, "rad/s")
        self._step(speed_rad_s, ramp_rad_per_s2, speed=True)

    def ramp_to_zero(self, duration_s: float) -> None:
        """Step torque or speed to zero; a controller that refuses is switched off."""
        rate = max(abs(self._set_point) / max(duration_s, 1e-3), 1e-9)
        try:
            self._step(0.0, rate, speed=self._speed_control)
        except BenchError:
            self.disable()

    def feed_watchdog(self) -> None:
        """Repeat the present set point, if the drive is on."""
        self._stepper.feed()
        self._send()

    def _step(self, target: float, rate: float, *, speed: bool) -> None:
        """Ramp a torque or speed to a target at a rate; control of the other quantity ends."""
        if not self.state().enabled:
            raise BenchError(
                Message("{name} is off", self._name),
                "commands to an enabled drive",
                "enable it first",
            )
        self._stepper.stop()
        if speed != self._speed_control:
            self._control(speed=speed)
        self._stepper.go(self._send, self._set_point, target, rate)

    def _control(self, *, speed: bool) -> None:
        """Change what is controlled, beginning at a set point of zero."""
        with self._sending:
            self._speed_control, self._set_point = speed, 0.0

    def _send(self, set_point: float | None = None) -> None:
        """Send a set point, by default the present one, if the drive is on."""
        with self._sending:
            if set_point is not None:
                self._set_point = set_point
            if self._on:
                self._command()

    def close(self) -> None:
        """Release the drive. A second call does nothing."""
        self._stepper.close()
        self._closes()
