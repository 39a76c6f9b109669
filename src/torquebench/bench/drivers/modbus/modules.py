"""Instruments beside the drives on Modbus TCP: probes, read-out, mode conversion, clamp, angles."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal, cast

import numpy as np
from pydantic import Field

from torquebench.bench.drivers.angles import unwrapped
from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.modbus import register_map
from torquebench.bench.drivers.modbus.device_map import DeviceMap, MappedOptions, ValueMap
from torquebench.bench.drivers.modbus.link import ModbusLink, ModbusOptions
from torquebench.bench.drivers.modbus.register_map import Coil, Contact
from torquebench.bench.drivers.sample_clock import SampleClock
from torquebench.bench.roles import SIDES, Side
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.signals import Record


class _Module:
    """An instrument with a Modbus link of its own, by its role in the bench."""

    ROLE: ClassVar[str] = ""

    def __init__(self, link: ModbusLink) -> None:
        self._link = link

    def identity(self) -> Identity:
        """Read its identity."""
        return self._link.identity(self.ROLE)

    def close(self) -> None:
        """Release it. A second call does nothing."""
        self._link.close()


class TemperatureOptions(MappedOptions):
    """Probes by name: the channel of each in the device's map."""

    probes: Mapping[str, Annotated[int, Field(ge=0, le=1000)]] = Field(min_length=1)
    interval_s: Annotated[float, Field(ge=0.0, le=60.0, description="s")] = 1.0


class _Mapped(_Module):
    """An instrument whose registers and bits are given by a map."""

    def __init__(self, link: ModbusLink, options: MappedOptions, device: DeviceMap) -> None:
        super().__init__(link)
        self._map = device
        self._serial = options.serial

    def identity(self, role: str = "") -> Identity:
        """Read its name plate; without one, return the identity in map and description."""
        if self._map.name_plate:
            return self._link.identity(role or self.ROLE)
        return Identity(
            role or self.ROLE,
            self._map.manufacturer or "unknown",
            self._map.model or "unknown",
            self._serial or "unknown",
            "unknown",
            {"address": self._link.address},
        )


class ModbusTemperature(_Mapped):
    """Temperature probes on a Modbus module, read every `interval_s`.

    A probe that is broken, implausible or doesn't answer is missing from the answer: an old value
    is never returned. The supervisor decides about missing values.

    Raises
    ------
    BenchError
        On opening, a probe reads an implausible temperature: the map isn't the device's.
    """

    ROLE = "temperature"

    def __init__(self, link: ModbusLink, options: TemperatureOptions, device: DeviceMap) -> None:
        super().__init__(link, options, device)
        self._probes = dict(options.probes)
        self._interval_s = options.interval_s
        self._asked = -math.inf
        self._answer: dict[str, float] = {}
        values = device.values
        for name, words in self._words().items():
            if not (_broken(values, words) or values.is_plausible(values.temperature_c(words))):
                raise _implausible(link, name, values, words)

    def temperatures(self) -> Mapping[str, float]:
        """Request all probes: temperature in °C by name."""
        now = time.monotonic()
        if now - self._asked < self._interval_s:
            return self._answer
        try:
            found = self._words()
        except BenchError:
            self._answer = {}
            return self._answer
        self._asked = now
        values = self._map.values
        self._answer = {
            name: temperature
            for name, words in found.items()
            if not _broken(values, words)
            and values.is_plausible(temperature := values.temperature_c(words))
        }
        return self._answer

    def _words(self) -> dict[str, list[int]]:
        """Read the registers of every probe; adjacent channels with one request."""
        values, link = self._map.values, self._link
        read = link.input_registers
        if values.function == "holding registers":
            read = link.holding_registers
        found: dict[str, list[int]] = {}
        for block in _adjacent(sorted({values.register(k) for k in self._probes.values()}), values):
            words = read(block[0], block[-1] - block[0] + values.width)
            for name, channel in self._probes.items():
                start = values.register(channel) - block[0]
                if values.register(channel) in block:
                    found[name] = words[start : start + values.width]
        return found


MOST_REGISTERS = 125
"""Largest number of registers in one request."""


def _adjacent(registers: list[int], values: ValueMap) -> list[list[int]]:
    """Group registers of channels into gap-free blocks that fit one request."""
    blocks: list[list[int]] = []
    for register in registers:
        last = blocks[-1] if blocks else []
        joined = bool(last) and register == last[-1] + values.width
        if joined and register - last[0] + values.width <= MOST_REGISTERS:
            last.append(register)
        else:
            blocks.append([register])
    return blocks


def _broken(values: ValueMap, words: Sequence[int]) -> bool:
    """Return whether registers state the value of a broken probe."""
    return values.number(words) in values.broken


def _implausible(link: ModbusLink, name: str, values: ValueMap, words: Sequence[int]) -> BenchError:
    """Return the error for a probe out of its range, with a possible cause in the map."""
    others = [
        (change, temperature)
        for change, temperature in values.readings_of_other_maps(words)
        if values.is_plausible(temperature)
    ]
    remedy = Message("compare type, word order, scale and unit with the manual, or mend the probe")
    if len(others) == 1:
        change, temperature = others[0]
        remedy = Message(
            "with {change} it reads {temperature:.1f} °C: compare the map with the manual",
            change,
            temperature,
        )
    low, high = values.plausible
    return BenchError(
        Message(
            "{name}: probe {probe} reads {found:.4g} °C (registers {words})",
            link.name,
            name,
            values.temperature_c(words),
            " ".join(map(str, words)),
        ),
        Message("{low:g} to {high:g} °C, the plausible range of its map", low, high),
        remedy,
    )


