import numpy as np
import pytest

from torquebench.calibration import CalibrationData, calibration_results, load_profile
from torquebench.uncertainty import CertifiedUncertainty


def measured(name, gain):
    """Readings with a span error that changes a little with the mounting position."""
    steps = [step for step in load_profile(name).staircase(100.0) if step.recorded]
    torque = np.array([step.nominal_nm for step in steps])
    position = np.array([step.position_deg for step in steps])
    branch = np.array([step.branch for step in steps])
    hysteresis = 0.01 * np.where(branch < 0, 1.0, 0.0) * np.sign(torque)
    return CalibrationData(
        reading_nm=torque * (gain + 1e-5 * position / 120.0) + hysteresis,
        standard_nm=torque,
        series=[step.series for step in steps],
        branch=branch,
        range_nm=100.0,
        nominal_nm=torque,
        position_deg=position,
    )


def test_both_directions_stand_side_by_side_before_and_after():
    data = measured("staircase", 1.004)
    results = calibration_results(
        data,
        resolution_nm=0.001,
        reference=CertifiedUncertainty.of_torque(1e-4),
        torque_nm=data.reading_nm / 1.004,
    )
    assert [each.name for each in results.directions] == ["clockwise", "counter-clockwise"]
    for direction in results.directions:
        before, after = direction.before, direction.after
        assert np.allclose(before.evaluation.indication_deviation_percent, 0.4, atol=0.002)
        assert np.allclose(after.evaluation.indication_deviation_percent, 0.0, atol=0.002)
        assert before.classification.whole_range == 1.0
        assert after.classification.whole_range == 0.1
        assert before.evaluation.positions.tolist() == [3] * 8
    assert results.errors_before.worst_percent_fs == pytest.approx(0.402, abs=0.001)
    assert results.errors_after.worst_percent_fs < 0.02
    assert results.zero_before is None


def test_what_was_not_measured_gives_no_class_and_says_why():
    results = calibration_results(
        measured("rapid-in-situ", 1.0),
        resolution_nm=0.001,
        reference=CertifiedUncertainty.of_torque(1e-4),
    )
    for direction in results.directions:
        assert direction.after is None
        assert direction.before.classification is None
        assert "a repeated series (b′)" in direction.before.unclassified
    assert results.errors_after is None


def test_reversing_cycles_have_a_zero_hysteresis_before_and_after():
    data = measured("reversing", 1.0)
    shifted = data.reading_nm + np.where(data.nominal_nm == 0, 0.02 * data.loading_direction(), 0)
    data = CalibrationData(
        shifted, data.standard_nm, data.series, data.branch, 100.0, nominal_nm=data.nominal_nm
    )
    results = calibration_results(
        data,
        resolution_nm=0.001,
        reference=CertifiedUncertainty.of_torque(1e-4),
        torque_nm=data.standard_nm,
    )
    assert results.zero_before.mean_nm == pytest.approx(0.04)
    assert results.zero_before.cycles == 3
    assert results.zero_after.mean_nm == 0.0
