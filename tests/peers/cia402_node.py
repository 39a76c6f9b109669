"""A CiA 402 drive on a bus that socketcand shares, over bare sockets."""

import math
import struct
import time
from collections.abc import Callable

from tests.peers.motor import Motor
from tests.peers.socketcand import SocketcandPeer

RATED_MNM = 400_000
LARGEST_PERMILLE, LARGEST_RPM = 6000, 24
UNITS_PER_RPM = 1000.0
RPM = 0.10471975511965977
STATES = {
    "switch on disabled": 0x40,
    "ready to switch on": 0x21,
    "switched on": 0x23,
    "operation enabled": 0x27,
    "quick stop active": 0x07,
    "fault": 0x08,
}
READ_ONLY = (0x1008, 0x1018, 0x603F, 0x6041, 0x6061, 0x6064, 0x6074, 0x6077, 0x606B, 0x606C)
WRITABLE = {
    **{(0x1016, 1): "<I", (0x6007, 0): "<h", (0x6040, 0): "<H", (0x6060, 0): "<b"},
    **{(0x6071, 0): "<h", (0x6083, 0): "<I", (0x6084, 0): "<I", (0x6085, 0): "<I"},
    **{(0x6087, 0): "<I", (0x60FF, 0): "<i"},
}


class Cia402Objects:
    """A drive's objects; `slowness_s` is how long each step to its power takes."""

    fault_code = 0x8130

    def __init__(self, serial: int, slowness_s: float = 0.0) -> None:
        self.motor = Motor()
        self.slowness_s = slowness_s
        self._stored = dict.fromkeys(WRITABLE, 0)
        self._state, self._due, self._next = "switch on disabled", 0.0, ""
        self._master, self._watchdog_s = 0, 0.0
        self._texts = {0x1008: b"drive of its own"}
        self._identity = {1: 0xAFFE, 2: 7, 3: 1, 4: serial}
        self.position = 0
        self.largest_permille, self.largest_rpm = LARGEST_PERMILLE, LARGEST_RPM
        self.modes = 0x0C  # profile velocity and profile torque
        self.torques: list[int] = []
        self.bits = 0x210  # voltage enabled, remote
        self.missing: set[tuple[int, int]] = set()
        self.not_yet = 0  # so many writings are refused in this state

    # -- objects ----------------------------------------------------------------------------

    def _read(self, index: int, subindex: int) -> bytes:
        motor = self.motor
        if (index, subindex) in self.missing:
            raise Abort(0x06090011 if subindex else 0x06020000)
        if index in self._texts:
            return self._texts[index]
        if index == 0x1018 and subindex in self._identity:
            return struct.pack("<I", self._identity[subindex])
        torque = round(motor.torque.present * 1e6 / RATED_MNM)
        velocity = round(motor.speed.present / RPM * UNITS_PER_RPM)
        found = {
            0x1000: struct.pack("<I", 0x20192),
            0x603F: struct.pack("<H", self.fault_code if motor.tripped else 0),
            0x6041: struct.pack("<H", STATES[self._state] | self.bits),
            0x6061: struct.pack("<b", self._stored[0x6060, 0]),
            0x6072: struct.pack("<H", self.largest_permille),
            0x6074: struct.pack("<h", torque),
            0x6076: struct.pack("<I", RATED_MNM),
            0x6502: struct.pack("<I", self.modes),
            0x6077: struct.pack("<h", torque),
            0x6080: struct.pack("<I", self.largest_rpm),
            0x6064: struct.pack("<i", self.position),
            0x606B: struct.pack("<i", velocity),
            0x606C: struct.pack("<i", velocity),
        }
        if index in found:
            return found[index]
        if (index, subindex) in WRITABLE:
            return struct.pack(WRITABLE[index, subindex], self._stored[index, subindex])
        raise Abort(0x06020000)

    def _download(self, index: int, subindex: int, data: bytes) -> None:
        layout = WRITABLE.get((index, subindex))
        if self.not_yet and index != 0x1016:
            self.not_yet -= 1
            raise Abort(0x08000022)
        if layout is None or (index, subindex) in self.missing:
            raise Abort(0x06010002 if index in READ_ONLY else 0x06020000)
        if struct.calcsize(layout) != len(data):
            raise Abort(0x06070010)
        (value,) = struct.unpack(layout, data)
        if index == 0x6060 and not self.modes >> value - 1 & 1:
            raise Abort(0x06090030)
        if index == 0x6071 and abs(value) > LARGEST_PERMILLE:
            raise Abort(0x06090031 if value > 0 else 0x06090032)
        if index in (0x6083, 0x6084, 0x6085, 0x6087) and value == 0:
            raise Abort(0x06090032)
        self._stored[index, subindex] = value
        if index == 0x1016:
            self._master, self._watchdog_s = value >> 16, (value & 0xFFFF) / 1e3
            self.motor.watchdog_s = 0.0
        elif index == 0x6040:
            self._control(value)
        elif index in (0x6060, 0x6071, 0x60FF):
            self._go()

    _word = 0

    def _control(self, word: int) -> None:
        rising, self._word = word & ~self._word, word
        if self._state == "fault":
            if rising & 0x80:
                self.motor.reset()
                self._state = "switch on disabled"
        elif not word & 0x02:
            self.motor.power(False)
            self._state, self._next = "switch on disabled", ""
        elif not word & 0x04:
            for ramp in (self.motor.torque, self.motor.speed):
                ramp.zero(0.1)
            self._state = "quick stop active"
        else:
            wanted = {0x06: "ready to switch on", 0x07: "switched on", 0x0F: "operation enabled"}
            order = list(STATES)[:4]
            name = wanted.get(word & 0x0F, "")
            if name and order.index(name) < order.index(self._state):  # down again, without power
                self.motor.power(False)
                self._state, self._next = name, ""
            elif name and order.index(name) == order.index(self._state) + 1:
                self._next, self._due = name, time.monotonic() + self.slowness_s
                self._look()

    def _look(self) -> None:
        """Take over what time has brought."""
        self.motor.look()
        if self.motor.tripped:
            self._state, self._next = "fault", ""
        if self._next and time.monotonic() >= self._due:
            self._state, self._next = self._next, ""
            if self._state == "operation enabled":
                self.motor.power(True)
                self._go()

    def _go(self) -> None:
        """Go to the target of the present mode."""
        if self._state != "operation enabled":
            return
        nm = RATED_MNM / 1e6
        if self._stored[0x6060, 0] == 10:  # a cyclic mode follows at once
            self.torques.append(self._stored[0x6071, 0])
            self.motor.torque.go(self._stored[0x6071, 0] * nm, math.inf)
        elif self._stored[0x6060, 0] == 9:
            self.motor.speed.go(self._stored[0x60FF, 0] * RPM / 1e3, math.inf)
        elif self._stored[0x6060, 0] == 4:
            self.motor.torque.go(self._stored[0x6071, 0] * nm, self._stored[0x6087, 0] * nm)
        else:
            present, target = self.motor.speed.present, self._stored[0x60FF, 0] * RPM / 1e3
            index = 0x6083 if abs(target) > abs(present) else 0x6084
            self.motor.speed.go(target, self._stored[index, 0] * RPM / 1e3)


