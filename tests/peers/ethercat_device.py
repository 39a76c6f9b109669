"""A CiA 402 drive on EtherCAT (states of ETG.1000, CoE), behind a fake of `pysoem`'s API.

The fake library (`ethercat_library/pysoem.py`) is what the driver imports, perhaps in another
process; its "network adapter" is this device's address. Requests are lines of JSON.
"""

import contextlib
import json
import socket
import struct
import time
from typing import Any

from tests.peers.cia402_node import WRITABLE, Abort, Cia402Objects

from torquebench.testing.cable import TcpPort

LIBRARY = __file__.replace("ethercat_device.py", "ethercat_library")
INIT, PREOP, SAFEOP, OP, ERROR = 1, 2, 4, 8, 0x10
WATCHDOG = 0x1B
FORMATS = {8: "b", 16: "H", 32: "i"}


class EthercatPeer(Cia402Objects):
    """One drive; `process_watchdog_s` is what the master has set."""

    fault_code = 0x7500

    def __init__(self, serial: int) -> None:
        super().__init__(serial)
        self.modes = 0x300  # cyclic synchronous velocity and torque
        self.al_state, self.al_status = INIT, 0
        self.process_watchdog_s = 0.1
        self.maps: dict[int, list[int]] = {0x1600: [], 0x1A00: []}
        self.assigned: dict[int, list[int]] = {0x1C12: [], 0x1C13: []}
        self.cycles = 0
        self._cycled_s = time.monotonic()

    # -- states -----------------------------------------------------------------------------

    def look(self) -> None:
        """Take over what time has brought."""
        late = time.monotonic() - self._cycled_s > self.process_watchdog_s
        if self.al_state == OP and late:
            self.al_state, self.al_status = SAFEOP | ERROR, WATCHDOG
            if self.motor.on:
                self.motor.power_lost()
        self._look()

    def request_state(self, wanted: int) -> None:
        if self.al_state & ERROR:
            if wanted & ERROR:  # acknowledged
                self.al_state, self.al_status = self.al_state & 0xF, 0
        else:
            self.al_state = wanted & 0xF
        if wanted == OP and self.al_state == OP:
            self._cycled_s = time.monotonic()

    # -- objects ----------------------------------------------------------------------------

    def sdo_read(self, index: int, subindex: int) -> bytes:
        return self._read(index, subindex)

    def sdo_write(self, index: int, subindex: int, data: bytes) -> None:
        for table, layout in ((self.maps, "<I"), (self.assigned, "<H")):
            if index in table:
                if self.al_state not in (INIT, PREOP):
                    raise Abort(0x08000022)
                if subindex:
                    table[index].append(struct.unpack(layout, data)[0])
                elif not data[0]:
                    table[index].clear()
                elif data[0] != len(table[index]):
                    raise Abort(0x06040042)
                return
        self._download(index, subindex, data)

    def _mapped(self, assignment: int) -> list[int]:
        return [entry for pdo in self.assigned[assignment] for entry in self.maps[pdo]]

    def cycle(self, out: bytes) -> bytes:
        """Take the outputs, and return the inputs."""
        if self.al_state == OP:
            self._cycled_s = time.monotonic()
            self.cycles += 1
            for entry in self._mapped(0x1C12):
                size = (entry & 0xFF) // 8
                value, out = out[:size], out[size:]
                index = entry >> 16
                held = struct.pack(WRITABLE[index, 0], self._stored[index, 0])
                if held != value and not (index == 0x6060 and value == b"\0"):
                    with contextlib.suppress(Abort):  # out of range: the drive keeps the last one
                        self._download(index, 0, value)
        return b"".join(self._read(entry >> 16, 0) for entry in self._mapped(0x1C13))

    def size(self, assignment: int) -> int:
        return sum((entry & 0xFF) // 8 for entry in self._mapped(assignment))


class EthercatNetwork(TcpPort):
    """Devices in a row behind one adapter, whose cable can fail."""

    def __init__(self, *devices: EthercatPeer) -> None:
        super().__init__()
        self.devices = devices

    def garbled(self, data: bytes) -> bytes:
        return bytes(byte ^ 0x5A for byte in data * 3)

    def serve(self, client: socket.socket) -> None:
        with contextlib.suppress(ValueError), client.makefile("rb") as lines:
            for line in lines:
                answer = self._answer(json.loads(line))
                late_s = self.fault("delay")
                if late_s is not None:
                    time.sleep(late_s)
                if self.fault("drop") is None and self.fault("cut") is None:
                    client.sendall(json.dumps(answer).encode() + b"\n")

    def _answer(self, request: dict[str, Any]) -> dict[str, Any]:
        name = request["name"]
        if name == "count":
            return {"count": len(self.devices)}
        if name == "cycle":
            inputs = []
            for device, out in zip(self.devices, request["out"], strict=True):
                with device.motor.lock:
                    device.look()
                    inputs.append(device.cycle(bytes.fromhex(out)).hex())
            working = sum(3 if d.al_state == OP else 1 for d in self.devices)
            return {"in": inputs, "working": working}
        device = self.devices[request["position"]]
        with device.motor.lock:
            device.look()
            try:
                return self._of_device(device, name, request)
            except Abort as abort:
                return {"abort": abort.code}

    def _of_device(
        self, device: EthercatPeer, name: str, request: dict[str, Any]
    ) -> dict[str, Any]:
        if name == "sdo_read":
            data = device.sdo_read(request["index"], request["subindex"])
            return {
                "data": (self.garbled(data) * 3 if self.fault("garble") is not None else data).hex()
            }
        if name == "sdo_write":
            device.sdo_write(request["index"], request["subindex"], bytes.fromhex(request["data"]))
        elif name == "request_state":
            device.request_state(request["state"])
        elif name == "watchdog":
            device.process_watchdog_s = request["ms"] / 1e3
        return {
            "state": device.al_state,
            "status": device.al_status,
            "sizes": [device.size(0x1C12), device.size(0x1C13)],
        }
