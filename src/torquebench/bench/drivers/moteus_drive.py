"""A moteus controller (mjbots) behind an fdcanusb adapter: torque and velocity of open actuators.

Frames are those of the `moteus` package. The controller doesn't ramp its torque: this computer
steps it. Each command states after which time without another one the controller stops.
"""

from __future__ import annotations

import math
import time
from typing import Annotated, Any

from pydantic import Field

from torquebench.bench.drivers.base import DriveLimits, DriveState, Identity
from torquebench.bench.drivers.lines import LineConnection, LineLink, LineOptions
from torquebench.bench.drivers.links import (
    SwitchingTime,
    TimeOut,
    WireError,
    wait_until_enabled,
)
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest, require_library
from torquebench.bench.drivers.stepping import SteppedDrive
from torquebench.bench.roles import Side
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.units import RAD_S_PER_RPM, TURN

COUNTS_PER_TURN = 100_000
"""Resolution of the position register, counts per turn of the motor."""
REPLY, BUS_SIZES, NO_OPERATION = 0x8000, (*range(9), 12, 16, 20, 24, 32, 48, 64), b"\x50"
MOST_FOREIGN = 50
"""Largest number of frames of other nodes that are skipped before an answer."""
SHORTEST_TIME_S = 0.01


class MoteusOptions(LineOptions):
    """Port of the adapter, the controller's number, and the largest set points."""

    node: Annotated[int, Field(ge=1, le=126)] = 1
    maximum_torque_nm: Annotated[float, Field(gt=0.0, le=1e4, description="N·m")]
    maximum_speed_rpm: Annotated[float, Field(gt=0.0, le=1e5, description="rpm")]
    switching_s: SwitchingTime = 5.0
    timeout_s: TimeOut | None = None


class MoteusLink(LineLink):
    """An fdcanusb adapter with one controller."""

    def __init__(self, name: str, options: MoteusOptions, timeout_s: float) -> None:
        super().__init__(name, options, timeout_s)
        self.library = require_library("moteus", "moteus")
        self._node = options.node

    def exchange(self, command: Any) -> dict[int, float]:
        """Send a command and return the registers of its answer."""
        size = next(size for size in BUS_SIZES if size >= len(command.data))
        data = command.data.ljust(size, NO_OPERATION)
        line = f"can send {REPLY | self._node:04x} {data.hex()} BF"

        def ask(connection: LineConnection) -> dict[int, float]:
            """Send a line and return this drive's registers; skip other drives' answers."""
            connection.send(line)
            deadline = time.monotonic() + self.timeout_s
            for _ in range(MOST_FOREIGN):
                answer = connection.receive(max(0.0, deadline - time.monotonic()))
                if answer.startswith("ERR"):
                    raise WireError(answer[:60])
                words = answer.split()
                if words[:1] != ["rcv"] or len(words) < 3:
                    continue
                try:
                    source, raw = int(words[1], 16) >> 8 & 0x7F, bytes.fromhex(words[2])
                    registers = self.library.parse_registers(raw).response
                except (ValueError, RuntimeError, IndexError, KeyError) as error:
                    raise WireError(Message("garbled answer {line!r}", answer[:20])) from error
                if source == self._node:
                    return {int(register): value for register, value in registers.items()}
            raise WireError("no answer")

        return self.call(ask)


