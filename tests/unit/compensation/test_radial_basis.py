"""The radial-basis network: its Jacobian, its leave-one-out aim, what it reaches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.compensation import RadialBasisModel
from torquebench.compensation.radial_basis import RadialBasis, _solve_outputs

X = np.linspace(-1.0, 1.0, 15)


def some_network(seed: int, neurons: int) -> RadialBasis:
    generator = np.random.default_rng(seed)
    return RadialBasis(
        generator.uniform(-1.0, 1.0, neurons),
        np.log(generator.uniform(0.1, 1.0, neurons)),
        generator.standard_normal(neurons),
        float(generator.standard_normal()),
        0.01,
    )


@given(seed=st.integers(0, 10_000), neurons=st.integers(1, 8))
def test_the_jacobian_agrees_with_central_differences(seed: int, neurons: int) -> None:
    network = some_network(seed, neurons)
    flat, step = network.flat, 1e-6
    columns = []
    for index in range(flat.size):
        moved = np.zeros(flat.size)
        moved[index] = step
        columns.append((network.moved(flat + moved)(X) - network.moved(flat - moved)(X)) / 2e-6)
    np.testing.assert_allclose(network.jacobian(X), np.column_stack(columns), atol=1e-7)


@given(seed=st.integers(0, 10_000))
def test_the_leave_one_out_error_is_that_of_leaving_one_out(seed: int) -> None:
    network = some_network(seed, 4)
    target = np.sin(3.0 * X)

    def solved(rows: np.ndarray) -> RadialBasis:
        outputs = _solve_outputs(
            X[rows],
            target[rows],
            np.ones(np.count_nonzero(rows)),
            network.centres[None],
            network.log_widths[None],
            np.array([0.01]),
        )
        return network.moved(
            np.concatenate(
                [
                    network.centres,
                    network.log_widths,
                    outputs.amplitudes[0],
                    outputs.biases,
                ]
            )
        )

    squares = []
    for left_out in range(X.size):
        rows = np.arange(X.size) != left_out
        squares.append((target[left_out] - solved(rows)(X[left_out : left_out + 1])[0]) ** 2)
    everything = _solve_outputs(
        X,
        target,
        np.ones(X.size),
        network.centres[None],
        network.log_widths[None],
        np.array([0.01]),
    )
    assert everything.left_out_squares[0] == pytest.approx(np.mean(squares), rel=1e-3)


def test_it_finds_a_chain_with_a_bump_and_knows_how_well() -> None:
    reading = np.linspace(-2000.0, 2000.0, 60)

    def truth(at: np.ndarray) -> np.ndarray:
        bump = 0.8 * np.exp(-0.5 * ((at - 700.0) / 150.0) ** 2)
        return at + 1e-3 * at + 1e-6 * at * np.abs(at) + bump

    dense = np.linspace(-2000.0, 2000.0, 401)
    inside = []
    for seed in range(6):
        noise = np.random.default_rng(seed).normal(0.0, 0.3, reading.size)
        model = RadialBasisModel(random_state=seed).fit(reading[:, None], truth(reading) + noise)
        torque, std = model.predict(dense[:, None], return_std=True)
        assert np.sqrt(np.mean((torque - truth(dense)) ** 2)) < 0.25
        assert 0.2 < model.noise_nm_ < 0.4
        inside.append(np.abs(torque - truth(dense)) < 1.96 * std)
    assert np.mean(inside) > 0.8


def test_the_swarm_beats_its_start_and_levenberg_marquardt_never_makes_it_worse() -> None:
    reading = np.linspace(-100.0, 100.0, 40)
    standard = reading + 0.3 * np.sin(reading / 15.0)
    short = RadialBasisModel(swarm_steps=1, iterations=0).fit(reading[:, None], standard)
    swarm = RadialBasisModel(iterations=0).fit(reading[:, None], standard)
    finished = RadialBasisModel().fit(reading[:, None], standard)
    assert finished.left_out_rms_nm_ <= swarm.left_out_rms_nm_ <= short.left_out_rms_nm_


def test_few_points_get_few_neurons() -> None:
    reading = np.linspace(-1.0, 1.0, 9)
    model = RadialBasisModel().fit(reading[:, None], 1.1 * reading)
    assert model.network_.centres.size == 2
