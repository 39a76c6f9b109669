"""The safe state over real sockets, with the drive's own log as the witness."""

import threading
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import Any

import bluesky.plan_stubs as bps
import pytest
from bluesky.utils import Msg
from tests.system.command_line import started
from tests.system.networked import described, simulating
from tests.system.test_station_runs import set_up

from torquebench.bench.audit.entries import AUDIT_FOLDER, read_audit
from torquebench.bench.drivers.simulated.control import SimulationControl
from torquebench.bench.safety import AlarmKind
from torquebench.errors import BenchError, InterlockError, TorquebenchError
from torquebench.simulators import Simulators
from torquebench.station import Station

PATIENCE_S = 120.0


def becomes(condition: Callable[[], object]) -> bool:
    """Wait patiently for something."""
    deadline = time.monotonic() + PATIENCE_S
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return bool(condition())


def loading(station: Station, torque_nm: float, then: Callable[[], None]) -> Generator[Msg]:
    """Load the output, do something, and go on."""
    yield from set_up(station.devices)
    yield from bps.mv(station.devices.output.drive.torque, torque_nm)
    yield from bps.sleep(0.5)
    then()
    yield from bps.sleep(5.0)
    yield from bps.mv(station.devices.output.drive.power, False)


def test_calibrate_ends_with_what_is_still_on_and_how_much(tmp_path: Path) -> None:
    with simulating(tmp_path) as (bench, control):
        command = ("calibrate", "output", "--bench", bench, "--data", "data", "--yes")
        with started(*command, cwd=tmp_path) as process:

            def output() -> dict[str, Any]:
                drive: dict[str, Any] = control.ask("status")["drives"]["output"]
                return drive

            assert becomes(lambda: output()["enabled"] and abs(output()["torque_nm"]) > 400.0)
            for kind in ("ignore", "unguarded"):
                control.ask("misbehave", endpoint="output_drive", kind=kind)
            _, said = process.communicate(timeout=PATIENCE_S)
            held_nm = output()["torque_nm"]
            assert process.returncode == 1
            assert output()["enabled"], "nothing took its power off"
    words = " ".join(said.split())
    assert "not in the safe state" in words
    assert "output side: drive still on" in words
    assert "press the emergency stop" in words
    stated_nm = float(words.partition("drive still on, ")[2].partition(" ")[0])
    assert stated_nm == pytest.approx(held_nm, rel=0.1), "how much is on"


def test_a_drive_that_only_acknowledges_is_not_safe_until_it_is_read_back(tmp_path: Path) -> None:
    with Simulators(described()) as simulators:
        drive = simulators.plant.bench.drives["output"]
        orders = simulators.misbehaviour

        def disobey() -> None:
            orders.start("output_drive", "ignore")
            orders.start("output_drive", "unguarded")
            station.emergency_stop("somebody pressed stop")

        with Station.open(simulators.description, tmp_path) as station:
            with pytest.raises(TorquebenchError, match="output side: drive still on, 5"):
                station.run(loading(station, 550.0, disobey), kind="loaded")
            supervisor = station.supervisor
            assert not supervisor.safe
            assert drive.state().enabled
            alarm = supervisor.alarm
            assert alarm is not None
            assert alarm.kind is AlarmKind.NOT_SAFE
            assert supervisor.alarms[0].alarm == alarm, "the most urgent of all"
            assert [each.kind for each in supervisor.history][:1] == [AlarmKind.STOP]
            with pytest.raises(InterlockError, match="drive still on") as refused:
                station.acknowledge_alarm("A. Tester")
            assert "press the emergency stop" in refused.value.remedy
            assert not drive.log[-1].event.startswith("to zero"), "it ignored everything"
            orders.heal()  # somebody has pressed the emergency stop
            assert becomes(lambda: supervisor.safe)
            assert not drive.state().enabled
            assert becomes(lambda: not supervisor.still_on())
            assert station.acknowledge_alarm("A. Tester") is not None


def test_a_bench_is_not_closed_in_silence_with_a_drive_that_stays_on(tmp_path: Path) -> None:
    with Simulators(described()) as simulators:
        station = Station.open(simulators.description, tmp_path)
        station.run(loading_only(station, 300.0), kind="loaded")
        simulators.misbehaviour.start("output_drive", "ignore")
        with pytest.raises(BenchError, match="output side: drive still on") as left:
            station.close()
        assert "press the emergency stop" in left.value.remedy


def loading_only(station: Station, torque_nm: float) -> Generator[Msg]:
    """Load and unload the output; its drive stays on for the next run."""
    yield from set_up(station.devices)
    yield from bps.mv(station.devices.output.drive.torque, torque_nm)
    yield from bps.mv(station.devices.output.drive.torque, 0.0)
    yield from bps.sleep(0.5)


def drive_log(control: SimulationControl, side: str) -> list[dict[str, Any]]:
    events: list[dict[str, Any]] = control.ask("drive_log", side=side)["events"]
    return events


def test_the_ramp_of_an_alarm_in_real_time_ends_before_the_power(tmp_path: Path) -> None:
    with (
        simulating(tmp_path, "--real-time") as (bench, control),
        Station.open(bench, tmp_path / "data") as station,
    ):
        ramp_s = station.description.safety.ramp_to_zero_s

        def stop() -> None:
            threading.Timer(0.01, station.emergency_stop, ("somebody pressed stop",)).start()

        with pytest.raises(BenchError, match="somebody pressed stop"):
            station.run(loading(station, 800.0, stop), kind="loaded")
        assert station.supervisor.wait_safe(PATIENCE_S)
        log = drive_log(control, "output")
        assert becomes(lambda: not station.supervisor.still_on())
        assert station.acknowledge_alarm("A. Tester") is not None
    ramp = next(event for event in log if event["event"] == "torque to 0" and event["torque_nm"])
    off = next(
        event for event in log if event["event"] == "off" and event["time_s"] > ramp["time_s"]
    )
    assert ramp["torque_nm"] == pytest.approx(800.0, abs=2.0)
    assert abs(off["torque_nm"]) < 20.0, "it was cut from the torque that the ramp had reached"
    assert off["time_s"] - ramp["time_s"] >= 0.9 * ramp_s


@pytest.mark.nightly
def test_a_calibration_in_real_time_over_sockets_is_not_disturbed(tmp_path: Path) -> None:
    """What `simulate --real-time` and `calibrate` are documented to do, with few steps."""
    with simulating(tmp_path, "--real-time") as (bench, _):
        command = ("calibrate", "output", "--bench", bench, "--data", "data", "--yes")
        few = ("--step", "50", "--model", "polynomial")
        with started(*command, *few, cwd=tmp_path) as process:
            told, said = process.communicate(timeout=2.0 * PATIENCE_S)
            assert process.returncode == 0, said
    assert "In use model-1" in " ".join((told + said).split())
    alarms = [line for line in read_audit(tmp_path / "data" / AUDIT_FOLDER) if "alarm" in line]
    assert alarms == []
