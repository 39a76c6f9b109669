import json

import numpy as np
import pytest
from tests.support.chains import Chain, Noise, Term, known_form, make_chain
from tests.support.draws import nightly

from torquebench.compensation import (
    CompensationModel,
    HybridModel,
    PointsReducedWarning,
    StoredModel,
    features,
    load_model,
    save_model,
)
from torquebench.compensation.hybrid.calibration_path import path_clock
from torquebench.compensation.model_file import Provenance

LINEAR = tuple(Term("power", 3e-3, (side, 1.0), 1) for side in (1.0, -1.0))


def rms_error(model: CompensationModel, chain: Chain) -> float:
    """Error over the dense range in fractions of full scale."""
    dense = chain.dense()
    error = model.predict(dense.X) - dense.torque_nm
    return float(np.sqrt(np.mean(error**2))) / chain.range_nm


def fitted(chain: Chain, points: int = 50) -> HybridModel:
    data = chain.calibration(points)
    return HybridModel(range_nm=chain.range_nm).fit(data.X, data.standard_nm)


def test_ripple_is_recognised_where_it_is_and_only_there() -> None:
    ripple = (Term("sine", 4e-4, (0.3, 0.0)),)
    for terms, low, high in ((ripple, 0.97, 1.0), ((), 0.0, 0.5)):
        present = fitted(Chain("", 1, LINEAR + terms, Noise(scale=1e-4)), 100).present_
        assert low <= present["ripple"] <= high, present


@pytest.mark.parametrize(
    "term",
    [
        Term("sine", 4e-4, (0.3, 0.0)),
        Term("smooth-step", 8e-4, (0.01,)),
        Term("loop", 6e-4, (1.0, 1.0)),
        Term("bump", 9e-4, (0.4, 0.08)),
    ],
    ids=lambda term: term.shape,
)
def test_each_structure_is_followed(term: Term) -> None:
    chain = Chain("", 1, (*LINEAR, term), Noise(scale=1e-4))
    assert rms_error(fitted(chain, 100), chain) < 6e-5


def test_a_drift_of_the_zero_is_left_out_of_the_curve() -> None:
    still = Chain("", 5, LINEAR, Noise(scale=5e-5))
    drifting = Chain("", 5, LINEAR, Noise(scale=5e-5, drift=8e-4))
    assert rms_error(fitted(still, 100), still) < 4e-5
    assert rms_error(fitted(drifting, 100), drifting) < 1.5e-4


def test_a_relaxing_zero_is_left_out_and_makes_the_curve_less_certain() -> None:
    still = Chain("", 5, LINEAR, Noise(scale=5e-5))
    relaxing = Chain("", 5, LINEAR, Noise(scale=5e-5, drift=6e-4, lag=0.2))
    model = fitted(relaxing, 100)
    assert rms_error(model, relaxing) < 2e-4  # a curve that holds all of it is off by 4e-4
    dense = still.dense(100).X
    doubts = [m.predict(dense, return_std=True)[1].mean() for m in (model, fitted(still, 100))]
    assert doubts[0] > 1.3 * doubts[1]


@pytest.mark.nightly
def test_scatter_follows_noise_that_grows_with_the_load() -> None:
    at = np.array([100.0, 1900.0])
    growing, even = (
        np.mean(
            [fitted(Chain("", seed, LINEAR, noise), 200).scatter_at(at) for seed in range(2)], 0
        )
        for noise in (Noise(growth=6.0), Noise())
    )
    truth = Noise(growth=6.0).relative(at / 2000.0)
    assert growing[1] / growing[0] == pytest.approx(truth[1] / truth[0], rel=0.4)
    assert even[1] / even[0] == pytest.approx(1.0, abs=0.15)


def test_outlier_readings_are_outvoted() -> None:
    outlying = Chain("", 9, LINEAR, Noise(outliers=0.08))
    ratio = []
    for repeat in range(4):
        data = outlying.calibration(80, repeat)
        model = HybridModel(range_nm=2000, outliers="keep").fit(data.X, data.standard_nm)
        ratio.append(model.noise_nm_ / 2000 / outlying.noise.scale)
    # The scale of the many good readings, not of all: the core is 0.62 of the standard deviation.
    assert np.median(ratio) < 0.85


