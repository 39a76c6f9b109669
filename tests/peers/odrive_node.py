"""An ODrive controller on a CAN bus, after the manual's table of CANSimple messages (firmware 0.6).

A message's number is node · 32 + command; an empty frame of a cyclic command is answered by it.
"""

import struct
import threading
import time

from tests.peers.socketcand import SocketcandPeer

UNDEFINED, IDLE, CLOSED_LOOP = 0, 1, 8
WATCHDOG_TIMER_EXPIRED, ESTOP = 0x1000000, 0x2000000


class OdrivePeer(SocketcandPeer):
    """Node `node`; `torque_nm` and `velocity` (1/s) are its inputs, `watchdog_s` its own setting.

    Its heartbeat comes every 100 ms.
    """

    def __init__(self, node: int, watchdog_s: float = 0.0, firmware: bytes = b"\0\6\12") -> None:
        super().__init__()
        self.node, self.watchdog_s, self.firmware = node, watchdog_s, firmware
        self.serial = 0x3868365F3132
        self.state, self.errors = IDLE, 0
        self.control_mode, self.input_mode = 3, 1  # position control, as delivered
        self.torque_nm = self.velocity = 0.0
        self.position = 0.25
        self.torques: list[float] = []
        self.velocities: list[float] = []
        self.lock = threading.RLock()
        self._fed_s = time.monotonic()
        self._ending = threading.Event()
        self._beating = threading.Thread(target=self._beat, daemon=True)

    def __enter__(self) -> "OdrivePeer":
        self._beating.start()
        return super().__enter__()

    def __exit__(self, *ended: object) -> None:
        self._ending.set()
        self._beating.join()
        super().__exit__(None, None, None)

    def _beat(self) -> None:
        while not self._ending.wait(0.1):
            with self.lock:
                self.look()
                message = struct.pack("<IBBBx", self.errors, self.state, 0, 0)
            self.send(self.node << 5 | 0x01, message)

    @property
    def powered(self) -> bool:
        return self.state == CLOSED_LOOP

    def look(self) -> None:
        starved = self.watchdog_s and time.monotonic() - self._fed_s > self.watchdog_s
        if self.state == CLOSED_LOOP and starved:
            self.fail(WATCHDOG_TIMER_EXPIRED)

    def fail(self, error: int) -> None:
        """Disarm the motor for a reason."""
        self.errors |= error
        self.state = IDLE

    def receive(self, number: int, data: bytes) -> None:
        if number >> 5 != self.node:
            return
        with self.lock:
            self.look()
            answer = self._obey(number & 0x1F, data)
        if answer:
            self.send(number, answer)

    def _obey(self, command: int, data: bytes) -> bytes:
        if not data:
            answers = {
                0x00: bytes([2, 4, 4, 58]) + self.firmware + b"\0",
                0x06: bytes([self.node]) + self.serial.to_bytes(6, "little"),
                0x09: struct.pack("<ff", self.position, self.velocity),
                0x1C: struct.pack("<ff", self.torque_nm, self.torque_nm + 0.01),
            }
            return answers.get(command, b"")
        if command == 0x07:
            (wanted,) = struct.unpack("<I", data)
            self._fed_s = time.monotonic()
            if wanted == IDLE or not self.errors:
                self.state = wanted
        elif command == 0x0B:
            self.control_mode, self.input_mode = struct.unpack("<II", data)
        elif command == 0x0D:
            self._fed_s = time.monotonic()
            self.velocity, self.torque_nm = struct.unpack("<ff", data)
            self.velocities.append(self.velocity)
        elif command == 0x0E:
            self._fed_s = time.monotonic()
            (self.torque_nm,) = struct.unpack("<f", data)
            if self.state == CLOSED_LOOP:
                self.torques.append(self.torque_nm)
        elif command == 0x18:
            self.errors = 0
        return b""
