import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.counting import counted

from torquebench.errors import InputError, SignalFault
from torquebench.signals import (
    EdgeBlock,
    PulseTrainFault,
    SignalFaultKind,
    SignalScale,
)

SCALE = SignalScale(
    nominal_torque_nm=2000.0,
    nominal_zero=60e3,
    sensitivity_cw=15.0,
    sensitivity_ccw=14.9,
    limits=(15e3, 105e3),
    measured_zero=60_012.5,
)


def test_each_direction_has_its_sensitivity():
    torque = SCALE.torque([60_012.5 + 15e3, 60_012.5, 60_012.5 - 14.9e3])
    np.testing.assert_allclose(torque, [1000.0, 0.0, -1000.0], atol=1e-9)


def test_it_equals_the_sources_form():
    # M = M_nom (f − f₀)/(f_nom − f₀) with f_nom the frequency at nominal torque
    scale = replace(SCALE, sensitivity_ccw=15.0).with_zero(60_030.0)
    frequency_nominal = scale.zero + 2000.0 * 15.0
    frequency = np.array([65e3, 72_345.6])
    expected = 2000.0 * (frequency - scale.zero) / (frequency_nominal - scale.zero)
    np.testing.assert_allclose(scale.torque(frequency), expected, rtol=1e-14)


@given(st.floats(-2400.0, 2400.0))
def test_frequency_and_torque_are_inverse(torque):
    assert float(SCALE.torque(SCALE.signal(torque))) == pytest.approx(torque, abs=1e-8)


@pytest.mark.parametrize("frequency", [14_999.0, 105_001.0, 0.0, np.nan, np.inf])
def test_outside_the_modulation_range_is_a_fault(frequency):
    with pytest.raises(PulseTrainFault, match="15000 to 105000 Hz") as caught:
        SCALE.torque([60e3, frequency])
    assert caught.value.kind is SignalFaultKind.OUT_OF_MODULATION
    assert isinstance(caught.value, SignalFault)


def test_a_fault_survives_pickling():
    fault = PulseTrainFault(SignalFaultKind.STUCK, "found", "allowed")
    again = pickle.loads(pickle.dumps(fault))
    assert (again.kind, str(again)) == (fault.kind, str(fault))


def test_samples_become_torque_with_uncertainty_and_faults(pulse_train):
    low = pulse_train(10e3, 10e-3)
    good = pulse_train(75_012.5, 10e-3) + 1_000_000
    block = EdgeBlock(np.concatenate((low, good)), 0, 3_000_000, 100e6)
    frequency = counted(block, 10e-3, edge_jitter_s=5e-9, check_train=False)
    torque = SCALE.readings(frequency)
    assert torque["fault"].tolist() == [
        SignalFaultKind.OUT_OF_MODULATION,
        0,
        SignalFaultKind.NO_PULSES,
    ]
    assert torque["reading_nm"][1] == pytest.approx(1000.0, abs=1e-3)
    assert torque["counter_nm"][1] == pytest.approx(frequency["frequency_uncertainty_hz"][1] / 15.0)
    assert np.isnan(torque["reading_nm"][[0, 2]]).all()
    assert torque.valid.tolist() == [False, True, False]
    with pytest.raises(PulseTrainFault, match=r"output_torque.*2 of 3 windows faulty"):
        torque.raise_on_fault("output_torque")


@pytest.mark.parametrize(
    "change",
    [
        {"nominal_torque_nm": 0.0},
        {"sensitivity_cw": -15.0},
        {"sensitivity_ccw": np.nan},
        {"limits": (105e3, 15e3)},
        {"measured_zero": 10e3},
    ],
)
def test_impossible_scales_are_refused(change):
    values = {
        "nominal_torque_nm": 2000.0,
        "nominal_zero": 60e3,
        "sensitivity_cw": 15.0,
        "sensitivity_ccw": 15.0,
        "limits": (15e3, 105e3),
    }
    with pytest.raises(InputError):
        SignalScale(**(values | change))


@pytest.mark.parametrize(("unit", "full"), [("V", 10.0), ("mV/V", 2.0), ("N·m", 2000.0)])
def test_a_voltage_a_ratio_and_a_torque_have_the_same_scale(unit, full):
    scale = SignalScale(
        nominal_torque_nm=2000.0,
        nominal_zero=0.0,
        sensitivity_cw=full / 2000.0,
        sensitivity_ccw=0.99 * full / 2000.0,
        limits=(-1.5 * full, 1.5 * full),
        measured_zero=0.01 * full,
        unit=unit,
    )
    torque = scale.torque([0.51 * full, 0.01 * full, (0.01 - 0.99 / 2.0) * full])
    np.testing.assert_allclose(torque, [1000.0, 0.0, -1000.0], atol=1e-9)
    with pytest.raises(PulseTrainFault, match=f"-{1.5 * full:g} to {1.5 * full:g} {unit}"):
        scale.torque(1.6 * full)
