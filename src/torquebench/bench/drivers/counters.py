"""Common base of counters: timebase, channels and frequencies."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from torquebench.bench.description import CounterDescription
from torquebench.bench.drivers.recording import note, recording
from torquebench.bench.roles import SIDES, torque_channel
from torquebench.errors import BenchError, InputError
from torquebench.message import Message
from torquebench.signals import Record, SignalFaultKind

Result = TypeVar("Result")
LONGEST_TEXT = 1000
"""Vendors' messages end with their code and task."""


class DescribedCounter:
    """A counter whose clock is the described one, and whose options name its channels.

    Parameters
    ----------
    channels : iterable of str
        Channels that it serves.

    Raises
    ------
    InputError
        The torque channel of a module is missing.
    """

    def __init__(self, counting: CounterDescription, channels: Iterable[str]) -> None:
        self._counting = counting
        self._served = tuple(str(name) for name in channels)
        self._serial = ""
        for side in SIDES:
            if torque_channel(side) not in self._served:
                raise InputError(
                    Message(
                        "driver.counter.channels without {torque_channel}", torque_channel(side)
                    ),
                    "the torque of each module",
                    "add it",
                )

    @property
    def timebase_hz(self) -> float:
        """Nominal frequency of the described clock, Hz."""
        return self._counting.timebase_hz

    @property
    def clock_identity(self) -> str:
        """Serial number from the instrument, and the described clock."""
        return f"{self._serial}/{self._counting.clock}"

    def _check_served(self, channels: frozenset[str]) -> None:
        """Refuse channels that no counter serves."""
        unknown = sorted(channels - set(self._served))
        if unknown:
            raise InputError(
                Message("no counter for {unknown}", unknown[0]),
                "one for every channel in use",
                "add it to driver.counter.channels or give the standard a read-out",
            )


class LibraryCounter(DescribedCounter):
    """A counter behind a vendor's library, whose errors become torquebench errors.

    Parameters
    ----------
    counting, channels
        As above.
    place : str
        Kind and address, for messages.
    failures : tuple of exception types
        Errors of the library.
    remedy : str
        Remedy for a device that fails.
    """

    def __init__(
        self,
        counting: CounterDescription,
        channels: Iterable[str],
        place: str,
        failures: tuple[type[Exception], ...],
        remedy: str,
    ) -> None:
        super().__init__(counting, channels)
        self._place = place
        self._failures = failures
        self._remedy = remedy
        self._closed = False

    def _ask(self, question: Callable[[], Result], what: str = "") -> Result:
        """Call the library; a failure or a closed counter is a BenchError."""
        if self._closed:
            raise BenchError("counter is closed", "an open instrument", "open it again")
        try:
            answer = question()
            if recording():
                note(self._place, "", "answer", f"{what}: {answer!r}")
            return answer
        except self._failures as error:
            message = f"{what}: {self._text_of(error)}" if what else self._text_of(error)
            raise BenchError(
                Message("{place}: {said}", self._place, message),
                "a device that executes its commands",
                self._remedy,
            ) from error

    def _text_of(self, error: Exception) -> str:
        """Return the library's message on one line, cut to its beginning."""
        return " ".join(str(error).split())[:LONGEST_TEXT]


def counted(
    time_s: NDArray[np.float64],
    frequency_hz: NDArray[np.float64],
    standard_uncertainty_hz: NDArray[np.float64] | float,
) -> Record:
    """Return frequencies from an instrument as windows; 0 Hz and NaN count as no signal."""
    silent = ~(frequency_hz > 0.0)
    return Record(
        {
            "time_s": time_s,
            "frequency_hz": np.where(silent, np.nan, frequency_hz),
            "frequency_uncertainty_hz": np.where(silent, np.nan, standard_uncertainty_hz),
            "fault": np.where(silent, np.uint8(SignalFaultKind.NO_PULSES), np.uint8(0)),
        }
    )
