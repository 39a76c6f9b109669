"""Warnings, tightened limits, presence, slow drives and slices of the supervisor."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from torquebench.bench import interlocks
from torquebench.bench.blocks import Block
from torquebench.bench.drivers.base import DriverSet, DriveState
from torquebench.bench.safety import AlarmKind, AlarmLevel, StepLimits
from torquebench.bench.safety.signals import SignalJudge
from torquebench.errors import (
    BenchError,
    InputError,
    InterlockError,
    LimitError,
    SignalFault,
    TorquebenchError,
)
from torquebench.signals import EdgeBlock, Record

if TYPE_CHECKING:
    from tests.unit.bench.conftest import LowBench
else:
    LowBench = Any

OpenBench = Callable[..., Any]


def test_a_warning_comes_below_the_limit_and_goes_with_hysteresis(open_bench: OpenBench) -> None:
    with open_bench(output__range_nm=400, output__limits__torque_nm=500) as bench:
        heard: list[tuple[AlarmLevel, bool]] = []
        bench.supervisor.subscribe(
            lambda entry: heard.append((entry.alarm.level, entry.cleared is not None))
        )
        bench.load_output(482.0)
        bench.clock.wait(1.0)
        sources = {each.alarm.source for each in bench.supervisor.alarms}
        assert sources <= {"output_torque", "output_reference"}
        assert sources
        assert {each.alarm.level for each in bench.supervisor.alarms} == {AlarmLevel.WARNING}
        assert bench.supervisor.alarm is None
        bench.command_torque(470.0, 1e5)
        bench.clock.wait(1.0)
        assert bench.supervisor.alarms, "within the hysteresis"
        bench.command_torque(300.0, 1e5)
        bench.clock.wait(1.0)
        assert bench.supervisor.alarms == ()
        assert (AlarmLevel.WARNING, True) in heard


@pytest.mark.parametrize(
    ("limits", "kind"),
    [
        (StepLimits("output", torque_nm=300.0), AlarmKind.TORQUE_LIMIT),
        (StepLimits("output", torque_rate_nm_per_s=1000.0), AlarmKind.RATE_LIMIT),
    ],
)
def test_a_step_tightens_a_limit_while_it_lasts(
    bench: LowBench, limits: StepLimits, kind: AlarmKind
) -> None:
    with bench.supervisor.limits.within(limits):
        bench.load_output(250.0 if kind is AlarmKind.TORQUE_LIMIT else 0.0)
        bench.clock.wait(0.5)
        assert bench.supervisor.alarm is None
        bench.command_torque(500.0, 1e4)
        with pytest.raises(LimitError):
            bench.clock.wait(2.0)
    assert bench.supervisor.alarm is not None
    assert bench.supervisor.alarm.kind is kind
    assert bench.supervisor.limits.side("output").torque_nm == 2400.0


def test_a_side_may_not_turn_further_than_its_step_allows(bench: LowBench) -> None:
    bench.load_output(100.0)
    bench.clock.wait(0.3)
    per_turn = bench.description.output.encoder.counts_per_revolution
    with bench.supervisor.limits.within(StepLimits("output", angle_deg=2.0)):
        bench.clock.wait(0.3)
        bench.simulated.twin.inject_fault("output", "encoder_slip", amount=per_turn / 360.0)
        bench.clock.wait(0.3)
        assert bench.supervisor.alarm is None, "one degree"
        bench.simulated.twin.inject_fault("output", "encoder_slip", amount=per_turn / 180.0)
        with pytest.raises(LimitError, match="output side turned"):
            bench.clock.wait(0.3)


def test_a_tightened_torque_is_refused_before_it_is_commanded(bench: LowBench) -> None:
    bench.load_output(0.0)
    bench.supervisor.limits.tighten(StepLimits("output", torque_nm=100.0))
    with pytest.raises(LimitError, match="±100 N·m"):
        interlocks.check_set_point(bench.state, "output", "torque", 150.0)
    bench.supervisor.limits.loosen()
    interlocks.check_set_point(bench.state, "output", "torque", 150.0)


def test_a_module_that_disagrees_with_the_standard_stops_the_bench(bench: LowBench) -> None:
    bench.load_output(500.0)
    bench.clock.wait(0.5)
    # 120 N·m beside the truth: within every limit, no fault of any pulse train.
    bench.simulated.twin.inject_fault("output_torque", "outlier", duration_s=2.0, amount=0.03)
    with pytest.raises(SignalFault, match="output_torque and output_reference are"):
        bench.clock.wait(2.0)


@pytest.mark.parametrize(("gap_s", "kinds"), [(0.5, set()), (0.0, {AlarmKind.RATE_LIMIT})])
def test_a_rate_counts_the_time_from_one_sample_to_the_next(
    bench: LowBench, gap_s: float, kinds: set[AlarmKind]
) -> None:
    """A standard whose connection was lost for a moment seemed to change all at once."""
    bench.load_output(500.0)
    bench.clock.wait(0.5)
    block = bench.acquisition.latest_block
    judge = SignalJudge(bench.description, bench.supervisor.limits, bench.commands)
    found = set()
    with bench.supervisor.limits.within(StepLimits("output", torque_rate_nm_per_s=1000.0)):
        for torque_nm, later_s in ((500.0, 0.0), (600.0, 0.05 + gap_s)):
            records = {
                name: block.records[name].with_columns(
                    reading_nm=torque_nm + 0.1 * np.arange(5),
                    time_s=block.stop_s + later_s + 0.01 * np.arange(-5, 0),
                )
                for name in ("output_torque", "output_reference")
            }
            moment = block.stop_s + later_s
            changed = replace(block, stop_s=moment, records={**block.records, **records})
            violation, _ = judge.judge(changed)
            found |= set() if violation is None else {violation.kind}
    assert found == kinds


@pytest.mark.parametrize("turns", [0.0, 0.3])
def test_a_slip_between_two_polls_of_an_encoder_is_too_fast(bench: LowBench, turns: float) -> None:
    """Each block was judged by its own samples: what happened from one to the next wasn't seen."""
    bench.load_output(0.0)
    bench.clock.wait(0.5)
    block = bench.acquisition.latest_block
    judge = SignalJudge(bench.description, bench.supervisor.limits, bench.commands)
    slip = round(turns * bench.description.output.encoder.counts_per_revolution)
    found = []
    for moment, counts in ((block.stop_s, 0), (block.stop_s + 0.05, slip)):
        time_s = moment - np.array([0.02, 0.01])  # a drive that is asked twice a block
        angle = Record({"time_s": time_s, "angle_counts": np.full(2, counts)})
        records = {**block.records, "output_angle": angle}
        violation, _ = judge.judge(replace(block, stop_s=moment, records=records))
        found += [] if violation is None else [violation.kind]
    assert found == ([AlarmKind.SPEED_LIMIT] if slip else [])


