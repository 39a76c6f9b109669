"""A moteus controller as drive, against a peer of its reference on TCP and a serial line."""

import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from tests.peers.moteus_controller import FAULT, MoteusPeer
from tests.system.networked import described

from torquebench.bench.drivers.angles import DriveAngles
from torquebench.bench.drivers.base import Positioned
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, LimitError

NODE = 3


@pytest.fixture(params=[False, True], ids=["TCP", "serial"])
def peer(request: pytest.FixtureRequest) -> Iterator[MoteusPeer]:
    with MoteusPeer(NODE, request.param) as running:
        yield running


def described_for(peer: MoteusPeer, watchdog_s: float = 10.0) -> Any:
    keys = {"maximum_torque_nm": 20.0, "maximum_speed_rpm": 600.0, "timeout_s": watchdog_s / 2.1}
    section = {"protocol": "moteus", "address": peer.address, "node": NODE}
    bench = described(input_drive=section | keys)
    drive = bench.input.drive.model_copy(update={"watchdog_s": watchdog_s})
    return bench.model_copy(update={"input": bench.input.model_copy(update={"drive": drive})})


@pytest.fixture
def drive(peer: MoteusPeer) -> Iterator[Any]:
    found = open_role(described_for(peer), "input_drive")
    yield found
    found.close()


def fed(drive: Any, until: Callable[[], object]) -> None:
    """Feed a drive until something is so."""
    deadline = time.monotonic() + 60.0
    while not until() and time.monotonic() < deadline:
        drive.feed_watchdog()
        time.sleep(0.02)


def test_it_is_stepped_to_torque_speed_and_zero(peer: MoteusPeer, drive: Any) -> None:
    identity = drive.identity()
    assert (identity.serial, identity.model) == ("11223344556677880A0B0C0D", "moteus")
    drive.enable()
    drive.command_torque(10.0, 20.0)
    fed(drive, lambda: peer.torque_nm >= 10.0)
    assert drive.state().torque_nm == pytest.approx(10.0)
    assert max(np.diff(peer.torques)) <= 20.0 * 0.02 + 1e-6, "no step longer than 20 ms"
    drive.ramp_to_zero(0.1)
    fed(drive, lambda: not drive.state().torque_nm)
    assert drive.state().torque_nm == 0.0
    drive.command_speed(-math.pi, 20.0)
    fed(drive, lambda: drive.state().speed_rad_s == pytest.approx(-math.pi))
    assert drive.state().speed_rad_s == pytest.approx(-math.pi)
    assert drive.position_counts() == 25_000
    assert isinstance(drive, Positioned)
    assert DriveAngles({"input": drive}).counts() == {"input": 25_000}
    drive.disable()
    assert not drive.state().enabled


def test_it_refuses_beyond_its_limits_and_while_it_is_off(drive: Any) -> None:
    with pytest.raises(BenchError, match="is off"):
        drive.command_torque(1.0, 10.0)
    drive.enable()
    with pytest.raises(LimitError, match="own limit"):
        drive.command_torque(21.0, 10.0)


def test_an_unfed_ramp_ends_with_the_controllers_own_time(peer: MoteusPeer) -> None:
    drive = open_role(described_for(peer, 0.6), "input_drive")
    try:
        drive.enable()
        drive.command_torque(20.0, 2.0)
        time.sleep(1.2)
        assert "watchdog not fed" in drive.state().fault
        assert not drive.state().enabled
        assert max(peer.torques) < 2.0 * 0.8, "the steps don't feed the watchdog"
        drive.enable()
        assert drive.state().enabled
    finally:
        drive.close()


def test_a_fault_has_its_code(peer: MoteusPeer, drive: Any) -> None:
    drive.enable()
    peer.mode, peer.fault_code = FAULT, 38
    state = drive.state()
    assert (state.enabled, state.fault) == (False, "fault code 38")


def test_feeding_never_switches_it_on_again(peer: MoteusPeer, drive: Any) -> None:
    ended = threading.Event()

    def feed() -> None:
        while not ended.is_set():
            drive.feed_watchdog()

    feeding = threading.Thread(target=feed)
    feeding.start()
    try:
        for _ in range(20):
            drive.enable()
            drive.disable()
            time.sleep(0.02)
            assert not drive.state().enabled
    finally:
        ended.set()
        feeding.join()
