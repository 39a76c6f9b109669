"""A moteus controller behind an fdcanusb adapter, after moteus' reference (register protocol).

A frame has subframes: 0x0T/0x1T/0x2T write, read, reply of type T (0 int8, 1 int16, 2 int32,
3 float), with the number of registers in the low bits, or in the next byte if these are 0.
"""

import math
import struct
import time
from collections.abc import Callable

from tests.peers.lines import LinePeer

STOPPED, FAULT, POSITION, TIMEOUT = 0, 1, 10, 11
FORMS = ("<b", "<h", "<i", "<f")
SCALES = {0x001: (0.01, 0.0001, 0.00001), 0x000: (1, 1, 1), 0x00F: (1, 1, 1)}


def varuint(data: bytes) -> tuple[int, bytes]:
    value = shift = 0
    for k, byte in enumerate(data):
        value |= (byte & 0x7F) << shift
        shift += 7
        if not byte & 0x80:
            return value, data[k + 1 :]
    raise ValueError(data)


class MoteusPeer(LinePeer):
    """Node `node`; `torque_nm` and `velocity` (1/s) are its set points."""

    def __init__(self, node: int, serial: bool = False, number: int = 0x0A0B0C0D) -> None:
        super().__init__(serial=serial)
        self.node, self.number = node, number
        self.mode, self.fault_code, self.position = STOPPED, 0, 0.25
        self.follows: Callable[[], float] | None = None  # what turns the shaft instead
        self.turns = False  # whether the position follows the velocity
        self._looked_s = time.monotonic()
        self.torque_nm = self.velocity = 0.0
        self.torques: list[float] = []
        self._until = math.inf
        self._written: dict[int, float] = {}

    @property
    def powered(self) -> bool:
        return self.mode == POSITION

    def look(self) -> None:
        passed_s = time.monotonic() - self._looked_s
        self._looked_s += passed_s
        self.position += self.velocity * passed_s if self.turns else 0.0
        if self.follows is not None:
            self.position = self.follows()
        if self.mode == POSITION and time.monotonic() > self._until:
            self.mode = TIMEOUT
        if self.mode != POSITION:
            self.torque_nm = self.velocity = 0.0

    def answer(self, line: str) -> str | None:
        words = line.split()
        if words[:2] != ["can", "send"]:
            return "ERR unknown command"
        arbitration, data = int(words[2], 16), bytes.fromhex(words[3])
        if arbitration & 0x7F != self.node:
            return "OK"
        self.look()
        reply = self._obey(data)
        if not arbitration & 0x8000:
            return "OK"
        return f"OK\r\nrcv {self.node << 8:x} {reply.hex()} E B F"

    def _obey(self, data: bytes) -> bytes:
        reply, written = b"", {}
        while data:
            head, data = data[0], data[1:]
            if head == 0x50:
                continue
            kind, form, count = head & 0xF0, head >> 2 & 3, head & 3
            if not count:
                count, data = varuint(data)
            first, data = varuint(data)
            layout = FORMS[form]
            for register in range(first, first + count):
                if kind == 0x00:
                    size = struct.calcsize(layout)
                    written[register] = struct.unpack(layout, data[:size])[0]
                    data = data[size:]
            if kind == 0x10:
                self._command(written)
                written = {}
                reply += self._registers(first, count, form)
        self._command(written)
        return reply

    def _command(self, written: dict[int, float]) -> None:
        if not written:
            return
        mode = written.get(0x000)
        if mode == STOPPED:
            self.mode, self.fault_code = STOPPED, 0
        elif mode == POSITION and self.mode in (STOPPED, POSITION):
            self.mode = POSITION
            self._until = time.monotonic() + written.get(0x027, 0.1)
            most = written.get(0x025, math.inf)
            self.torque_nm = max(-most, min(most, written.get(0x022, 0.0)))
            self.velocity = written.get(0x021, 0.0)
            self.torques.append(self.torque_nm)
        self.look()

    def _registers(self, first: int, count: int, form: int) -> bytes:
        values: dict[int, float] = {
            0x000: self.mode,
            0x001: self.position,
            0x002: self.velocity,
            0x003: self.torque_nm,
            0x00D: 24.0,
            0x00E: 30.0,
            0x00F: self.fault_code,
            0x039: self.velocity,
            0x03A: self.torque_nm,
            0x101: 0x010A00,
            0x120: 0x11223344,
            0x121: 0x55667788,
            0x122: self.number,
        }
        reply = bytes([0x20 | form << 2]) + bytes([count]) + self._number(first)
        for register in range(first, first + count):
            value = values[register]
            if form != 3:
                value = round(value / SCALES.get(register, (1, 1, 1))[form])
            reply += struct.pack(FORMS[form], value)
        return reply

    @staticmethod
    def _number(value: int) -> bytes:
        return bytes([value]) if value < 0x80 else bytes([value & 0x7F | 0x80, value >> 7])
