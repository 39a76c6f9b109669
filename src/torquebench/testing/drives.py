"""What every drive does, seen at its motor: ramps, limits, watchdog, nothing after a stop."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import pytest

from torquebench.bench.description import BenchDescription
from torquebench.bench.drivers.base import Drive
from torquebench.bench.drivers.instruments import open_role
from torquebench.errors import BenchError, LimitError

__all__ = ["DriveContract", "MotorCase"]

PATIENCE_S = 60.0
TORQUE_NM, SPEED_RAD_S = 10.0, 1.0
QUICK = 1e4
"""Rate with which a set point is reached at once, N·m/s or rad/s²."""
STEP_S = 0.05
"""Longest time for which a set point may be ahead of its ramp."""
STARTS = 10
"""Number of starts and stops while another thread feeds."""


@dataclass(frozen=True)
class MotorCase:
    """One drive, with what its device knows of the motor.

    Parameters
    ----------
    description : BenchDescription
        A bench with the drive, whose watchdog's time a busy computer keeps.
    key : {"input_drive", "output_drive"}
    powered : callable
        Whether the motor has power.
    torque_nm, speed_rad_s : callable
        Active set point at the shaft, N·m or rad/s; 0 without power.
    starve : callable
        Lets the watchdog's time pass without feeding; by default it passes by itself.
    unfed : BenchDescription, optional
        The bench with a short watchdog's time, for the test that waits for it.
    """

    description: BenchDescription
    key: str
    powered: Callable[[], bool]
    torque_nm: Callable[[], float]
    speed_rad_s: Callable[[], float]
    starve: Callable[[], None] = lambda: None
    unfed: BenchDescription | None = None


def fed(drive: Drive, until: Callable[[], object]) -> None:
    """Feed a drive until something is so."""
    deadline = time.monotonic() + PATIENCE_S
    while not until():
        assert time.monotonic() < deadline
        drive.feed_watchdog()
        time.sleep(0.01)


def follows(
    drive: Drive,
    command: Callable[[float, float], None],
    present: Callable[[], float],
    target: float,
) -> None:
    """Command a set point in half a second from 0; check that it ramps there no faster."""
    rate = 2.0 * abs(target)
    begun_s = time.monotonic()
    command(target, rate)

    def reached() -> bool:
        value = present()
        assert abs(value) <= 1.01 * rate * (time.monotonic() - begun_s + STEP_S)
        return value == pytest.approx(target, rel=1e-3)

    fed(drive, reached)


class DriveContract:
    """Tests of a drive; a subclass has the fixture `case`.

    Examples
    --------
    ::

        class TestDrive(DriveContract):
            @pytest.fixture
            def case(self):
                with OwnController() as peer:
                    bench = described(input_drive={"protocol": "own", "address": peer.address})
                    yield MotorCase(
                        bench,
                        "input_drive",
                        powered=lambda: peer.on,
                        torque_nm=lambda: peer.torque_nm,
                        speed_rad_s=lambda: peer.speed_rad_s,
                    )
    """

    @pytest.fixture
    def drive(self, case: MotorCase) -> Iterator[Any]:
        """Open the drive."""
        opened = open_role(case.description, case.key)
        yield opened
        opened.close()

    def test_it_ramps_to_torque_and_speed_and_to_zero(self, case: MotorCase, drive: Any) -> None:
        assert not drive.state().enabled
        drive.enable()
        assert case.powered()
        assert drive.state().torque_nm == 0.0
        follows(drive, drive.command_torque, case.torque_nm, TORQUE_NM)
        fed(drive, lambda: drive.state().torque_nm == pytest.approx(TORQUE_NM, rel=0.01))
        drive.ramp_to_zero(0.1)
        fed(drive, lambda: drive.state().torque_nm == 0.0)
        assert case.torque_nm() == 0.0
        follows(drive, drive.command_speed, case.speed_rad_s, -SPEED_RAD_S)
        fed(drive, lambda: drive.state().speed_rad_s == pytest.approx(-SPEED_RAD_S, rel=0.01))
        drive.ramp_to_zero(0.1)
        fed(drive, lambda: drive.state().speed_rad_s == 0.0)
        drive.disable()
        fed(drive, lambda: not drive.state().enabled)
        assert not case.powered()
        assert drive.state().fault == ""

    def test_it_gets_nothing_beyond_its_own_limits(self, case: MotorCase, drive: Any) -> None:
        limits = drive.limits()
        drive.enable()
        for value in (1.01 * limits.torque_nm, math.nan, -math.inf):
            with pytest.raises(LimitError):
                drive.command_torque(value, QUICK)
        for value in (-1.01 * limits.speed_rad_s, math.nan, math.inf):
            with pytest.raises(LimitError):
                drive.command_speed(value, QUICK)
        assert case.torque_nm() == case.speed_rad_s() == 0.0

    def test_it_is_refused_while_it_is_off(self, case: MotorCase, drive: Any) -> None:
        with pytest.raises(BenchError):
            drive.command_torque(TORQUE_NM, QUICK)
        with pytest.raises(BenchError):
            drive.command_speed(SPEED_RAD_S, QUICK)
        drive.feed_watchdog()
        assert not case.powered()

    def test_without_feeding_it_loses_its_power(self, case: MotorCase) -> None:
        drive = open_role(case.unfed or case.description, case.key)
        try:
            drive.enable()
            drive.command_torque(TORQUE_NM, 0.1)
            case.starve()
            deadline = time.monotonic() + PATIENCE_S
            while case.powered() or not drive.state().fault:
                assert time.monotonic() < deadline
                time.sleep(0.02)
            assert not drive.state().enabled
            for _ in range(2):
                drive.enable()
                assert case.powered()
                assert (drive.state().enabled, drive.state().fault) == (True, "")
                assert case.torque_nm() == 0.0
        finally:
            drive.close()

    def test_feeding_meanwhile_sends_nothing_else(self, case: MotorCase, drive: Any) -> None:
        ended = threading.Event()

        def feed() -> None:
            while not ended.is_set():
                drive.feed_watchdog()

        feeding = threading.Thread(target=feed)
        feeding.start()
        try:
            for _ in range(STARTS):
                drive.enable()
                drive.command_torque(TORQUE_NM, QUICK)
                fed(drive, lambda: case.torque_nm() == pytest.approx(TORQUE_NM, rel=1e-3))
                drive.command_speed(0.01 * SPEED_RAD_S, QUICK)
                fed(drive, lambda: case.speed_rad_s() > 0.0)
                assert case.speed_rad_s() <= 0.0101 * SPEED_RAD_S
                drive.disable()
                fed(drive, lambda: not case.powered())
                time.sleep(0.02)
                assert not case.powered()
        finally:
            ended.set()
            feeding.join()
