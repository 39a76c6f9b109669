"""A CiA 402 servo drive over CANopen (`canopen`): profile or cyclic torque and velocity.

The drive executes its ramps (in the cyclic modes, which know none, this computer steps them) and
monitors this computer's heartbeat by itself. `cia402.eds` lists all objects in use.
"""

from __future__ import annotations

import contextlib
import math
import struct
import time
from collections.abc import Callable
from importlib import resources
from typing import Annotated, Any, TypeVar

from pydantic import Field

from torquebench.bench.drivers.base import DriveLimits, DriveState, Identity
from torquebench.bench.drivers.can_bus import BusOptions
from torquebench.bench.drivers.links import (
    LONGEST_TIME_OUT_S,
    POLL_S,
    Link,
    SwitchingTime,
    TimeOut,
    WireError,
    check_drive_order,
)
from torquebench.bench.drivers.plugins import (
    DriverPlugin,
    InstrumentRequest,
    Options,
    require_library,
)
from torquebench.bench.drivers.stepping import Stepper
from torquebench.bench.roles import Side
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.units import MS_PER_S, RPM_PER_RAD_S

CONTROLWORD, STATUSWORD, ERROR_CODE = 0x6040, 0x6041, 0x603F
MODE, MODE_DISPLAY = 0x6060, 0x6061
TARGET_TORQUE, TORQUE_DEMAND, TORQUE_SLOPE = 0x6071, 0x6074, 0x6087
MAXIMUM_TORQUE, RATED_TORQUE, MAXIMUM_SPEED = 0x6072, 0x6076, 0x6080
TARGET_VELOCITY, VELOCITY_DEMAND = 0x60FF, 0x606B
POSITION = 0x6064
ACCELERATION, DECELERATION, QUICK_STOP_DECELERATION = 0x6083, 0x6084, 0x6085
ABORT_OPTION, HEARTBEAT_CONSUMER, IDENTITY = 0x6007, 0x1016, 0x1018
DEVICE_NAME, QUICK_STOP_OPTION, FAULT_REACTION = 0x1008, 0x605A, 0x605E

SUPPORTED_MODES = 0x6502

PROFILE_VELOCITY, PROFILE_TORQUE, CYCLIC_VELOCITY, CYCLIC_TORQUE = 3, 4, 9, 10
SHUT_DOWN, SWITCH_ON, ENABLE_OPERATION, FAULT_RESET = 0x06, 0x07, 0x0F, 0x80
DISABLE_VOLTAGE, QUICK_STOP = 0x00, 0x02
ABORT_BY_FAULT = 1
OPERATIONAL = 5
LARGEST_SLOPE = 2**31 - 1
HEARTBEAT_ERRORS = (0x8130, 0x8110, 0x8120)
REMOTE, INTERNAL_LIMIT = 0x0200, 0x0800
"""Bits of the statusword: the drive accepts commands from the bus; one of its own limits acts."""
TIMED_OUT, NOT_IN_THIS_STATE = 0x05040000, 0x08000022
ABSENT = (0x06020000, 0x06090011)
"""Abort codes: no answer; refused in the present state; no such object or subindex."""

STATES = (
    (0x4F, 0x40, "switch on disabled"),
    (0x6F, 0x21, "ready to switch on"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, "operation enabled"),
    (0x6F, 0x07, "quick stop active"),
    (0x4F, 0x0F, "fault reaction active"),
    (0x4F, 0x08, "fault"),
    (0x4F, 0x00, "not ready to switch on"),
)
"""Mask, value and name of the states (CiA 402-2, statusword)."""
BUSY_STATES = ("not ready to switch on", "fault reaction active")
"""States that end by themselves, and in which a drive accepts no controlword."""

Result = TypeVar("Result")


class Refusal(BenchError):  # noqa: N818 - the drive's answer, not a defect of the wire
    """The drive refuses to read or write an object."""

    code = 0
    """Abort code of CiA 301."""


class DriveOptions(Options):
    """A CiA 402 drive; `velocity_units_per_rpm` is the resolution of its velocity objects."""

    velocity_units_per_rpm: Annotated[float, Field(gt=0.0, le=1e6)] = 1000.0
    switching_s: SwitchingTime = 5.0
    timeout_s: TimeOut | None = None


