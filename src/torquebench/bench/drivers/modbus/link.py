"""A Modbus TCP connection to one unit (pymodbus), and the keys of its address."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Annotated, Any

from pydantic import Field

from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.links import Address, Link, TimeOut, WireError, split_address
from torquebench.bench.drivers.modbus import register_map
from torquebench.bench.drivers.plugins import Options, require_library
from torquebench.errors import BenchError
from torquebench.message import Message

BUSY = 6
"""Exception "server device busy": the request is repeated."""
BUSY_S = 0.01
EXCEPTIONS = {
    1: " (illegal function)",
    2: " (illegal data address)",
    3: " (illegal data value)",
    4: " (device failure)",
}
"""Meaning of exception codes (Modbus application protocol 1.1b3, 7)."""


class _BusyError(Exception):
    """The instrument is busy."""


Unit = Annotated[int, Field(ge=0, le=255)]
Base = Annotated[int, Field(ge=0, le=60000)]


class ModbusOptions(Options):
    """Address of an instrument: host and port, unit identifier, first register."""

    address: Address
    unit: Unit = 1
    base: Base = 0
    timeout_s: TimeOut = 0.5


class ModbusLink(Link[Any]):
    """One Modbus TCP connection to one unit."""

    def __init__(self, name: str, options: ModbusOptions) -> None:
        super().__init__(name, options.address, options.timeout_s)
        self._unit = options.unit
        self._base = options.base
        self._library = require_library("pymodbus.client", "modbus")
        self._failures = require_library("pymodbus.exceptions", "modbus").ModbusException

    def _open(self) -> Any:
        """Connect to the server, without repeats by the library."""
        host, port = split_address(self.address)
        client = self._library.ModbusTcpClient(
            host, port=port, timeout=self.timeout_s, retries=0, name=self.name
        )
        if not client.connect():
            raise WireError("no connection")
        return client

    def _close(self, connection: Any) -> None:
        connection.close()

    def _exchange(self, ask: Callable[[Any], Any], what: str) -> Any:
        """Communicate with the unit; `what` names the request in messages."""

        def question(client: Any) -> Any:
            """Exchange data with the device; turn its failures into the errors of wires."""
            try:
                answer = ask(client)
            except self._failures as error:
                silent = "No response received" in str(error)
                text = (
                    Message("no answer in {timeout_s:g} s", self.timeout_s)
                    if silent
                    else _short(error)
                )
                raise WireError(text) from error
            except (IndexError, ValueError, AttributeError, TypeError) as error:
                raise WireError(Message("garbled answer ({error})", error)) from error
            if answer.isError() and answer.exception_code == BUSY:
                raise _BusyError
            if answer.isError():
                raise BenchError(
                    Message(
                        "{name} at {address} refuses {what}: exception {exception_code}{meaning}",
                        self.name,
                        self.address,
                        what,
                        answer.exception_code,
                        EXCEPTIONS.get(answer.exception_code, ""),
                    ),
                    "a register and a value that the instrument supports",
                    "compare its register map with docs/reference/device-protocols.md",
                )
            return answer

        deadline = time.monotonic() + self.timeout_s
        while True:
            try:
                return self.call(question)
            except _BusyError as busy:
                if time.monotonic() > deadline:
                    raise BenchError(
                        Message(
                            "{name} at {address} is busy (exception {busy})",
                            self.name,
                            self.address,
                            BUSY,
                        ),
                        Message("an answer within {timeout_s:g} s", self.timeout_s),
                        "find out which other program uses it",
                    ) from busy
                time.sleep(BUSY_S)

    def input_registers(self, first: int, count: int) -> list[int]:
        """Read input registers (function 4)."""
        address, unit = self._base + first, self._unit
        words = self._exchange(
            lambda client: client.read_input_registers(address, count=count, device_id=unit),
            Message("to read input registers {first} to {last}", address, address + count - 1),
        ).registers
        return self._complete(words, count)

    def holding_registers(self, first: int, count: int) -> list[int]:
        """Read holding registers (function 3)."""
        address, unit = self._base + first, self._unit
        words = self._exchange(
            lambda client: client.read_holding_registers(address, count=count, device_id=unit),
            Message("to read holding registers {first} to {last}", address, address + count - 1),
        ).registers
        return self._complete(words, count)

    def write(self, first: int, values: list[int]) -> None:
        """Write holding registers (function 16), all at once."""
        address, unit = self._base + first, self._unit
        self._exchange(
            lambda client: client.write_registers(address, values, device_id=unit),
            Message(
                "to write holding registers {first} to {last}", address, address + len(values) - 1
            ),
        )

    def contacts(self, first: int, count: int) -> list[bool]:
        """Read discrete inputs (function 2)."""
        address, unit = self._base + first, self._unit
        bits = self._exchange(
            lambda client: client.read_discrete_inputs(address, count=count, device_id=unit),
            Message("to read discrete inputs {first} to {last}", address, address + count - 1),
        ).bits
        return [bool(bit) for bit in self._complete(bits, count)]

    def coils(self, first: int, count: int) -> list[bool]:
        """Read coils (function 1)."""
        address, unit = self._base + first, self._unit
        bits = self._exchange(
            lambda client: client.read_coils(address, count=count, device_id=unit),
            Message("to read coils {first} to {last}", address, address + count - 1),
        ).bits
        return [bool(bit) for bit in self._complete(bits, count)]

    def switch(self, first: int, values: list[bool]) -> None:
        """Write coils (function 15), all at once."""
        address, unit = self._base + first, self._unit
        self._exchange(
            lambda client: client.write_coils(address, values, device_id=unit),
            Message("to write coils {first} to {last}", address, address + len(values) - 1),
        )

    def _complete(self, values: list[int], count: int) -> list[int]:
        """Return the requested values; refuse an answer with fewer."""
        if len(values) < count:
            raise BenchError(
                Message(
                    "{name} at {address} sends {count} values", self.name, self.address, len(values)
                ),
                Message("the {wanted} that were requested", count),
                "check the instrument's register map",
            )
        return values[:count]

    def identity(self, role: str) -> Identity:
        """Read the name plate."""
        words = self.input_registers(
            register_map.IDENTITY - self._base, register_map.IDENTITY_LENGTH
        )
        texts = [register_map.text_of(words[k : k + 8]) for k in range(0, len(words), 8)]
        manufacturer, model, serial, firmware = texts
        return Identity(role, manufacturer, model, serial, firmware, {"address": self.address})


def _short(error: Exception) -> str:
    text = str(error).partition("] ")[2] or str(error)
    return text if len(text) < 120 else text[:117] + "…"
