"""Selection: folds that never leak, the noise floor, the one-standard-error rule, its table."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.draws import nightly
from tests.watching import Watching

from torquebench.compensation import (
    Comparison,
    PolynomialModel,
    RadialBasisModel,
    compare,
    features,
    noise_floor,
    repeat_groups,
)
from torquebench.compensation.repeats import spread_folds
from torquebench.errors import InputError

STEPS = np.linspace(-2000.0, 2000.0, 21)
FAST = ("polynomial-1", "polynomial-2", "polynomial-3", "polynomial-12")


def quadratic(reading: np.ndarray) -> np.ndarray:
    return reading + 1.0 + 1e-3 * reading + 1.5e-6 * reading**2


def repeated(seed: int, repeats: int = 2, noise: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    reading = np.tile(STEPS, repeats) + generator.normal(0.0, 0.5, repeats * STEPS.size)
    return reading[:, None], quadratic(reading) + generator.normal(0.0, noise, reading.size)


@pytest.mark.nightly
def test_a_form_that_fits_is_never_called_worse() -> None:
    scores = [compare(*repeated(seed), FAST).score("polynomial-2") for seed in range(6)]
    assert sum("worse" not in score.reason for score in scores) >= 5


def test_a_better_model_wins_over_a_simpler_one() -> None:
    X, y = repeated(0)
    y = y + 1.5 * np.sin(X[:, 0] / 250.0)
    comparison = compare(X, y, FAST)
    assert comparison.best == "polynomial-12"
    assert "standard errors worse than polynomial-12" in comparison.score("polynomial-2").reason


def test_the_table_states_each_error_in_three_ways_and_a_reason() -> None:
    X, y = repeated(1)
    comparison = compare(X, y, FAST, range_nm=2000.0)
    assert [score.name for score in comparison.scores] == list(FAST)
    for score in comparison.scores:
        assert score.worst_percent_fs == pytest.approx(score.worst_nm / 20.0)
        assert score.rms_percent_fs == pytest.approx(score.rms_nm / 20.0)
        assert score.rms_nm <= score.worst_nm
        assert score.worst_averaged_nm <= score.worst_nm
        assert score.worst_percent_reading < 100.0 * score.worst_nm / 100.0  # from 5 % FS
        assert score.fit_time_s > 0.0
        assert score.reason
    best = min(comparison.scores, key=lambda score: score.rms_nm)
    assert (comparison.best, best.reason) == (best.name, "least error at points left out")
    assert comparison.models[best.name].full_scale_nm_ == 2000.0


def test_errors_are_those_at_points_that_were_left_out() -> None:
    X, y = (values[np.tile(np.arange(STEPS.size) % 3 == 0, 2)] for values in repeated(2))
    comparison = compare(X, y, ["polynomial-2"], folds=5)
    groups = repeat_groups(X[:, 0])
    errors = []
    for step in range(1, 6):  # the outermost steps are never left out
        here = groups == step
        model = PolynomialModel(range_nm=float(np.max(np.abs(X)))).fit(X[~here], y[~here])
        errors.extend(model.predict(X[here]) - y[here])
    assert comparison.score("polynomial-2").rms_nm == pytest.approx(
        np.sqrt(np.mean(np.square(errors))), rel=1e-9
    )
    assert (comparison.folds, comparison.steps, comparison.points) == (5, 7, 10)


@given(steps=st.integers(5, 80), repeats=st.integers(1, 4), folds=st.integers(2, 20))
def test_folds_keep_repeats_together_and_ends_in(steps: int, repeats: int, folds: int) -> None:
    step = np.tile(np.arange(steps), repeats)
    fold, count = spread_folds(step, folds)
    assert set(fold) == set(range(-1, count))
    assert all(np.unique(fold[step == number]).size == 1 for number in range(steps))
    assert np.all((fold == -1) == ((step == 0) | (step == steps - 1)))
    inner = fold[1 : steps - 1]
    if count > 1:
        assert np.all(inner[1:] != inner[:-1])  # neighbours stay in


@given(seed=st.integers(0, 1000), repeats=st.integers(1, 4))
def test_steps_are_found_whatever_the_order(seed: int, repeats: int) -> None:
    generator = np.random.default_rng(seed)
    true_step = generator.permutation(np.tile(np.arange(STEPS.size), repeats))
    reading = STEPS[true_step] + generator.uniform(-1.0, 1.0, true_step.size)
    np.testing.assert_array_equal(repeat_groups(reading), true_step)


def test_a_ramp_without_steps_is_cut_evenly() -> None:
    group = repeat_groups(np.linspace(0.0, 100.0, 5000))
    assert group.max() == 49
    assert np.all(np.bincount(group) >= 90)


def test_the_noise_floor_comes_from_repeats_of_the_same_branch() -> None:
    generator = np.random.default_rng(0)
    reading, branch = np.tile(STEPS, 8), np.repeat([1, -1], 4 * STEPS.size)
    hysteresis = 1.0 * branch
    standard = quadratic(reading) + hysteresis + generator.normal(0.0, 0.3, reading.size)
    known = noise_floor(features(reading, branch=branch), standard)
    assert known is not None
    assert known.degrees_of_freedom == reading.size - 2 * STEPS.size
    assert known.standard_deviation_nm == pytest.approx(0.3, rel=0.15)
    unknown = noise_floor(reading[:, None], standard)
    assert unknown is not None
    assert unknown.standard_deviation_nm > 0.8
    assert noise_floor(STEPS[:, None], quadratic(STEPS)) is None


def test_an_outlier_is_named_and_not_scored() -> None:
    X, y = repeated(3)
    y[7] += 40.0
    comparison = compare(X, y, FAST)
    assert [point.row for point in comparison.outliers] == [7]
    assert comparison.score("polynomial-2").worst_nm < 2.0


def test_a_candidate_that_refuses_the_data_is_listed_with_its_words() -> None:
    X, y = repeated(4, repeats=1)
    comparison = compare(X, y, ["polynomial-2", "polynomial-25"])
    assert "at least 27" in comparison.refused["polynomial-25"]
    assert comparison.best == "polynomial-2"
    with pytest.raises(InputError, match="no candidate"):
        compare(X, y, ["polynomial-25"])


def test_own_models_under_own_names() -> None:
    X, y = repeated(5)
    mine = {"stiff": RadialBasisModel(swarm_steps=5), "curve": PolynomialModel(degree=2)}
    comparison = compare(X, y, mine)
    assert isinstance(comparison, Comparison)
    assert set(comparison.models) == set(mine)
    assert not hasattr(mine["stiff"], "network_")  # copies are fitted


def test_progress_goes_from_model_to_model() -> None:
    watching = Watching()
    compare(*repeated(6), FAST, progress=watching)
    assert watching.done == sorted(watching.done)
    assert watching.done[-1] == 100
    assert watching.reached[0][1].startswith("polynomial-1, fold 1 of")


@pytest.mark.parametrize(
    ("X", "y", "message"),
    [
        (np.ones((3, 1)), np.ones(4), "4 standard values"),
        (np.array([[1.0], [np.nan], [2.0]]), np.ones(3), "row 1"),
        (STEPS[:4, None], STEPS[:4], "4 different steps"),
    ],
)
def test_bad_tables_are_refused(X: np.ndarray, y: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        compare(X, y, FAST)


def test_groups_must_be_one_for_each_point() -> None:
    X, y = repeated(7)
    with pytest.raises(InputError, match="groups"):
        compare(X, y, FAST, groups=[0, 1])
    by_hand = compare(X, y, FAST, groups=np.tile(np.arange(21), 2))
    assert (
        by_hand.score("polynomial-12").rms_nm == compare(X, y, FAST).score("polynomial-12").rms_nm
    )


@pytest.mark.parametrize("repeats", [1, nightly(12)])
def test_without_noise_rounding_does_not_choose(repeats: int) -> None:
    reading = np.repeat(np.linspace(-2000.0, 2000.0, 11), repeats)
    exact = compare(reading[:, None], quadratic(reading), [*FAST, "hybrid"])
    assert "worse" not in exact.score("polynomial-2").reason
    assert not exact.caution


def test_few_steps_are_said_and_call_nothing_worse_by_luck() -> None:
    reading = np.repeat(np.linspace(-2000.0, 2000.0, 5), 4)
    selected = []
    for seed in range(6):
        noise = np.random.default_rng(seed).normal(0.0, 0.3, reading.size)
        comparison = compare(reading[:, None], quadratic(reading) + noise, FAST)
        assert comparison.caution.startswith("only 3 steps")
        selected.append("worse" not in comparison.score("polynomial-2").reason)
    assert selected.count(True) >= 4


def test_an_outlier_is_kept_or_refused_by_choice() -> None:
    X, y = repeated(3)
    y[9] += 30.0
    assert [point.row for point in compare(X, y, FAST).outliers] == [9]
    kept = compare(X, y, FAST, outliers="keep")
    assert not kept.outliers
    assert kept.points == compare(X, y, FAST).points + 1
    with pytest.raises(InputError, match="outlier among the calibration points"):
        compare(X, y, FAST, outliers="refuse")


def test_points_that_no_model_takes_are_refused_once() -> None:
    X, y = repeated(4)
    contradictory = np.vstack([X, X[5]]), np.append(y, y[5] + 50.0)
    with pytest.raises(InputError, match="contradictory") as refusal:
        compare(*contradictory, FAST)
    assert str(refusal.value).count("contradictory") == 1
    with pytest.raises(InputError, match="constant reading column"):
        compare(np.full((9, 1), 5.0), np.arange(9.0), FAST)
