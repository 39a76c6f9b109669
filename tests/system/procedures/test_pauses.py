"""A pause within a leg of a reducer test: the whole leg is driven again, from where it begins."""

from collections.abc import Callable

import numpy as np
import pytest
from tests.watching import Watching

from torquebench.procedures.reducers.loop import HysteresisSettings, hysteresis_loops
from torquebench.procedures.reducers.setup import ReducerLimits
from torquebench.procedures.reducers.turning import TransmissionSettings, transmission_error
from torquebench.station import RunRecord, Station

STANDARD = ReducerLimits(
    ratio=80.0, rated_torque_nm=400.0, largest_torque_nm=1000.0, largest_input_rpm=2000.0
)


def paused_once(station: Station, plan: object, within: Callable[[int, str], bool]) -> RunRecord:
    pauses: list[str] = []

    def pause(done: int, detail: str) -> None:
        if within(done, detail) and not pauses:
            pauses.append(detail)
            station.pause()

    def resume(held: Station) -> str:
        assert [drive.state().torque_nm for drive in held.drivers.drives.values()] == [0.0, 0.0]
        return "resume"

    record = station.run(plan, kind="paused", progress=Watching(pause), on_pause=resume)
    assert (record.exit_status, record.interruptions, len(pauses)) == ("success", 1, 1)
    return record


def test_an_interrupted_loop_is_preloaded_and_driven_again(station: Station) -> None:
    settings = HysteresisSettings(loops=2, positions_deg=(0.0,), loop_s=4.0)
    plan = hysteresis_loops(station.devices, STANDARD, settings)
    record = paused_once(station, plan, lambda _, detail: detail.endswith("loop 2"))
    first, second = record.result.loops
    assert [first.number, second.number] == [1, 2]
    for loop in (first, second):
        torque_nm = loop.recording.output_torque_nm
        assert torque_nm[0] == pytest.approx(-400.0, abs=20.0)
        assert np.ptp(torque_nm) == pytest.approx(800.0, abs=40.0)
    assert len(second.recording.time_s) == pytest.approx(len(first.recording.time_s), rel=0.02)


def test_an_interrupted_revolution_is_turned_again(station: Station) -> None:
    settings = TransmissionSettings(output_rpm=10.0, counter_clockwise=False, settle_s=0.5)
    plan = transmission_error(station.devices, STANDARD, settings)
    record = paused_once(station, plan, lambda done, _: done == 2)
    (turned,) = record.result.directions
    assert np.ptp(turned.output_angle_rad) == pytest.approx(2.0 * np.pi * 1.33, rel=0.05)
    assert np.all(np.diff(turned.time_s) < 0.05)  # no gap where it was paused
