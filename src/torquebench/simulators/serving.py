"""All simulators of a bench description: one for each described instrument, and their control."""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Mapping
from typing import Any, Protocol, Self

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.instruments import ROLES, InstrumentsOptions
from torquebench.bench.drivers.links import split_address
from torquebench.bench.drivers.plugins import require_library
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.simulators.control import ControlServer
from torquebench.simulators.misbehaviour import Misbehaviour, WireFaults
from torquebench.simulators.plant import Plant
from torquebench.validation import validated


class Served(Protocol):
    """A simulator on a port."""

    host: str
    port: int

    def close(self) -> None:
        """End the simulator. A second call does nothing."""


class Simulators:
    """Serves the twin by every protocol in a bench description.

    Addresses with port 0 get a free port; `description` then holds the actual ports, so that a test
    can open its bench with it.

    Parameters
    ----------
    description : BenchDescription
        Description with `bench.driver = "instruments"` and a section `[driver.simulation]`.

    Raises
    ------
    InputError
        The description has no section `[driver.simulation]`, or names a protocol without simulator.
    BenchError
        A port is in use.
    """

    def __init__(self, description: BenchDescription) -> None:
        if "simulation" not in description.driver:
            raise InputError(
                Message("{name} has no instruments to simulate", description.name),
                "a bench with a section [driver.simulation]",
                "see examples/networked.toml",
            )
        source = f"{description.name}: driver"
        options: InstrumentsOptions = validated(InstrumentsOptions, description.driver, source)
        assert options.simulation is not None
        self.plant = Plant(description, options.simulation)
        self.misbehaviour = Misbehaviour(options.simulation.seed)
        self._served: dict[str, Served] = {}
        self._places: dict[tuple[str, str], tuple[str, str]] = {}
        driver = {key: _plain(value) for key, value in description.driver.items()}
        try:
            for role in ROLES:
                section = driver.get(role)
                if section is not None:
                    driver[role] = self._serve(role, section)
            for side, drive in self.plant.bench.drives.items():
                faults = self.misbehaviour.endpoint(f"{side}_drive")
                drive.unguarded = functools.partial(faults.active, "unguarded")
            host, port = split_address(options.simulation.control, lowest=0)
            control = ControlServer(self.plant, self.misbehaviour, host, port)
            self._served["control"] = control
            driver["simulation"] = driver["simulation"] | {"control": f"{host}:{control.port}"}
        except BaseException:
            self.close()
            raise
        self.description = description.model_copy(update={"driver": driver})

    # -- serving ----------------------------------------------------------------------------

    def _serve(self, role: str, section: dict[str, Any]) -> dict[str, Any]:
        """Serve one instrument of a role; refuse a protocol without a simulator."""
        protocol = str(section.get("protocol"))
        build = _BUILDERS.get(protocol)
        if build is None:
            raise InputError(
                Message("driver.{role}.protocol = {protocol!r} has no simulator", role, protocol),
                Message("one of {list}", ", ".join(_BUILDERS)),
                "simulate this instrument by one of these",
            )
        return build(self, role, section)

    def serve_at(
        self,
        role: str,
        address: str,
        start: Callable[[WireFaults, str, int], Served],
        *,
        kind: str = "",
        join: Callable[[Any], None] | None = None,
    ) -> str:
        """Serve an endpoint, unless its address is already served; return the actual address.

        Parameters
        ----------
        role : str
            Name of the endpoint for injected faults.
        start : callable
            Function of the endpoint's faults, host and port that starts the server.
        kind : str
            Endpoints of one kind with one address are one instrument, or one bus.
        join : callable
            Called with the server of the address, for example to add nodes to a bus.
        """
        host, port = split_address(address, lowest=0)
        known = self._places.get((kind, address))
        if port != 0 and known is not None:
            first, true = known
            self.misbehaviour.alias(role, first)
            if join is not None:
                join(self._served[true])
            return true
        served = start(self.misbehaviour.endpoint(role), host, port)
        true = f"{host}:{served.port}"
        self._served[true] = served
        self._places[kind, address] = (role, true)
        if join is not None:
            join(served)
        return true

    @property
    def addresses(self) -> Mapping[str, str]:
        """Address of each endpoint, for display."""
        addresses_by_role = {"control": self._served["control"]}
        named = {name: f"{served.host}:{served.port}" for name, served in addresses_by_role.items()}
        for (kind, _), (role, true) in self._places.items():
            named[role] = f"{true} ({kind})"
        return named

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def close(self) -> None:
        """End every server and the plant. A second call does nothing."""
        with contextlib.ExitStack() as closing:
            closing.callback(self.plant.close)
            for served in self._served.values():
                closing.callback(served.close)


