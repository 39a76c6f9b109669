from dataclasses import replace

import numpy as np
import pytest

from torquebench.calibration import (
    CLASSES,
    CalibrationData,
    LoadingSeries,
    classify,
    evaluate_static,
    limits_of_class,
    load_profile,
    loading_series,
    zero_hysteresis,
)
from torquebench.errors import InputError

STEPS = np.array([20.0, 40.0, 60.0, 80.0, 100.0])


def series(position=0.0, offset=0.0, falling=None, zero_return=None, gain=1.0):
    rising = gain * STEPS + offset
    return LoadingSeries(
        position, rising, None if falling is None else rising + falling, zero_return
    )


def evaluate(parts, **options):
    settings = {"resolution": 0.001, "reference_uncertainty_percent": 0.01, "scale": 1.0}
    return evaluate_static(STEPS, parts, **{**settings, **options})


def staircase(range_nm=100.0, gain=1.0, loading=0.001):
    """A noise-free staircase whose steps are missed by 0.1 % of the step."""
    steps = [step for step in load_profile("staircase").staircase(range_nm) if step.recorded]
    nominal = np.array([step.nominal_nm for step in steps])
    standard = nominal * (1 + loading * np.array([step.branch for step in steps]))
    return CalibrationData(
        reading_nm=gain * standard,
        standard_nm=standard,
        series=[step.series for step in steps],
        branch=[step.branch for step in steps],
        range_nm=range_nm,
        nominal_nm=nominal,
        position_deg=[step.position_deg for step in steps],
        tared=True,
    )


def test_an_ideal_chain_has_no_deviation_at_all():
    result = evaluate([series(), series(), series(120.0, falling=0.0, zero_return=0.0)])
    for values in (
        result.repeatability_percent,
        result.reproducibility_range_percent,
        result.reproducibility_deviation_percent,
        result.reversibility_percent,
        result.indication_deviation_percent,
        result.interpolation(1).deviation_percent,
    ):
        np.testing.assert_allclose(values, 0.0, atol=1e-12)
    assert result.zero_residual_percent == 0.0
    assert result.sensitivity == 1.0
    np.testing.assert_allclose(
        result.uncertainty_percent(1, "range", decreasing=True),
        2 * np.sqrt(0.005**2 + 2 * (0.1 / STEPS / np.sqrt(12)) ** 2),
    )


def test_the_repeated_series_enters_the_repeatability_alone():
    one = evaluate([series(), series(offset=0.01), series(120.0)])
    np.testing.assert_allclose(one.mean, STEPS)
    np.testing.assert_allclose(one.repeatability_percent, 100 * 0.01 / (STEPS + 0.005))
    assert one.positions.tolist() == [2] * 5


def test_without_another_position_nothing_is_called_reproducibility():
    result = evaluate([series(), series(offset=0.01)])
    assert result.reproducibility_range_percent is None
    assert result.reproducibility_deviation_percent is None
    assert "reproducibility" not in result.components(1, "range", decreasing=False)
    with pytest.raises(InputError, match="without a second position"):
        classify(result, degree=1, decreasing=False)


def test_what_was_not_measured_is_not_counted():
    result = evaluate([series(), series(120.0)], scale=None)
    assert result.repeatability_percent is None
    assert result.zero_residual_percent is None
    components = result.components(2, "standard-deviation", decreasing=False)
    assert set(components) == {
        "reference",
        "resolution",
        "resolution of the zero",
        "interpolation",
        "reproducibility",
    }
    with pytest.raises(InputError, match="no decreasing series"):
        result.components(1, "range", decreasing=True)
    with pytest.raises(InputError, match="no fixed scale"):
        result.interval_percent(1, "range", decreasing=False)


def test_a_gain_error_is_an_indication_deviation_and_no_interpolation_deviation():
    result = evaluate([series(gain=1.002), series(120.0, gain=1.002)])
    np.testing.assert_allclose(result.indication_deviation_percent, 0.2)
    np.testing.assert_allclose(result.interpolation(1).deviation_percent, 0.0, atol=1e-12)
    w = result.uncertainty_percent(1, "range", decreasing=False)
    np.testing.assert_allclose(result.interval_percent(1, "range", decreasing=False), 0.2 + w)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_polynomials_through_zero_are_found_exactly(degree):
    coefficients = np.array([1.5, -2e-4, 3e-6])[:degree]
    rising = sum(c * STEPS ** (k + 1) for k, c in enumerate(coefficients))
    result = evaluate([LoadingSeries(0.0, rising)])
    np.testing.assert_allclose(result.interpolation(degree).coefficients, coefficients, rtol=1e-9)
    np.testing.assert_allclose(result.interpolation(degree).deviation_percent, 0.0, atol=1e-11)


