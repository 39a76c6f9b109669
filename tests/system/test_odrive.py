"""An ODrive controller as drive, against a peer of its manual on a CAN bus."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from tests.peers.odrive_node import ESTOP, OdrivePeer
from tests.system.command_line import wait_until
from tests.system.networked import CAN_BUS, described

from torquebench.bench.drivers.base import Positioned
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, LimitError

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


def test_it_is_stepped_to_torque_speed_and_zero(peer: OdrivePeer, drive: Any) -> None:
    identity = drive.identity()
    assert (identity.serial, identity.firmware) == ("3868365F3132", "0.6.10")
    drive.enable()
    assert (peer.control_mode, peer.input_mode) == (1, 1)
    drive.command_torque(10.0, 20.0)
    fed(drive, lambda: peer.torque_nm >= 10.0)
    assert drive.state().torque_nm == pytest.approx(10.0)
    assert max(np.diff(peer.torques)) <= 20.0 * 0.02 + 1e-6, "no step longer than 20 ms"
    drive.ramp_to_zero(0.1)
    fed(drive, lambda: not drive.state().torque_nm)
    assert drive.state().torque_nm == 0.0
    drive.command_speed(-math.pi, 20.0)
    fed(drive, lambda: peer.velocity == pytest.approx(-0.5))
    assert peer.control_mode == 2
    assert drive.state().speed_rad_s == pytest.approx(-math.pi)
    assert drive.position_counts() == 25_000
    assert isinstance(drive, Positioned)
    drive.disable()
    fed(drive, lambda: not drive.state().enabled)
    assert not drive.state().enabled


def test_it_refuses_beyond_its_limits_and_while_it_is_off(drive: Any) -> None:
    with pytest.raises(BenchError, match="is off"):
        drive.command_torque(1.0, 10.0)
    drive.enable()
    with pytest.raises(LimitError, match="own limit"):
        drive.command_torque(21.0, 10.0)


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
        assert not drive.state().enabled
        assert max(peer.torques) < 2.0 * 2.0 * 1.5, "the steps end, so that the watchdog acts"
        drive.enable()
        assert drive.state().enabled
        assert not drive.state().fault
    finally:
        drive.close()


def test_feeding_never_sends_a_torque_as_a_velocity(peer: OdrivePeer, drive: Any) -> None:
    ended = threading.Event()

    def feed() -> None:
        while not ended.is_set():
            drive.feed_watchdog()

    drive.enable()
    feeding = threading.Thread(target=feed)
    feeding.start()
    try:
        for _ in range(30):
            drive.command_torque(10.0, 1e6)
            wait_until(lambda: peer.torque_nm == 10.0, "the torque")
            drive.command_speed(0.1, 1e6)
            wait_until(lambda: peer.velocity > 0.0, "the velocity")
    finally:
        ended.set()
        feeding.join()
    assert max(peer.velocities) == pytest.approx(0.1 / math.tau)


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
