"""A CAN bus with one node that socketcand shares, over bare sockets."""

import contextlib
import socket
import threading
import time
from types import TracebackType
from typing import Self


class SocketcandPeer:
    """`receive` gets every frame of the clients, `send` writes one to all of them."""

    def __init__(self) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.cut = False  # whether the node is off the bus
        self._writing = threading.Lock()
        self._clients: list[tuple[threading.Thread, socket.socket]] = []

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

    def __enter__(self) -> Self:
        self._accepting = threading.Thread(target=self._accept, daemon=True)
        self._accepting.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._accepting.join()
        self._listener.close()
        for thread, client in self._clients:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
            thread.join()
            client.close()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                thread = threading.Thread(target=self._attend, args=(client,), daemon=True)
                self._clients.append((thread, client))
                thread.start()

    def _attend(self, client: socket.socket) -> None:
        with contextlib.suppress(OSError):
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
