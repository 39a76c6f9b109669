"""Drivers of one's own, one for each role of a bench, for instruments that speak lines of text.

Announce `PLUGIN` in a package's pyproject.toml, and write `protocol = "ascii"` in the bench
description:

    [project.entry-points."torquebench.drivers"]
    ascii = "ascii_bench:PLUGIN"

`LineLink` keeps the rules of the page "Write a driver": it waits for whole lines, has a time limit,
serves one caller at a time, connects again and repeats a request once. Take the class of your role
and delete the others.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from torquebench.bench.drivers.amplifiers import AmplifierOptions, answer_s, opened
from torquebench.bench.drivers.base import DriveLimits, DriveState, Identity
from torquebench.bench.drivers.fixture import FixtureClamp, FixtureModes, FixtureRail, FixtureSupply
from torquebench.bench.drivers.lines import LineConnection, LineLink, LineOptions
from torquebench.bench.drivers.links import TimeOut, WireError, check_drive_order
from torquebench.bench.drivers.modbus.register_map import Coil, Contact
from torquebench.bench.drivers.plugins import DriverPlugin, InstrumentRequest
from torquebench.bench.drivers.sample_clock import SampleClock
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import BenchError
from torquebench.signals import Record


class AsciiOptions(LineOptions):
    """Keys of the sections: those of a line (address, baud_rate ...) and the time-out."""

    timeout_s: TimeOut | None = None


class AsciiLink(LineLink):
    """Asks for numbers: `ID?` answers texts, everything else numbers, or ERR and a reason."""

    def words(self, line: str) -> list[str]:
        """Send a line and return the words of its answer."""
        answer = self.query(line)
        if answer.startswith("ERR"):
            raise BenchError(f"{self.name}: {line!r} is refused: {answer}", "OK", "read the manual")
        return answer.split()

    def identity(self, role: str) -> Identity:
        """Read manufacturer, model and serial number."""
        manufacturer, model, serial = self.words("ID?")[:3]
        return Identity(role, manufacturer, model, serial)

    def numbers(self, line: str, count: int) -> list[float]:
        """Send a line and return the numbers of its answer; other answers are asked for again."""

        def exchange(connection: LineConnection) -> list[float]:
            connection.send(line)
            words = connection.receive(self.timeout_s).split()
            try:
                numbers = [float(word) for word in words]
            except ValueError as error:
                raise WireError(f"{line} is answered with {words}") from error
            if count and len(numbers) != count:
                raise WireError(f"{line} is answered with {len(numbers)} numbers")
            return numbers

        return self.call(exchange)


class AsciiDrive:
    """A drive that ramps by itself and has its own watchdog: `WD seconds` sets it, `FEED` feeds."""

    def __init__(self, link: AsciiLink, side: Side, watchdog_s: float) -> None:
        self._link, self._side, self._watchdog_s = link, side, watchdog_s
        torque_nm, speed_rad_s = link.numbers("LIM?", 2)
        self._limits = DriveLimits(torque_nm, speed_rad_s)

    def identity(self) -> Identity:
        """Read manufacturer, model and serial number."""
        return self._link.identity(f"{self._side}.drive")

    def limits(self) -> DriveLimits:
        """Return the limits that were read on opening."""
        return self._limits

    def enable(self) -> None:
        """Set the watchdog, then power the motor at zero torque."""
        self._link.words(f"WD {self._watchdog_s}")
        self._link.words("ON")

    def disable(self) -> None:
        """Switch the power off."""
        self._link.words("OFF")

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        """Ramp to a torque."""
        check_drive_order(self._link.name, torque_nm, ramp_nm_per_s, self._limits.torque_nm, "N·m")
        self._link.words(f"TQ {torque_nm} {ramp_nm_per_s}")

    def command_speed(self, speed_rad_s: float, ramp_rad_per_s2: float) -> None:
        """Ramp to a speed."""
        most = self._limits.speed_rad_s
        check_drive_order(self._link.name, speed_rad_s, ramp_rad_per_s2, most, "rad/s")
        self._link.words(f"SP {speed_rad_s} {ramp_rad_per_s2}")

    def ramp_to_zero(self, duration_s: float) -> None:
        """One command: the drive completes it even if this computer hangs."""
        self._link.words(f"ZERO {duration_s}")

    def feed_watchdog(self) -> None:
        """Nothing else feeds the watchdog."""
        self._link.words("FEED")

    def state(self) -> DriveState:
        """Read power, fault, and the set points on their ramps."""
        on, fault, torque_nm, speed_rad_s = self._link.numbers("ST?", 4)
        text = "" if not fault else "watchdog" if fault == 1 else f"fault {fault:g}"
        return DriveState(bool(on), torque_nm, speed_rad_s, text)

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        self._link.close()


class AsciiReadout:
    """A standard's amplifier: `V? 1` answers all values of channel 1 since the last question.

    It states no times. A `SampleClock` finds them: values are `period_s` apart, and the newest is
    as old as the quickest answer so far allows.
    """

    period_s = 0.01

    def __init__(self, link: AsciiLink) -> None:
        self._link = link
        self._clocks = {side: SampleClock(self.period_s) for side in SIDES}
        for side in SIDES:
            link.numbers(f"V? {SIDES.index(side) + 1}", 0)  # old values

    def identity(self) -> Identity:
        """Read manufacturer, model and serial number."""
        return self._link.identity("reference")

    def read(self, side: Side, until_s: float, timed_s: float) -> Record:
        """Return the values up to a bench time."""
        values = self._link.numbers(f"V? {SIDES.index(side) + 1}", 0)
        return self._clocks[side].take(np.array(values), until_s, timed_s)

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        self._link.close()


class AsciiAmplifier:
    """The modules' amplifier: `T?` answers the present torque of both, in N·m or as described.

    `opened` makes it a counter, which asks once in each window.
    """

    def __init__(self, link: AsciiLink) -> None:
        self._link = link

    def identity(self, role: str) -> Identity:
        """Read manufacturer, model and serial number."""
        return self._link.identity(role)

    def values(self) -> Mapping[str, float]:
        """Request the present values; NaN is a channel without a valid one."""
        torque = self._link.numbers("T?", 2)
        return {"input_torque": torque[0], "output_torque": torque[1]}

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        self._link.close()


class AsciiAngles:
    """Encoders of both shafts: `A?` answers their counts, clockwise positive, without overflow."""

    def __init__(self, link: AsciiLink) -> None:
        self._link = link

    def counts(self) -> Mapping[Side, int]:
        """Request the present counts."""
        return {side: int(n) for side, n in zip(SIDES, self._link.numbers("A?", 2), strict=True)}

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        self._link.close()


class AsciiProbes:
    """Temperature probes: `P?` answers °C in the order of the bench's list `temperatures`."""

    def __init__(self, link: AsciiLink, names: tuple[str, ...]) -> None:
        self._link, self._names = link, names

    def identity(self) -> Identity:
        """Read manufacturer, model and serial number."""
        return self._link.identity("temperature")

    def temperatures(self) -> Mapping[str, float]:
        """Read all probes; no probe has a value if nothing answers."""
        try:
            values = self._link.numbers("P?", len(self._names))
        except BenchError:
            return {}
        return dict(zip(self._names, values, strict=True))

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        self._link.close()


