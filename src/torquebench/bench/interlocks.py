"""Interlocks: rules for all procedures that forbid operations in some states of the bench.

Rules are functions of a `BenchState`. The devices apply them to the present state, a rehearsal to
the state predicted for the step. A rule returns if the operation is allowed; otherwise it raises
`InterlockError` (state) or `LimitError` (value), with what was found, what is allowed and what to
do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import inf
from typing import TYPE_CHECKING, Literal, Protocol

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import Drive, DriveLimits, DriverSet, Identity
from torquebench.bench.roles import (
    MODES,
    MOUNTINGS,
    RAIL_TARGETS,
    SIDES,
    Mode,
    Mounting,
    RailPosition,
    Side,
    torque_channel,
)
from torquebench.bench.safety import SafetySupervisor
from torquebench.bench.safety.alarms import Alarm
from torquebench.bench.safety.limits import LimitBook, SideLimits
from torquebench.bench.state import CommandState, Quantity
from torquebench.errors import BenchError, InputError, InterlockError, LimitError
from torquebench.message import Message
from torquebench.units import RPM_PER_RAD_S

if TYPE_CHECKING:
    from torquebench.bench.acquisition import Acquisition

ProcedureKind = Literal["calibration", "verification", "reducer_test", "empty_run"]

_NEEDED: dict[ProcedureKind, Mounting] = {
    "calibration": "calibrator",
    "verification": "verification_standard",
    "reducer_test": "reducer",
    "empty_run": "nothing",
}
_RAIL_WORDS: dict[RailPosition, str] = {
    "end": "at its end position",
    "away": "drawn back",
    "between": "between its positions",
}
_ROUNDING = 1e-9
"""Relative tolerance of a speed limit, for rounding in the conversion from rpm."""


class BenchState(Protocol):
    """State of the bench for the interlocks; torque in N·m, speed in rad/s, clockwise positive."""

    @property
    def description(self) -> BenchDescription:
        """Description of the bench."""

    def mounted(self) -> Mounting:
        """Return the part between the flanges."""

    def clamped(self) -> bool:
        """Whether the clamp is closed."""

    def mode(self, side: Side) -> Mode:
        """Mode of a side."""

    def enabled(self, side: Side) -> bool:
        """Whether a drive has power."""

    def commanded(self, side: Side) -> tuple[float, float]:
        """Last commanded torque and speed of a drive."""

    def reading_nm(self, side: Side) -> float:
        """Return the torque reading of a transducer. Raises SignalFault if it is unknown."""

    def speed_rad_s(self, side: Side) -> float:
        """Measured speed of a side."""

    def limits(self, side: Side) -> SideLimits:
        """Limits in force on a side."""

    def drive_limits(self, side: Side) -> DriveLimits:
        """Return the drive's own limits."""

    def alarm(self) -> Alarm | None:
        """Return the latched alarm."""

    def has_rail(self) -> bool:
        """Whether the bench moves a guide rail."""

    def rail(self) -> RailPosition:
        """Position of the guide rail; "end" if the bench has none."""

    def supplied(self) -> bool:
        """Whether the drives' supply is on; true if it isn't monitored."""

    def absent_s(self) -> float:
        """Time since the operator's confirmation of presence expired, s; 0 while it is valid."""


def _always_at_end() -> RailPosition:
    return "end"


def _always_on() -> bool:
    """Return that the bench is powered: it has no instrument that tells."""
    return True


class PresentState:
    """The present state of the bench: the drivers' reports and the last commands."""

    def __init__(
        self,
        description: BenchDescription,
        drivers: DriverSet,
        supervisor: SafetySupervisor,
        commands: CommandState,
        acquisition: Acquisition,
    ) -> None:
        self.description = description
        self.mounted = drivers.operator.mounted
        self.clamped = drivers.clamp.clamped
        self.mode = drivers.modes.mode
        self.limits = supervisor.limits.side
        self.absent_s = supervisor.heartbeats.absent_s
        self.speed_rad_s = acquisition.speed_rad_s
        rail, supply = drivers.rail, drivers.supply
        self.rail = _always_at_end if rail is None else rail.position
        self.supplied = _always_on if supply is None else supply.supplies
        self._has_rail = rail is not None
        self._drives = drivers.drives
        self._supervisor = supervisor
        self._commands = commands
        self._acquisition = acquisition

    def has_rail(self) -> bool:
        """Whether the bench moves a guide rail."""
        return self._has_rail

    def enabled(self, side: Side) -> bool:
        """Whether a drive has power."""
        return self._commands.side(side).enabled

    def commanded(self, side: Side) -> tuple[float, float]:
        """Last commanded torque and speed of a drive."""
        commands = self._commands.side(side)
        return commands.torque_nm, commands.speed_rad_s

    def reading_nm(self, side: Side) -> float:
        """Return the reading of a transducer. Raises SignalFault if it is unknown."""
        return self._acquisition.reading_nm(torque_channel(side))

    def drive_limits(self, side: Side) -> DriveLimits:
        """Return the drive's own limits."""
        return self._drives[side].limits()

    def alarm(self) -> Alarm | None:
        """Return the latched alarm."""
        return self._supervisor.alarm


