"""Bench time: the one time axis of a bench, in seconds since it was opened.

On hardware and in real time, bench time follows the wall clock. On a fast simulated bench, it
advances only while threads sleep and stops while the run engine's loop computes, so that a plan
gives the same result on any machine.
"""

from __future__ import annotations

import asyncio
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from torquebench.bench.event_loop import LoopActivity, new_watched_loop

LARGEST_DRIFT = 2e-4
"""Largest relative deviation of the counter's clock from the wall clock."""
LONGEST_BEHIND_S = 1.0
"""Largest delay of acquisition if no counter states it, s; beyond that, bench time stops."""
_TICK_S = 1e-9  # deadlines closer than this are treated as equal

Wake = Callable[[BaseException | None], None]


@dataclass(eq=False)
class _Sleeper:
    until_s: float
    wake: Wake


class BenchClock:
    """Bench time for sleepers on event loops and on threads.

    Parameters
    ----------
    fast : bool
        Whether time advances only while threads sleep (simulated benches). Otherwise the wall clock
        or hardware sets the pace.

    Examples
    --------
    >>> clock = BenchClock(fast=True)
    >>> clock.now()
    0.0
    >>> clock.require(1.0)  # somebody needs the bench to go on until 1 s
    >>> clock.wait_for_demand(timeout_s=1.0)
    True
    >>> clock.advance_to(1.0)
    >>> clock.wait_for_demand(timeout_s=0.0)
    False
    """

    def __init__(self, *, fast: bool) -> None:
        self.fast = fast
        self._condition = threading.Condition()
        self._now_s = 0.0
        self._behind_s = math.inf  # smallest delay of a block so far, wall time
        self._told = False  # the counter states its delay
        self._required_s = 0.0
        self._sleepers: list[_Sleeper] = []
        self._loops: dict[asyncio.AbstractEventLoop, LoopActivity] = {}
        self._failure: BaseException | None = None

    def now(self) -> float:
        """Bench time, s."""
        return self._now_s

    def present(self) -> float:
        """Present bench time, s, from the counter or from the block with the smallest delay.

        The last acquired block ended earlier: acquiring a block takes time, more on a busy
        computer.
        """
        late_s = self.late_s
        return self._now_s + (late_s if self._told else min(late_s, LONGEST_BEHIND_S))

    @property
    def late_s(self) -> float:
        """Time from the end of the last acquired block to the present, s; 0 in fast time."""
        if self.fast:
            return 0.0
        return max(0.0, time.monotonic() - self._behind_s - self._now_s)

    def stood(self, seconds: float) -> None:
        """Record that simulated time stopped for some seconds of wall time."""
        with self._condition:
            self._behind_s += seconds

    @property
    def sleeping(self) -> bool:
        """Whether anything is waiting for bench time."""
        return bool(self._sleepers)

    # -- sleeping ---------------------------------------------------------------------------

    def new_event_loop(self) -> asyncio.AbstractEventLoop:
        """Create an event loop whose computations take no simulated time.

        Time may advance while sleepers on other loops or on threads compute.
        """
        loop, activity = new_watched_loop()
        activity.on_idle = self._notify
        with self._condition:
            self._loops[loop] = activity
        return loop

    def _notify(self) -> None:
        """Let sleepers on threads check the time."""
        if self._sleepers:  # later sleepers get their own notification
            with self._condition:
                self._condition.notify_all()

    async def sleep(self, duration_s: float) -> None:
        """Sleep in bench time on the running event loop.

        Raises
        ------
        TorquebenchError
            The bench stopped or went to its safe state; the error is the cause of that.
        """
        await self.sleep_until(self._now_s + duration_s)

    async def sleep_until(self, time_s: float) -> None:
        """Sleep on the running event loop until a bench time; raises errors like `sleep`."""
        loop = asyncio.get_running_loop()
        activity = self._loops.get(loop)
        future: asyncio.Future[None] = loop.create_future()

        def settle(error: BaseException | None) -> None:
            """Complete the wait, or end it with an error."""
            if activity is not None:
                activity.received()
            if future.done():
                return
            if error is None:
                future.set_result(None)
            else:
                future.set_exception(error)

        def wake(error: BaseException | None) -> None:
            """Let the event loop end the sleep; called from acquisition's thread."""
            if loop.is_closed():
                return
            if activity is not None:
                activity.sent()
            loop.call_soon_threadsafe(settle, error)

        sleeper = self._add_sleeper(time_s, wake)
        if sleeper is None:
            return
        try:
            await future
        finally:
            self._remove_sleeper(sleeper)

    def wait(self, duration_s: float) -> None:
        """Sleep in bench time on the calling thread; raises errors like `sleep`."""
        self.wait_until(self._now_s + duration_s)

    def wait_until(self, time_s: float) -> None:
        """Sleep on the calling thread until a bench time; raises errors like `sleep`."""
        woken = threading.Event()
        outcome: list[BaseException] = []

        def wake(error: BaseException | None) -> None:
            """End the sleep, or keep the error for the sleeping thread."""
            if error is not None:
                outcome.append(error)
            woken.set()

        sleeper = self._add_sleeper(time_s, wake)
        if sleeper is None:
            return
        try:
            woken.wait()
        finally:  # Ctrl-C
            self._remove_sleeper(sleeper)
        if outcome:
            raise outcome[0]

    def require(self, time_s: float) -> None:
        """Let a fast bench advance to a bench time even if nothing sleeps or a loop hangs."""
        with self._condition:
            self._required_s = max(self._required_s, time_s)
            self._condition.notify_all()

    def _add_sleeper(self, time_s: float, wake: Wake) -> _Sleeper | None:
        """Register a sleeper; return None if its deadline has already passed."""
        with self._condition:
            if self._failure is not None:
                raise self._failure
            if time_s <= self._now_s + _TICK_S:
                return None
            sleeper = _Sleeper(time_s, wake)
            self._sleepers.append(sleeper)
            self._condition.notify_all()
            return sleeper

    def _remove_sleeper(self, sleeper: _Sleeper) -> None:
        with self._condition:
            if sleeper in self._sleepers:
                self._sleepers.remove(sleeper)

    # -- driving (acquisition only) ---------------------------------------------------------

    def wait_for_demand(self, timeout_s: float) -> bool:
        """Wait on the calling thread until bench time has to advance; False after `timeout_s`.

        If the bench isn't fast, it always has to.
        """
        if not self.fast:
            return True
        deadline = time.monotonic() + timeout_s
        with self._condition:
            while not self._wanted():
                remaining = deadline - time.monotonic()
                if remaining <= 0.0:
                    return False
                self._condition.wait(remaining)
            return True

    def _wanted(self) -> bool:
        """Return whether somebody waits for bench time and nobody computes meanwhile."""
        if self._required_s > self._now_s + _TICK_S:
            return True
        thinking = any(activity.busy for activity in self._loops.values())
        return bool(self._sleepers) and not thinking

    def wakes(self, time_s: float) -> bool:
        """Return whether advancing to a bench time ends a sleep, or nothing sleeps."""
        with self._condition:
            first_s = min((sleeper.until_s for sleeper in self._sleepers), default=-math.inf)
        return first_s <= time_s + _TICK_S

    def advance_to(self, time_s: float, behind_s: float | None = None) -> None:
        """Set bench time and wake all sleepers whose deadline has passed.

        Parameters
        ----------
        behind_s : float, optional
            Delay of bench time to the wall clock (`time.monotonic`), s, if the counter states it;
            otherwise estimated from this block. The smallest delay counts.
        """
        with self._condition:
            drifted_s = self._behind_s + LARGEST_DRIFT * (time_s - self._now_s)
            self._told = behind_s is not None
            if behind_s is None:
                behind_s = time.monotonic() - time_s
            self._behind_s = min(behind_s, drifted_s)  # an answer may come late, but never early
            self._now_s = time_s
            due = [sleeper for sleeper in self._sleepers if sleeper.until_s <= time_s + _TICK_S]
            for sleeper in due:
                self._sleepers.remove(sleeper)
            # Woken under the lock: no block may begin between a wake and its registration.
            for sleeper in due:
                sleeper.wake(None)

    def interrupt(self, error: BaseException) -> None:
        """Wake every sleeper with an error; later sleepers aren't affected."""
        with self._condition:
            woken, self._sleepers = self._sleepers, []
            for sleeper in woken:
                sleeper.wake(error)

    def stop(self, error: BaseException) -> None:
        """End bench time: wake every present and future sleeper with this error."""
        with self._condition:
            self._failure = error
        self.interrupt(error)
