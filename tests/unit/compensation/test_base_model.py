"""What all compensation models promise: columns, range, order of rows, names."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.support.draws import nightly
from tests.watching import Watching

from torquebench.compensation import (
    FEATURES,
    MODELS,
    CompensationModel,
    PolynomialModel,
    compile_table,
    feature_column,
    features,
    make_model,
)
from torquebench.compensation.kinds import NETWORKS
from torquebench.errors import InputError

READING = np.linspace(-100.0, 100.0, 25)
STANDARD = READING + 0.2 + 1e-3 * READING + 2e-5 * READING * np.abs(READING)
OTHER_NETWORKS = ("bayesian-network", "radial-basis")
ALL = sorted({*MODELS, *NETWORKS} - {"network"})
KINDS = [nightly(kind) if kind in OTHER_NETWORKS else kind for kind in ALL]
QuickModel = Callable[..., CompensationModel]


def chain_features(reading: np.ndarray) -> np.ndarray:
    return features(reading, branch=np.where(np.arange(reading.size) % 2, 1, -1))


@pytest.mark.parametrize("width", range(1, len(FEATURES) + 1))
def test_features_reach_to_the_last_given_column(width: int) -> None:
    given_columns = {FEATURES[width - 1]: 3.0} if width > 1 else {}
    X = features([1.0, 2.0], **given_columns)
    assert X.shape == (2, width)
    assert np.all(X[:, 1 : width - 1] == 0.0)


def test_a_column_of_another_length_is_refused_by_name() -> None:
    with pytest.raises(InputError, match="branch"):
        features([1.0, 2.0], branch=[1, -1, 1])


def test_branch_comes_back_as_sign_and_missing_columns_as_zeros() -> None:
    X = features([1.0, 2.0], branch=[5.0, -0.1])
    assert feature_column(X, "branch").tolist() == [1.0, -1.0]
    assert feature_column(X, "temperature_c").tolist() == [0.0, 0.0]


def test_names_lead_to_models_and_unknown_ones_to_a_list() -> None:
    assert make_model("polynomial-5").kind_parameters["degree"] == 5
    assert all(MODELS[kind].kind == kind for kind in MODELS)
    assert all(make_model(name).name == name for name in ALL if name != "polynomial")
    with pytest.raises(InputError, match="bayesian-network"):
        make_model("oracle")
    with pytest.raises(InputError, match="'degree'"):
        make_model("hybrid", degree=3)


@pytest.mark.parametrize("kind", KINDS)
def test_every_model_fits_a_smooth_chain_and_states_its_uncertainty(
    quick_model: QuickModel, kind: str
) -> None:
    X = chain_features(READING)
    model = quick_model(kind).fit(X, STANDARD)
    torque, std = model.predict(X, return_std=True)
    np.testing.assert_array_equal(torque, model.predict(X))
    np.testing.assert_allclose(model.additional_torque(X), torque - READING)
    assert np.max(np.abs(torque - STANDARD)) < 0.25  # the chain adds up to 0.5 N·m
    assert np.all(std > 0.0)
    assert model.noise_nm_ >= 0.0
    assert 1.0 < model.effective_parameters_ < READING.size
    assert model.points_ == READING.size
    freedom = READING.size - model.effective_parameters_
    assert model.degrees_of_freedom_ == pytest.approx(max(freedom, 1.0), rel=0.1)  # without noise
    assert model.complexity > 0


@pytest.mark.parametrize("kind", KINDS)
def test_the_order_of_the_rows_does_not_matter(quick_model: QuickModel, kind: str) -> None:
    X = chain_features(READING)
    order = np.random.default_rng(3).permutation(READING.size)
    expected = quick_model(kind).fit(X, STANDARD).predict(X, return_std=True)
    shuffled = quick_model(kind).fit(X[order], STANDARD[order]).predict(X, return_std=True)
    np.testing.assert_array_equal(expected, shuffled)


@pytest.mark.parametrize("kind", KINDS)
def test_fits_repeat_bit_for_bit(quick_model: QuickModel, kind: str) -> None:
    X = chain_features(READING)
    first, second = (
        quick_model(kind).fit(X, STANDARD).predict(X, return_std=True) for _ in range(2)
    )
    np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("kind", KINDS)
def test_readings_outside_the_calibrated_range_are_refused(
    quick_model: QuickModel, kind: str
) -> None:
    X = chain_features(READING)
    model = quick_model(kind).fit(X, STANDARD)
    model.predict(features([101.9, -101.9], branch=1))
    with pytest.raises(InputError, match=r"reading 102\.5 N·m \(row 1\)"):
        model.predict(features([0.0, 102.5], branch=1))


@given(margin=st.floats(0.0, 0.5), beyond=st.floats(1e-6, 10.0))
def test_the_margin_is_kept_exactly(margin: float, beyond: float) -> None:
    model = PolynomialModel(range_nm=100.0, range_margin=margin)
    model.fit_curve(READING[:, None], READING)
    limit = 100.0 + margin * 100.0
    model.predict([[limit], [-limit]])
    with pytest.raises(InputError, match="outside the calibrated range"):
        model.predict([[limit * (1.0 + beyond)]])


def test_a_direction_that_was_never_loaded_stays_refused() -> None:
    clockwise = READING[READING >= 0.0]
    model = PolynomialModel(range_nm=100.5).fit(clockwise[:, None], clockwise)
    model.predict([[102.0]])
    with pytest.raises(InputError, match=r"-2\.01 to 102\.51"):
        model.predict([[-20.0]])


@given(share=st.floats(0.001, 0.85))
def test_the_part_of_the_range_that_was_never_loaded_stays_refused(share: float) -> None:
    model = PolynomialModel(range_nm=100.0 / share).fit(READING[:, None], STANDARD)
    assert model.full_scale_nm_ == pytest.approx(100.0 / share)
    model.predict([[101.9], [-101.9]])
    with pytest.raises(InputError, match="-102 to 102"):
        model.predict([[103.0]])
    assert compile_table(model).reach_nm == pytest.approx(102.0)
    assert model.calibrated_nm == pytest.approx(100.0)


def test_a_declared_range_smaller_than_the_data_is_refused() -> None:
    with pytest.raises(InputError, match=r"100\.5 N·m"):
        PolynomialModel(range_nm=50.0).fit(READING[:, None], STANDARD)


def test_progress_reaches_the_end(quick_model: QuickModel) -> None:
    X = READING[:, None]
    for kind in ("published-network", "bayesian-network", "radial-basis"):
        watching = Watching()
        quick_model(kind).fit(X, STANDARD, progress=watching)
        assert watching.done == sorted(watching.done)
        assert watching.done[-1] == 100
        assert all(detail for _, detail in watching.reached)


def test_long_predictions_come_in_blocks_without_a_seam(quick_model: QuickModel) -> None:
    model = quick_model("polynomial-3").fit(READING[:, None], STANDARD)
    many = np.linspace(-100.0, 100.0, 20_001)[:, None]
    torque, std = model.predict(many, return_std=True)
    np.testing.assert_allclose(torque[8000:8400], model.predict(many[8000:8400]), rtol=1e-13)
    assert np.max(np.abs(np.diff(std))) < 1e-2
