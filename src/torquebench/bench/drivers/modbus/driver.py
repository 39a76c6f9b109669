"""Drives, probes, read-outs, mode conversion and clamp over Modbus TCP (pymodbus).

The register map is in `register_map` and in docs/reference/device-protocols.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

from torquebench.bench.drivers.base import DriveLimits, DriveState, Identity
from torquebench.bench.drivers.fixture import (
    FixtureClamp,
    FixtureModes,
    FixtureRail,
    FixtureSupply,
)
from torquebench.bench.drivers.links import (
    SwitchingTime,
    check_drive_order,
    wait_until_enabled,
)
from torquebench.bench.drivers.modbus import register_map
from torquebench.bench.drivers.modbus.device_map import device_map
from torquebench.bench.drivers.modbus.link import ModbusLink, ModbusOptions
from torquebench.bench.drivers.modbus.modules import (
    AnglesOptions,
    DigitalOptions,
    ModbusAngles,
    ModbusFixture,
    ModbusReadout,
    ModbusTemperature,
    TemperatureOptions,
)
from torquebench.bench.drivers.modbus.register_map import (
    DriveCommand,
    DriveControl,
    DriveMode,
    DriveReport,
    DriveStatus,
)
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest
from torquebench.bench.roles import Side
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.units import MS_PER_S

REPORT_LENGTH = 14


class DriveOptions(ModbusOptions):
    """Options of a drive: the longest time until it is ready."""

    switching_s: SwitchingTime = 5.0


class ModbusDrive:
    """A servo drive on Modbus TCP with torque and speed control, ramps and watchdog.

    Parameters
    ----------
    side : {"input", "output"}
    watchdog_s : float
        Time without feeding after which the drive ramps to zero and disables itself, s.
    switching_s : float
        Longest time until the drive is ready, s.
    """

    def __init__(
        self, link: ModbusLink, side: Side, watchdog_s: float, switching_s: float = 5.0
    ) -> None:
        self._switching_s = switching_s
        self._link = link
        self._side = side
        self._watchdog_ms = round(watchdog_s * MS_PER_S)
        self._fed = 0
        words = link.input_registers(DriveReport.MAXIMUM_TORQUE, 4)
        self._limits = DriveLimits(
            register_map.float_of(words[:2]), register_map.float_of(words[2:])
        )

    def identity(self) -> Identity:
        """Read the identity of the drive."""
        return self._link.identity(f"{self._side}.drive")

    def limits(self) -> DriveLimits:
        """Return the limits in the register map."""
        return self._limits

    def enable(self) -> None:
        """Reset a fault, start the watchdog, and power the motor at zero torque and speed."""
        self._link.write(DriveCommand.WATCHDOG, [self._next_feed(), self._watchdog_ms])
        self._link.write(DriveCommand.CONTROL, [DriveControl.RESET, DriveMode.NONE])
        self._link.write(DriveCommand.CONTROL, [DriveControl.ENABLE, DriveMode.NONE])
        wait_until_enabled(self, self._link.name, self._switching_s)

    def disable(self) -> None:
        """Switch off the motor's power."""
        self._link.write(DriveCommand.CONTROL, [0, DriveMode.NONE])

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        """Go to a torque at a limited rate and keep it."""
        self._command(DriveMode.TORQUE, torque_nm, ramp_nm_per_s, self._limits.torque_nm, "N·m")

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        """Go to a speed at a limited rate and keep it."""
        self._command(
            DriveMode.SPEED, speed_rad_s, ramp_rad_per_s2, self._limits.speed_rad_s, "rad/s"
        )

    def _command(
        self, mode: DriveMode, value: float, rate: float, maximum: float, unit: str
    ) -> None:
        """Write set point and mode to the drive; refuse a drive that is off."""
        check_drive_order(self._link.name, value, rate, maximum, unit)
        register = DriveCommand.TORQUE if mode is DriveMode.TORQUE else DriveCommand.SPEED
        numbers = [*register_map.from_float(value), *register_map.from_float(rate)]
        self._link.write(register, numbers)
        self._link.write(DriveCommand.CONTROL, [DriveControl.ENABLE, mode])
        if not self.state().enabled:
            raise BenchError(
                Message("{name} is off", self._link.name),
                "commands to an enabled drive",
                "enable it first",
            )

    def ramp_to_zero(self, duration_s: float) -> None:
        """Make the drive ramp torque and speed to zero by itself."""
        self._link.write(DriveCommand.ZERO_RAMP, register_map.from_float(duration_s))
        self._link.write(DriveCommand.CONTROL, [DriveControl.ENABLE | DriveControl.ZERO])

    def feed_watchdog(self) -> None:
        """Reset the drive's watchdog."""
        self._link.write(DriveCommand.WATCHDOG, [self._next_feed()])

    def _next_feed(self) -> int:
        self._fed = (self._fed + 1) % 65536
        return self._fed

    def state(self) -> DriveState:
        """Request the active set points and the fault state."""
        words = self._link.input_registers(0, REPORT_LENGTH)
        status = words[DriveReport.STATUS]
        fault = ""
        if status & DriveStatus.WATCHDOG:
            fault = Message("watchdog not fed for {watchdog_s:g} s", self._watchdog_ms / MS_PER_S)
        elif status & DriveStatus.FAULT:
            fault = Message("fault code {words}", words[DriveReport.FAULT])
        torque = register_map.float_of(words[DriveReport.TORQUE : DriveReport.TORQUE + 2])
        speed = register_map.float_of(words[DriveReport.SPEED : DriveReport.SPEED + 2])
        if not (math.isfinite(torque) and math.isfinite(speed)):
            raise BenchError(
                Message(
                    "{name} reports {torque:g} N·m and {speed:g} rad/s",
                    self._link.name,
                    torque,
                    speed,
                ),
                "finite set points",
                "check the drive and its register map",
            )
        return DriveState(bool(status & DriveStatus.ENABLED), torque, speed, fault)

    def position_counts(self) -> int:
        """Request the position of the drive's encoder, 32 bits."""
        return register_map.integer_of(self._link.input_registers(DriveReport.POSITION, 2))

    def close(self) -> None:
        """Release the drive. A second call does nothing."""
        self._link.close()


