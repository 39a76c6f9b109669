"""Instruments that answer with lines of text, on a TCP port or a serial line (pyserial)."""

from __future__ import annotations

import socket
import time
from typing import Annotated, Any, Literal, Protocol

from pydantic import Field

from torquebench.bench.drivers.links import Link, WireError, split_address
from torquebench.bench.drivers.plugins import Options, require_library
from torquebench.bench.drivers.recording import note, recording
from torquebench.message import Message

LONGEST_ANSWER = 16_000_000
SerialRate = Annotated[int, Field(ge=300, le=4_000_000, description="baud")]


class LineOptions(Options):
    """Address of an instrument: `host:port`, or a serial port such as `/dev/ttyUSB0` or `COM3`."""

    address: Annotated[
        str, Field(min_length=3, max_length=200, description="host:port or a serial port")
    ]
    baud_rate: SerialRate = 9600
    data_bits: Literal[7, 8] = 8
    parity: Literal["none", "even", "odd"] = "none"
    stop_bits: Literal[1, 2] = 1


class LineConnection(Protocol):
    """A connection that sends and receives lines."""

    def send(self, line: str) -> None:
        """Send a line and the terminator."""

    def receive(self, timeout_s: float) -> str:
        """Return the next line; raises `WireError`."""

    def close(self) -> None:
        """Disconnect."""


class _Lines:
    """Base of connections that splits received bytes into lines."""

    def __init__(self, terminator: bytes) -> None:
        self._terminator = terminator
        self._rest = b""

    def _more(self, within_s: float) -> bytes:
        """Return the next received bytes; empty after the time-out."""
        raise NotImplementedError

    def receive(self, timeout_s: float) -> str:
        """Return the next line without its terminator; raises `WireError`."""
        deadline = time.monotonic() + timeout_s
        while self._terminator not in self._rest:
            # Received bytes are used even if this process was late.
            data = self._more(max(0.0, deadline - time.monotonic()))
            if not data:
                part = "a part of an answer" if self._rest else "no answer"
                raise WireError(Message("{part} in {timeout_s:g} s", part, timeout_s))
            self._rest += data
            if len(self._rest) > LONGEST_ANSWER:
                raise WireError("an answer without end")
        line, _, self._rest = self._rest.partition(self._terminator)
        try:
            return line.decode("ascii").strip()
        except UnicodeDecodeError as error:
            raise WireError(Message("garbled answer {line!r}", line[:20])) from error


class SocketLines(_Lines):
    """Lines over a TCP socket."""

    def __init__(self, address: str, timeout_s: float, terminator: bytes = b"\n") -> None:
        super().__init__(terminator)
        self._socket = socket.create_connection(split_address(address), timeout_s)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, line: str) -> None:
        """Send a line and the terminator."""
        self._socket.sendall(line.encode("ascii") + self._terminator)

    def _more(self, within_s: float) -> bytes:
        """Return the bytes that arrive in time; none is no error."""
        self._socket.settimeout(within_s)
        try:
            data = self._socket.recv(65536)
        except (BlockingIOError, TimeoutError):
            return b""
        if not data:
            raise WireError("the instrument closed the connection")
        return data

    def close(self) -> None:
        """Disconnect."""
        self._socket.close()


class SerialLines(_Lines):
    """Lines on a serial port; the bytes in `prologue` and `epilogue` begin and end the session."""

    def __init__(
        self,
        options: LineOptions,
        timeout_s: float,
        terminator: bytes = b"\n",
        prologue: bytes = b"",
        epilogue: bytes = b"",
    ) -> None:
        super().__init__(terminator)
        library = require_library("serial", "serial")
        self._failures = (
            library.SerialException,
            OSError,
            TypeError,
        )  # TypeError: the port was unplugged
        self._epilogue = epilogue
        try:
            self._port: Any = library.Serial(
                options.address,
                options.baud_rate,
                bytesize=options.data_bits,
                parity=options.parity[0].upper(),
                stopbits=options.stop_bits,
                write_timeout=timeout_s,
                exclusive=True,
            )
            self._port.reset_input_buffer()
            self._port.write(prologue)
        except self._failures as error:
            raise WireError(str(error)) from error

    def send(self, line: str) -> None:
        """Send a line and the terminator."""
        try:
            self._port.write(line.encode("ascii") + self._terminator)
        except self._failures as error:
            raise WireError(str(error)) from error

    def _more(self, within_s: float) -> bytes:
        """Return the bytes that arrive in time; none is no error."""
        try:
            self._port.timeout = within_s
            first: bytes = self._port.read(1)
            return first + self._port.read(self._port.in_waiting) if first else b""
        except self._failures as error:
            raise WireError(str(error)) from error

    def close(self) -> None:
        """Release the port."""
        try:
            if self._epilogue:
                self._port.write(self._epilogue)
        finally:
            self._port.close()


class _RecordedLines:
    """A connection whose lines are recorded."""

    def __init__(self, connection: LineConnection, name: str, address: str) -> None:
        self._connection, self._place = connection, (name, address)

    def send(self, line: str) -> None:
        """Send a line and the terminator."""
        note(*self._place, "sent", line)
        self._connection.send(line)

    def receive(self, timeout_s: float) -> str:
        """Return the next line; raises `WireError`."""
        line = self._connection.receive(timeout_s)
        note(*self._place, "received", line)
        return line

    def close(self) -> None:
        """Disconnect."""
        self._connection.close()


class LineLink(Link[LineConnection]):
    """A connection to an instrument that answers with lines.

    Parameters
    ----------
    terminator : bytes
        Bytes that end a line.
    prologue, epilogue : bytes
        Bytes that begin and end a session on a serial line.
    """

    def __init__(
        self,
        name: str,
        options: LineOptions,
        timeout_s: float,
        terminator: bytes = b"\n",
        prologue: bytes = b"",
        epilogue: bytes = b"",
    ) -> None:
        super().__init__(name, options.address, timeout_s)
        self._options = options
        self._session = terminator, prologue, epilogue

    def _open(self) -> LineConnection:
        """Connect by a socket or a serial port, and record the lines if a recording is made."""
        options, (terminator, prologue, epilogue) = self._options, self._session
        host, _, port = options.address.rpartition(":")
        connection: LineConnection
        if host and port.isdigit():
            connection = SocketLines(options.address, self.timeout_s, terminator)
        else:
            connection = SerialLines(options, self.timeout_s, terminator, prologue, epilogue)
        return _RecordedLines(connection, self.name, self.address) if recording() else connection

    def _close(self, connection: LineConnection) -> None:
        connection.close()

    def query(self, line: str) -> str:
        """Send a line and return the answer."""

        def exchange(connection: LineConnection) -> str:
            connection.send(line)
            return connection.receive(self.timeout_s)

        return self.call(exchange)
