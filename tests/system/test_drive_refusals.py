"""A drive's refusals, states and malformed answers reach the user in its own words."""

import re
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bluesky.plan_stubs as bps
import numpy as np
import pytest
from tests.peers.cia402_node import Cia402Peer
from tests.system.networked import CAN_BUS, DRIVES, canopen, described, hasty
from tests.system.test_station_runs import set_up

from torquebench.bench.drivers.base import Drive, DriveLimits, DriveState
from torquebench.bench.drivers.instruments import open_role
from torquebench.bench.drivers.simulated.driver import SimulatedDrive
from torquebench.bench.safety import AlarmKind
from torquebench.bench.safety.drives import DriveWorker
from torquebench.calibration import load_profile
from torquebench.errors import BenchError, LimitError
from torquebench.operations.bench_checks import _watchdog, instruments
from torquebench.procedures import calibrate, rehearse
from torquebench.simulators import Simulators
from torquebench.station import Station

NODE = 9


@contextmanager
def opened(peer: Cia402Peer, **keys: Any) -> Iterator[Drive]:
    drive = open_role(describing(peer, **keys), "output_drive")
    try:
        yield drive
    finally:
        drive.close()


def describing(peer: Cia402Peer, **keys: Any) -> Any:
    section = canopen() | {"node": NODE, "bus": CAN_BUS | {"port": peer.port}} | keys
    return described(output_drive=section)


@pytest.fixture
def peer() -> Iterator[Cia402Peer]:
    with Cia402Peer(NODE, 402005) as node:
        yield node


def test_objects_that_cia_301_leaves_optional_may_be_missing(peer: Cia402Peer) -> None:
    peer.missing |= {(0x1008, 0), (0x1018, 2), (0x1018, 3), (0x1018, 4), (0x603F, 0)}
    with opened(peer) as drive:
        identity = drive.identity()
        assert identity.serial == ""
        assert identity.manufacturer == "vendor 0xAFFE"
        drive.enable()
        assert drive.state().enabled


def test_a_refused_object_is_named(peer: Cia402Peer) -> None:
    peer.missing.add((0x6087, 0))
    with opened(peer) as drive:
        drive.enable()
        with pytest.raises(
            BenchError, match=r"to write 2500 to 0x6087 \(Torque slope\).*not exist"
        ):
            drive.command_torque(10.0, 1000.0)
    peer.missing.add((0x6076, 0))
    with pytest.raises(BenchError, match=r"to read 0x6076 \(Motor rated torque\)"), opened(peer):
        pass


def test_a_refusal_in_the_present_state_is_retried(peer: Cia402Peer) -> None:
    with opened(peer) as drive:
        peer.not_yet = 5
        drive.enable()
        assert drive.state().enabled
        peer.not_yet = 2
        drive.command_torque(10.0, 1e4)
        assert peer.motor.torque.target == pytest.approx(10.0)
    with opened(peer, switching_s=0.2) as drive:
        peer.not_yet = 10**6
        with pytest.raises(BenchError, match="present device state"):
            drive.enable()


def test_the_last_emergency_is_the_reason(peer: Cia402Peer) -> None:
    peer.missing.add((0x603F, 0))
    with opened(peer) as drive:
        drive.enable()
        peer.emergency(0x2310)
        peer.motor.power_lost()
        deadline = time.monotonic() + 60.0
        while "EMCY" not in (fault := drive.state().fault) and time.monotonic() < deadline:
            time.sleep(0.01)
    assert fault == "fault: EMCY 0x2310, Current"


def test_local_control_and_an_acting_limit_are_told(peer: Cia402Peer, tmp_path: Path) -> None:
    with opened(peer) as drive:
        assert drive.state().remote
        assert not drive.state().limited
        peer.bits |= 0x800
        assert drive.state().limited
        peer.bits &= ~0x200
        assert not drive.state().remote
    found = {each.what: each for each in instruments(describing(peer), tmp_path)}
    assert found["output drive"].state == "problem"
    assert "local control" in found["output drive"].found
    peer.slowness_s = 60.0
    with (
        opened(peer, switching_s=0.2) as drive,
        pytest.raises(BenchError, match="local control, its remote bit is 0"),
    ):
        drive.enable()


