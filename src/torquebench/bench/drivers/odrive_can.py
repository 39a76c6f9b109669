"""An ODrive controller on a CAN bus (CANSimple of firmware 0.6): torque and velocity of a motor.

The controller knows no ramp of this computer's rate: this computer steps its set point. Each set
point feeds the controller's watchdog, which is set in the controller itself.
"""

from __future__ import annotations

import struct
import time
from typing import Annotated, Any

from pydantic import Field

from torquebench.bench.drivers.base import DriveLimits, DriveState, Identity
from torquebench.bench.drivers.can_bus import BusOptions
from torquebench.bench.drivers.links import (
    POLL_S,
    Link,
    SwitchingTime,
    TimeOut,
    WireError,
    wait_until_enabled,
)
from torquebench.bench.drivers.plugins import (
    DriverPlugin,
    InstrumentRequest,
    Options,
    require_library,
)
from torquebench.bench.drivers.stepping import SteppedDrive
from torquebench.bench.roles import Side
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.units import RAD_S_PER_RPM, TURN

COUNTS_PER_TURN = 100_000
"""Resolution of `position_counts`, counts per turn of the motor."""
VERSION, HEARTBEAT, ADDRESS, SET_STATE = 0x00, 0x01, 0x06, 0x07
ENCODER, SET_MODE, SET_VELOCITY, SET_TORQUE = 0x09, 0x0B, 0x0D, 0x0E
CLEAR_ERRORS, TORQUES = 0x18, 0x1C
IDLE, CLOSED_LOOP = 1, 8
TORQUE_CONTROL, VELOCITY_CONTROL, PASSTHROUGH = 1, 2, 1
WATCHDOG_EXPIRED = 0x0100_0000
OLDEST_FIRMWARE = (0, 6)
MOST_QUEUED = 10_000


class OdriveOptions(Options):
    """One controller on a bus, and its largest set points."""

    bus: BusOptions
    node: Annotated[int, Field(ge=0, le=62)] = 0
    maximum_torque_nm: Annotated[float, Field(gt=0.0, le=1e4, description="N·m")]
    maximum_speed_rpm: Annotated[float, Field(gt=0.0, le=1e5, description="rpm")]
    switching_s: SwitchingTime = 5.0
    timeout_s: TimeOut | None = None


class OdriveLink(Link[Any]):
    """One node on a CAN bus; its heartbeats are kept as they arrive."""

    def __init__(self, name: str, options: OdriveOptions, timeout_s: float) -> None:
        super().__init__(name, f"node {options.node} on {options.bus.address}", timeout_s)
        self._can = require_library("can", "canopen")
        self._options = options
        self._heartbeat = (0, 0)
        self._heard_s = self._emptied_s = float("-inf")

    def _open(self) -> Any:
        self._heard_s = self._emptied_s = float("-inf")
        return self._options.bus.open(self.timeout_s)

    def _close(self, connection: Any) -> None:
        connection.shutdown()

    def _next(self, bus: Any, wait_s: float) -> tuple[int, bytes] | None:
        """Return the node's next message as command and data; None if none arrives in time."""
        deadline = time.monotonic() + wait_s
        while (frame := bus.recv(max(0.0, deadline - time.monotonic()))) is not None:
            if frame.is_extended_id or frame.arbitration_id >> 5 != self._options.node:
                continue
            command, data = frame.arbitration_id & 0x1F, bytes(frame.data)
            if command == HEARTBEAT and len(data) >= 5:
                self._heartbeat, self._heard_s = struct.unpack_from("<IB", data), time.monotonic()
            return command, data
        return None

    def _empty(self, bus: Any) -> None:
        """Read what has arrived since the last time."""
        for _ in range(MOST_QUEUED):
            if self._next(bus, 0.0) is None:
                break
        now_s = time.monotonic()
        if now_s - self._emptied_s > self.timeout_s:  # these heartbeats may be old
            self._heard_s = float("-inf")
        self._emptied_s = now_s

    def _await(self, bus: Any, wanted: int) -> bytes:
        deadline = time.monotonic() + self.timeout_s
        while (message := self._next(bus, deadline - time.monotonic())) is not None:
            if message[0] == wanted:
                return message[1]
        raise WireError("no answer")

    def _exchange(self, question: Any) -> Any:
        """Return the node's answer to a question; translate the library's errors."""

        def ask(bus: Any) -> Any:
            try:
                self._empty(bus)
                return question(bus)
            except (self._can.CanError, struct.error) as error:
                raise WireError(str(error) or type(error).__name__) from error

        return self.call(ask)

    def _send(self, bus: Any, command: int, data: bytes) -> None:
        number = self._options.node << 5 | command
        bus.send(self._can.Message(arbitration_id=number, data=data, is_extended_id=False))

    def tell(self, command: int, layout: str, *values: float) -> None:
        """Send a command."""
        data = struct.pack(layout, *values)
        self._exchange(lambda bus: self._send(bus, command, data))
        if command in (SET_STATE, CLEAR_ERRORS):  # what was heard before is no longer so
            self._heard_s = float("-inf")

    def request(self, command: int, layout: str) -> tuple[Any, ...]:
        """Request a message of the node, and return its values."""

        def question(bus: Any) -> tuple[Any, ...]:
            self._send(bus, command, b"")
            return struct.unpack_from(layout, self._await(bus, command))

        found: tuple[Any, ...] = self._exchange(question)
        return found

    def heartbeat(self) -> tuple[int, int]:
        """Return errors and state of the last heartbeat, at most `timeout_s` old."""

        def question(bus: Any) -> tuple[int, int]:
            if time.monotonic() - self._heard_s > self.timeout_s:
                self._await(bus, HEARTBEAT)
            return self._heartbeat

        found: tuple[int, int] = self._exchange(question)
        return found


