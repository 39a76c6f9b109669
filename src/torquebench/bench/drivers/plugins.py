"""The available protocols, and the conversion of a section of `[driver]` to an instrument.

A protocol is a `DriverPlugin`: its name and one opener for each role. Built-in protocols are loaded
when a bench description names them. Another package adds a protocol by an entry point in the group
`torquebench.drivers` that gives a `DriverPlugin`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from types import ModuleType
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.drivers.links import drive_timeout
from torquebench.bench.roles import Side
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.plugins import DRIVERS, entry_points
from torquebench.validation import validated

__all__ = [
    "DriverPlugin",
    "InstrumentRequest",
    "Options",
    "Role",
    "find_plugin",
    "protocols",
    "require_library",
]

Role = Literal[
    "counter", "angles", "drive", "reference", "temperature", "modes", "clamp", "rail", "supply"
]

_BUILT_IN = {
    "modbus": "torquebench.bench.drivers.modbus.driver",
    "scpi": "torquebench.bench.drivers.scpi.driver",
    "canopen": "torquebench.bench.drivers.cia402",
    "ethercat": "torquebench.bench.drivers.ethercat",
    "nidaqmx": "torquebench.bench.drivers.daqmx",
    "opendaq": "torquebench.bench.drivers.open_daq",
    "opcua": "torquebench.bench.drivers.opcua",
    "moteus": "torquebench.bench.drivers.moteus_drive",
    "odrive": "torquebench.bench.drivers.odrive_can",
    "ads": "torquebench.bench.drivers.ads",
    "s7": "torquebench.bench.drivers.s7",
    "hbm": "torquebench.bench.drivers.hbm",
    "serial": "torquebench.bench.drivers.serial_readout",
}


class Options(BaseModel):
    """Checked keys of an instrument's section; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


@dataclass(frozen=True)
class InstrumentRequest:
    """A section of a bench description that defines one instrument.

    Parameters
    ----------
    section : str
        Section that contains its keys, such as `driver.input_drive`.
    options : mapping
        The keys except `protocol`.
    side : {"input", "output"} or None
        Side of a drive.
    """

    role: Role
    section: str
    options: Mapping[str, Any]
    description: BenchDescription
    side: Side | None = None

    @property
    def name(self) -> str:
        """Name of the instrument in messages, such as `input drive`."""
        return self.section.removeprefix("driver.").replace("_", " ")

    def drive_times(self, described_s: float | None) -> tuple[float, float]:
        """Return a drive's watchdog time and the time-out of its answers, s: `drive_timeout`."""
        assert self.side is not None
        watchdog_s = self.description.module(self.side).drive.watchdog_s
        return watchdog_s, drive_timeout(described_s, watchdog_s, self.section)

    def read(self, model: type[Any]) -> Any:
        """Check the section's keys against a model, and return them; raises `InputError`."""
        return validated(model, self.options, f"{self.description.name}: {self.section}")

    def check_probes(self, probes: Collection[str]) -> None:
        """Refuse a section that lacks one of the bench's temperature probes."""
        missing = set(self.description.temperatures) - set(probes)
        if missing:
            raise InputError(
                Message("{section}.probes without {missing}", self.section, sorted(missing)[0]),
                "every probe of the list `temperatures`",
                "add its register",
            )


Opener = Callable[[InstrumentRequest], Any]


@dataclass(frozen=True)
class DriverPlugin:
    """A wire protocol: how to open an instrument in each role that it can serve.

    Parameters
    ----------
    name : str
        The value of `protocol = ` in a bench description.
    openers : mapping of role to callable
        Each takes an `InstrumentRequest` and returns an object with the role's interface in
        `bench.drivers.base`.
    bench : callable, optional
        Opens a whole bench, for `bench.driver = name`.
    """

    name: str
    openers: Mapping[Role, Opener] = field(default_factory=dict)
    bench: Callable[[BenchDescription], DriverSet] | None = None


def protocols() -> dict[str, Callable[[], DriverPlugin]]:
    """Return every installed protocol with the function that loads it.

    Examples
    --------
    >>> sorted(protocols())[:3]
    ['ads', 'canopen', 'ethercat']
    """
    plugins: dict[str, Callable[[], DriverPlugin]] = {}
    for point in entry_points(DRIVERS):
        plugins[point.name] = point.load
    for name, module in _BUILT_IN.items():
        plugins[name] = partial(_built_in, module)
    return plugins


def _built_in(module: str) -> DriverPlugin:
    plugin: DriverPlugin = import_module(module).PLUGIN
    return plugin


def find_plugin(name: str, key: str) -> DriverPlugin:
    """Load a protocol.

    Parameters
    ----------
    key : str
        The key of the bench description that names it, for the message.

    Raises
    ------
    InputError
        No driver has this name, or the entry point isn't a `DriverPlugin`.
    """
    known = protocols()
    if name not in known:
        raise InputError(
            Message("{key} = {name!r}", key, name),
            Message("one of {list}", ", ".join(sorted(known))),
            "correct the bench description or install the package that provides the protocol",
        )
    plugin = known[name]()
    if callable(plugin) and not isinstance(
        plugin, DriverPlugin
    ):  # the entry point may be a factory function
        plugin = plugin()
    if not isinstance(plugin, DriverPlugin):
        raise InputError(
            Message("entry point {name!r} gives {plugin_name}", name, type(plugin).__name__),
            "a torquebench.bench.drivers.plugins.DriverPlugin",
            "correct the package that provides it",
        )
    return plugin


def require_library(module: str, extra: str) -> ModuleType:
    """Import the library of a protocol and silence its log unless a handler is set.

    Raises
    ------
    InputError
        The driver's package isn't installed; the message names the extra to install.
    """
    logging.getLogger(module.partition(".")[0]).addHandler(logging.NullHandler())
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            Message("the library {partition} isn't installed", module.partition(".")[0]),
            Message("it comes with the extra {extra!r}", extra),
            Message("pip install torquebench[{extra}]", extra),
        ) from error
