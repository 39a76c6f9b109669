"""A model judged against the posterior of the truth: see `curve_uncertainty`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.curve_uncertainty import (
    COVERAGE_95,
    CurveUncertainty,
    half_widths,
)

__all__ = ["Posterior", "Values", "judge"]

Values = Callable[[FloatArray, FloatArray], FloatArray]
"""Additional torque from u and branch, all as fractions of full scale."""
Posterior = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""Mean and standard deviation of the true additional torque from u and branch."""

_REACH = 0.05
_SAMPLES_PER_REACH = 8
_SAMPLES_PER_NODE = 4


def judge(
    values: Values,
    posterior: Posterior,
    limits: tuple[float, float],
    *,
    branch_aware: bool,
    branches: frozenset[float],
) -> CurveUncertainty:
    """Return the uncertainty of a model's values against the posterior of the truth.

    Parameters
    ----------
    values : callable
        The model.
    posterior : callable
        Mean and standard deviation of the truth.
    limits : tuple of float
        Lowest and highest u that the model accepts.
    branch_aware : bool
        Whether the model's values depend on the branch.
    branches : frozenset of float
        Branches that the calibration recorded, of +1 and −1: with one of them or none, nothing is
        said of another, and a loop counts as noise.

    Returns
    -------
    uncertainty : CurveUncertainty
    """
    step = _REACH / _SAMPLES_PER_REACH
    count = int(np.ceil((limits[1] - limits[0]) / step / _SAMPLES_PER_NODE)) * _SAMPLES_PER_NODE
    u = np.linspace(limits[0], limits[1], count + 1)
    nodes = np.arange(0, u.size, _SAMPLES_PER_NODE)
    window = nodes[:, None] + np.arange(-_SAMPLES_PER_REACH, _SAMPLES_PER_REACH + 1)
    window = np.clip(window, 0, u.size - 1)

    def error(known: float, truth: float) -> tuple[FloatArray, FloatArray]:
        mean, spread = posterior(u, np.full(u.size, truth))
        bias = values(u, np.full(u.size, known)) - mean
        return bias[window], spread[window]

    def std(*cases: tuple[FloatArray, FloatArray]) -> FloatArray:
        bias, spread = (np.concatenate(parts, axis=1) for parts in zip(*cases, strict=True))
        return half_widths(bias, spread) / COVERAGE_95

    if len(branches) < 2:
        only = next(iter(branches), 1.0)
        plain = std(error(only, only))
        return CurveUncertainty(u[nodes], plain, plain, plain)
    if not branch_aware:
        both = std(error(0.0, 1.0), error(0.0, -1.0))
        return CurveUncertainty(u[nodes], both, both, both)
    # Half a loop to either side, next to other contributions in a budget: its standard deviation.
    halves = [bias**2 + spread**2 for bias, spread in (error(0.0, 1.0), error(0.0, -1.0))]
    middle = np.sqrt(np.mean(np.concatenate(halves, axis=1), axis=1))
    return CurveUncertainty(u[nodes], std(error(1.0, 1.0)), std(error(-1.0, -1.0)), middle)
