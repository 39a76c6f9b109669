from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.calibration import (
    CalibrationData,
    load_profile,
    repeatability,
    summarise_errors,
    verify,
)
from torquebench.chain import Component, Shared, Torque
from torquebench.errors import InputError


class Shift:
    """A chain that adds a constant."""

    def __init__(self, shift_nm):
        self.shift_nm = shift_nm

    def torque(self, readings):
        own = Component("own", Shared.CALIBRATION, np.full(len(readings), 0.1))
        return Torque(readings.reading_nm + self.shift_nm, (own,))


def groups(seed=0, noise_nm=0.0, offset_nm=1.0, count=10, range_nm=100.0):
    rng = np.random.default_rng(seed)
    profile = load_profile("verification").with_options(groups=count)
    steps = [step for step in profile.staircase(range_nm, rng) if step.recorded]
    true = np.array([step.nominal_nm for step in steps])
    true *= 1 + rng.normal(0, 0.0005, true.size)
    return CalibrationData(
        reading_nm=true - offset_nm + rng.normal(0, noise_nm, true.size),
        standard_nm=true + 0.01,
        series=[step.series for step in steps],
        branch=[step.branch for step in steps],
        range_nm=range_nm,
        true_torque_nm=true,
    )


def test_errors_of_known_numbers():
    summary = summarise_errors([1.0, 10.4, 99.0], [0.0, 10.0, 100.0], 100.0)
    assert summary.points == 3
    assert summary.worst_nm == 1.0
    assert summary.worst_percent_fs == 1.0
    assert summary.rms_nm == pytest.approx(np.sqrt((1 + 0.16 + 1) / 3))
    assert summary.worst_percent_reading == pytest.approx(4.0)


def test_errors_in_percent_of_reading_need_a_torque_to_refer_to():
    summary = summarise_errors([1.0, 2.0], [0.0, 0.0], 100.0)
    assert summary.worst_percent_reading is None
    assert summary.rms_percent_reading is None


@pytest.mark.parametrize(
    ("torque", "reference", "range_nm", "message"),
    [
        ([1.0], [1.0, 2.0], 10.0, "shape"),
        ([], [], 10.0, "at least one point"),
        ([1.0], [1.0], 0.0, "range 0.0"),
        ([1.0, np.nan], [1.0, 2.0], 10.0, "nan against reference 2.0 at point 2"),
    ],
)
def test_what_has_no_error_is_refused(torque, reference, range_nm, message):
    with pytest.raises(InputError, match=message):
        summarise_errors(torque, reference, range_nm)


@given(
    st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=40),
    st.floats(0.5, 1e3),
    st.floats(0.1, 10.0),
)
def test_errors_scale_with_the_unit_and_worst_is_at_least_rms(torque, range_nm, factor):
    torque = np.array(torque)
    reference = np.round(torque)
    one = summarise_errors(torque, reference, range_nm)
    scaled = summarise_errors(factor * torque, factor * reference, factor * range_nm)
    # Squares of errors below 1e-154 N·m have few digits left.
    assert one.worst_nm >= one.rms_nm * (1 - 1e-12) - 1e-150
    assert scaled.worst_percent_fs == pytest.approx(one.worst_percent_fs, abs=1e-9)


def test_raw_comes_first_and_models_stand_beside_it():
    result = verify(groups(), {"shift": Shift(1.0), "wrong": Shift(-1.0)})
    assert [model.name for model in result.models] == ["raw", "shift", "wrong"]
    assert (result.groups, result.points, result.simulated) == (10, 500, True)
    raw, shift = result.of("raw"), result.of("shift")
    assert raw.against_truth.worst_nm == pytest.approx(1.0)
    assert raw.against_standard.worst_nm == pytest.approx(1.01)
    assert shift.against_truth.worst_nm == pytest.approx(0.0, abs=1e-12)
    assert shift.against_standard.worst_nm == pytest.approx(0.01)
    assert len(shift.groups) == 10
    assert all(group.points == 50 for group in shift.groups)