def test_an_interpolation_needs_more_steps_than_its_degree():
    result = evaluate_static(
        [50.0, 100.0],
        [LoadingSeries(0.0, np.array([50.0, 100.0]))],
        resolution=0.0,
        reference_uncertainty_percent=0.0,
    )
    with pytest.raises(InputError, match="degree 2 through 2 steps; allowed: the degrees 1"):
        result.interpolation(2)


@pytest.mark.parametrize(
    ("torque", "parts", "options", "message"),
    [
        ([0.0, 1.0], [series()], {}, "steps"),
        ([2.0, 1.0], [series()], {}, "steps"),
        (STEPS, [], {}, "no series"),
        (STEPS, [LoadingSeries(0.0, STEPS[:3])], {}, "series 1 has increasing values"),
        (STEPS, [LoadingSeries(0.0, STEPS * np.nan)], {}, "no increasing deflection at 20 N·m"),
        (STEPS, [LoadingSeries(0.0, STEPS * np.inf)], {}, "series 1 has increasing values"),
        (STEPS, [LoadingSeries(0.0, STEPS, STEPS[:2])], {}, "series 1 has decreasing values"),
        (STEPS, [LoadingSeries(0.0, -STEPS)], {}, "a deflection of -100"),
        (STEPS, [series()], {"resolution": -1.0}, "resolution -1.0"),
        (STEPS, [series()], {"reference_uncertainty_percent": np.nan}, "reference nan"),
    ],
)
def test_what_cannot_be_evaluated_is_named(torque, parts, options, message):
    settings = {"resolution": 0.001, "reference_uncertainty_percent": 0.01}
    with pytest.raises(InputError, match=message):
        evaluate_static(torque, parts, **{**settings, **options})


def test_limits_follow_from_the_class():
    for c in CLASSES:
        limits = limits_of_class(c)
        assert limits.reversibility >= 1.25 * c
        assert limits.reversibility == pytest.approx(1.25 * c, rel=0.01)
        assert (limits.reproducibility, limits.repeatability) == (c, c / 2)
        assert (limits.zero_residual, limits.reference) == (c / 4, c / 5)
    with pytest.raises(InputError, match=r"class 0\.3; allowed: 0\.05, 0\.1"):
        limits_of_class(0.3)


def test_a_class_holds_from_the_step_where_all_limits_are_met_on():
    parts = [series(), series(offset=0.03), series(120.0, zero_return=0.0)]
    result = classify(evaluate(parts), degree=1, decreasing=False)
    # b′ is 0.15, 0.075, 0.05, 0.0375 and 0.03 % and must not exceed half the class.
    assert result.starts_nm[0.05] is None
    assert result.starts_nm[0.1] == 60.0
    assert result.starts_nm[0.2] == 40.0
    assert result.starts_nm[0.5] == 20.0
    assert result.whole_range == 0.5


def test_the_range_starts_where_the_resolution_is_fine_enough():
    parts = [series(), series(), series(120.0, zero_return=0.0)]
    result = classify(evaluate(parts, resolution=0.04), degree=1, decreasing=False)
    # M_A must be at least 200/class times the resolution: 80 N·m for the class 0.1.
    assert result.starts_nm[0.1] == 80.0


def test_the_reference_limits_the_class_of_all_steps():
    parts = [series(), series(), series(120.0, zero_return=0.0)]
    result = classify(
        evaluate(parts, reference_uncertainty_percent=0.05), degree=1, decreasing=False
    )
    assert result.starts_nm[0.2] is None
    assert result.whole_range == 0.5


def test_a_fixed_scale_is_classified_by_its_indication():
    parts = [series(gain=1.002), series(gain=1.002), series(120.0, gain=1.002, zero_return=0.0)]
    evaluation = evaluate(parts)
    assert classify(evaluation, degree=1, decreasing=False).whole_range == 0.05
    fixed = classify(evaluation, degree=1, decreasing=False, fixed_scale=True)
    assert fixed.whole_range == 0.5


def test_series_of_a_table_are_normalised_to_their_nominal_steps():
    for direction in (1, -1):
        loading = loading_series(staircase(gain=1.001), direction)
        torque, parts = loading.torque_nm, loading.series
        assert loading.remarks == ()
        np.testing.assert_allclose(torque, [10, 20, 30, 40, 50, 60, 80, 100])
        assert [part.position_deg for part in parts] == [0.0, 0.0, 120.0, 240.0]
        assert [part.decreasing is not None for part in parts] == [False, False, True, True]
        for part in parts:
            np.testing.assert_allclose(part.increasing, 1.001 * torque)
            assert part.zero_return == 0.0


def test_a_step_that_a_series_lacks_is_evaluated_by_the_others():
    data = staircase()
    lacking = loading_series(data.subset(np.arange(len(data)) != 3), 1)
    assert lacking.torque_nm.size == 8
    assert np.flatnonzero(np.isnan(lacking.series[0].increasing)).tolist() == [3]
    result = evaluate_static(
        lacking.torque_nm, lacking.series, resolution=0.0, reference_uncertainty_percent=0.0
    )
    assert np.flatnonzero(np.isnan(result.repeatability_percent)).tolist() == [3]
    assert result.positions.tolist() == [3] * 3 + [2] + [3] * 4
    with pytest.raises(InputError, match="steps"):
        evaluate_static([], [], resolution=0.0, reference_uncertainty_percent=0.0)


