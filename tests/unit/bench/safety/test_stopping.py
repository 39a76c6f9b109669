"""The way to the safe state: zero, power off, and both read back."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from tests.unit.bench.test_bench_devices import play, ready

from torquebench.bench.drivers.base import DriverSet, DriveState
from torquebench.bench.safety import AlarmKind, AlarmLevel
from torquebench.errors import BenchError, InterlockError

OpenBench = Callable[..., Any]
PATIENCE_S = 120.0


class Stubborn:
    """A drive that acknowledges and does nothing, says that it is off, or comes on by itself."""

    def __init__(self, drive: Any) -> None:
        self.drive = drive
        self.ignores = self.denies = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self.drive, name)

    def disable(self) -> None:
        if not self.ignores:
            self.drive.disable()

    def ramp_to_zero(self, duration_s: float) -> None:
        if not self.ignores:
            self.drive.ramp_to_zero(duration_s)

    def feed_watchdog(self) -> None:
        self.drive.feed_watchdog()

    def state(self) -> DriveState:
        state: DriveState = self.drive.state()
        return DriveState(False, 0.0, 0.0) if self.denies else state


@pytest.fixture
def drives() -> dict[str, Stubborn]:
    return {}


@pytest.fixture
def wrap(drives: dict[str, Stubborn]) -> Callable[[DriverSet], DriverSet]:
    def wrapped(drivers: DriverSet) -> DriverSet:
        drives.update({side: Stubborn(drive) for side, drive in drivers.drives.items()})
        for each in drives.values():
            each.drive.unguarded = lambda: True
        return replace(drivers, drives=drives)  # type: ignore[arg-type]

    return wrapped


def comes(condition: Callable[[], object]) -> bool:
    """Wait patiently for something."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return bool(condition())


def passes(bench: Any, duration_s: float) -> None:
    """Let bench time go on, whatever alarms come."""
    until_s = bench.clock.now() + duration_s
    bench.clock.require(until_s)
    assert comes(lambda: bench.clock.now() >= until_s - 1e-6)


def test_what_stays_on_after_an_alarm_is_said_and_not_acknowledged_away(
    open_bench: OpenBench, wrap: Any, drives: dict[str, Stubborn]
) -> None:
    with open_bench(wrap=wrap) as bench:
        supervisor = bench.supervisor
        bench.load_output(650.0)
        bench.clock.wait(0.5)
        drives["output"].ignores = True
        stopped = supervisor.trip(AlarmKind.STOP, "test", "a stop", "", "")
        assert not supervisor.wait_safe(PATIENCE_S)
        alarm = supervisor.unsafe
        assert alarm is supervisor.alarm
        assert alarm.found.startswith("output side: drive still on, 6")
        assert alarm.allowed.endswith("0.5 N·m at the input, 20 N·m at the output")
        assert [each.alarm for each in supervisor.alarms] == [alarm, stopped]
        assert [each.power for each in supervisor.still_on()] == [True]
        with pytest.raises(InterlockError, match="drive still on") as refused:
            supervisor.acknowledge("A. Tester")
        assert "press the emergency stop" in refused.value.remedy
        assert supervisor.alarm is alarm
        drives["output"].drive.command_torque(350.0, 1e5)
        assert comes(lambda: "drive still on, 3" in supervisor.alarm.found), "how much, anew"
        drives["output"].ignores = False  # it is told again and again
        assert comes(lambda: supervisor.safe and not supervisor.still_on())
        assert bench.zeroed_and_off()
        assert supervisor.acknowledge("A. Tester").kind is AlarmKind.NOT_SAFE
        assert supervisor.alarms == ()


def test_torque_of_a_drive_that_says_it_is_off_is_not_safe(
    open_bench: OpenBench, wrap: Any, drives: dict[str, Stubborn]
) -> None:
    with open_bench(wrap=wrap) as bench:
        bench.load_output(650.0)
        bench.clock.wait(0.5)
        drives["output"].ignores = drives["output"].denies = True
        bench.supervisor.trip(AlarmKind.STOP, "test", "a stop", "", "")
        assert not bench.supervisor.wait_safe(PATIENCE_S)
        assert bench.supervisor.alarm.found.startswith("output side: drive off, 6")


