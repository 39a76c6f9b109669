"""Instruments that a PLC's program serves: torque, probes, angles, drives, fixture contacts.

A protocol (`ads`, `s7`) reads and writes variables by name (`PlcLink`). Drives and fixture are
structures with the fields of `COMMAND`, `REPORT` and `FIXTURE`; what the PLC's program does with
them stands in docs/reference/device-protocols.md.
"""

from __future__ import annotations

import contextlib
import math
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from enum import IntEnum
from typing import Annotated, Any, Literal

from pydantic import Field

from torquebench.bench.drivers.amplifiers import AmplifierOptions, ChannelName, answer_s, opened
from torquebench.bench.drivers.angles import unwrapped
from torquebench.bench.drivers.base import DriveLimits, DriveState, Identity
from torquebench.bench.drivers.fixture import FixtureClamp, FixtureModes, FixtureRail, FixtureSupply
from torquebench.bench.drivers.links import (
    Link,
    SwitchingTime,
    TimeOut,
    check_drive_order,
    wait_until_enabled,
)
from torquebench.bench.drivers.modbus.register_map import Coil, Contact
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest, Options, Role
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import BenchError
from torquebench.message import Message

COMMAND = {
    "Control": "INT",
    "Value": "REAL",
    "Rate": "REAL",
    "WatchdogTime": "REAL",
    "Order": "DINT",
    "Life": "DINT",
}
"""Fields of a drive that this computer writes, with their types."""
REPORT = {
    "Done": "DINT",
    "Status": "INT",
    "Fault": "INT",
    "LifeSeen": "DINT",
    "Torque": "REAL",
    "Speed": "REAL",
    "MaxTorque": "REAL",
    "MaxSpeed": "REAL",
    "Position": "DINT",
}
"""Fields of a drive that the PLC writes."""
FIXTURE = {
    "InputDriven": "INT",
    "InputLocked": "INT",
    "OutputDriven": "INT",
    "OutputLocked": "INT",
    "Clamp": "INT",
    "Rail": "INT",
    "Contacts": "INT",
}
"""Coils in the order of `Coil`, 0 or 1, and the word of contacts, bit k for `Contact` k."""
LARGEST_NUMBER = 2**31 - 1
STANDS_S = 0.2
"""Longest time for which a running PLC's cycle counter doesn't change, s."""
POLL_S = 0.005
ANSWER_S = 1.0
WATCHDOG_FAULT = 1


class Control(IntEnum):
    """Commands of a drive; `RAMP` has the ramp's time in `Rate`."""

    OFF, ON, TORQUE, SPEED, RAMP, RESET = range(6)


class Status(IntEnum):
    """Bits of a drive's status."""

    ENABLED, LOCAL, LIMITED, REFUSED = 1, 2, 4, 8


class PlcOptions(Options):
    """Options of every section of a PLC; a protocol adds its address."""

    serial: str = ""
    timeout_s: TimeOut | None = None


class PlcLink(Link[Any]):
    """A connection to a PLC whose variables are read and written by name."""

    serial = ""

    @abstractmethod
    def fields(self, structure: str, types: Mapping[str, str], first: int = 0) -> dict[str, str]:
        """Return the variable of each field of a structure; `first` fields precede them."""

    @abstractmethod
    def _read(self, connection: Any, names: Sequence[str]) -> list[float]:
        """Read numbers; raise `WireError` on failure."""

    @abstractmethod
    def _write(self, connection: Any, values: Mapping[str, float]) -> None:
        """Write numbers in one request, in this order."""

    @abstractmethod
    def _plate(self, connection: Any) -> tuple[str, str, str]:
        """Return manufacturer, model and firmware."""

    def read(self, names: Sequence[str]) -> list[float]:
        """Read variables in one request."""
        return self.call(lambda connection: self._read(connection, names))

    def write(self, values: Mapping[str, float]) -> None:
        """Write variables in one request."""
        self.call(lambda connection: self._write(connection, values))

    def identity(self, role: str) -> Identity:
        """Request the PLC's identity; the serial number is the described one."""
        manufacturer, model, firmware = self.call(self._plate)
        details = {"address": self.address}
        return Identity(role, manufacturer, model, self.serial, firmware, details)


