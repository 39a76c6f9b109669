"""Zeros as plans of their own."""

import numpy as np
import pytest

from torquebench.bench.active_chain import ActiveChain
from torquebench.chain import MeasuringChain, Zero
from torquebench.compensation import make_model
from torquebench.procedures import zero_modules
from torquebench.station import Station


def test_zeroed_modules_read_zero(station: Station) -> None:
    record = station.run(zero_modules(station.devices), kind="zero")
    assert set(record.result) == {"input", "output"}
    station.clock.wait(0.2)
    for side, range_nm in (("input", 50.0), ("output", 2000.0)):
        found = record.result[side]
        assert found.standard_signal is None
        assert station.acquisition.zero(f"{side}_torque") == found.signal
        assert abs(station.acquisition.reading_nm(f"{side}_torque")) < 0.1e-2 * range_nm


def test_the_uncertainty_of_a_measured_zero_is_in_u_of_the_live_torque(station: Station) -> None:
    standard = np.linspace(-2000.0, 2000.0, 21)
    model = make_model("polynomial-1", range_nm=2000.0).fit(standard[:, None], standard)
    active = ActiveChain(MeasuringChain(model, (Zero("data sheet", 0.0),)), "1", "polynomial")
    station.acquisition.set_compensation("output", active)
    found = station.run(zero_modules(station.devices), kind="zero").result["output"]
    assert 0.0 < found.standard_uncertainty_nm < 0.1e-2 * 2000.0
    viewer = station.acquisition.add_viewer()
    station.clock.wait(0.2)
    torque = list(iter(lambda: viewer.get(0.0), None))[-1].torques["output"]
    assert torque.component("zero") == pytest.approx(found.standard_uncertainty_nm)
