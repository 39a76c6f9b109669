"""Set points that this computer steps to their targets, for drives that don't ramp."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from torquebench.errors import BenchError

PERIOD_S = 0.01
LONGEST_STEP_S = 0.02
"""A computer that stood for longer continues its ramp later, instead of jumping ahead."""


class Stepper:
    """A set point on its way to a target at a rate, written every 10 ms by a thread of its own.

    While the watchdog isn't fed, it stays where it is: the drive's watchdog acts.
    """

    def __init__(self, watchdog_s: float) -> None:
        self._watchdog_s = watchdog_s
        self._lock = threading.Lock()
        self._write: Callable[[float], None] | None = None
        self._present = self._target = self._rate = 0.0
        self._fed_s = -math.inf
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        self._failure: BenchError | None = None

    def go(
        self, write: Callable[[float], None], present: float, target: float, rate: float
    ) -> None:
        """Step from the present set point to a target; `write` commands a set point."""
        with self._lock:
            self._write, self._present, self._target, self._rate = write, present, target, rate
        if self._thread is None and not self._ending.is_set():
            self._thread = threading.Thread(target=self._run, daemon=True)
            self._thread.start()

    def stop(self) -> None:
        """Write nothing until the next target."""
        with self._lock:
            self._write = None

    def feed(self) -> None:
        """Allow steps for the watchdog's time."""
        self._fed_s = time.monotonic()

    def check(self) -> None:
        """Raise the failure of the last step, once."""
        failure, self._failure = self._failure, None
        if failure is not None:
            raise failure

    def _run(self) -> None:
        """Move the set point in steps until stopped; hold it when the watchdog wasn't fed."""
        before_s = time.monotonic()
        while not self._ending.wait(PERIOD_S):
            now_s = time.monotonic()
            passed_s, before_s = min(now_s - before_s, LONGEST_STEP_S), now_s
            if now_s - self._fed_s > self._watchdog_s:
                continue
            try:
                self._step(passed_s)
            except BenchError as error:
                self._failure = error
                self.stop()

    def _step(self, passed_s: float) -> None:
        """Write the next set point on the ramp from the present one to the target."""
        with self._lock:
            if self._write is None or self._present == self._target:
                return
            left = self._target - self._present
            step = math.copysign(min(abs(left), self._rate * passed_s), left)
            self._present = self._target if step == left else self._present + step
            self._write(self._present)

    def close(self) -> None:
        """End the thread. A second call does nothing."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join()