class OdriveDrive(SteppedDrive):
    """A motor with an ODrive controller.

    Parameters
    ----------
    side : {"input", "output"}
    watchdog_s : float
        Time without feeding after which the motor is without power: half of it until this computer
        sends no more set points, and half for the controller's own watchdog.
    """

    def __init__(
        self, link: OdriveLink, side: Side, options: OdriveOptions, watchdog_s: float
    ) -> None:
        largest_rad_s = options.maximum_speed_rpm * RAD_S_PER_RPM
        limits = DriveLimits(options.maximum_torque_nm, largest_rad_s)
        super().__init__(link, limits, 0.5 * watchdog_s)
        self._link, self._side, self._options = link, side, options
        self._watchdog_s = watchdog_s
        self._version = link.request(VERSION, "<8B")
        if self._version[4:6] < OLDEST_FIRMWARE:
            raise BenchError(
                Message("{name}: firmware {firmware}", link.name, self._firmware),
                "firmware 0.6 or later, whose watchdog is fed by set points only",
                "update its firmware",
            )

    @property
    def _firmware(self) -> str:
        return ".".join(str(number) for number in self._version[4:7])

    def identity(self) -> Identity:
        """Read the controller's serial number and firmware."""
        node, *serial = self._link.request(ADDRESS, "<7B")
        number = f"{int.from_bytes(bytes(serial), 'little'):012X}"
        model = "ODrive " + ".".join(str(part) for part in self._version[1:4])
        details = {"address": self._link.address, "node": str(node)}
        return Identity(f"{self._side}.drive", "ODrive", model, number, self._firmware, details)

    def _command(self) -> None:
        if self._speed_control:
            self._link.tell(SET_VELOCITY, "<ff", self._set_point / TURN, 0.0)
        else:
            self._link.tell(SET_TORQUE, "<f", self._set_point)

    def _switch_off(self) -> None:
        self._link.tell(SET_STATE, "<I", IDLE)

    def _control(self, *, speed: bool) -> None:
        """Change what is controlled, beginning at a set point of zero."""
        with self._sending:
            super()._control(speed=speed)
            self._command()
            mode = VELOCITY_CONTROL if speed else TORQUE_CONTROL
            self._link.tell(SET_MODE, "<II", mode, PASSTHROUGH)

    def enable(self) -> None:
        """Clear errors, and control zero torque."""
        self.disable()
        self._link.tell(CLEAR_ERRORS, "<B", 0)
        deadline = time.monotonic() + self._options.switching_s
        while self._link.heartbeat()[0] and time.monotonic() < deadline:
            time.sleep(POLL_S)
        self._control(speed=False)
        self._stepper.feed()
        self._on = True
        self._link.tell(SET_STATE, "<I", CLOSED_LOOP)
        wait_until_enabled(self, self._link.name, self._options.switching_s)

    def state(self) -> DriveState:
        """Return the state of the last heartbeat, and request the active torque.

        The controller doesn't state its set point of velocity: the last one sent is returned.
        """
        self._stepper.check()
        torque_nm = float(self._link.request(TORQUES, "<ff")[0])  # asked, so that silence shows
        errors, state = self._link.heartbeat()
        enabled, fault = state == CLOSED_LOOP, ""
        if errors & WATCHDOG_EXPIRED:
            fault = Message("watchdog not fed for {watchdog_s:g} s", self._watchdog_s)
        elif errors:
            fault = Message("error 0x{code:08X}", errors)
        if self._speed_control:
            return DriveState(enabled, None, self._set_point if enabled else 0.0, fault)
        return DriveState(enabled, torque_nm if enabled else 0.0, None, fault)

    def position_counts(self) -> int:
        """Request the position, `COUNTS_PER_TURN` per turn of the motor."""
        counts = round(float(self._link.request(ENCODER, "<ff")[0]) * COUNTS_PER_TURN)
        return (counts + 2**31) % 2**32 - 2**31


def _drive(request: InstrumentRequest) -> OdriveDrive:
    assert request.side is not None
    options: OdriveOptions = request.read(OdriveOptions)
    watchdog_s, timeout_s = request.drive_times(options.timeout_s)
    with OdriveLink(request.name, options, timeout_s).kept() as link:
        return OdriveDrive(link, request.side, options, watchdog_s)


PLUGIN = DriverPlugin("odrive", {"drive": _drive})
"""Plug-in for `protocol = "odrive"`."""