@pytest.mark.parametrize(
    "spoil",
    [
        lambda answer: answer[:1],
        lambda answer: answer[:3],
        lambda answer: answer[:5],
        lambda _answer: b"\x80",
        lambda answer: b"\x41" + answer[1:4] + b"\x01",
        lambda answer: bytes([0x4F]) + answer[1:],  # one byte for every number
        lambda _answer: b"\xff" * 8,
        lambda answer: answer[:1] + struct.pack("<H", 0x1234) + answer[3:],
    ],
)  # fmt: skip
def test_a_malformed_answer_is_an_error(peer: Cia402Peer, spoil: Any) -> None:
    with opened(peer, timeout_s=0.3) as drive:
        peer.spoil = spoil
        with pytest.raises(BenchError):
            drive.state()
        peer.spoil = None
        assert not drive.state().enabled


def test_a_drives_own_limit_is_found_before_anything_moves(
    peer: Cia402Peer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    peer.largest_permille = 4000  # of 400 N·m
    found = {each.what: each for each in instruments(describing(peer), tmp_path)}
    assert found["output drive"].state == "problem"
    assert "its own limit is 1600 N·m, the range 2000 N·m" in found["output drive"].found
    monkeypatch.setattr(SimulatedDrive, "limits", lambda _: DriveLimits(1600.0, 100.0))
    with (
        Station.open(data_dir=tmp_path) as station,
        pytest.raises(LimitError, match=r"±1600 N·m, the drive's own limit"),
    ):
        rehearse(station.devices, calibrate(station.devices, "output", load_profile("staircase")))


def test_a_refused_command_is_withdrawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command = SimulatedDrive.command_torque

    def refusing(drive: SimulatedDrive, torque_nm: float, rate: float) -> None:
        if abs(torque_nm) > 300.0:
            raise LimitError("550 N·m requested", "±300 N·m, the drive's own limit")
        command(drive, torque_nm, rate)

    monkeypatch.setattr(SimulatedDrive, "command_torque", refusing)

    def loading(station: Station) -> Any:
        yield from set_up(station.devices)
        yield from bps.mv(station.devices.output.drive.torque, 200.0)
        yield from bps.sleep(0.5)
        yield from bps.mv(station.devices.output.drive.torque, 550.0)

    with Station.open(data_dir=tmp_path) as station:
        with pytest.raises(LimitError, match="the drive's own limit"):
            station.run(loading(station), kind="loaded")
        station.clock.wait(2.0)
        assert station.supervisor.history == (), "no alarm about a command that wasn't given"


def test_a_drive_that_goes_to_local_control_ends_the_run(tmp_path: Path) -> None:
    def loading(station: Station) -> Any:
        yield from set_up(station.devices)
        yield from bps.mv(station.devices.output.drive.torque, 100.0)
        simulators.misbehaviour.start("output_drive", "local")
        yield from bps.sleep(5.0)  # it keeps what it does, so nothing else shows it

    with (
        Simulators(described()) as simulators,
        Station.open(hasty(simulators.description, *DRIVES, drive_s=1.0), tmp_path) as station,
    ):
        with pytest.raises(Exception, match="went to local control"):
            station.run(loading(station), kind="loaded")
        assert station.supervisor.alarm is not None
        assert station.supervisor.alarm.kind is AlarmKind.DRIVE_FAULT
        assert station.supervisor.wait_safe(20.0), "its watchdog has taken its power off"


def test_a_drive_that_never_states_remote_control_but_obeys_is_used() -> None:
    class Obeying:
        remote = False

        def state(self) -> DriveState:
            return DriveState(True, 1.0, None, "", remote=self.remote)

    drive: Any = Obeying()
    worker = DriveWorker("output", drive, threaded=False)
    worker.ask(feed=False)
    assert worker.found_wrong(0.0, 1.0, 1.0) == ""
    drive.remote = True
    worker.ask(feed=False)
    assert worker.found_wrong(0.0, 1.0, 1.0) == ""
    drive.remote = False
    worker.ask(feed=False)
    assert "local control" in worker.found_wrong(0.0, 1.0, 1.0)


def test_the_watchdog_is_timed_by_the_wall_although_a_counter_has_buffered(
    peer: Cia402Peer,
) -> None:
    class Buffered:
        """A card that hands out at once what it has counted meanwhile."""

        def read_block(self, _duration_s: float) -> None:
            time.sleep(0.001)

    description = describing(peer)
    drive_settings = description.output.drive.model_copy(update={"watchdog_s": 2.0})
    output = description.output.model_copy(update={"drive": drive_settings})
    description = description.model_copy(update={"output": output})
    driver = {k: v for k, v in description.driver.items() if k != "simulation"}
    driver["output_drive"] = driver["output_drive"] | {"timeout_s": 0.9}
    description = description.model_copy(update={"driver": driver})
    peer.slowness_s = 0.2
    drive = open_role(description, "output_drive")
    try:
        set_of: Any = SimpleNamespace(
            counter=Buffered(), drives={"output": drive}, simulated_time=False
        )
        begun = time.monotonic()
        found = _watchdog(set_of, description, "output")
        most_s = time.monotonic() - begun
    finally:
        drive.close()
    stopped = re.search(r"it stopped by itself after (\S+) s", found.found)
    assert stopped, found.found
    assert 1.0 < float(stopped[1]) < most_s + 0.01, "not the 50 ms of each block that it counted"


def test_modbus_refusals_name_the_registers() -> None:
    with Simulators(described()) as simulators:
        drive = open_role(simulators.description, "input_drive")
        try:
            with pytest.raises(
                BenchError, match=r"to read input registers 5000 to 5001: exception 2 \(illegal"
            ):
                drive._link.input_registers(5000, 2)
        finally:
            drive.close()


# -- cyclic modes -----------------------------------------------------------------------------

CYCLIC = 1 << 8 | 1 << 9


def fed(drive: Drive, until: Callable[[], object]) -> None:
    """Feed a drive until something is so."""
    deadline = time.monotonic() + 60.0
    while not until() and time.monotonic() < deadline:
        drive.feed_watchdog()
        time.sleep(0.02)


def test_a_drive_with_cyclic_modes_alone_is_stepped_to_torque_speed_and_zero(
    peer: Cia402Peer,
) -> None:
    peer.modes = CYCLIC
    with opened(peer) as drive:
        drive.enable()
        drive.command_torque(100.0, 400.0)
        fed(drive, lambda: peer.motor.torque.present >= 100.0)
        assert drive.state().torque_nm == pytest.approx(100.0)
        assert max(np.diff(peer.torques)) <= 400.0 * 0.02 / 0.4 + 2, "no step longer than 20 ms"
        drive.ramp_to_zero(0.2)
        fed(drive, lambda: not drive.state().torque_nm)
        assert drive.state().torque_nm == 0.0
        drive.command_speed(-1.5, 5.0)
        fed(drive, lambda: drive.state().speed_rad_s == pytest.approx(-1.5, abs=1e-3))
        assert drive.state().speed_rad_s == pytest.approx(-1.5, abs=1e-3)
        drive.disable()
        assert not peer.motor.on


def test_an_unfed_ramp_of_a_cyclic_drive_stands_until_its_watchdog_acts(peer: Cia402Peer) -> None:
    peer.modes = CYCLIC
    section = canopen() | {"node": NODE, "bus": CAN_BUS | {"port": peer.port}}
    bench = described(output_drive=section | {"timeout_s": 0.9})
    module = bench.output.model_copy(
        update={"drive": bench.output.drive.model_copy(update={"watchdog_s": 2.0})}
    )
    drive = open_role(bench.model_copy(update={"output": module}), "output_drive")
    try:
        drive.enable()
        drive.feed_watchdog()
        drive.command_torque(2000.0, 100.0)
        deadline = time.monotonic() + 60.0
        while not drive.state().fault and time.monotonic() < deadline:
            time.sleep(0.02)
        assert "watchdog not fed" in drive.state().fault
        assert max(peer.torques) < 1e3 * 100.0 * 2.3 / 400.0
        steps = len(peer.torques)
        time.sleep(0.1)
        assert len(peer.torques) == steps
    finally:
        drive.close()


def test_a_drive_with_neither_torque_mode_is_refused_on_opening(peer: Cia402Peer) -> None:
    peer.modes = 1 << 2
    with pytest.raises(BenchError, match="neither mode 4 nor 10"), opened(peer):
        pass