class PlannedState:
    """State of the bench in a rehearsal, which the rehearsed devices change.

    It assumes that the operator is present, the supply on and no alarm latched; the devices check
    this at run time.
    """

    def __init__(self, present: BenchState, drives: Mapping[Side, Drive]) -> None:
        self.description = present.description
        self.book = LimitBook(present.description)
        self.limits = self.book.side
        self.drive_limits, self.has_rail = present.drive_limits, present.has_rail
        self.mounting, self.closed = present.mounted(), present.clamped()
        self.rail_position = present.rail()
        self.modes = {side: present.mode(side) for side in SIDES}
        self.power = {side: drives[side].state().enabled for side in SIDES}
        self.mounted: Callable[[], Mounting] = lambda: self.mounting
        self.clamped: Callable[[], bool] = lambda: self.closed
        self.rail: Callable[[], RailPosition] = lambda: self.rail_position
        self.mode, self.enabled = self.modes.__getitem__, self.power.__getitem__
        self.supplied = _always_on
        self._set_points = {side: {"torque": 0.0, "speed": 0.0} for side in SIDES}

    def commanded(self, side: Side) -> tuple[float, float]:
        """Planned torque and speed of a drive."""
        return self.reading_nm(side), self.speed_rad_s(side)

    def reading_nm(self, side: Side) -> float:
        """Planned torque of a side."""
        return self._set_points[side]["torque"]

    def speed_rad_s(self, side: Side) -> float:
        """Planned speed of a side."""
        return self._set_points[side]["speed"]

    def alarm(self) -> Alarm | None:
        """Return None: no alarm is assumed."""
        return None

    def absent_s(self) -> float:
        """Return 0: the operator is assumed to be present."""
        return 0.0

    def ramp(self, side: Side, quantity: Quantity, target: float, rate: float = inf) -> float:
        """Ramp to a torque or a speed, at the drive's rate or slower; return the duration, s."""
        check_set_point(self, side, quantity, target)
        way = abs(target - self._set_points[side][quantity])
        self._set_points[side][quantity] = target
        return way / min(rate, self.description.module(side).drive.rate(quantity))


# -- torque and speed --------------------------------------------------------------------------


def check_set_point(state: BenchState, side: Side, quantity: Quantity, value: float) -> None:
    """Check a torque (N·m) or a speed (rad/s) before a drive is commanded to it.

    A set point other than zero requires a driven side, an enabled drive and no alarm. A torque
    requires a closed clamp, and so does a speed if anything is mounted.
    """
    limits, own = state.limits(side), state.drive_limits(side)
    if quantity == "torque":
        check_torque_limit(side, value, limits.torque_nm)
        _check_own_limit(side, value, own.torque_nm, "N·m")
    else:
        if value:
            state.description.needed_encoder(side)
        check_speed_limit(side, value * RPM_PER_RAD_S, limits.speed_rpm)
        _check_own_limit(side, value * RPM_PER_RAD_S, own.speed_rad_s * RPM_PER_RAD_S, "rpm")
    if value == 0.0:
        return
    _check_may_drive(state, side, quantity)
    if quantity == "torque" or state.mounted() != "nothing":
        _check_clamped(state, quantity)


def check_torque_limit(side: Side, torque_nm: float, limit_nm: float) -> None:
    """Refuse a torque beyond a limit of the bench, or one that isn't a number."""
    if not abs(torque_nm) <= limit_nm:
        raise LimitError(
            Message("{torque_nm:g} N·m requested from the {side} drive", torque_nm, side),
            Message("±{limit:g} N·m", limit_nm),
            Message("raise {side}.limits.torque_nm only if the whole chain withstands it", side),
        )


def check_speed_limit(side: Side, speed_rpm: float, limit_rpm: float) -> None:
    """Refuse a speed beyond a limit of the bench, or one that isn't a number."""
    if not abs(speed_rpm) <= limit_rpm * (1.0 + _ROUNDING):
        raise LimitError(
            Message("{speed_rpm:g} rpm requested from the {side} drive", speed_rpm, side),
            Message("±{limit:g} rpm", limit_rpm),
            Message("raise {side}.limits.speed_rpm only if the whole chain withstands it", side),
        )


