"""Heartbeats of run engine, procedure and operator."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from torquebench.bench.safety.alarms import AlarmKind, Violation
from torquebench.message import Message

OPERATOR = "operator"


@dataclass
class _Heartbeat:
    timeout_s: float
    last_s: float
    ping: Callable[[], None] | None


class Heartbeats:
    """Heartbeats, each with its own time-out; thread-safe.

    Parameters
    ----------
    now : callable
        Bench time, s.
    presence_s : float
        Validity of a confirmation of the operator's presence, s of wall time; 0 if none is
        required.
    """

    def __init__(self, now: Callable[[], float], presence_s: float) -> None:
        self._now = now
        self._lock = threading.Lock()
        self._beats: dict[str, _Heartbeat] = {}
        self._presence_s = presence_s
        self._present_until = float("-inf")
        self.present = ""

    def expect(self, name: str, timeout_s: float, ping: Callable[[], None] | None = None) -> None:
        """Require a heartbeat from now on; `ping` may request it, see `ask`."""
        with self._lock:
            self._beats[name] = _Heartbeat(timeout_s, self._now(), ping)

    def beat(self, name: str) -> None:
        """Record a heartbeat."""
        heartbeat = self._beats.get(name)
        if heartbeat is not None:
            heartbeat.last_s = self._now()

    def release(self, name: str) -> None:
        """Stop requiring the heartbeat."""
        with self._lock:
            self._beats.pop(name, None)

    def confirm_presence(self, who: str) -> None:
        """Confirm the operator's presence."""
        self.present = who
        self._present_until = time.monotonic() + self._presence_s

    def present_s(self) -> float:
        """Remaining validity of the confirmation of presence, s of wall time; 0 without one."""
        return max(0.0, self._present_until - time.monotonic())

    def absent_s(self) -> float:
        """Time since the confirmation of presence expired, s of wall time; 0 while valid."""
        if self._presence_s <= 0.0:
            return 0.0
        return max(0.0, time.monotonic() - self._present_until)

    def missing(self) -> Violation | None:
        """Return a violation if a heartbeat or a confirmation is missing."""
        if self.absent_s() > 0.0:
            return Violation(
                AlarmKind.PRESENCE,
                OPERATOR,
                Message(
                    "no confirmation of presence at the bench for {seconds:g} s", self._presence_s
                ),
                Message(
                    "a confirmation every {seconds:g} s while a drive has power", self._presence_s
                ),
                "stay at the bench and confirm, or end the run before leaving",
            )
        with self._lock:
            heartbeats = list(self._beats.items())
        now = self._now()
        for name, heartbeat in heartbeats:
            silent_s = now - heartbeat.last_s
            if silent_s > heartbeat.timeout_s:
                return Violation(
                    AlarmKind.HEARTBEAT,
                    name,
                    Message("no heartbeat of the {name} for {seconds:.1f} s", name, silent_s),
                    Message("at most {timeout_s:g} s", heartbeat.timeout_s),
                    "restart the software that hangs",
                )
        return None

    def ask(self) -> None:
        """Request a heartbeat from all sources with a callback."""
        with self._lock:
            pings = [beat.ping for beat in self._beats.values() if beat.ping is not None]
        for ping in pings:
            with contextlib.suppress(Exception):  # a source that can't be called gives no heartbeat
                ping()
