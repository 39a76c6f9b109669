"""The no-load friction sweep of a mounted reducer."""

import numpy as np
import pytest
from tests.watching import Watching

from torquebench.errors import InputError
from torquebench.procedures import FrictionSettings, Plan, friction_sweep, rehearse
from torquebench.procedures.reducers.setup import turn_at
from torquebench.procedures.setup import Setup, power_on, set_up
from torquebench.station import Station


def test_windows_hold_whole_revolutions() -> None:
    settings = FrictionSettings()
    for speed in settings.speeds_rpm:
        window = settings.steady(-speed)
        turns = window.window_s * speed / 60.0
        assert turns == pytest.approx(round(turns), abs=1e-6)
        assert window.window_s >= settings.window_s - 1e-9


def test_the_points_go_up_and_down_in_both_directions_and_repeat() -> None:
    settings = FrictionSettings(speeds_rpm=(100.0, 200.0, 300.0), repeats=2)
    points = list(settings.points())
    assert len(points) == 2 * 2 * 5
    speeds = [point.speed_rpm for point in points[:10]]
    assert speeds == [100, 200, 300, 200, 100, -100, -200, -300, -200, -100]
    assert {point.repeat for point in points} == {1, 2}


@pytest.mark.parametrize(
    "wrong",
    [
        {"speeds_rpm": ()},
        {"speeds_rpm": (0.0, 100.0)},
        {"speeds_rpm": (200.0, 100.0)},
        {"repeats": 0},
        {"rate_rpm_per_s": 0.0},
        {"clockwise": False, "counter_clockwise": False},
    ],
)
def test_settings_that_make_no_sweep_are_refused(wrong: dict) -> None:
    with pytest.raises(InputError):
        FrictionSettings(**wrong)


def test_a_sweep_follows_the_true_friction(station: Station) -> None:
    settings = FrictionSettings(speeds_rpm=(100.0, 600.0, 1200.0), repeats=1)
    record = station.run(friction_sweep(station.devices, settings), kind="no-load-friction")
    sweep = record.result
    assert np.array_equal(np.sign(sweep.torque_nm), np.sign(sweep.nominal_rpm))
    assert sweep.speed_rpm == pytest.approx(sweep.nominal_rpm, rel=0.02)
    assert not sweep.compensated
    error = np.abs(sweep.torque_nm - sweep.true_torque_nm)
    assert error.max() < 0.5e-2 * 50.0
    fast, slow = np.abs(sweep.nominal_rpm) == 1200.0, np.abs(sweep.nominal_rpm) == 100.0
    assert np.abs(sweep.torque_nm[fast]).mean() > np.abs(sweep.torque_nm[slow]).mean()
    assert not station.drivers.drives["input"].state().enabled


def test_a_pause_stops_the_shaft_and_the_sweep_goes_on(station: Station) -> None:
    settings = FrictionSettings(speeds_rpm=(300.0, 600.0), repeats=1)
    speeds, asked = [], []

    def pause_once(done: int, _detail: str) -> None:
        if done == 2 and not asked:
            asked.append(done)
            station.pause()

    def look(paused: Station) -> str:
        speeds.append(paused.drivers.drives["input"].state().speed_rad_s)
        return "resume"

    record = station.run(
        friction_sweep(station.devices, settings),
        kind="no-load-friction",
        progress=Watching(pause_once),
        on_pause=look,
    )
    assert record.exit_status == "success"
    assert speeds == pytest.approx([0.0], abs=1e-9)
    assert record.result.speed_rpm == pytest.approx(record.result.nominal_rpm, rel=0.02)


@pytest.mark.parametrize("speed_rpm", [600.0, -600.0])
def test_a_speed_is_approached_at_the_rate_of_the_settings(
    station: Station, speed_rpm: float
) -> None:
    rate, present = 150.0, []

    def plan() -> Plan[None]:
        yield from set_up(station.devices, Setup("reducer_test", "input", "reducer", "free"))
        yield from power_on(station.devices, "input")
        for target in (speed_rpm, 0.0):
            began = station.clock.now()
            yield from turn_at(station.devices, "input", target, rate)
            present.append((target, station.clock.now() - began, drive.state().speed_rad_s))

    drive = station.drivers.drives["input"]
    station.run(plan(), kind="turning")
    for target, seconds, reached in present:
        assert seconds == pytest.approx(abs(speed_rpm) / rate, abs=0.2)
        assert reached * 30.0 / np.pi == pytest.approx(target, abs=1.0)


def test_no_drive_is_asked_for_more_than_it_can(station: Station) -> None:
    fastest = station.description.module("input").drive.speed_rate_rpm_per_s
    slow, as_it_can, faster = (
        rehearse(
            station.devices,
            friction_sweep(
                station.devices,
                FrictionSettings(speeds_rpm=(600.0,), repeats=1, rate_rpm_per_s=rate),
            ),
        ).duration_s
        for rate in (100.0, fastest, 1e9)
    )
    assert faster == pytest.approx(as_it_can)
    ways = 1800.0  # to 600 and to -600 1/min; taking the speed off at the end is the drive's own
    assert slow - as_it_can == pytest.approx(ways / 100.0 - ways / fastest)