def test_nobody_at_the_bench_takes_the_power_off(open_bench: OpenBench) -> None:
    with open_bench(safety__presence_s=600.0) as bench:
        with pytest.raises(InterlockError, match="nobody at the bench"):
            interlocks.check_enable(bench.state, "output")
        bench.supervisor.heartbeats.confirm_presence("A. Tester")
        interlocks.check_enable(bench.state, "output")
        bench.load_output(100.0)
        bench.clock.wait(0.2)
        assert bench.supervisor.alarm is None
        bench.supervisor.heartbeats._present_until = time.monotonic()  # its time has passed
        with pytest.raises(BenchError, match="no confirmation of presence"):
            bench.clock.wait(1.0)
        assert bench.supervisor.alarm.kind is AlarmKind.PRESENCE


PATIENT: dict[str, Any] = {
    "safety__stall_s": 60.0,
    "input__drive__watchdog_s": 10.0,
    "output__drive__watchdog_s": 10.0,
}
"""In real time a busy computer may stand for seconds, which is no alarm that is looked for here."""


class SlowDrive:
    """A drive on a wire that can hang."""

    def __init__(self, drive: Any) -> None:
        self.drive = drive
        self.hanging = threading.Event()
        self.released = threading.Event()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.drive, name)

    def state(self) -> DriveState:
        if self.hanging.is_set():
            self.released.wait(120.0)
        state: DriveState = self.drive.state()
        return state


def test_a_drive_that_hangs_does_not_keep_the_other_from_being_stopped(
    open_bench: OpenBench, describe: Callable[..., Any]
) -> None:
    slow: dict[str, SlowDrive] = {}

    def wrap(drivers: DriverSet) -> DriverSet:
        slow.update({side: SlowDrive(drive) for side, drive in drivers.drives.items()})
        return replace(drivers, drives=slow, blocking=True)  # type: ignore[arg-type]

    with open_bench(real_time=True, wrap=wrap, **PATIENT) as bench:
        bench.load_output(100.0)
        slow["input"].drive.enable()
        bench.commands.input.enabled = True
        time.sleep(0.2)
        assert bench.supervisor.alarm is None
        slow["input"].hanging.set()
        bench.supervisor._description = describe(**PATIENT | {"input__drive__watchdog_s": 0.2})
        deadline = time.monotonic() + 60.0
        while slow["output"].drive.state().torque_nm and time.monotonic() < deadline:
            time.sleep(0.005)
        assert slow["output"].drive.state().torque_nm == 0.0
        assert bench.supervisor.alarm is not None
        assert bench.supervisor.alarm.name == "drive fault: input"
        assert "no answer for" in bench.supervisor.alarm.found
        slow["input"].released.set()
        assert bench.supervisor.wait_safe(60.0)


def test_a_violation_is_seen_between_blocks_in_real_time(open_bench: OpenBench) -> None:
    # A busy computer may stand for a part of a block, not for a whole one.
    changes = {"counter__block_s": 1.0, "output__range_nm": 400, "output__limits__torque_nm": 500}
    with open_bench(real_time=True, **PATIENT, **changes) as bench:
        bench.load_output(300.0)
        bench.clock.wait(0.6)
        at_alarm: list[int] = []
        bench.supervisor.subscribe(lambda _: at_alarm.append(bench.acquisition.blocks))
        bench.command_torque(800.0, 1e5)
        blocks = bench.acquisition.blocks
        with pytest.raises(TorquebenchError, match="torque limit"):
            bench.clock.wait(20.0)
        assert at_alarm[0] - blocks <= 1, "not only when its block was full"
        assert bench.supervisor.wait_safe(60.0)


def counted(start: int, stop: int, ticks: list[int]) -> Block:
    edges = EdgeBlock(np.array(ticks, dtype=np.int64), start, stop, 1e6)
    angle = Record({"time_s": np.array([start / 1e6]), "angle_counts": np.array([start])})
    return Block(start / 1e6, stop / 1e6, {"input_torque": edges}, {"input_angle": angle})


def test_slices_are_put_together_without_a_gap() -> None:
    whole = Block.join([counted(0, 100, [10, 50]), counted(100, 200, [150]), counted(200, 300, [])])
    edges = whole.edges["input_torque"]
    assert edges.ticks.tolist() == [10, 50, 150]
    assert (edges.start_tick, edges.stop_tick) == (0, 300)
    assert whole.records["input_angle"]["angle_counts"].tolist() == [0, 100, 200]
    with pytest.raises(InputError, match="edges up to tick 100"):
        Block.join([counted(0, 100, [10]), counted(101, 200, [150])])