class Cia402Options(DriveOptions):
    """One drive on a CAN bus; `master` is the node number of this computer's heartbeat."""

    bus: BusOptions
    node: Annotated[int, Field(ge=1, le=127)]
    master: Annotated[int, Field(ge=1, le=127)] = 126


def load_dictionary() -> Any:
    """Read the object dictionary that driver and simulator share."""
    canopen = require_library("canopen", "canopen")
    text = resources.files("torquebench.bench.drivers") / "cia402.eds"
    with resources.as_file(text) as path:
        return canopen.import_od(str(path))


class ObjectLink(Link[Any]):
    """A node with an object dictionary, accessed by SDO."""

    def __init__(self, name: str, address: str, timeout_s: float) -> None:
        super().__init__(name, address, timeout_s)
        self.dictionary = load_dictionary()

    def exchange(self, ask: Callable[[Any], Result], what: str) -> Result:
        """Communicate on the connection; `what` names the request in messages."""
        raise NotImplementedError

    def upload(self, connection: Any, index: int, subindex: int) -> Any:
        """Return an object's value."""
        raise NotImplementedError

    def download(self, connection: Any, index: int, subindex: int, value: int) -> None:
        """Write an object's value."""
        raise NotImplementedError

    def read(self, index: int, subindex: int = 0) -> int:
        """Read an integer object."""
        what = Message("to read {object}", self._named(index, subindex))
        return int(self.exchange(lambda at: self.upload(at, index, subindex), what))

    def read_optional(self, index: int, subindex: int = 0) -> int | None:
        """Read an integer object; None if the drive doesn't have it."""
        try:
            return self.read(index, subindex)
        except Refusal as refusal:
            if refusal.code in ABSENT:
                return None
            raise

    def read_text(self, index: int) -> str:
        """Read a text object; empty if the drive doesn't have it."""
        what = Message("to read {object}", self._named(index, 0))
        try:
            return str(self.exchange(lambda at: self.upload(at, index, 0), what))
        except Refusal as refusal:
            if refusal.code in ABSENT:
                return ""
            raise

    def write(self, index: int, value: int, subindex: int = 0) -> None:
        """Write an integer object."""
        named = self._named(index, subindex)
        self.exchange(
            lambda at: self.download(at, index, subindex, value),
            Message("to write {value} to {object}", value, named),
        )

    def refused(self, what: str, error: Exception, code: int) -> Refusal:
        """Return the error for a node that aborts a request."""
        refusal = Refusal(
            Message("{name} at {address} refuses {what}: {error}",
                    self.name, self.address, what, error),
            "an object and a value that the drive supports",
            "compare its object dictionary with cia402.eds",
        )  # fmt: skip
        refusal.code = code
        return refusal

    def _named(self, index: int, subindex: int) -> str:
        """Return number and name of an object, such as "0x6072 (Max torque)"."""
        variable = self.variable(index, subindex)
        return f"0x{index:04X}{f':{subindex}' * bool(subindex)} ({variable.name})"

    def variable(self, index: int, subindex: int) -> Any:
        """Return an object's entry in the dictionary."""
        entry = self.dictionary[index]
        return entry[subindex] if subindex else entry

    def beat(self) -> None:
        """Show the drive that this computer is alive."""
        raise NotImplementedError

    def start_node(self) -> None:
        """Let the node exchange set points."""
        raise NotImplementedError

    def watch(self, write: Callable[[int, int, int], None], watchdog_s: float) -> None:
        """Let the drive remove its power this long after the last sign of life.

        `write` takes index, value and subindex of an object.
        """
        raise NotImplementedError

    def emergency(self) -> str:
        """Return the last emergency message (EMCY) that wasn't reset; empty without one."""
        raise NotImplementedError


