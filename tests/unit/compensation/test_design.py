"""Proposals of calibration points."""

import numpy as np
import pytest
from tests.support.draws import nightly

from torquebench.compensation import features, make_model
from torquebench.compensation.design import propose_points
from torquebench.errors import InputError

_FS = 2000.0


def _coarse(points=6, gap=None):
    share = np.linspace(0.0, 1.0, points)
    share = np.concatenate([share, share[::-1], -share, -share[::-1]])
    branch = np.repeat([1.0, -1.0, 1.0, -1.0], points)
    if gap is not None:
        kept = (share < gap[0]) | (share > gap[1])
        share, branch = share[kept], branch[kept]
    extra = 3e-3 * share + 2e-3 * share * np.abs(share) + 3e-4 * np.tanh(share / 0.02)
    extra += 2e-4 * np.sin(9.0 * share)
    extra += 2e-4 * np.sign(share) * branch * np.abs(share) * (1 - np.abs(share))
    noise = 2e-4 * np.random.default_rng(2).standard_normal(share.size)
    return features(_FS * (share - extra + noise), branch), _FS * share


@pytest.fixture(scope="module", params=["polynomial-3", "hybrid"])
def fitted(request):
    X, y = _coarse()
    return make_model(request.param, range_nm=_FS).fit(X, y), X, y


@pytest.mark.parametrize("criterion", ["worst", nightly("integrated")])
def test_points_form_a_staircase_and_promise_less_uncertainty(fitted, criterion):
    model, X, y = fitted
    proposal = propose_points(model, X, y, 16, criterion=criterion)
    assert proposal.nominal_nm.size == proposal.branch.size == 16
    assert np.max(np.abs(proposal.nominal_nm)) <= _FS
    assert proposal.after_nm < 0.9 * proposal.before_nm
    # each direction once up and once down again, clockwise first
    direction = np.where(proposal.nominal_nm < 0, -1, 1)
    assert np.all(np.diff(direction) <= 0)
    for side in (1, -1):
        here = direction == side
        size, branch = np.abs(proposal.nominal_nm[here]), proposal.branch[here]
        assert np.all(np.diff(branch.astype(int)) <= 0)
        assert np.all(np.diff(size[branch > 0]) > 0)
        assert np.all(np.diff(size[branch < 0]) < 0)


def test_a_gap_in_the_calibration_attracts_points():
    X, y = _coarse(points=11, gap=(0.25, 0.75))
    model = make_model("hybrid", range_nm=_FS).fit(X, y)
    proposal = propose_points(model, X, y, 6)
    share = proposal.nominal_nm / _FS
    assert np.count_nonzero((share > 0.2) & (share < 0.8)) >= 4


def test_more_points_promise_less(fitted):
    model, X, y = fitted
    after = [propose_points(model, X, y, count).after_nm for count in (4, 12, 24)]
    assert after[0] > after[1] > after[2]


def test_same_input_same_points(fitted):
    model, X, y = fitted
    first, second = propose_points(model, X, y, 8), propose_points(model, X, y, 8)
    np.testing.assert_array_equal(first.nominal_nm, second.nominal_nm)


def test_measured_points_keep_the_promise():
    """Fitted again with the proposed points, the model is about as certain as predicted."""
    share = np.linspace(0.0, 1.0, 6)
    X, y = _coarse()
    model = make_model("hybrid", range_nm=_FS).fit(X, y)
    proposal = propose_points(model, X, y, 40)
    target, branch = proposal.nominal_nm / _FS, proposal.branch.astype(float)
    extra = 3e-3 * target + 2e-3 * target * np.abs(target) + 3e-4 * np.tanh(target / 0.02)
    extra += 2e-4 * np.sin(9.0 * target)
    extra += 2e-4 * np.sign(target) * branch * np.abs(target) * (1 - np.abs(target))
    noise = 2e-4 * np.random.default_rng(3).standard_normal(target.size)
    more = features(_FS * (target - extra + noise), branch)
    again = make_model("hybrid", range_nm=_FS)
    again.fit(np.vstack([X, more]), np.concatenate([y, proposal.nominal_nm]))
    share = np.linspace(-1.0, 1.0, 101)
    deviation = max(
        again.predict(features(_FS * share, side), return_std=True)[1].max() for side in (1.0, -1.0)
    )
    assert deviation < 0.85 * proposal.before_nm


def test_one_direction_only():
    reading = np.linspace(0.0, 50.0, 12)
    X, y = features(reading), reading + 1e-4 * reading**2
    model = make_model("polynomial-3", range_nm=50.0).fit(X, y)
    proposal = propose_points(model, X, y, 5)
    assert np.all(proposal.nominal_nm >= -1.0 - 1e-9)


@pytest.mark.parametrize("count", [0, 151])
def test_impossible_counts_are_refused(fitted, count):
    with pytest.raises(InputError, match="points to propose"):
        propose_points(*fitted, count)
