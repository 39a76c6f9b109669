"""Amplifiers and displays that are polled, as a bench's counter or as a standard's read-out."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal, Protocol

import numpy as np
from pydantic import Field

from torquebench.bench.blocks import Block
from torquebench.bench.drivers.base import Identity
from torquebench.bench.drivers.counters import DescribedCounter
from torquebench.bench.drivers.links import TimeOut
from torquebench.bench.drivers.plugins import InstrumentRequest, Options
from torquebench.bench.drivers.sample_clock import SampleClock
from torquebench.bench.roles import SIDES, Side, reference_channel
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.signals import Record

ChannelName = Literal["input_torque", "output_torque", "input_reference", "output_reference"]
SHORTEST_ANSWER_S = 0.05
TRIALS = 25
"""Number of trial requests from which the response time is estimated."""


class AmplifierOptions(Options):
    """Keys of every amplifier: its channels, and the polling period of a standard."""

    channels: Mapping[ChannelName, Any] = Field(min_length=1)
    period_s: Annotated[float, Field(ge=0.005, le=1.0, description="s")] = 0.05
    serial: str = ""
    timeout_s: TimeOut | None = None


class Amplifier(Protocol):
    """An amplifier that returns the values of all its channels at once."""

    def identity(self, role: str) -> Identity:
        """Request its identity."""

    def values(self) -> Mapping[str, float]:
        """Request the present values by bench channel; NaN for a channel without a valid value."""

    def close(self) -> None:
        """Release it. A second call does nothing."""


def answer_s(request: InstrumentRequest, described_s: float | None) -> float:
    """Return the time-out of an answer: the time in which a lost signal must be noticed."""
    if described_s is not None:
        return described_s
    window_s, loss_s = (
        request.description.counter.window_s,
        request.description.safety.signal_loss_s,
    )
    return max(SHORTEST_ANSWER_S, window_s + loss_s)


class AmplifierCounter(DescribedCounter):
    """An amplifier that is polled once in the middle of each window, by the computer's clock.

    A value has the time of its request. The amplifier replaces the counter on a bench whose modules
    deliver torque, voltage or mV/V. A window that is over before its request could be sent is lost.

    Parameters
    ----------
    channels : iterable of str
        Bench channels that it serves.

    Raises
    ------
    InputError
        Its answers take longer than a window.
    """

    def __init__(
        self, amplifier: Amplifier, request: InstrumentRequest, channels: Iterable[str]
    ) -> None:
        super().__init__(request.description.counter, channels)
        self._amplifier = amplifier
        self._serial = amplifier.identity("counter").serial
        self._selected = frozenset(self._served)
        self._begun_s: float | None = None
        self._windows = 0
        self._window_s = self._counting.window_s
        least_s = math.inf
        for _ in range(TRIALS):  # an answer takes longer if this computer is busy
            asked_s = time.monotonic()
            amplifier.values()
            least_s = min(least_s, time.monotonic() - asked_s)
            if least_s <= 0.8 * self._window_s:
                break
        else:
            raise InputError(
                Message("{section}: an answer takes {least_s:.3g} s", request.section, least_s),
                Message("clearly less than counter.window_s = {window_s:g} s", self._window_s),
                "lengthen the window or quicken the connection (baud rate)",
            )

    @property
    def shortest_read_s(self) -> float:
        """A block is read as a whole."""
        return self._counting.block_s

    def identity(self) -> Identity:
        """Request the identity of the amplifier."""
        return self._amplifier.identity("counter")

    def select(self, channels: frozenset[str]) -> None:
        """Deliver only these channels from the next block on."""
        self._check_served(channels)
        self._selected = channels

    def read_block(self, duration_s: float) -> Block:
        """Poll the amplifier in the middle of each window of the block."""
        if self._begun_s is None:
            self._begun_s = time.monotonic()
        count = max(1, round(duration_s / self._window_s))
        start_s = self._windows * self._window_s
        time_s = start_s + self._window_s * (np.arange(count, dtype=np.float64) + 0.5)
        values = np.full((count, len(self._selected)), np.nan)
        names = sorted(self._selected)
        for row in range(count):
            ahead_s = self._begun_s + time_s[row] - time.monotonic()
            if ahead_s > 0.0:
                time.sleep(ahead_s)
            # at most until the next window is due or the block ends
            latest_s = time_s[row] + self._window_s * (1.0 if row + 1 < count else 0.5)
            if time.monotonic() - self._begun_s > latest_s:
                continue
            asked_s = time.monotonic()
            stated = self._amplifier.values()
            middle_s = 0.5 * (asked_s + time.monotonic()) - self._begun_s
            if middle_s < latest_s:
                time_s[row] = middle_s
                values[row] = [stated[name] for name in names]
        self._windows += count
        time.sleep(max(0.0, self._begun_s + self._windows * self._window_s - time.monotonic()))
        records = {
            name: Record({"time_s": time_s, "signal": values[:, column].copy()})
            for column, name in enumerate(names)
        }
        return Block(start_s, self._windows * self._window_s, {}, records)

    def close(self) -> None:
        """Release the amplifier. A second call does nothing."""
        self._amplifier.close()


class AmplifierReadout:
    """An amplifier of the mounted standard, polled every `period_s` in a thread of its own.

    Parameters
    ----------
    amplifier : Amplifier
        Amplifier with the channels `input_reference`, `output_reference` or both.
    """

    def __init__(self, amplifier: Amplifier, period_s: float) -> None:
        self._amplifier = amplifier
        self.period_s = period_s
        self._clocks = {side: SampleClock(period_s) for side in SIDES}
        self._kept: dict[Side, list[float]] = {side: [] for side in SIDES}
        self._lost = dict.fromkeys(SIDES, 0)
        self._failure: BenchError | None = None
        self._lock = threading.Lock()
        self._ending = threading.Event()
        amplifier.values()  # raises where the amplifier doesn't answer
        self._thread = threading.Thread(target=self._ask, daemon=True)
        self._thread.start()

    def _ask(self) -> None:
        """Read the amplifier once a period until the end; periods without an answer become NaN."""
        begun_s, number = time.monotonic(), 0
        while not self._ending.wait(max(0.0, begun_s + number * self.period_s - time.monotonic())):
            late = max(0, int((time.monotonic() - begun_s) / self.period_s) - number)
            try:
                stated, failure = self._amplifier.values(), None
            except BenchError as error:
                stated, failure = {}, error
            with self._lock:
                self._failure = failure or self._failure
                for side in SIDES:
                    if not self._kept[side]:
                        self._lost[side] += late
                    else:  # while a request is pending, the last sample is repeated as no signal
                        self._kept[side] += [float("nan")] * late
                    self._kept[side].append(stated.get(reference_channel(side), float("nan")))
            number += late + 1

    def identity(self) -> Identity:
        """Request the identity of the amplifier."""
        return self._amplifier.identity("reference")

    def read(self, side: Side, until_s: float, timed_s: float) -> Record:
        """Return the samples since the last call; raises `BenchError` without an answer."""
        with self._lock:
            failure, self._failure = self._failure, None
            kept, self._kept[side] = self._kept[side], []
            lost, self._lost[side] = self._lost[side], 0
            timed = self._clocks[side].take(np.array(kept), until_s, timed_s, lost)
        if self._ending.is_set():
            self._amplifier.values()  # a closed amplifier refuses requests
        if failure is not None:
            raise failure
        return timed

    def close(self) -> None:
        """Release the amplifier. A second call does nothing."""
        self._ending.set()
        self._amplifier.close()
        self._thread.join()


def opened(amplifier: Amplifier, request: InstrumentRequest, options: AmplifierOptions) -> Any:
    """Return an amplifier in the requested role; it is closed if that fails."""
    with contextlib.ExitStack() as stack:
        stack.callback(amplifier.close)
        if request.role == "counter":
            role: Any = AmplifierCounter(amplifier, request, options.channels.keys())
        else:
            missing = [side for side in SIDES if reference_channel(side) not in options.channels]
            if missing:
                raise InputError(
                    Message(
                        "{section}.channels without {channel}",
                        request.section,
                        reference_channel(missing[0]),
                    ),
                    "the standard's transducer of each side",
                    "add it",
                )
            role = AmplifierReadout(amplifier, options.period_s)
        stack.pop_all()
    return role
