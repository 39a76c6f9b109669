"""Markers: notes at a time of the live signals."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from datetime import datetime

from torquebench.errors import InputError
from torquebench.message import Message

LONGEST_NOTE = 200
MOST_KEPT = 500


@dataclass(frozen=True)
class Marker:
    """A note at a time.

    Parameters
    ----------
    number : int
        Number since the bench was opened, from 1.
    bench_time_s : float
    at : datetime.datetime
        The same time by the wall clock, UTC.
    note, who : str
    """

    number: int
    bench_time_s: float
    at: datetime
    note: str
    who: str


class Markers:
    """The markers since the bench was opened, the newest last; safe to use from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._kept: list[Marker] = []
        self._count = 0

    def add(self, bench_time_s: float, at: datetime, note: str, who: str) -> Marker:
        """Add a marker.

        Raises
        ------
        InputError
            The note is empty or too long.
        """
        note = " ".join(note.split())
        if not note or len(note) > LONGEST_NOTE or not note.isprintable():
            raise InputError(
                Message("a note of {count} characters", len(note)),
                Message("1 to {most} that can be printed", LONGEST_NOTE),
            )
        with self._lock:
            self._count += 1
            marker = Marker(self._count, bench_time_s, at, note, who)
            self._kept = [*self._kept, marker][-MOST_KEPT:]
        return marker

    def all(self) -> list[Marker]:
        """Return all markers."""
        with self._lock:
            return list(self._kept)
