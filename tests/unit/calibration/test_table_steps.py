"""Tables that follow no profile, evaluated by the steps that they have."""

import numpy as np
import pytest

from torquebench.calibration import CalibrationData, calibration_results, own_steps
from torquebench.uncertainty import CertifiedUncertainty


def table(*rows: tuple[float, int, int]) -> CalibrationData:
    """Return points (standard, series, branch) whose reading is 0.1 % too large."""
    standard, series, branch = (np.array(column) for column in zip(*rows, strict=True))
    return CalibrationData(1.001 * standard, standard, series, branch, 100.0)


def nominal(data: CalibrationData) -> list[float]:
    found = own_steps(data)
    assert found.data is not None
    assert found.data.nominal_nm is not None
    assert not found.of_profile
    return found.data.nominal_nm.tolist()


def test_reference_torques_that_belong_together_are_one_step_with_a_plain_name() -> None:
    data = table((19.98, 1, 1), (50.1, 1, 1), (20.03, 2, 1), (49.9, 2, 1))
    assert nominal(data) == [20.0, 50.0, 20.0, 50.0]
    assert own_steps(data).remarks == ()


def test_both_directions_and_unloaded_points_keep_their_place() -> None:
    rows = [(0.01, 1, 1), (30.0, 1, 1), (60.0, 1, 1), (0.0, 1, -1), (-30.0, 1, 1), (-60.0, 1, 1)]
    assert nominal(table(*rows)) == [0.0, 30.0, 60.0, 0.0, -30.0, -60.0]


def test_nominal_torques_of_the_table_are_taken() -> None:
    data = CalibrationData([5.0, 9.0], [5.0, 9.0], [1, 1], [1, 1], 10.0, nominal_nm=[5.1, 9.2])
    assert nominal(data) == [5.1, 9.2]


def test_a_step_that_a_series_lacks_is_left_out_and_named() -> None:
    data = table((20.0, 1, 1), (40.0, 1, 1), (60.0, 1, 1), (20.0, 2, 1), (60.0, 2, 1))
    assert nominal(data) == [20.0, 60.0, 20.0, 60.0]
    assert own_steps(data).remarks == (
        "clockwise, series 2 lacks the step 40 N·m: the step is left out",
    )


def test_a_falling_series_may_lack_the_turn_but_no_other_step() -> None:
    rows = [(20.0, 1, 1), (40.0, 1, 1), (60.0, 1, 1), (40.0, 1, -1), (20.0, 1, -1)]
    assert own_steps(table(*rows)).remarks == ()
    assert own_steps(table(*rows[:-1])).remarks == (
        "clockwise, series 1 lacks the step 20 N·m with decreasing torque: the step is left out",
    )


def test_a_direction_that_is_not_in_steps_is_named_and_the_other_evaluated() -> None:
    ramp = [(value, 1, 1) for value in np.linspace(50.0, 60.0, 200)]
    data = table((20.0, 1, 1), *ramp, (-20.0, 1, 1), (-40.0, 1, 1))
    assert nominal(data) == [-20.0, -40.0]
    assert own_steps(data).remarks == (
        "clockwise, more than once on one branch of a series, or too close to another step: "
        "55 N·m; left out",
        "clockwise, fewer than two steps that every series has: not evaluated",
    )


def test_small_steps_that_merge_leave_the_other_steps_to_be_evaluated() -> None:
    small = [(0.30, 1, 1), (0.34, 1, 1), (0.38, 2, 1), (0.42, 2, 1)]
    data = table(*small, (20.0, 1, 1), (50.0, 1, 1), (20.0, 2, 1), (50.0, 2, 1))
    assert nominal(data) == [20.0, 50.0, 20.0, 50.0]
    assert own_steps(data).remarks == (
        "clockwise, more than once on one branch of a series, or too close to another step: "
        "0.36 N·m; left out",
    )


def test_an_unloaded_point_has_no_sign() -> None:
    rows = [(-0.01, 1, 1), (-30.0, 1, 1), (-60.0, 1, 1)]
    assert not np.any(np.signbit(nominal(table(*rows))[:1]))


def test_one_step_is_nothing_to_evaluate() -> None:
    found = own_steps(table((20.0, 1, 1), (20.0, 2, 1)))
    assert found.data is None
    assert found.remarks == (
        "clockwise, fewer than two steps that every series has: not evaluated",
    )


def test_what_is_left_evaluates() -> None:
    rows = [(step, number, 1) for number in (1, 2) for step in (10.0, 35.0, 70.0, 95.0)]
    found = own_steps(table(*rows, (50.0, 1, 1)))
    assert found.data is not None
    results = calibration_results(
        found.data, resolution_nm=0.001, reference=CertifiedUncertainty.of_torque(2e-4)
    )
    (clockwise,) = results.directions
    assert clockwise.before.evaluation.torque_nm.tolist() == [10.0, 35.0, 70.0, 95.0]
    deviation = clockwise.before.evaluation.indication_deviation_percent
    assert deviation == pytest.approx([0.1] * 4)
