"""Mode conversion, clamp, rail and supply by coils and contacts, whatever protocol carries them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import ClassVar, Protocol

from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.modbus.register_map import Coil, Contact
from torquebench.bench.roles import Mode, RailPosition, Side
from torquebench.errors import BenchError
from torquebench.message import Message

POLL_S = 0.05


class Fixture(Protocol):
    """A device with coils and contacts."""

    name: str

    def made(self, *contacts: Contact) -> list[bool]:
        """Return which contacts are closed."""

    def switch(self, values: Mapping[Coil, bool]) -> None:
        """Set coils; those to be cleared first."""

    def identity(self, role: str) -> Identity:
        """Read its identity."""

    def close(self) -> None:
        """Release it. A second call does nothing."""


class _Part:
    """A part of the fixture; a motion takes `travel_s` at most."""

    ROLE: ClassVar[str]

    def __init__(self, fixture: Fixture, travel_s: float) -> None:
        self._fixture = fixture
        self._travel_s = travel_s

    def identity(self) -> Identity:
        """Read the identity of the device."""
        return self._fixture.identity(self.ROLE)

    def close(self) -> None:
        """Release the device. A second call does nothing."""
        self._fixture.close()


_CONTACTS: tuple[Mode, ...] = ("free", "driven", "locked")
_SIDE_COILS: Mapping[Side, tuple[Coil, Coil]] = {
    "input": (Coil.INPUT_DRIVEN, Coil.INPUT_LOCKED),
    "output": (Coil.OUTPUT_DRIVEN, Coil.OUTPUT_LOCKED),
}
_SIDE_CONTACTS: Mapping[Side, tuple[Contact, Contact, Contact]] = {
    "input": (Contact.INPUT_FREE, Contact.INPUT_DRIVEN, Contact.INPUT_LOCKED),
    "output": (Contact.OUTPUT_FREE, Contact.OUTPUT_DRIVEN, Contact.OUTPUT_LOCKED),
}


class FixtureModes(_Part):
    """The test-mode conversion: coils command a mode, discrete inputs report the reached mode."""

    ROLE = "modes"

    def set_mode(self, side: Side, mode: Mode) -> None:
        """Change the mode of one side, and return when it is reached.

        Raises
        ------
        BenchError
            The state isn't reached in time.
        """
        driven, locked = _SIDE_COILS[side]
        self._fixture.switch({driven: mode == "driven", locked: mode == "locked"})
        _await(
            lambda: self._reached(side) == [mode],
            self._travel_s,
            Message(
                "{name}: {side} side hasn't reached mode {mode!r}", self._fixture.name, side, mode
            ),
        )

    def mode(self, side: Side) -> Mode:
        """Request the present mode of one side.

        Raises
        ------
        BenchError
            Its contacts report no mode or several modes.
        """
        reached = self._reached(side)
        if len(reached) != 1:
            raise BenchError(
                Message(
                    "{name}: {side} side is {reached}",
                    self._fixture.name,
                    side,
                    " and ".join(reached) or "in no mode",
                ),
                "exactly one of free, driven, locked",
                "check the conversion's position contacts",
            )
        return reached[0]

    def _reached(self, side: Side) -> list[Mode]:
        """Return the modes of a side whose contacts are closed."""
        made = self._fixture.made(*_SIDE_CONTACTS[side])
        return [mode for mode, contact in zip(_CONTACTS, made, strict=True) if contact]


class FixtureClamp(_Part):
    """The hydraulic clamp: one coil, three contacts."""

    ROLE = "clamp"

    def set_clamped(self, clamped: bool) -> None:
        """Close or open the clamp and return when that is reached; else raise `BenchError`."""
        self._fixture.switch({Coil.CLAMP: clamped})
        word = "closed" if clamped else "open"
        _await(
            lambda: self.clamped() == clamped,
            self._travel_s,
            Message("{name} isn't {word}", self._fixture.name, word),
        )

    def clamped(self) -> bool:
        """Return whether the clamp is closed and under pressure.

        Raises
        ------
        BenchError
            Its contacts report open and closed at the same time.
        """
        closed, pressure, opened = self._fixture.made(
            Contact.CLAMP_CLOSED, Contact.CLAMP_PRESSURE, Contact.CLAMP_OPEN
        )
        if closed and opened:
            raise BenchError(
                Message("{name} is open and closed", self._fixture.name),
                "one of them",
                "check its contacts",
            )
        return closed and pressure


class FixtureRail(_Part):
    """The guide rail of the input module: one coil, a contact at each end."""

    ROLE = "guide_rail"

    def move(self, position: RailPosition) -> None:
        """Move to "end" or "away" and return when it is there; else raise `BenchError`."""
        self._fixture.switch({Coil.RAIL: position == "end"})
        _await(
            lambda: self.position() == position,
            self._travel_s,
            Message("{name} isn't at its position {position!r}", self._fixture.name, position),
        )

    def position(self) -> RailPosition:
        """Request the rail's position.

        Raises
        ------
        BenchError
            Its contacts report both end positions at the same time.
        """
        at_end, away = self._fixture.made(Contact.RAIL_END, Contact.RAIL_AWAY)
        if at_end and away:
            raise BenchError(
                Message("{name} is at both ends", self._fixture.name),
                "one of them",
                "check its contacts",
            )
        return "end" if at_end else "away" if away else "between"


class FixtureSupply(_Part):
    """The drives' power supply: one contact."""

    ROLE = "power_supply"

    def supplies(self) -> bool:
        """Return whether the supply is on."""
        return self._fixture.made(Contact.SUPPLY_ON)[0]


def _await(reached: Callable[[], bool], within_s: float, failure: str) -> None:
    """Wait until a condition holds; raise `failure` if it doesn't in time."""
    deadline = time.monotonic() + within_s
    while not reached():
        if time.monotonic() > deadline:
            raise BenchError(
                failure, Message("within {within_s:g} s", within_s), "check pressure and contacts"
            )
        time.sleep(POLL_S)
