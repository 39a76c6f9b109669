"""Instruments with clocks of their own beside the counter: nothing is judged at the wrong time."""

import re
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from torquebench.bench.blocks import Block
from torquebench.bench.clock import BenchClock
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.drivers.sample_clock import SampleClock
from torquebench.bench.safety import AlarmKind
from torquebench.bench.safety.signals import SignalJudge
from torquebench.errors import SignalFault
from torquebench.signals import EdgeBlock, FrequencyCounter, Record

OpenBench = Callable[..., Any]
PERIOD_S, BLOCK_S = 0.01, 0.05


def behind_at(asked_s: float, behind_s: float) -> float:
    """How far a computer is behind that begins late and catches up."""
    return max(0.002, behind_s - 0.7 * asked_s)


@pytest.mark.parametrize("behind_s", [0.0, 0.1, 0.6])
def test_samples_have_their_times_although_a_computer_catches_up(behind_s: float) -> None:
    clock = SampleClock(PERIOD_S)
    handed, found = 0, []
    for number in range(1, 80):
        until_s = number * BLOCK_S
        asked_s = until_s + behind_at(until_s, behind_s)
        made = int(asked_s / PERIOD_S)  # each states the middle of its own period
        values = PERIOD_S * (np.arange(handed, made) + 0.5)
        handed = made
        samples = clock.take(values, until_s, until_s)
        assert (samples.time_s <= until_s + 1e-9).all(), "none later than asked for"
        found.append(samples)
    time_s = np.concatenate([each.time_s for each in found])
    stated_s = np.concatenate([each["signal"] for each in found])
    assert stated_s.size > 0.9 * handed
    np.testing.assert_array_equal(np.diff(stated_s).round(9), PERIOD_S)
    np.testing.assert_allclose(time_s, stated_s, atol=PERIOD_S)


def test_samples_have_their_times_although_a_computer_is_behind_for_good() -> None:
    clock, handed, found = SampleClock(PERIOD_S), 0, []
    for number in range(1, 40):
        until_s = number * BLOCK_S
        timed_s = until_s + 0.19 + 0.01 * (number % 3)  # of which the counter tells
        made = int(timed_s / PERIOD_S + 1e-9)
        values = PERIOD_S * (np.arange(handed, made) + 0.5)
        handed = made
        found.append(clock.take(values, until_s, timed_s))
    time_s = np.concatenate([each.time_s for each in found])
    stated_s = np.concatenate([each["signal"] for each in found])
    assert stated_s.size > 100
    np.testing.assert_allclose(time_s, stated_s, atol=PERIOD_S)


class Buffering:
    """A counter that began to count before anybody read it, by a wall clock of its own."""

    def __init__(self, counter: Any, began_s: float, *, tells: bool) -> None:
        self._counter = counter
        self._tells = tells
        self._read_s = 0.0
        self.wall_s = began_s  # since it began
        self.behind_s: list[float] = []
        """After each read that acquisition's own thread made."""

    def __getattr__(self, name: str) -> Any:
        return getattr(self._counter, name)

    def read_block(self, duration_s: float) -> Block:
        self._read_s += duration_s
        self.wall_s = max(self.wall_s + 0.4 * duration_s, self._read_s)  # so long a read takes
        waiting_s = self.wall_s - self._read_s
        if threading.current_thread() is not threading.main_thread():
            self.behind_s.append(waiting_s)
            time.sleep(0.02)
        block: Block = self._counter.read_block(duration_s)
        return replace(block, waiting_s=waiting_s if self._tells else None)


@pytest.mark.parametrize("tells", [True, False])
def test_a_bench_opens_when_it_has_caught_up_with_its_counter(
    open_bench: OpenBench, monkeypatch: pytest.MonkeyPatch, tells: bool
) -> None:
    counters: list[Buffering] = []
    wall = SimpleNamespace(monotonic=lambda: counters[0].wall_s)
    monkeypatch.setattr("torquebench.bench.acquisition.time", wall)
    monkeypatch.setattr("torquebench.bench.clock.time", wall)

    def wrap(drivers: DriverSet) -> DriverSet:
        counters.append(Buffering(drivers.counter, began_s=3.0, tells=tells))
        return replace(drivers, counter=counters[0], simulated_time=False)

    with open_bench(real_time=True, wrap=wrap) as bench:
        bench.clock.wait(0.1)
    assert counters[0].behind_s[0] < BLOCK_S, "3 s were buffered"