def _link(request: InstrumentRequest, options: ModbusOptions) -> ModbusLink:
    return ModbusLink(request.name, options)


def _drive(request: InstrumentRequest) -> ModbusDrive:
    """Open a side's drive, with a time-out that its watchdog allows."""
    assert request.side is not None
    options: DriveOptions = request.read(DriveOptions)
    described_s = options.timeout_s if "timeout_s" in options.model_fields_set else None
    watchdog_s, timeout_s = request.drive_times(described_s)
    link = _link(request, options.model_copy(update={"timeout_s": timeout_s}))
    with link.kept():
        return ModbusDrive(link, request.side, watchdog_s, options.switching_s)


def _temperature(request: InstrumentRequest) -> ModbusTemperature:
    options: TemperatureOptions = request.read(TemperatureOptions)
    request.check_probes(options.probes)
    device = device_map(options, request.section)
    with _link(request, options).kept() as link:
        return ModbusTemperature(link, options, device)


def _readout(request: InstrumentRequest) -> ModbusReadout:
    return ModbusReadout(_link(request, request.read(ModbusOptions)))


Part = TypeVar("Part", FixtureModes, FixtureClamp, FixtureRail, FixtureSupply)


def _digital(kind: type[Part]) -> Callable[[InstrumentRequest], Part]:
    """Return the function that opens a module with coils and contacts."""

    def opened(request: InstrumentRequest) -> Part:
        """Open the device's digital inputs and outputs as modes or clamp."""
        options: DigitalOptions = request.read(DigitalOptions)
        device = device_map(options, request.section)
        return kind(ModbusFixture(_link(request, options), options, device), options.travel_s)

    return opened


def _angles(request: InstrumentRequest) -> ModbusAngles:
    options: AnglesOptions = request.read(AnglesOptions)
    with _link(request, options).kept() as link:
        return ModbusAngles(link, options)


PLUGIN = DriverPlugin(
    "modbus",
    {
        "drive": _drive,
        "temperature": _temperature,
        "reference": _readout,
        "modes": _digital(FixtureModes),
        "clamp": _digital(FixtureClamp),
        "rail": _digital(FixtureRail),
        "supply": _digital(FixtureSupply),
        "angles": _angles,
    },
)
"""Plug-in for `protocol = "modbus"`."""
