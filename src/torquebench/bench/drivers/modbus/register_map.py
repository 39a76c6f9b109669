"""The register map of the Modbus drivers: see docs/reference/device-protocols.md.

Addresses start at 0 as in the protocol, relative to the instrument's `base`. Numbers of two
registers have the high word first. Every instrument can identify itself.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum, IntFlag


class DriveCommand(IntEnum):
    """Holding registers of a drive."""

    CONTROL = 0
    MODE = 1
    TORQUE = 2  # float, N·m
    TORQUE_RATE = 4  # float, N·m/s
    SPEED = 6  # float, rad/s
    SPEED_RATE = 8  # float, rad/s²
    ZERO_RAMP = 10  # float, s
    WATCHDOG = 12  # writing any value resets the watchdog
    WATCHDOG_TIME = 13  # ms, 0 switches it off


class DriveControl(IntFlag):
    """Bits of `DriveCommand.CONTROL`."""

    ENABLE = 1
    ZERO = 2  # ramp torque and speed to zero within ZERO_RAMP, whatever was commanded
    RESET = 128  # reset of a fault


class DriveMode(IntEnum):
    """Values of `DriveCommand.MODE`."""

    NONE = 0
    TORQUE = 1
    SPEED = 2


class DriveReport(IntEnum):
    """Input registers of a drive."""

    STATUS = 0
    FAULT = 1
    MODE = 2
    TORQUE = 3  # float, active set point, N·m
    SPEED = 5  # float, active set point, rad/s
    MAXIMUM_TORQUE = 8  # float, N·m
    MAXIMUM_SPEED = 10  # float, rad/s
    POSITION = 12  # signed, encoder counts


class DriveStatus(IntFlag):
    """Bits of `DriveReport.STATUS`."""

    ENABLED = 1
    FAULT = 2
    RAMPING = 4
    WATCHDOG = 8  # the watchdog has tripped


class Coil(IntEnum):
    """Coils of mode conversion, clamp and rail; a side without a set coil is free."""

    INPUT_DRIVEN = 0
    INPUT_LOCKED = 1
    OUTPUT_DRIVEN = 2
    OUTPUT_LOCKED = 3
    CLAMP = 4
    RAIL = 5  # move to the end position; 0 moves it away


class Contact(IntEnum):
    """Discrete inputs: the reached states."""

    INPUT_FREE = 0
    INPUT_DRIVEN = 1
    INPUT_LOCKED = 2
    OUTPUT_FREE = 3
    OUTPUT_DRIVEN = 4
    OUTPUT_LOCKED = 5
    CLAMP_CLOSED = 6
    CLAMP_PRESSURE = 7
    CLAMP_OPEN = 8
    RAIL_END = 9
    RAIL_AWAY = 10
    SUPPLY_ON = 11


IDENTITY = 900
"""Input registers of the name plate: manufacturer, model, serial, firmware, 16 characters each."""
IDENTITY_LENGTH = 32
PROBE_BROKEN = -32768
"""Value, in hundredths of a degree, for a broken or disconnected probe."""
READOUT_HEADER = 4
"""Input registers before a read-out's samples: count (2), period in µs, samples held."""
READOUT_SAMPLES = 50
"""Number of samples in a read-out, the oldest first; NaN without a signal."""
READOUT_STRIDE = 200
"""Offset in registers from the input side's block to the output side's."""


def from_float(value: float) -> list[int]:
    """Return the two registers of a number.

    Examples
    --------
    >>> [hex(word) for word in from_float(1.0)]
    ['0x3f80', '0x0']
    """
    return list(struct.unpack(">2H", struct.pack(">f", value)))


def float_of(registers: Sequence[int]) -> float:
    """Return the number that two registers hold.

    Examples
    --------
    >>> float_of([0x3F80, 0])
    1.0
    """
    return float(struct.unpack(">f", struct.pack(">2H", *registers))[0])


def from_integer(value: int) -> list[int]:
    """Return the two registers of a signed integer."""
    return list(struct.unpack(">2H", struct.pack(">i", value)))


def integer_of(registers: Sequence[int]) -> int:
    """Return the signed integer that two registers hold.

    Examples
    --------
    >>> integer_of(from_integer(-70000))
    -70000
    """
    return int(struct.unpack(">i", struct.pack(">2H", *registers))[0])


def from_text(text: str, registers: int = 8) -> list[int]:
    """Return the registers of a text, two characters each, padded with zeros."""
    raw = text.encode("ascii", "replace")[: 2 * registers].ljust(2 * registers, b"\0")
    return list(struct.unpack(f">{registers}H", raw))


def text_of(registers: Sequence[int]) -> str:
    """Return the text that registers hold.

    Examples
    --------
    >>> text_of(from_text("SIM-1"))
    'SIM-1'
    """
    raw = struct.pack(f">{len(registers)}H", *registers)
    return raw.rstrip(b"\0").decode("ascii", "replace")
