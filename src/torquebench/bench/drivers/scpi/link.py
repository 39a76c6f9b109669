"""SCPI over a TCP socket, or through VISA (pyvisa) for other interfaces."""

from __future__ import annotations

import contextlib
import re
import socket
import time
from typing import Annotated, Any, Protocol

from pydantic import Field

from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.links import Link, TimeOut, WireError, split_address
from torquebench.bench.drivers.plugins import Options, require_library
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.units import MS_PER_S

__all__ = ["NO_NUMBER", "ScpiAddress", "ScpiLink", "ScpiOptions", "numbers"]

NO_NUMBER = 9.91e37
"""Number that SCPI instruments send for "not a number" (SCPI-1999, 7.2.1.5)."""
LONGEST_ANSWER = 16_000_000
LONGEST_QUEUE = 100
"""Largest number of errors in an instrument's queue."""
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
"""Decimal numeric response data (IEEE 488.2, 8.7.2 to 8.7.4), and a little more."""

ScpiAddress = Annotated[
    str, Field(min_length=3, max_length=200, description="host:port or a VISA resource")
]


class ScpiOptions(Options):
    """Where an instrument is: `host:port`, or a VISA resource such as `GPIB0::5::INSTR`."""

    address: ScpiAddress
    timeout_s: TimeOut = 1.0


class _Connection(Protocol):
    def send(self, line: str) -> None: ...

    def receive(self, timeout_s: float) -> str: ...

    def close(self) -> None: ...


class _SocketConnection:
    """Lines over a TCP socket."""

    def __init__(self, address: str, timeout_s: float) -> None:
        self._socket = socket.create_connection(split_address(address), timeout_s)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._rest = b""

    def send(self, line: str) -> None:
        self._socket.sendall(line.encode("ascii") + b"\n")

    def receive(self, timeout_s: float) -> str:
        deadline = time.monotonic() + timeout_s
        while b"\n" not in self._rest:
            # What has arrived is taken even if this process was late.
            self._socket.settimeout(max(0.0, deadline - time.monotonic()))
            try:
                data = self._socket.recv(65536)
            except (BlockingIOError, TimeoutError):
                part = "a part of an answer" if self._rest else "no answer"
                raise WireError(Message("{part} in {timeout_s:g} s", part, timeout_s)) from None
            if not data:
                raise WireError("the instrument closed the connection")
            self._rest += data
            if len(self._rest) > LONGEST_ANSWER:
                raise WireError("an answer without end")
        line, _, self._rest = self._rest.partition(b"\n")
        try:
            return line.decode("ascii").strip()
        except UnicodeDecodeError as error:
            raise WireError(Message("garbled answer {line!r}", line[:20])) from error

    def close(self) -> None:
        self._socket.close()


class _VisaConnection:
    """A connection through VISA."""

    def __init__(self, resource: str, timeout_s: float) -> None:
        visa = require_library("pyvisa", "visa")
        self._errors: type[Exception] = visa.errors.Error
        try:
            self._manager = visa.ResourceManager()
            self._resource: Any = self._manager.open_resource(
                resource, read_termination="\n", write_termination="\n"
            )
        except (self._errors, ValueError) as error:
            raise WireError(str(error)) from error
        self._resource.timeout = timeout_s * MS_PER_S

    def send(self, line: str) -> None:
        try:
            self._resource.write(line)
        except self._errors as error:
            raise WireError(str(error)) from error

    def receive(self, timeout_s: float) -> str:
        try:
            self._resource.timeout = timeout_s * MS_PER_S
            return str(self._resource.read()).strip()
        except (self._errors, UnicodeDecodeError) as error:
            raise WireError(str(error)) from error

    def close(self) -> None:
        with contextlib.suppress(self._errors):
            self._resource.close()
            self._manager.close()


class ScpiLink(Link[_Connection]):
    """One SCPI instrument.

    Parameters
    ----------
    name : str
    address : str
        `host:port` or a VISA resource.
    timeout_s : float
    attempts : int
        1 where an answer takes something out of the instrument, so that asking again loses it.
    """

    def __init__(self, name: str, address: str, timeout_s: float, attempts: int = 2) -> None:
        super().__init__(name, address, timeout_s, attempts)

    def _open(self) -> _Connection:
        connection: _Connection
        if "::" in self.address:
            connection = _VisaConnection(self.address, self.timeout_s)
        else:
            connection = _SocketConnection(self.address, self.timeout_s)
        connection.send("*CLS")  # errors of earlier sessions
        return connection

    def _close(self, connection: _Connection) -> None:
        connection.close()

    def query(self, line: str, *, within_s: float | None = None) -> str:
        """Ask and return the answer; it may take `within_s` instead of the link's time-out."""
        timeout_s = self.timeout_s if within_s is None else within_s

        def exchange(connection: _Connection) -> str:
            connection.send(line)
            return connection.receive(timeout_s)

        return self.call(exchange)

    def command(self, line: str) -> None:
        """Command, and make sure that the instrument has taken it.

        Raises
        ------
        BenchError
            The instrument reports an error.
        """

        def exchange(connection: _Connection) -> str:
            for _ in range(LONGEST_QUEUE):  # errors in the queue aren't this command's
                if _no_error(error(connection)):
                    break
            connection.send(line)
            return error(connection)

        def error(connection: _Connection) -> str:
            connection.send("SYST:ERR?")
            return connection.receive(self.timeout_s)

        answer = self.call(exchange)
        if not _no_error(answer):
            raise BenchError(
                Message(
                    "{name} at {address} answers {line!r} with {answer!r}",
                    self.name,
                    self.address,
                    line,
                    answer[:80],
                ),
                'no error (0,"No error")',
                "compare the command with the instrument's manual",
            )

    def identity(self, role: str) -> Identity:
        """Ask `*IDN?`.

        Raises
        ------
        BenchError
            The answer doesn't have the four fields of IEEE 488.2.
        """
        fields = [part.strip() for part in self.query("*IDN?").split(",")]
        if len(fields) != 4:
            raise BenchError(
                Message(
                    "{name} at {address} identifies itself as {fields!r}",
                    self.name,
                    self.address,
                    ",".join(fields)[:60],
                ),
                "manufacturer,model,serial,firmware",
                "check that the address is the instrument's",
            )
        manufacturer, model, serial, firmware = fields
        details = {"address": self.address}
        return Identity(role, manufacturer, model, serial, firmware, details)


def _no_error(answer: str) -> bool:
    return answer.partition(",")[0].strip() in ("0", "+0", "-0")


def numbers(answer: str, name: str) -> list[float]:
    """Return the numbers of a list, NaN where the instrument has none.

    Raises
    ------
    BenchError
        A value in it isn't a number.

    Examples
    --------
    >>> numbers("6.0E+04,9.91E37", "counter")
    [60000.0, nan]
    """
    if not answer:
        return []
    parts = [part.strip() for part in answer.split(",")]
    if not all(_NUMBER.fullmatch(part) for part in parts):
        raise BenchError(
            Message("{name} answers {answer!r}", name, answer[:40]),
            "numbers",
            "check the instrument and its cable",
        )
    values = [float(part) for part in parts]
    return [float("nan") if abs(value) >= NO_NUMBER else value for value in values]
