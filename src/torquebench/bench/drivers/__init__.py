"""Instruments behind narrow roles: `base` says what a role is, one file a wire protocol.

`simulated` is the only file of the bench that knows the twin.
"""

from __future__ import annotations

from collections.abc import Callable

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.errors import InputError

__all__ = ["DRIVERS", "open_drivers"]


def _simulated(description: BenchDescription) -> DriverSet:
    from torquebench.bench.drivers.simulated import open_simulated  # brings the twin along

    return open_simulated(description)


DRIVERS: dict[str, Callable[[BenchDescription], DriverSet]] = {"simulated": _simulated}
"""How to open the instruments of a bench, by the name that `bench.driver` gives."""


def open_drivers(description: BenchDescription) -> DriverSet:
    """Open the instruments that a description names.

    Raises
    ------
    InputError
        There is no such driver, or its section `[driver]` is wrong.
    BenchError
        An instrument doesn't answer.
    """
    opener = DRIVERS.get(description.bench.driver)
    if opener is None:
        raise InputError(
            f"bench.driver = {description.bench.driver!r}",
            "one of " + ", ".join(DRIVERS),
            "correct the bench description or install the driver",
        )
    return opener(description)
