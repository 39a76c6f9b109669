"""A CAN bus with one node that socketcand shares, over bare sockets."""

import contextlib
import socket
import threading
import time

from torquebench.testing.cable import TcpPort


class SocketcandPeer(TcpPort):
    """`receive` gets every frame of the clients, `send` writes one to all of them."""

    def __init__(self) -> None:
        super().__init__()
        self.cut = False  # whether the node is off the bus
        self._writing = threading.Lock()

    def receive(self, number: int, data: bytes) -> None:
        raise NotImplementedError

    def send(self, number: int, data: bytes) -> None:
        if self.cut:
            return
        frame = f"< frame {number:03X} {time.time():.6f} {data.hex().upper()} >".encode()
        with self._writing:
            for _, client in self._clients:
                with contextlib.suppress(OSError):
                    client.sendall(frame)

    def serve(self, client: socket.socket) -> None:
        client.sendall(b"< hi >")
        rest = b""
        while data := client.recv(4096):
            rest += data
            while b">" in rest:
                line, _, rest = rest.partition(b">")
                words = line.decode("ascii").replace("<", "").split()
                if words[0] in ("open", "rawmode"):
                    client.sendall(b"< ok >")
                elif words[0] == "send":
                    frame = bytes(int(word, 16) for word in words[3:])
                    if not self.cut:
                        self.receive(int(words[1], 16), frame)
