"""A Modbus TCP server with one image of the simulated bench.

It doesn't use pymodbus's server, which loses requests that arrive before it has answered.
"""

from __future__ import annotations

import contextlib
import socket
import struct
from collections.abc import Callable, Mapping
from enum import IntEnum

from torquebench.errors import TorquebenchError
from torquebench.simulators.line_server import LineServer
from torquebench.simulators.misbehaviour import WireFaults
from torquebench.simulators.modbus_images import Image

HEADER = struct.Struct(">HHHB")
LONGEST_REQUEST = 254
LONGEST_BITS, LONGEST_WORDS = 2000, 125
LONGEST_WRITTEN_BITS, LONGEST_WRITTEN_WORDS = 1968, 123
ANY_UNIT = (0, 255)
"""Unit identifiers by which a Modbus TCP client addresses the instrument itself."""


class Code(IntEnum):
    """Exception codes."""

    ILLEGAL_FUNCTION = 1
    ILLEGAL_ADDRESS = 2
    ILLEGAL_VALUE = 3
    DEVICE_FAILURE = 4
    BUSY = 6
    NO_SUCH_UNIT = 11


class _RefusedError(Exception):
    def __init__(self, code: Code) -> None:
        super().__init__(code)
        self.code = code


class ModbusSimulator(LineServer):
    """One simulated instrument on Modbus TCP: functions 1 to 6, 15 and 16.

    Requests may arrive before earlier ones are answered; answers keep their order.

    Parameters
    ----------
    host, port
        With port 0, a free port is chosen, which `port` then holds.
    base : int
        First register of the image.
    """

    def __init__(
        self, image: Image, faults: WireFaults, host: str, port: int, unit: int = 1, base: int = 0
    ) -> None:
        self._image = image
        self._unit = unit
        self._base = base
        self._frozen: dict[int, dict[int, int]] = {}
        super().__init__(faults, host, port)

    def attend(self, connection: socket.socket) -> None:
        """Answer one client until it disconnects or sends invalid Modbus data."""
        received = b""
        with contextlib.suppress(OSError):
            while data := connection.recv(4096):
                received += data
                while len(received) >= HEADER.size:
                    transaction, protocol, length, unit = HEADER.unpack_from(received)
                    if protocol != 0 or not 2 <= length <= LONGEST_REQUEST:
                        return
                    if len(received) < HEADER.size - 1 + length:
                        break
                    request = received[HEADER.size : HEADER.size - 1 + length]
                    received = received[HEADER.size - 1 + length :]
                    answer = self._answer(unit, request)
                    header = HEADER.pack(transaction, 0, len(answer) + 1, unit)
                    spoilt = self.faults.outgoing(header + answer)
                    if spoilt is not None:
                        connection.sendall(spoilt)

    def _answer(self, unit: int, request: bytes) -> bytes:
        """Return the answer to a request, or the exception that it causes."""
        function = request[0]
        try:
            if unit != self._unit and unit not in ANY_UNIT:
                raise _RefusedError(Code.NO_SUCH_UNIT)
            serve = self._functions.get(function)
            if serve is None:
                raise _RefusedError(Code.ILLEGAL_FUNCTION)
            if self.faults.busy:
                raise _RefusedError(Code.BUSY)
            return bytes([function]) + serve(function, request[1:])
        except _RefusedError as refused:
            code = refused.code
        except IndexError:
            code = Code.ILLEGAL_ADDRESS
        except (ValueError, struct.error):
            code = Code.ILLEGAL_VALUE
        except TorquebenchError:
            code = Code.DEVICE_FAILURE
        return bytes([function | 0x80, code])

    @property
    def _functions(self) -> Mapping[int, Callable[[int, bytes], bytes]]:
        """Return the handlers by function code."""
        bits, words = self._read_bits, self._read_words
        one_bit, one_word = self._write_bit, self._write_word
        return {1: bits, 2: bits, 3: words, 4: words, 5: one_bit, 6: one_word} | {
            15: self._write_bits,
            16: self._write_words,
        }

    # -- reading ----------------------------------------------------------------------------

    def _table(self, function: int) -> dict[int, int]:
        """Return the table of a function by the protocol's addresses."""
        if not self.faults.frozen:
            self._frozen.pop(function, None)
        elif function in self._frozen:
            return self._frozen[function]
        tables = {
            1: self._image.coils,
            2: self._image.contacts,
            3: self._image.holding,
            4: self._image.inputs,
        }
        with self._image.plant.lock:
            words = {self._base + offset: value for offset, value in tables[function]().items()}
        if function == 4:
            words |= self._image.plate
        if self.faults.frozen:
            self._frozen[function] = words
        return words

    def _read(self, function: int, request: bytes, most: int) -> list[int]:
        """Return the requested values of a table; refuse too many or unknown ones."""
        first, count = struct.unpack(">HH", request)
        if not 1 <= count <= most:
            raise _RefusedError(Code.ILLEGAL_VALUE)
        table = self._table(function)
        try:
            return [int(table[address]) for address in range(first, first + count)]
        except KeyError:
            raise _RefusedError(Code.ILLEGAL_ADDRESS) from None

    def _read_words(self, function: int, request: bytes) -> bytes:
        words = self._read(function, request, LONGEST_WORDS)
        return struct.pack(f">B{len(words)}H", 2 * len(words), *words)

    def _read_bits(self, function: int, request: bytes) -> bytes:
        bits = self._read(function, request, LONGEST_BITS)
        packed = sum(bit << position for position, bit in enumerate(bits))
        size = -(-len(bits) // 8)
        return bytes([size]) + packed.to_bytes(size, "little")

    # -- writing ----------------------------------------------------------------------------

    def _obey(self, write: Callable[[int, list[int]], None], first: int, values: list[int]) -> None:
        """Write values at an address; a misbehaving device ignores them."""
        if self.faults.ignoring:
            return
        with self._image.plant.lock:
            if first < self._base:
                raise _RefusedError(Code.ILLEGAL_ADDRESS)
            write(first - self._base, values)

    def _write_word(self, function: int, request: bytes) -> bytes:
        del function
        address, value = struct.unpack(">HH", request)
        self._obey(self._image.written, address, [value])
        return request

    def _write_bit(self, function: int, request: bytes) -> bytes:
        """Obey the writing of one bit."""
        del function
        address, value = struct.unpack(">HH", request)
        if value not in (0x0000, 0xFF00):
            raise _RefusedError(Code.ILLEGAL_VALUE)
        self._obey(self._image.switched, address, [int(value == 0xFF00)])
        return request

    def _write_words(self, function: int, request: bytes) -> bytes:
        """Obey the writing of several registers."""
        del function
        first, count, size = struct.unpack_from(">HHB", request)
        if not 1 <= count <= LONGEST_WRITTEN_WORDS or size != 2 * count:
            raise _RefusedError(Code.ILLEGAL_VALUE)
        self._obey(self._image.written, first, list(struct.unpack(f">{count}H", request[5:])))
        return request[:4]

    def _write_bits(self, function: int, request: bytes) -> bytes:
        """Obey the writing of several bits."""
        del function
        first, count, size = struct.unpack_from(">HHB", request)
        sizes = {-(-count // 8), len(request) - 5}
        if not 1 <= count <= LONGEST_WRITTEN_BITS or sizes != {size}:
            raise _RefusedError(Code.ILLEGAL_VALUE)
        packed = int.from_bytes(request[5:], "little")
        self._obey(
            self._image.switched, first, [packed >> position & 1 for position in range(count)]
        )
        return request[:4]
