"""The network beside scikit-learn's: the same values, a better fit, in comparable time."""

import time
import warnings
from collections.abc import Callable

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.neural_network import MLPRegressor

from torquebench.compensation import NetworkModel
from torquebench.compensation.network_training import NetworkParameters, network_values

RANGE_NM = 2000.0


def truth(reading: np.ndarray) -> np.ndarray:
    u = reading / RANGE_NM
    error = 2e-3 * u + 1.5e-3 * u * np.abs(u) + 8e-4 * np.tanh(u / 0.015)
    error += 3e-4 * np.sin(9.0 * u) + 4e-4 * np.exp(-0.5 * ((u - 0.4) / 0.06) ** 2)
    return reading + RANGE_NM * error


def calibration(seed: int, points: int = 50) -> tuple[np.ndarray, np.ndarray]:
    reading = np.linspace(-RANGE_NM, RANGE_NM, points)
    noise = np.random.default_rng(seed).normal(0.0, 2e-4 * RANGE_NM, points)
    return reading, truth(reading) + noise


def scikit_learn_network(reading: np.ndarray, standard: np.ndarray) -> MLPRegressor:
    """L-BFGS with inputs and targets scaled; its own tolerance often ends at a straight line."""
    additional = standard - reading
    network = MLPRegressor(
        hidden_layer_sizes=(50,),
        activation="tanh",
        solver="lbfgs",
        tol=1e-10,
        max_iter=200,
        random_state=0,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return network.fit(reading[:, None] / RANGE_NM, additional / np.std(additional))


def best_time(action: Callable[[], object], repeats: int = 7) -> float:
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        action()
        times.append(time.perf_counter() - started)
    return min(times)


def test_the_same_weights_give_the_same_values() -> None:
    network = scikit_learn_network(*calibration(0))
    parameters = NetworkParameters(
        network.coefs_[0][0],
        network.intercepts_[0],
        network.coefs_[1][:, 0],
        float(network.intercepts_[1][0]),
    )
    x = np.linspace(-1.0, 1.0, 101)
    np.testing.assert_allclose(network_values(parameters, x), network.predict(x[:, None]))


def test_it_errs_less_than_scikit_learns_on_the_same_fifty_points() -> None:
    dense = np.linspace(-RANGE_NM, RANGE_NM, 801)
    ours, theirs = [], []
    for seed in range(8):
        reading, standard = calibration(seed)
        model = NetworkModel().fit(reading[:, None], standard)
        ours.append(np.sqrt(np.mean((model.predict(dense[:, None]) - truth(dense)) ** 2)))
        other = scikit_learn_network(reading, standard)
        compensated = dense + np.std(standard - reading) * other.predict(dense[:, None] / RANGE_NM)
        theirs.append(np.sqrt(np.mean((compensated - truth(dense)) ** 2)))
    assert np.median(ours) < np.median(theirs)
    assert np.median(ours) < 2e-4 * RANGE_NM  # less than the scatter of one point


def test_its_fit_takes_at_most_twice_the_time_of_scikit_learns() -> None:
    reading, standard = calibration(0)
    model = NetworkModel()
    ours = best_time(lambda: model.fit_curve(reading[:, None], standard))
    theirs = best_time(lambda: scikit_learn_network(reading, standard))
    assert ours < 2.0 * theirs
