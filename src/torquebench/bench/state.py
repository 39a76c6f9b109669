"""The last commands to the bench, shared by all parts that command or check it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import Literal

from torquebench.bench.roles import Side

Quantity = Literal["torque", "speed"]


@dataclass(frozen=True)
class SetPoint:
    """A drive's commanded torque or speed, and its ramp.

    Parameters
    ----------
    value : float
        N·m or rad/s.
    rate : float
        Rate of the drive's ramp, N·m/s or rad/s².
    within_s : float
        Shortest duration of the ramp, s of bench time.
    asked_s, told_s : float
        Bench time before and after the command; infinity until it was given.
    """

    value: float = 0.0
    rate: float = math.inf
    within_s: float = 0.0
    asked_s: float = 0.0
    told_s: float = 0.0

    @property
    def uncertain_s(self) -> float:
        """Ramp time to zero while it is unknown whether the command arrived, s; else 0."""
        return 0.0 if math.isfinite(self.told_s) else abs(self.value) / self.rate


@dataclass(frozen=True)
class Turned:
    """Angle by which a drive has turned, calculated from its speed commands and their ramps.

    Parameters
    ----------
    angle_rad : float
        Angle if each command takes effect when the drive has received it.
    uncertain_rad : float
        Largest deviation from this angle, because each command takes effect at some moment while it
        is being given.
    time_s, speed_rad_s : float
        Time for which the angle is valid, and the speed at that time.
    target_rad_s, rate : float
        Target and rate of the present ramp, rad/s and rad/s².
    late_s : float
        Time by which this ramp may be earlier.
    """

    angle_rad: float = 0.0
    uncertain_rad: float = 0.0
    time_s: float = 0.0
    speed_rad_s: float = 0.0
    target_rad_s: float = 0.0
    rate: float = math.inf
    late_s: float = 0.0

    def until(self, time_s: float) -> Turned:
        """Advance to a later time."""
        lasts_s = max(0.0, time_s - self.time_s)
        distance = self.target_rad_s - self.speed_rad_s
        whole_s = abs(distance) / self.rate if distance else 0.0
        ramp_s = min(lasts_s, whole_s)
        speed = self.speed_rad_s + distance * (ramp_s / whole_s if whole_s else 1.0)
        angle = self.angle_rad + 0.5 * (self.speed_rad_s + speed) * ramp_s
        angle += self.target_rad_s * (lasts_s - ramp_s)
        return replace(self, angle_rad=angle, time_s=self.time_s + lasts_s, speed_rad_s=speed)

    def commanded(self, point: SetPoint) -> Turned:
        """Advance to the time of a command, and follow this command from then on."""
        before, late_s = self.until(point.told_s), point.told_s - point.asked_s
        if before.speed_rad_s != before.target_rad_s:  # the ramp continues from its present value
            late_s = max(late_s, self.late_s)
        distance = abs(point.value - before.speed_rad_s)
        return replace(
            before,
            uncertain_rad=before.uncertain_rad + abs(point.value - before.target_rad_s) * late_s,
            target_rad_s=point.value,
            rate=min(point.rate, distance / point.within_s if point.within_s else math.inf),
            late_s=late_s,
        )


@dataclass
class SideCommands:
    """Last commands to one drive.

    Parameters
    ----------
    enabled : bool
        Whether the drive was enabled and hasn't been disabled since, not even by the supervisor.
    torque_nm, speed_rad_s : float
        Set points.
    changed_s : float
        Bench time of the last change of a set point.
    enabled_wall_s : float
        Monotonic wall time at which the drive was enabled: earlier states don't count.
    switching : bool
        Whether the drive is being switched on: it may have power already.
    controls : {"torque", "speed"}
        Quantity of the last command; a shaft that a mounted standard holds keeps its torque while
        its speed changes.
    set_points : dict of str to SetPoint
        The last set point of each quantity, from the time of its command on.
    turned : Turned
        Angle by all speed commands so far.
    """

    enabled: bool = False
    torque_nm: float = 0.0
    speed_rad_s: float = 0.0
    changed_s: float = 0.0
    enabled_wall_s: float = 0.0
    switching: bool = False
    controls: Quantity = "torque"
    set_points: dict[Quantity, SetPoint] = field(
        default_factory=lambda: {"torque": SetPoint(), "speed": SetPoint()}
    )
    turned: Turned = field(default_factory=Turned)

    def value(self, quantity: Quantity) -> float:
        """Return the last commanded torque or speed, N·m or rad/s."""
        return self.torque_nm if quantity == "torque" else self.speed_rad_s

    @property
    def uncertain_s(self) -> float:
        """Ramp time to zero while it is unknown whether the drive received a command, s; else 0."""
        return max(point.uncertain_s for point in self.set_points.values())

    def ask(self, quantity: Quantity, value: float, rate: float, time_s: float) -> SetPoint:
        """Record that a command is about to be given."""
        requested = SetPoint(value, rate, asked_s=time_s, told_s=math.inf)
        self.set_points[quantity] = requested
        self.controls = quantity
        return requested

    def told(self, quantity: Quantity, requested: SetPoint, time_s: float) -> SetPoint:
        """Record that the command was given, unless another one followed; return it."""
        confirmed = replace(requested, told_s=time_s)
        if self.set_points[quantity] is requested:
            if quantity == "torque":
                self.torque_nm = requested.value
            else:
                self.speed_rad_s = requested.value
                self.turned = self.turned.commanded(confirmed)
            self.changed_s = time_s
            self.set_points[quantity] = confirmed
        return confirmed

    def on(self) -> None:
        """Record that the drive has power, at zero torque."""
        self.controls = "torque"
        self.enabled_wall_s = time.monotonic()
        self.enabled = True

    def withdraw(
        self, quantity: Quantity, requested: SetPoint, before: tuple[Quantity, SetPoint]
    ) -> None:
        """Record that a command was refused: the earlier quantity and set point stay in force."""
        if self.set_points[quantity] is requested:
            self.controls, self.set_points[quantity] = before

    def ask_zero(self, time_s: float, ramp_s: float) -> SetPoint:
        """Record that the drive is about to be commanded to zero, within a ramp's time."""
        self.torque_nm = self.speed_rad_s = 0.0
        self.changed_s = time_s
        requested = SetPoint(within_s=ramp_s, asked_s=time_s, told_s=math.inf)
        self.set_points["torque"] = self.set_points["speed"] = requested
        return requested

    def told_zero(self, requested: SetPoint, time_s: float) -> None:
        """Note when the drive got the set point 0, unless another set point followed it."""
        confirmed = replace(requested, told_s=time_s)
        for quantity, point in self.set_points.items():
            if point is requested:
                self.set_points[quantity] = confirmed
                if quantity == "speed":
                    self.turned = self.turned.commanded(confirmed)

    def at_zero(self, time_s: float) -> None:
        """Record that the drive is at zero torque and speed."""
        self.told_zero(self.ask_zero(time_s, 0.0), time_s)

    def off(self, time_s: float) -> None:
        """Record that the drive has no power."""
        self.at_zero(time_s)
        self.enabled = False


@dataclass
class CommandState:
    """Last commands to both drives."""

    input: SideCommands = field(default_factory=SideCommands)
    output: SideCommands = field(default_factory=SideCommands)

    def side(self, side: Side) -> SideCommands:
        """Commands of one side."""
        return self.input if side == "input" else self.output

    @property
    def any_enabled(self) -> bool:
        """Whether a drive has power."""
        return self.input.enabled or self.output.enabled

    @property
    def any_powered(self) -> bool:
        """Whether a drive has power, or may have it because it is being switched on."""
        return self.any_enabled or self.input.switching or self.output.switching