def test_one_direction_alone_is_fitted_and_the_other_refused() -> None:
    chain = make_chain("reference", 3)
    data = chain.calibration(60)
    mine = data.standard_nm >= 0
    model = HybridModel().fit(data.X[mine], data.standard_nm[mine])
    dense = chain.dense()
    inside = dense.torque_nm > 20
    error = model.predict(dense.X[inside]) - dense.torque_nm[inside]
    assert np.sqrt(np.mean(error**2)) < 0.5
    with pytest.raises(ValueError, match="outside the calibrated range"):
        model.predict([[-500.0, 1.0, 1.0]])


def test_rising_series_leave_the_falling_branch_in_doubt() -> None:
    chain = make_chain("reference", 8)
    data = chain.calibration(80)
    rising = data.X[:, 1] > 0
    both = HybridModel(range_nm=2000).fit(data.X, data.standard_nm)
    model = HybridModel(range_nm=2000).fit(data.X[rising], data.standard_nm[rising])
    at = features(np.linspace(200, 1500, 20), np.full(20, -1), np.ones(20))
    _, doubt = model.predict(at, return_std=True)
    _, known = both.predict(at, return_std=True)
    assert np.mean(doubt) > 1.3 * np.mean(known)


def test_without_a_branch_column_intervals_hold_both_branches() -> None:
    inside = []
    for seed in range(6):
        chain = make_chain("reference", seed)
        data, dense = chain.calibration(60), chain.dense()
        model = HybridModel(range_nm=2000).fit(data.X[:, :1], data.standard_nm)
        torque, std = model.predict(dense.X[:, :1], return_std=True)
        inside.append(np.mean(np.abs(torque - dense.torque_nm) < 1.96 * std))
    assert 0.9 < np.mean(inside) <= 1.0


def test_an_unknown_branch_is_the_middle_of_both_and_less_certain() -> None:
    model = fitted(make_chain("reference", 8))
    at = np.linspace(-1900, 1900, 39)
    up, down, middle = (features(at, np.full(39, b), np.ones(39)) for b in (1, -1, 0))
    half = 0.5 * (model.predict(up) - model.predict(down))
    torque, std = model.predict(middle, return_std=True)
    np.testing.assert_allclose(torque, model.predict(up) - half, atol=1e-9)
    assert np.all(std >= np.abs(half))


@pytest.mark.parametrize("factor", [1e-3, nightly(0.37), nightly(1e3)])
def test_the_unit_of_torque_does_not_matter(factor: float) -> None:
    data = make_chain("power-law", 7).calibration(40)
    scaled = data.X.copy()
    scaled[:, 0] *= factor
    one = HybridModel().fit(data.X, data.standard_nm)
    other = HybridModel().fit(scaled, factor * data.standard_nm)
    for value, wanted in zip(
        other.predict(scaled, return_std=True), one.predict(data.X, return_std=True), strict=True
    ):
        np.testing.assert_allclose(value, factor * wanted, rtol=1e-5, atol=2e-5 * factor)


def test_the_model_file_gives_it_back_bit_for_bit(tmp_path) -> None:
    model = fitted(make_chain("rippled", 4))
    path = save_model(tmp_path / "model.json", StoredModel(model, Provenance(2000.0)))
    again = load_model(path).model
    dense = make_chain("rippled", 4).dense(60)
    for one, other in zip(
        model.predict(dense.X, return_std=True),
        again.predict(dense.X, return_std=True),
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)
    assert len(json.dumps(model.get_state())) < 60_000


def test_many_points_are_averaged_and_named() -> None:
    chain = make_chain("quadratic", 1)
    data = chain.calibration(900)
    with pytest.warns(PointsReducedWarning):
        model = HybridModel(range_nm=2000).fit(data.X, data.standard_nm)
    assert rms_error(model, chain) < 4e-5


def test_a_gross_offset_is_learned_although_the_zero_was_taken() -> None:
    chain = Chain("", 3, (*LINEAR, Term("offset", 6e-4)), Noise(scale=5e-5))
    assert rms_error(fitted(chain, 80), chain) < 8e-5