def _plain(value: Any) -> Any:
    return dict(value) if isinstance(value, Mapping) else value


def _modbus(simulators: Simulators, role: str, section: dict[str, Any]) -> dict[str, Any]:
    """Serve a role by Modbus; return its section with the address in use."""
    from torquebench.simulators import modbus_images as images
    from torquebench.simulators.modbus import ModbusSimulator

    plant = simulators.plant
    builders: dict[str, Callable[[WireFaults], images.Image]] = {
        "input_drive": lambda faults: images.DriveImage(plant, faults, "input"),
        "output_drive": lambda faults: images.DriveImage(plant, faults, "output"),
        "temperature": lambda faults: images.ProbesImage(plant, faults, section["probes"]),
        "reference": lambda faults: images.ReadoutImage(plant, faults),
        "angles": lambda faults: images.AnglesImage(plant, faults, section["registers"]),
        "modes": lambda faults: images.DigitalImage(plant, faults),
        "clamp": lambda faults: images.DigitalImage(plant, faults),
        "guide_rail": lambda faults: images.DigitalImage(plant, faults),
        "power_supply": lambda faults: images.DigitalImage(plant, faults),
    }
    unit, base = int(section.get("unit", 1)), int(section.get("base", 0))

    def start(faults: WireFaults, host: str, port: int) -> Served:
        return ModbusSimulator(builders[role](faults), faults, host, port, unit, base)

    address = simulators.serve_at(role, section["address"], start, kind="modbus")
    return section | {"address": address}


def _scpi(simulators: Simulators, role: str, section: dict[str, Any]) -> dict[str, Any]:
    """Serve a role by SCPI; return its section with the addresses in use."""
    from torquebench.simulators import scpi

    plant = simulators.plant
    if role == "reference":
        start = functools.partial(scpi.ScpiSimulator, scpi.ScpiAmplifier(plant))
        address = simulators.serve_at(role, section["address"], start, kind="scpi")
        return section | {"address": address}
    channels: dict[str, str] = {}
    for number, (channel, address) in enumerate(section["channels"].items()):
        serial = plant.description.counter.serial + (f"-{number + 1}" if number else "")
        counter = scpi.ScpiFrequencyCounter(plant, channel, serial)
        start = functools.partial(scpi.ScpiSimulator, counter)
        endpoint = role if number == 0 else f"{role}.{channel}"
        channels[channel] = simulators.serve_at(endpoint, address, start, kind="scpi")
    return section | {"channels": channels}


def _canopen(simulators: Simulators, role: str, section: dict[str, Any]) -> dict[str, Any]:
    """Serve a drive on a CAN bus over TCP; return its section with the address in use."""
    require_library("canopen", "canopen")
    from torquebench.simulators.canopen_bus import CanBusSimulator
    from torquebench.simulators.cia402 import Cia402Node

    bus = dict(section["bus"])
    if bus.get("interface") != "socketcand":
        raise InputError(
            Message(
                "driver.{role}.bus.interface = {bus!r} has no simulator", role, bus.get("interface")
            ),
            '"socketcand" with host and port',
            "simulate the drive on a bus over TCP",
        )

    def join(served: CanBusSimulator) -> None:
        """Add the drive's node to the served bus."""
        node = Cia402Node(
            simulators.plant,
            "input" if role == "input_drive" else "output",
            int(section["node"]),
            float(section.get("velocity_units_per_rpm", 1000.0)),
            simulators.misbehaviour.endpoint(role),
        )
        served.add_node(node)

    address = f"{bus['host']}:{bus['port']}"
    true = simulators.serve_at(role, address, CanBusSimulator, kind="canopen", join=join)
    return section | {"bus": bus | {"port": split_address(true)[1]}}


def _daqmx(simulators: Simulators, role: str, section: dict[str, Any]) -> dict[str, Any]:
    """Serve a counter card over gRPC; return its section with the address in use."""
    require_library("nidaqmx", "nidaqmx")
    from torquebench.simulators.daqmx import DaqmxSimulator

    if section.get("address") is None:
        raise InputError(
            Message("driver.{role} is a card in this computer", role),
            "an address host:port of an NI gRPC Device Server",
            "simulate the card behind an address",
        )
    wiring = {counter: channel for channel, counter in section["channels"].items()}
    wiring |= {counter: side for side, counter in section["encoders"].items()}
    start = functools.partial(DaqmxSimulator, simulators.plant, wiring)
    return section | {"address": simulators.serve_at(role, section["address"], start, kind="grpc")}


_BUILDERS: dict[str, Callable[[Simulators, str, dict[str, Any]], dict[str, Any]]] = {
    "modbus": _modbus,
    "scpi": _scpi,
    "canopen": _canopen,
    "nidaqmx": _daqmx,
}