class AsciiFixture:
    """Coils and contacts of mode conversion, clamp, rail and supply: `SET n 0` or `1`, `C?`.

    The classes of `torquebench.bench.drivers.fixture` move the parts and check the contacts.
    """

    def __init__(self, link: AsciiLink) -> None:
        self._link, self.name = link, link.name

    def made(self, *contacts: Contact) -> list[bool]:
        """Return which contacts are closed."""
        bits = self._link.numbers("C?", len(Contact))
        return [bool(bits[contact]) for contact in contacts]

    def switch(self, values: Mapping[Coil, bool]) -> None:
        """Set coils, those to be cleared first."""
        for coil, on in sorted(values.items(), key=lambda item: item[1]):
            self._link.words(f"SET {int(coil)} {int(on)}")

    def identity(self, role: str) -> Identity:
        """Read manufacturer, model and serial number."""
        return self._link.identity(role)

    def close(self) -> None:
        """Disconnect; a second call does nothing."""
        self._link.close()


def _drive(request: InstrumentRequest) -> AsciiDrive:
    assert request.side is not None
    options: AsciiOptions = request.read(AsciiOptions)  # names a misspelt key
    watchdog_s, timeout_s = request.drive_times(options.timeout_s)
    with AsciiLink(request.section, options, timeout_s).kept() as link:
        return AsciiDrive(link, request.side, watchdog_s)


def _readout(request: InstrumentRequest) -> AsciiReadout:
    options: AsciiOptions = request.read(AsciiOptions)
    with AsciiLink(request.section, options, options.timeout_s or 0.5).kept() as link:
        return AsciiReadout(link)


class AsciiChannels(LineOptions, AmplifierOptions):
    """Keys of the counter: those of a line, and `channels` with the channels that it measures."""


def _counter(request: InstrumentRequest) -> Any:
    options: AsciiChannels = request.read(AsciiChannels)
    with AsciiLink(request.section, options, answer_s(request, options.timeout_s)).kept() as link:
        return opened(AsciiAmplifier(link), request, options)


def _with_link(kind: Callable[[AsciiLink, InstrumentRequest], Any]) -> Any:
    """Return the function that opens an instrument which needs nothing but its connection."""

    def opens(request: InstrumentRequest) -> Any:
        options: AsciiOptions = request.read(AsciiOptions)
        with AsciiLink(request.section, options, options.timeout_s or 0.5).kept() as link:
            return kind(link, request)

    return opens


TRAVEL_S = 10.0
"""Longest time of a motion."""

PLUGIN = DriverPlugin(
    "ascii",
    {
        "counter": _counter,
        "drive": _drive,
        "reference": _readout,
        "angles": _with_link(lambda link, _: AsciiAngles(link)),
        "temperature": _with_link(lambda link, r: AsciiProbes(link, r.description.temperatures)),
        "modes": _with_link(lambda link, _: FixtureModes(AsciiFixture(link), TRAVEL_S)),
        "clamp": _with_link(lambda link, _: FixtureClamp(AsciiFixture(link), TRAVEL_S)),
        "rail": _with_link(lambda link, _: FixtureRail(AsciiFixture(link), TRAVEL_S)),
        "supply": _with_link(lambda link, _: FixtureSupply(AsciiFixture(link), TRAVEL_S)),
    },
)
