"""Devices on Modbus TCP, after the Modbus Application Protocol V1.1b3 and the devices' manuals.

Registers and bits that the manual doesn't list don't exist: a request that touches one is refused
as a whole with exception 2. Another unit identifier is refused with exception 11.
"""

import socket
import struct
from collections.abc import Callable

from torquebench.testing.cable import TcpPort

READ_COILS, READ_DISCRETE, READ_HOLDING, READ_INPUT, WRITE_COILS = 1, 2, 3, 4, 15


def float_words(value: float, *, low_first: bool = False) -> list[int]:
    """Return the two registers of a number."""
    high, low = struct.unpack(">2H", struct.pack(">f", value))
    return [low, high] if low_first else [high, low]


class ModbusDevicePeer(TcpPort):
    """A device with the registers and bits that it is given, at `address` within its context."""

    def __init__(self, unit: int = 1) -> None:
        super().__init__()
        self.unit = unit
        self.registers: dict[int, dict[int, int]] = {READ_HOLDING: {}, READ_INPUT: {}}
        self.bits: dict[int, dict[int, bool]] = {READ_COILS: {}, READ_DISCRETE: {}}
        self.requests: list[tuple[int, int, int]] = []
        self.written: Callable[[], None] = lambda: None

    def serve(self, client: socket.socket) -> None:
        with client.makefile("rb") as stream:
            while len(head := stream.read(7)) == 7:
                transaction, protocol, length, unit = struct.unpack(">3HB", head)
                answer = self._answer(unit, stream.read(length - 1))
                length = len(answer) + 1
                client.sendall(struct.pack(">3HB", transaction, protocol, length, unit) + answer)

    def _answer(self, unit: int, request: bytes) -> bytes:
        function, first, count = struct.unpack(">BHH", request[:5])
        if unit != self.unit:
            return bytes([function | 0x80, 11])
        self.requests.append((function, first, count))
        wanted = range(first, first + count)
        if function in self.registers:
            table = self.registers[function]
            if not all(place in table for place in wanted):
                return bytes([function | 0x80, 2])
            words = [table[place] for place in wanted]
            return struct.pack(f">BB{count}H", function, 2 * count, *words)
        if function in self.bits:
            bits = self.bits[function]
            if not all(place in bits for place in wanted):
                return bytes([function | 0x80, 2])
            number = sum(bits[place] << k for k, place in enumerate(wanted))
            size = (count + 7) // 8
            return struct.pack(">BB", function, size) + number.to_bytes(size, "little")
        if function == WRITE_COILS:
            coils = self.bits[READ_COILS]
            if not all(place in coils for place in wanted):
                return bytes([function | 0x80, 2])
            number = int.from_bytes(request[6:], "little")
            coils.update({place: bool(number >> k & 1) for k, place in enumerate(wanted)})
            self.written()
            return request[:5]
        return bytes([function | 0x80, 1])
