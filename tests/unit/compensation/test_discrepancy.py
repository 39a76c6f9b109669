"""The uncertainty that a discrepancy from a posterior gives to any estimator."""

import numpy as np
import pytest
from scipy.special import stdtrit
from sklearn.base import clone
from tests.support.chains import make_chain

from torquebench.compensation import (
    CompensationModel,
    HybridModel,
    PolynomialModel,
    RadialBasisModel,
    compare,
    features,
    make_model,
)
from torquebench.compensation.discrepancy import discrepancy_of


@pytest.mark.parametrize("model", [PolynomialModel(degree=3), RadialBasisModel(neurons=5)])
def test_a_curve_is_compared_with_the_posterior_of_the_truth(model: CompensationModel) -> None:
    data = make_chain("reference", 2).calibration(60)
    at = make_chain("reference", 2).dense(100)
    torque, std = clone(model).fit(data.X, data.standard_nm).predict(at.X, return_std=True)
    curve = clone(model).fit_curve(data.X, data.standard_nm)
    np.testing.assert_array_equal(torque, curve.predict(at.X))
    error = np.abs(torque - at.torque_nm)
    assert np.mean(error < 1.96 * std) > 0.85
    assert not hasattr(model, "points_")


def test_the_covariance_of_coefficients_knows_nothing_of_loop_and_ripple() -> None:
    data = make_chain("reference", 2).calibration(60)
    at = make_chain("reference", 2).dense(100)
    model = PolynomialModel(degree=3).fit(data.X, data.standard_nm)
    error = np.abs(model.predict(at.X) - at.torque_nm)
    assert np.mean(error < 1.96 * model._coefficient_std(at.X)) < 0.75


def test_one_posterior_serves_several_curves() -> None:
    data = make_chain("kinked", 5).calibration(60)
    posterior = HybridModel(maximum_points=200).fit(data.X, data.standard_nm)
    for kind in ("polynomial-2", "polynomial-3"):
        model = make_model(kind).fit(data.X, data.standard_nm)
        own = model.predict(data.X, return_std=True)
        model.uncertainty_ = discrepancy_of(model, posterior, data.X)
        np.testing.assert_array_equal(model.predict(data.X, return_std=True), own)


def test_fewer_than_five_points_leave_the_covariance_widened_for_its_freedom() -> None:
    reading = np.array([-100.0, -30.0, 40.0, 100.0])
    standard = reading + np.array([0.1, -0.1, 0.05, 0.0])
    model = make_model("polynomial-1").fit(features(reading), standard)
    _, std = model.predict(features(reading), return_std=True)
    own = model._coefficient_std(features(reading))
    np.testing.assert_allclose(std / own, stdtrit(2.0, 0.975) / 1.959964)
    assert model.scatter_nm == model.noise_nm_


def test_a_comparison_gives_what_a_fit_of_its_own_gives() -> None:
    data = make_chain("quadratic", 1).calibration(60)
    compared = compare(data.X, data.standard_nm, ["polynomial-2"]).models["polynomial-2"]
    alone = make_model("polynomial-2", range_nm=compared.range_nm).fit(data.X, data.standard_nm)
    np.testing.assert_array_equal(
        compared.predict(data.X, return_std=True), alone.predict(data.X, return_std=True)
    )
