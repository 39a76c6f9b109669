"""Evidence, gradients and posterior of one structure, held against the textbook's formulas."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from torquebench.compensation.hybrid.average import ALIKE, PLAIN, STRUCTURES, average
from torquebench.compensation.hybrid.calibration_path import path_clock
from torquebench.compensation.hybrid.member import (
    Layout,
    Member,
    Problem,
    Structure,
    Weighting,
    log_posterior,
)
from torquebench.compensation.hybrid.parts import Points, catalogue

EVERYTHING = Structure("odd", tuple(sorted(catalogue(12))), growing=True)


def problem(seed: int, *, correlated: bool = False) -> Problem:
    rng = np.random.default_rng(seed)
    half = np.concatenate([np.linspace(0.05, 1.0, 8), np.linspace(0.9, 0.1, 7)])
    u, branch = np.concatenate([half, -half]), np.tile(np.repeat([1.0, -1.0], [8, 7]), 2)
    target = 1e-3 * u * np.abs(u) + 3e-4 * np.tanh(u / 0.01) + 2e-4 * rng.normal(size=u.size)
    whitening = None
    if correlated:
        shared = np.eye(u.size) + 0.5 * np.exp(-np.abs(u[:, None] - u) / 0.3)
        whitening = np.linalg.inv(np.linalg.cholesky(shared))
    points = Points(u, branch, path_clock(u, branch, np.zeros(u.size)))
    return Problem(points, target, catalogue(12), 1.0, whitening)


def somewhere(layout: Layout, seed: int) -> np.ndarray:
    return layout.mean + 0.3 * np.random.default_rng(seed).normal(size=layout.mean.size)


def prior_covariance(data: Problem, layout: Layout, theta: np.ndarray) -> np.ndarray:
    trend = data.trend(layout.structure.trend)
    total = trend @ trend.T
    for name, part in layout.parts.items():
        shape = np.exp(theta[layout.shape[name]])
        scale = np.exp(theta[layout.amplitude[name]] + part.scales(shape)[0])
        columns = data.columns(name, shape)[0] * scale
        total += columns @ columns.T
    return total


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), correlated=st.booleans())
def test_the_marginal_likelihood_is_that_of_the_normal_distribution(
    seed: int, correlated: bool
) -> None:
    data, layout = problem(seed, correlated=correlated), Layout(EVERYTHING, catalogue(12))
    one, other = (somewhere(layout, seed + k) for k in (0, 1))
    weights = np.random.default_rng(seed).uniform(0.2, 1.0, data.target.size)
    values = []
    for theta in (one, other):
        noise = np.diag(layout.variances(theta, data.points.u) / weights)
        covariance = prior_covariance(data, layout, theta) + noise
        z = (theta - layout.mean) / layout.sd
        density = multivariate_normal(np.zeros(len(covariance)), covariance).logpdf(data.target)
        values.append(density - 0.5 * z @ z - log_posterior(data, layout, weights, theta)[0])
    assert values[0] == pytest.approx(values[1], abs=1e-6)  # but for one constant


@settings(max_examples=10)
@given(seed=st.integers(0, 1000), correlated=st.booleans())
def test_gradients_are_those_of_differences(seed: int, correlated: bool) -> None:
    data, layout = problem(seed, correlated=correlated), Layout(EVERYTHING, catalogue(12))
    theta, weights = somewhere(layout, seed), np.ones(data.target.size)
    slope = log_posterior(data, layout, weights, theta)[1]
    for k, step in enumerate(1e-5 * np.eye(theta.size)):
        high, low = (log_posterior(data, layout, weights, theta + s)[0] for s in (step, -step))
        assert slope[k] == pytest.approx((high - low) / 2e-5, abs=1e-4 * np.abs(slope).max())


def test_mean_and_variance_are_those_of_the_gaussian_process() -> None:
    data, layout = problem(1), Layout(EVERYTHING, catalogue(12))
    theta, weights = somewhere(layout, 3), np.ones(data.target.size)
    member = Member(
        data, layout, Weighting(weights, weights), theta, 0.0, np.zeros((theta.size,) * 2)
    )
    at = Points(np.array([-0.93, -0.2, 0.004, 0.41, 1.0]), np.array([1.0, -1, 0, 1, -1]))

    count = data.target.size
    joint = Problem(
        Points(
            *(
                np.concatenate(pair)
                for pair in zip(
                    (data.points.u, data.points.branch, data.points.elapsed),
                    (at.u, at.branch, np.zeros(len(at))),
                    strict=True,
                )
            )
        ),
        np.zeros(count + len(at)),
        catalogue(12),
    )
    prior = prior_covariance(joint, layout, theta)
    inverse = np.linalg.inv(prior[:count, :count] + np.diag(layout.variances(theta, data.points.u)))
    cross = prior[count:, :count]
    mean, factors = member.curve(at)
    np.testing.assert_allclose(mean, cross @ inverse @ data.target, atol=1e-9)
    wanted = prior[count:, count:] - cross @ inverse @ cross.T
    np.testing.assert_allclose(factors @ factors.T, wanted, atol=1e-11)


def test_unknown_hyperparameters_add_to_the_variance_what_moving_them_does() -> None:
    data, layout = problem(2), Layout(EVERYTHING, catalogue(12))
    theta, weights = somewhere(layout, 5), np.ones(data.target.size)
    at = Points(np.linspace(-0.9, 0.9, 7), np.ones(7))

    def member(moved: np.ndarray, covariance: np.ndarray) -> Member:
        return Member(data, layout, Weighting(weights, weights), moved, 0.0, covariance)

    nothing = np.zeros((theta.size, theta.size))
    fixed = np.sum(member(theta, nothing).curve(at)[1] ** 2, axis=1)
    for unit in np.eye(theta.size):
        added = np.sum(member(theta, np.diag(unit)).curve(at)[1] ** 2, axis=1) - fixed
        high, low = (member(theta + s * unit, nothing).curve(at)[0] for s in (1e-5, -1e-5))
        np.testing.assert_allclose(added, ((high - low) / 2e-5) ** 2, rtol=1e-3, atol=1e-14)


def test_laplace_evidence_is_near_the_integral_over_two_hyperparameters() -> None:
    data, layout = problem(4), Layout(Structure("quadratic", ("offset",)), catalogue(12))
    weights = np.ones(data.target.size)
    member = Member.fitted(data, layout, Weighting(weights, weights)).integrated()
    amplitude = layout.mean[0] + layout.sd[0] * np.linspace(-6, 6, 121)
    noise = member.theta[1] + np.linspace(-1.2, 1.2, 121)
    logs = np.array(
        [
            [log_posterior(data, layout, weights, np.array([a, s]))[0] for s in noise]
            for a in amplitude
        ]
    )
    cell = (amplitude[1] - amplitude[0]) * (noise[1] - noise[0]) / (2 * np.pi * layout.sd.prod())
    exact = logs.max() + np.log(np.sum(np.exp(logs - logs.max())) * cell)
    assert member.log_evidence == pytest.approx(exact, abs=0.5)


def test_shares_add_up_and_the_likeliest_comes_first() -> None:
    data = problem(6)
    members, shares = average(data, np.ones(data.target.size))
    assert shares.sum() == pytest.approx(1.0)
    assert np.all(np.diff(shares) <= 0.0)
    assert len({member.structure for member in members}) == len(members)


def test_a_branch_alone_has_no_loop_in_any_structure() -> None:
    data = problem(7)
    rising = data.points.branch > 0
    points = Points(*(v[rising] for v in (data.points.u, data.points.branch, data.points.elapsed)))
    alone = Problem(points, data.target[rising], catalogue(12, with_loops=False))
    members, _ = average(alone, np.ones(len(points)))
    assert not any({"loop", "lag", "branch"}.intersection(m.structure.parts) for m in members)


def test_loops_close_at_full_scale_and_turn_over_with_the_branch() -> None:
    u = np.array([-1.0, -0.4, 0.4, 1.0])
    for name in ("loop", "lag"):
        part = catalogue(12)[name]
        shape = np.exp([prior.mean for prior in part.shape])
        up, down = (part.columns(Points(u, b * np.ones(4)), shape)[0] for b in (1.0, -1.0))
        np.testing.assert_allclose(up[[0, 3]], 0.0, atol=1e-7)
        np.testing.assert_allclose(up[:, :2], -down[:, :2])
        np.testing.assert_allclose(up[:, 2:], down[:, 2:])  # of a direction that is loaded alone


def test_structures_are_distinct_and_of_known_parts() -> None:
    every = (*STRUCTURES, *ALIKE, *PLAIN)
    assert len(set(every)) == len(every)
    assert all(set(structure.parts) <= set(catalogue(12)) for structure in every)
