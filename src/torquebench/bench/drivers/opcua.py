"""Values from a PLC by OPC UA: torque of modules or standard, and temperatures."""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Callable, Mapping
from concurrent.futures import CancelledError
from typing import Annotated, Any

from pydantic import Field

from torquebench.bench.drivers.amplifiers import AmplifierOptions, ChannelName, answer_s, opened
from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.links import Link, TimeOut, WireError
from torquebench.bench.drivers.plugins import (
    DriverPlugin,
    InstrumentRequest,
    Options,
    require_library,
)
from torquebench.errors import BenchError
from torquebench.message import Message

BUILD_INFO = ("i=2263", "i=2261", "i=2264")
"""Nodes of manufacturer, product and version of every server (OPC 10000-5)."""
ANSWER_S = 2.0
SHORTEST_ANSWER_S = 0.5
"""Shortest time-out, s: opening a session takes several answers from a PLC that is busy
otherwise."""
NodeText = Annotated[str, Field(pattern=r"^(ns=\d+;)?[isgb]=.+$", description="such as ns=2;s=A")]


class ServerOptions(Options):
    """Options of a server without security, in the bench's own network."""

    address: Annotated[str, Field(pattern=r"^opc\.tcp://.+$", description="opc.tcp://host:port")]
    serial: str = ""


class OpcUaOptions(ServerOptions, AmplifierOptions):
    """Variables by channel, in the unit of the described signal."""

    channels: Mapping[ChannelName, NodeText] = Field(min_length=1)


class ProbeOptions(ServerOptions):
    """OPC UA variable for the temperature of each probe, °C."""

    probes: Mapping[str, NodeText] = Field(min_length=1)
    timeout_s: TimeOut = ANSWER_S


class OpcUaServer(Link[Any]):
    """A server from which some variables are read together.

    Parameters
    ----------
    nodes : mapping of str to str
        Node by the name of its value.
    """

    def __init__(
        self, name: str, options: ServerOptions, nodes: Mapping[Any, str], timeout_s: float
    ) -> None:
        super().__init__(name, options.address, timeout_s)
        self._serial, self._nodes = options.serial, dict(nodes)
        self._library = require_library("asyncua", "opcua")
        self._client = require_library("asyncua.sync", "opcua").Client

    def _open(self) -> Any:
        """Connect to the server; hang up if that fails."""
        client = self._client(
            self.address, self.timeout_s, sync_wrapper_timeout=4.0 * self.timeout_s
        )
        try:
            self._asked(client.connect)
        except BaseException:
            self._hang_up(client)
            raise
        return client

    def _close(self, connection: Any) -> None:
        with contextlib.suppress(Exception):  # the session is lost in any case
            connection.tloop.post(connection.aio_obj.disconnect())
        self._hang_up(connection)

    @staticmethod
    def _hang_up(client: Any) -> None:
        """Close the socket, which a failed session leaves open, and end the client's thread."""

        async def closed() -> None:
            """Cancel the connection's tasks and close its socket."""
            protocol = client.aio_obj.uaclient.protocol
            unfinished = asyncio.all_tasks() - {asyncio.current_task()}
            for task in unfinished:  # a session that is being opened or closed would continue
                task.cancel()
            await asyncio.gather(*unfinished, return_exceptions=True)
            client.aio_obj.disconnect_socket()
            if protocol is not None and protocol.transport is not None:
                protocol.transport.abort()  # without waiting for data that can't be sent any more
            await asyncio.sleep(0.0)  # the loop closes the socket on its next iteration

        hanging_up = closed()
        with contextlib.suppress(Exception):
            client.tloop.post(hanging_up)
        hanging_up.close()
        client._stop_own_tloop()

    def _asked(self, question: Callable[[], Any]) -> Any:
        """Return the server's answer to a question; translate the library's errors."""
        try:
            return question()
        except (self._library.ua.UaError, OSError, RuntimeError, CancelledError) as error:
            raise WireError(str(error) or "no answer") from error

    def _read(self, nodes: list[str]) -> list[Any]:
        """Return the values of nodes, read by one request."""

        def exchange(client: Any) -> list[Any]:
            variables = [client.get_node(node) for node in nodes]
            value = self._library.ua.AttributeIds.Value
            return list(self._asked(lambda: client.read_attributes(variables, attr=value)))

        return self.call(exchange)

    def identity(self, role: str) -> Identity:
        """Request the server's identity, which has no serial number."""
        stated = [str(value.Value.Value or "unknown") for value in self._read(list(BUILD_INFO))]
        details = {"address": self.address}
        return Identity(role, stated[0], stated[1], self._serial, stated[2], details)

    def values(self) -> Mapping[str, float]:
        """Read every variable; NaN if its quality isn't good."""
        read = self._read(list(self._nodes.values()))
        values: dict[str, float] = {}
        for (name, node), stated in zip(self._nodes.items(), read, strict=True):
            status, good = stated.StatusCode, stated.StatusCode.is_good()
            if "BadNodeId" in status.name:
                raise BenchError(
                    Message("{name} has no variable {node}", self.name, node),
                    "variables of the server",
                    "copy the node's identifier from the PLC's own software",
                )
            number: Any = None if stated.Value is None else stated.Value.Value
            if good and (isinstance(number, bool) or not isinstance(number, int | float)):
                raise BenchError(
                    Message("{node} of {name} states {number!r}", node, self.name, number),
                    "a number",
                    "choose the variable of the scaled value",
                )
            values[name] = float(number) if good else math.nan
        return values


class OpcUaProbes:
    """Temperature probes of a PLC."""

    def __init__(self, server: OpcUaServer) -> None:
        self._server = server
        server.values()  # refuses variables that the server doesn't have

    def identity(self) -> Identity:
        """Request the server's identity."""
        return self._server.identity("temperature")

    def temperatures(self) -> Mapping[str, float]:
        """Read all probes; those without a good value, or of a silent server, are missing."""
        with contextlib.suppress(BenchError):
            return {name: c for name, c in self._server.values().items() if math.isfinite(c)}
        return {}

    def close(self) -> None:
        """Disconnect. A second call does nothing."""
        self._server.close()


def _amplifier(request: InstrumentRequest) -> Any:
    options: OpcUaOptions = request.read(OpcUaOptions)
    name, limit_s = request.name, answer_s(request, options.timeout_s)
    if options.timeout_s is None:
        limit_s = max(limit_s, SHORTEST_ANSWER_S)
    return opened(OpcUaServer(name, options, dict(options.channels), limit_s), request, options)


def _probes(request: InstrumentRequest) -> OpcUaProbes:
    options: ProbeOptions = request.read(ProbeOptions)
    request.check_probes(options.probes)
    with OpcUaServer("temperature", options, options.probes, options.timeout_s).kept() as server:
        return OpcUaProbes(server)


PLUGIN = DriverPlugin(
    "opcua", {"counter": _amplifier, "reference": _amplifier, "temperature": _probes}
)
"""Plug-in for `protocol = "opcua"`."""