def test_a_step_that_is_read_twice_is_averaged():
    data = staircase()
    twice = data.subset([0, *range(len(data))])
    reading = np.array(twice.reading_nm)
    reading[1] += 0.2
    series = loading_series(replace(twice, reading_nm=reading), 1).series
    assert series[0].increasing[0] == pytest.approx(10.1, abs=2e-4)


def test_a_direction_that_was_not_loaded_has_no_series():
    data = staircase()
    assert loading_series(data.subset(data.nominal_nm > 0), -1) is None


def test_zero_hysteresis_of_cycles():
    data = CalibrationData(
        reading_nm=[10.0, 0.03, -10.0, -0.01, 10.0, 0.05, -10.0, -0.01],
        standard_nm=[10.0, 0.0, -10.0, 0.0, 10.0, 0.0, -10.0, 0.0],
        series=[1, 1, 1, 1, 2, 2, 2, 2],
        branch=[1, -1, 1, -1, 1, -1, 1, -1],
        range_nm=10.0,
    )
    result = zero_hysteresis(data)
    assert result.cycles == 2
    assert result.mean_nm == pytest.approx(0.05)
    assert result.worst_nm == pytest.approx(0.06)
    assert result.worst_percent_fs == pytest.approx(0.6)
    assert zero_hysteresis(data.subset(data.standard_nm > 0)) is None


def test_a_small_step_is_no_zero_whatever_the_standard_shows() -> None:
    # Steps of 0.1 % of the range, of which the standard shows a little less or the other sign.
    cycle = [2.0, 4.0, 2.0, 0.0, -2.0, -4.0, -2.0, 0.0]
    standard = np.array([1.9, 4.0, -0.1, 0.1, -1.9, -4.0, 0.1, -0.1])
    reading = np.array([1.2, 3.5, 1.5, 0.4, -1.2, -3.5, -1.5, 0.0])
    data = CalibrationData(
        reading, standard, [1] * 8, [1, 1, -1, -1, 1, 1, -1, -1], 2000.0, nominal_nm=cycle
    )
    assert data.direction.tolist() == [1, 1, 1, 0, -1, -1, -1, 0]
    assert data.loading_direction().tolist() == [1, 1, 1, 1, -1, -1, -1, -1]
    assert zero_hysteresis(data).worst_nm == pytest.approx(0.4)
    loading = loading_series(replace(data, tared=True), 1)
    assert loading.torque_nm.tolist() == [2.0, 4.0]
    assert loading.series[0].zero_return == 0.4
    assert "loaded with -0.1 N·m, deviation 105 %: left out" in loading.remarks[1]


def test_a_guess_from_the_standard_is_named() -> None:
    data = CalibrationData([5.0, 10.0, 0.0], [5.0, 10.0, 0.005], [1] * 3, [1, 1, -1], 10.0)
    assert data.unloaded.tolist() == [False, False, True]
    assert any("1 points below 0.1 % of the range are treated as zeros" in n for n in data.notes())
    told = CalibrationData(
        [5.0, 10.0, 0.0], [5.0, 10.0, 0.005], [1] * 3, [1, 1, -1], 10.0, nominal_nm=[5.0, 10.0, 0.0]
    )
    assert not any("treated as zeros" in note for note in told.notes())


def test_small_steps_are_loads_and_never_zeros_and_keep_their_commanded_direction() -> None:
    """Steps of ±0.1 % of the range, whose standard scatters beyond zero; zeros return 0.45 N·m."""
    steps = [step for step in load_profile("small-torques").staircase(2000.0) if step.recorded]
    target = np.array([step.nominal_nm for step in steps])
    standard = target + np.random.default_rng(5).normal(0.0, 3.0, target.size)
    branch = np.array([step.branch for step in steps])
    zero = (target == 0.0) & (branch < 0)
    before = np.sign(np.concatenate([[0.0], target[:-1]]))
    data = CalibrationData(
        reading_nm=np.where(zero, 0.225 * before, standard),
        standard_nm=standard,
        series=[step.series for step in steps],
        branch=branch,
        range_nm=2000.0,
        nominal_nm=target,
    )
    assert np.any(standard[target == 2.0] < 0.0)  # what a guess by the standard would miss
    assert data.direction.tolist() == np.sign(target).tolist()
    assert data.unloaded.tolist() == (target == 0.0).tolist()
    hysteresis = zero_hysteresis(data)
    assert hysteresis.cycles == 8
    assert hysteresis.worst_nm == pytest.approx(0.45)
