"""The sources' training: gradient descent step by step, both mappings, both starts."""

import sys
from functools import partial

import numpy as np
import pytest

from torquebench.compensation import NetworkModel
from torquebench.compensation.network_training import (
    NetworkParameters,
    descend,
    jacobian,
    network_values,
)
from torquebench.errors import InputError

READING = np.linspace(-2000.0, 2000.0, 50)
ADDITIONAL = 2.0 + 2e-3 * READING + 1.5e-6 * READING * np.abs(READING)
STANDARD = READING + ADDITIONAL
published = partial(NetworkModel, training="gradient-descent")


def plain_descent(
    network: NetworkParameters, x: np.ndarray, target: np.ndarray, rate: float, epochs: int
) -> NetworkParameters:
    """The same training from the Jacobian, as one would write it down."""
    flat = network.flat
    for _ in range(epochs):
        now = NetworkParameters.from_flat(flat)
        errors = network_values(now, x) - target
        flat = flat - rate * 2.0 / x.size * (jacobian(now, x).T @ errors)
    return NetworkParameters.from_flat(flat)


@pytest.mark.parametrize("start", ["nguyen-widrow", "small-uniform"])
@pytest.mark.parametrize("mapping", ["residual", "direct"])
def test_training_is_batch_gradient_descent_on_the_mean_square(start: str, mapping: str) -> None:
    model = published(mapping=mapping, start=start, epochs=300)
    model.fit(READING[:, None], STANDARD)
    target = ADDITIONAL if mapping == "residual" else STANDARD
    scaled = model.output_scaling_.to_unit(target)
    expected = plain_descent(
        model._starts()[0], model.input_scaling_.to_unit(READING), scaled, 0.01, 300
    )
    np.testing.assert_allclose(model.networks_[0].flat, expected.flat, atol=1e-12)
    assert scaled.min() == pytest.approx(-1.0)
    assert scaled.max() == pytest.approx(1.0)


def test_numpy_descends_as_the_compiled_loop(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = np.random.default_rng(3)
    x, target = np.linspace(-1.0, 1.0, 40), np.sin(np.linspace(-2.0, 2.0, 40))
    network = NetworkParameters.from_flat(generator.normal(size=3 * 7 + 1))
    weights = generator.uniform(0.5, 1.0, 40)
    compiled = descend(network, x, target, weights, 0.05, 500)
    monkeypatch.setitem(sys.modules, "torquebench.compensation.compiled_descent", None)
    by_numpy = descend(network, x, target, weights, 0.05, 500)
    np.testing.assert_allclose(by_numpy.flat, compiled.flat, rtol=0.0, atol=1e-9)


def test_the_start_decides_what_gradient_descent_reaches() -> None:
    middle = 0.5 * (READING[1:] + READING[:-1])
    truth = middle + 2.0 + 2e-3 * middle + 1.5e-6 * middle * np.abs(middle)
    worst = {}
    for start in ("nguyen-widrow", "small-uniform"):
        model = published(start=start, epochs=20_000).fit(READING[:, None], STANDARD)
        worst[start] = np.max(np.abs(model.predict(middle[:, None]) - truth))
    bayesian = NetworkModel().fit(READING[:, None], STANDARD).predict(middle[:, None])
    assert 3.0 * worst["small-uniform"] < worst["nguyen-widrow"]
    assert 50.0 * np.max(np.abs(bayesian - truth)) < worst["small-uniform"]


def test_a_rough_network_says_that_it_is_wrong_between_the_points() -> None:
    model = published(epochs=5000).fit(READING[:, None], STANDARD)
    between = np.linspace(-2000.0, 2000.0, 401)
    truth = between + 2.0 + 2e-3 * between + 1.5e-6 * between * np.abs(between)
    torque, std = model.predict(between[:, None], return_std=True)
    assert np.mean(np.abs(torque - truth) < 1.96 * std) > 0.9
    assert np.sqrt(np.mean(std**2)) < 3.0 * np.sqrt(np.mean((torque - truth) ** 2))


def test_divergence_is_an_answer() -> None:
    with pytest.raises(InputError, match=r"learning_rate 0\.5"):
        published(learning_rate=0.5, epochs=4000).fit(READING[:, None], STANDARD)


def test_the_training_curve_falls_and_ends_at_the_target_error() -> None:
    whole = published(start="small-uniform", epochs=3000)
    curve = whole.fit(READING[:, None], STANDARD).training_curve_
    assert curve[:4, 0].tolist() == [1, 2, 5, 10]
    assert curve[-1, 0] == 3000
    assert curve[-1, 1] == whole.training_rms_nm_ < 0.5 * curve[0, 1]
    target = float(np.sqrt(curve[0, 1] * curve[-1, 1]))
    ended = published(start="small-uniform", epochs=3000, target_error_nm=target)
    ended.fit(READING[:, None], STANDARD)
    assert ended.training_rms_nm_ < target <= ended.training_curve_[-2, 1]
    np.testing.assert_array_equal(ended.training_curve_, curve[: len(ended.training_curve_)])


def test_the_seed_decides_alone() -> None:
    first, second = (
        published(epochs=100, random_state=seed).fit(READING[:, None], STANDARD) for seed in (1, 2)
    )
    assert not np.allclose(first.networks_[0].flat, second.networks_[0].flat)