def test_nothing_is_compiled_while_the_counter_already_counts(
    open_bench: OpenBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    order: list[str] = []
    push = FrequencyCounter.push

    def pushing(counter: FrequencyCounter, edges: EdgeBlock) -> Record:
        order.append("evaluate")
        return push(counter, edges)

    def wrap(drivers: DriverSet) -> DriverSet:
        read_block = drivers.counter.read_block

        def reading(duration_s: float) -> Block:
            order.append("read")
            return read_block(duration_s)

        monkeypatch.setattr(drivers.counter, "read_block", reading)
        return drivers

    monkeypatch.setattr(FrequencyCounter, "push", pushing)
    with open_bench(wrap=wrap):
        assert order[:2] == ["evaluate", "read"]


def test_the_present_lies_after_what_was_acquired_last() -> None:
    clock = BenchClock(fast=False)
    soonest = time.monotonic()
    clock.advance_to(1.0)
    time.sleep(0.1)
    clock.advance_to(1.05)  # late
    assert 1.09 <= clock.present() <= 1.0 + time.monotonic() - soonest + 0.01
    told = time.monotonic()
    clock.advance_to(1.1, told - 1.6)  # the counter had timed half a second more
    assert 1.6 <= clock.present() <= 1.7 + time.monotonic() - told
    clock.advance_to(1.7, time.monotonic() - 1.0)  # an answer that came late
    assert clock.present() >= 1.6
    clock.advance_to(1.8, time.monotonic() - 5.0)  # all stood still for 3 s, the counter didn't
    assert clock.present() >= 5.0, "what is told now is told then"
    fast = BenchClock(fast=True)
    fast.advance_to(1.0)
    time.sleep(0.02)
    assert fast.present() == fast.now() == 1.0


class Readout:
    """A standard's read-out, for its period."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s

    def read(self, side: str, until_s: float, timed_s: float) -> Record:
        raise NotImplementedError


def judged(bench: Any, late_s: float, factor: float, period_s: float, *, ramp: bool) -> Any:
    """Hold a standard that is late and states another torque against a loaded module."""
    bench.load_output(0.0)
    bench.clock.wait(1.5)
    block = bench.acquisition.latest_block
    judge = SignalJudge(
        bench.description,
        bench.supervisor.limits,
        bench.commands,
        Readout(period_s),  # type: ignore[arg-type]
    )
    judge._following = replace_nothing(judge._following)
    violation, start_s = None, block.start_s
    for number in range(40):
        begin_s = start_s + number * BLOCK_S
        time_s = begin_s + PERIOD_S * (np.arange(5) + 0.5)
        stated_s = np.array(
            [t for t in time_s if round(t / PERIOD_S - 0.5) % (period_s / PERIOD_S) < 0.5]
        )

        def torque(at_s: Any) -> Any:
            rising = np.clip(4000.0 * (np.asarray(at_s) - start_s - 1.0), 0.0, 1600.0)
            noise = 0.1 * np.sin(1e4 * np.asarray(at_s))
            return noise + (rising if ramp else 1000.0)

        def record(at_s: Any, torque_nm: Any) -> Record:
            return Record({"time_s": at_s, "reading_nm": torque_nm, "fault": np.zeros_like(at_s)})

        own = record(time_s, torque(time_s))
        reference = record(stated_s, factor * torque(stated_s - late_s))
        violation, _ = judge.judge(
            replace(
                block,
                start_s=begin_s,
                stop_s=begin_s + BLOCK_S,
                records={
                    **block.records,
                    "output_torque": own,
                    "output_reference": reference,
                },
            )
        )
        if violation is not None:
            break
    return violation


def replace_nothing(following: Any) -> Any:
    """Leave what the drive was told out of it."""
    following.judge = lambda _block: None
    return following


@pytest.mark.parametrize(("late_s", "period_s"), [(0.08, 0.01), (-0.08, 0.01), (0.08, 0.1)])
def test_clocks_that_are_a_little_apart_do_not_disagree(
    bench: Any, late_s: float, period_s: float
) -> None:
    assert judged(bench, late_s, 1.0, period_s, ramp=True) is None


@pytest.mark.parametrize("period_s", [0.01, 0.1])
def test_transducers_that_state_another_torque_disagree(bench: Any, period_s: float) -> None:
    violation = judged(bench, 0.0, 0.85, period_s, ramp=False)
    assert violation is not None
    assert violation.kind is AlarmKind.DISAGREEMENT
    assert re.search(r"1(49|50)\.\d N·m apart", violation.found)


class Slow:
    """A read-out that states the mean of ten windows, every 100 ms."""

    period_s = 0.1

    def __init__(self, readout: Any) -> None:
        self._readout = readout
        self._waiting: dict[str, list[float]] = {}
        self._clocks: dict[str, SampleClock] = {}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._readout, name)

    def read(self, side: str, until_s: float, timed_s: float) -> Record:
        waiting = self._waiting.setdefault(side, [])
        waiting += self._readout.read(side, until_s, timed_s)["signal"].tolist()
        count = len(waiting) // 10
        means = np.array(waiting[: 10 * count]).reshape(count, 10).mean(axis=1)
        del waiting[: 10 * count]
        return self._clocks.setdefault(side, SampleClock(0.1)).take(means, until_s, timed_s)


def test_a_read_out_every_100_ms_is_neither_lost_nor_disagrees(open_bench: OpenBench) -> None:
    def wrap(drivers: DriverSet) -> DriverSet:
        return replace(drivers, reference=Slow(drivers.reference))  # type: ignore[arg-type]

    with open_bench(wrap=wrap, driver__reference="readout") as bench:
        bench.load_output(0.0)
        bench.clock.wait(1.0)
        for torque_nm in (800.0, -400.0, 0.0):
            bench.command_torque(torque_nm, 4000.0)
            bench.clock.wait(1.0)
        assert bench.supervisor.alarm is None
        read = bench.acquisition.window("output_reference", 0.5, 4.0)
        assert read.time_s.size >= 30
        np.testing.assert_allclose(np.diff(read.time_s), 0.1, atol=0.01)
        bench.drivers.reference._clocks["output"].take = lambda *_: Record(
            {"time_s": np.empty(0), "signal": np.empty(0)}
        )
        with pytest.raises(SignalFault, match="output_reference"):
            bench.clock.wait(1.0)
