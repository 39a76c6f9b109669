"""A TCP port with a thread a client, and a cable to a device, which can be cut, slow or noisy."""

from __future__ import annotations

import contextlib
import socket
import threading
from types import TracebackType
from typing import Self

from torquebench.testing.faults import Faults

LOOPBACK = ("127.0.0.1", 0)


class TcpPort(Faults):
    """Listens within its context and serves each client in a thread of its own.

    Parameters
    ----------
    at : tuple of str and int
        Address at which it listens; by default a free port, `port`.
    """

    def __init__(self, at: tuple[str, int] = LOOPBACK) -> None:
        super().__init__()
        self._listener = socket.create_server(at)
        self.port = self._listener.getsockname()[1]
        self.address = f"127.0.0.1:{self.port}"
        self._clients: list[tuple[threading.Thread, socket.socket]] = []

    def serve(self, client: socket.socket) -> None:
        """Serve a client until it goes; an `OSError` ends it, too."""
        raise NotImplementedError

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
        self.disconnect()

    def disconnect(self) -> None:
        """Close every connection."""
        clients, self._clients = self._clients, []
        for thread, client in clients:
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
            if thread is not threading.current_thread():
                thread.join()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                if self.fault("disconnect") is not None:
                    client.close()
                    continue
                thread = threading.Thread(target=self._attend, args=(client,), daemon=True)
                self._clients.append((thread, client))
                thread.start()

    def _attend(self, client: socket.socket) -> None:
        with client, contextlib.suppress(OSError):
            self.serve(client)


class Cable(TcpPort):
    """Passes on what is sent to its port, and misbehaves in the device's direction of sending.

    Parameters
    ----------
    port : int
        Port of the device.
    host : str, default "127.0.0.1"
        Host of the device.
    at : tuple of str and int, optional
        Address at which it listens; by default a free port, `port`.
    """

    def __init__(self, port: int, host: str = "127.0.0.1", at: tuple[str, int] = LOOPBACK) -> None:
        super().__init__(at)
        self._device = host, port
        self.address = f"opc.tcp://{self.address}"

    def garbled(self, data: bytes) -> bytes:
        """Return data that nobody understands."""
        return bytes(byte ^ 0x5A if k % 3 else byte for k, byte in enumerate(data))

    def serve(self, client: socket.socket) -> None:
        """Pass on both ways until one end closes."""
        with socket.create_connection(self._device) as device:
            back = threading.Thread(target=self._pass, args=(device, client, True), daemon=True)
            back.start()
            self._pass(client, device, False)
            back.join()

    def _pass(self, source: socket.socket, target: socket.socket, spoils: bool) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                target.sendall(self.spoiled(data) if spoils else data)
        with contextlib.suppress(OSError):
            target.shutdown(socket.SHUT_RDWR)
