"""CiA 402 drives on EtherCAT: the driver on a fake of its library's API, in front of a peer."""

import importlib
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from tests.peers import ethercat_device
from tests.peers.ethercat_device import OP, EthercatNetwork, EthercatPeer
from tests.system.networked import described, hasty, motor_case

from torquebench.bench.drivers.base import Positioned
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, InputError
from torquebench.testing.drivers import DriverCase, DriverContract, Peer
from torquebench.testing.drives import DriveContract, MotorCase

UNFED_S = 4.0
"""A watchdog's time that a busy computer keeps, half of it without a cycle."""


def forget_library() -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] == "pysoem"]:
        del sys.modules[name]


@pytest.fixture(autouse=True)
def library(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Put the fake in the library's place."""
    forget_library()
    monkeypatch.syspath_prepend(ethercat_device.LIBRARY)
    yield importlib.import_module("pysoem")
    forget_library()


@pytest.fixture
def real(library: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Take the library itself."""
    monkeypatch.setattr(sys, "path", [p for p in sys.path if p != ethercat_device.LIBRARY])
    forget_library()
    found = importlib.import_module("pysoem")
    assert found.__file__ != library.__file__
    return found


@pytest.fixture
def network() -> Iterator[EthercatNetwork]:
    with EthercatNetwork(EthercatPeer(11), EthercatPeer(12)) as running:
        yield running


def described_for(network: EthercatNetwork, watchdog_s: float = 10.0, **keys: Any) -> Any:
    section = {"protocol": "ethercat", "adapter": network.address, "timeout_s": watchdog_s / 2.1}
    drives = {
        f"{side}_drive": section | {"position": k, "cycle_s": 0.005} | keys
        for k, side in enumerate(("input", "output"))
    }
    bench = described(**drives)
    modules = {}
    for side in ("input", "output"):
        module = bench.module(side)
        drive = module.drive.model_copy(update={"watchdog_s": watchdog_s})
        modules[side] = module.model_copy(update={"drive": drive})
    return bench.model_copy(update=modules)


@pytest.fixture
def drives(network: EthercatNetwork) -> Iterator[list[Any]]:
    bench = described_for(network)
    found = [open_role(bench, f"{side}_drive") for side in ("input", "output")]
    yield found
    for drive in found:
        drive.close()


def fed(drives: list[Any], until: Callable[[], object]) -> None:
    """Feed drives until something is so."""
    deadline = time.monotonic() + 60.0
    while not until() and time.monotonic() < deadline:
        for drive in drives:
            drive.feed_watchdog()
        time.sleep(0.02)


def test_two_drives_share_a_network(network: EthercatNetwork, drives: list[Any]) -> None:
    assert [drive.identity().serial for drive in drives] == ["11", "12"]
    first, second = network.devices
    for drive in drives:
        drive.enable()
    drives[0].command_torque(100.0, 200.0)
    drives[1].command_speed(-1.0, 10.0)
    fed(drives, lambda: first.motor.torque.present >= 99.9)
    assert drives[0].state().torque_nm == pytest.approx(100.0, abs=0.5)
    steps = [b - a for a, b in zip(first.torques, first.torques[1:], strict=False)]
    assert max(steps) <= 1e3 * 200.0 * 0.03 / 400.0, "thousandths of 400 N·m, no longer than 30 ms"
    fed(drives, lambda: second.motor.speed.present <= -0.999)
    assert drives[1].state().speed_rad_s == pytest.approx(-1.0, abs=1e-3)
    second.position = -77
    fed(drives, lambda: drives[1].position_counts() == -77)
    assert drives[1].position_counts() == -77
    assert isinstance(drives[1], Positioned)
    drives[0].disable()
    fed(drives[1:], lambda: not drives[0].state().enabled)
    assert (drives[0].state().enabled, drives[1].state().enabled) == (False, True)
    assert "late by" in drives[0].identity().details["cycle"]


def test_both_drives_can_be_enabled_after_both_have_lost_their_power(
    network: EthercatNetwork,
) -> None:
    bench = described_for(network, UNFED_S)
    drives = [open_role(bench, f"{side}_drive") for side in ("input", "output")]
    try:
        for drive in drives:
            drive.enable()
        deadline = time.monotonic() + 60.0
        while not all(device.motor.tripped for device in network.devices):
            for device in network.devices:
                with device.motor.lock:
                    device.look()
            assert time.monotonic() < deadline
            time.sleep(0.02)
        for drive in drives:
            drive.enable()
            assert drive.state().enabled
    finally:
        for drive in drives:
            drive.close()


def test_a_drive_that_never_operates_leaves_no_cycles_behind(
    network: EthercatNetwork, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = network.devices[0]
    request = device.request_state
    monkeypatch.setattr(device, "request_state", lambda wanted: wanted != OP and request(wanted))
    with pytest.raises(BenchError, match="doesn't reach OP"):
        open_role(described_for(network), "input_drive")
    before = device.cycles
    time.sleep(0.1)
    assert device.cycles == before
    assert not [each for each in threading.enumerate() if each.name == "ethercat"]


def test_without_power_the_cycles_need_no_feeding(network: EthercatNetwork) -> None:
    drive = open_role(described_for(network, UNFED_S), "input_drive")
    try:
        time.sleep(0.7 * UNFED_S)
        before = network.devices[0].cycles
        time.sleep(0.3)
        assert network.devices[0].cycles > before
        assert not drive.state().fault
    finally:
        drive.close()


def test_positions_and_adapters_are_checked(network: EthercatNetwork) -> None:
    with pytest.raises(InputError, match="both drives at position 1"):
        open_role(described_for(network, position=1), "input_drive")
    alone = described(
        input_drive={"protocol": "ethercat", "adapter": network.address, "position": 5}
    )
    with pytest.raises(BenchError, match=r"2 devices on .*, none at position 5"):
        open_role(alone, "input_drive")


def test_the_fake_has_the_names_of_the_library(library: Any, real: Any) -> None:
    names = [name for name, value in vars(library).items() if hasattr(value, "__module__")]
    own = [name for name in names if getattr(library, name).__module__ == "pysoem"]
    assert {"Master", "SdoError", "WkcError", "al_status_code_to_string"} <= {*own}
    assert not [name for name in own if name[0] != "_" and not hasattr(real, name)]
    for fake, theirs in ((library.Master, real.Master), (library._Slave, real.CdefSlave)):
        public = {name for name in vars(fake) if not name.startswith("_")} - {"ask"}
        assert not [name for name in public if not hasattr(theirs, name)]
    for name in ("SAFEOP_STATE", "OP_STATE", "INIT_STATE", "STATE_ACK", "STATE_ERROR"):
        assert getattr(library, name) == getattr(real, name)


def test_the_library_itself_refuses_an_adapter_that_is_not_there(real: Any) -> None:
    section = {"protocol": "ethercat", "adapter": "no-such-adapter", "position": 0}
    with pytest.raises(BenchError, match="could not open interface"):
        open_role(described(input_drive=section), "input_drive")


@dataclass(frozen=True)
class _Side:
    description: Any
    misbehaviour: EthercatNetwork


class TestContract(DriverContract):
    """The drive keeps the contract of drivers."""

    @pytest.fixture
    def case(self) -> DriverCase:
        return DriverCase(
            "ethercat-drive", "input_drive", lambda i: i.state(), lambda s: not s.enabled
        )

    @pytest.fixture
    def peer(self, network: EthercatNetwork) -> Peer:
        bench = described_for(network)
        drive = bench.input.drive.model_copy(update={"serial": "11"})
        module = bench.input.model_copy(update={"drive": drive})
        return _Side(bench.model_copy(update={"input": module}), network)

    def hasty(self, description: Any) -> Any:
        return hasty(description)


class TestDrive(DriveContract):
    """Half of the watchdog's time is that of the process data."""

    @pytest.fixture
    def case(self, network: EthercatNetwork) -> Iterator[MotorCase]:
        device = network.devices[0]
        unfed = described_for(network, UNFED_S)
        bench, motor = described_for(network), device.motor
        yield motor_case(bench, "input_drive", motor, device.look, unfed=unfed, starve=lambda: None)
        if device.motor.tripped:
            assert device.process_watchdog_s == pytest.approx(0.5 * UNFED_S)
