"""The uncertainty that a discrepancy from a posterior gives to any estimator."""

import numpy as np
import pytest
from scipy.special import stdtrit
from sklearn.base import clone
from tests.support.chains import make_chain

from torquebench.compensation import (
    DiscrepancyUncertainty,
    GaussianProcessModel,
    HybridModel,
    PolynomialModel,
    SplineModel,
    compare,
    features,
    make_model,
)


@pytest.mark.parametrize("posterior", [HybridModel(), GaussianProcessModel()])
@pytest.mark.parametrize("estimator", [PolynomialModel(degree=3), SplineModel()])
def test_any_estimator_is_compared_with_any_posterior(
    estimator: PolynomialModel | SplineModel, posterior: HybridModel | GaussianProcessModel
) -> None:
    data = make_chain("reference", 2).calibration(60)
    at = make_chain("reference", 2).dense(100)
    wrapped = DiscrepancyUncertainty(estimator, posterior).fit(data.X, data.standard_nm)
    torque, std = wrapped.predict(at.X, return_std=True)
    bare = clone(estimator).fit(data.X, data.standard_nm)
    np.testing.assert_array_equal(torque, bare.predict(at.X))
    error = np.abs(torque - at.torque_nm)
    own = bare.predict(at.X, return_std=True)[1]
    assert np.mean(error < 1.96 * std) > 0.85
    assert np.mean(error < 1.96 * own) < 0.75  # the covariance knows nothing of loop and ripple
    assert not hasattr(estimator, "points_")  # copies are fitted
    assert not hasattr(posterior, "points_")


def test_a_fitted_posterior_serves_several_estimators() -> None:
    data = make_chain("kinked", 5).calibration(60)
    posterior = HybridModel().fit(data.X, data.standard_nm)
    for estimator in (PolynomialModel(), SplineModel()):
        given, own = (
            DiscrepancyUncertainty(estimator, each).fit(data.X, data.standard_nm)
            for each in (posterior, HybridModel())
        )
        np.testing.assert_array_equal(
            given.predict(data.X, return_std=True), own.predict(data.X, return_std=True)
        )


def test_fewer_than_five_points_leave_the_covariance_widened_for_its_freedom() -> None:
    reading = np.array([-100.0, -30.0, 40.0, 100.0])
    standard = reading + np.array([0.1, -0.1, 0.05, 0.0])
    model = make_model("polynomial-1").fit(features(reading), standard)
    bare = PolynomialModel(degree=1).fit(features(reading), standard)
    torque, std = model.predict(features(reading), return_std=True)
    wanted, own = bare.predict(features(reading), return_std=True)
    np.testing.assert_array_equal(torque, wanted)
    np.testing.assert_allclose(std / own, stdtrit(2.0, 0.975) / 1.959964)
    assert model.scatter_nm == bare.noise_nm_


def test_a_comparison_gives_what_a_fit_of_its_own_gives() -> None:
    data = make_chain("quadratic", 1).calibration(60)
    compared = compare(data.X, data.standard_nm, ["polynomial-2"]).models["polynomial-2"]
    alone = make_model("polynomial-2", range_nm=compared.range_nm).fit(data.X, data.standard_nm)
    np.testing.assert_array_equal(
        compared.predict(data.X, return_std=True), alone.predict(data.X, return_std=True)
    )
