import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.calibration import CalibrationData, infer_branch
from torquebench.errors import InputError


def table(**changes):
    columns = {
        "reading_nm": [0.1, 5.2, 10.1, 5.4, 0.2],
        "standard_nm": [0.0, 5.0, 10.0, 5.0, 0.0],
        "series": [1, 1, 1, 1, 1],
        "branch": [1, 1, 1, -1, -1],
        "range_nm": 10.0,
    }
    return CalibrationData(**{**columns, **changes})


def test_arrays_are_typed_and_cannot_be_changed():
    data = table()
    assert data.reading_nm.dtype == np.float64
    assert data.series.dtype == np.int64
    assert data.branch.dtype == np.int8
    with pytest.raises(ValueError, match="read-only"):
        data.reading_nm[0] = 1.0


def test_the_callers_arrays_stay_their_own():
    reading = np.array([0.1, 5.2, 10.1, 5.4, 0.2])
    data = table(reading_nm=reading)
    reading[0] = 99.0
    assert data.reading_nm[0] == 0.1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"range_nm": 0.0}, "range 0.0 N·m"),
        ({"range_nm": float("nan")}, "range nan"),
        ({"standard_nm": [0.0, 5.0]}, "column standard_nm has shape"),
        ({"reading_nm": [0.1, np.nan, 10.1, 5.4, 0.2]}, "reading_nm holds nan at point 2"),
        ({"reading_nm": ["a", 1, 2, 3, 4]}, "values that aren't numbers"),
        ({"branch": [1, 1, 2, -1, -1]}, "branch 2 at point 3"),
        ({"series": [1, 1, 1.5, 1, 1]}, "series 1.5 at point 3"),
        ({"standard_nm": [0.0, 5.0, 11.0, 5.0, 0.0]}, "standard_nm 11 N·m at point 3"),
        ({"temperature_c": [20.0]}, "temperature_c has shape"),
        ({"reading_nm": [], "standard_nm": [], "series": [], "branch": []}, "without points"),
    ],
)
def test_what_cannot_be_used_is_named(changes, message):
    with pytest.raises(InputError, match=message):
        table(**changes)


def test_points_within_the_margin_of_the_range_are_kept():
    assert len(table(standard_nm=[0.0, 5.0, 10.19, 5.0, 0.0])) == 5


def test_features_hold_reading_branch_and_series():
    data = table()
    X = data.features()
    assert X.shape == (5, 3)
    np.testing.assert_array_equal(X[:, 0], data.reading_nm)
    np.testing.assert_array_equal(X[:, 1], data.branch)


def test_features_that_were_not_measured_are_refused():
    with pytest.raises(InputError, match="no column speed_rpm"):
        table().features(4)
    assert table(speed_rpm=np.zeros(5), temperature_c=np.full(5, 23.0)).features(5).shape == (5, 5)


def test_a_true_torque_makes_it_simulated():
    assert not table().simulated
    assert table(true_torque_nm=[0.0, 5.0, 10.0, 5.0, 0.0]).simulated
    assert table(simulated=True).simulated


def test_hash_depends_on_values_and_on_what_they_refer_to():
    same = table()
    assert table().sha256() == same.sha256()
    assert len(same.sha256()) == 64
    others = [
        table(reading_nm=[0.1, 5.2, 10.1, 5.4, 0.3]),
        table(range_nm=20.0),
        table(transducer_serial="T-2"),
        table(temperature_c=np.full(5, 20.0)),
    ]
    assert len({data.sha256() for data in (same, *others)}) == 5


def test_subset_keeps_all_columns():
    data = table(temperature_c=[20.0, 21.0, 22.0, 23.0, 24.0]).subset([0, 3])
    assert data.temperature_c.tolist() == [20.0, 23.0]
    assert data.branch.tolist() == [1, -1]


def test_averages_keep_branches_and_directions_apart():
    one = table()
    two = table(reading_nm=[0.2, 5.3, 10.2, 5.5, 0.3])
    data = CalibrationData.concatenate([one, two]).averaged()
    np.testing.assert_allclose(data.reading_nm, [0.15, 5.25, 10.15, 5.45, 0.25])
    np.testing.assert_allclose(data.standard_error_nm, np.full(5, 0.05))
    assert data.branch.tolist() == [1, 1, 1, -1, -1]


def test_zeros_after_either_direction_are_different_steps():
    data = CalibrationData(
        [5.0, 0.1, -5.0, -0.1, 5.0, 0.1, -5.0, -0.1],
        [5.0, 0.0, -5.0, 0.0, 5.0, 0.0, -5.0, 0.0],
        [1, 1, 1, 1, 2, 2, 2, 2],
        [1, -1, 1, -1, 1, -1, 1, -1],
        5.0,
    )
    assert data.averaged().reading_nm.tolist() == [5.0, 0.1, -5.0, -0.1]


def test_averages_of_single_points_have_no_standard_error():
    assert table().averaged().standard_error_nm is None


