"""Search for instruments: at this computer, on its CAN buses, and at hosts of the network."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import socket
import time
import warnings
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from torquebench.bench.drivers.links import WireError
from torquebench.bench.drivers.plugins import require_library
from torquebench.bench.new_description import FoundInstrument
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.progress import NO_PROGRESS, Progress

PORTS = {
    502: "modbus",
    5025: "scpi",
    4840: "opcua",
    102: "s7",
    48898: "ads",
    55000: "hbm",
    31763: "nidaqmx",
}
"""TCP ports at which instruments listen unless their owner has changed that, with the protocol."""
CONNECT_S, ANSWER_S = 0.5, 1.0
CAN_ANSWER_S = 0.3
CIA402_PROFILE = 402
MOST_HOSTS = 1024
_AT_ONCE = 64


def scan(
    hosts: Sequence[str] = (),
    buses: Sequence[str] = (),
    adapters: Sequence[str] = (),
    progress: Progress = NO_PROGRESS,
) -> tuple[FoundInstrument, ...]:
    """Search for instruments; nothing is changed or moved.

    A serial port is listed and not asked, because an unknown device may take any text as a command.

    Parameters
    ----------
    hosts : sequence of str
        Names, addresses or networks such as 192.168.0.0/28.
    buses : sequence of str
        CAN buses as interface:channel; by default those of SocketCAN.
    adapters : sequence of str
        Network adapters with EtherCAT devices, which must not be in operation.
    progress : Progress

    Raises
    ------
    InputError
        A host or a bus is written wrongly, there are too many addresses, or an adapter can't be
        opened.
    """
    addresses = addresses_of(hosts)
    instruments = [*_serial_ports(), *_visa_resources(), *_daqmx_devices(), *_can_nodes(buses)]
    instruments += _ethercat_drives(adapters)
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        searches = [(host, port) for host in addresses for port in PORTS]
        progress.start("search the network", len(searches))
        answers = pool.map(lambda search: _at_port(*search), searches)
        for done, answer in enumerate(answers):
            progress.reach(done + 1, searches[done][0])
            instruments += [answer] if answer is not None else []
        progress.finish(Message("{number} found", len(instruments)))
    return tuple(instruments)


def addresses_of(hosts: Iterable[str]) -> list[str]:
    """Return the single addresses of hosts and networks.

    Examples
    --------
    >>> addresses_of(["192.168.0.8/30", "plc.local"])
    ['192.168.0.9', '192.168.0.10', 'plc.local']
    """
    addresses: list[str] = []
    for host in hosts:
        if "/" not in host:
            addresses.append(host)
            continue
        try:
            network = ipaddress.ip_network(host, strict=False)
        except ValueError as error:
            raise InputError(
                Message("the network {host}: {error}", host, error),
                "a host, or a network such as 192.168.0.0/28",
            ) from error
        if network.num_addresses > MOST_HOSTS:
            raise InputError(
                Message("{number} addresses in {host}", network.num_addresses, host),
                Message("at most {most}", MOST_HOSTS),
                "state a smaller network",
            )
        addresses += [str(host_address) for host_address in network.hosts()]
    return addresses


def _library(module: str, extra: str) -> Any:
    """Return a library; None if it isn't installed."""
    try:
        return require_library(module, extra)
    except InputError:
        return None


def _serial_ports() -> Iterator[FoundInstrument]:
    """Yield the serial ports to which something is connected."""
    ports = _library("serial.tools.list_ports", "serial")
    for port in ports.comports() if ports else ():
        if port.hwid == "n/a" and port.device.startswith("/dev/ttyS"):
            continue  # Linux lists ports of the chip set that nothing is connected to
        protocol = "moteus" if "fdcanusb" in f"{port.description} {port.product}" else "serial"
        yield FoundInstrument(protocol, port.device, port.description, port.serial_number or "")


def _visa_resources() -> Iterator[FoundInstrument]:
    """Yield the instruments that VISA lists, with their answers to ``*IDN?``."""
    visa = _library("pyvisa", "visa")
    if visa is None:
        return
    with (
        warnings.catch_warnings(action="ignore"),  # of kinds of connection that can't be searched
        contextlib.suppress(ValueError, OSError, visa.errors.Error),
    ):
        for name in visa.ResourceManager().list_resources("?*::INSTR"):
            if not name.startswith("ASRL"):  # serial ports are listed by themselves
                yield FoundInstrument("scpi", name, *_asked_by_scpi(name))


def _daqmx_devices() -> Iterator[FoundInstrument]:
    """Yield the devices that the NI-DAQmx driver lists."""
    library = _library("nidaqmx", "nidaqmx")
    if library is None:
        return
    system = _library("nidaqmx.system", "nidaqmx")
    errors = (library.errors.DaqError, library.errors.DaqNotFoundError, OSError)
    with contextlib.suppress(*errors):
        for device in system.System.local().devices:
            serial = f"{device.serial_num:08X}"
            yield FoundInstrument("nidaqmx", device.name, device.product_type, serial)


