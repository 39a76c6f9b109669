"""SCPI over a TCP socket, or through VISA (pyvisa) for other interfaces."""

from __future__ import annotations

import contextlib
import re
from typing import Annotated, Any

from pydantic import Field

from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.lines import LineConnection, SocketLines
from torquebench.bench.drivers.links import Link, TimeOut, WireError
from torquebench.bench.drivers.plugins import Options, require_library
from torquebench.errors import BenchError
from torquebench.message import Message
from torquebench.units import MS_PER_S

NO_NUMBER = 9.91e37
"""Number that SCPI instruments send for "not a number" (SCPI-1999, 7.2.1.5)."""
LONGEST_QUEUE = 100
"""Largest number of errors in an instrument's error queue."""
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
"""Decimal numeric response data (IEEE 488.2, 8.7.2 to 8.7.4), with some tolerance."""

ScpiAddress = Annotated[
    str, Field(min_length=3, max_length=200, description="host:port or a VISA resource")
]


class ScpiOptions(Options):
    """Address of an instrument: `host:port`, or a VISA resource such as `GPIB0::5::INSTR`."""

    address: ScpiAddress
    timeout_s: TimeOut = 1.0


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


class ScpiLink(Link[LineConnection]):
    """One SCPI instrument.

    Parameters
    ----------
    address : str
        `host:port` or a VISA resource.
    attempts : int
        1 for an instrument whose answers remove data from it, which a repeated request would lose.
    """

    def _open(self) -> LineConnection:
        """Connect by VISA or a socket, and clear earlier errors."""
        connection: LineConnection
        if "::" in self.address:
            connection = _VisaConnection(self.address, self.timeout_s)
        else:
            connection = SocketLines(self.address, self.timeout_s)
        connection.send("*CLS")  # read errors of earlier sessions
        return connection

    def _close(self, connection: LineConnection) -> None:
        connection.close()

    def query(self, line: str, *, within_s: float | None = None) -> str:
        """Send a request and return the answer; `within_s` replaces the link's time-out."""
        timeout_s = self.timeout_s if within_s is None else within_s

        def exchange(connection: LineConnection) -> str:
            connection.send(line)
            return connection.receive(timeout_s)

        return self.call(exchange)

    def command(self, line: str) -> None:
        """Send a command, and check that the instrument has accepted it.

        Raises
        ------
        BenchError
            The instrument reports an error.
        """

        def exchange(connection: LineConnection) -> str:
            """Send the command and return its own error."""
            for _ in range(LONGEST_QUEUE):  # errors in the queue don't belong to this command
                if _no_error(error(connection)):
                    break
            connection.send(line)
            return error(connection)

        def error(connection: LineConnection) -> str:
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
        """Request `*IDN?`.

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
    """Return the numbers of a list; NaN for the instrument's code for "not a number".

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