class _PlcValues:
    """Numbers that the PLC's program writes in every cycle, which `life` counts."""

    def __init__(self, link: PlcLink, variables: Mapping[Any, str], life: str) -> None:
        self._link = link
        self._names = [str(name) for name in variables]
        self._variables = [*variables.values(), life]
        self._life, self._changed_s = math.nan, -math.inf
        self.values()

    def values(self) -> Mapping[str, float]:
        """Read every variable; all are NaN while the PLC's program stands."""
        *numbers, life = self._link.read(self._variables)
        now_s = time.monotonic()
        if life != self._life:
            self._life, self._changed_s = life, now_s
        stands = now_s - self._changed_s > STANDS_S
        return {
            name: math.nan if stands else number
            for name, number in zip(self._names, numbers, strict=True)
        }

    def identity(self, role: str = "temperature") -> Identity:
        """Request the identity."""
        return self._link.identity(role)

    def close(self) -> None:
        """Disconnect. A second call does nothing."""
        self._link.close()


class PlcProbes(_PlcValues):
    """Temperature probes of a PLC."""

    def temperatures(self) -> Mapping[str, float]:
        """Read all probes; those without a value, or of a silent PLC, are missing."""
        with contextlib.suppress(BenchError):
            return {name: c for name, c in self.values().items() if math.isfinite(c)}
        return {}


class PlcAngles:
    """Positions of both encoders, signed words of 32 bits."""

    def __init__(self, link: PlcLink, positions: Mapping[Side, str]) -> None:
        self._link, self._positions = link, positions
        self._counts: dict[Side, int] = {}

    def counts(self) -> Mapping[Side, int]:
        """Request the counts of both sides, unwrapped."""
        words = self._link.read([self._positions[side] for side in SIDES])
        for side, word in zip(SIDES, words, strict=True):
            self._counts[side] = unwrapped(int(word), self._counts.get(side))
        return dict(self._counts)

    def close(self) -> None:
        """Disconnect. A second call does nothing."""
        self._link.close()


