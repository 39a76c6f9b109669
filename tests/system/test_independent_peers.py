"""The drivers against devices that somebody wrote from docs/reference/device-protocols.md."""

import re
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.peers.cia402_node import Cia402Peer
from tests.peers.daqmx_server import CounterCardPeer
from tests.peers.modbus_drive import ModbusDrivePeer
from tests.peers.scpi_instruments import CounterPeer, ReadoutPeer
from tests.support.draws import nightly
from tests.system.networked import (
    CAN_BUS,
    WATCHDOG_S,
    canopen,
    daqmx,
    described,
    motor_case,
    scpi,
)

from torquebench.bench.drivers.base import CounterCard, Drive, Identified
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, LimitError
from torquebench.testing.drives import DriveContract, MotorCase

PEERS = Path(__file__).resolve().parents[1] / "peers"
LONGEST_S = 120.0


def test_they_know_nothing_of_torquebench() -> None:
    """Only the faults that writers of drivers get, too, are shared."""
    for file in PEERS.rglob("*.py"):
        imported = re.findall(
            r"^\s*(?:from|import) (torquebench\S*)", file.read_text(), re.MULTILINE
        )
        assert set(imported) <= {"torquebench.testing.cable", "torquebench.testing.faults"}, file


def wait_for(reached: Callable[[], bool], drive: Drive | None = None) -> None:
    """Wait, and feed a drive meanwhile."""
    deadline = time.monotonic() + LONGEST_S
    while not reached():
        assert time.monotonic() < deadline
        if drive is not None:
            drive.feed_watchdog()
        time.sleep(0.01)


# -- drives -----------------------------------------------------------------------------------


class TestDrives(DriveContract):
    @pytest.fixture(params=["modbus", "canopen", "canopen, cyclic", nightly("canopen, slow")])
    def case(self, request: pytest.FixtureRequest) -> Iterator[MotorCase]:
        if request.param == "modbus":
            with ModbusDrivePeer("OWN-1") as peer:
                section = {"protocol": "modbus", "address": peer.address}
                yield motor_case(described(input_drive=section), "input_drive", peer.motor)
            return
        with Cia402Peer(9, 1234567, 0.15 if "slow" in request.param else 0.0) as node:
            if "cyclic" in request.param:
                node.modes = 0x300
            section = canopen() | {"node": 9, "bus": CAN_BUS | {"port": node.port}}
            yield motor_case(described(output_drive=section), "output_drive", node.motor)

    def test_its_watchdog_has_the_described_time(self, case: MotorCase, drive: Any) -> None:
        assert drive.identity().model == "drive of its own"
        assert drive.identity().serial in ("OWN-1", "1234567")
        drive.enable()
        case.starve()
        assert not case.powered()
        wait_for(lambda: "watchdog" in drive.state().fault)


@pytest.mark.parametrize("ratio", [25.0, -4.0])
def test_a_drive_behind_a_gear_is_commanded_in_values_of_the_shaft(ratio: float) -> None:
    with ModbusDrivePeer("OWN-1") as peer:
        bench = described(input_drive={"protocol": "modbus", "address": peer.address})
        geared = bench.input.drive.model_copy(update={"gear_ratio": ratio})
        module = bench.input.model_copy(update={"drive": geared})
        drive = open_role(bench.model_copy(update={"input": module}), "input_drive")
        try:
            assert drive.limits().torque_nm == pytest.approx(60.0 * abs(ratio))
            assert drive.limits().speed_rad_s == pytest.approx(150.0 / abs(ratio))
            drive.enable()
            drive.command_torque(100.0, 2000.0)
            torque = peer.motor.torque
            wait_for(lambda: torque.present == torque.target, drive)
            assert torque.present == pytest.approx(100.0 / ratio)
            assert drive.state().torque_nm == pytest.approx(100.0, rel=1e-5)
            drive.command_speed(2.0, 40.0)
            speed = peer.motor.speed
            wait_for(lambda: speed.present == speed.target, drive)
            assert speed.present == pytest.approx(2.0 * ratio)
            assert drive.state().speed_rad_s == pytest.approx(2.0, rel=1e-5)
            with pytest.raises(LimitError, match=rf"±{60.0 * abs(ratio):g} N·m"):
                drive.command_torque(61.0 * ratio, 2000.0)
            drive.ramp_to_zero(0.1)
            wait_for(lambda: drive.state().speed_rad_s == 0.0, drive)
            motor = peer.motor
            motor.starve(WATCHDOG_S)
            wait_for(lambda: not drive.state().enabled)
            assert "watchdog" in drive.state().fault
        finally:
            drive.close()


