from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from torquebench.bench.compensating import ActiveCompensation
from torquebench.compensation import MODELS, CompensationModel, features, make_model

FULL_SCALE_NM = 300.0
SINGLE_CURVE = ["bayesian-network", "polynomial", "radial-basis", "spline"]
WITH_BRANCHES = ["gaussian-process", "hybrid", "physics"]


def fitted(kind: str) -> CompensationModel:
    draw = np.random.default_rng(5)
    half = np.linspace(-FULL_SCALE_NM, FULL_SCALE_NM, 31)
    reading = np.concatenate((half, half[::-1]))
    branch = np.where(np.diff(np.abs(reading), append=FULL_SCALE_NM) > 0.0, 1, -1)
    extra = 1e-3 * reading + 0.6 * (reading / FULL_SCALE_NM) ** 2 + 0.05 * branch
    standard = reading + extra + draw.normal(0.0, 0.02, reading.size)
    return make_model(kind, range_nm=FULL_SCALE_NM).fit(features(reading, branch), standard)


@pytest.mark.parametrize("kind", SINGLE_CURVE)
def test_live_windows_get_what_the_model_says(kind: str) -> None:
    assert kind in MODELS
    model = fitted(kind)
    active = ActiveCompensation(model, "1", kind)
    assert active.table is not None
    assert active.history is None
    reading = np.random.default_rng(1).uniform(-FULL_SCALE_NM, FULL_SCALE_NM, 200)
    reading[0] = 0.0
    found = active.samples(reading, 3.0, 23.0)
    rows = features(reading, 0, 0, 3.0, 23.0)[:, : model.n_features_in_]
    torque_nm, uncertainty_nm = model.predict(rows, return_std=True)
    allowed = 1e-6 * FULL_SCALE_NM
    np.testing.assert_allclose(found.torque_nm, torque_nm, rtol=0.0, atol=allowed)
    np.testing.assert_allclose(found.standard_uncertainty_nm, uncertainty_nm, 0.0, allowed)
    one = active.value(float(reading[7]), 3.0, 23.0)
    assert one == pytest.approx((torque_nm[7], uncertainty_nm[7]))


@pytest.mark.parametrize("kind", ["polynomial", "hybrid"])
def test_a_ripple_is_rectified_where_the_curve_bends(kind: str) -> None:
    active = ActiveCompensation(fitted(kind), "1", kind)
    ripple = 60.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False))
    for mean in (-120.0, 150.0):
        # The mean of a square is the square of the mean and half that of the amplitude.
        truth = 0.6 * 0.5 * (60.0 / FULL_SCALE_NM) ** 2
        found = active.rectified_nm(mean + ripple, 3.0, 23.0)
        assert found == pytest.approx(truth, rel=0.35)
        of_mean = active.model.predict(features([mean], 0)[:, : active.model.n_features_in_])
        rows = features(mean + ripple, 0)[:, : active.model.n_features_in_]
        assert of_mean[0] + found == pytest.approx(active.model.predict(rows).mean(), abs=1e-9)
    assert active.rectified_nm(np.full(9, 150.0), 3.0, 23.0) == pytest.approx(0.0, abs=1e-9)
    assert active.rectified_nm(FULL_SCALE_NM - 1.0 + ripple, 3.0, 23.0) == 0.0


@cache
def loop_model(kind: str) -> CompensationModel:
    """A chain whose loop is ten times its noise, calibrated up and down in both directions."""
    draw, steps = np.random.default_rng(6), 13
    size = np.concatenate((np.linspace(0.04, 1.0, steps), np.linspace(0.98, 0.02, steps)))
    side, up = np.repeat([1.0, -1.0], 2 * steps), np.tile(np.repeat([1.0, -1.0], steps), 2)
    u = side * np.tile(size, 2)
    extra = 1e-3 * u + 2e-3 * u * np.abs(u) + side * up * LOOP * (1.0 - np.abs(u))
    reading = FULL_SCALE_NM * u
    standard = reading + FULL_SCALE_NM * (extra + draw.normal(0.0, 1e-4, u.size))
    model = make_model(kind, range_nm=FULL_SCALE_NM)
    return model.fit(features(reading, up, np.where(side > 0, 1, 2)), standard)


LOOP = 1e-3


def ramp(*turning_points: float) -> np.ndarray:
    legs = [np.linspace(start, stop, 200) for start, stop in pairwise(turning_points)]
    return FULL_SCALE_NM * np.concatenate(legs)


