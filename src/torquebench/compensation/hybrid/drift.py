"""Zero drift during a calibration, as candidate covariances over time.

The zero was measured at the beginning. Its drift since then is an error of the calibration, not
part of the compensation, and is marginalised with everything else. The form of the drift is
unknown, so each kind of drift is a Gaussian process W(t) with W(0) = 0 whose variance is 1 at the
end:

    steady      t with relaxations of long lags: a chain that follows the room's temperature
    relaxing    relaxations (1 − exp(−t/τ)) of short lags: a chain that warms up or settles
    again       as steady, but from each direction's own beginning, where a new zero may have been
                measured

Each is a sum of functions φⱼ with common and own coefficients,
W = a Σⱼ φⱼ / m + Σⱼ bⱼ φⱼ / √m, a and bⱼ independent with variance ½. Kinds and their amplitudes
are averaged by evidence (`search`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torquebench.compensation.columns import FloatArray

__all__ = ["AMPLITUDES", "NO_DRIFT_SHARE", "DriftKind", "drift_kinds"]

AMPLITUDES = (0.6e-4, 3e-4)
"""Candidate standard deviations of the drift at the end, as fractions of full scale."""

NO_DRIFT_SHARE = 0.15
"""Prior probability of a zero that doesn't drift.

Step, loop and offset of the curve can stand in for a drift, so that the points often don't tell and
this decides. With 0.3, intervals of chains that drift covered 74 to 92 % (synthetic, 12 to 30
chains a family); with less, those that don't drift lose accuracy.
"""

_STEADY_SHARE, _RELAXING_SHARE, _ANEW_SHARE = 0.5, 0.29, 0.21  # of those that drift
_STEADY_LAGS = (np.inf, 1.0, 0.4)  # lags as fractions of the calibration's duration
_RELAXING_LAGS = (0.05, 0.15, 0.5)
_ANEW_LAGS = (np.inf, 0.5)
_COMMON = 0.5


@dataclass(frozen=True)
class DriftKind:
    """One kind of drift.

    Attributes
    ----------
    covariance : float64 array of shape (n, n)
        Among the calibration points, for unit amplitude.
    share : float
        Prior probability.
    """

    covariance: FloatArray
    share: float


def drift_kinds(elapsed: FloatArray) -> list[DriftKind]:
    """Return the kinds of drift that the path of a calibration can show.

    Parameters
    ----------
    elapsed : float64 array of shape (clocks, n)
        From `effects.path_clocks`: the last row runs through the whole calibration.

    Returns
    -------
    kinds : list of DriftKind
        Empty without a clock; the shares add up to 1 - `NO_DRIFT_SHARE`.

    Examples
    --------
    >>> kinds = drift_kinds(np.array([[0.0, 0.5, 1.0]]))
    >>> [kind.covariance[2, 2].round(3) for kind in kinds]
    [np.float64(1.0), np.float64(1.0)]
    """
    if len(elapsed) == 0:
        return []
    found = [
        (_covariance(elapsed[-1], _STEADY_LAGS), _STEADY_SHARE),
        (_covariance(elapsed[-1], _RELAXING_LAGS), _RELAXING_SHARE),
    ]
    if len(elapsed) > 1:
        found.append((_covariance(elapsed[0], _ANEW_LAGS), _ANEW_SHARE))
    total = sum(share for _, share in found)
    return [DriftKind(matrix, (1.0 - NO_DRIFT_SHARE) * share / total) for matrix, share in found]


def _covariance(time: FloatArray, lags: tuple[float, ...]) -> FloatArray:
    relaxations = np.array([_relaxation(time, lag) for lag in lags])
    mean = relaxations.mean(axis=0)
    own = relaxations.T @ relaxations / len(relaxations)
    return np.asarray(_COMMON * np.outer(mean, mean) + (1.0 - _COMMON) * own)


def _relaxation(time: FloatArray, lag: float) -> FloatArray:
    """Return a relaxation that is 1 at the end."""
    if np.isinf(lag):
        return time
    return np.asarray(np.expm1(-time / lag) / np.expm1(-1.0 / lag))