class ModbusReadout(_Module):
    """A calibrator's amplifier that holds its last samples in registers, one block for each side.

    The newest sample is assumed to be as old as the answer; see `SampleClock`.
    """

    ROLE = "reference"

    def __init__(self, link: ModbusLink) -> None:
        super().__init__(link)
        self._count: dict[Side, int | None] = dict.fromkeys(SIDES)
        self._clocks: dict[Side, SampleClock] = {}

    @property
    def period_s(self) -> float:
        """Period of the samples, as reported by the amplifier."""
        return max((clock.period_s for clock in self._clocks.values()), default=0.0)

    def read(self, side: Side, until_s: float, timed_s: float) -> Record:
        """Return the samples since the last call, without those that its buffer has lost."""
        base = SIDES.index(side) * register_map.READOUT_STRIDE
        length = register_map.READOUT_HEADER + 2 * register_map.READOUT_SAMPLES
        words = self._link.input_registers(base, length)
        count = register_map.integer_of(words[0:2])
        period_s, held = words[2] * 1e-6, words[3]
        if not (period_s > 0.0 and held <= register_map.READOUT_SAMPLES and count >= 0):
            raise BenchError(
                Message(
                    "{name}: period {words} µs, {held} samples of {count}",
                    self._link.name,
                    words[2],
                    held,
                    count,
                ),
                Message(
                    "a period and at most {readout_samples} samples", register_map.READOUT_SAMPLES
                ),
                "check the amplifier's register map",
            )
        before, self._count[side] = self._count[side], count
        new = held if before is None or count < before else min(held, count - before)
        first = register_map.READOUT_HEADER + 2 * (held - new)
        torque = np.array(
            [register_map.float_of(words[k : k + 2]) for k in range(first, first + 2 * new, 2)],
            dtype=np.float64,
        )
        clock = self._clocks.get(side)
        if clock is None or clock.period_s != period_s:
            clock = self._clocks[side] = SampleClock(period_s)
        lost = 0 if before is None else max(0, count - before - new)
        return clock.take(torque, until_s, timed_s, lost)


CoilName = Literal[
    "input_driven", "input_locked", "output_driven", "output_locked", "clamp", "rail"
]
ContactName = Literal[
    "input_free",
    "input_driven",
    "input_locked",
    "output_free",
    "output_driven",
    "output_locked",
    "clamp_closed",
    "clamp_pressure",
    "clamp_open",
    "rail_end",
    "rail_away",
    "supply_on",
]


class DigitalOptions(MappedOptions):
    """Coils and contacts by name: the channel of each in the device's map.

    Names that aren't given have the channels in `Coil` and `Contact`. Inverted contacts are closed
    if the device reports 0.
    """

    coils: Mapping[CoilName, Annotated[int, Field(ge=0, le=1000)]] = Field(default_factory=dict)
    contacts: Mapping[ContactName, Annotated[int, Field(ge=0, le=1000)]] = Field(
        default_factory=dict
    )
    inverted: tuple[ContactName, ...] = ()
    travel_s: Annotated[float, Field(gt=0.0, le=120.0, description="s")] = 10.0


class ModbusFixture(_Mapped):
    """A module with coils and contacts."""

    def __init__(self, link: ModbusLink, options: DigitalOptions, device: DeviceMap) -> None:
        super().__init__(link, options, device)
        self.name = link.name
        self._coils, self._contacts = options.coils, options.contacts
        self._inverted = frozenset(options.inverted)

    def made(self, *contacts: Contact) -> list[bool]:
        """Return which contacts are closed; adjacent contacts are read with one request."""
        bits = self._map.contacts
        read = self._link.coils if bits.function == "coils" else self._link.contacts
        names = [cast("ContactName", contact.name.lower()) for contact in contacts]
        places = [
            bits.first + self._contacts.get(name, contact)
            for name, contact in zip(names, contacts, strict=True)
        ]
        if places == list(range(places[0], places[0] + len(places))):
            states = read(places[0], len(places))
        else:
            states = [read(address, 1)[0] for address in places]
        return [bit != (name in self._inverted) for bit, name in zip(states, names, strict=True)]

    def switch(self, values: Mapping[Coil, bool]) -> None:
        """Set coils, adjacent ones together; coils to be cleared first."""
        first = self._map.coils.first
        places = {
            first + self._coils.get(cast("CoilName", coil.name.lower()), coil): value
            for coil, value in values.items()
        }
        ordered = sorted(places)
        if ordered == list(range(ordered[0], ordered[0] + len(ordered))):
            self._link.switch(ordered[0], [places[place] for place in ordered])
            return
        for place in sorted(ordered, key=lambda place: places[place]):
            self._link.switch(place, [places[place]])


class AnglesOptions(ModbusOptions):
    """Positions of both encoders: the input register of each, signed 32-bit counts."""

    registers: Mapping[Literal["input", "output"], int]


class ModbusAngles:
    """Encoder positions on a Modbus module or the drives' gateway."""

    def __init__(self, link: ModbusLink, options: AnglesOptions) -> None:
        self._link = link
        self._registers = dict(options.registers)
        self._position: dict[Side, int] = {}
        missing = [side for side in SIDES if side not in self._registers]
        if missing:
            raise InputError(
                Message("registers without {missing}", missing[0]), "one for input, one for output"
            )

    def counts(self) -> Mapping[Side, int]:
        """Request the counts of both sides, and unwrap their 32 bits."""
        for side, address in self._registers.items():
            word = register_map.integer_of(self._link.input_registers(address, 2))
            self._position[side] = unwrapped(word, self._position.get(side))
        return dict(self._position)

    def close(self) -> None:
        """Release the module. A second call does nothing."""
        self._link.close()
