"""A CAN bus over TCP as `socketcand` serves one, with simulated CANopen nodes on it."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from typing import Any

import canopen

from torquebench.simulators.line_server import LineServer
from torquebench.simulators.misbehaviour import WireFaults

__all__ = ["CanBusSimulator"]

LONGEST_FRAME = 200


class _ServedNetwork(canopen.Network):
    """CANopen's services on a bus that is served here instead of one that python-can opens."""

    def __init__(self, bus: CanBusSimulator) -> None:
        super().__init__(None)
        self._served = bus

    def send_message(self, can_id: int, data: bytes, remote: bool = False) -> None:
        """Put a node's frame on the bus."""
        if not remote:
            self._served.broadcast(can_id, bytes(data))


class CanBusSimulator(LineServer):
    """A bus that clients reach by python-can's interface `socketcand`.

    Parameters
    ----------
    faults : WireFaults
        Spoils frames of the nodes.
    host, port
        Port 0 takes a free one, which `port` then says.
    """

    def __init__(self, faults: WireFaults, host: str, port: int) -> None:
        self.network = _ServedNetwork(self)
        self._bus_lock = threading.RLock()
        self._open: dict[socket.socket, threading.Lock] = {}
        super().__init__(faults, host, port)

    def add_node(self, node: Any) -> None:
        """Put a node on the bus."""
        with self._bus_lock:
            self.network.add_node(node)

    def broadcast(self, can_id: int, data: bytes, sender: socket.socket | None = None) -> None:
        """Show a frame to every client, except to the one that sent it."""
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
        """Speak socketcand's protocol with one client until it goes."""
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
