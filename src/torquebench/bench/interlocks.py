"""What the bench's state forbids, whatever a procedure asks for."""

from __future__ import annotations

from typing import Literal

from torquebench.bench.drivers.base import Mode, Mounting, Side

__all__ = ["Interlocks"]


class Interlocks:
    """Refuses operations that the bench's present state forbids.

    Every method returns when the operation is allowed and raises `InterlockError` (state) or
    `LimitError` (value) otherwise, with what was found, what is allowed and what to do.
    """

    enabled: dict[Side, bool]

    def check_torque(self, side: Side, torque_nm: float) -> None:
        """Torque needs a closed clamp, a driven side, an enabled drive, no alarm, no excess."""

    def check_speed(self, side: Side, speed_rad_s: float) -> None:
        """Speed needs a driven side, an enabled drive, no alarm and no excess."""

    def check_enable(self, side: Side) -> None:
        """A drive is not enabled while an alarm is latched."""

    def check_unloaded(self, side: Side, purpose: str) -> None:
        """The side carries no torque and stands still."""

    def check_mode_change(self, side: Side, mode: Mode) -> None:
        """A mode is changed only without load, at standstill."""

    def check_clamp(self, clamped: bool) -> None:
        """The clamp is opened only without load, and closed only on something."""

    def check_mounting(self, mounting: Mounting) -> None:
        """Something else is mounted only with the clamp open and the drives off."""

    def check_procedure(
        self, kind: Literal["calibration", "verification", "reducer_test"]
    ) -> None:
        """A calibration needs the calibrator, a reducer test the reducer in the clamp.

        Procedures call this first. A verification takes the verification standard.
        """

    def standard_serial(self) -> str:
        """Serial number of the mounted standard, empty when none is mounted."""
        return ""
