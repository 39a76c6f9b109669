"""The engine that averages over candidate effects, held against exact enumeration."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from torquebench.compensation.hybrid.averaging import Candidates, average_effects


def some_kind(seed: int, count: int = 4, width: int = 2, points: int = 10) -> Candidates:
    rng = np.random.default_rng(seed)
    prior = rng.dirichlet(np.ones(count + 1))
    return Candidates(
        rng.normal(size=(count, width, points)),
        np.array([0.3, 1.5]),
        np.log(prior[:-1]),
        float(np.log(prior[-1])),
    )


def enumerated(kind: Candidates, points: int) -> list[tuple[float, np.ndarray]]:
    """Every choice of one effect: log prior probability and covariance that it adds."""
    choices = [(kind.log_absent, np.zeros((points, points)))]
    for j, scale in product(range(len(kind.columns)), kind.scales):
        gram = kind.columns[j].T @ kind.columns[j]
        choices.append((kind.log_prior[j] - np.log(kind.scales.size), scale**2 * gram))
    return choices


def log_density(target: np.ndarray, covariance: np.ndarray) -> float:
    matrix = np.eye(target.size) + covariance
    constant = 0.5 * target.size * np.log(2 * np.pi)
    return float(multivariate_normal(np.zeros(target.size), matrix).logpdf(target) + constant)


@settings(max_examples=20)
@given(seed=st.integers(0, 10_000))
def test_a_single_effect_is_exact(seed: int) -> None:
    kind = some_kind(seed)
    target = 2 * np.random.default_rng(seed + 1).normal(size=10)
    choices = enumerated(kind, 10)
    logs = np.array([prior + log_density(target, matrix) for prior, matrix in choices])
    posterior = average_effects(target, [kind])
    weights = np.exp(logs - logsumexp(logs))
    assert posterior.log_evidence == pytest.approx(float(logsumexp(logs)), abs=1e-9)
    np.testing.assert_allclose(posterior.weights[0].T.ravel(), weights[1:], atol=1e-10)
    assert posterior.present[0] == pytest.approx(1.0 - weights[0])
    means = [matrix @ np.linalg.solve(np.eye(10) + matrix, target) for _, matrix in choices]
    np.testing.assert_allclose(posterior.fit, weights @ np.array(means), atol=1e-10)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000))
def test_the_bound_of_two_effects_stays_below_the_exact_evidence(seed: int) -> None:
    kinds = [some_kind(seed), some_kind(seed + 1, width=1)]
    target = 2 * np.random.default_rng(seed + 2).normal(size=10)
    logs = [
        first[0] + second[0] + log_density(target, first[1] + second[1])
        for first, second in product(*(enumerated(kind, 10) for kind in kinds))
    ]
    exact = float(logsumexp(logs))
    posterior = average_effects(target, kinds, sweeps=200, tolerance=1e-10)
    assert posterior.log_evidence <= exact + 1e-9
    assert posterior.log_evidence >= exact - 8.0


def test_two_clear_effects_of_one_kind_are_both_found() -> None:
    points = np.linspace(0, 1, 60)
    centres = np.linspace(0, 1, 21)
    columns = np.exp(-0.5 * ((points - centres[:, None]) / 0.03) ** 2)[:, None, :]
    kind = Candidates(columns, np.array([5.0]), np.log(np.full(21, 0.5 / 21)), np.log(0.5), 3)
    rng = np.random.default_rng(3)
    target = 8 * columns[5, 0] - 7 * columns[15, 0] + rng.normal(size=60)
    posterior = average_effects(target, [kind])
    found = sum(np.abs(means[:, 0]) for means in posterior.means)
    assert set(np.argsort(found)[-2:]) == {5, 15}
    np.testing.assert_allclose(
        sum(means[[5, 15], 0] for means in posterior.means), [8, -7], atol=1.5
    )


def test_more_sweeps_never_lower_the_bound() -> None:
    kinds = [some_kind(1), some_kind(2), some_kind(3, width=1)]
    target = 2 * np.random.default_rng(4).normal(size=10)
    results = [average_effects(target, kinds, sweeps=k, tolerance=-1.0) for k in range(1, 9)]
    bounds = [result.log_evidence for result in results]
    assert np.all(np.diff(bounds) > -1e-9)