def _check_own_limit(side: Side, value: float, limit: float, unit: str) -> None:
    """Refuse a set point that the drive itself would refuse or limit."""
    if abs(value) > limit * (1.0 + _ROUNDING):
        raise LimitError(
            Message("{value:g} {unit} requested from the {side} drive", value, unit, side),
            Message("±{limit:g} {unit}, the drive's own limit", limit, unit),
            "raise the limit in the drive's settings if motor and chain withstand it, or "
            "request less",
        )


def check_enable(state: BenchState, side: Side) -> None:
    """Refuse to enable a drive with an alarm latched, or without presence or torque signal."""
    _check_no_alarm(state, Message("enable the {side} drive", side))
    if not state.supplied():
        raise InterlockError(
            Message("enabling the {side} drive with its supply off", side),
            "the power supply on",
            "switch the power supply on",
        )
    if state.absent_s() > 0.0:
        raise InterlockError(
            Message("enabling the {side} drive with nobody at the bench", side),
            "a person who has confirmed their presence",
            "confirm your presence, then continue",
        )
    state.reading_nm(side)  # a signal fault means that the torque is unknown


def _check_may_drive(state: BenchState, side: Side, what: str) -> None:
    """Refuse a command to a drive during an alarm, in another mode or without power."""
    _check_no_alarm(state, Message("{what} on the {side} side", what, side))
    mode = state.mode(side)
    if mode != "driven":
        raise InterlockError(
            Message("{value} requested from the {side} side in mode {mode!r}", what, side, mode),
            "mode 'driven'",
            "change the mode first",
        )
    if not state.enabled(side):
        raise InterlockError(
            Message("{value} requested from the {side} drive, which is off", what, side),
            "an enabled drive",
            "switch its power on first",
        )


def _check_clamped(state: BenchState, what: str) -> None:
    """Refuse a request that needs the closed clamp."""
    if not state.clamped():
        raise InterlockError(
            Message("{value} requested with the clamp open", what),
            "a closed clamp",
            "close the clamp first",
        )


def _check_no_alarm(state: BenchState, purpose: str) -> None:
    """Refuse a request while an alarm is latched."""
    alarm = state.alarm()
    if alarm is not None:
        raise InterlockError(
            Message(
                "{purpose} while an alarm is latched ({alarm}: {found})",
                purpose,
                alarm.kind.value,
                alarm.found,
            ),
            "no latched alarm",
            "remove the cause and acknowledge the alarm",
        )


# -- modes, clamp, mounting --------------------------------------------------------------------


def check_unloaded(state: BenchState, side: Side, purpose: str) -> None:
    """Require that the side carries no torque and is at standstill.

    Raises
    ------
    InterlockError
        The module is loaded, commanded or turning.
    SignalFault
        Its torque is unknown.
    """
    torque_nm, speed_rad_s = state.commanded(side)
    if state.enabled(side) and (torque_nm != 0.0 or speed_rad_s != 0.0):
        raise InterlockError(
            Message(
                "{side} drive at {torque:g} N·m and {speed:g} rpm",
                side,
                torque_nm,
                speed_rad_s * RPM_PER_RAD_S,
            ),
            "zero torque and standstill",
            Message("unload the side first to {purpose}", purpose),
        )
    reading, limit = state.reading_nm(side), state.description.unloaded_nm(side)
    if not abs(reading) <= limit:
        raise InterlockError(
            Message("{side} transducer reads {reading:.2f} N·m", side, reading),
            Message("±{limit:g} N·m", limit),
            Message(
                "unload the side first to {purpose}; where nothing loads it, its zero is "
                "off: raise `safety.unloaded_percent`, or have the transducer adjusted",
                purpose,
            ),
        )
    if state.description.module(side).encoder is None:  # then its drive takes no speed
        return
    safety, speed_rad_s = state.description.safety, state.speed_rad_s(side)
    if not safety.at_standstill(speed_rad_s):
        raise InterlockError(
            Message("{side} side turns at {speed:.2f} rpm", side, abs(speed_rad_s) * RPM_PER_RAD_S),
            Message("at most {standstill_rpm:g} rpm", safety.standstill_rpm),
            Message("stop the side first to {purpose}", purpose),
        )


def check_mode_change(state: BenchState, side: Side, mode: Mode) -> None:
    """Require both sides unloaded and at standstill for a change of mode.

    A side whose drive has power can't leave the mode 'driven'.
    """
    if mode not in MODES:
        raise InputError(Message("mode {mode!r}", mode), ", ".join(MODES))
    for driven_side in SIDES:
        check_unloaded(state, driven_side, Message("change the {side} mode", side))
    if state.enabled(side) and mode != "driven":
        raise InterlockError(
            Message("mode {mode} of the {side} with its drive on", mode, side),
            "drive off",
            "switch the drives off",
        )


