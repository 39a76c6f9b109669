"""Connection to an instrument: opened when needed, one caller at a time, renewed after errors."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Generic, Self, TypeVar

from pydantic import Field, StringConstraints

from torquebench.bench.drivers.recording import note, recording
from torquebench.errors import BenchError, InputError, LimitError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.bench.drivers.base import Drive

Connection = TypeVar("Connection")
Result = TypeVar("Result")

Address = Annotated[
    str, StringConstraints(pattern=r"^[^\s:]+:\d{1,5}$"), Field(description="host:port")
]
TimeOut = Annotated[float, Field(ge=0.02, le=30.0, description="s")]


SwitchingTime = Annotated[float, Field(gt=0.0, le=30.0, description="s")]
LONGEST_TIME_OUT_S = 0.3
POLL_S = 0.005
TRIES_A_WATCHDOG = 4
"""Number of time-outs in a drive's watchdog time: two attempts and a new connection, with
margin."""


def drive_timeout(described_s: float | None, watchdog_s: float, section: str) -> float:
    """Return a time-out for a drive's answer that allows a second attempt before its watchdog.

    Raises
    ------
    InputError
        The described times are too long for that.

    Examples
    --------
    >>> drive_timeout(None, 0.5, "driver.input_drive")
    0.125
    >>> drive_timeout(0.2, 0.5, "driver.input_drive")
    0.2
    """
    if described_s is None:
        return max(0.02, min(LONGEST_TIME_OUT_S, watchdog_s / TRIES_A_WATCHDOG))
    if described_s >= watchdog_s / 2.0:
        raise InputError(
            Message("{section}.timeout_s = {described_s:g} s", section, described_s),
            Message("less than {watchdog_s:g} s, half of the drive's watchdog_s", watchdog_s / 2.0),
            "shorten it, or leave it out, so that a lost answer can be repeated in time",
        )
    return described_s


def check_drive_order(name: str, value: float, rate: float, maximum: float, unit: str) -> None:
    """Refuse a set point beyond the drive's own limit, or a rate that isn't above 0.

    Raises
    ------
    LimitError
        The set point is beyond the drive's maximum.
    InputError
        The rate isn't finite and above 0.
    """
    if not abs(value) <= maximum * (1.0 + 1e-6):
        raise LimitError(
            Message("{value:g} {unit} requested from {name}", value, unit, name),
            Message("±{maximum:g} {unit}, the drive's own limit", maximum, unit),
            "stay within the drive's limits",
        )
    if not (rate > 0.0 and math.isfinite(rate)):
        raise InputError(Message("rate {rate:g} {unit}/s", rate, unit), "a rate above 0")


def wait_until_enabled(drive: Drive, name: str, switching_s: float) -> None:
    """Feed a drive's watchdog until it has power; raise BenchError at a fault or after a time."""
    deadline = time.monotonic() + switching_s
    while not (state := drive.state()).enabled:
        if state.fault or time.monotonic() > deadline:
            raise BenchError(
                Message("{name} stays off: {fault}", name, state.fault or "no reason given"),
                Message("an enabled drive within {switching_s:g} s", switching_s),
                "read the drive's fault code and the safety circuit",
            )
        drive.feed_watchdog()
        time.sleep(POLL_S)


class WireError(Exception):
    """The connection failed or returned invalid data; the request may be repeated."""


def split_address(address: str, lowest: int = 1) -> tuple[str, int]:
    """Split `host:port`; raises `InputError` for other forms and for ports below `lowest`.

    Examples
    --------
    >>> split_address("127.0.0.1:502")
    ('127.0.0.1', 502)
    """
    host, _, port = address.rpartition(":")
    if not host or not port.isdigit() or not lowest <= int(port) < 65536:
        raise InputError(
            Message("address {address!r}", address), "host:port", "such as 192.168.0.10:502"
        )
    return host, int(port)


class Link(ABC, Generic[Connection]):
    """A connection that all callers of one instrument share.

    After an error the connection is closed and opened again, because late data on the old one may
    belong to an earlier request; then the request is repeated. All requests of torquebench's
    drivers can be repeated, because commands contain absolute values.

    Parameters
    ----------
    name : str
        Role and instrument, for messages.
    address : str
        Address, for messages.
    timeout_s : float
        Timeout of one answer, s.
    attempts : int
        Number of attempts before a request counts as unanswered.
    """

    def __init__(self, name: str, address: str, timeout_s: float, attempts: int = 2) -> None:
        self.name = name
        self.address = address
        self.timeout_s = timeout_s
        self._attempts = attempts
        self._lock = threading.RLock()
        self._connection: Connection | None = None
        self._closed = False
        self.reconnects = 0

    @abstractmethod
    def _open(self) -> Connection:
        """Connect; raise `OSError` or `WireError` on failure."""

    @abstractmethod
    def _close(self, connection: Connection) -> None:
        """Disconnect."""

    def call(self, question: Callable[[Connection], Result]) -> Result:
        """Send a request on the connection, exclusively; for errors see the class.

        Raises
        ------
        BenchError
            The instrument didn't answer, gave invalid answers twice, or the link is closed.
        """
        with self._lock:
            if self._closed:
                raise BenchError(
                    Message("{name} is closed", self.name), "an open instrument", "open it again"
                )
            failure: Exception = WireError("never asked")
            for _ in range(self._attempts):
                try:
                    if self._connection is None:
                        self._connection = self._open()
                        self.reconnects += 1
                    answer = question(self._connection)
                    if recording():
                        note(self.name, self.address, "answer", repr(answer))
                    return answer
                except (OSError, WireError) as error:
                    failure = error
                    note(self.name, self.address, "failure", error)
                    self._drop()
            raise BenchError(
                Message(
                    "{name} at {address}: {failure}",
                    self.name,
                    self.address,
                    failure if str(failure) else type(failure).__name__,
                ),
                Message("a valid answer within {timeout_s:g} s", self.timeout_s),
                "check power, cable and address of the instrument",
            ) from failure

    def _drop(self) -> None:
        """Give up the connection, whether it can still be closed or not."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with contextlib.suppress(Exception):  # the connection is lost in any case
                self._close(connection)

    @contextlib.contextmanager
    def kept(self) -> Iterator[Self]:
        """Close the link if the block raises an error."""
        try:
            yield self
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Disconnect permanently. A second call does nothing."""
        with self._lock:
            self._closed = True
            self._drop()
