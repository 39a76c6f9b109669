"""The last commands to the bench, shared by everything that commands or checks it."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import Literal

from torquebench.bench.roles import Side

__all__ = ["CommandState", "Quantity", "SetPoint", "SideCommands"]

Quantity = Literal["torque", "speed"]


@dataclass(frozen=True)
class SetPoint:
    """A drive's commanded torque or speed, and its ramp.

    Parameters
    ----------
    value : float
        N·m or rad/s.
    rate : float
        Of the drive's ramp, N·m/s or rad/s².
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
        """Ramp time to zero if it is unknown whether the drive got the command, s; else 0."""
        return 0.0 if math.isfinite(self.told_s) else abs(self.value) / self.rate


@dataclass
class SideCommands:
    """Last commands to one drive.

    Parameters
    ----------
    enabled : bool
        Whether the drive was enabled, and neither disabled since nor by the supervisor.
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
        The last one of each quantity, from the time of its command on.
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

    def value(self, quantity: Quantity) -> float:
        """Return the last commanded torque or speed, N·m or rad/s."""
        return self.torque_nm if quantity == "torque" else self.speed_rad_s

    @property
    def uncertain_s(self) -> float:
        """Ramp time to zero if it is unknown whether the drive got a command, s; else 0."""
        return max(point.uncertain_s for point in self.set_points.values())

    def ask(self, quantity: Quantity, value: float, rate: float, time_s: float) -> SetPoint:
        """Record that the command is about to be given."""
        asked = SetPoint(value, rate, asked_s=time_s, told_s=math.inf)
        self.set_points[quantity] = asked
        self.controls = quantity
        return asked

    def told(self, quantity: Quantity, asked: SetPoint, time_s: float) -> SetPoint:
        """Record that the command was given, unless another one followed; return it."""
        told = replace(asked, told_s=time_s)
        if self.set_points[quantity] is asked:
            if quantity == "torque":
                self.torque_nm = asked.value
            else:
                self.speed_rad_s = asked.value
            self.changed_s = time_s
            self.set_points[quantity] = told
        return told

    def on(self) -> None:
        """Note that the drive has power, at zero torque."""
        self.controls = "torque"
        self.enabled_wall_s = time.monotonic()
        self.enabled = True

    def withdraw(
        self, quantity: Quantity, asked: SetPoint, before: tuple[Quantity, SetPoint]
    ) -> None:
        """Record that a command was refused: the controlled quantity and set point before hold."""
        if self.set_points[quantity] is asked:
            self.controls, self.set_points[quantity] = before

    def ask_zero(self, time_s: float, ramp_s: float) -> SetPoint:
        """Note that the drive is about to be commanded to go to zero, and within which time."""
        self.torque_nm = self.speed_rad_s = 0.0
        self.changed_s = time_s
        asked = SetPoint(within_s=ramp_s, asked_s=time_s, told_s=math.inf)
        self.set_points["torque"] = self.set_points["speed"] = asked
        return asked

    def told_zero(self, asked: SetPoint, time_s: float) -> None:
        """Record that the command was given, except where another one followed."""
        for quantity, point in self.set_points.items():
            if point is asked:
                self.set_points[quantity] = replace(asked, told_s=time_s)

    def at_zero(self, time_s: float) -> None:
        """Note that the drive is at zero torque and speed."""
        self.told_zero(self.ask_zero(time_s, 0.0), time_s)

    def off(self, time_s: float) -> None:
        """Note that the drive has no power."""
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
