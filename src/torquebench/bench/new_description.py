"""The text of a new bench description: commented TOML by the protocols of its instruments."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from string import Template
from typing import Any

from torquebench.bench.roles import SIDES, Side, Signal
from torquebench.errors import InputError
from torquebench.message import Message

COUNTERS = ("nidaqmx", "scpi", "opendaq")
"""Protocols that deliver frequencies; all others deliver values, and `nidaqmx` both."""
ONE_EACH = ("canopen", "ethercat", "moteus", "odrive")
"""Protocols with a found instrument for each drive."""
UNKNOWN_ROLE = ("modbus", "serial", "scpi")
"""Protocols whose found instruments don't show which role they have."""
_NOMINAL_SIGNAL = {"V": 10.0, "mV/V": 2.0}
_COLUMN = 39
"""Column of the comments."""


@dataclass(frozen=True)
class FoundInstrument:
    """An instrument, or a port at which one may be.

    Parameters
    ----------
    protocol : str
        Protocol that its port or connection suggests.
    address : str
        Address for a bench description.
    identity : str
        What it says of itself; empty if it wasn't asked or didn't answer.
    serial : str
        Its serial number, if it states one.
    node : int or None
        Number on a CAN bus.
    """

    protocol: str
    address: str
    identity: str = ""
    serial: str = ""
    node: int | None = None


@dataclass(frozen=True)
class SideValues:
    """Values of one side.

    Parameters
    ----------
    range_nm : float
        Range, and nominal torque of the transducers.
    speed_rpm : float
        Largest speed.
    counts : int
        Encoder counts per revolution.
    gear_ratio : float
        Turns of the drive's motor per turn of the shaft.
    """

    range_nm: float
    speed_rpm: float
    counts: int
    gear_ratio: float = 1.0


@dataclass(frozen=True)
class NewBench:
    """Instruments of a new bench, by their protocols.

    Parameters
    ----------
    name : str
    counter, drives, fixture, temperature : str
        Protocol of the modules' torque, of both drives, of test-mode conversion and clamp, and of
        the probes.
    reference : str
        Protocol of the calibrator's read-out; "counter" if its transducers are at the counter.
    angles : str
        Protocol of the encoders; "counter", "drives", or a protocol.
    signal : {"frequency", "Nm", "V", "mV/V"}
        What the modules' transducers deliver.
    sides : mapping of side to SideValues
    ratio : float
        Ratio of the reducers.
    found : tuple of FoundInstrument
        Instruments of a scan, whose addresses and serial numbers take the place of the examples'.
    """

    name: str
    counter: str
    drives: str
    reference: str
    angles: str
    fixture: str
    temperature: str
    signal: Signal
    sides: Mapping[Side, SideValues]
    ratio: float
    found: tuple[FoundInstrument, ...] = ()

    def instrument(self, protocol: str, number: int = 0) -> FoundInstrument | None:
        """Return what the scan found of a protocol at this place of the order, or None.

        Modbus devices and serial ports don't say what they are, and SCPI instruments may have any
        role, so that a person has to choose.
        """
        if protocol in UNKNOWN_ROLE:
            return None
        of_protocol = [instrument for instrument in self.found if instrument.protocol == protocol]
        return of_protocol[number] if number < len(of_protocol) else None


@cache
def _sections() -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
    source = files("torquebench.bench.drivers") / "sections.toml"
    return tomllib.loads(source.read_text(encoding="utf-8"))


def protocols_of(role: str) -> tuple[str, ...]:
    """Return the protocols that have a section for a role.

    Examples
    --------
    >>> protocols_of("drive")
    ('ads', 's7', 'canopen', 'ethercat', 'moteus', 'odrive', 'modbus')
    """
    return tuple(protocol for protocol, roles in _sections().items() if role in roles)


def description_text(bench: NewBench) -> str:
    """Return a bench description as commented TOML.

    Raises
    ------
    InputError
        A protocol can't serve its role, or the counter can't measure the signal.
    """
    _check(bench)
    lines = [*_heading(bench)]
    for side in SIDES:
        lines += _side(bench, side)
    lines += _standards(bench)
    if bench.counter not in COUNTERS or bench.reference != "counter":
        lines += [
            "[safety]",
            _line("signal_loss_s = 0.2", "several windows: one lost answer is no lost signal"),
            "",
        ]
    lines += ["# -- instruments", ""]
    lines += _instruments(bench)
    return "\n".join(lines).rstrip() + "\n"


