"""A bench of separate instruments, one in each section of `[driver]`, by role and protocol.

```toml
[bench]
driver = "instruments"

[driver.counter]
protocol = "nidaqmx"
...
[driver.input_drive]
protocol = "modbus"
...
```
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.angles import CounterWithAngles, DriveAngles
from torquebench.bench.drivers.base import (
    Drive,
    DriveLimits,
    DriverSet,
    DriveState,
    Identity,
    Positioned,
)
from torquebench.bench.drivers.links import Address, check_drive_order
from torquebench.bench.drivers.plugins import InstrumentRequest, Role, find_plugin
from torquebench.bench.drivers.simulated.control import (
    SimulatedOperator,
    SimulatedTruth,
    SimulationControl,
    simulated_certificates,
    simulated_encoder_certificates,
    simulated_reducer_certificate,
)
from torquebench.bench.prompts import PromptQueue, QueuedOperator
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.validation import validated

_ROLES: dict[str, tuple[Role, Side | None]] = {
    "counter": ("counter", None),
    "angles": ("angles", None),
    "input_drive": ("drive", "input"),
    "output_drive": ("drive", "output"),
    "reference": ("reference", None),
    "temperature": ("temperature", None),
    "modes": ("modes", None),
    "clamp": ("clamp", None),
    "guide_rail": ("rail", None),
    "power_supply": ("supply", None),
}
BY_DRIVES = "drives"
"""Protocol of `[driver.angles]` if the drives' own encoders measure the angles."""
ROLES = tuple(_ROLES)
"""Sections of a bench description, one for each instrument."""


class SimulationOptions(BaseModel):
    """Section `[driver.simulation]`: the instruments are simulators with these settings.

    With `time` "on-demand", bench time advances when the counter is read, as fast as possible; with
    "real" it follows the wall clock. On opening, the simulators report with which of the two they
    were started.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    control: Address
    time: Literal["on-demand", "real"] = "on-demand"
    preset: Literal["nominal", "worn"] = "nominal"
    seed: int = Field(default=1, ge=0, le=2**32 - 1, description="(any seed)")
    ambient_c: float | None = Field(default=None, ge=-10, le=50, description="°C")


class InstrumentsOptions(BaseModel):
    """Section `[driver]` of a bench of separate instruments, one section for each instrument."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    counter: Mapping[str, Any]
    input_drive: Mapping[str, Any]
    output_drive: Mapping[str, Any]
    modes: Mapping[str, Any]
    clamp: Mapping[str, Any]
    temperature: Mapping[str, Any]
    reference: Mapping[str, Any] | None = None
    angles: Mapping[str, Any] | None = None
    guide_rail: Mapping[str, Any] | None = None
    power_supply: Mapping[str, Any] | None = None
    simulation: SimulationOptions | None = None


def open_instruments(description: BenchDescription) -> DriverSet:
    """Open every instrument that a description names.

    Raises
    ------
    InputError
        A section is missing or wrong, a protocol unknown or its library not installed.
    BenchError
        An instrument doesn't answer; the instruments opened before are closed.
    """
    source = f"{description.name}: driver"
    options: InstrumentsOptions = validated(InstrumentsOptions, description.driver, source)
    with contextlib.ExitStack() as opened:

        def open_one(key: str) -> Any:
            """Open an instrument that is closed with the others."""
            instrument = _open(description, key, getattr(options, key))
            if hasattr(instrument, "close"):
                opened.callback(instrument.close)
            return instrument

        control, on_demand = None, False
        if options.simulation is not None:
            control = SimulationControl(options.simulation.control)
            opened.callback(control.close)
            on_demand = _running(control, description.name)["time"] == "on-demand"
        drives: dict[Side, Drive] = {
            "input": open_one("input_drive"),
            "output": open_one("output_drive"),
        }
        counter = open_one("counter")
        if options.angles is not None:
            _check_needs_angles(counter)
            window_s = description.counter.window_s
            by_drives = options.angles.get("protocol") == BY_DRIVES
            encoders = DriveAngles(drives) if by_drives else open_one("angles")
            counter = CounterWithAngles(counter, encoders, window_s, not on_demand)
        return DriverSet(
            name="instruments",
            counter=counter,
            drives=drives,
            modes=open_one("modes"),
            clamp=open_one("clamp"),
            temperature=open_one("temperature"),
            operator=QueuedOperator(PromptQueue())
            if control is None
            else SimulatedOperator(control),
            reference=None if options.reference is None else open_one("reference"),
            rail=None if options.guide_rail is None else open_one("guide_rail"),
            supply=None if options.power_supply is None else open_one("power_supply"),
            truth=None if control is None else SimulatedTruth(control),
            certificates={} if control is None else simulated_certificates(control),
            encoder_certificates={} if control is None else simulated_encoder_certificates(control),
            reducer_certificate=() if control is None else simulated_reducer_certificate(control),
            simulated_time=on_demand,
            shortest_read_s=float(getattr(counter, "shortest_read_s", 0.0)),
            resources=opened.pop_all(),
        )


def _check_needs_angles(counter: object) -> None:
    """Refuse separate angles beside a counter that times the encoders itself."""
    if getattr(counter, "times_encoders", False):
        raise InputError(
            "driver.angles and a counter that reads the encoders itself",
            "one of the two",
            "remove the section [driver.angles]",
        )


