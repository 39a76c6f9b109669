"""Instruments of PLCs by ADS and S7 against the servers of pyads and python-snap7."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from tests.peers.plc import AdsPlc, S7Plc
from tests.system.networked import described, motor_case

from torquebench.bench.drivers.base import Positioned
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, InputError
from torquebench.testing.drives import DriveContract, MotorCase, fed

Plc = AdsPlc | S7Plc
TORQUE = {"input": 12.5, "output": -250.0}


@pytest.fixture(params=[AdsPlc, S7Plc], ids=["ADS", "S7"])
def plc(request: pytest.FixtureRequest) -> Iterator[Plc]:
    values = {"fInput": lambda: TORQUE["input"], "fOutput": lambda: TORQUE["output"]}
    with request.param(values) as running:
        yield running


def opened(plc: Plc, key: str, **keys: Any) -> Any:
    return open_role(described(**{key: plc.section(timeout_s=2.0, **keys)}), key)


class TestDrive(DriveContract):
    @pytest.fixture
    def case(self, plc: Plc) -> MotorCase:
        section = plc.section(timeout_s=2.0, structure=plc.structure("Input"))
        motor = plc.program.motors["Input"]
        return motor_case(described(input_drive=section), "input_drive", motor)

    def test_it_states_its_position(self, drive: Any) -> None:
        assert isinstance(drive, Positioned)
        drive.enable()
        before = drive.position_counts()
        drive.command_speed(-1.5, 5.0)
        fed(drive, lambda: drive.position_counts() < before)


def test_a_program_that_stands_is_an_error_of_the_drive_and_no_value_of_the_torque(
    plc: Plc,
) -> None:
    channels = {f"{side}_torque": plc.variable(f"f{side.capitalize()}") for side in TORQUE}
    keys = {"life": plc.variable("Cycles")} if isinstance(plc, S7Plc) else {}
    drive = opened(plc, "input_drive", structure=plc.structure("Input"))
    counter = opened(plc, "counter", channels=channels, **keys)
    try:
        values = values_of(counter)
        assert values == {TORQUE["input"]}
        plc.program.running = False
        values_of(counter)  # until the counter of cycles has stood for long enough
        assert values_of(counter) == set()
        drive.feed_watchdog()
        time.sleep(2.3)
        with pytest.raises(BenchError, match="doesn't follow"):
            drive.state()
    finally:
        counter.close()
        drive.close()


def values_of(counter: Any) -> set[float]:
    read: set[float] = set()
    for _ in range(8):
        stated = counter.read_block(0.05).records["input_torque"]["signal"]
        read |= set(stated[~np.isnan(stated)].tolist())
    return read


def test_modes_and_clamp_go_where_they_are_sent(plc: Plc) -> None:
    modes = opened(plc, "modes", structure=plc.structure("Fixture"))
    clamp = opened(plc, "clamp", structure=plc.structure("Fixture"))
    try:
        modes.set_mode("output", "locked")
        assert (modes.mode("input"), modes.mode("output")) == ("free", "locked")
        clamp.set_clamped(True)
        assert clamp.clamped()
        assert modes.mode("output") == "locked"
        clamp.set_clamped(False)
        assert not clamp.clamped()
    finally:
        modes.close()
        clamp.close()


def test_a_variable_that_the_plc_does_not_have_is_named() -> None:
    channels = dict.fromkeys(("input_torque", "output_torque"), "GVL.fNone")
    with AdsPlc({}) as plc, pytest.raises(BenchError, match=r"has no variable .*GVL\.fNone"):
        opened(plc, "counter", channels=channels)


def test_a_block_that_is_none_is_refused() -> None:
    with S7Plc({}) as plc, pytest.raises(InputError, match=r"structure = 'GVL'.*DB10"):
        opened(plc, "input_drive", structure="GVL")


def test_a_cable_that_is_pulled_is_an_error_with_the_address_and_mends(plc: Plc) -> None:
    drive = opened(plc, "input_drive", structure=plc.structure("Input"))
    try:
        plc.start("input_drive", "disconnect", duration_s=60.0)
        with pytest.raises(BenchError, match=plc.address):
            drive.state()
        plc.heal()
        assert not drive.state().enabled
    finally:
        drive.close()
