import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.chains import make_chain

from torquebench.compensation import PhysicsModel, features, make_model, model_from_state
from torquebench.compensation.physics import ChainPoints, physics_basis


def loaded(points: int = 24) -> tuple[np.ndarray, np.ndarray]:
    """Readings and branches of 0 → +FS → 0 → −FS → 0, as fractions of full scale."""
    up = np.linspace(1.0 / points, 1.0, points)
    u = np.concatenate([up, up[::-1], -up, -up[::-1]])
    return u, np.repeat([1.0, -1.0, 1.0, -1.0], points)


def test_basis_is_odd_in_the_step_and_vanishes_at_full_scale_in_the_loops() -> None:
    points = ChainPoints(np.array([-1.0, -0.3, 0.3, 1.0]), np.ones(4))
    basis = physics_basis(points, 0.01)
    assert basis.shape == (4, 8)
    np.testing.assert_allclose(basis[[0, 3], 6:], 0.0)
    np.testing.assert_allclose(basis[1, 5:], -basis[2, 5:])
    np.testing.assert_allclose(basis[2, 1:3], [0.3, 0.09])
    np.testing.assert_allclose(basis[1, 3:5], [-0.3, -0.09])


def test_it_finds_the_constants_of_equation_15() -> None:
    u, branch = loaded()
    rng = np.random.default_rng(1)
    added = np.where(u > 0, 3e-3 * u + 2e-3 * u**2, 4e-3 * u - 1e-3 * u**2)
    added = added + 4e-4 * np.tanh(u / 0.008) + 2e-4 * branch * np.sign(u) * (1 - np.abs(u))
    reading = 2000 * u
    standard = reading + 2000 * (added + 5e-5 * rng.standard_normal(u.size))
    model = PhysicsModel(range_nm=2000).fit(features(reading, branch), standard)
    coefficients = model.evidence_ @ model.coefficients_
    np.testing.assert_allclose(coefficients[[1, 2, 3, 4]], [3e-3, 2e-3, 4e-3, 1e-3], atol=2e-4)
    np.testing.assert_allclose(coefficients[[5, 7]], [4e-4, 2e-4], atol=6e-5)
    assert model.noise_nm_ == pytest.approx(0.1, rel=0.3)


def test_what_it_cannot_follow_widens_its_intervals() -> None:
    u, branch = loaded()
    rng = np.random.default_rng(2)
    noise = 2e-4 * rng.standard_normal(u.size)
    plain = 2000 * (u + 3e-3 * u + noise)
    rippled = plain + 2000 * 5e-4 * np.sin(20 * u)
    X = features(2000 * u, branch)
    widths = []
    for standard in (plain, rippled):
        _, std = make_model("physics").fit(X, standard).predict(X, return_std=True)
        widths.append(float(np.mean(std)))
    assert widths[1] > 2 * widths[0]


def test_an_unknown_branch_costs_half_the_loop() -> None:
    u, branch = loaded()
    added = 5e-4 * branch * np.sign(u) * (1 - np.abs(u))
    X = features(2000 * u, branch)
    model = PhysicsModel().fit(X, X[:, 0] + 2000 * added)
    at = np.array([400.0, -400.0])
    up, down = (model.predict(features(at, [b, b])) for b in (1, -1))
    middle, std = model.predict(features(at, [0, 0]), return_std=True)
    np.testing.assert_allclose(middle, 0.5 * (up + down), atol=1e-6)
    assert np.all(std >= 0.5 * np.abs(up - down) * 0.999)
    assert np.all(np.abs(up - down) > 1.0)


def test_a_drift_during_the_calibration_is_not_part_of_the_curve() -> None:
    u, branch = loaded()
    time = np.linspace(0.0, 1.0, u.size)
    reading = 2000 * (u - 1e-3 * u * np.abs(u) + 2e-4 * time)
    X = features(reading, branch, np.where(u > 0, 1, 2))
    dense = np.concatenate([np.linspace(0.05, 0.95, 30), -np.linspace(0.05, 0.95, 30)])
    truth = 2000 * dense
    clean = features(2000 * (dense - 1e-3 * dense * np.abs(dense)), np.ones(60), np.ones(60))
    error = PhysicsModel().fit(X, 2000 * u).predict(clean) - truth
    assert np.max(np.abs(error)) < 0.5 * 2000 * 2e-4


def test_state_gives_the_same_predictions_bit_for_bit() -> None:
    data = make_chain("power-law", 4).calibration(50)
    model = make_model("physics").fit(data.X, data.standard_nm)
    again = model_from_state(model.get_state())
    for one, other in zip(
        model.predict(data.X, return_std=True), again.predict(data.X, return_std=True), strict=True
    ):
        np.testing.assert_array_equal(one, other)


@settings(max_examples=15)
@given(factor=st.floats(1e-2, 1e3))
def test_the_unit_of_torque_does_not_matter(factor: float) -> None:
    data = make_chain("reference", 7).calibration(50)
    scaled = data.X.copy()
    scaled[:, 0] *= factor
    one = PhysicsModel().fit(data.X, data.standard_nm)
    other = PhysicsModel().fit(scaled, factor * data.standard_nm)
    expected = [factor * value for value in one.predict(data.X, return_std=True)]
    for value, wanted in zip(other.predict(scaled, return_std=True), expected, strict=True):
        np.testing.assert_allclose(value, wanted, rtol=1e-6, atol=1e-7 * factor)
