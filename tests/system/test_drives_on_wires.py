"""Drives on real wires that are slow, late, in fault, busy or have lost an answer."""

import math
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from tests.peers.cia402_node import Cia402Peer
from tests.system.command_line import run, started
from tests.system.networked import (
    CAN_BUS,
    DRIVES,
    WATCHDOG_S,
    canopen,
    described,
    hasty,
    simulating,
)
from tests.system.test_station_runs import staircase
from tests.watching import Watching

from torquebench.bench.drivers.base import DriveState
from torquebench.bench.drivers.instruments import open_role
from torquebench.bench.drivers.links import drive_timeout
from torquebench.bench.drivers.scpi.link import ScpiLink
from torquebench.errors import BenchError, InputError
from torquebench.operations.bench_checks import instruments
from torquebench.simulators import Simulators
from torquebench.station import Station

PATIENCE_S = 120.0


@pytest.fixture(params=["input_drive", "output_drive"])
def wired(request: pytest.FixtureRequest) -> Iterator[tuple[Simulators, str, Any]]:
    """One drive on Modbus, one on CANopen, alone."""
    with Simulators(described()) as simulators:
        simulators.plant.time = "real"
        drive = open_role(simulators.description, request.param)
        try:
            yield simulators, request.param, drive
        finally:
            drive.close()


def passed(simulators: Simulators, duration_s: float, drive: Any) -> None:
    until_s = simulators.plant.now_s + duration_s
    deadline = time.monotonic() + PATIENCE_S
    while simulators.plant.now_s < until_s and time.monotonic() < deadline:
        drive.feed_watchdog()
        time.sleep(0.005)


def test_another_mode_begins_with_its_own_target_and_not_with_the_one_before(
    wired: tuple[Simulators, str, Any],
) -> None:
    simulators, key, drive = wired
    side = key.removesuffix("_drive")
    motor = simulators.plant.bench.drives[side]  # type: ignore[index]
    drive.enable()
    drive.command_torque(40.0, 1e5)
    passed(simulators, 0.05, drive)
    drive.command_speed(0.5, 100.0)
    passed(simulators, 0.05, drive)
    log = len(motor.log)
    simulators.misbehaviour.start(key, "delay", amount=0.005)  # a slow wire
    drive.command_torque(10.0, 100.0)
    passed(simulators, 0.1, drive)
    told = [event.event for event in list(motor.log)[log:] if event.event.startswith("torque to")]
    assert told
    assert "torque to 40" not in told
    assert all(float(each.removeprefix("torque to ")) <= 10.5 for each in told)
    simulators.misbehaviour.heal()
    drive.disable()


def test_a_drive_that_is_slow_to_get_ready_is_waited_for(
    wired: tuple[Simulators, str, Any],
) -> None:
    simulators, key, drive = wired
    simulators.misbehaviour.start(key, "slow", amount=0.6)
    drive.enable()
    assert drive.state().enabled
    drive.disable()


def test_a_fault_is_reset_by_each_enable(wired: tuple[Simulators, str, Any]) -> None:
    simulators, key, drive = wired
    motor = simulators.plant.bench.drives[key.removesuffix("_drive")]  # type: ignore[index]
    simulators.plant.time = "on-demand"
    for _ in range(2):
        drive.enable()
        assert drive.state().enabled
        simulators.plant.require(simulators.plant.now_s + 1.1 * WATCHDOG_S, PATIENCE_S)
        assert not motor.state().enabled, "nobody has fed it"
        assert "watchdog" in drive.state().fault
    drive.enable()
    assert drive.state().enabled


def test_the_reset_bit_of_a_foreign_drive_rises_although_it_was_high() -> None:
    with Cia402Peer(9, 1234567) as node:
        section = canopen() | {"node": 9, "bus": CAN_BUS | {"port": node.port}}
        drive = open_role(described(output_drive=section), "output_drive")
        try:
            drive.enable()
            node.motor.fault = True
            node.motor.power(False)
            drive._link.write(0x6040, 0x80)  # somebody has left the bit high
            node.motor.fault = True
            drive.enable()
            assert drive.state().enabled
        finally:
            drive.close()


