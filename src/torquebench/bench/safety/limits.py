"""Limits in force: those of the bench description, and narrower limits of a step."""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace

from torquebench.bench.description import BenchDescription
from torquebench.bench.roles import SIDES, Side
from torquebench.bench.safety.alarms import AlarmLevel


@dataclass(frozen=True)
class StepLimits:
    """Limits of one step of a procedure on one side; None keeps the bench's limit.

    Parameters
    ----------
    side : {"input", "output"}
    torque_nm, speed_rpm, temperature_c : float, optional
        Magnitudes.
    angle_deg : float, optional
        Largest angle from the position at the beginning of the step, degrees.
    torque_rate_nm_per_s, speed_rate_rpm_per_s : float, optional
        Largest changes of torque and speed per second.
    """

    side: Side
    torque_nm: float | None = None
    speed_rpm: float | None = None
    temperature_c: float | None = None
    angle_deg: float | None = None
    torque_rate_nm_per_s: float | None = None
    speed_rate_rpm_per_s: float | None = None


@dataclass(frozen=True)
class SideLimits:
    """Limits in force on one side, with the fields of `StepLimits`; infinity for no limit."""

    torque_nm: float
    speed_rpm: float
    temperature_c: float
    angle_deg: float = math.inf
    torque_rate_nm_per_s: float = math.inf
    speed_rate_rpm_per_s: float = math.inf


def tightened(limits: SideLimits, step: StepLimits) -> SideLimits:
    """Return the limits narrowed by those of a step; none becomes wider.

    Examples
    --------
    >>> wide = SideLimits(torque_nm=2400.0, speed_rpm=20.0, temperature_c=60.0)
    >>> narrow = tightened(wide, StepLimits("output", torque_nm=2100.0, speed_rpm=50.0))
    >>> narrow.torque_nm, narrow.speed_rpm
    (2100.0, 20.0)
    """
    changed = {
        name: min(getattr(limits, name), value)
        for name in (field.name for field in fields(SideLimits))
        if (value := getattr(step, name)) is not None
    }
    return replace(limits, **changed)


class LimitBook:
    """Limits in force on each side; thread-safe."""

    def __init__(self, description: BenchDescription) -> None:
        self._lock = threading.Lock()
        self._steps: dict[int, StepLimits] = {}
        self._number = 0
        self._own: dict[Side, SideLimits] = {}
        for side in SIDES:
            limits = description.module(side).limits.model_dump(exclude_none=True)
            self._own[side] = SideLimits(**limits)
        self._present = dict(self._own)
        self.angle_changes = dict.fromkeys(SIDES, 0)
        """Number of new angle limits of each side; after each new limit, the angle is counted from
        0 again."""

    def side(self, side: Side) -> SideLimits:
        """Limits in force on a side."""
        return self._present[side]

    def tighten(self, *steps: StepLimits) -> tuple[int, ...]:
        """Add narrower limits; return their keys for `loosen`."""
        with self._lock:
            numbers = []
            for step in steps:
                self._number += 1
                self._steps[self._number] = step
                numbers.append(self._number)
                if step.angle_deg is not None:
                    self.angle_changes[step.side] += 1
            self._combine()
            return tuple(numbers)

    def loosen(self, numbers: tuple[int, ...] | None = None) -> None:
        """Remove narrower limits; without numbers, all of them."""
        with self._lock:
            for number in tuple(self._steps) if numbers is None else numbers:
                self._steps.pop(number, None)
            self._combine()

    def _combine(self) -> None:
        """Compute the present limits from the bench's own and those of all steps."""
        present = dict(self._own)
        for step in self._steps.values():
            present[step.side] = tightened(present[step.side], step)
        self._present = present

    @contextmanager
    def within(self, *steps: StepLimits) -> Iterator[None]:
        """Apply narrower limits within a `with` block."""
        numbers = self.tighten(*steps)
        try:
            yield
        finally:
            self.loosen(numbers)


@dataclass
class Watch:
    """Alarm level of one monitored quantity, with hysteresis.

    Parameters
    ----------
    level : AlarmLevel or None
        Level of the alarm; None within the limits.
    number : int
        Number of the warning in the book of alarms, 0 without one.
    """

    level: AlarmLevel | None = None
    number: int = 0

    def judge(self, value: float, limit: float, warning: float, hysteresis: float) -> bool:
        """Evaluate a new value; return whether the level changed.

        The level falls only when the value is below its threshold by the hysteresis. NaN doesn't
        change it: a missing signal is checked elsewhere.

        Examples
        --------
        >>> watch = Watch()
        >>> levels = []
        >>> for torque_nm in (90.0, 96.0, 94.5, 92.0, 101.0, 99.0, 97.5):
        ...     changed = watch.judge(torque_nm, limit=100.0, warning=95.0, hysteresis=2.0)
        ...     levels.append(watch.level.name if watch.level else "none")
        >>> levels
        ['none', 'WARNING', 'WARNING', 'none', 'CRITICAL', 'CRITICAL', 'WARNING']
        """
        before = self.level
        critical = limit - (hysteresis if before is AlarmLevel.CRITICAL else 0.0)
        warned = warning - (hysteresis if before is not None else 0.0)
        if value > critical:
            self.level = AlarmLevel.CRITICAL
        elif value > warned:
            self.level = AlarmLevel.WARNING
        elif value <= warned:
            self.level = None
        return self.level is not before