class PlcDrive:
    """A drive that a PLC's program commands; the program ramps and has the watchdog.

    Parameters
    ----------
    structure : str
        Variable, or data block, with the fields of `COMMAND` and `REPORT`.
    side : {"input", "output"}
    watchdog_s, switching_s : float
        Time without feeding after which the program stops the drive; longest time to get ready, s.

    Raises
    ------
    BenchError
        The PLC's program doesn't run.
    """

    def __init__(
        self, link: PlcLink, structure: str, side: Side, watchdog_s: float, switching_s: float
    ) -> None:
        self._link, self._side = link, side
        self._watchdog_s, self._switching_s = watchdog_s, switching_s
        self._command = link.fields(structure, COMMAND)
        self._report = link.fields(structure, REPORT, len(COMMAND))
        self._fed_s, self._life, self._number = math.inf, 0, 0
        report = self._read()
        self._life, self._number = int(report["LifeSeen"]), int(report["Done"])
        self._limits = DriveLimits(report["MaxTorque"], report["MaxSpeed"])
        self.feed_watchdog()
        while self._read()["LifeSeen"] != self._life:
            time.sleep(POLL_S)

    def _read(self) -> dict[str, float]:
        """Read the report; raise `BenchError` if the program has stopped to look at commands."""
        numbers = self._link.read(list(self._report.values()))
        report = dict(zip(self._report, numbers, strict=True))
        late_s = time.monotonic() - self._fed_s
        if report["LifeSeen"] != self._life and late_s > STANDS_S + self._link.timeout_s:
            raise BenchError(
                Message("{name} doesn't follow for {late_s:.2g} s", self._link.name, late_s),
                "a PLC whose program copies Life to LifeSeen in every cycle",
                "start the PLC's program, and compare its structure with the description",
            )
        if not all(map(math.isfinite, numbers)):
            raise BenchError(
                Message("{name} reports numbers that aren't finite", self._link.name),
                "finite set points",
                "compare the PLC's structure with the description",
            )
        return report

    def identity(self) -> Identity:
        """Request the PLC's identity."""
        return self._link.identity(f"{self._side}.drive")

    def limits(self) -> DriveLimits:
        """Return the limits that the program states."""
        return self._limits

    def _order(self, control: Control, value: float = 0.0, rate: float = 0.0) -> None:
        """Command the program, and wait until it has taken the command over."""
        self._number = self._number % LARGEST_NUMBER + 1
        values = {
            "Control": int(control),
            "Value": value,
            "Rate": rate,
            "WatchdogTime": self._watchdog_s,
            "Order": self._number,
        }
        self._link.write({self._command[name]: number for name, number in values.items()})
        deadline = time.monotonic() + STANDS_S + self._link.timeout_s
        while (report := self._read())["Done"] != self._number:
            if time.monotonic() > deadline:
                raise BenchError(
                    Message("{name} hasn't taken over command {number}", self._link.name, control),
                    "Done equal to Order after a cycle of the PLC",
                    "compare the PLC's structure with the description",
                )
            time.sleep(POLL_S)
        if int(report["Status"]) & Status.REFUSED:
            raise BenchError(
                Message("{name} refuses {number:g} with {rate:g}", self._link.name, value, rate),
                "a command that the PLC's program executes",
                "enable the drive first, and stay within the program's limits",
            )

    def enable(self) -> None:
        """Reset a fault, start the watchdog, and power the motor at zero torque and speed."""
        self.feed_watchdog()
        self._order(Control.RESET)
        self.feed_watchdog()
        self._order(Control.ON)
        wait_until_enabled(self, self._link.name, self._switching_s)

    def disable(self) -> None:
        """Switch off the motor's power."""
        self._order(Control.OFF)

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        """Go to a torque at a limited rate and keep it."""
        name, most = self._link.name, self._limits.torque_nm
        check_drive_order(name, torque_nm, ramp_nm_per_s, most, "N·m")
        self._order(Control.TORQUE, torque_nm, ramp_nm_per_s)

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        """Go to a speed at a limited rate and keep it."""
        name, most = self._link.name, self._limits.speed_rad_s
        check_drive_order(name, speed_rad_s, ramp_rad_per_s2, most, "rad/s")
        self._order(Control.SPEED, speed_rad_s, ramp_rad_per_s2)

    def ramp_to_zero(self, duration_s: float) -> None:
        """Make the program ramp torque and speed to zero by itself."""
        self._order(Control.RAMP, 0.0, duration_s)

    def feed_watchdog(self) -> None:
        """Change the number that the program's watchdog monitors."""
        self._life = self._life % LARGEST_NUMBER + 1
        self._link.write({self._command["Life"]: self._life})
        self._fed_s = time.monotonic()

    def state(self) -> DriveState:
        """Request the active set points and the fault state."""
        report = self._read()
        status, code, fault = int(report["Status"]), int(report["Fault"]), ""
        if code == WATCHDOG_FAULT:
            fault = Message("watchdog not fed for {watchdog_s:g} s", self._watchdog_s)
        elif code:
            fault = Message("fault code {words}", code)
        return DriveState(
            bool(status & Status.ENABLED),
            report["Torque"],
            report["Speed"],
            fault,
            limited=bool(status & Status.LIMITED),
            remote=not status & Status.LOCAL,
        )

    def position_counts(self) -> int:
        """Request the position of the drive's encoder, 32 bits."""
        return int(self._read()["Position"])

    def close(self) -> None:
        """Disconnect. A second call does nothing."""
        self._link.close()