class CanopenLink(ObjectLink):
    """One node on a CANopen bus."""

    def __init__(self, name: str, options: Cia402Options) -> None:
        timeout_s = LONGEST_TIME_OUT_S if options.timeout_s is None else options.timeout_s
        super().__init__(name, f"node {options.node} on {options.bus.address}", timeout_s)
        self._options = options
        self._canopen = require_library("canopen", "canopen")
        self._can = require_library("can", "canopen")

    def _open(self) -> Any:
        """Connect to the bus and add the drive's node; the library repeats nothing."""
        if self.reconnects:  # a late answer would reach every reader on the bus
            time.sleep(self.timeout_s)
        network = self._canopen.Network(self._options.bus.open(self.timeout_s))
        network.NOTIFIER_CYCLE = 0.05
        network.connect()
        node = network.add_node(self._options.node, self.dictionary)
        node.sdo.RESPONSE_TIMEOUT = self.timeout_s
        node.sdo.RETRY_DELAY = 0.0
        return network

    def _close(self, connection: Any) -> None:
        connection.disconnect()

    def exchange(self, ask: Callable[[Any], Result], what: str) -> Result:
        """Communicate with the network; `what` names the request in messages."""
        aborted, garbled = self._canopen.SdoAbortedError, self._canopen.SdoCommunicationError
        malformed = (
            self._canopen.ObjectDictionaryError,
            struct.error,
            ValueError,
            TypeError,
            IndexError,
        )

        def question(network: Any) -> Result:
            """Exchange data with the node; turn its failures into the errors of wires."""
            try:
                network.check()
                return ask(network)
            except aborted as error:
                if error.code == TIMED_OUT:
                    raise WireError(Message("{what}: {failure}", what, error)) from error
                raise self.refused(what, error, error.code) from error
            except (garbled, self._can.CanError, EOFError) as error:
                text = str(error) or type(error).__name__
                raise WireError(Message("{what}: {failure}", what, text)) from error
            except malformed as error:
                raise WireError(Message("{what}: garbled answer ({error})", what, error)) from error

        return self.call(question)

    def _node(self, network: Any) -> Any:
        return network[self._options.node]

    def upload(self, connection: Any, index: int, subindex: int) -> Any:
        """Return an object's value."""
        return self._sdo(connection, index, subindex).raw

    def download(self, connection: Any, index: int, subindex: int, value: int) -> None:
        """Write an object's value."""
        self._sdo(connection, index, subindex).raw = value

    def _sdo(self, network: Any, index: int, subindex: int) -> Any:
        sdo = self._node(network).sdo
        return sdo[index][subindex] if subindex else sdo[index]

    def beat(self) -> None:
        """Send this computer's heartbeat once."""
        can_id = 0x700 + self._options.master
        self.exchange(
            lambda network: network.send_message(can_id, bytes([OPERATIONAL])),
            "to send a heartbeat",
        )

    def start_node(self) -> None:
        """Set the node to the NMT state operational."""

        def ask(network: Any) -> None:
            self._node(network).nmt.state = "OPERATIONAL"

        self.exchange(ask, "to start the node")

    def watch(self, write: Callable[[int, int, int], None], watchdog_s: float) -> None:
        """Let the drive monitor this computer's heartbeat, with a fault as its reaction."""
        milliseconds = round(watchdog_s * MS_PER_S)
        write(HEARTBEAT_CONSUMER, self._options.master << 16 | milliseconds, 1)
        write(ABORT_OPTION, ABORT_BY_FAULT, 0)

    def emergency(self) -> str:
        """Return the last emergency message (EMCY) that wasn't reset; empty without one."""

        def ask(network: Any) -> str:
            """Return the drive's active emergency code; empty if there is none."""
            active = self._node(network).emcy.active
            return str(active[-1]).replace("Code ", "EMCY ") if active else ""

        return self.exchange(ask, "to read its emergencies")