@pytest.mark.nightly
def test_a_curve_begins_at_the_zero_that_its_readings_count_from() -> None:
    """It had the offset that fits the loaded points best, so that an unloaded chain read it.

    When the members were conditioned on the zero, the error at loaded points grew by a sixth.
    """
    terms = (*LINEAR, Term("smooth-step", 4e-4, (0.01,)), Term("loop", 4e-4, (1.0, 1.0)))
    near, far = [], []
    for seed in range(4):
        chain = Chain("", seed, terms, Noise(scale=2e-4))
        data, dense = chain.calibration(50), chain.dense()
        models = [HybridModel(range_nm=chain.range_nm, zeroed=zeroed) for zeroed in (False, True)]
        for model in models:
            model.fit(data.X, data.standard_nm)
        free, zeroed = (float(model.predict(features([0.0], 0.0, 1.0))[0]) for model in models)
        assert abs(zeroed) < 1e-9 * chain.range_nm < abs(free)
        free, zeroed = (model.predict(dense.X) for model in models)
        loaded = np.abs(dense.X[:, 0]) > 0.08 * chain.range_nm
        far.append(np.max(np.abs(free - zeroed)[loaded]) / chain.range_nm)
        errors = np.array([free, zeroed])[:, ~loaded] - dense.torque_nm[~loaded]
        near.append(np.sqrt(np.mean(errors**2, axis=1)))
    assert max(far) < 1e-9
    free, zeroed = np.mean(near, axis=0)
    assert zeroed < free


# ---- the path as a clock ----------------------------------------------------------------------


def test_the_clock_follows_the_path_through_directions_and_series() -> None:
    u = np.array([0.5, 1.0, 0.5, -0.5, -1.0, -0.5])
    branch = np.array([1.0, 1, -1, 1, 1, -1])
    elapsed = path_clock(u, branch, np.array([1.0, 1, 1, 2, 2, 2]))
    np.testing.assert_allclose(elapsed, np.array([0.25, 0.5, 0.75, 1.25, 1.5, 1.75]) / 2)


def test_a_reading_next_to_zero_makes_no_direction_of_its_own() -> None:
    u = np.array([0.5, 1.0, 0.5, -0.0005])
    assert path_clock(u, np.array([1.0, 1, -1, -1]), np.zeros(4))[-1] == pytest.approx(
        1.0, abs=1e-3
    )


def test_an_unknown_branch_stops_the_clock() -> None:
    assert path_clock(np.array([0.5, 0.6]), np.array([1.0, 0.0]), np.zeros(2)).size == 0


def test_a_narrow_reversal_step_is_found_where_torques_lie_on_its_slope() -> None:
    """Closely spaced widths: 0.55 % lies between the coarse ones of 0.4 and 1 %."""
    rng = np.random.default_rng(4)
    rising = np.array([0.001, 0.002, 0.003, 0.004, 0.006, 0.008, 0.01, 0.02, 0.05, 0.1, 0.2, 0.3])
    cycle = np.concatenate([rising, rising[::-1], -rising, -rising[::-1]])
    u = np.tile(cycle, 3)
    branch = np.tile(np.repeat([1.0, -1.0, 1.0, -1.0], rising.size), 3)

    def added(share: np.ndarray) -> np.ndarray:
        return np.asarray(1e-3 * np.tanh(share / 0.0055) + 3e-3 * share)

    truth = u + added(u)
    reading = 50.0 * (u + 2e-5 * rng.standard_normal(u.size))
    model = HybridModel(range_nm=50.0).fit(np.column_stack([reading, branch]), 50.0 * truth)
    small = np.array([-0.003, -0.0015, 0.0015, 0.003])
    found = model.predict(np.column_stack([50.0 * small, np.zeros(4)]))
    np.testing.assert_allclose(found, 50.0 * (small + added(small)), atol=1.5e-3)


@pytest.mark.nightly
def test_a_plain_quadratic_is_recognised_as_one() -> None:
    """Errors are those of the three constants, not of all that a chain might have shown."""
    ratios, inside = [], []
    for seed in range(6):
        chain = make_chain("plain", seed)
        data, dense = chain.calibration(50), chain.dense(100)
        model = HybridModel(range_nm=chain.range_nm).fit(data.X, data.standard_nm)
        torque, std = model.predict(dense.X, return_std=True)
        bound = known_form(chain, data).predict(dense.X) - dense.torque_nm
        error = torque - dense.torque_nm
        ratios.append(np.sqrt(np.mean(error**2) / np.mean(bound**2)))
        inside.append(np.mean(np.abs(error) < 1.96 * std))
    assert np.median(ratios) < 1.3  # 1.7 without plain forms
    assert np.mean(inside) > 0.8
