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
from typing import Any, Self

from torquebench.testing.cable import TcpPort


class LinePeer(TcpPort):
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
        self._line: tuple[int, int] | None = None
        self._serial = serial
        self.write: Callable[[bytes], None] = lambda _: None
        """Writes on the line of the last client."""
        if serial:
            self._listener.close()
            self._line = pty.openpty()
            tty.setraw(self._line[1])
            self.address = os.ttyname(self._line[1])

    def __enter__(self) -> Self:
        if self._line is None:
            return super().__enter__()
        master = self._line[0]
        self.write = lambda data: _write(master, data)
        self._reading = threading.Thread(
            target=self._converse,
            args=(lambda: _read(master, self._ended), self.write),
            daemon=True,
        )
        self._reading.start()
        return self

    def __exit__(self, *ended: Any) -> None:
        if not self._serial:
            super().__exit__(*ended)
        elif self._line is not None:
            line, self._line = self._line, None
            self._ended.set()
            self._reading.join()
            for end in line:
                os.close(end)

    def pull_out(self) -> None:
        """Pull the plug of the serial line, for good."""
        self.__exit__(None, None, None)

    def garbled(self, data: bytes) -> bytes:
        """Return a line that nobody understands."""
        return bytes(0xFF - byte if k % 3 else byte for k, byte in enumerate(data[:-2])) + b"\n"

    # -- serving ----------------------------------------------------------------------------

    def serve(self, client: socket.socket) -> None:
        self._converse(lambda: client.recv(4096), client.sendall)

    def _converse(self, read: Callable[[], bytes], write: Callable[[bytes], None]) -> None:
        rest = b""
        with contextlib.suppress(OSError):
            while data := read():
                *whole, rest = re.split(self.ends, rest + self.received(data))
                for line in whole:
                    if line.strip():
                        self._handle(line, write)

    def _handle(self, line: bytes, write: Callable[[bytes], None]) -> None:
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
