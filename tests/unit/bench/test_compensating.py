import numpy as np
import pytest

from torquebench.bench.compensating import ActiveCompensation
from torquebench.compensation import MODELS, CompensationModel, features, make_model

FULL_SCALE_NM = 300.0
# The others go the same way; a Gaussian process takes many seconds to compile.
KINDS = ["bayesian-network", "hybrid", "physics", "polynomial", "radial-basis", "spline"]


def fitted(kind: str) -> CompensationModel:
    draw = np.random.default_rng(5)
    half = np.linspace(-FULL_SCALE_NM, FULL_SCALE_NM, 31)
    reading = np.concatenate((half, half[::-1]))
    branch = np.where(np.diff(np.abs(reading), append=FULL_SCALE_NM) > 0.0, 1, -1)
    extra = 1e-3 * reading + 0.6 * (reading / FULL_SCALE_NM) ** 2 + 0.05 * branch
    standard = reading + extra + draw.normal(0.0, 0.02, reading.size)
    return make_model(kind, range_nm=FULL_SCALE_NM).fit(features(reading, branch), standard)


@pytest.mark.parametrize("kind", KINDS)
def test_live_windows_get_what_the_model_says(kind: str) -> None:
    assert kind in MODELS
    model = fitted(kind)
    active = ActiveCompensation(model, "1", kind)
    assert active.table is not None
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