class PlcFixture:
    """Coils and contacts of the fixture in a PLC's structure."""

    def __init__(self, link: PlcLink, structure: str) -> None:
        self._link = link
        self.name = link.name
        self._fields = link.fields(structure, FIXTURE)

    def made(self, *contacts: Contact) -> list[bool]:
        """Return which contacts are closed."""
        word = int(self._link.read([self._fields["Contacts"]])[0])
        return [bool(word >> contact & 1) for contact in contacts]

    def switch(self, values: Mapping[Coil, bool]) -> None:
        """Set coils in one request; those to be cleared first."""
        names = list(FIXTURE)
        ordered = sorted(values, key=lambda coil: values[coil])
        self._link.write({self._fields[names[coil]]: int(values[coil]) for coil in ordered})

    def identity(self, role: str) -> Identity:
        """Request the PLC's identity."""
        return self._link.identity(role)

    def close(self) -> None:
        """Disconnect. A second call does nothing."""
        self._link.close()


Opens = Callable[[str, Any, float], PlcLink]


def plc_plugin(name: str, base: type[PlcOptions], variable: Any, life: Any, opens: Opens) -> Any:
    """Return the plug-in of a protocol.

    Parameters
    ----------
    base : type
        Options with the address.
    variable, life : annotated str
        A variable's name, and that of the cycle counter, perhaps with a default.
    opens : callable
        Returns the link from a section's name, its options and a time-out.
    """

    class Channels(base, AmplifierOptions):  # type: ignore[valid-type, misc]
        channels: Mapping[ChannelName, variable] = Field(min_length=1)
        life: life

    class Probes(base):  # type: ignore[valid-type, misc]
        probes: Mapping[str, variable] = Field(min_length=1)
        life: life

    class Positions(base):  # type: ignore[valid-type, misc]
        positions: Mapping[Literal["input", "output"], variable] = Field(min_length=2)

    class Structure(base):  # type: ignore[valid-type, misc]
        structure: Annotated[str, Field(min_length=1)]

    class Drive(Structure):
        switching_s: SwitchingTime = 5.0

    class Fixture(Structure):
        travel_s: Annotated[float, Field(gt=0.0, le=120.0, description="s")] = 10.0

    def linked(request: InstrumentRequest, options: Any, timeout_s: float | None = None) -> PlcLink:
        """Connect to the PLC, which states the described serial number."""
        link = opens(request.name, options, timeout_s or options.timeout_s or ANSWER_S)
        link.serial = options.serial
        return link

    def amplifier(request: InstrumentRequest) -> Any:
        options = request.read(Channels)
        with linked(request, options, answer_s(request, options.timeout_s)).kept() as link:
            return opened(_PlcValues(link, options.channels, options.life), request, options)

    def probes(request: InstrumentRequest) -> PlcProbes:
        options = request.read(Probes)
        request.check_probes(options.probes)
        with linked(request, options).kept() as link:
            return PlcProbes(link, options.probes, options.life)

    def angles(request: InstrumentRequest) -> PlcAngles:
        options = request.read(Positions)
        with linked(request, options).kept() as link:
            return PlcAngles(link, options.positions)

    def drive(request: InstrumentRequest) -> PlcDrive:
        """Open a side's drive, with a time-out that its watchdog allows."""
        assert request.side is not None
        options = request.read(Drive)
        watchdog_s, timeout_s = request.drive_times(options.timeout_s)
        with linked(request, options, timeout_s).kept() as link:
            return PlcDrive(link, options.structure, request.side, watchdog_s, options.switching_s)

    def fixture(kind: Callable[[Any, float], Any]) -> Callable[[InstrumentRequest], Any]:
        """Return a function that opens the fixture's modes or its clamp."""

        def opens_fixture(request: InstrumentRequest) -> Any:
            options = request.read(Fixture)
            with linked(request, options).kept() as link:
                return kind(PlcFixture(link, options.structure), options.travel_s)

        return opens_fixture

    openers: dict[Role, Callable[[InstrumentRequest], Any]] = {
        "counter": amplifier,
        "reference": amplifier,
        "temperature": probes,
        "angles": angles,
        "drive": drive,
        "modes": fixture(FixtureModes),
        "clamp": fixture(FixtureClamp),
        "rail": fixture(FixtureRail),
        "supply": fixture(FixtureSupply),
    }
    return DriverPlugin(name, openers)
