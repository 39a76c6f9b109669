"""Composite covariance of the additional torque over reading and branch, with its gradients.

Everything is in fractions of full scale; u is the reading, b the branch. The covariance is a sum:

    trend        c² (u u′ + u²u′² + u|u| u′|u′|) + c₀²      equation 15, wide; the measured zero
    smooth       a₁² exp(−(u − u′)² / 2l₁²)               eq. 4.9 of Rasmussen & Williams (2006)
    rough        a₂² (1 + d + d²/3) exp(−d), d = √5|u − u′|/l₂           Matérn 5/2, eq. 4.17
    reversal     a₃² tanh(u/w) tanh(u′/w)                 the step where the torque reverses
    hysteresis   a₄² bs(1 − |u|) b′s′(1 − |u′|) exp(−(u − u′)² / 2l₄²)   closes at full scale
    drift        d² t t′                                  drift of the zero since its measurement
    noise        σ² where both points are the same one

with s = sign(u) and t the time since the beginning at calibration points (zero elsewhere: the drift
isn't part of the curve). The logarithms of a₁, l₁, a₂, l₂, a₃, a₄, σ (`PARAMETERS`) are unknown,
with independent normal priors of a width of a factor of two to four.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torquebench.compensation.columns import FloatArray

__all__ = ["PARAMETERS", "PRIOR_MEAN", "PRIOR_STD", "KernelPoints", "covariance", "gradients"]

PARAMETERS = (
    "log smooth amplitude",
    "log smooth length",
    "log rough amplitude",
    "log rough length",
    "log reversal amplitude",
    "log hysteresis amplitude",
    "log noise",
)
"""Names of the hyper-parameters, in order."""

PRIOR_MEAN = np.log([3e-4, 0.4, 1e-4, 0.08, 2e-4, 1e-4, 2e-4])
"""Prior means of the hyper-parameters, as logarithms of fractions of full scale."""

PRIOR_STD = np.array([1.2, 0.5, 1.0, 0.5, 1.0, 1.0, 1.0])
"""Prior standard deviations of the hyper-parameters."""

_TREND = 3e-2
_ZERO = 1.5e-4
_DRIFT = 1.4e-4
_STEP_WIDTH = 0.01
_SIDELESS = 5e-4
_HYSTERESIS_LENGTH = 0.5


@dataclass(frozen=True)
class KernelPoints:
    """Points at which a covariance is evaluated.

    Attributes
    ----------
    u : float64 array of shape (n,)
        Reading / full scale.
    branch : float64 array of shape (n,)
        +1 up, −1 down, 0 unknown.
    elapsed : float64 array of shape (clocks, n), optional
        Time since the zero was taken, see `hybrid.calibration_path`.
    """

    u: FloatArray
    branch: FloatArray
    elapsed: FloatArray | None = None

    @property
    def trend(self) -> FloatArray:
        """Columns without hyper-parameters, scaled by their prior standard deviation."""
        u = self.u
        columns = [np.full_like(u, _ZERO), _TREND * u, _TREND * u * u, _TREND * u * np.abs(u)]
        if self.elapsed is not None:
            columns += [_DRIFT * time for time in self.elapsed]
        return np.column_stack(columns)

    @property
    def reversal(self) -> FloatArray:
        """Unit step at torque reversal."""
        return np.asarray(np.tanh(self.u / _STEP_WIDTH))

    @property
    def loop(self) -> FloatArray:
        """Sign and taper of the hysteresis: closed at full scale, ±1 at zero."""
        taper = np.clip(1.0 - np.abs(self.u), 0.0, None)
        return np.asarray(self.branch * np.tanh(self.u / _SIDELESS) * taper)


def covariance(a: KernelPoints, b: KernelPoints, theta: FloatArray) -> FloatArray:
    """Return the covariance of the curve between two sets of points, without noise.

    Parameters
    ----------
    a, b : KernelPoints
        n and m points.
    theta : float64 array of shape (7,)
        Hyper-parameters, see `PARAMETERS`.

    Returns
    -------
    covariance : float64 array of shape (n, m)

    Examples
    --------
    >>> points = KernelPoints(np.array([-0.5, 0.5]), np.array([1.0, 1.0]))
    >>> matrix = covariance(points, points, PRIOR_MEAN)
    >>> bool(np.all(np.linalg.eigvalsh(matrix) > 0))
    True
    """
    left, right = a.trend, b.trend
    shared = min(left.shape[1], right.shape[1])
    trend = left[:, :shared] @ right[:, :shared].T
    return np.asarray(trend + sum(part for part, _ in _parts(a, b, theta)))


def variance(a: KernelPoints, theta: FloatArray) -> FloatArray:
    """Return the diagonal of `covariance`, shape (n,)."""
    smooth, _, rough, _, reversal, hysteresis, _ = np.exp(2 * theta)
    fixed = np.sum(a.trend**2, axis=1) + smooth + rough
    return np.asarray(fixed + reversal * a.reversal**2 + hysteresis * a.loop**2)


def gradients(a: KernelPoints, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the covariance among points, without noise, and its gradient.

    Parameters
    ----------
    a : KernelPoints
        n points.
    theta : float64 array of shape (7,)
        Hyper-parameters.

    Returns
    -------
    covariance : float64 array of shape (n, n)
    gradient : float64 array of shape (6, n, n)
        Derivatives with respect to all hyper-parameters but the noise.
    """
    parts = _parts(a, a, theta)
    slopes: list[FloatArray] = []
    for part, slope in parts:
        slopes.append(2.0 * part)
        if slope is not None:
            slopes.append(slope)
    return np.asarray(a.trend @ a.trend.T + sum(part for part, _ in parts)), np.array(slopes)


def _parts(
    a: KernelPoints, b: KernelPoints, theta: FloatArray
) -> list[tuple[FloatArray, FloatArray | None]]:
    """Return each part of the sum, and its derivative by log length if any."""
    smooth, _, rough, _, reversal, hysteresis, _ = np.exp(2 * theta)
    square = (a.u[:, None] - b.u[None, :]) ** 2
    scaled = square / np.exp(2 * theta[1])
    smooth_part = smooth * np.exp(-0.5 * scaled)
    distance = np.sqrt(5.0 * square) / np.exp(theta[3])
    decay = rough * np.exp(-distance)
    loop = np.outer(a.loop, b.loop) * np.exp(-0.5 * square / _HYSTERESIS_LENGTH**2)
    return [
        (smooth_part, smooth_part * scaled),
        (decay * (1 + distance + distance**2 / 3), decay * distance**2 * (1 + distance) / 3),
        (reversal * np.outer(a.reversal, b.reversal), None),
        (hysteresis * loop, None),
    ]
