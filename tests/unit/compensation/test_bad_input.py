"""Bad calibration data: each case gets one clear answer from every model."""

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.draws import nightly

from torquebench.compensation import (
    MODELS,
    CompensationModel,
    OutlierWarning,
    PointsReducedWarning,
    PolynomialModel,
    features,
)
from torquebench.compensation.checks import CalibrationPoints, find_outliers, reduce_points
from torquebench.compensation.kinds import NETWORKS
from torquebench.errors import InputError

QuickModel = Callable[..., CompensationModel]
OTHER_NETWORKS = ("bayesian-network", "radial-basis")
ALL = sorted({*MODELS, *NETWORKS} - {"network"})
KINDS = [nightly(kind) if kind in OTHER_NETWORKS else kind for kind in ALL]


def chain(
    seed: int = 0, steps: int = 13, noise: float = 0.4
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Up and down in both directions, with a reversal step, a bump and hysteresis."""
    up = np.linspace(0.0, 2000.0, steps)[1:]
    torque = np.concatenate([up, up[::-1], -up, -up[::-1]])
    branch = np.tile(np.repeat([1.0, -1.0], up.size), 2)
    additional = 1e-3 * torque + 1e-6 * torque * np.abs(torque) + 1.5 * np.tanh(torque / 30.0)
    additional += 0.8 * np.exp(-0.5 * ((torque - 900.0) / 120.0) ** 2)
    additional += 0.5 * branch * np.sign(torque) * (1.0 - np.abs(torque) / 2000.0)
    noise_nm = np.random.default_rng(seed).normal(0.0, noise, torque.size)
    return torque, torque + additional + noise_nm, branch


@pytest.mark.parametrize("kind", KINDS)
def test_too_few_points(quick_model: QuickModel, kind: str) -> None:
    with pytest.raises(InputError, match=r"1 sample .*at least \d"):
        quick_model(kind).fit([[1.0]], [1.0])
    with pytest.raises(InputError, match=r"2 samples .*at least \d"):
        quick_model(kind).fit([[1.0], [2.0]], [1.0, 2.0])
    with pytest.raises(InputError, match="2 distinct readings"):
        quick_model(kind).fit([[1.0], [2.0]] * 10, [1.0, 2.0] * 10)


@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_column(quick_model: QuickModel, kind: str) -> None:
    values = np.linspace(0.0, 1.0, 20)
    with pytest.raises(InputError, match="constant reading column: 5 N·m"):
        quick_model(kind).fit(np.full((20, 1), 5.0), values)
    with pytest.raises(InputError, match="constant standard column: 5 N·m"):
        quick_model(kind).fit(values[:, None], np.full(20, 5.0))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("value", "word"), [(np.nan, "NaN"), (np.inf, "infinity")])
def test_nan_and_infinity_are_named_by_column_and_row(
    quick_model: QuickModel, kind: str, value: float, word: str
) -> None:
    torque, standard, branch = chain()
    X = features(torque, branch=branch)
    X[3, 1] = value
    with pytest.raises(InputError, match=f"{word} in column branch, row 3"):
        quick_model(kind).fit(X, standard)
    standard[4] = value
    with pytest.raises(InputError, match=f"{word} in column standard, row 4"):
        quick_model(kind).fit(features(torque), standard)
    model = quick_model(kind).fit(features(torque), torque * 1.001)
    with pytest.raises(InputError, match=f"{word} in column reading_nm, row 1"):
        model.predict([[1.0], [value]])


def test_another_number_of_columns_is_refused() -> None:
    torque, standard, branch = chain()
    model = PolynomialModel().fit(features(torque, branch=branch), standard)
    with pytest.raises(InputError, match=r"1 features.*2 features"):
        model.predict([[1.0]])


@pytest.mark.parametrize("kind", KINDS)
def test_contradictory_duplicates_are_refused_with_their_values(
    quick_model: QuickModel, kind: str
) -> None:
    torque, standard, branch = chain()
    X = features(np.append(torque, 1000.0), branch=np.append(branch, 1.0))
    standard = np.append(standard, standard[5] + 60.0)
    found = r"reading 1000 N·m has .* 1064\.\d+ N·m"
    with pytest.raises(InputError, match=found):
        quick_model(kind).fit(X, standard)


@pytest.mark.parametrize("kind", KINDS)
def test_exact_duplicates_are_just_repeats(quick_model: QuickModel, kind: str) -> None:
    torque, standard, branch = chain()
    X = np.tile(features(torque, branch=branch), (2, 1))
    model = quick_model(kind).fit(X, np.tile(standard, 2))
    assert np.max(np.abs(model.predict(X) - np.tile(standard, 2))) < 6.0


@given(seed=st.integers(0, 10_000), row=st.integers(0, 47), size=st.floats(15.0, 2000.0))
def test_one_outlier_is_named(seed: int, row: int, size: float) -> None:
    torque, standard, branch = chain(seed)
    standard[row] += size
    X = features(torque, branch=branch, series=np.arange(48) // 24)
    points = CalibrationPoints(X, standard, np.arange(48)).sorted()
    _, outlying = find_outliers(points)
    assert row in [point.row for point in outlying]
    point = next(point for point in outlying if point.row == row)
    assert point.series == row // 24
    assert point.standard_nm == standard[row]
    assert point.residual_nm == pytest.approx(size, abs=4.0)
    assert f"row {row}: reading {torque[row]:.6g} N·m" in str(point)


@given(seed=st.integers(0, 10_000), noise=st.sampled_from([0.0, 0.02, 0.4, 2.0]))
def test_a_chain_with_step_bump_and_hysteresis_has_no_outliers(seed: int, noise: float) -> None:
    torque, standard, branch = chain(seed, noise=noise)
    for X in (features(torque), features(torque, branch=branch)):
        points = CalibrationPoints(X, standard, np.arange(torque.size)).sorted()
        assert find_outliers(points)[1] == []


@pytest.mark.parametrize("kind", KINDS)
def test_an_outlier_is_down_weighted_refused_or_kept_by_choice(
    quick_model: QuickModel, kind: str
) -> None:
    torque, standard, branch = chain()
    X = features(torque, branch=branch)
    clean = quick_model(kind).fit(X, standard).predict(X)
    standard[20] += 50.0
    with pytest.raises(InputError, match="outlier among the calibration points: series 0, row 20"):
        quick_model(kind, outliers="refuse").fit(X, standard)
    with pytest.warns(OutlierWarning, match="row 20"):
        model = quick_model(kind).fit(X, standard)
    assert [point.row for point in model.outliers_] == [20]
    others = np.arange(torque.size) != 20
    assert np.max(np.abs(model.predict(X) - clean)[others]) < 3.0
    kept = quick_model(kind, outliers="keep").fit(X, standard)
    assert kept.outliers_ == []


def test_several_outliers_are_all_named() -> None:
    torque, standard, branch = chain(steps=26)
    rows = [3, 40, 41, 90]
    standard[rows] += [30.0, -25.0, 40.0, 60.0]
    with pytest.raises(InputError, match="outlier") as refusal:
        PolynomialModel(outliers="refuse").fit(features(torque, branch=branch), standard)
    assert all(f"row {row}:" in str(refusal.value) for row in rows)


@pytest.mark.parametrize("kind", KINDS)
def test_repeats_without_any_noise_are_fitted(quick_model: QuickModel, kind: str) -> None:
    reading = np.repeat(np.linspace(-2000.0, 2000.0, 9), 12)
    standard = reading + 1.0 + 1e-3 * reading + 1.5e-6 * reading**2
    model = quick_model(kind).fit(features(reading), standard)
    torque_nm, std = model.predict(features(reading), return_std=True)
    assert np.all(np.isfinite(torque_nm))
    assert np.all(std >= 0.0)


@pytest.mark.parametrize("kind", KINDS)
def test_a_branch_missing_on_one_side_is_no_obstacle(quick_model: QuickModel, kind: str) -> None:
    torque, standard, branch = chain()
    keep = (torque > 0.0) | (branch > 0.0)
    X = features(torque, branch=branch)
    model = quick_model(kind).fit(X[keep], standard[keep])
    torque_nm, std = model.predict(X, return_std=True)
    assert np.all(np.isfinite(torque_nm))
    assert np.all(std > 0.0)


@pytest.mark.timeout(120)  # a bound on waiting, not a benchmark
@pytest.mark.parametrize("kind", KINDS)
def test_a_hundred_thousand_points_are_averaged_with_a_warning(
    quick_model: QuickModel, kind: str
) -> None:
    generator = np.random.default_rng(0)
    reading = generator.uniform(-2000.0, 2000.0, 100_000)
    branch = generator.choice([-1.0, 1.0], reading.size)
    standard = reading + 1e-3 * reading + 1e-6 * reading * np.abs(reading) + 0.3 * branch
    standard += generator.normal(0.0, 0.4, reading.size)
    X = features(reading, branch=branch)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = quick_model(kind).fit(X, standard)
    reduced = [str(w.message) for w in caught if w.category is PointsReducedWarning]
    assert len(reduced) == (model.maximum_points is not None)
    assert all(text.startswith("100000 calibration points averaged") for text in reduced)
    assert model.points_ == 100_000
    error = model.predict(X[:500]) - standard[:500]
    assert np.sqrt(np.mean(error**2)) < 0.8


def test_averaging_keeps_branches_apart_and_information_whole() -> None:
    generator = np.random.default_rng(1)
    reading = generator.uniform(-100.0, 100.0, 20_000)
    branch = generator.choice([-1.0, 1.0], reading.size)
    y = 2.0 * reading + 5.0 * branch
    points = CalibrationPoints(features(reading, branch=branch), y, np.arange(y.size)).sorted()
    weights = np.ones(y.size)
    with pytest.warns(PointsReducedWarning, match="20000 calibration points averaged to"):
        few, total = reduce_points(points, weights, 400, ("reading_nm", "branch"))
    assert few.y.size <= 400
    assert total.sum() == pytest.approx(20_000.0)
    np.testing.assert_allclose(few.y, 2.0 * few.reading + 5.0 * few.X[:, 1], atol=1e-9)
    assert np.all(np.diff(few.reading) >= 0.0)
    with pytest.warns(PointsReducedWarning):
        mixed, _ = reduce_points(points, weights, 400, ("reading_nm",))
    assert np.all(np.abs(mixed.X[:, 1]) < 0.9)
    same, unchanged = reduce_points(points, weights, None, ("reading_nm",))
    assert same is points
    assert unchanged is weights


def test_temperature_is_kept_apart_only_where_a_model_looks_at_it() -> None:
    generator = np.random.default_rng(2)
    X = features(
        generator.uniform(-1.0, 1.0, 5000),
        branch=1,
        series=generator.integers(0, 3, 5000),
        speed_rpm=0.0,
        temperature_c=generator.uniform(15.0, 35.0, 5000),
    )
    points = CalibrationPoints(X, X[:, 0], np.arange(5000)).sorted()
    looks = ("reading_nm", "branch", "series", "speed_rpm", "temperature_c")
    with pytest.warns(PointsReducedWarning):
        apart, _ = reduce_points(points, np.ones(5000), 100, looks)
    with pytest.warns(PointsReducedWarning):
        together, _ = reduce_points(points, np.ones(5000), 100, ("reading_nm",))
    assert np.ptp(apart.X[:, 4]) > 15.0 > np.ptp(together.X[:, 4])


def test_steps_that_stand_close_together_stay_apart_where_points_are_averaged() -> None:
    generator = np.random.default_rng(3)
    close, far = np.arange(0.0, 1.0, 0.05), np.arange(1.0, 20.0, 1.0)
    reading = np.repeat(np.concatenate([close, far]), 16)
    reading = reading + generator.normal(0.0, 1e-3, reading.size)
    points = CalibrationPoints(reading[:, None], reading, np.arange(reading.size)).sorted()
    with pytest.warns(PointsReducedWarning):
        few, _ = reduce_points(points, np.ones(reading.size), 160, ("reading_nm",))
    assert few.y.size <= 160
    missed = np.abs(few.reading[:, None] - close).min(axis=0)
    assert np.all(missed < 5e-3)  # in bins of equal width four of them were one
