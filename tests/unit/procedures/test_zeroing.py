"""Zero and preload as plans of their own."""

import bluesky.preprocessors as bpp
import pytest

from torquebench.procedures import preload, zero_modules
from torquebench.procedures.setup import Setup, power_on, set_up, unloaded_after
from torquebench.station import Station


def test_zeroed_modules_read_zero(station: Station) -> None:
    record = station.run(zero_modules(station.devices), kind="zero")
    assert set(record.result) == {"input", "output"}
    station.clock.wait(0.2)
    for side, range_nm in (("input", 50.0), ("output", 2000.0)):
        found = record.result[side]
        assert found.standard_frequency_hz is None
        assert station.acquisition.zero_hz(f"{side}_torque") == found.frequency_hz
        latest = station.acquisition.latest(f"{side}_torque")
        assert abs(latest.torque_nm) < 0.1e-2 * range_nm


def test_a_preload_loads_and_unloads(station: Station) -> None:
    devices = station.devices
    torques = []

    def plan():
        yield from set_up(devices, Setup("calibration", "output", "calibrator", "locked"))
        yield from power_on(devices, "output")
        yield from preload(devices, "output", 1000.0, on_s=0.5, off_s=0.5)
        now = station.clock.now()
        for start, stop in ((now - 0.9, now - 0.8), (now - 0.1, now)):
            torques.append(station.drivers.truth.true_torque("output", start, stop))

    station.run(unloaded_after(devices, lambda: bpp.run_wrapper(plan())), kind="preload")
    assert torques[0] == pytest.approx(1000.0, rel=0.01)
    assert torques[1] == pytest.approx(0.0, abs=10.0)