@pytest.mark.parametrize("kind", WITH_BRANCHES)
def test_the_branch_of_live_windows_follows_from_those_before(kind: str) -> None:
    model = loop_model(kind)
    active = ActiveCompensation(model, "1", kind)
    assert active.history is not None
    path = ramp(0.0, 1.0, 0.0, 1.0, 0.0)
    blocks = [active.samples(block, 0.0, 23.0) for block in np.array_split(path, 80)]
    torque = np.concatenate([block.torque_nm for block in blocks])
    std = np.concatenate([block.standard_uncertainty_nm for block in blocks])
    for leg, branch in ((2, 1), (3, -1)):
        middle = slice(200 * leg + 60, 200 * leg + 140)
        rows = features(path[middle], branch, 1)[:, : model.n_features_in_]
        expected, own_std = model.predict(rows, return_std=True)
        wrong = model.predict(features(path[middle], -branch, 1)[:, : model.n_features_in_])
        away = np.abs(torque[middle] - expected)
        assert np.max(away / np.abs(wrong - expected)) < 0.25
        assert np.median(std[middle]) < 2.0 * np.median(own_std)
    assert std[1] > 1.5 * std[401]  # nothing was known of the past


def test_a_fault_a_gap_and_the_start_make_the_past_unknown() -> None:
    active = ActiveCompensation(loop_model("hybrid"), "1", "hybrid")
    path = ramp(0.0, 1.0, 0.0, 1.0, 0.5)
    time_s = 1e-3 * np.arange(path.size + 10)

    def known(samples: int = path.size) -> None:
        active.forget()
        active.samples(path[:samples], 0.0, 23.0, time_s[:samples])

    here = path[-1:].repeat(10)
    known()
    quiet = active.samples(here, 0.0, 23.0, time_s[path.size :]).standard_uncertainty_nm
    known()
    after_gap = active.samples(here, 0.0, 23.0, 1.0 + time_s[path.size :]).standard_uncertainty_nm
    known()
    broken = here.copy()
    broken[4] = np.nan
    after_fault = active.samples(broken, 0.0, 23.0, time_s[path.size :])
    active.forget()
    at_start = active.samples(here, 0.0, 23.0).standard_uncertainty_nm
    assert np.all(after_gap > 1.5 * quiet)
    np.testing.assert_allclose(after_gap, at_start)
    np.testing.assert_allclose(after_fault.standard_uncertainty_nm[:4], quiet[:4])
    assert np.isnan(after_fault.torque_nm[4])
    assert np.all(after_fault.standard_uncertainty_nm[5:] > 1.5 * quiet[5:])


def test_a_steady_value_is_taken_where_the_stream_stands_and_moves_nothing() -> None:
    active = ActiveCompensation(loop_model("hybrid"), "1", "hybrid")
    active.warm_up()
    half = FULL_SCALE_NM / 2
    _, unknown = active.value(half, 0.0, 23.0)
    active.samples(ramp(0.0, 1.0, 0.0, 0.5), 0.0, 23.0)
    rising, known = active.value(half, 0.0, 23.0)
    assert (rising, known) == active.value(half, 0.0, 23.0)
    active.samples(ramp(0.5, 1.0, 0.5), 0.0, 23.0)
    falling, _ = active.value(half, 0.0, 23.0)
    assert rising - falling == pytest.approx(LOOP * FULL_SCALE_NM, rel=0.3)
    assert unknown > 1.5 * known
    assert active.samples(np.zeros(0), 0.0, 23.0, np.zeros(0)).torque_nm.size == 0


def test_faults_and_readings_beyond_the_range_get_no_number() -> None:
    active = ActiveCompensation(fitted("polynomial"), "1", "polynomial")
    reading = np.array([np.nan, 10.0, 2.0 * FULL_SCALE_NM, -np.inf])
    found = active.samples(reading, 0.0, 23.0)
    for values in (found.torque_nm, found.standard_uncertainty_nm):
        assert np.isnan(values).tolist() == [True, False, True, True]
    assert active.samples(reading[:0], 0.0, 23.0).torque_nm.size == 0


class Warm(MODELS["polynomial"]):  # type: ignore[name-defined,misc]
    """A model that looks at the temperature."""

    used_features = ("reading_nm", "temperature_c")


class Stepped(MODELS["polynomial"]):  # type: ignore[name-defined,misc]
    """A model that jumps where no table may."""

    def _predict(self, X, return_std):  # type: ignore[no-untyped-def]
        torque, deviation = super()._predict(X, return_std)
        return torque + (X[:, 0] > 33.3), deviation


@pytest.mark.parametrize("kind", [Warm, Stepped])
def test_a_model_without_a_table_is_asked_itself(kind: type[CompensationModel]) -> None:
    reading = np.linspace(-FULL_SCALE_NM, FULL_SCALE_NM, 61)
    rows = features(reading, 0, 0, 0.0, 23.0)
    model = kind(range_nm=FULL_SCALE_NM).fit(rows, 1.001 * reading)
    active = ActiveCompensation(model, "1", "own")
    assert active.table is None
    found = active.samples(reading, 0.0, 23.0)
    torque_nm, uncertainty_nm = model.predict(rows, return_std=True)
    np.testing.assert_array_equal(found.torque_nm, torque_nm)
    np.testing.assert_array_equal(found.standard_uncertainty_nm, uncertainty_nm)
    assert np.isnan(active.samples(reading, 0.0, np.nan).torque_nm).all()