def test_unknown_models_and_reserved_names_are_named():
    with pytest.raises(InputError, match="model 'other'"):
        verify(groups(), {}).of("other")
    with pytest.raises(InputError, match="a model called 'raw'"):
        verify(groups(), {"raw": Shift(0.0)})


def test_repeatability_and_averages_of_noise():
    noise = 0.02
    model = verify(groups(seed=5, noise_nm=noise), {"shift": Shift(1.0)}).of("shift")
    assert model.repeatability.places == 50
    assert model.repeatability.pooled_nm == pytest.approx(noise, rel=0.15)
    assert model.repeatability.pooled_percent_fs == pytest.approx(model.repeatability.pooled_nm)
    # Averaging ten groups takes the noise down by √10; the worst single reading can't show it.
    assert model.averaged.rms_nm == pytest.approx(noise / np.sqrt(10), rel=0.3)
    assert model.averaged.worst_nm < 0.5 * model.against_truth.worst_nm


def test_a_constant_error_has_no_spread():
    raw = verify(groups(), {}).of("raw")
    assert raw.repeatability.pooled_nm == pytest.approx(0.0, abs=1e-12)
    assert raw.averaged.worst_nm == pytest.approx(1.0)


def test_one_group_has_no_repeatability():
    raw = verify(groups(count=1), {}).of("raw")
    assert raw.repeatability is None
    assert raw.averaged is None


def test_without_a_truth_the_standard_is_the_reference():
    data = groups()
    data = CalibrationData(
        data.reading_nm, data.standard_nm, data.series, data.branch, data.range_nm
    )
    raw = verify(data, {}).of("raw")
    assert raw.against_truth is None
    assert raw.groups[0].worst_nm == pytest.approx(1.01)


def test_groups_of_different_order_fall_into_cells():
    data = CalibrationData(
        reading_nm=[51.0, 11.0, 11.2, 51.2, 90.0],
        standard_nm=[51.0, 11.0, 11.0, 51.0, 90.0],
        series=[1, 1, 2, 2, 2],
        branch=[-1, -1, -1, -1, 1],
        range_nm=100.0,
    )
    repeatability = verify(data, {}).of("raw").repeatability
    assert repeatability.places == 2
    assert repeatability.rule == "points of one branch and direction in the same 5 % of range"
    assert repeatability.pooled_nm == pytest.approx(0.2 / np.sqrt(2))


def test_points_at_other_speeds_are_other_places():
    """Random speeds and torques repeat nothing: what differs between them is no repeatability."""
    data = CalibrationData(
        reading_nm=[51.0, 11.0, 51.5, 11.5],
        standard_nm=[51.0, 11.0, 51.0, 11.0],
        series=[1, 1, 2, 2],
        branch=[1, -1, 1, -1],
        range_nm=100.0,
        speed_rpm=[100.0, 100.0, -900.0, -900.0],
    )
    error = data.reading_nm - data.standard_nm
    assert repeatability(error, data) is None
    still = replace(data, speed_rpm=None)
    assert repeatability(error, still).worst_nm == pytest.approx(0.5 / np.sqrt(2))


def test_the_largest_uncertainty_of_the_chain_is_stated():
    result = verify(groups(), {"shift": Shift(1.0)})
    assert result.of("shift").expanded_uncertainty_nm == pytest.approx(0.2)
    assert result.of("raw").expanded_uncertainty_nm is None


def test_the_noise_of_a_standing_encoder_does_not_part_the_groups() -> None:
    torque = np.tile(np.linspace(100.0, 2000.0, 12), 3)
    noise_rpm = 1e-3 * np.random.default_rng(3).standard_normal(torque.size)
    data = CalibrationData(
        torque, torque, np.repeat([1, 2, 3], 12), np.ones(torque.size), 2000.0, speed_rpm=noise_rpm
    )
    found = verify(data, {}).models[0]
    assert found.repeatability is not None
    assert found.repeatability.places == 12
