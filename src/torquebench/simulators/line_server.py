"""A TCP server with a thread for each client, for simulators that answer line by line."""

from __future__ import annotations

import contextlib
import socket
import threading
from abc import ABC, abstractmethod

from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.simulators.misbehaviour import WireFaults

ACCEPT_POLL_S = 0.1


class LineServer(ABC):
    """Server that accepts clients and serves each in a thread of its own.

    Parameters
    ----------
    port : int
        With 0, a free port is chosen, which `port` then holds.
    """

    def __init__(self, faults: WireFaults, host: str, port: int) -> None:
        self.faults = faults
        self.host = host
        try:
            self._listener = socket.create_server((host, port))
        except OSError as error:
            raise BenchError(
                Message(
                    "{name} can't be served on {host}:{port} ({strerror})",
                    faults.name,
                    host,
                    port,
                    error.strerror,
                ),
                "a free port",
                "end what uses it, or name another one",
            ) from error
        self.port: int = self._listener.getsockname()[1]
        self._listener.settimeout(ACCEPT_POLL_S)
        self._lock = threading.Lock()
        self._clients: dict[socket.socket, threading.Thread] = {}
        self._closing = threading.Event()
        faults.disconnect = self.disconnect
        self._thread = threading.Thread(
            target=self._accept, name=f"simulated-{faults.name}", daemon=True
        )
        self._thread.start()

    def _accept(self) -> None:
        """Serve each client in a thread of its own until the server closes."""
        while not self._closing.is_set():
            try:
                connection, _ = self._listener.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            if self.faults.refusing:
                connection.close()
                continue
            connection.settimeout(None)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            thread = threading.Thread(
                target=self._serve, args=(connection,), name=f"client of {self.faults.name}"
            )
            thread.daemon = True
            with self._lock:
                self._clients[connection] = thread
            thread.start()

    def _serve(self, connection: socket.socket) -> None:
        """Attend a client until it leaves, then forget it."""
        try:
            self.attend(connection)
        finally:
            with self._lock:
                self._clients.pop(connection, None)
            connection.close()

    @abstractmethod
    def attend(self, connection: socket.socket) -> None:
        """Answer one client until it disconnects."""

    def disconnect(self) -> None:
        """Close every client's connection."""
        with self._lock:
            clients = list(self._clients)
        for client in clients:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """End the server and every client's thread. A second call does nothing."""
        self._closing.set()
        self._listener.close()
        with self._lock:
            threads = list(self._clients.values())
        self.disconnect()
        for thread in (self._thread, *threads):
            if thread is not threading.current_thread():
                thread.join()
