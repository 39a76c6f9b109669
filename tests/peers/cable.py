"""A cable between a client and a device on TCP, which can be cut, slow or noisy."""

import contextlib
import socket
import threading
import time
from types import TracebackType
from typing import Self


class Cable:
    """Passes on what is sent to `address`; it misbehaves in the device's direction of sending."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.address = f"opc.tcp://127.0.0.1:{self.port}"
        self._ends: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self._faults: dict[str, tuple[float, int | None, float]] = {}

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
        self._disconnect()

    def _disconnect(self) -> None:
        for end in self._ends:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
        for thread in self._threads:
            thread.join()
        for end in self._ends:
            end.close()
        self._ends, self._threads = [], []

    def start(
        self,
        _endpoint: str,
        kind: str,
        *,
        amount: float = 0.0,
        replies: int | None = None,
        duration_s: float | None = None,
    ) -> None:
        """Delay, drop, cut or garble what comes next, or disconnect."""
        until = float("inf") if duration_s is None else time.monotonic() + duration_s
        if kind != "disconnect" or duration_s is not None:
            self._faults[kind] = amount, replies, until
        if kind == "disconnect":
            self._disconnect()

    def heal(self) -> None:
        """Pass everything on again."""
        self._faults.clear()

    def _fault(self, kind: str) -> float | None:
        amount, replies, until = self._faults.get(kind, (0.0, 0, 0.0))
        if replies == 0 or time.monotonic() > until:
            return None
        if replies is not None:
            self._faults[kind] = amount, replies - 1, until
        return amount

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                if self._fault("disconnect") is not None:
                    client.close()
                    continue
                device = socket.create_connection(("127.0.0.1", self._port))
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
                    late_s = self._fault("delay")
                    if late_s is not None:
                        time.sleep(late_s)
                    if self._fault("drop") is not None:
                        continue
                    if self._fault("cut") is not None:
                        data = data[: len(data) // 2]
                    if self._fault("garble") is not None:
                        data = bytes(byte ^ 0x5A if k % 3 else byte for k, byte in enumerate(data))
                target.sendall(data)
        with contextlib.suppress(OSError):
            target.shutdown(socket.SHUT_RDWR)