def test_power_goes_off_when_zero_is_read_back_and_not_before(
    open_bench: OpenBench, wrap: Any, drives: dict[str, Stubborn]
) -> None:
    with open_bench(wrap=wrap, safety__ramp_to_zero_s=1.0) as bench:
        bench.load_output(1000.0)
        bench.clock.wait(1.0)
        bench.supervisor.trip(AlarmKind.STOP, "test", "a stop", "", "")
        bench.supervisor.unload()
        bench.supervisor.disable()  # as a run that ends does
        assert bench.supervisor.wait_safe(PATIENCE_S)
        log = drives["output"].drive.log
        ramp = next(event for event in log if event.event == "to zero in 1 s")
        off = next(event for event in log if event.event == "off" and event.time_s > ramp.time_s)
        assert abs(off.torque_nm) <= 20.0
        assert 0.9 <= off.time_s - ramp.time_s <= 1.3


def test_power_goes_off_in_time_where_zero_is_never_read(
    open_bench: OpenBench, wrap: Any, drives: dict[str, Stubborn]
) -> None:
    with open_bench(wrap=wrap) as bench:
        bench.load_output(500.0)
        bench.clock.wait(0.5)
        drives["output"].ramp_to_zero = lambda _duration_s: None  # type: ignore[method-assign]
        began_s = bench.clock.now()
        bench.supervisor.trip(AlarmKind.STOP, "test", "a stop", "", "")
        assert bench.supervisor.wait_safe(PATIENCE_S)
        off = drives["output"].drive.log[-1]
        assert off.event == "off"
        assert abs(off.torque_nm) > 400.0
        assert 0.4 <= off.time_s - began_s <= 0.7


def test_a_switch_reads_back_that_its_drive_is_off(
    open_bench: OpenBench, wrap: Any, drives: dict[str, Stubborn]
) -> None:
    with open_bench(wrap=wrap) as bench:

        async def scene() -> None:
            async with ready(bench) as devices:
                drives["output"].ignores = True
                with pytest.raises(BenchError, match="output side: drive still on"):
                    await devices.output.drive.power.set(False)

        play(bench, scene)
        assert bench.supervisor.alarm.name == "not in the safe state: output"


def test_a_drive_that_stays_on_after_an_orderly_stop_is_an_alarm(
    open_bench: OpenBench, wrap: Any, drives: dict[str, Stubborn]
) -> None:
    with open_bench(wrap=wrap) as bench:
        bench.load_output(0.0)
        bench.clock.wait(0.2)
        drives["output"].ignores = True
        bench.supervisor.disable()
        with pytest.raises(BenchError, match="output side: drive still on"):
            bench.clock.wait(5.0)


def test_a_drive_that_comes_on_by_itself_is_an_alarm(bench: Any) -> None:
    bench.clock.wait(0.2)
    bench.drivers.drives["input"].enable()
    with pytest.raises(BenchError, match="input side: drive still on"):
        bench.clock.wait(5.0)
    assert bench.supervisor.wait_safe(PATIENCE_S)
    assert bench.zeroed_and_off()


@pytest.mark.parametrize(
    ("torque_nm", "level"), [(600.0, AlarmLevel.CRITICAL), (60.0, AlarmLevel.WARNING)]
)
def test_torque_that_stays_after_an_orderly_stop_is_said(
    open_bench: OpenBench,
    wrap: Any,
    drives: dict[str, Stubborn],
    torque_nm: float,
    level: AlarmLevel,
) -> None:
    with open_bench(wrap=wrap) as bench:
        bench.load_output(torque_nm)
        bench.clock.wait(0.5)
        drives["output"].ignores = drives["output"].denies = True
        bench.supervisor.disable()
        passes(bench, 3.0)
        worst = bench.supervisor.alarms[0].alarm
        assert (worst.kind, worst.level) == (AlarmKind.NOT_SAFE, level)
        assert worst.found.startswith("output side: drive off, ")
        if level is AlarmLevel.WARNING:
            drives["output"].drive.disable()
            passes(bench, 1.0)
            assert bench.supervisor.alarms == (), "it has gone"


def test_a_torque_that_nobody_can_read_holds_up_the_acknowledgement(bench: Any) -> None:
    bench.load_output(300.0)
    bench.clock.wait(0.5)
    now_s = bench.clock.now()
    bench.simulated.twin.inject_fault("output_torque", "silent", start_s=now_s, duration_s=4.0)
    bench.simulated.twin.inject_fault("output_reference", "silent", start_s=now_s, duration_s=4.0)
    passes(bench, 2.0)
    assert bench.supervisor.wait_safe(PATIENCE_S), "the drive says that it is off"
    with pytest.raises(InterlockError, match="drive off, torque can't be read"):
        bench.supervisor.acknowledge("A. Tester")
    passes(bench, 3.0)
    assert bench.supervisor.acknowledge("A. Tester").kind is AlarmKind.SIGNAL_LOST
