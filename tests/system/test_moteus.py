"""A moteus controller as drive, against a peer of its reference on TCP and a serial line."""

import math
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from tests.peers.moteus_controller import FAULT, MoteusPeer
from tests.system.networked import described, seen_by

from torquebench.bench.drivers.angles import DriveAngles
from torquebench.bench.drivers.base import Positioned
from torquebench.bench.drivers.instruments import open_role
from torquebench.testing.drives import DriveContract, MotorCase

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


def test_it_is_stepped_and_states_its_position(peer: MoteusPeer, drive: Any) -> None:
    identity = drive.identity()
    assert (identity.serial, identity.model) == ("11223344556677880A0B0C0D", "moteus")
    drive.enable()
    drive.command_torque(10.0, 20.0)
    fed(drive, lambda: peer.torque_nm >= 10.0)
    assert drive.state().torque_nm == pytest.approx(10.0)
    assert max(np.diff(peer.torques)) <= 20.0 * 0.02 + 1e-6, "no step longer than 20 ms"
    assert drive.position_counts() == 25_000
    assert isinstance(drive, Positioned)
    assert DriveAngles({"input": drive}).counts() == {"input": 25_000}


def test_the_steps_of_an_unfed_ramp_do_not_feed_its_watchdog(peer: MoteusPeer) -> None:
    drive = open_role(described_for(peer, 0.6), "input_drive")
    try:
        drive.enable()
        drive.command_torque(20.0, 2.0)
        time.sleep(1.2)
        assert "watchdog not fed" in drive.state().fault
        assert max(peer.torques) < 2.0 * 0.8
    finally:
        drive.close()


def test_a_fault_has_its_code(peer: MoteusPeer, drive: Any) -> None:
    drive.enable()
    peer.mode, peer.fault_code = FAULT, 38
    state = drive.state()
    assert (state.enabled, state.fault) == (False, "fault code 38")


class TestDrive(DriveContract):
    @pytest.fixture
    def case(self, peer: MoteusPeer) -> MotorCase:
        seen = seen_by(peer._lock, peer.look)
        return MotorCase(
            described_for(peer),
            "input_drive",
            powered=seen(lambda: peer.powered),
            torque_nm=seen(lambda: peer.torque_nm),
            speed_rad_s=seen(lambda: math.tau * peer.velocity),
            unfed=described_for(peer, 2.0),
        )
