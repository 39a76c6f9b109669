"""A CAN bus over TCP with the protocol of `socketcand`, with simulated CANopen nodes on it."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from typing import Any

import canopen

from torquebench.simulators.cia402 import Cia402Node
from torquebench.simulators.line_server import LineServer
from torquebench.simulators.misbehaviour import WireFaults

LONGEST_FRAME = 200
TICK_S = 0.005


class _Periodic:
    """A frame that is sent periodically, such as a heartbeat."""

    def __init__(self, can_id: int, data: bytes, period_s: float) -> None:
        self.can_id = can_id
        self.data = data
        self.period_s = period_s
        self.due_s = time.monotonic()
        self.over = False

    def update(self, data: Any) -> None:
        """Send this data from now on."""
        self.data = bytes(data)

    def stop(self) -> None:
        """Stop sending."""
        self.over = True


class _ServedNetwork(canopen.Network):
    """CANopen's network interface on this simulated bus, instead of one opened by python-can."""

    def __init__(self, bus: CanBusSimulator) -> None:
        super().__init__(None)
        self._served = bus
        self.periodic: list[_Periodic] = []

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Send a node's frame to the bus."""
        if not remote:
            self._served.broadcast(can_id, bytes(data))

    def send_periodic(self, can_id: int, data: Any, period: float, remote: bool = False) -> Any:
        """Send a node's frame periodically."""
        del remote
        task = _Periodic(can_id, bytes(data), period)
        self.periodic.append(task)
        return task


class CanBusSimulator(LineServer):
    """A bus to which clients connect by python-can's interface `socketcand`.

    Parameters
    ----------
    faults : WireFaults
        Faults in the frames of the nodes.
    host, port
        With port 0, a free port is chosen, which `port` then holds.
    """

    def __init__(self, faults: WireFaults, host: str, port: int) -> None:
        self.network = _ServedNetwork(self)
        self._bus_lock = threading.RLock()
        self._open: dict[socket.socket, threading.Lock] = {}
        self._nodes: list[Cia402Node] = []
        super().__init__(faults, host, port)
        self._ticking = threading.Thread(target=self._tick, name=f"bus of {faults.name}")
        self._ticking.daemon = True
        self._ticking.start()

    def add_node(self, node: Cia402Node) -> None:
        """Add a drive to the bus; the drive boots."""
        with self._bus_lock:
            self._nodes.append(node)
            node.join(self.network)

    def _tick(self) -> None:
        """Let nodes send unrequested frames: heartbeats and emergencies."""
        while not self._closing.wait(TICK_S):
            now_s = time.monotonic()
            with self._bus_lock:
                for node in self._nodes:
                    node.tick()
                periodic = [task for task in self.network.periodic if not task.over]
                self.network.periodic = periodic
                for task in periodic:
                    if now_s >= task.due_s:
                        task.due_s = now_s + task.period_s
                        self.broadcast(task.can_id, task.data)

    def close(self) -> None:
        """End the bus. A second call does nothing."""
        super().close()
        self._ticking.join()

    def broadcast(self, can_id: int, data: bytes, sender: socket.socket | None = None) -> None:
        """Send a frame to every client except the sender."""
        frame = f"< frame {can_id:03X} {time.time():.6f} {data.hex()} >".encode("ascii")
        if sender is None:
            spoilt = self.faults.outgoing(frame)
            if spoilt is None:
                return
            frame = spoilt
        for client, lock in list(self._open.items()):
            if client is not sender:
                with lock, contextlib.suppress(OSError):
                    client.sendall(frame)

    def attend(self, connection: socket.socket) -> None:
        """Serve one client by socketcand's protocol until it disconnects."""
        try:
            with contextlib.suppress(OSError):
                connection.sendall(b"< hi >")
                rest = b""
                while data := connection.recv(4096):
                    rest += data
                    while b">" in rest:
                        line, _, rest = rest.partition(b">")
                        self._obey(connection, line.replace(b"<", b"").split())
                    if len(rest) > LONGEST_FRAME:
                        return
        finally:
            self._open.pop(connection, None)

    def _obey(self, connection: socket.socket, words: list[bytes]) -> None:
        """Obey one command of a socketcand client."""
        if not words:
            return
        if words[0] == b"open":
            connection.sendall(b"< ok >")
        elif words[0] == b"rawmode":
            connection.sendall(b"< ok >")
            self._open[connection] = threading.Lock()
        elif words[0] == b"send" and len(words) >= 3:
            try:
                can_id = int(words[1], 16)
                data = bytes(int(word, 16) for word in words[3 : 3 + int(words[2], 16)])
            except ValueError:
                connection.sendall(b"< error could not parse >")
                return
            self.broadcast(can_id, data, sender=connection)
            with self._bus_lock:
                self.network.notify(can_id, bytearray(data), time.time())