class Cia402Drive:
    """A servo drive after CiA 402 with profile torque and profile velocity.

    Torques are rounded to thousandths of the motor's rated torque (object 0x6076). The drive
    controls either torque or speed, never both.

    Parameters
    ----------
    side : {"input", "output"}
    watchdog_s : float
        Time without this computer's heartbeat after which the drive enters its fault state.
    """

    def __init__(
        self, link: ObjectLink, side: Side, options: DriveOptions, watchdog_s: float
    ) -> None:
        self._link = link
        self._side = side
        self._options = options
        self._watchdog_s = watchdog_s
        self._rated_nm = link.read(RATED_TORQUE) / 1e3
        if self._rated_nm <= 0.0:
            raise BenchError(
                Message("{name}: rated torque {rated_nm:g} N·m", link.name, self._rated_nm),
                "above 0 N·m",
                "set object 0x6076 of the drive",
            )
        self._maximum_nm = link.read(MAXIMUM_TORQUE) * self._rated_nm / 1e3
        self._maximum_rad_s = link.read(MAXIMUM_SPEED) / RPM_PER_RAD_S
        self._torque_mode = self._available(PROFILE_TORQUE, CYCLIC_TORQUE)
        self._speed_mode = self._available(PROFILE_VELOCITY, CYCLIC_VELOCITY)
        self._stepper = Stepper(watchdog_s)

    def _available(self, profile: int, cyclic: int) -> int:
        """Return the profile mode, else the cyclic one; refuse a drive that has neither."""
        bits = self._link.read_optional(SUPPORTED_MODES)
        supported = [mode for mode in (profile, cyclic) if not bits or bits >> mode - 1 & 1]
        if not supported:
            raise BenchError(
                Message("{name} has neither mode {profile} nor {cyclic}",
                        self._link.name, profile, cyclic),
                "profile or cyclic synchronous torque and velocity (object 0x6502)",
                "enable the mode in the drive's settings, or take another drive",
            )  # fmt: skip
        return supported[0]

    def identity(self) -> Identity:
        """Read identity and reactions of the drive; objects optional in CiA 301 may be missing."""
        link = self._link
        vendor = link.read(IDENTITY, 1)
        product, revision, serial = (link.read_optional(IDENTITY, sub) for sub in (2, 3, 4))
        product_text = "" if product is None else f"0x{product:X}"
        reactions = {
            "reaction to a fault (0x605E)": link.read_optional(FAULT_REACTION),
            "reaction to quick stop (0x605A)": link.read_optional(QUICK_STOP_OPTION),
        }
        return Identity(
            f"{self._side}.drive",
            f"vendor 0x{vendor:X}",
            link.read_text(DEVICE_NAME) or f"product {product_text}",
            "" if serial is None else str(serial),
            "" if revision is None else f"revision 0x{revision:X}",
            {"product": product_text, "address": link.address}
            | {name: str(value) for name, value in reactions.items() if value is not None},
        )

    def limits(self) -> DriveLimits:
        """Return the limits in objects 0x6072 and 0x6080."""
        return DriveLimits(self._maximum_nm, self._maximum_rad_s)

    # -- state machine ----------------------------------------------------------------------

    def _status(self, word: int | None = None) -> str:
        word = self._link.read(STATUSWORD) if word is None else word
        return next((name for mask, value, name in STATES if word & mask == value), "unknown")

    def _write(self, index: int, value: int, subindex: int = 0) -> None:
        """Write an object; repeat if the drive's state doesn't allow it yet."""
        deadline = time.monotonic() + self._options.switching_s
        while True:
            try:
                return self._link.write(index, value, subindex)
            except Refusal as refusal:
                if refusal.code != NOT_IN_THIS_STATE or time.monotonic() > deadline:
                    raise
            self._link.beat()
            time.sleep(POLL_S)

    def _switch(self, controlword: int, wanted: str) -> None:
        """Write a controlword, and wait for the resulting state."""
        self._write(CONTROLWORD, controlword)
        resets = controlword == FAULT_RESET
        self._await_state(lambda status: status == wanted, wanted, fault_ends=not resets)

    def _await_state(self, reached: Callable[[str], bool], wanted: str, *, fault_ends: bool) -> str:
        """Wait for a state, at most until a fault where that ends the wait.

        Heartbeats are sent meanwhile, since the drive may already expect them.
        """
        deadline = time.monotonic() + self._options.switching_s
        while not reached(status := self._status(word := self._link.read(STATUSWORD))):
            if time.monotonic() > deadline or (fault_ends and status == "fault"):
                raise BenchError(
                    Message(
                        "{name} is in the state {status!r}{reason}",
                        self._link.name,
                        status,
                        self._reason(status, word),
                    ),
                    Message(
                        "the state {wanted!r} within {switching_s:g} s",
                        wanted,
                        self._options.switching_s,
                    ),
                    "read the drive's error code and check its supply and safety circuit",
                )
            self._link.beat()
            time.sleep(POLL_S)
        return status

    def _reason(self, status: str, word: int = REMOTE) -> str:
        """Return the drive's reported fault, or that it doesn't accept the bus's commands."""
        if "fault" not in status:
            return "" if word & REMOTE else ": local control, its remote bit is 0"
        code = self._link.read_optional(ERROR_CODE)
        emergency = self._link.emergency()
        if not code:
            return Message(": {emergency}", emergency or "no error code")
        if code in HEARTBEAT_ERRORS:
            return Message(
                ": error 0x{code:04X}, watchdog not fed for {watchdog_s:g} s",
                code,
                self._watchdog_s,
            )
        if emergency and f"0x{code:04X}" not in emergency:
            return Message(": error 0x{code:04X}; {emergency}", code, emergency)
        name = emergency.partition(", ")[2]
        if name:
            return Message(": error 0x{code:04X} ({name})", code, name)
        return Message(": error 0x{code:04X}", code)

    def enable(self) -> None:
        """Reset a fault, start the heartbeat monitoring, and enable operation at zero torque."""
        link = self._link
        self._stepper.stop()  # it may not have noticed yet that nobody feeds
        link.start_node()
        link.beat()
        link.watch(self._write, self._watchdog_s)
        link.beat()
        status = self._await_state(
            lambda status: status not in BUSY_STATES, "ready", fault_ends=False
        )
        if status == "fault":  # a rising edge of the bit resets, and the bit may still be high
            self._write(CONTROLWORD, DISABLE_VOLTAGE)
            self._switch(FAULT_RESET, "switch on disabled")
        elif status == "quick stop active":
            self._switch(DISABLE_VOLTAGE, "switch on disabled")
        self._write(TARGET_TORQUE, 0)
        self._write(TARGET_VELOCITY, 0)
        self._stepper.feed()
        self._set_mode(self._torque_mode)
        self._switch(SHUT_DOWN, "ready to switch on")
        self._switch(SWITCH_ON, "switched on")
        self._switch(ENABLE_OPERATION, "operation enabled")

    def disable(self) -> None:
        """Switch off the motor's power."""
        self._stepper.stop()
        self._link.write(CONTROLWORD, DISABLE_VOLTAGE)

    def _set_mode(self, mode: int) -> None:
        """Change the drive's mode of operation and wait until it states the new one."""
        if self._link.read(MODE_DISPLAY) == mode:
            return
        self._write(MODE, mode)
        deadline = time.monotonic() + self._options.switching_s
        while (displayed := self._link.read(MODE_DISPLAY)) != mode:
            if time.monotonic() > deadline:
                raise BenchError(
                    Message("{name} stays in mode {shown}", self._link.name, displayed),
                    Message("mode {mode}", mode),
                    "check that the drive supports this mode",
                )
            self._link.beat()
            time.sleep(POLL_S)

    def _check_enabled(self) -> None:
        """Refuse a command to a drive that isn't enabled; say why it isn't."""
        status = self._status()
        if status != "operation enabled":
            raise BenchError(
                Message(
                    "{name} is in the state {status!r}{reason}",
                    self._link.name,
                    status,
                    self._reason(status),
                ),
                "commands to an enabled drive",
                "enable it first",
            )

    # -- commands ---------------------------------------------------------------------------

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        """Go to a torque at a limited rate and keep it."""
        check_drive_order(self._link.name, torque_nm, ramp_nm_per_s, self._maximum_nm, "N·m")
        self._check_enabled()
        if self._torque_mode == CYCLIC_TORQUE:
            self._step_to(CYCLIC_TORQUE, torque_nm, ramp_nm_per_s)
            return
        # Set the target before the mode: the drive follows its target as soon as the mode changes.
        self._stepper.stop()
        self._write(TORQUE_SLOPE, self._slope(ramp_nm_per_s))
        self._write(TARGET_TORQUE, self._permille(torque_nm))
        self._set_mode(PROFILE_TORQUE)

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        """Go to a speed at a limited rate and keep it."""
        check_drive_order(
            self._link.name, speed_rad_s, ramp_rad_per_s2, self._maximum_rad_s, "rad/s"
        )
        self._check_enabled()
        if self._speed_mode == CYCLIC_VELOCITY:
            self._step_to(CYCLIC_VELOCITY, speed_rad_s, ramp_rad_per_s2)
            return
        self._stepper.stop()
        ramp = self._ramp(ramp_rad_per_s2)
        for index in (ACCELERATION, DECELERATION, QUICK_STOP_DECELERATION):
            self._write(index, ramp)
        self._write(TARGET_VELOCITY, self._velocity(speed_rad_s))
        self._set_mode(PROFILE_VELOCITY)

    def _step_to(self, mode: int, target: float, rate: float) -> None:
        """Step from the present set point of a cyclic mode to a target."""
        torque = mode == CYCLIC_TORQUE
        index = TARGET_TORQUE if torque else TARGET_VELOCITY
        units: Callable[[float], int] = self._permille if torque else self._velocity
        self._stepper.stop()
        state = self.state()
        shown = state.torque_nm if torque else state.speed_rad_s
        present = 0.0 if shown is None else shown
        self._write(index, units(present))
        self._set_mode(mode)
        write = self._link.write
        self._stepper.go(lambda value: write(index, units(value)), present, target, rate)

    def quick_stop(self) -> None:
        """Stop the drive with its quick-stop ramp; it stays in the state quick stop."""
        self._stepper.stop()
        self._link.write(CONTROLWORD, QUICK_STOP)

    def ramp_to_zero(self, duration_s: float) -> None:
        """Make the drive ramp torque or speed to zero by itself.

        A drive that refuses the ramp or the set point is stopped by its quick stop.
        """
        try:
            self._ramp_to_zero(duration_s)
        except BenchError:
            self.quick_stop()

    def _ramp_to_zero(self, duration_s: float) -> None:
        """Ramp torque and speed to zero within a duration, in the mode that the drive is in."""
        present = self.state()
        seconds = max(duration_s, 1e-3)
        for mode, value in (
            (CYCLIC_TORQUE, present.torque_nm),
            (CYCLIC_VELOCITY, present.speed_rad_s),
        ):
            if value is not None and mode in (self._torque_mode, self._speed_mode):
                self._step_to(mode, 0.0, max(abs(value) / seconds, 1e-9))
                return
        if present.torque_nm is not None:
            self._link.write(TORQUE_SLOPE, self._slope(abs(present.torque_nm) / seconds))
        if present.speed_rad_s is not None:
            self._link.write(DECELERATION, self._ramp(abs(present.speed_rad_s) / seconds))
        self._link.write(TARGET_TORQUE, 0)
        self._link.write(TARGET_VELOCITY, 0)

    def _permille(self, torque_nm: float) -> int:
        return round(1e3 * torque_nm / self._rated_nm)

    def _slope(self, rate_nm_per_s: float) -> int:
        """Return a rate of torque as the drive has it: in ‰ of rated torque per second."""
        return min(LARGEST_SLOPE, max(1, math.ceil(1e3 * rate_nm_per_s / self._rated_nm)))

    def _ramp(self, rate_rad_per_s2: float) -> int:
        return min(LARGEST_SLOPE, max(1, abs(self._velocity(rate_rad_per_s2))))

    def _velocity(self, speed_rad_s: float) -> int:
        return round(speed_rad_s * RPM_PER_RAD_S * self._options.velocity_units_per_rpm)

    def feed_watchdog(self) -> None:
        """Send the heartbeat that the drive monitors."""
        self._link.beat()
        self._stepper.feed()

    def state(self) -> DriveState:
        """Request the set point of the active mode and the fault state."""
        self._stepper.check()
        word = self._link.read(STATUSWORD)
        status = self._status(word)
        mode = self._link.read(MODE_DISPLAY)
        torque_nm = speed_rad_s = None
        if mode in (PROFILE_VELOCITY, CYCLIC_VELOCITY):
            units = self._link.read(VELOCITY_DEMAND)
            speed_rad_s = units / self._options.velocity_units_per_rpm / RPM_PER_RAD_S
        else:
            torque_nm = self._link.read(TORQUE_DEMAND) * self._rated_nm / 1e3
        enabled = status == "operation enabled"
        fault = f"{status}{self._reason(status)}" if "fault" in status else ""
        return DriveState(
            enabled,
            torque_nm,
            speed_rad_s,
            fault,
            limited=bool(word & INTERNAL_LIMIT),
            remote=bool(word & REMOTE),
        )

    def position_counts(self) -> int:
        """Request the position of the drive's encoder, 32 bits."""
        return int(self._link.read(POSITION))

    def close(self) -> None:
        """Release the drive. A second call does nothing."""
        self._stepper.close()
        with contextlib.suppress(BenchError):
            self._link.close()


def _drive(request: InstrumentRequest) -> Cia402Drive:
    """Open a side's drive, with a time-out that its watchdog allows."""
    assert request.side is not None
    options: Cia402Options = request.read(Cia402Options)
    watchdog_s, timeout_s = request.drive_times(options.timeout_s)
    link = CanopenLink(request.name, options.model_copy(update={"timeout_s": timeout_s}))
    with link.kept():
        return Cia402Drive(link, request.side, options, watchdog_s)


PLUGIN = DriverPlugin("canopen", {"drive": _drive})
"""Plug-in for `protocol = "canopen"`."""