def _check(bench: NewBench) -> None:
    """Refuse protocols that don't serve their role or deliver the chosen signal."""
    roles = {
        "counter": bench.counter,
        "drive": bench.drives,
        "modes": bench.fixture,
        "temperature": bench.temperature,
    }
    if bench.reference != "counter":
        roles["reference"] = bench.reference
    if bench.angles != "counter":
        roles["angles"] = bench.angles
    for role, protocol in roles.items():
        if protocol not in protocols_of(role):
            raise InputError(
                Message("{protocol} doesn't serve the role {role}", protocol, role),
                Message("one of {list}", ", ".join(protocols_of(role))),
            )
    if bench.angles == "counter" and "encoders" not in _sections()[bench.counter]["counter"]:
        raise InputError(
            Message("{protocol} doesn't read encoders", bench.counter),
            Message("one of {list}", ", ".join(protocols_of("angles"))),
            "choose where the encoders are read (--angles)",
        )
    if (bench.signal == "frequency") != (bench.counter in COUNTERS) and bench.counter != "nidaqmx":
        raise InputError(
            Message("{protocol} doesn't deliver {signal}", bench.counter, bench.signal),
            "a frequency by nidaqmx, scpi or opendaq; N·m, V or mV/V by nidaqmx or an amplifier",
            "choose the signal (--signal) that the instrument delivers",
        )


def _line(text: str, comment: str = "") -> str:
    return f"{text:<{_COLUMN - 1}} # {comment}" if comment else text


def _quoted(text: str) -> str:
    """Return a TOML string, which is written as one of JSON."""
    return json.dumps(text, ensure_ascii=False)


def _heading(bench: NewBench) -> Iterator[str]:
    """Yield the lines about the whole bench and its counter."""
    counter = _sections()[bench.counter]["counter"]
    instrument = bench.instrument(bench.counter)
    serial = instrument.serial if instrument and instrument.serial else counter["serial"]
    by_values = bench.counter not in COUNTERS
    yield f"# {bench.name}: torque by {bench.counter}, drives by {bench.drives}."
    yield "# Replace serial numbers, addresses, channels, limits and data of certificates, then run"
    yield "#     torquebench doctor --bench FILE"
    yield ""
    yield 'temperatures = ["ambient", "input_transducer", "output_transducer"]'
    yield ""
    yield from ("[bench]", f"name = {_quoted(bench.name)}", 'driver = "instruments"')
    yield f"reducer_ratio = {bench.ratio:g}"
    yield from ("", "[counter]")
    yield _line(f"serial = {_quoted(serial)}", counter["serial_words"])
    yield f"clock = {_quoted(counter['clock'])}"
    if by_values:
        yield _line("window_s = 0.05", "each value is queried once in a window")
    else:
        yield "window_s = 0.01"
    yield from ("block_s = 0.1", "")


def _transducer(nominal_nm: float, signal: Signal) -> Iterator[str]:
    """Yield a transducer's lines."""
    yield f"nominal_torque_nm = {nominal_nm:g}"
    if signal == "frequency":
        yield _line("option_khz = 60", "60 ± 30 kHz; or 240")
        return
    yield f'signal = "{signal}"'
    if signal in _NOMINAL_SIGNAL:
        nominal = _NOMINAL_SIGNAL[signal]
        yield _line(
            f"signal_at_nominal = {nominal}", f"{signal} at nominal torque, from the certificate"
        )
    yield _line("filter_delay_s = 0.008", "of the amplifier's low-pass")
    yield _line(
        "signal_uncertainty_percent = 0.002", "resolution and noise of one value, % of nominal"
    )


def _side(bench: NewBench, side: Side) -> Iterator[str]:
    """Yield the lines of a side: transducer, drive, encoder, limits."""
    values = bench.sides[side]
    yield from (f"[{side}]", f"range_nm = {values.range_nm:g}")
    yield f'temperature_probe = "{side}_transducer"'
    yield from ("", f"[{side}.transducer]")
    yield _line(f'serial = "T-{side}-1"', "from its name plate; a calibration belongs to it")
    yield from _transducer(values.range_nm, bench.signal)
    yield from ("", f"[{side}.drive]", f"serial = {_quoted(_drive_serial(bench, side))}")
    yield _line(f"torque_rate_nm_per_s = {2 * values.range_nm:g}", "fastest change of torque")
    yield f"speed_rate_rpm_per_s = {values.speed_rpm:g}"
    yield _line("watchdog_s = 0.5", "the drive stops by itself after so long without this computer")
    if values.gear_ratio != 1.0:
        yield _line(
            f"gear_ratio = {values.gear_ratio:g}", "turns of the motor per turn of the shaft"
        )
    if bench.angles != "none":
        yield from ("", f"[{side}.encoder]", f'serial = "E-{side}-1"')
        yield f"counts_per_revolution = {values.counts}"
    yield from ("", f"[{side}.limits]")
    yield f"torque_nm = {1.2 * values.range_nm:g}"
    yield from (f"speed_rpm = {values.speed_rpm:g}", "")