def test_one_lost_answer_is_no_alarm(tmp_path: Path) -> None:
    with (
        Simulators(described()) as simulators,
        Station.open(hasty(simulators.description, *DRIVES, drive_s=1.0), tmp_path) as station,
    ):
        lost: list[str] = []

        def lose() -> None:
            for key in DRIVES:
                simulators.misbehaviour.start(key, "drop", replies=1)
                lost.append(key)

        plan = staircase(station.devices, [0.0, 200.0, 400.0])
        record = station.run(plan, kind="load", progress=Watching(lambda *_: lose()))
        assert record.exit_status == "success"
        assert lost
        assert station.supervisor.history == ()


def test_the_second_try_comes_before_the_watchdog() -> None:
    assert 2.0 * drive_timeout(None, 0.5, "driver.output_drive") <= 0.25
    assert drive_timeout(None, 20.0, "driver.output_drive") == 0.3
    with pytest.raises(InputError, match=r"driver.output_drive.timeout_s = 0.5 s"):
        drive_timeout(0.5, 0.5, "driver.output_drive")
    section = {"protocol": "modbus", "address": "127.0.0.1:9", "timeout_s": 5.0}
    with pytest.raises(InputError, match="half of the drive's watchdog_s"):
        open_role(described(input_drive=section), "input_drive")


def test_a_busy_modbus_server_is_asked_again(wired: tuple[Simulators, str, Any]) -> None:
    simulators, key, drive = wired
    if key == "output_drive":
        return  # CANopen knows no such answer
    simulators.misbehaviour.start(key, "busy", replies=3)
    assert not drive.state().enabled
    impatient = open_role(hasty(simulators.description), key)
    simulators.misbehaviour.start(key, "busy")
    try:
        with pytest.raises(BenchError, match=r"is busy \(exception 6\)"):
            impatient.state()
    finally:
        impatient.close()


def test_errors_that_were_there_before_are_not_the_commands(tmp_path: Path) -> None:
    del tmp_path
    with Simulators(described()) as simulators:
        address = simulators.description.driver["counter"]["channels"]["input_torque"]
        host, _, port = address.rpartition(":")
        with socket.create_connection((host, int(port))) as somebody:
            somebody.sendall(b"NONSENSE\nMORE:NONSENSE\n*OPC?\n")
            somebody.recv(100)
            link = ScpiLink("counter", address, timeout_s=PATIENCE_S)
            try:
                link.command("CONF:FREQ")
                somebody.sendall(b"NONSENSE\n*OPC?\n")  # from the front panel, meanwhile
                somebody.recv(100)
                link.command("CONF:FREQ")
                with pytest.raises(BenchError, match="answers 'NONSENSE' with"):
                    link.command("NONSENSE")
            finally:
                link.close()


@pytest.mark.nightly
def test_an_instrument_that_falls_silent_prints_no_traceback(tmp_path: Path) -> None:
    with simulating(tmp_path, patient=False) as (bench, control):
        command = ("calibrate", "output", "--bench", bench, "--data", "data", "--yes")
        with started(*command, cwd=tmp_path) as process:
            deadline = time.monotonic() + PATIENCE_S
            while time.monotonic() < deadline:
                if control.ask("status")["drives"]["output"]["enabled"]:
                    break
                time.sleep(0.01)
            for endpoint in ("counter", "reference", "output_drive"):
                control.ask("misbehave", endpoint=endpoint, kind="drop", duration_s=60.0)
            told, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 1
    assert "error" in said
    assert "Traceback" not in told + said
    assert 'File "' not in told + said


def test_doctor_is_not_ready_where_a_drives_status_cannot_be_read(tmp_path: Path) -> None:
    with Simulators(described()) as simulators:
        found = {each.what: each for each in instruments(simulators.description, tmp_path)}
        assert found["output drive"].state == "ok"
        assert found["output drive"].found.endswith("; off")
        drive = simulators.plant.bench.drives["input"]
        drive.state = lambda: DriveState(False, math.nan, 0.0)  # type: ignore[method-assign]
        found = {each.what: each for each in instruments(simulators.description, tmp_path)}
        assert found["input drive"].state == "problem"
        assert "reports nan N·m" in found["input drive"].found
    with simulating(tmp_path, patient=False) as (bench, control):
        control.ask("misbehave", endpoint="output_drive", kind="drop")
        checked = run("doctor", "--bench", bench, cwd=tmp_path)
        assert checked.returncode == 1
        assert "Ready." not in checked.stdout
