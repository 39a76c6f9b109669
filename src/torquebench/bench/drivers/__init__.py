"""Instruments behind narrow roles: `base` defines the roles, and each wire protocol has a file.

`instruments` assembles a bench from its sections, `plugins` finds the protocols. `simulated` is the
only module of this package that uses the twin.
"""

from __future__ import annotations

from collections.abc import Callable

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["DRIVERS", "open_drivers"]


def _simulated(description: BenchDescription) -> DriverSet:
    from torquebench.bench.drivers.simulated.driver import (
        open_simulated,
    )  # imported late, because it imports the twin

    return open_simulated(description)


def _instruments(description: BenchDescription) -> DriverSet:
    from torquebench.bench.drivers.instruments import open_instruments

    return open_instruments(description)


DRIVERS: dict[str, Callable[[BenchDescription], DriverSet]] = {
    "simulated": _simulated,
    "instruments": _instruments,
}
"""Functions that open a bench's instruments, by the name in `bench.driver`."""


def open_drivers(description: BenchDescription) -> DriverSet:
    """Open the instruments that a description names.

    Raises
    ------
    InputError
        There is no such driver, or its section `[driver]` is wrong.
    BenchError
        An instrument doesn't answer.
    """
    name = description.bench.driver
    opener = DRIVERS.get(name) or _whole_bench(name)
    if opener is None:
        raise InputError(
            Message("bench.driver = {name!r}", name),
            Message("one of {list}", ", ".join(DRIVERS)),
            "correct the bench description or install the driver",
        )
    return opener(description)


def _whole_bench(name: str) -> Callable[[BenchDescription], DriverSet] | None:
    """Return the function by which a plug-in opens a whole bench; None without such a plug-in."""
    from torquebench.bench.drivers.plugins import find_plugin, protocols

    return find_plugin(name, "bench.driver").bench if name in protocols() else None