def _can_nodes(buses: Sequence[str]) -> Iterator[FoundInstrument]:
    """Yield the nodes that answer an SDO request for their device type."""
    can, canopen = _library("can", "canopen"), _library("canopen", "canopen")
    if can is None or canopen is None:
        return
    errors = (canopen.SdoAbortedError, canopen.SdoCommunicationError)
    named = [tuple(bus.partition(":")[::2]) for bus in buses]
    for bus, (interface, channel) in zip(buses, named, strict=True):
        if not interface or not channel:
            raise InputError(
                Message("the CAN bus {bus!r}", bus), "interface:channel, such as socketcan:can0"
            )
    if not buses:
        there = can.detect_available_configs(["socketcan"])
        named = [(each["interface"], str(each["channel"])) for each in there]
    for interface, channel in named:
        network = canopen.Network()
        try:
            network.connect(interface=interface, channel=channel)
        except (can.CanError, OSError, ValueError) as error:
            raise InputError(
                Message("the CAN bus {bus}: {error}", f"{interface}:{channel}", error),
                "a bus that this computer can open",
                "switch the bus on, or leave it out",
            ) from error
        try:
            network.scanner.search()
            time.sleep(CAN_ANSWER_S)
            for number in sorted(network.scanner.nodes):
                node = network.add_node(number)
                name, serial = "", ""
                with contextlib.suppress(*errors):  # a node may lack both objects
                    serial = str(int.from_bytes(node.sdo.upload(0x1018, 4), "little"))
                    name = node.sdo.upload(0x1008, 0).decode("ascii", "replace")
                yield FoundInstrument(
                    "canopen", f"{interface}:{channel}", name, serial, node=number
                )
        finally:
            network.disconnect()


def _ethercat_drives(adapters: Sequence[str]) -> Iterator[FoundInstrument]:
    """Yield the CiA 402 drives behind network adapters; their devices go to the state PRE-OP."""
    for adapter in adapters:
        soem = require_library("pysoem", "ethercat")
        master = soem.Master()
        try:
            master.open(adapter)
        except ConnectionError as error:
            raise InputError(
                Message("the adapter {adapter}: {error}", adapter, error),
                "a network adapter of this computer, and administrator rights",
                "state another one, or leave it out",
            ) from error
        try:
            count = master.config_init()
            for position in range(count):
                device = master.slaves[position]
                with contextlib.suppress(soem.SdoError, soem.MailboxError, soem.WkcError):
                    profile = int.from_bytes(device.sdo_read(0x1000, 0)[:2], "little")
                    if profile == CIA402_PROFILE:
                        serial = str(int.from_bytes(device.sdo_read(0x1018, 4), "little"))
                        name = device.name
                        yield FoundInstrument("ethercat", adapter, name, serial, node=position)
        finally:
            master.close()


def _at_port(host: str, port: int) -> FoundInstrument | None:
    """Return the instrument that listens at a known port; None if none does."""
    try:
        socket.create_connection((host, port), CONNECT_S).close()
    except OSError:
        return None
    protocol = PORTS[port]
    address = {"opcua": f"opc.tcp://{host}:{port}", "ads": host, "s7": host}.get(
        protocol, f"{host}:{port}"
    )
    ask = {"scpi": _asked_by_scpi, "hbm": _asked_by_line, "opcua": _asked_by_opcua}.get(protocol)
    return FoundInstrument(protocol, address, *(ask(address) if ask else ("", "")))


def _identified(fields: str) -> tuple[str, str]:
    """Return manufacturer with model, and the serial number, of an answer to ``*IDN?``."""
    parts = [part.strip().strip('"') for part in fields.split(",")]
    return " ".join(parts[:2]), parts[2] if len(parts) > 2 else ""


def _asked_by_scpi(address: str) -> tuple[str, str]:
    """Return name and serial number by ``*IDN?``; empty texts if nothing answers."""
    from torquebench.bench.drivers.scpi.link import ScpiLink

    link = ScpiLink("scan", address, ANSWER_S, attempts=1)
    with contextlib.closing(link), contextlib.suppress(BenchError):  # no instrument after all
        return _identified(link.query("*IDN?"))
    return "", ""


def _asked_by_line(address: str) -> tuple[str, str]:
    """Return name and serial number by ``*IDN?`` on a line; empty texts if nothing answers."""
    from torquebench.bench.drivers.lines import SocketLines

    with contextlib.suppress(WireError, OSError):
        lines = SocketLines(address, ANSWER_S, b"\n")
        with contextlib.closing(lines):
            lines.send("*IDN?")
            return _identified(lines.receive(ANSWER_S))
    return "", ""


def _asked_by_opcua(address: str) -> tuple[str, str]:
    """Return the names of the OPC UA servers at an address; empty texts if none answers."""
    library = _library("asyncua", "opcua")
    if library is None:
        return "", ""
    with contextlib.suppress(library.ua.UaError, OSError, TimeoutError):  # no server after all
        servers = asyncio.run(library.Client(address, ANSWER_S).connect_and_find_servers())
        return ", ".join(server.ApplicationName.Text for server in servers), ""
    return "", ""
