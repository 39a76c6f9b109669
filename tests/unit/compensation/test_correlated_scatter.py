"""Scatter that stays for a while, told from repeats."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from torquebench.compensation import HybridModel
from torquebench.compensation.columns import FloatArray, features
from torquebench.compensation.hybrid.calibration_path import correlated_covariance

LEVELS = np.concatenate([np.linspace(0.001, 0.006, 6), np.linspace(0.01, 0.3, 12)])
NOISE = 1e-4


def cycles(
    rng: np.random.Generator, repeats: int, share: float, length: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return u, branch, series and scatter of cycles through both directions."""
    leg = np.concatenate([LEVELS, LEVELS[::-1]])
    branch = np.repeat([1.0, -1.0], LEVELS.size)
    way = np.where(branch < 0, 2 * LEVELS[-1] - leg, leg)
    memory = np.exp(-np.abs(way[:, None] - way[None, :]) / length)
    factor = np.linalg.cholesky(memory + 1e-10 * np.eye(leg.size))
    columns = []
    for number in range(repeats):
        for sign in (1.0, -1.0):
            kept = np.sqrt(share) * factor @ rng.normal(size=leg.size)
            scatter = NOISE * (kept + np.sqrt(1 - share) * rng.normal(size=leg.size))
            columns.append((sign * leg, branch, np.full(leg.size, float(number)), scatter))
    u, branches, series, scatters = (np.concatenate(part) for part in zip(*columns, strict=True))
    return u, branches, series, scatters


@pytest.mark.parametrize(("share", "length"), [(0.8, 0.01), (0.6, 0.3)])
def test_scatter_that_stays_is_found_with_its_size_and_length(share: float, length: float) -> None:
    u, branch, series, scatter = cycles(np.random.default_rng(3), 10, share, length)
    found = correlated_covariance(u, branch, series, scatter)
    assert found is not None
    assert np.array_equal(found, found.T)
    assert found.max() / (1 + found.max()) == pytest.approx(share, abs=0.15)
    apart = (series[:, None] != series) | (np.sign(u)[:, None] != np.sign(u))
    assert not np.any(found[apart])


def test_the_course_of_the_chain_is_no_scatter() -> None:
    rng = np.random.default_rng(5)
    u, branch, series, _ = cycles(rng, 8, 0.0, 1.0)
    course = 3e-3 * np.tanh(u / 0.004) + 5e-3 * u**2 + 2e-4 * branch
    assert (
        correlated_covariance(u, branch, series, course + NOISE * rng.normal(size=u.size)) is None
    )


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(1, 2))
def test_one_or_two_series_tell_nothing(seed: int, repeats: int) -> None:
    u, branch, series, scatter = cycles(np.random.default_rng(seed), repeats, 0.9, 0.5)
    assert correlated_covariance(u, branch, series, scatter) is None


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
@example(272)  # the shortest length reaches from no point to another
def test_any_points_are_taken_in_any_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = int(rng.integers(3, 60))
    u, target = rng.normal(size=size), rng.normal(size=size)
    branch, series = rng.choice([-1.0, 0.0, 1.0], size), rng.choice(4, size).astype(float)
    found = correlated_covariance(u, branch, series, target)
    order = rng.permutation(size)
    again = correlated_covariance(u[order], branch[order], series[order], target[order])
    assert (found is None) == (again is None)
    if found is not None and again is not None:
        np.testing.assert_allclose(again, found[np.ix_(order, order)])


@pytest.mark.nightly
def test_a_curve_from_series_that_stay_off_is_less_well_known() -> None:
    errors, deviations = [], []
    for seed in range(3):
        u, branch, series, scatter = cycles(np.random.default_rng(seed), 6, 0.9, 0.1)
        reading = 50.0 * u
        X = features(reading, branch, 0.0)
        X[:, 2] = series
        torque = reading + 0.05 * np.tanh(u / 0.005) + 50.0 * scatter
        model = HybridModel(range_nm=50.0).fit(X, torque)
        asked = np.array([-0.1, -0.02, 0.02, 0.1])
        value, std = model.predict(features(50.0 * asked, np.ones(4), 0.0), return_std=True)
        errors.append(value - 50.0 * asked - 0.05 * np.tanh(asked / 0.005))
        deviations.append(std)
        assert model.noise_nm_ == pytest.approx(50.0 * NOISE, rel=0.4)  # with what stays, too
    ratio = np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(deviations)))
    assert 0.4 < ratio < 1.6


def test_a_reversal_beside_zero_is_followed_where_torques_lie_on_it() -> None:
    u, branch, series, scatter = cycles(np.random.default_rng(4), 4, 0.0, 1.0)

    def added(x: FloatArray) -> FloatArray:
        return np.asarray(0.05 * (np.tanh((x - 0.001) / 0.004) + np.tanh(0.25)))

    X = features(50.0 * u, branch, 0.0)
    X[:, 2] = series
    model = HybridModel(range_nm=50.0).fit(X, 50.0 * u + added(u) + 5.0 * scatter)
    asked = np.array([-0.008, -0.004, -0.002, 0.002, 0.004, 0.008])
    found = model.predict(features(50.0 * asked, np.ones(6), 0.0)) - 50.0 * asked
    assert np.max(np.abs(found - added(asked))) < 1e-3


def test_what_a_zero_reads_is_no_torque_on_the_step() -> None:
    torque = np.concatenate([np.linspace(0.0, 1.0, 26), np.linspace(0.0, -1.0, 26)])
    reading = torque + 0.002
    model = HybridModel(range_nm=1.0).fit(features(reading, np.ones(52), 0.0), torque)
    found = model.predict(features(reading, np.ones(52), 0.0))
    np.testing.assert_allclose(found, torque, atol=1e-4)