def check_clamp(state: BenchState, clamped: bool) -> None:
    """Allow to open the clamp only without load, and to close it only on a mounted part."""
    if clamped and state.mounted() == "nothing":
        raise InterlockError(
            "closing the clamp with nothing mounted",
            "the calibrator, the verification standard or a reducer",
            "mount it first",
        )
    if clamped and state.rail() != "end":
        raise InterlockError(
            Message("closing the clamp with the guide rail {position}", _RAIL_WORDS[state.rail()]),
            "the guide rail at its end position",
            "move the input module to the end of the rail first",
        )
    if not clamped and state.clamped():
        for side in SIDES:
            check_unloaded(state, side, "open the clamp")


def check_rail(state: BenchState, position: RailPosition) -> None:
    """Allow to move the rail only with the clamp open, the drives off, no load and standstill."""
    if position not in RAIL_TARGETS:
        raise InputError(Message("guide rail to {position!r}", position), ", ".join(RAIL_TARGETS))
    if not state.has_rail():
        raise InputError(
            Message("the guide rail of {name}", state.description.name),
            "a bench with a section [driver.guide_rail]",
            "move it by hand",
        )
    if state.clamped():
        raise InterlockError(
            "moving the guide rail with the clamp closed", "an open clamp", "open the clamp"
        )
    for side in SIDES:
        if state.enabled(side):
            raise InterlockError(
                Message("moving the guide rail with the {side} drive on", side),
                "both drives off",
                "switch the drives off",
            )
        check_unloaded(state, side, "move the guide rail")


def check_mounting(state: BenchState, mounting: Mounting) -> None:
    """Allow another mounting only with the clamp open and the drives off."""
    if mounting not in MOUNTINGS:
        raise InputError(Message("mounting {what!r}", mounting), ", ".join(MOUNTINGS))
    if mounting != state.mounted():
        _check_accessible(state, mounting)


def check_seating(state: BenchState) -> None:
    """Require a mounted part, an open clamp, and drives that are off."""
    if state.mounted() == "nothing":
        raise InterlockError(
            "seating with nothing mounted", "something between the flanges", "mount it first"
        )
    _check_accessible(state, state.mounted())


def _check_accessible(state: BenchState, mounting: Mounting) -> None:
    """Refuse a change of the mounting with the clamp closed or a drive on."""
    if state.clamped():
        raise InterlockError(
            Message("mounting {what} with the clamp closed", mounting),
            "an open clamp",
            "open the clamp",
        )
    for side in SIDES:
        if state.enabled(side):
            raise InterlockError(
                Message("mounting {what} with the {side} drive on", mounting, side),
                "both drives off",
                "switch the drives off",
            )


# -- procedures --------------------------------------------------------------------------------


def check_procedure(state: BenchState, kind: ProcedureKind) -> None:
    """Require the mounting that a procedure needs: calibrator, standard, reducer or nothing.

    Procedures call this first.
    """
    _check_no_alarm(state, Message("start a {kind}", kind.replace("_", " ")))
    mounted, needed = state.mounted(), _NEEDED[kind]
    if mounted != needed:
        raise InterlockError(
            Message(
                "{kind} with {mounted} mounted", kind.replace("_", " "), mounted.replace("_", " ")
            ),
            needed.replace("_", " "),
            Message("mount the {what}", needed.replace("_", " "))
            if needed != "nothing"
            else "take it out",
        )
    if needed != "nothing":
        _check_clamped(state, kind.replace("_", " "))


def standard_serial(state: BenchState) -> str:
    """Return the serial number of the mounted standard; empty if none is mounted."""
    standard = state.description.standard(state.mounted())
    return standard.serial if standard else ""


# -- identity ----------------------------------------------------------------------------------


def check_identities(description: BenchDescription, identities: Iterable[Identity]) -> None:
    """Compare the serial numbers that instruments report with those in the description.

    Parameters
    ----------
    identities : iterable of Identity
        Identities that the instruments report. Roles without a serial number in the description (a
        read-out) and instruments that report none aren't compared.

    Raises
    ------
    BenchError
        An instrument isn't the described one: limits and calibrations would be wrong.
    """
    for identity in identities:
        described = description.serials.get(identity.role)
        if described is not None and identity.serial not in ("", described):
            raise BenchError(
                Message(
                    "{role}: {manufacturer} {model} answers with serial {serial!r}",
                    identity.role,
                    identity.manufacturer,
                    identity.model,
                    identity.serial,
                ),
                Message("serial {described!r}, as described", described),
                "connect the described instrument or correct the bench description",
            )