class Cia402Peer(Cia402Objects, SocketcandPeer):
    """One node on a CANopen bus."""

    def __init__(self, node: int, serial: int, slowness_s: float = 0.0) -> None:
        Cia402Objects.__init__(self, serial, slowness_s)
        SocketcandPeer.__init__(self)
        self.node = node
        self._segments = b""
        self.spoil: Callable[[bytes], bytes] | None = None

    def receive(self, number: int, data: bytes) -> None:
        with self.motor.lock:
            answer = self._frame(number, data)
        if answer:
            self.send(0x580 + self.node, self.spoil(answer) if self.spoil else answer)

    def emergency(self, code: int) -> None:
        """Send an EMCY message to everybody."""
        self.send(0x80 + self.node, struct.pack("<HB5x", code, 1))

    def _frame(self, can_id: int, data: bytes) -> bytes:
        self._look()
        if can_id == 0x700 + self._master and self._master:
            self.motor.watchdog_s = self._watchdog_s
            self.motor.feed()
        if can_id != 0x600 + self.node:
            return b""
        command, index, subindex = struct.unpack_from("<BHB", data)
        try:
            if command & 0xE0 == 0x40:
                return self._upload(index, subindex)
            if command & 0xE0 == 0x60:
                return self._segment(command)
            if command & 0xE2 == 0x22:
                size = 4 - (command >> 2 & 3) if command & 1 else 4
                self._download(index, subindex, data[4 : 4 + size])
                return struct.pack("<BHB4x", 0x60, index, subindex)
            raise Abort(0x05040001)
        except Abort as abort:
            return struct.pack("<BHBI", 0x80, index, subindex, abort.code)

    def _upload(self, index: int, subindex: int) -> bytes:
        value = self._read(index, subindex)
        if len(value) <= 4:
            command = 0x43 | (4 - len(value)) << 2
            return struct.pack("<BHB", command, index, subindex) + value.ljust(4, b"\0")
        self._segments = value
        return struct.pack("<BHBI", 0x41, index, subindex, len(value))

    def _segment(self, command: int) -> bytes:
        part, self._segments = self._segments[:7], self._segments[7:]
        last = 0 if self._segments else 1
        return bytes([command & 0x10 | (7 - len(part)) << 1 | last]) + part.ljust(7, b"\0")


class Abort(Exception):  # noqa: N818 - as CiA 301 calls it
    def __init__(self, code: int) -> None:
        super().__init__(hex(code))
        self.code = code
