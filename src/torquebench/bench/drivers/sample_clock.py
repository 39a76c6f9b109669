"""Bench times for samples of an instrument with its own clock, estimated from their arrival."""

from __future__ import annotations

import math
import threading

import numpy as np
from numpy.typing import NDArray

from torquebench.signals import Record

LARGEST_DRIFT = 2e-4
"""Largest relative deviation of the instrument's clock from the counter's."""
SETTLED_BY = 5
"""Number of answers in a row, none quicker than the quickest by a period or more, after which the
offset of the clocks is known.
"""
FORGOTTEN_S = 1.0
"""Time without a request after which samples are lost, in unknown number, s."""


class SampleClock:
    """Clock that assigns times to samples, a period apart, from the quickest answer so far.

    A request is sent after the counter's block has arrived, so an answer is never older than the
    block's end, nor than the counter's time then; on a busy computer it is later by the computer's
    delay. The answer with the smallest delay gives the best offset of the two clocks, and is valid
    until they may have drifted. While delays still decrease, as when a computer catches up after a
    start, the times are unknown: samples are kept until they are known. A sample that is later than
    the block is kept for the block that it belongs to.

    Examples
    --------
    >>> clock = SampleClock(0.01)
    >>> [clock.take(np.zeros(2), t, t).time_s.size for t in (1.0, 1.02, 1.04, 1.06, 1.08)]
    [0, 0, 0, 0, 0]
    >>> clock.take(np.zeros(2), until_s=1.1, timed_s=1.1).time_s[[0, -1]].round(3)
    array([0.985, 1.095])
    >>> clock.take(np.zeros(3), 1.12, 1.12).time_s.round(3)  # asked late, so it brings more
    array([1.105, 1.115])
    >>> clock.take(np.zeros(1), until_s=1.14, timed_s=1.14).time_s.round(3)
    array([1.125, 1.135])
    """

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self._until_s = -math.inf
        self._lock = threading.Lock()
        self._begin()

    def _begin(self) -> None:
        """Forget all answers, as at the start."""
        self._number = 0  # earliest time of the next sample, when the first answer came
        self._begun_s = -math.inf  # earliest time at which the first answer came
        self._settled = False
        self._quiet = 0
        self._quiet_since_s = math.inf
        self._torque: NDArray[np.float64] = np.empty(0)
        self._numbers: NDArray[np.int64] = np.empty(0, dtype=np.int64)

    def take(
        self, torque_nm: NDArray[np.float64], until_s: float, timed_s: float, lost: int = 0
    ) -> Record:
        """Add the samples of an answer; return those up to a bench time whose times are known.

        Parameters
        ----------
        torque_nm : float64 array of shape (n,)
            Samples, the newest last.
        until_s : float
            End of the block for which they were requested, bench time.
        timed_s : float
            The counter's time at the request, bench time.
        lost : int
            Number of samples lost by the instrument before them, if it states that.
        """
        with self._lock:
            return self._taken(torque_nm, until_s, timed_s, lost)

    def _taken(
        self, torque_nm: NDArray[np.float64], until_s: float, timed_s: float, lost: int
    ) -> Record:
        """Add samples and return those whose times are known."""
        if until_s - self._until_s > FORGOTTEN_S:
            self._begin()
        passed_s, self._until_s = until_s - self._until_s, until_s
        count = torque_nm.size
        if count:
            first = self._number + lost
            self._number = first + count
            self._torque = np.concatenate((self._torque, torque_nm))
            self._numbers = np.concatenate((self._numbers, first + np.arange(count)))
            # The newest sample isn't older than the request: the first answer came no earlier.
            begun_s = max(until_s, timed_s) - self._number * self.period_s
            self._begun_s = max(begun_s, self._begun_s - LARGEST_DRIFT * passed_s)
            # Count the answers in a row that leave this estimate within a period.
            if abs(self._begun_s - self._quiet_since_s) > self.period_s:
                self._quiet, self._quiet_since_s = 0, self._begun_s
            self._quiet += 1
            self._settled = self._settled or self._quiet > SETTLED_BY
        if not self._settled:
            return Record({"time_s": np.empty(0), "signal": np.empty(0)})
        time_s = self._begun_s + self.period_s * (self._numbers + np.float64(0.5))
        ready = int(np.searchsorted(time_s, until_s + 1e-9))
        timed = Record({"time_s": time_s[:ready], "signal": self._torque[:ready]})
        self._numbers, self._torque = self._numbers[ready:], self._torque[ready:]
        return timed