def _drive_serial(bench: NewBench, side: Side) -> str:
    instrument = bench.instrument(bench.drives, SIDES.index(side))
    return instrument.serial if instrument and instrument.serial else f"D-{side}-1"


def _standards(bench: NewBench) -> Iterator[str]:
    """Yield the lines of the description's sections for both torque standards."""
    at_counter = bench.reference == "counter" and bench.counter in COUNTERS
    signal = bench.signal if at_counter else "Nm"  # an amplifier scales by the certificate
    for key, number, percent in (("calibrator", 1, 0.05), ("verification_standard", 2, 0.02)):
        yield from (f"[{key}]", f'serial = "K-{number}"')
        yield 'certificate_number = "enter the certificate\'s number"'
        if key == "calibrator":
            yield _line("certificate_due = 2027-12-31", "date from the certificate")
        yield _line(f"expanded_uncertainty_percent = {percent}", "k = 2, of the nominal torque")
        for side in SIDES:
            yield from ("", f"[{key}.{side}]", f'serial = "K-{number}-{side}"')
            yield from _transducer(bench.sides[side].range_nm, signal)
        yield ""


def _instruments(bench: NewBench) -> Iterator[str]:
    """Yield a section for each instrument, and as comments what a scan found."""
    roles: list[tuple[str, str, str, Side | None]] = [
        ("counter", bench.counter, "counter", None),
        ("reference", bench.reference, "reference", None),
        ("angles", bench.angles, "angles", None),
        ("input_drive", bench.drives, "drive", "input"),
        ("output_drive", bench.drives, "drive", "output"),
        ("modes", bench.fixture, "modes", None),
        ("clamp", bench.fixture, "clamp", None),
        ("temperature", bench.temperature, "temperature", None),
    ]
    for key, protocol, role, side in roles:
        if protocol in ("counter", "none"):
            continue
        template = _sections()[protocol]
        section = template.get(role) or template["modes"]
        yield f"[driver.{key}]"
        text = Template(section["text"].strip()).substitute(_values(bench, section, side))
        position = SIDES.index(side) if side and protocol in ONE_EACH else 0
        yield from (_with_found(text, bench.instrument(protocol, position)), "")
    if bench.found:
        yield "# Found by the scan:"
        for each in bench.found:
            node = "" if each.node is None else f", node {each.node}"
            serial = f", serial {each.serial}" if each.serial else ""
            words = f"{each.protocol}: {each.address}{node} {each.identity}{serial}"
            printable = "".join(c if c.isprintable() else " " for c in words)
            yield f"#     {printable.rstrip()}"  # a device may state any characters


def _values(bench: NewBench, section: Mapping[str, Any], side: Side | None) -> dict[str, Any]:
    """Return the values that a section's template needs."""
    channels = dict(section.get("channels", {}))
    if "input_torque" in channels and bench.reference != "counter":  # the modules' alone
        channels = {name: value for name, value in channels.items() if "torque" in name}
    values: dict[str, Any] = {"channels": _inline(channels)}
    values["encoders"] = _inline(section.get("encoders", {}) if bench.angles == "counter" else {})
    if side is not None:
        index, own = SIDES.index(side), bench.sides[side]
        values |= {"side": side, "Side": side.capitalize(), "serial": _drive_serial(bench, side)}
        values |= {"index": index, "place": index + 1, "node": 8 + index}
        values["motor_torque"] = f"{1.2 * own.range_nm / own.gear_ratio:g}"
        values["motor_speed"] = f"{1.2 * own.speed_rpm * own.gear_ratio:g}"
    return values


def _inline(table: Mapping[str, Any]) -> str:
    """Return an inline table; texts that are tables themselves stay as they are."""
    parts = (
        f"{key} = {value if isinstance(value, int) or value.startswith('{') else _quoted(value)}"
        for key, value in table.items()
    )
    return "{ " + ", ".join(parts) + " }" if table else "{}"


def _with_found(text: str, instrument: FoundInstrument | None) -> str:
    """Put what the scan found into a section, in the place of the example's values."""
    if instrument is None:
        return text
    if instrument.protocol == "nidaqmx":
        return text if ":" in instrument.address else text.replace("PXI1Slot2", instrument.address)
    key, value = "address", _quoted(instrument.address)
    if instrument.protocol == "canopen":
        interface, _, channel = instrument.address.partition(":")
        text = text.replace('"socketcan"', _quoted(interface)).replace('"can0"', _quoted(channel))
        key, value = "node", str(instrument.node)
    elif instrument.protocol == "ethercat":
        text = text.replace('"eth1"', _quoted(instrument.address))
        key, value = "position", str(instrument.node)
    elif instrument.protocol == "ads":
        key = "host"
    return "\n".join(
        _line(f"{key} = {value}", "found by the scan") if line.startswith(f"{key} = ") else line
        for line in text.splitlines()
    )
