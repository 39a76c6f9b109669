"""What the bench was last told, shared by everything that commands or judges it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from torquebench.bench.roles import SIDES, Side

__all__ = ["CommandState", "SideCommands"]


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
        Monotonic wall time at which the drive was enabled: what it said before doesn't count.
    """

    enabled: bool = False
    torque_nm: float = 0.0
    speed_rad_s: float = 0.0
    changed_s: float = 0.0
    enabled_wall_s: float = 0.0

    def on(self) -> None:
        """Note that the drive has power."""
        self.enabled_wall_s = time.monotonic()
        self.enabled = True

    def at_zero(self, time_s: float) -> None:
        """Note that torque and speed were told to go to zero."""
        self.torque_nm = self.speed_rad_s = 0.0
        self.changed_s = time_s

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
        return any(self.side(side).enabled for side in SIDES)
