"""Instruments whose commands are written to the audit log.

Commands of a procedure also pass a gate: while an alarm is latched none takes effect, not even a
command that another thread was giving while the supervisor removed the torque.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal, Protocol

from torquebench.bench.audit.entries import AuditLog
from torquebench.bench.drivers.base import (
    Clamp,
    Drive,
    DriveLimits,
    DriverSet,
    DriveState,
    GuideRail,
    Identity,
    ModeConverter,
)
from torquebench.bench.roles import Mode, RailPosition, Side
from torquebench.bench.safety.alarms import Alarm
from torquebench.errors import InterlockError
from torquebench.message import Message

Commander = Literal["procedure", "supervisor", "doctor"]


class CommandGate(Protocol):
    """A function that returns the alarm which forbids commands of a procedure, or None."""

    def __call__(self) -> Alarm | None:
        """Return the latched alarm."""


class AuditedDrive:
    """A drive whose commands are in the audit log.

    Watchdog signals and state requests aren't commands and aren't logged: they occur a hundred
    times a second.

    Parameters
    ----------
    side : {"input", "output"}
    by : {"procedure", "supervisor", "doctor"}
        The origin of commands through this object.
    gate : callable
        See `CommandGate`; for the supervisor it is always open.
    ramp_s : float
        Ramp time to zero after a command that came after an alarm, s.
    """

    def __init__(
        self,
        drive: Drive,
        side: Side,
        log: AuditLog,
        by: Commander,
        gate: CommandGate,
        ramp_s: float,
    ) -> None:
        self.drive = drive
        self._side = side
        self._log = log
        self._by = by
        self._gate = gate
        self._ramp_s = ramp_s

    def identity(self) -> Identity:
        """Read the identity of the drive."""
        return self.drive.identity()

    def limits(self) -> DriveLimits:
        """Return the drive's own limits."""
        return self.drive.limits()

    def enable(self) -> None:
        """Power the motor at zero torque and zero speed."""
        self._pass("enable", self.drive.enable)

    def disable(self) -> None:
        """Switch off the motor's power."""
        self._give("disable", self.drive.disable)

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        """Ramp to a torque at a limited rate."""
        self._pass(
            "command_torque",
            lambda: self.drive.command_torque(torque_nm, ramp_nm_per_s),
            moves=torque_nm != 0.0,
            torque_nm=torque_nm,
            ramp_nm_per_s=ramp_nm_per_s,
        )

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        """Ramp to a speed at a limited rate."""
        self._pass(
            "command_speed",
            lambda: self.drive.command_speed(speed_rad_s, ramp_rad_per_s2),
            moves=speed_rad_s != 0.0,
            speed_rad_s=speed_rad_s,
            ramp_rad_per_s2=ramp_rad_per_s2,
        )

    def ramp_to_zero(self, duration_s: float) -> None:
        """Ramp torque and speed to zero."""
        self._give(
            "ramp_to_zero", lambda: self.drive.ramp_to_zero(duration_s), duration_s=duration_s
        )

    def feed_watchdog(self) -> None:
        """Reset the drive's watchdog."""
        self.drive.feed_watchdog()

    def state(self) -> DriveState:
        """Request the active set points and the fault state."""
        return self.drive.state()

    def close(self) -> None:
        """Release the drive."""
        self.drive.close()

    def _pass(
        self, command: str, give: Callable[[], None], *, moves: bool = True, **values: float
    ) -> None:
        """Give a command that moves something, unless an alarm is latched before or during it."""
        alarm = self._gate()
        if alarm is not None and not moves:
            return  # the supervisor is already ramping to zero, and faster
        if alarm is None:
            self._give(command, give, **values)
            alarm = self._gate()
            if (
                alarm is not None and moves
            ):  # the supervisor acted in between: its command to zero takes precedence
                self._give(
                    "ramp_to_zero",
                    lambda: self.drive.ramp_to_zero(self._ramp_s),
                    duration_s=self._ramp_s,
                )
        if alarm is not None and moves:
            self._log.write("refused", command=command, side=self._side, alarm=alarm.name)
            raise InterlockError(
                Message(
                    "{command} of the {side} drive while an alarm is latched ({alarm}: {found})",
                    command.replace("_", " "),
                    self._side,
                    alarm.kind.value,
                    alarm.found,
                ),
                "no latched alarm",
                "remove the cause and acknowledge the alarm",
            )

    def _give(self, command: str, give: Callable[[], None], **values: float) -> None:
        _logged(self._log, "drive", command, give, self._by, side=self._side, **values)


class AuditedModes:
    """A mode conversion whose commands are in the audit log."""

    def __init__(self, modes: ModeConverter, log: AuditLog) -> None:
        self._modes = modes
        self._log = log

    def set_mode(self, side: Side, mode: Mode) -> None:
        """Change the mode of one side."""
        give = partial(self._modes.set_mode, side, mode)
        _logged(self._log, "modes", "set_mode", give, "procedure", side=side, mode=mode)

    def mode(self, side: Side) -> Mode:
        """Request the present mode of one side."""
        return self._modes.mode(side)


class AuditedClamp:
    """A clamp whose commands are in the audit log."""

    def __init__(self, clamp: Clamp, log: AuditLog) -> None:
        self._clamp = clamp
        self._log = log

    def set_clamped(self, clamped: bool) -> None:
        """Close or open the clamp."""
        give = partial(self._clamp.set_clamped, clamped)
        _logged(self._log, "clamp", "set_clamped", give, "procedure", clamped=clamped)

    def clamped(self) -> bool:
        """Return whether the clamp is closed and under pressure."""
        return self._clamp.clamped()


class AuditedRail:
    """A guide rail whose commands are in the audit log."""

    def __init__(self, rail: GuideRail, log: AuditLog) -> None:
        self._rail = rail
        self._log = log

    def move(self, position: RailPosition) -> None:
        """Move to "end" or "away"."""
        give = partial(self._rail.move, position)
        _logged(self._log, "guide rail", "move", give, "procedure", position=position)

    def position(self) -> RailPosition:
        """Return the rail's position."""
        return self._rail.position()


def audited(
    drivers: DriverSet, log: AuditLog, by: Commander, gate: CommandGate, ramp_s: float
) -> DriverSet:
    """Return the instruments with an audit log for all that are commanded.

    Parameters
    ----------
    by : {"procedure", "supervisor", "doctor"}
        The origin of commands through the result.
    gate : callable
    ramp_s : float
        As in `AuditedDrive`.
    """
    return replace(
        drivers,
        drives={
            side: AuditedDrive(drive, side, log, by, gate, ramp_s)
            for side, drive in drivers.drives.items()
        },
        modes=AuditedModes(drivers.modes, log),
        clamp=AuditedClamp(drivers.clamp, log),
        rail=None if drivers.rail is None else AuditedRail(drivers.rail, log),
    )


def _logged(
    log: AuditLog,
    instrument: str,
    command: str,
    give: Callable[[], None],
    by: Commander,
    **values: object,
) -> None:
    """Write a line and give the command; for the supervisor, give the command first."""
    line = {"instrument": instrument, "command": command, "by": by, **values}
    urgent = by == "supervisor"
    write = log.write_soon if urgent else log.write
    if not urgent:
        write("command", **line)
    try:
        give()
    except Exception as error:
        write("command failed", **line, error=f"{type(error).__name__}: {error}")
        raise
    if urgent:
        write("command", **line)
