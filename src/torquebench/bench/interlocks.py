"""What the bench's state forbids, whatever a procedure asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.roles import MODES, MOUNTINGS, SIDES, Mode, Mounting, Side, torque_channel
from torquebench.bench.safety import SafetySupervisor
from torquebench.bench.state import CommandState
from torquebench.errors import InputError, InterlockError, LimitError
from torquebench.units import RPM_PER_RAD_S

if TYPE_CHECKING:
    from torquebench.bench.acquisition import Acquisition

__all__ = ["Interlocks", "ProcedureKind"]

ProcedureKind = Literal["calibration", "verification", "reducer_test"]


_NEEDED: dict[ProcedureKind, Mounting] = {
    "calibration": "calibrator",
    "verification": "verification_standard",
    "reducer_test": "reducer",
}


class Interlocks:
    """Refuses operations that the bench's present state forbids.

    Every method returns when the operation is allowed and raises `InterlockError` (state) or
    `LimitError` (value) otherwise, with what was found, what is allowed and what to do.
    """

    def __init__(
        self,
        description: BenchDescription,
        drivers: DriverSet,
        supervisor: SafetySupervisor,
        commands: CommandState,
        acquisition: Acquisition,
    ) -> None:
        self._description = description
        self._drivers = drivers
        self._supervisor = supervisor
        self._commands = commands
        self._acquisition = acquisition

    # -- torque and speed -------------------------------------------------------------------

    def check_torque(self, side: Side, torque_nm: float) -> None:
        """Torque needs a closed clamp, a driven side, an enabled drive, no alarm, no excess."""
        limit = self._supervisor.limits_of(side).torque_nm
        if not abs(torque_nm) <= limit:
            raise LimitError(
                f"{torque_nm:g} N·m asked of the {side} drive",
                f"±{limit:g} N·m",
                f"raise {side}.limits.torque_nm only if the whole chain bears it",
            )
        if torque_nm != 0.0:
            self._check_may_drive(side, "torque")
            self._check_clamped("torque")

    def check_speed(self, side: Side, speed_rad_s: float) -> None:
        """Speed needs a driven side, an enabled drive, no alarm and no excess.

        With anything mounted it needs the clamp too.
        """
        limit = self._supervisor.limits_of(side).speed_rpm
        if not abs(speed_rad_s) * RPM_PER_RAD_S <= limit:
            raise LimitError(
                f"{speed_rad_s * RPM_PER_RAD_S:g} rpm asked of the {side} drive",
                f"±{limit:g} rpm",
                f"raise {side}.limits.speed_rpm only if the whole chain bears it",
            )
        if speed_rad_s != 0.0:
            self._check_may_drive(side, "speed")
            if self._drivers.operator.mounted() != "nothing":
                self._check_clamped("speed")

    def check_enable(self, side: Side) -> None:
        """Refuse to enable a drive with an alarm latched, nobody there, or no torque signal."""
        self._check_no_alarm(f"enable the {side} drive")
        if self._supervisor.heartbeats.absent_s() > 0.0:
            raise InterlockError(
                f"enabling the {side} drive with nobody at the bench",
                "somebody who has confirmed to be there",
                "confirm your presence, then go on",
            )
        self._acquisition.latest(torque_channel(side))

    def _check_may_drive(self, side: Side, what: str) -> None:
        self._check_no_alarm(f"{what} on the {side} side")
        mode = self._drivers.modes.mode(side)
        if mode != "driven":
            raise InterlockError(
                f"{what} asked of the {side} side in mode {mode!r}",
                "mode 'driven'",
                "change the mode first",
            )
        if not self._commands.side(side).enabled:
            raise InterlockError(
                f"{what} asked of the {side} drive, which is off",
                "an enabled drive",
                "switch its power on first",
            )

    def _check_clamped(self, what: str) -> None:
        if not self._drivers.clamp.clamped():
            raise InterlockError(
                f"{what} asked with the clamp open", "a closed clamp", "close the clamp first"
            )

    def _check_no_alarm(self, purpose: str) -> None:
        alarm = self._supervisor.alarm
        if alarm is not None:
            raise InterlockError(
                f"{purpose} while an alarm is latched ({alarm.kind.value}: {alarm.found})",
                "no latched alarm",
                "remove the cause and acknowledge the alarm",
            )

    # -- modes, clamp, mounting -------------------------------------------------------------

    def check_unloaded(self, side: Side, purpose: str) -> None:
        """Require that the side carries no torque and stands still.

        Raises
        ------
        InterlockError
            It is loaded, commanded or turning.
        SignalFault
            Its torque is unknown.
        """
        commands = self._commands.side(side)
        if commands.enabled and (commands.torque_nm != 0.0 or commands.speed_rad_s != 0.0):
            raise InterlockError(
                f"{side} drive at {commands.torque_nm:g} N·m and "
                f"{commands.speed_rad_s * RPM_PER_RAD_S:g} rpm",
                "zero torque and standstill",
                f"unload the side first to {purpose}",
            )
        safety = self._description.safety
        limit = safety.unloaded_percent / 100.0 * self._description.module(side).range_nm
        reading = self._acquisition.latest(torque_channel(side)).torque_nm
        if abs(reading) > limit:
            raise InterlockError(
                f"{side} transducer reads {reading:.2f} N·m",
                f"±{limit:g} N·m",
                f"unload the side first to {purpose}; where nothing loads it, its zero is off: "
                "raise `safety.unloaded_percent`, or have the transducer adjusted",
            )
        speed = abs(self._acquisition.speed_rad_s(side)) * RPM_PER_RAD_S
        if speed > safety.standstill_rpm:
            raise InterlockError(
                f"{side} side turns with {speed:.2f} rpm",
                f"at most {safety.standstill_rpm:g} rpm",
                f"stop the side first to {purpose}",
            )

    def check_mode_change(self, side: Side, mode: Mode) -> None:
        """Require both sides unloaded and at standstill for another mode."""
        if mode not in MODES:
            raise InputError(f"mode {mode!r}", ", ".join(MODES))
        for each in SIDES:
            self.check_unloaded(each, f"change the {side} mode")

    def check_clamp(self, clamped: bool) -> None:
        """Open the clamp only without load, close it only on something."""
        if clamped and self._drivers.operator.mounted() == "nothing":
            raise InterlockError(
                "closing the clamp with nothing mounted",
                "the calibrator, the verification standard or a reducer",
                "mount it first",
            )
        if not clamped and self._drivers.clamp.clamped():
            for side in SIDES:
                self.check_unloaded(side, "open the clamp")

    def check_mounting(self, mounting: Mounting) -> None:
        """Something else is mounted only with the clamp open and the drives off."""
        if mounting not in MOUNTINGS:
            raise InputError(f"mounting {mounting!r}", ", ".join(MOUNTINGS))
        if self._drivers.clamp.clamped():
            raise InterlockError(
                f"mounting {mounting} with the clamp closed", "an open clamp", "open the clamp"
            )
        for side in SIDES:
            if self._commands.side(side).enabled:
                raise InterlockError(
                    f"mounting {mounting} with the {side} drive on",
                    "both drives off",
                    "take the power off the drives",
                )

    # -- procedures -------------------------------------------------------------------------

    def check_procedure(self, kind: ProcedureKind) -> None:
        """Require what the procedure needs in the clamp: calibrator, standard or reducer.

        Procedures ask this first.
        """
        self._check_no_alarm(f"start a {kind.replace('_', ' ')}")
        mounted, needed = self._drivers.operator.mounted(), _NEEDED[kind]
        if mounted != needed:
            raise InterlockError(
                f"{kind.replace('_', ' ')} with {mounted.replace('_', ' ')} mounted",
                needed.replace("_", " "),
                f"mount the {needed.replace('_', ' ')}",
            )
        self._check_clamped(kind.replace("_", " "))

    def standard_serial(self) -> str:
        """Return the serial number of the mounted standard, empty when none is mounted."""
        standard = self._description.standard(self._drivers.operator.mounted())
        return standard.serial if standard else ""
