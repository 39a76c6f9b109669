"""An ODrive controller as drive, against a peer of its manual on a CAN bus."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from tests.peers.odrive_node import ESTOP, OdrivePeer
from tests.system.networked import CAN_BUS, described, seen_by

from torquebench.bench.drivers.base import Positioned
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError
from torquebench.testing.drives import DriveContract, MotorCase

NODE = 5


@pytest.fixture
def peer() -> Iterator[OdrivePeer]:
    with OdrivePeer(NODE) as running:
        yield running


def described_for(peer: OdrivePeer, watchdog_s: float = 10.0) -> Any:
    keys = {"maximum_torque_nm": 20.0, "maximum_speed_rpm": 600.0, "timeout_s": watchdog_s / 2.1}
    bus = CAN_BUS | {"port": peer.port}
    bench = described(input_drive={"protocol": "odrive", "bus": bus, "node": NODE} | keys)
    drive = bench.input.drive.model_copy(update={"watchdog_s": watchdog_s})
    return bench.model_copy(update={"input": bench.input.model_copy(update={"drive": drive})})


@pytest.fixture
def drive(peer: OdrivePeer) -> Iterator[Any]:
    found = open_role(described_for(peer), "input_drive")
    yield found
    found.close()


def fed(drive: Any, until: Callable[[], object]) -> None:
    """Feed a drive until something is so."""
    deadline = time.monotonic() + 60.0
    while not until() and time.monotonic() < deadline:
        drive.feed_watchdog()
        time.sleep(0.02)


def test_it_is_stepped_and_states_its_position(peer: OdrivePeer, drive: Any) -> None:
    identity = drive.identity()
    assert (identity.serial, identity.firmware) == ("3868365F3132", "0.6.10")
    drive.enable()
    assert (peer.control_mode, peer.input_mode) == (1, 1)
    drive.command_torque(10.0, 20.0)
    fed(drive, lambda: peer.torque_nm >= 10.0)
    assert drive.state().torque_nm == pytest.approx(10.0)
    assert max(np.diff(peer.torques)) <= 20.0 * 0.02 + 1e-6, "no step longer than 20 ms"
    assert drive.position_counts() == 25_000
    assert isinstance(drive, Positioned)


def test_an_unfed_ramp_ends_within_the_described_time(peer: OdrivePeer) -> None:
    peer.watchdog_s = 2.0
    drive = open_role(described_for(peer, 4.0), "input_drive")
    try:
        drive.enable()
        drive.command_torque(20.0, 2.0)
        deadline = time.monotonic() + 60.0
        while not drive.state().fault and time.monotonic() < deadline:
            time.sleep(0.05)
        assert "watchdog not fed for 4 s" in drive.state().fault
        assert max(peer.torques) < 2.0 * 2.0 * 1.5, "the steps end, so that the watchdog acts"
    finally:
        drive.close()


class TestDrive(DriveContract):
    @pytest.fixture
    def case(self, peer: OdrivePeer) -> Iterator[MotorCase]:
        peer.watchdog_s = 5.0
        seen = seen_by(peer.lock, peer.look)
        yield MotorCase(
            described_for(peer),
            "input_drive",
            powered=seen(lambda: peer.powered),
            torque_nm=seen(lambda: peer.torque_nm * peer.powered),
            speed_rad_s=seen(lambda: math.tau * peer.velocity * peer.powered),
        )
        assert max(peer.velocities, default=0.0) < 1.0, "a torque was sent as a velocity"


def test_an_error_has_its_code(peer: OdrivePeer, drive: Any) -> None:
    drive.enable()
    with peer.lock:
        peer.fail(ESTOP)
    fed(drive, lambda: not drive.state().enabled)
    assert drive.state().fault == "error 0x02000000"


def test_a_heartbeat_that_stays_away_is_no_state(peer: OdrivePeer) -> None:
    drive = open_role(described_for(peer, 4.0), "input_drive")
    try:
        assert not drive.state().enabled
        peer.cut = True
        time.sleep(2.2)
        with pytest.raises(BenchError, match="no answer"):
            drive.state()
    finally:
        drive.close()


def test_older_firmware_is_refused() -> None:
    with (
        OdrivePeer(NODE, firmware=b"\0\5\6") as peer,
        pytest.raises(BenchError, match=r"firmware 0\.5\.6"),
    ):
        open_role(described_for(peer), "input_drive")
