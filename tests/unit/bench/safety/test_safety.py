import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import pytest

from torquebench.bench import interlocks
from torquebench.bench.blocks import Block
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.safety import Alarm, AlarmKind, RaisedAlarm
from torquebench.errors import (
    BenchError,
    InterlockError,
    LimitError,
    SignalFault,
    TorquebenchError,
)
from torquebench.signals import SignalFaultKind

if TYPE_CHECKING:
    from tests.unit.bench.conftest import LowBench
else:
    LowBench = Any

OpenBench = Callable[..., Any]


def assert_safe(bench: LowBench, kind: AlarmKind, source: str) -> Alarm:
    assert bench.supervisor.wait_safe(60.0)
    assert bench.zeroed_and_off()
    alarm: Alarm | None = bench.supervisor.alarm
    assert alarm is not None
    assert (alarm.kind, alarm.source) == (kind, source)
    assert alarm.found
    assert alarm.remedy
    return alarm


def test_a_healthy_loaded_bench_raises_no_alarm(bench: LowBench) -> None:
    bench.load_output(1900.0)
    bench.clock.wait(3.0)
    assert bench.supervisor.alarm is None
    assert bench.drivers.drives["output"].state().enabled


def test_too_much_torque_is_taken_off(open_bench: OpenBench) -> None:
    with open_bench(output__range_nm=400, output__limits__torque_nm=500) as bench:
        bench.load_output(800.0)
        with pytest.raises(LimitError, match="torque limit: output_torque"):
            bench.clock.wait(5.0)
        alarm = assert_safe(bench, AlarmKind.TORQUE_LIMIT, "output_torque")
        assert alarm.allowed == "at most 500 N·m"
        bench.clock.wait(1.0)
        assert abs(bench.acquisition.reading_nm("output_torque")) < 20.0


def test_a_standard_is_protected_like_the_modules_own_transducer(open_bench: OpenBench) -> None:
    with open_bench(output__range_nm=400, output__limits__torque_nm=500) as bench:
        bench.load_output(300.0)
        bench.clock.wait(0.5)
        bench.simulated.twin.inject_fault("output_reference", "outlier", amount=0.2)
        with pytest.raises(LimitError, match="output_reference"):
            bench.clock.wait(5.0)
        assert_safe(bench, AlarmKind.TORQUE_LIMIT, "output_reference")


def test_a_drive_that_runs_away_is_stopped(open_bench: OpenBench) -> None:
    with open_bench(output__limits__speed_rpm=5) as bench:
        bench.load_output(0.0)
        bench.drivers.drives["output"].command_speed(1.5, 100.0)
        with pytest.raises(LimitError, match="speed limit: output speed"):
            bench.clock.wait(5.0)
        assert_safe(bench, AlarmKind.SPEED_LIMIT, "output")
        bench.clock.wait(3.0)
        assert abs(bench.acquisition.speed_rad_s("output")) < 0.05


def test_heat_stops_the_bench(open_bench: OpenBench) -> None:
    with open_bench(output__limits__temperature_c=23.7) as bench:
        bench.load_output(100.0)
        bench.clock.wait(1.0)
        assert bench.supervisor.alarm is None
        bench.simulated.twin.set_climate(500.0)
        with pytest.raises(LimitError, match="temperature limit: probe output_transducer"):
            bench.clock.wait(600.0)
        assert_safe(bench, AlarmKind.TEMPERATURE_LIMIT, "output_transducer")


def test_a_bench_that_is_too_warm_already_is_not_switched_on(open_bench: OpenBench) -> None:
    warm = {"driver__ambient_c": 40.0, "output__limits__temperature_c": 35.0}
    with open_bench(**warm) as bench, pytest.raises(InterlockError, match="temperature limit"):
        interlocks.check_enable(bench.state, "output")


@pytest.mark.parametrize("channel", ["output_torque", "output_reference", "input_torque"])
@pytest.mark.parametrize(
    "kind", ["silent", "missing_pulses", "doubled_pulses", "out_of_modulation", "frozen"]
)
def test_a_lost_signal_takes_the_torque_off(bench: LowBench, channel: Any, kind: Any) -> None:
    bench.load_output(800.0)
    bench.clock.wait(0.5)
    bench.simulated.twin.inject_fault(channel, kind, duration_s=2.0)
    with pytest.raises(SignalFault, match=channel):
        bench.clock.wait(2.0)
    assert_safe(bench, AlarmKind.SIGNAL_LOST, channel)


@pytest.mark.parametrize("channel", ["output_torque", "output_reference"])
def test_a_frozen_signal_stays_marked_until_it_lives_again(bench: LowBench, channel: Any) -> None:
    bench.load_output(0.0)
    bench.drivers.drives["output"].disable()
    bench.commands.output.enabled = False  # nothing is stopped by it
    bench.clock.wait_until(1.0)
    bench.simulated.twin.inject_fault(channel, "frozen", duration_s=1.0)
    bench.clock.wait_until(2.5)
    samples = bench.acquisition.channel(channel).recent
    assert (samples.window(1.35, 1.99)["fault"] == SignalFaultKind.STUCK).all()
    assert not samples.window(2.1, 2.5)["fault"].any()


