"""Devices that answer lines of text, on a TCP port or a serial line (a pseudo-terminal)."""

import contextlib
import os
import pty
import re
import select
import socket
import threading
import tty
from collections.abc import Callable
from types import TracebackType
from typing import Self

from torquebench.testing.faults import Faults


class LinePeer(Faults):
    """Lines on a port, a thread a client; the device is one, whoever asks.

    With `serial` it has a serial line instead, and `address` is the name of its terminal.
    """

    ends = b"\n"
    """What ends a command: a pattern."""
    ending = b"\n"
    """What it ends its answers with."""

    def __init__(self, *, serial: bool = False) -> None:
        super().__init__()
        self.lines: list[str] = []
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self._clients: list[tuple[threading.Thread, Callable[[], None]]] = []
        self._line: tuple[int, int] | None = None
        self.write: Callable[[bytes], None] = lambda _: None
        """Writes on the line of the last client."""
        self._listener: socket.socket | None = None
        if serial:
            self._line = pty.openpty()
            tty.setraw(self._line[1])
            self.address = os.ttyname(self._line[1])
        else:
            self._listener = socket.create_server(("127.0.0.1", 0))
            self.address = f"127.0.0.1:{self._listener.getsockname()[1]}"

    def __enter__(self) -> Self:
        if self._line is not None:
            master = self._line[0]
            self.write = lambda data: _write(master, data)
            self._attend(lambda: _read(master, self._ended), self.write)
        else:
            self._accepting = threading.Thread(target=self._accept, daemon=True)
            self._accepting.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._line is not None:
            line, self._line = self._line, None
            self._ended.set()
            self.disconnect()
            for end in line:
                os.close(end)
        if self._listener is None:
            return
        self._listener.shutdown(socket.SHUT_RDWR)
        self._accepting.join()
        self._listener.close()
        self.disconnect()

    def pull_out(self) -> None:
        """Pull the plug of the serial line, for good."""
        assert self._line is not None
        self.__exit__(None, None, None)

    def disconnect(self) -> None:
        """Close every connection."""
        clients, self._clients = self._clients, []
        for thread, shut in clients:
            with contextlib.suppress(OSError):
                shut()
            thread.join()

    def garbled(self, data: bytes) -> bytes:
        """Return a line that nobody understands."""
        return bytes(0xFF - byte if k % 3 else byte for k, byte in enumerate(data[:-2])) + b"\n"

    # -- serving ----------------------------------------------------------------------------

    def _accept(self) -> None:
        assert self._listener is not None
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                if self.fault("disconnect") is not None:
                    client.close()
                    continue
                self._attend(
                    lambda client=client: client.recv(4096),  # type: ignore[misc]
                    client.sendall,
                    lambda client=client: client.shutdown(socket.SHUT_RDWR),  # type: ignore[misc]
                    client.close,
                )

    def _attend(
        self,
        read: Callable[[], bytes],
        write: Callable[[bytes], None],
        shut: Callable[[], None] = lambda: None,
        close: Callable[[], None] = lambda: None,
    ) -> None:
        def serve() -> None:
            rest = b""
            with contextlib.suppress(OSError):
                while data := read():
                    *whole, rest = re.split(self.ends, rest + self.received(data))
                    for line in whole:
                        if line.strip():
                            self._serve(line, write)
            close()

        thread = threading.Thread(target=serve, daemon=True)
        self._clients.append((thread, shut))
        thread.start()

    def _serve(self, line: bytes, write: Callable[[bytes], None]) -> None:
        with self._lock:
            text = line.decode("ascii", "replace").strip()
            self.lines.append(text)
            self.write = write
            answer = self.answer(text)
            if answer is not None:
                write(self.spoiled(answer.encode("ascii") + self.ending))

    def received(self, data: bytes) -> bytes:
        """Return what counts of the bytes that arrived."""
        return data

    def answer(self, line: str) -> str | None:
        """Obey or answer one line."""
        raise NotImplementedError


def _read(end: int, ended: threading.Event) -> bytes:
    while not ended.is_set():
        if select.select([end], [], [], 0.05)[0]:
            return os.read(end, 4096)
    return b""


def _write(end: int, data: bytes) -> None:
    """Write on a serial line; what nobody reads is lost."""
    if select.select([], [end], [], 0.0)[1]:
        os.write(end, data)