def _running(control: SimulationControl, bench: str) -> dict[str, Any]:
    """Return the state of the simulators; if they don't run, the error says how to start them."""
    try:
        return control.ask("status")
    except BenchError as error:
        raise BenchError(
            Message(
                "the instruments of {bench} are simulated, and no simulators answer ({found})",
                bench,
                error.found,
            ),
            "running simulators",
            "start them in another terminal with `torquebench simulate --bench FILE`, the same "
            "file, and leave it open",
        ) from error


def open_role(description: BenchDescription, key: str) -> Any:
    """Open a single instrument of a bench, for `doctor` and for tests of its driver.

    Parameters
    ----------
    key : str
        Its section: "counter", "angles", "input_drive", "output_drive", "reference",
        "temperature", "modes", "clamp", "guide_rail" or "power_supply".

    Raises
    ------
    InputError, BenchError
        Like `open_instruments`.
    """
    source = Message("{name}: driver", description.name)
    options: InstrumentsOptions = validated(InstrumentsOptions, description.driver, source)
    section = getattr(options, key)
    if section is None:
        raise InputError(Message("{source}.{key} is missing", source, key), "a section", "add it")
    if key == "angles" and section.get("protocol") == BY_DRIVES:
        return _OwnDriveAngles(description)
    return _open(description, key, section)


def _open(description: BenchDescription, key: str, section: Mapping[str, Any]) -> Any:
    """Open the instrument that a section of the description names for its role."""
    role, side = _ROLES[key]
    values = dict(section)
    name = values.pop("protocol", None)
    if not isinstance(name, str):
        raise InputError(
            Message("{name}: driver.{key}.protocol is missing", description.name, key),
            "a protocol",
            "add the key",
        )
    plugin = find_plugin(name, f"driver.{key}.protocol")
    opener = plugin.openers.get(role)
    if opener is None:
        raise InputError(
            Message("driver.{key}.protocol = {name!r}", key, name),
            Message(
                "a protocol that serves as {role}; {name} serves as {openers}",
                role,
                name,
                ", ".join(plugin.openers),
            ),
            "choose another protocol for this role",
        )
    request = InstrumentRequest(role, f"driver.{key}", values, description, side)
    try:
        opened = opener(request)
    except BenchError as error:
        raise BenchError(
            Message("driver.{key}: {found}", key, error.found), error.allowed, error.remedy
        ) from error
    ratio = 1.0 if side is None else description.module(side).drive.gear_ratio
    if ratio == 1.0:
        return opened
    geared = _GearedEncoder if isinstance(opened, Positioned) else GearedDrive
    return geared(opened, ratio, key.replace("_", " "))


class _OwnDriveAngles(DriveAngles):
    """The drives' positions over separate connections."""

    def __init__(self, description: BenchDescription) -> None:
        with contextlib.ExitStack() as opened:
            drives: dict[Side, Drive] = {}
            for side in SIDES:
                drives[side] = open_role(description, f"{side}_drive")
                opened.callback(drives[side].close)
            super().__init__(drives)
            self._opened = opened.pop_all()

    def close(self) -> None:
        """Release the drives. A second call does nothing."""
        self._opened.close()


@dataclass(frozen=True)
class GearedDrive:
    """A drive with a gear to the module's shaft; its torques and speeds are those of the shaft.

    Parameters
    ----------
    ratio : float
        Turns of the motor per turn of the shaft, negative where the gear reverses.
    name : str
        For messages.
    """

    drive: Drive
    ratio: float
    name: str

    def identity(self) -> Identity:
        """Read the identity of the drive."""
        return self.drive.identity()

    def limits(self) -> DriveLimits:
        """Return the drive's own limits at the shaft."""
        own, turns = self.drive.limits(), abs(self.ratio)
        return DriveLimits(own.torque_nm * turns, own.speed_rad_s / turns)

    def enable(self) -> None:
        """Power the motor."""
        self.drive.enable()

    def disable(self) -> None:
        """Switch off the motor's power."""
        self.drive.disable()

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        """Ramp to a torque of the shaft."""
        check_drive_order(self.name, torque_nm, ramp_nm_per_s, self.limits().torque_nm, "N·m")
        self.drive.command_torque(torque_nm / self.ratio, ramp_nm_per_s / abs(self.ratio))

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        """Ramp to a speed of the shaft."""
        check_drive_order(
            self.name, speed_rad_s, ramp_rad_per_s2, self.limits().speed_rad_s, "rad/s"
        )
        self.drive.command_speed(speed_rad_s * self.ratio, ramp_rad_per_s2 * abs(self.ratio))

    def ramp_to_zero(self, duration_s: float) -> None:
        """Ramp torque and speed to zero."""
        self.drive.ramp_to_zero(duration_s)

    def feed_watchdog(self) -> None:
        """Reset the drive's watchdog."""
        self.drive.feed_watchdog()

    def state(self) -> DriveState:
        """Request the set points, at the shaft."""
        state, ratio = self.drive.state(), self.ratio
        torque, speed = state.torque_nm, state.speed_rad_s
        return replace(
            state,
            torque_nm=None if torque is None else torque * ratio,
            speed_rad_s=None if speed is None else speed / ratio,
        )

    def close(self) -> None:
        """Release the drive."""
        self.drive.close()


class _GearedEncoder(GearedDrive):
    """A drive behind a gear that states its motor's position."""

    def position_counts(self) -> int:
        """Request the motor's position, in the direction of the shaft."""
        assert isinstance(self.drive, Positioned)
        return int(math.copysign(1.0, self.ratio)) * self.drive.position_counts()