def test_one_faulty_window_is_no_alarm(bench: LowBench) -> None:
    bench.load_output(800.0)
    bench.clock.wait_until(0.5)
    bench.simulated.twin.inject_fault("output_torque", "missing_pulses", duration_s=0.012)
    bench.clock.wait_until(1.0)
    assert bench.acquisition.channel("output_torque").recent.window(0.5, 1.0)["fault"].any()
    assert bench.supervisor.alarm is None


def test_a_lost_signal_is_no_alarm_while_no_drive_has_power(bench: LowBench) -> None:
    bench.clock.wait(0.1)
    bench.simulated.twin.inject_fault("output_torque", "silent", duration_s=0.5)
    bench.clock.wait(0.5)
    assert bench.supervisor.alarm is None


def test_a_drive_that_switches_itself_off_is_noticed(bench: LowBench) -> None:
    bench.load_output(200.0)
    bench.clock.wait(0.2)
    bench.drivers.drives["output"].disable()
    with pytest.raises(BenchError, match="output drive: lost its enable"):
        bench.clock.wait(1.0)
    assert_safe(bench, AlarmKind.DRIVE_FAULT, "output")


def test_a_missing_heartbeat_takes_the_torque_off(bench: LowBench) -> None:
    bench.load_output(200.0)
    bench.supervisor.heartbeats.expect("procedure", 1.0)
    for _ in range(4):
        bench.clock.wait(0.5)
        bench.supervisor.heartbeats.beat("procedure")
    assert bench.supervisor.alarm is None
    with pytest.raises(BenchError, match="no heartbeat of the procedure"):
        bench.clock.wait(5.0)
    assert_safe(bench, AlarmKind.HEARTBEAT, "procedure")


def test_who_lives_is_not_missed_when_power_comes_on_late(bench: LowBench) -> None:
    beat = bench.supervisor.heartbeats.beat
    bench.supervisor.heartbeats.expect("run engine", 0.5, lambda: beat("run engine"))
    bench.clock.wait(2.0)  # somebody mounts the standard
    bench.load_output(200.0)
    bench.clock.wait(1.0)
    assert bench.supervisor.alarm is None


def test_a_released_heartbeat_is_not_missed(bench: LowBench) -> None:
    bench.load_output(200.0)
    pings: list[float] = []
    bench.supervisor.heartbeats.expect("procedure", 1.0, lambda: pings.append(bench.clock.now()))
    bench.clock.wait(0.5)
    bench.supervisor.heartbeats.release("procedure")
    bench.supervisor.heartbeats.beat("procedure")
    bench.clock.wait(3.0)
    assert bench.supervisor.alarm is None
    assert len(pings) == 10


class HangingCounter:
    """The simulated counter, until its connection hangs."""

    def __init__(self, drivers: DriverSet) -> None:
        self._counter = drivers.counter
        self.hang = threading.Event()
        self.released = threading.Event()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._counter, name)

    def read_block(self, duration_s: float) -> Block:
        if self.hang.is_set():
            self.released.wait(120.0)
        return self._counter.read_block(duration_s)


def test_the_torque_goes_off_although_acquisition_hangs(open_bench: OpenBench) -> None:
    counters: list[HangingCounter] = []

    def wrap(drivers: DriverSet) -> DriverSet:
        counters.append(HangingCounter(drivers))
        return replace(drivers, counter=counters[0])

    with open_bench(wrap=wrap, safety__stall_s=0.2) as bench:
        bench.load_output(500.0)
        bench.clock.wait(0.5)
        counters[0].hang.set()
        with pytest.raises(BenchError, match="acquisition stalled"):
            bench.clock.wait(1.0)
        assert bench.supervisor.wait_safe(60.0)
        assert not bench.drivers.drives["output"].state().enabled
        assert not bench.commands.any_enabled
        counters[0].released.set()


def test_a_silent_encoder_is_a_lost_signal_and_no_standstill(open_bench: OpenBench) -> None:
    class Silent(HangingCounter):
        def read_block(self, duration_s: float) -> Block:
            block = self._counter.read_block(duration_s)
            records = {name: r for name, r in block.records.items() if name != "output_angle"}
            return replace(block, records=records) if self.hang.is_set() else block

    counters: list[Silent] = []

    def wrap(drivers: DriverSet) -> DriverSet:
        counters.append(Silent(drivers))
        return replace(drivers, counter=counters[0])

    with open_bench(wrap=wrap) as bench:
        bench.load_output(200.0)
        bench.clock.wait(0.3)
        counters[0].hang.set()
        with pytest.raises(SignalFault, match="no sample of the output encoder"):
            bench.clock.wait(1.0)
        assert_safe(bench, AlarmKind.SIGNAL_LOST, "output encoder")
        with pytest.raises(SignalFault, match="no angle from the output encoder"):
            bench.acquisition.speed_rad_s("output")
        with pytest.raises(SignalFault, match="no angle from the output encoder"):
            interlocks.check_unloaded(bench.state, "output", "change the mode")


