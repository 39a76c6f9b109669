"""The bits of a data sheet: fields of any width, the lowest bit first, and their data types."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from datetime import date, timedelta
from typing import Any

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = [
    "BitReader",
    "BitWriter",
    "Constant",
    "Day",
    "Enumeration",
    "Letters",
    "Logarithmic",
    "Number",
    "Single",
    "Whole",
]

_FIRST_DAY = date(1998, 1, 1)


class BitReader:
    """Reads fields one after the other.

    Parameters
    ----------
    data : bytes
        Bits of a data sheet, without the checksums of its pages.

    Examples
    --------
    >>> reader = BitReader(bytes.fromhex("1f40"))
    >>> reader.take(14, "manufacturer")
    31
    """

    def __init__(self, data: bytes) -> None:
        self._bits = int.from_bytes(data, "little")
        self._length = 8 * len(data)
        self.position = 0

    @property
    def left(self) -> int:
        """Number of bits that haven't been read yet."""
        return self._length - self.position

    def take(self, width: int, name: str) -> int:
        """Return the next field as a whole number.

        Raises
        ------
        InputError
            The data sheet ends before the field does.
        """
        if width > self.left:
            raise InputError(
                Message("the data sheet ends at bit {length}, within {name!r}", self._length, name),
                Message("{position} bits up to there", self.position + width),
                "read the whole memory; it may be damaged or cut off",
            )
        value = (self._bits >> self.position) & ((1 << width) - 1)
        self.position += width
        return value


class BitWriter:
    """Writes fields one after the other."""

    def __init__(self) -> None:
        self._bits = 0
        self.length = 0

    def put(self, value: int, width: int) -> None:
        """Append a field."""
        self._bits |= value << self.length
        self.length += width

    def data(self) -> bytes:
        """Return the bits as bytes, padded with zeros."""
        return self._bits.to_bytes((self.length + 7) // 8, "little")


def _refuse(name: str, found: object, allowed: str) -> InputError:
    return InputError(Message("{name}: {found!r}", name, found), allowed, "correct the sheet")


@dataclass(frozen=True)
class Whole:
    """A whole number without sign (UnInt)."""

    width: int
    low: int = 0
    high: int | None = None

    def decode(self, code: int) -> int:
        """Return the number."""
        return code

    def encode(self, value: Any, name: str) -> int:
        """Return the code of a number."""
        high = (1 << self.width) - 1 if self.high is None else self.high
        if isinstance(value, bool) or not isinstance(value, int) or not self.low <= value <= high:
            raise _refuse(
                name, value, Message("a whole number from {low} to {high}", self.low, high)
            )
        return value


@dataclass(frozen=True)
class Enumeration:
    """A code that stands for one of several words."""

    width: int
    words: tuple[str, ...]

    def decode(self, code: int) -> str | int:
        """Return the word, or the code if it stands for no known word."""
        return self.words[code] if code < len(self.words) else code

    def encode(self, value: Any, name: str) -> int:
        """Return the code of a word."""
        if value in self.words:
            return self.words.index(value)
        if isinstance(value, int) and len(self.words) <= value < 1 << self.width:
            return value
        raise _refuse(name, value, ", ".join(self.words))


@dataclass(frozen=True)
class Letters:
    """Capital letters of five bits each (Chr5); blanks at the end aren't part of the text."""

    count: int

    @property
    def width(self) -> int:
        """Number of bits."""
        return 5 * self.count

    def decode(self, code: int) -> str:
        """Return the text."""
        codes = [(code >> (5 * place)) & 31 for place in range(self.count)]
        return "".join(chr(64 + each) if each else " " for each in codes).rstrip()

    def encode(self, value: Any, name: str) -> int:
        """Return the code of a text."""
        text = value if isinstance(value, str) else ""
        codes = [0 if letter == " " else ord(letter) - 64 for letter in text]
        fits = isinstance(value, str) and len(text) <= self.count and text == text.rstrip()
        if not fits or not all(0 <= code <= 31 for code in codes) or "@" in text:
            raise _refuse(name, value, Message("up to {count} capital letters A to Z", self.count))
        return sum(code << (5 * place) for place, code in enumerate(codes))


@dataclass(frozen=True)
class Day:
    """A date as days since 1 January 1998; 0 means no date."""

    width: int = 16

    def decode(self, code: int) -> str | None:
        """Return the date, ISO 8601."""
        return (_FIRST_DAY + timedelta(days=code)).isoformat() if code else None

    def encode(self, value: Any, name: str) -> int:
        """Return the number of days."""
        if value is None:
            return 0
        last = _FIRST_DAY + timedelta(days=(1 << self.width) - 1)
        try:
            days = (date.fromisoformat(value) - _FIRST_DAY).days
        except (TypeError, ValueError):
            days = 0
        if not 0 < days < 1 << self.width:
            raise _refuse(
                name, value, Message("a date like 2026-11-23, 1998-01-02 to {last}", last)
            )
        return days


@dataclass(frozen=True)
class Single:
    """A 32-bit number of IEEE 754; a number that isn't finite means unknown."""

    width: int = 32

    def decode(self, code: int) -> float | None:
        """Return the number."""
        value = float(struct.unpack("<f", code.to_bytes(4, "little"))[0])
        return value if math.isfinite(value) else None

    def encode(self, value: Any, name: str) -> int:
        """Return the code of the nearest number."""
        if value is None:
            return 0x7FC00000
        if isinstance(value, int | float) and math.isfinite(value):
            try:
                return int.from_bytes(struct.pack("<f", value), "little")
            except OverflowError:
                pass
        raise _refuse(name, value, "a number up to 3.4e38")


@dataclass(frozen=True)
class Constant:
    """A number in equal steps (ConRes); the highest code means unknown."""

    width: int
    start: float
    step: float

    @property
    def end(self) -> float:
        """Largest number."""
        return self.decode((1 << self.width) - 2) or 0.0

    def decode(self, code: int) -> float | None:
        """Return the number."""
        if code == (1 << self.width) - 1:
            return None
        return round(self.start + self.step * code, 12)

    def encode(self, value: Any, name: str) -> int:
        """Return the code of the nearest step."""
        last = (1 << self.width) - 1
        if value is None:
            return last
        if isinstance(value, int | float) and math.isfinite(value):
            code = round((value - self.start) / self.step)
            if 0 <= code < last:
                return code
        raise _refuse(
            name,
            value,
            Message("{start:g} to {end:g} in steps of {step:.4g}", self.start, self.end, self.step),
        )


@dataclass(frozen=True)
class Logarithmic:
    """A number in equal relative steps (ConRelRes); the highest code means unknown."""

    width: int
    start: float
    tolerance: float

    def decode(self, code: int) -> float | None:
        """Return the number."""
        if code == (1 << self.width) - 1:
            return None
        return float(self.start * (1.0 + 2.0 * self.tolerance) ** code)

    def encode(self, value: Any, name: str) -> int:
        """Return the code of the nearest step."""
        last = (1 << self.width) - 1
        if value is None:
            return last
        if isinstance(value, int | float) and math.isfinite(value) and value > 0.0:
            code = round(math.log(value / self.start) / math.log1p(2.0 * self.tolerance))
            if 0 <= code < last:
                return code
        end = self.decode(last - 1)
        raise _refuse(name, value, Message("{low:g} to {high:.3g}", self.start, end))


Number = Whole | Enumeration | Letters | Day | Single | Constant | Logarithmic
"""Any data type of a field."""
