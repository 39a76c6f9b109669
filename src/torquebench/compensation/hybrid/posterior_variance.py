"""Posterior variance of the hybrid's curve."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.hybrid.effects import all_columns, at_zero_time
from torquebench.compensation.hybrid.inference import (
    Member,
    Problem,
    deviation_kernel,
    deviation_variance,
    main_columns,
)
from torquebench.kernels import inner, kernel

__all__ = ["curve_variance"]

_NEGLIGIBLE_SHARE = 2e-3


def curve_variance(
    problem: Problem,
    members: list[Member],
    shares: FloatArray,
    u: FloatArray,
    branch: float = 1.0,
) -> tuple[FloatArray, FloatArray]:
    """Return the posterior variance of the curve, averaged over members.

    Parameters
    ----------
    problem : Problem
    members : list of Member
    shares : float64 array
        Weight of every member.
    u : float64 array of shape (m,)
        Where, as fractions of full scale.
    branch : float, default 1
        Size of the branch: 0 for the curve in the middle of the loop.

    Returns
    -------
    up, down : float64 array of shape (m,)
        Variance on the two branches, as a fraction of full scale squared.
    """
    points = at_zero_time(u, np.full(u.size, branch))
    columns = all_columns(points, problem.dictionary)
    main_form, same = main_columns(u), deviation_kernel(u, problem.points.u)
    train_form = main_columns(problem.points.u)
    first, second = np.zeros((2, u.size)), np.zeros((2, u.size))
    for share, member in zip(shares, members, strict=True):
        amplitude2 = (problem.prior_scale * member.setting.amplitude) ** 2
        main = main_form * member.main_scales
        cross = main @ (train_form * member.main_scales).T + amplitude2 * same
        gain = cho_solve((member.factor, True), cross.T, check_finite=False)
        common = (
            np.sum(main**2, axis=1)
            + amplitude2 * deviation_variance(u)
            - np.sum(gain.T * cross, axis=1)
        )
        value, variance = np.tile(cross @ member.solved, (2, 1)), np.tile(common, (2, 1))
        start = 0
        for kind in problem.kinds:
            means = member.effects.means[start : start + kind.copies]
            moments = member.effects.moments[start : start + kind.copies]
            start += kind.copies
            _add_effect(
                columns[kind.name],
                -1.0 if kind.turns else 1.0,
                kind.columns,
                gain,
                np.array(means),
                np.sum(moments, axis=0),
                value,
                variance,
            )
        first += share * value
        second += share * (variance + value**2)
    up, down = np.maximum(second - first**2, 0.0)
    return up, down


@kernel
def _add_effect(  # type: ignore[no-untyped-def] # Numba infers
    columns, turns, train_columns, gain, means, moments, value, variance
):
    """Add the contribution of all copies of one kind to the curve's mean and variance.

    Main form and deviation compensate an effect's values at the calibration points, so only columns
    minus their projection vary. The second row is the other branch, on which the columns are
    multiplied by `turns`: 1 if both are equal.
    """
    copies, count, width = means.shape
    branches = 1 if turns == 1.0 else 2
    sizes = np.zeros(count)
    for j in range(count):
        for p in range(width):
            sizes[j] += moments[j, p, p]
    least = _NEGLIGIBLE_SHARE * sizes.sum()
    points = columns.shape[2]
    single = np.zeros((branches, copies, points))
    added = np.zeros((branches, points))
    left = np.empty((width, points))
    for j in range(count):
        for p in range(width):
            mean = means[:, j, p].sum()
            for i in range(points):
                value[0, i] += mean * columns[j, p, i]
                value[1, i] += turns * (mean * columns[j, p, i])
        if sizes[j] > least:
            projected = np.dot(train_columns[j], gain)
            for branch in range(branches):
                factor = turns if branch else 1.0
                for p in range(width):
                    for i in range(points):
                        left[p, i] = factor * columns[j, p, i] - projected[p, i]
                _add_moments(left, means[:, j], moments[j], single[branch], added[branch])
    for branch in range(2):
        row = min(branch, branches - 1)
        for i in range(points):
            spread = added[row, i]
            for copy in range(copies):
                spread -= single[row, copy, i] ** 2
            variance[branch, i] += spread


@inner
def _add_moments(left, means, moments, single, variance):  # type: ignore[no-untyped-def] # Numba infers
    """Add one candidate's second moment to the variance, and its mean to every copy's."""
    for p in range(left.shape[0]):
        for q in range(p + 1):
            moment = moments[p, q] if p == q else moments[p, q] + moments[q, p]
            for i in range(left.shape[1]):
                variance[i] += moment * left[p, i] * left[q, i]
        for copy in range(means.shape[0]):
            for i in range(left.shape[1]):
                single[copy, i] += means[copy, p] * left[p, i]
