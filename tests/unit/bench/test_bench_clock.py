import asyncio
import threading
import time
from collections.abc import Coroutine
from typing import Any, TypeVar

import pytest

from torquebench.bench.clock import BenchClock
from torquebench.errors import BenchError, LimitError

T = TypeVar("T")
BLOCK_S = 0.05


class Ticker:
    """Advances a clock in blocks as acquisition does, until it is stopped."""

    def __init__(self, clock: BenchClock) -> None:
        self._clock = clock
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        while not self._stopped.is_set():
            if self._clock.wait_for_demand(0.01):
                self._clock.advance_to(self._clock.now() + BLOCK_S)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self._stopped.set()
        self._thread.join()


def run_on_bench_loop(clock: BenchClock, coroutine: Coroutine[Any, Any, T]) -> T:
    loop = clock.new_event_loop()
    try:
        return loop.run_until_complete(coroutine)
    finally:
        loop.close()


def test_time_goes_no_further_than_it_is_slept_for() -> None:
    clock = BenchClock(fast=True)
    with Ticker(clock):
        clock.wait(1.0)
        clock.wait(2.0)
        assert not clock.wait_for_demand(0.05), "nobody sleeps, so nothing goes on"
    assert clock.now() == pytest.approx(3.0)


def test_time_stands_while_a_woken_sleeper_thinks_though_others_sleep_on() -> None:
    clock = BenchClock(fast=True)
    woken: list[tuple[str, float]] = []

    async def one(name: str, durations_s: list[float]) -> None:
        for duration_s in durations_s:
            await clock.sleep(duration_s)
            for _ in range(20):  # thinks for many turns of the loop
                await asyncio.sleep(0)
            woken.append((name, round(clock.now(), 6)))

    async def everybody() -> None:
        await asyncio.gather(one("long", [30.0]), one("short", [0.5, 0.2, 0.2]), one("b", [0.6]))

    with Ticker(clock):
        run_on_bench_loop(clock, everybody())
    assert woken == [("short", 0.5), ("b", 0.6), ("short", 0.7), ("short", 0.9), ("long", 30.0)]


def test_a_watcher_on_a_thread_does_not_pull_time_away_from_a_thinking_loop() -> None:
    clock = BenchClock(fast=True)
    watching = threading.Thread(target=clock.wait, args=(100.0,))

    async def plan() -> list[float]:
        times = []
        for _ in range(5):
            await clock.sleep(0.5)
            time.sleep(0.01)
            times.append(round(clock.now(), 6))
        return times

    async def started() -> list[float]:
        watching.start()
        return await plan()

    with Ticker(clock):
        assert run_on_bench_loop(clock, started()) == [0.5, 1.0, 1.5, 2.0, 2.5]
        watching.join()


def test_what_safety_requires_goes_on_although_a_loop_hangs() -> None:
    clock = BenchClock(fast=True)

    async def hangs() -> float:
        await clock.sleep(BLOCK_S)
        clock.require(1.0)
        deadline = time.monotonic() + 120.0
        while clock.now() < 1.0 and time.monotonic() < deadline:
            time.sleep(0.001)
        return clock.now()

    with Ticker(clock):
        assert run_on_bench_loop(clock, hangs()) == pytest.approx(1.0)


def test_a_time_that_has_come_already_does_not_wait() -> None:
    clock = BenchClock(fast=True)
    clock.advance_to(2.0)
    clock.wait_until(1.0)
    asyncio.run(clock.sleep(0.0))
    asyncio.run(clock.sleep_until(2.0))


def test_an_interruption_wakes_every_sleeper_with_its_cause_once() -> None:
    clock = BenchClock(fast=True)

    async def interrupted() -> None:
        sleeper = asyncio.create_task(clock.sleep(10.0))
        await asyncio.sleep(0)
        clock.interrupt(LimitError("too much"))
        with pytest.raises(LimitError, match="too much"):
            await sleeper
        later = asyncio.create_task(clock.sleep(1.0))
        await asyncio.sleep(0)
        clock.advance_to(1.0)
        await later

    asyncio.run(interrupted())


def test_an_interruption_reaches_threads_that_wait() -> None:
    clock = BenchClock(fast=True)
    caught: list[BaseException] = []

    def wait() -> None:
        try:
            clock.wait(10.0)
        except LimitError as error:
            caught.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    assert clock.wait_for_demand(120.0)
    clock.interrupt(LimitError("too much"))
    thread.join(120.0)
    assert len(caught) == 1


def test_after_the_end_nobody_sleeps_for_ever() -> None:
    clock = BenchClock(fast=False)
    clock.stop(BenchError("the bench is closed"))
    with pytest.raises(BenchError, match="closed"):
        clock.wait(1.0)
    with pytest.raises(BenchError, match="closed"):
        asyncio.run(clock.sleep(1.0))


def test_a_sleeper_that_was_cancelled_is_forgotten() -> None:
    clock = BenchClock(fast=True)

    async def cancelled() -> None:
        sleeper = asyncio.create_task(clock.sleep(1.0))
        await asyncio.sleep(0)
        sleeper.cancel()
        with pytest.raises(asyncio.CancelledError):
            await sleeper
        assert not clock.wait_for_demand(0.0)

    asyncio.run(cancelled())


def test_a_bench_that_is_not_fast_always_goes_on() -> None:
    assert BenchClock(fast=False).wait_for_demand(0.0)
