"""What becomes of the bench when the supervisor itself meets something that nobody foresaw."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from torquebench.bench.acquisition import LATE_S
from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.safety import AlarmKind, RaisedAlarm
from torquebench.bench.safety.signals import SignalJudge
from torquebench.errors import BenchError, InterlockError

if TYPE_CHECKING:
    from tests.unit.bench.conftest import LowBench
else:
    LowBench = Any

OpenBench = Callable[..., Any]
PATIENCE_S = 120.0
PATIENT: dict[str, Any] = {"safety__stall_s": 60.0, "output__drive__watchdog_s": 10.0}
"""A busy computer may stand for seconds, which is no alarm that is looked for here."""


def comes(condition: Callable[[], object]) -> bool:
    """Wait patiently for something."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return bool(condition())


def test_a_supervisor_that_fails_stops_the_bench_and_goes_on_watching(
    open_bench: OpenBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    with open_bench(real_time=True, **PATIENT) as bench:
        bench.load_output(100.0)

        def fails() -> None:
            raise ZeroDivisionError("nobody foresaw it")

        monkeypatch.setattr(bench.supervisor.heartbeats, "missing", fails)
        assert comes(lambda: bench.supervisor.alarm)
        assert bench.supervisor.alarm.kind is AlarmKind.SUPERVISOR
        assert "ZeroDivisionError: nobody foresaw it" in bench.supervisor.alarm.found
        assert bench.supervisor.wait_safe(PATIENCE_S)
        assert bench.zeroed_and_off()
        assert len(bench.supervisor.history) == 1, "said once, though it comes with every look"
        monkeypatch.undo()
        bench.supervisor.acknowledge("A. Tester")
        bench.load_output(100.0)
        bench.simulated.drives["output"].disable()
        assert comes(lambda: bench.supervisor.alarm), "it still watches"
        assert bench.supervisor.alarm.name == "drive fault: output"


def test_a_supervisor_that_cannot_even_trip_takes_the_power_off(
    open_bench: OpenBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_arguments: object) -> None:
        raise ZeroDivisionError

    with open_bench(real_time=True, **PATIENT) as bench:
        bench.load_output(100.0)
        monkeypatch.setattr(bench.supervisor, "trip", fails)
        monkeypatch.setattr(bench.supervisor, "_look_around", fails)
        assert comes(bench.zeroed_and_off)
        monkeypatch.undo()


def test_an_acquisition_that_just_ends_is_a_stall(open_bench: OpenBench) -> None:
    with open_bench(real_time=True, safety__stall_s=0.2) as bench:
        bench.load_output(100.0)
        bench.acquisition._stopping.set()  # its thread ends, and tells nobody
        assert comes(lambda: bench.supervisor.alarm)
        assert bench.supervisor.alarm.kind is AlarmKind.STALL
        assert bench.supervisor.wait_safe(PATIENCE_S)
        assert bench.zeroed_and_off()


def test_power_stays_until_the_ramp_is_over_although_others_look(
    bench: LowBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[bool] = []
    stop = bench.supervisor._stop
    ramp = stop.ramp_to_zero

    def slowly(*arguments: Any) -> None:
        bench.supervisor._watch_once()  # as the supervisor's own thread does meanwhile
        seen.append(bench.simulated.drives["output"].state().enabled)
        ramp(*arguments)

    bench.load_output(300.0)
    monkeypatch.setattr(stop, "ramp_to_zero", slowly)
    bench.supervisor.trip(AlarmKind.STOP, "test", "a stop", "", "")
    assert seen == [True, True]
    assert bench.supervisor.wait_safe(PATIENCE_S)


class Deaf:
    """A drive whose wire swallows the order to go off, and never answers."""

    def __init__(self, drive: Any) -> None:
        self.drive = drive
        self.released = threading.Event()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.drive, name)

    def disable(self) -> None:
        self.released.wait(PATIENCE_S)
        self.drive.disable()


def test_a_drive_that_never_answers_to_go_off_is_left_to_its_watchdog(
    open_bench: OpenBench,
) -> None:
    deaf: dict[str, Deaf] = {}

    def wrap(drivers: DriverSet) -> DriverSet:
        deaf.update({side: Deaf(drive) for side, drive in drivers.drives.items()})
        return replace(drivers, drives=deaf, blocking=True)  # type: ignore[arg-type]

    with open_bench(real_time=True, wrap=wrap, safety__stall_s=60.0) as bench:
        bench.load_output(100.0)
        bench.supervisor.trip(AlarmKind.STOP, "test", "a stop", "", "")
        assert not bench.supervisor.wait_safe(PATIENCE_S)
        off = comes(lambda: not deaf["output"].drive.state().enabled)
        assert off, "its watchdog wasn't fed"
        # Its last answer is too old, or came just after the stop, and said that it was on.
        with pytest.raises(InterlockError, match=r"state of the drive unknown|drive still on"):
            bench.supervisor.acknowledge("A. Tester")
        for drive in deaf.values():
            drive.released.set()
        assert comes(lambda: bench.supervisor.safe)
        assert bench.supervisor.acknowledge("A. Tester") is not None


def test_a_listener_that_waits_for_a_disk_does_not_hold_up_a_stop(bench: LowBench) -> None:
    entered, released = threading.Event(), threading.Event()

    def writes(entry: RaisedAlarm) -> None:
        if entry.acknowledged is not None:
            entered.set()
            released.wait(PATIENCE_S)

    bench.supervisor.subscribe(writes)
    bench.supervisor.trip(AlarmKind.STOP, "test", "a stop", "", "")
    assert bench.supervisor.wait_safe(PATIENCE_S)
    slow = threading.Thread(target=bench.supervisor.acknowledge, args=("A. Tester",))
    slow.start()
    assert entered.wait(PATIENCE_S)
    stop = threading.Thread(
        target=bench.supervisor.trip, args=(AlarmKind.STOP, "test", "another", "", "")
    )
    stop.start()
    assert comes(lambda: bench.supervisor.alarm), "latched although the listener still writes"
    released.set()
    slow.join()
    stop.join()


def test_late_samples_are_shown_and_end_with_power_on_what_runs(bench: LowBench) -> None:
    def late() -> list[str]:
        return [str(each.alarm.found) for each in bench.supervisor.alarms]

    for late_s, shown in ((0.99 * LATE_S, 0), (1.01 * LATE_S, 1), (9.0, 1), (0.1, 0)):
        bench.supervisor.check_lateness(late_s, LATE_S)
        assert len(late()) == shown, late_s
    assert bench.supervisor.alarm is None, "without power it goes on by itself"
    bench.load_output(100.0)
    bench.supervisor.check_lateness(1.01 * LATE_S, LATE_S)
    assert bench.supervisor.alarm is not None
    assert bench.supervisor.alarm.kind is AlarmKind.STALL


def test_a_heartbeat_that_cannot_be_asked_for_is_missing(bench: LowBench) -> None:
    def closed() -> None:
        raise RuntimeError("Event loop is closed")

    bench.supervisor.heartbeats.expect("run engine", 0.3, closed)
    bench.load_output(100.0)
    with pytest.raises(BenchError, match="no heartbeat of the run engine"):
        bench.clock.wait(2.0)


def test_a_torque_that_is_no_number_is_a_lost_signal_whatever_the_windows_say(
    bench: LowBench,
) -> None:
    bench.load_output(500.0)
    bench.clock.wait(0.5)
    block = bench.acquisition.latest_block
    assert block is not None
    missing = block.records["output_torque"].with_columns(reading_nm=np.full(5, np.nan))
    judge = SignalJudge(bench.description, bench.supervisor.limits, bench.commands)
    records = {**block.records, "output_torque": missing}
    violation, _ = judge.judge(replace(block, records=records))
    assert violation is not None
    assert (violation.kind, violation.source) == (AlarmKind.SIGNAL_LOST, "output_torque")


def test_a_command_whose_answer_was_lost_is_taken_back(bench: LowBench) -> None:
    bench.load_output(0.0)
    bench.commands.output.ask("torque", 400.0, 1e5, bench.clock.now())
    bench.drivers.drives["output"].command_torque(400.0, 1e5)  # and no answer
    bench.clock.wait(0.2)
    bench.clock.wait(bench.supervisor.unload())
    assert bench.drivers.drives["output"].state().torque_nm == 0.0
