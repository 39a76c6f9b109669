"""The network's values, Jacobian and starts, each against an independent way."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.compensation.network_training import (
    NetworkParameters,
    SpanScaling,
    hidden_values,
    jacobian,
    network_values,
    nguyen_widrow_start,
    small_uniform_start,
    tangent_kernels,
)

X = np.linspace(-1.0, 1.0, 17)


def some_network(seed: int, hidden: int) -> NetworkParameters:
    generator = np.random.default_rng(seed)
    return NetworkParameters.from_flat(generator.normal(0.0, 1.5, 3 * hidden + 1))


@given(seed=st.integers(0, 10_000), hidden=st.integers(1, 12))
def test_the_jacobian_agrees_with_central_differences(seed: int, hidden: int) -> None:
    network = some_network(seed, hidden)
    flat, step = network.flat, 1e-6
    differences = np.empty((X.size, flat.size))
    for index in range(flat.size):
        moved = np.zeros(flat.size)
        moved[index] = step
        up = network_values(NetworkParameters.from_flat(flat + moved), X)
        down = network_values(NetworkParameters.from_flat(flat - moved), X)
        differences[:, index] = (up - down) / (2.0 * step)
    np.testing.assert_allclose(jacobian(network, X), differences, atol=2e-8)


@given(seed=st.integers(0, 10_000), hidden=st.integers(1, 12))
def test_tangent_kernels_are_products_of_the_jacobian_with_itself(seed: int, hidden: int) -> None:
    network = some_network(seed, hidden)
    J = jacobian(network, X)
    parts = (J[:, :hidden], J[:, hidden : 2 * hidden], J[:, 2 * hidden :])
    kernels = tangent_kernels(network, X, hidden_values(network, X))
    for part, kernel in zip(parts, kernels, strict=True):
        np.testing.assert_allclose(kernel, part @ part.T, atol=1e-11)


def test_flat_parameters_come_back() -> None:
    network = some_network(1, 4)
    again = NetworkParameters.from_flat(network.flat)
    np.testing.assert_array_equal(again.flat, network.flat)
    assert again.input_weights.shape == (4,)


def test_a_value_does_not_depend_on_the_others_asked_for() -> None:
    network = some_network(2, 50)
    one_by_one = [network_values(network, X[i : i + 1])[0] for i in range(X.size)]
    np.testing.assert_array_equal(network_values(network, X), one_by_one)


@pytest.mark.parametrize("size", [0.25, 1.0, 2.0])
def test_nguyen_widrow_spreads_the_neurons_over_the_input(size: float) -> None:
    start = nguyen_widrow_start(np.random.default_rng(0), 50, size)
    np.testing.assert_allclose(np.abs(start.input_weights), 35.0 * size)
    turning_points = -start.hidden_biases / start.input_weights
    np.testing.assert_allclose(np.sort(turning_points), np.linspace(-1.0, 1.0, 50), atol=1e-12)
    assert np.all(np.abs(start.output_weights) <= 1.0)


def test_small_uniform_is_small() -> None:
    start = small_uniform_start(np.random.default_rng(0), 50, 0.5)
    assert 0.4 < np.max(np.abs(start.flat)) <= 0.5


@given(low=st.floats(-1e6, 1e6), span=st.floats(1e-3, 1e6))
def test_scaling_maps_the_span_onto_minus_one_to_one_and_back(low: float, span: float) -> None:
    values = low + span * np.array([0.3, 0.0, 1.0])
    scaling = SpanScaling.of(values)
    scaled = scaling.to_unit(values)
    np.testing.assert_allclose([scaled.min(), scaled.max()], [-1.0, 1.0], rtol=1e-6)
    np.testing.assert_allclose(scaling.from_unit(scaled), values, rtol=1e-9, atol=1e-9)


def test_a_single_value_scales_to_zero() -> None:
    assert SpanScaling.of(np.array([3.0])).to_unit(np.array([3.0])).tolist() == [0.0]
