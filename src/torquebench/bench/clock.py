"""Bench time: the one time axis of a bench, in seconds since it was opened.

On hardware and in real time, bench time follows the wall. A fast simulated bench has no time of
its own: it advances exactly as far as somebody sleeps, so that it never runs away while Python
thinks, and the same plan meets the same bench however slow the machine is.
"""

from __future__ import annotations

import asyncio
import heapq
import itertools
import threading
import time
from collections.abc import Callable

__all__ = ["BenchClock"]

_TICK_S = 1e-9  # deadlines closer than this are the same instant


class BenchClock:
    """Bench time for sleepers on event loops and on threads.

    Parameters
    ----------
    fast : bool
        Advance only as far as somebody sleeps (simulated benches). Otherwise whoever acquires
        is expected to be paced by the wall or by hardware.

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
        self._horizon_s = 0.0
        self._order = itertools.count()
        self._sleepers: list[tuple[float, int, Callable[[BaseException | None], None]]] = []
        self._failure: BaseException | None = None

    def now(self) -> float:
        """Bench time, s."""
        return self._now_s

    # -- sleeping ---------------------------------------------------------------------------

    async def sleep(self, duration_s: float) -> None:
        """Sleep in bench time on the running event loop.

        Raises
        ------
        TorquebenchError
            The bench stopped or went to its safe state meanwhile; the cause itself is raised.
        """
        await self.sleep_until(self._now_s + duration_s)

    async def sleep_until(self, time_s: float) -> None:
        """Sleep on the running event loop until a bench time."""
        loop = asyncio.get_running_loop()
        future: asyncio.Future[None] = loop.create_future()

        def settle(error: BaseException | None) -> None:
            if future.done():
                return
            if error is None:
                future.set_result(None)
            else:
                future.set_exception(error)

        def wake(error: BaseException | None) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(settle, error)

        if self._enqueue(time_s, wake):
            await future

    def wait(self, duration_s: float) -> None:
        """Sleep in bench time on the calling thread; raises like `sleep`."""
        self.wait_until(self._now_s + duration_s)

    def wait_until(self, time_s: float) -> None:
        """Sleep on the calling thread until a bench time."""
        woken = threading.Event()
        outcome: list[BaseException] = []

        def wake(error: BaseException | None) -> None:
            if error is not None:
                outcome.append(error)
            woken.set()

        if self._enqueue(time_s, wake):
            woken.wait()
        if outcome:
            raise outcome[0]

    def require(self, time_s: float) -> None:
        """Let a fast bench go on until a bench time although nobody sleeps for it."""
        with self._condition:
            self._horizon_s = max(self._horizon_s, time_s)
            self._condition.notify_all()

    def _enqueue(self, time_s: float, wake: Callable[[BaseException | None], None]) -> bool:
        """Register a sleeper; False when its time has come already."""
        with self._condition:
            if self._failure is not None:
                raise self._failure
            if time_s <= self._now_s + _TICK_S:
                return False
            heapq.heappush(self._sleepers, (time_s, next(self._order), wake))
            self._horizon_s = max(self._horizon_s, time_s)
            self._condition.notify_all()
            return True

    # -- driving (acquisition only) ---------------------------------------------------------

    def wait_for_demand(self, timeout_s: float) -> bool:
        """Wait on the calling thread until the bench has to go on; True when it has to.

        A bench that isn't fast always has to.
        """
        if not self.fast:
            return True
        deadline = time.monotonic() + timeout_s
        with self._condition:
            while self._horizon_s <= self._now_s + _TICK_S:
                remaining = deadline - time.monotonic()
                if remaining <= 0.0:
                    return False
                self._condition.wait(remaining)
            return True

    def advance_to(self, time_s: float) -> None:
        """Set bench time and wake everybody whose time has come."""
        with self._condition:
            self._now_s = time_s
            due = []
            while self._sleepers and self._sleepers[0][0] <= time_s + _TICK_S:
                due.append(heapq.heappop(self._sleepers)[2])
        for wake in due:
            wake(None)

    def interrupt(self, error: BaseException) -> None:
        """Wake every sleeper with an error; later sleepers are not concerned."""
        with self._condition:
            woken = [sleeper[2] for sleeper in self._sleepers]
            self._sleepers.clear()
            if self.fast:
                self._horizon_s = self._now_s
        for wake in woken:
            wake(error)

    def stop(self, error: BaseException) -> None:
        """Bench time ends: wake every sleeper, now and in future, with this error."""
        with self._condition:
            self._failure = error
            self._condition.notify_all()
        self.interrupt(error)
