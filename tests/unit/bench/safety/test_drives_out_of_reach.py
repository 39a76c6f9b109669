"""Drives that can't be told any more: time goes on, and safe is only what was read back."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from tests.support.draws import nightly
from tests.unit.bench.test_bench_devices import play, ready

from torquebench.bench.drivers.base import DriverSet
from torquebench.bench.safety import AlarmKind
from torquebench.errors import BenchError, InterlockError

OpenBench = Callable[..., Any]
PATIENCE_S = 120.0


def comes(condition: Callable[[], object]) -> bool:
    """Wait patiently for something."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)
    return bool(condition())


class Wire:
    """A drive behind a wire that can be cut, or answers late."""

    def __init__(self, drive: Any) -> None:
        self._drive = drive
        self.cut = False
        self.late_s = 0.0
        self.enables_badly = False
        self.obeys = True

    def __getattr__(self, name: str) -> Any:
        return lambda *arguments: self._ask(name, *arguments)

    def enable(self) -> None:
        self._ask("enable")
        if self.enables_badly:
            raise BenchError("the drive says that it stays off", "an enabled drive")

    def command_torque(self, torque_nm: float, ramp_nm_per_s: float) -> None:
        if not self.obeys:
            raise BenchError("the drive says that it is off", "an enabled drive")
        self._ask("command_torque", torque_nm, ramp_nm_per_s)

    def close(self) -> None:
        """Nothing: the bench closes its drives itself."""

    def _ask(self, name: str, *arguments: Any) -> Any:
        if self.cut:
            time.sleep(self.late_s)
            raise BenchError("the drive doesn't answer", "an answer", "check its wire")
        return getattr(self._drive, name)(*arguments)


def wired(wires: dict[str, Wire], *, blocking: bool) -> Callable[[DriverSet], DriverSet]:
    def wrap(drivers: DriverSet) -> DriverSet:
        wires.update({side: Wire(drive) for side, drive in drivers.drives.items()})
        return replace(drivers, drives=wires, blocking=blocking)  # type: ignore[arg-type]

    return wrap


@pytest.mark.parametrize(("blocking", "late_s"), [(False, 0.0), nightly(True, 0.0), (True, 0.5)])
def test_a_drive_out_of_reach_is_left_to_its_watchdog_and_the_bench_is_safe_when_it_is_read(
    open_bench: OpenBench, blocking: bool, late_s: float
) -> None:
    wires: dict[str, Wire] = {}
    with open_bench(wrap=wired(wires, blocking=blocking)) as bench:
        bench.load_output(300.0)
        bench.clock.wait(0.5)
        wires["output"].late_s = late_s
        wires["output"].cut = True
        cut_s = bench.clock.now()
        with pytest.raises(BenchError, match="output drive"):
            bench.clock.wait(2.0)
        assert bench.supervisor.history[0].name == "drive fault: output"
        assert not bench.supervisor.wait_safe(PATIENCE_S)
        assert not bench.simulated.drives["output"].state().enabled
        alarm = bench.supervisor.alarm
        assert alarm.name == "not in the safe state: output"
        assert "output side: state of the drive unknown" in alarm.found
        assert "emergency stop" in alarm.remedy
        assert bench.clock.now() - cut_s < 4.0
        with pytest.raises(InterlockError, match="state of the drive unknown"):
            bench.supervisor.acknowledge("A. Tester")
        wires["output"].cut = False
        assert comes(lambda: bench.supervisor.safe)
        assert bench.supervisor.acknowledge("A. Tester") is alarm


@pytest.mark.parametrize("blocking", [False, True])
def test_time_in_which_nobody_asked_is_not_the_drives_silence(
    open_bench: OpenBench, blocking: bool
) -> None:
    wires: dict[str, Wire] = {}
    with open_bench(wrap=wired(wires, blocking=blocking), output__drive__watchdog_s=0.1) as bench:
        bench.load_output(300.0)
        bench.clock.wait(0.5)
        worker = bench.supervisor._workers["output"]
        looked, waited = worker.ask, worker.wait_asked

        def held_up(**options: Any) -> None:
            looked(**options)
            waited()
            time.sleep(0.3)  # this computer does something else before it looks at the answer

        worker.ask = held_up
        bench.clock.wait(0.2)
        assert bench.supervisor.alarm is None


@pytest.mark.parametrize("blocking", [False, True])
def test_a_drive_that_can_not_be_told_to_go_off_is_an_alarm(
    open_bench: OpenBench, blocking: bool
) -> None:
    wires: dict[str, Wire] = {}
    with open_bench(wrap=wired(wires, blocking=blocking)) as bench:
        bench.load_output(0.0)
        bench.clock.wait(0.2)
        wires["output"].cut = True
        bench.supervisor.disable()  # an orderly end of a run
        deadline = time.monotonic() + PATIENCE_S
        while bench.supervisor.alarm is None and time.monotonic() < deadline:
            time.sleep(0.005)
        assert bench.supervisor.alarm.kind is AlarmKind.DRIVE_FAULT
        assert "can't be switched off" in bench.supervisor.history[0].found
        assert not bench.supervisor.wait_safe(PATIENCE_S)
        assert bench.supervisor.alarm.kind is AlarmKind.NOT_SAFE
        assert not bench.simulated.drives["output"].state().enabled


@pytest.mark.parametrize("cut", [False, True])
def test_a_drive_that_fails_while_it_is_enabled_is_not_left_with_power(
    open_bench: OpenBench, cut: bool
) -> None:
    wires: dict[str, Wire] = {}
    with open_bench(wrap=wired(wires, blocking=True)) as bench:

        async def scene() -> None:
            async with ready(bench) as devices:
                power = devices.output.drive.power
                await power.set(False)
                wires["output"].enables_badly = True
                inner = wires["output"]._drive.enable

                def enable() -> None:
                    inner()
                    wires["output"].cut = cut

                wires["output"]._drive.enable = enable
                with pytest.raises(BenchError):
                    await power.set(True)

        play(bench, scene)
        alarm = bench.supervisor.history[0]
        assert alarm.name == "drive fault: output"
        assert "commanded to switch on" in alarm.found
        assert bench.supervisor.wait_safe(PATIENCE_S) is not cut
        assert not bench.commands.output.enabled
        assert not bench.simulated.drives["output"].state().enabled


@pytest.mark.parametrize("blocking", [False, True])
def test_a_drive_that_fails_at_a_command_is_an_alarm(open_bench: OpenBench, blocking: bool) -> None:
    wires: dict[str, Wire] = {}
    with open_bench(wrap=wired(wires, blocking=blocking)) as bench:

        async def scene() -> None:
            async with ready(bench) as devices:
                wires["output"].obeys = False
                with pytest.raises(BenchError, match="the drive says that it is off"):
                    await devices.output.drive.torque.set(100.0)

        play(bench, scene)
        alarm = bench.supervisor.alarm
        assert alarm.name == "drive fault: output"
        assert "commanded to go to 100 N·m" in alarm.found
        assert bench.supervisor.wait_safe(60.0)
        assert not bench.simulated.drives["output"].state().enabled
