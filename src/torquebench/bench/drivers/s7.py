"""A Siemens S7 PLC by its own protocol (python-snap7): numbers in data blocks."""

from __future__ import annotations

import re
import socket
import struct
from collections.abc import Mapping, Sequence
from typing import Annotated, Any

from pydantic import Field

from torquebench.bench.drivers.links import WireError, split_address
from torquebench.bench.drivers.plc import COMMAND, PlcLink, PlcOptions, plc_plugin
from torquebench.bench.drivers.plugins import require_library
from torquebench.errors import InputError
from torquebench.message import Message

PATTERN = r"^DB(\d+)\.(INT|DINT|REAL|LREAL)(\d+)$"
FORMATS = {"INT": ">h", "DINT": ">i", "REAL": ">f", "LREAL": ">d"}
MOST_BYTES = 200
"""Largest number of bytes in one request of the smallest PLC."""
Place = Annotated[str, Field(pattern=PATTERN, description="such as DB5.REAL12")]


class S7Options(PlcOptions):
    """Address of a PLC, with port if it isn't 102, and its place in the rack."""

    address: Annotated[str, Field(pattern=r"^[^\s:]+(:\d{1,5})?$", description="host or host:port")]
    rack: Annotated[int, Field(ge=0, le=7)] = 0
    slot: Annotated[int, Field(ge=0, le=31)] = 1


class S7Link(PlcLink):
    """A CPU with PUT/GET access; numbers of one data block are read in one request."""

    def __init__(self, name: str, options: S7Options, timeout_s: float) -> None:
        text = options.address if ":" in options.address else f"{options.address}:102"
        super().__init__(name, text, timeout_s)
        self._options = options
        self._library = require_library("snap7", "s7")
        self._failure = require_library("snap7.error", "s7").S7Error

    def _open(self) -> Any:
        """Connect to the PLC within the time-out."""
        host, port = split_address(self.address)
        # the library waits for 5 s for a connection
        socket.create_connection((host, port), self.timeout_s).close()
        client = self._library.Client()
        self._asked(client.connect, host, self._options.rack, self._options.slot, port)
        client.connection.timeout = self.timeout_s
        client.connection.socket.settimeout(self.timeout_s)
        return client

    def _close(self, connection: Any) -> None:
        connection.disconnect()

    def _asked(self, question: Any, *arguments: Any) -> Any:
        """Return the PLC's answer to a question; translate the library's errors."""
        try:
            return question(*arguments)
        except (self._failure, RuntimeError, ValueError, struct.error, IndexError) as error:
            raise WireError(" ".join(str(error).split())[:160] or type(error).__name__) from error

    def _parts(self, names: Sequence[str]) -> list[tuple[int, str, int]]:
        """Return the data block, format and offset that each name states."""
        matches = [re.fullmatch(PATTERN, name) for name in names]
        parts = [(int(m[1]), FORMATS[m[2]], int(m[3])) for m in matches if m is not None]
        assert len(parts) == len(names)
        return parts

    def _read(self, connection: Any, names: Sequence[str]) -> list[float]:
        """Read variables with one request for each data block."""
        parts = self._parts(names)
        raw: dict[int, tuple[int, bytes]] = {}
        for block in {block for block, _, _ in parts}:
            ends = [(at, at + struct.calcsize(f)) for number, f, at in parts if number == block]
            start, size = min(ends)[0], max(stop for _, stop in ends) - min(ends)[0]
            raw[block] = start, bytes(self._asked(connection.db_read, block, start, size))
            if len(raw[block][1]) != size:
                raise WireError(Message("{count} of {wanted} bytes", len(raw[block][1]), size))
        return [
            float(struct.unpack_from(form, raw[block][1], at - raw[block][0])[0])
            for block, form, at in parts
        ]

    def _write(self, connection: Any, values: Mapping[str, float]) -> None:
        """Write adjacent numbers together, in ascending order of their places."""
        parts = self._parts(list(values))
        numbers = dict(zip(parts, values.values(), strict=True))
        pending = b""
        block = start = -1
        for number, form, at in sorted(parts, key=lambda part: (part[0], part[2])):
            value = numbers[number, form, at]
            data = struct.pack(form, value if form in (">f", ">d") else int(value))
            if number != block or at != start + len(pending):
                self._put(connection, block, start, pending)
                block, start, pending = number, at, b""
            pending += data
        self._put(connection, block, start, pending)

    def _put(self, connection: Any, block: int, start: int, data: bytes) -> None:
        if data:
            self._asked(connection.db_write, block, start, bytearray(data))

    def _plate(self, connection: Any) -> tuple[str, str, str]:
        """Return manufacturer, order code and version."""
        code = self._asked(connection.get_order_code)
        version = f"{int(code.V1)}.{int(code.V2)}.{int(code.V3)}"
        return "Siemens", bytes(code.OrderCode).split(b"\0")[0].decode("ascii", "replace"), version

    def fields(self, structure: str, types: Mapping[str, str], first: int = 0) -> dict[str, str]:
        """Return the variable of each field: one after the other in a data block."""
        if not re.fullmatch(r"DB\d+", structure):
            raise InputError(
                Message("structure = {structure!r}", structure),
                "a data block such as DB10",
                "give the number of the drive's or fixture's data block",
            )
        offset = sum(struct.calcsize(FORMATS[kind]) for kind in list(COMMAND.values())[:first])
        places: dict[str, str] = {}
        for name, kind in types.items():
            places[name] = f"{structure}.{kind}{offset}"
            offset += struct.calcsize(FORMATS[kind])
        return places


PLUGIN = plc_plugin("s7", S7Options, Place, Place, S7Link)
"""Plug-in for `protocol = "s7"`."""
