"""Instruments beside the drives on Modbus TCP: probes, read-out, mode conversion, clamp, angles."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from torquebench.bench.drivers.base import Identity, Mode, RailPosition, Side
from torquebench.bench.drivers.modbus import register_map
from torquebench.bench.drivers.modbus.link import ModbusLink, ModbusOptions
from torquebench.bench.drivers.modbus.register_map import Coil, Contact
from torquebench.bench.drivers.sample_clock import SampleClock
from torquebench.bench.roles import SIDES
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.signals import Record

__all__ = [
    "AnglesOptions",
    "DigitalOptions",
    "ModbusAngles",
    "ModbusClamp",
    "ModbusModes",
    "ModbusRail",
    "ModbusReadout",
    "ModbusSupply",
    "ModbusTemperature",
    "TemperatureOptions",
]

POLL_S = 0.05


class _Module:
    """An instrument that has a Modbus link for itself, by its role in the bench."""

    ROLE: ClassVar[str]

    def __init__(self, link: ModbusLink) -> None:
        self._link = link

    def identity(self) -> Identity:
        """Read its identity."""
        return self._link.identity(self.ROLE)

    def close(self) -> None:
        """Release it. A second call does nothing."""
        self._link.close()


class TemperatureOptions(ModbusOptions):
    """Probes by name: the input register of each, signed, hundredths of a degree."""

    probes: Mapping[str, Annotated[int, Field(ge=0, le=125)]] = Field(min_length=1)
    interval_s: Annotated[float, Field(ge=0.0, le=60.0, description="s")] = 1.0


class ModbusTemperature(_Module):
    """Temperature probes on a Modbus module, read every `interval_s`.

    A probe that is broken or doesn't answer is missing from the answer, which the supervisor
    judges: it is never an old value.
    """

    ROLE = "temperature"

    def __init__(self, link: ModbusLink, options: TemperatureOptions) -> None:
        super().__init__(link)
        self._probes = dict(options.probes)
        self._interval_s = options.interval_s
        self._asked = -math.inf
        self._answer: dict[str, float] = {}

    def temperatures(self) -> Mapping[str, float]:
        """Ask for all probes: name to °C."""
        now = time.monotonic()
        if now - self._asked < self._interval_s:
            return self._answer
        try:
            words = self._link.input_registers(0, max(self._probes.values()) + 1)
        except BenchError:
            self._answer = {}
            return self._answer
        self._asked = now
        hundredths = {name: _signed(words[place]) for name, place in self._probes.items()}
        self._answer = {
            name: value / 100.0
            for name, value in hundredths.items()
            if value != register_map.PROBE_BROKEN
        }
        return self._answer


def _signed(word: int) -> int:
    return word - 65536 if word >= 32768 else word


class ModbusReadout(_Module):
    """A calibrator's amplifier that holds its last samples in registers, one block a side.

    The newest sample is taken to be as old as the answer; see `SampleClock`.
    """

    ROLE = "reference"

    def __init__(self, link: ModbusLink) -> None:
        super().__init__(link)
        self._count: dict[Side, int | None] = dict.fromkeys(SIDES)
        self._clocks: dict[Side, SampleClock] = {}

    @property
    def period_s(self) -> float:
        """As it states itself."""
        return max((clock.period_s for clock in self._clocks.values()), default=0.0)

    def read(self, side: Side, until_s: float, timed_s: float) -> Record:
        """Return the samples since the last call, except those lost by the ring buffer."""
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


class DigitalOptions(ModbusOptions):
    """Mode conversion or clamp: how long its travel may take."""

    travel_s: Annotated[float, Field(gt=0.0, le=120.0, description="s")] = 10.0


class _Travelling(_Module):
    """A module that moves something, and how long its travel may take."""

    def __init__(self, link: ModbusLink, travel_s: float) -> None:
        super().__init__(link)
        self._travel_s = travel_s


_MODE_COILS: dict[Mode, list[bool]] = {
    "free": [False, False],
    "driven": [True, False],
    "locked": [False, True],
}
_CONTACTS: tuple[Mode, ...] = ("free", "driven", "locked")


class ModbusModes(_Travelling):
    """The test-mode conversion: coils command it, discrete inputs give the reached state."""

    ROLE = "modes"

    def set_mode(self, side: Side, mode: Mode) -> None:
        """Change the mode of one side and return when it is reached.

        Raises
        ------
        BenchError
            It isn't reached in time.
        """
        coil = Coil.INPUT_DRIVEN if side == "input" else Coil.OUTPUT_DRIVEN
        self._link.switch(coil, _MODE_COILS[mode])
        _await(
            lambda: self._reached(side) == [mode],
            self._travel_s,
            Message(
                "{name}: {side} side hasn't reached mode {mode!r}", self._link.name, side, mode
            ),
        )

    def mode(self, side: Side) -> Mode:
        """Ask for the present mode of one side.

        Raises
        ------
        BenchError
            Its contacts say none or several.
        """
        reached = self._reached(side)
        if len(reached) != 1:
            raise BenchError(
                Message(
                    "{name}: {side} side is {reached}",
                    self._link.name,
                    side,
                    " and ".join(reached) or "in no mode",
                ),
                "exactly one of free, driven, locked",
                "check the conversion's position contacts",
            )
        return reached[0]

    def _reached(self, side: Side) -> list[Mode]:
        first = Contact.INPUT_FREE if side == "input" else Contact.OUTPUT_FREE
        made = self._link.contacts(first, 3)
        return [mode for mode, contact in zip(_CONTACTS, made, strict=True) if contact]


class ModbusClamp(_Travelling):
    """The hydraulic clamp: one coil, three contacts."""

    ROLE = "clamp"

    def set_clamped(self, clamped: bool) -> None:
        """Close or open the clamp and return when it is reached; raises `BenchError` if not."""
        self._link.switch(Coil.CLAMP, [clamped])
        word = "closed" if clamped else "open"
        _await(
            lambda: self.clamped() == clamped,
            self._travel_s,
            Message("{name} isn't {word}", self._link.name, word),
        )

    def clamped(self) -> bool:
        """Ask whether the clamp is closed and under pressure.

        Raises
        ------
        BenchError
            It states open and closed at the same time.
        """
        closed, pressure, opened = self._link.contacts(Contact.CLAMP_CLOSED, 3)
        if closed and opened:
            raise BenchError(
                Message("{name} is open and closed", self._link.name),
                "one of them",
                "check its contacts",
            )
        return closed and pressure


class ModbusRail(_Travelling):
    """The guide rail of the input module: one coil, a contact at each end."""

    ROLE = "guide_rail"

    def move(self, position: RailPosition) -> None:
        """Move to "end" or "away" and return when it is there; raises `BenchError` if not."""
        self._link.switch(Coil.RAIL, [position == "end"])
        _await(
            lambda: self.position() == position,
            self._travel_s,
            Message("{name} isn't at its position {position!r}", self._link.name, position),
        )

    def position(self) -> RailPosition:
        """Ask where it is.

        Raises
        ------
        BenchError
            It states both end positions at the same time.
        """
        at_end, away = self._link.contacts(Contact.RAIL_END, 2)
        if at_end and away:
            raise BenchError(
                Message("{name} is at both ends", self._link.name),
                "one of them",
                "check its contacts",
            )
        return "end" if at_end else "away" if away else "between"


class ModbusSupply(_Module):
    """The drives' supply: one contact."""

    ROLE = "power_supply"

    def supplies(self) -> bool:
        """Ask whether it is on."""
        return bool(self._link.contacts(Contact.SUPPLY_ON, 1)[0])


def _await(reached: Callable[[], bool], within_s: float, failure: str) -> None:
    deadline = time.monotonic() + within_s
    while not reached():
        if time.monotonic() > deadline:
            raise BenchError(
                failure, Message("within {within_s:g} s", within_s), "check pressure and contacts"
            )
        time.sleep(POLL_S)


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
        """Ask for the counts of both sides; the wrapping of 32 bits is undone."""
        for side, place in self._registers.items():
            word = register_map.integer_of(self._link.input_registers(place, 2))
            before = self._position.get(side, word)
            self._position[side] = before + _signed32(word - before)
        return dict(self._position)

    def close(self) -> None:
        """Release the module. A second call does nothing."""
        self._link.close()


def _signed32(difference: int) -> int:
    return (difference + 2**31) % 2**32 - 2**31
