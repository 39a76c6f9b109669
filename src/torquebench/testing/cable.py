"""A cable between a client and a device on TCP, which can be cut, slow or noisy."""

from __future__ import annotations

import contextlib
import socket
import threading
from types import TracebackType
from typing import Self

from torquebench.testing.faults import Faults


class Cable(Faults):
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

    def __init__(
        self, port: int, host: str = "127.0.0.1", at: tuple[str, int] = ("127.0.0.1", 0)
    ) -> None:
        super().__init__()
        self._device = host, port
        self._listener = socket.create_server(at)
        self.port = self._listener.getsockname()[1]
        self.address = f"opc.tcp://127.0.0.1:{self.port}"
        self._ends: list[socket.socket] = []
        self._threads: list[threading.Thread] = []

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
        for end in self._ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        for end in self._ends:
            end.close()
        self._ends, self._threads = [], []

    def garbled(self, data: bytes) -> bytes:
        """Return data that nobody understands."""
        return bytes(byte ^ 0x5A if k % 3 else byte for k, byte in enumerate(data))

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                if self.fault("disconnect") is not None:
                    client.close()
                    continue
                device = socket.create_connection(self._device)
                self._ends += [client, device]
                for source, target in ((client, device), (device, client)):
                    thread = threading.Thread(
                        target=self._pass, args=(source, target, target is client), daemon=True
                    )
                    self._threads.append(thread)
                    thread.start()

    def _pass(self, source: socket.socket, target: socket.socket, spoils: bool) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(65536):
                if spoils:
                    data = self.spoiled(data)
                target.sendall(data)
        with contextlib.suppress(OSError):
            target.shutdown(socket.SHUT_RDWR)