def test_the_drives_state_the_angles_across_the_end_of_their_32_bits() -> None:
    with ModbusDrivePeer("OWN-1") as peer, Cia402Peer(9, 1234567) as node:
        section = canopen() | {"node": 9, "bus": CAN_BUS | {"port": node.port}}
        bench = described(
            input_drive={"protocol": "modbus", "address": peer.address},
            output_drive=section,
            angles={"protocol": "drives"},
        )
        geared = bench.output.drive.model_copy(update={"gear_ratio": -3.0})
        module = bench.output.model_copy(update={"drive": geared})
        angles = open_role(bench.model_copy(update={"output": module}), "angles")
        try:
            node.position = 2**31 - 5
            assert angles.counts() == {"input": 4711, "output": 5 - 2**31}
            node.position = -(2**31) + 5
            assert angles.counts()["output"] == 5 - 2**31 - 10
        finally:
            angles.close()
            angles.close()
        with pytest.raises(BenchError):
            angles.counts()


# -- counters and read-out --------------------------------------------------------------------


def read_blocks(counter: CounterCard, count: int) -> list[Any]:
    counter.select(frozenset({"input_torque", "output_torque"}))
    return [counter.read_block(0.05) for _ in range(count)]


def test_frequency_counters_deliver_every_window_once() -> None:
    with CounterPeer(60e3, "SER-1") as one, CounterPeer(90e3, "SER-2") as two:
        channels = {"input_torque": one.address, "output_torque": two.address}
        section = {"protocol": "scpi", "channels": channels}
        counter = open_role(described(counter=section), "counter")
        try:
            assert counter.identity().serial == "SER-1"
            blocks = read_blocks(counter, 4)
            for name, first_hz in (("input_torque", 60e3), ("output_torque", 90e3)):
                counted = np.concatenate([each.records[name]["frequency_hz"] for each in blocks])
                np.testing.assert_allclose(counted, first_hz + np.arange(20.0), rtol=1e-6)
            assert blocks[-1].stop_s == pytest.approx(0.2)
            counter.select(frozenset({"input_torque"}))
            assert two.begun is None, "a channel that nobody needs is stopped"
            counter.select(frozenset({"input_torque", "output_torque"}))
        finally:
            counter.close()
        commands = [line for line in one.lines if "?" not in line and line != "*CLS"]
        asked = [
            after for line, after in zip(one.lines, one.lines[1:], strict=False) if line in commands
        ]
        assert commands
        assert set(asked) == {"SYST:ERR?"}, "the question after every command"


def test_a_command_that_a_counter_does_not_know_is_an_error() -> None:
    with CounterPeer(60e3, "SER-1") as peer:
        channels = {"input_torque": peer.address, "output_torque": peer.address}
        section = {"protocol": "scpi", "channels": channels, "setup": ["ABOR", "OWN:INV 1"]}
        counter = open_role(described(counter=section), "counter")
        try:
            with pytest.raises(BenchError, match="OWN:INV 1"):
                counter.select(frozenset({"input_torque"}))
        finally:
            counter.close()