class MoteusDrive(SteppedDrive):
    """A motor with a moteus controller.

    Parameters
    ----------
    side : {"input", "output"}
    watchdog_s : float
        Time without feeding after which the controller goes to its time-out mode, s.
    """

    def __init__(
        self, link: MoteusLink, side: Side, options: MoteusOptions, watchdog_s: float
    ) -> None:
        largest_rad_s = options.maximum_speed_rpm * RAD_S_PER_RPM
        super().__init__(link, DriveLimits(options.maximum_torque_nm, largest_rad_s), watchdog_s)
        self._link, self._side, self._options = link, side, options
        self._watchdog_s = watchdog_s
        moteus = link.library
        self._register, self._mode = moteus.Register, moteus.Mode
        resolution = moteus.QueryResolution()
        resolution.position = moteus.INT32
        resolution._extra = {
            self._register.CONTROL_VELOCITY: moteus.F32,
            self._register.CONTROL_TORQUE: moteus.F32,
        }
        self._controller = moteus.Controller(
            id=options.node, query_resolution=resolution, transport=object()
        )
        self._fed_s = time.monotonic()
        self._read()

    def _read(self, command: Any = None) -> dict[int, float]:
        """Send a command, or only ask; return the state with all registers that are needed."""
        registers = self._link.exchange(command or self._controller.make_query())
        register = self._register
        needed = (register.MODE, register.POSITION, register.FAULT)
        if any(name not in registers for name in (*needed, register.CONTROL_TORQUE)):
            raise BenchError(
                Message("{name} states no {register}", self._link.name, "mode or control torque"),
                "a controller with firmware of 2023 or later",
                "update its firmware",
            )
        return registers

    def identity(self) -> Identity:
        """Read the controller's serial number and firmware."""
        register, moteus = self._register, self._link.library
        numbers = (register.SERIAL_NUMBER, register.SERIAL_NUMBER2, register.SERIAL_NUMBER3)
        wanted = dict.fromkeys((*numbers, register.FIRMWARE_VERSION), moteus.INT32)
        found = self._link.exchange(self._controller.make_custom_query(wanted))
        serial = "".join(f"{int(found.get(name, 0)) & 0xFFFFFFFF:08X}" for name in numbers)
        version = int(found.get(register.FIRMWARE_VERSION, 0)) & 0xFFFFFFFF
        details = {"address": self._link.address, "node": str(self._options.node)}
        return Identity(f"{self._side}.drive", "mjbots", "moteus", serial, f"{version:X}", details)

    def _command(self) -> None:
        """Send the present set point, for the rest of the watchdog's time."""
        set_point: dict[str, float] = {"feedforward_torque": 0.0, "velocity": 0.0}
        if self._speed_control:
            set_point["velocity"] = self._set_point / TURN
        else:
            set_point |= {"feedforward_torque": self._set_point, "kp_scale": 0.0, "kd_scale": 0.0}
        left_s = self._watchdog_s - (time.monotonic() - self._fed_s)
        self._read(
            self._controller.make_position(
                position=math.nan,
                maximum_torque=self._options.maximum_torque_nm,
                watchdog_timeout=max(SHORTEST_TIME_S, left_s),
                query=True,
                **set_point,
            )
        )

    def _switch_off(self) -> None:
        self._read(self._controller.make_stop(query=True))

    def enable(self) -> None:
        """Reset a fault or a time-out, and control zero torque."""
        self.disable()
        self._control(speed=False)
        self._fed_s = time.monotonic()
        self._stepper.feed()
        self._on = True
        self._send()
        wait_until_enabled(self, self._link.name, self._options.switching_s)

    def feed_watchdog(self) -> None:
        """Repeat the present set point, if the controller is on: it would start a stopped one."""
        self._fed_s = time.monotonic()
        self._stepper.feed()
        if int(self._read()[self._register.MODE]) == self._mode.POSITION:
            self._send()

    def state(self) -> DriveState:
        """Request the active set points and the fault state."""
        self._stepper.check()
        registers = self._read()
        mode, fault = int(registers[self._register.MODE]), ""
        if mode == self._mode.TIMEOUT:
            fault = Message("watchdog not fed for {watchdog_s:g} s", self._watchdog_s)
        elif mode == self._mode.FAULT:
            fault = Message("fault code {words}", int(registers[self._register.FAULT]))
        enabled = mode == self._mode.POSITION
        if self._speed_control:
            turns_s = registers[self._register.CONTROL_VELOCITY] if enabled else 0.0
            return DriveState(enabled, None, turns_s * TURN, fault)
        torque_nm = registers[self._register.CONTROL_TORQUE] if enabled else 0.0
        return DriveState(enabled, torque_nm, None, fault)

    def position_counts(self) -> int:
        """Request the position, `COUNTS_PER_TURN` per turn of the motor."""
        counts = round(self._read()[self._register.POSITION] * COUNTS_PER_TURN)
        return (counts + 2**31) % 2**32 - 2**31


def _drive(request: InstrumentRequest) -> MoteusDrive:
    """Open a side's drive, with a time-out that its watchdog allows."""
    assert request.side is not None
    options: MoteusOptions = request.read(MoteusOptions)
    watchdog_s, timeout_s = request.drive_times(options.timeout_s)
    with MoteusLink(request.name, options, timeout_s).kept() as link:
        assert isinstance(link, MoteusLink)
        return MoteusDrive(link, request.side, options, watchdog_s)


PLUGIN = DriverPlugin("moteus", {"drive": _drive})
"""Plug-in for `protocol = "moteus"`."""