def test_standards_that_never_hit_the_step_exactly_are_one_step():
    data = CalibrationData(
        [5.0, 10.0, 5.0, 10.0], [5.01, 10.02, 4.99, 9.98], [1, 1, 2, 2], [1, 1, 1, 1], 10.0
    )
    np.testing.assert_allclose(data.averaged().standard_nm, [5.0, 10.0])


def test_nominal_steps_are_told_apart_however_close_they_are():
    nominal = np.arange(1.0, 101.0) / 1000
    one = CalibrationData(
        nominal, nominal, np.ones(100), np.ones(100), range_nm=1.0, nominal_nm=nominal
    )
    assert len(CalibrationData.concatenate([one, one]).averaged()) == 100
    bare = CalibrationData(nominal, nominal, np.ones(100), np.ones(100), range_nm=1.0)
    assert len(bare.averaged()) == 1
    assert len(bare.averaged(tolerance_nm=1e-4)) == 100


def test_joined_series_keep_different_numbers():
    data = CalibrationData.concatenate([table(), table(series=[7, 7, 7, 8, 8])])
    assert data.series.tolist() == [1] * 5 + [2, 2, 2, 3, 3]


def test_a_column_that_one_part_lacks_is_dropped():
    data = CalibrationData.concatenate([table(speed_rpm=np.zeros(5)), table()])
    assert data.speed_rpm is None


def test_tables_of_different_chains_are_not_joined():
    with pytest.raises(InputError, match="different transducer_serial"):
        CalibrationData.concatenate([table(), table(transducer_serial="T-2")])
    with pytest.raises(InputError, match="no calibration table"):
        CalibrationData.concatenate([])


def test_notes_say_what_the_points_cannot_support():
    assert table().notes() == (
        "only clockwise points: nothing is known of counter-clockwise torque",
    )
    both = CalibrationData([1.0, 0.0, -1.0, 0.0], [1.0, 0, -1, 0], [1] * 4, [1, -1, 1, -1], 1.0)
    assert both.notes() == ()


def test_branch_of_a_reversing_cycle():
    standard = [0, 5, 10, 5, 0, -5, -10, -5, 0]
    assert infer_branch(standard, np.ones(9)).tolist() == [1, 1, 1, -1, -1, 1, 1, -1, -1]


def test_branch_where_the_torque_changes_its_direction_without_a_zero():
    assert infer_branch([10, 5, -5, -10], [1] * 4).tolist() == [-1, -1, 1, 1]


def test_branch_of_series_that_begin_at_full_load():
    assert infer_branch([0, 10, 10, 0], [1, 1, 2, 2]).tolist() == [1, 1, -1, -1]


def test_small_changes_of_the_standard_are_no_change_of_branch():
    assert infer_branch([0, 5, 5.001, 4.999, 10, 10.002, 5], [1] * 7).tolist() == [1] * 6 + [-1]


def test_branch_of_single_points_is_up():
    assert infer_branch([5.0, 7.0], [1, 2]).tolist() == [1, 1]


@given(
    steps=st.lists(st.integers(1, 50), min_size=2, max_size=30, unique=True),
    sign=st.sampled_from([1, -1]),
)
def test_branch_of_any_staircase_up_and_down(steps, sign):
    rising = sorted(steps)
    path = sign * np.array([0, *rising, *rising[-2::-1], 0])
    branch = infer_branch(path, np.ones(path.size))
    top = len(rising)
    assert branch.tolist() == [1] * (top + 1) + [-1] * top


@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_averaging_equal_repeats_changes_nothing(repeats, seed):
    rng = np.random.default_rng(seed)
    n = 9
    reading = np.sort(rng.uniform(0, 9.9, n))
    one = CalibrationData(reading, np.arange(1.0, n + 1), np.ones(n), np.ones(n), 10.0)
    data = CalibrationData.concatenate([one] * repeats).averaged()
    np.testing.assert_allclose(data.reading_nm, one.reading_nm, rtol=1e-14)
    np.testing.assert_allclose(data.standard_nm, one.standard_nm, rtol=1e-14)


def test_zeros_after_opposite_loads_are_no_repeats() -> None:
    torque = np.concatenate(
        [np.linspace(0, 50, 11), np.linspace(45, -50, 20), np.linspace(-45, 0, 10)]
    )
    rising = np.sign(np.diff(torque, prepend=-1.0))
    remanence = 0.05 * rising * (1.0 - np.abs(torque) / 50.0)
    series = np.ones(torque.size, dtype=int)
    data = CalibrationData(torque + remanence, torque, series, infer_branch(torque, series), 50.0)
    assert data.noise_floor() is None
    twice = CalibrationData.concatenate([data, data])
    noise = twice.noise_floor()
    assert noise is not None
    assert noise.degrees_of_freedom == len(data)
    assert noise.standard_deviation_nm == pytest.approx(0.0, abs=1e-12)