def test_a_counter_without_pulses_is_noticed_within_the_loss_time_by_its_transducer() -> None:
    """The gate of a 53230A never closes without pulses, unless a time-out is set."""
    with CounterPeer(60e3, "SER-1") as one, CounterPeer(90e3, "SER-2") as two:
        channels = {"input_torque": one.address, "output_torque": two.address}
        counter = open_role(
            described(counter={"protocol": "scpi", "channels": channels, "timeout_s": 30.0}),
            "counter",
        )
        try:
            counter.select(frozenset(channels))
            assert one.timeout_s == two.timeout_s == pytest.approx(0.01 + 0.03)
            two.pulses.clear()
            block = counter.read_block(0.05)
            assert np.isnan(block.records["output_torque"]["frequency_hz"]).all()
            assert np.isfinite(block.records["input_torque"]["frequency_hz"]).all()
        finally:
            two.pulses.set()
            counter.close()


def test_a_counter_that_hangs_is_named_by_its_transducer_within_its_timeout() -> None:
    with CounterPeer(60e3, "SER-1") as one, CounterPeer(90e3, "SER-2") as two:
        channels = {"input_torque": one.address, "output_torque": two.address}
        section = {"protocol": "scpi", "channels": channels, "timeout_s": 0.5}
        counter = open_role(described(counter=section), "counter")
        try:
            counter.select(frozenset({"input_torque", "output_torque"}))
            two.pulses.clear()
            two.timeout_s = None
            with pytest.raises(BenchError, match=r"counter of output_torque.*no answer in 0\.55 s"):
                counter.read_block(0.05)
        finally:
            two.pulses.set()
            counter.close()


def test_a_read_out_states_every_sample_once() -> None:
    now_s = 0.0
    with ReadoutPeer(lambda: now_s) as peer:
        readout = open_role(described(reference=scpi(address=peer.address)), "reference")
        try:
            assert isinstance(readout, Identified)
            assert readout.identity().model == "amplifier of its own"
            parts = {"input": [], "output": []}  # type: ignore[var-annotated]
            for block in range(1, 13):
                now_s = 0.05 * block
                for side in ("input", "output"):
                    parts[side].append(readout.read(side, now_s, now_s))
        finally:
            readout.close()
    for side, sign in (("input", 1.0), ("output", -1.0)):
        torque = np.concatenate([part["signal"] for part in parts[side]])
        time_s = np.concatenate([part.time_s for part in parts[side]])
        np.testing.assert_allclose(torque, sign * 12.5)
        np.testing.assert_allclose(time_s, 0.01 * np.arange(60) + 0.005, atol=1e-3)


def test_a_counter_card_delivers_every_edge_and_angle() -> None:
    with CounterCardPeer(0x0A1B2C3D, 61_234.5, 36_000.0) as peer:
        section = daqmx() | {"address": peer.address}
        counter = open_role(described(counter=section), "counter")
        try:
            assert counter.identity().serial == "0A1B2C3D"
            blocks = read_blocks(counter, 6)
        finally:
            counter.close()
        assert peer.tasks == {}, "every task is cleared"
    edges = np.concatenate([block.edges["output_torque"].ticks for block in blocks])
    assert edges.size == int(0.3 * 61_234.5)
    np.testing.assert_array_equal(
        edges, np.rint(np.arange(1, edges.size + 1) / 61_234.5 * 1e8).astype(np.int64)
    )
    counts = np.concatenate([block.records["input_angle"]["angle_counts"] for block in blocks])
    np.testing.assert_array_equal(counts, np.arange(300) * 36)


def test_a_counter_that_another_client_has_is_named() -> None:
    with CounterCardPeer(0x0A1B2C3D, 60_000.0, 0.0) as peer:
        section = daqmx() | {"address": peer.address}
        first = open_role(described(counter=section), "counter")
        second = open_role(described(counter=section), "counter")
        try:
            read_blocks(first, 1)
            with pytest.raises(BenchError, match=r"reserved|-50103"):
                read_blocks(second, 1)
        finally:
            first.close()
            second.close()