def test_a_missing_probe_is_a_lost_signal(open_bench: OpenBench) -> None:
    class Deaf:
        lost = False

        def __init__(self, drivers: DriverSet) -> None:
            self._temperature = drivers.temperature

        def temperatures(self) -> dict[str, float]:
            probes = dict(self._temperature.temperatures())
            if self.lost:
                del probes["output_transducer"]
            return probes

    probes: list[Deaf] = []

    def wrap(drivers: DriverSet) -> DriverSet:
        probes.append(Deaf(drivers))
        return replace(drivers, temperature=probes[0])

    with open_bench(wrap=wrap) as bench:
        bench.load_output(200.0)
        bench.clock.wait(0.3)
        probes[0].lost = True
        with pytest.raises(SignalFault, match="no sample of the probe output_transducer"):
            bench.clock.wait(1.0)
        assert_safe(bench, AlarmKind.SIGNAL_LOST, "probe output_transducer")


def test_an_alarm_stays_latched_until_a_person_acknowledges_it(bench: LowBench) -> None:
    heard: list[RaisedAlarm] = []
    bench.supervisor.subscribe(heard.append)
    assert bench.supervisor.acknowledge("A. Tester") is None
    bench.load_output(300.0)
    bench.clock.wait(0.3)
    with bench.supervisor._lock:  # so long no block of acquisition goes on with the ramp
        first = bench.supervisor.trip(AlarmKind.STOP, "test", "stop", "", "go on")
        with pytest.raises(InterlockError, match="still ramp"):
            bench.supervisor.acknowledge("A. Tester")
    second = bench.supervisor.trip(AlarmKind.STOP, "test", "once more", "", "go on")
    assert bench.supervisor.wait_safe(60.0)
    assert bench.supervisor.alarm is first
    assert bench.supervisor.history == (first, second)
    assert [each.alarm for each in heard] == [first, second]
    assert [each.alarm for each in bench.supervisor.alarms] == [first, second]
    bench.clock.wait(5.0)
    assert bench.supervisor.alarm is first
    with pytest.raises(TorquebenchError, match="stop requested"):
        bench.supervisor.raise_if_latched()
    with pytest.raises(InterlockError, match="person's name"):
        bench.supervisor.acknowledge("  ")
    assert bench.supervisor.acknowledge("A. Tester") is first
    assert bench.supervisor.alarms == ()
    assert {each.acknowledged_by for each in bench.supervisor.entries} == {"A. Tester"}
    bench.supervisor.raise_if_latched()


def test_the_way_to_safety_is_gone_in_simulated_time_although_nobody_sleeps(
    bench: LowBench,
) -> None:
    bench.load_output(300.0)
    bench.clock.wait(0.3)
    bench.supervisor.trip(AlarmKind.STOP, "test", "stop", "", "go on")
    assert bench.supervisor.wait_safe(60.0)
    assert bench.zeroed_and_off()
    time.sleep(0.1)
    assert bench.clock.now() < 1.0


def test_an_orderly_stop_keeps_to_the_drives_own_rates(bench: LowBench) -> None:
    bench.load_output(2000.0)  # its rate: 4000 N·m/s
    bench.clock.wait(1.0)
    needed_s = bench.supervisor.unload()
    assert needed_s == pytest.approx(0.5 + 0.2)
    bench.clock.wait(0.25)
    assert bench.drivers.drives["output"].state().torque_nm == pytest.approx(1000.0)
    assert bench.supervisor.unload() == pytest.approx(0.45), "on its way already"
    bench.clock.wait(0.5)
    assert abs(bench.acquisition.reading_nm("output_torque")) < 20.0
    assert bench.supervisor.unload() == 0.0
    assert bench.drivers.drives["output"].state().enabled
    assert bench.supervisor.alarm is None


def test_a_drive_that_refuses_to_ramp_is_disabled(open_bench: OpenBench) -> None:
    class Stubborn:
        def __init__(self, drive: Any) -> None:
            self._drive = drive

        def __getattr__(self, name: str) -> Any:
            return getattr(self._drive, name)

        def ramp_to_zero(self, _duration_s: float) -> None:
            raise BenchError("the drive doesn't answer")

    def wrap(drivers: DriverSet) -> DriverSet:
        return replace(
            drivers, drives={side: Stubborn(drive) for side, drive in drivers.drives.items()}
        )

    with open_bench(wrap=wrap) as bench:
        bench.load_output(300.0)
        bench.clock.wait(0.3)
        bench.supervisor.trip(AlarmKind.STOP, "test", "stop", "", "go on")
        assert not bench.drivers.drives["output"].state().enabled
        assert_safe(bench, AlarmKind.STOP, "test")
