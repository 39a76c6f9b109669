"""How far a simple model's form may be from the truth, judged by what its residuals share.

A form that can't follow the chain leaves residuals that neighbours in reading, of either branch,
have in common; noise doesn't. The residuals are taken as noise plus a Gaussian process whose
amplitude and length aren't known, and the amplitude's mean square is averaged over the marginal
likelihood (Rasmussen & Williams 2006, eq. 5.8), amplitude zero included. This is the model
discrepancy of M. C. Kennedy and A. O'Hagan (J. R. Stat. Soc. B 63 (2001) 425-464), used for the
uncertainty only: the simple model's values stay its own.

A loop that residuals of both branches show, because the form doesn't look at the branch, is fitted
by the four shapes of a loop that closes at full scale, and counts with its half-width. One of them,
open at zero with the same sign in both directions, is what a drift of the zero leaves; half of that
drift went into the curve, and counts everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.state import storable

__all__ = ["Misfit", "estimate_misfit"]

_LENGTHS = (0.04, 0.1, 0.3)
_STEP_REACH = 0.1
_REVERSAL_WIDTH = 0.01
_FEWEST_FOR_LOOP = 12
_NO_MISFIT = 0.3  # prior probability that the form is right
_AMPLITUDES = np.geomspace(0.1, 2.0, 12)  # in units of the residuals' scatter
_NOISES = np.geomspace(0.1, 1.3, 14)


@storable
@dataclass(frozen=True)
class Misfit:
    """What is known of a model's misfit.

    Attributes
    ----------
    amplitude : float
        Root mean square of the misfit, in the residuals' unit.
    noise : float
        Standard deviation of the points without it.
    loop : float64 array of shape (4,)
        Coefficients of the half loop that the form misses.
    """

    amplitude: float
    noise: float
    loop: FloatArray

    def variance(self, u: FloatArray) -> FloatArray:
        """Return the misfit's variance at readings u (fractions of full scale)."""
        half_loop = _loop_columns(u, np.ones_like(u)) @ self.loop
        return np.asarray(self.amplitude**2 * _diagonal(u) + half_loop**2 + self.loop[1] ** 2)


def estimate_misfit(
    u: FloatArray, branch: FloatArray, residual: FloatArray, weights: FloatArray, parameters: float
) -> Misfit:
    """Estimate a model's misfit from its residuals.

    Parameters
    ----------
    u, branch : float64 array of shape (n,)
        Reading / full scale, and branch.
    residual : float64 array of shape (n,)
        Measured minus fitted, in any unit.
    weights : float64 array of shape (n,)
        A point's noise variance is noise² / weight.
    parameters : float
        Number of parameters that the fit took from the data.

    Returns
    -------
    misfit : Misfit

    Examples
    --------
    >>> u = np.linspace(-1.0, 1.0, 60)
    >>> noise = np.random.default_rng(1).normal(size=60)
    >>> found = estimate_misfit(u, np.ones(60), noise + 3 * np.sin(9 * u), np.ones(60), 1.0)
    >>> bool(1.0 < found.amplitude < 6.0), bool(0.7 < found.noise < 1.4)
    (True, True)
    """
    loop = _fit_loop(u, branch, residual, weights)
    residual = residual - _loop_columns(u, branch) @ loop
    freedom = max(residual.size - parameters - np.count_nonzero(loop), 1.0)
    scale = float(np.sqrt(np.sum(weights * residual**2) / freedom))
    if scale == 0.0:
        return Misfit(0.0, 0.0, loop)
    root = np.sqrt(weights)
    # A fit takes as much from its residuals as it has parameters; give that back.
    scaled = root * residual / scale * np.sqrt(residual.size / freedom)
    amplitudes = np.concatenate([[0.0], _AMPLITUDES])
    log_likelihood = np.empty((len(_LENGTHS), amplitudes.size, _NOISES.size))
    for k, length in enumerate(_LENGTHS):
        values, vectors = np.linalg.eigh(_kernel(u, length) * np.outer(root, root))
        power = (vectors.T @ scaled) ** 2
        misfit2 = amplitudes[:, None, None] ** 2 * np.maximum(values, 0.0)
        total = misfit2 + _NOISES[None, :, None] ** 2
        log_likelihood[k] = -0.5 * np.sum(power / total + np.log(total), axis=2)
    prior = np.full(amplitudes.size, (1.0 - _NO_MISFIT) / _AMPLITUDES.size)
    prior[0] = _NO_MISFIT
    share = np.exp(log_likelihood - log_likelihood.max()) * prior[None, :, None]
    share /= share.sum()
    amplitude2 = float(share.sum(axis=(0, 2)) @ amplitudes**2)
    noise2 = float(share.sum(axis=(0, 1)) @ _NOISES**2)
    return Misfit(scale * float(np.sqrt(amplitude2)), scale * float(np.sqrt(noise2)), loop)


def _fit_loop(
    u: FloatArray, branch: FloatArray, residual: FloatArray, weights: FloatArray
) -> FloatArray:
    """Fit the half loop by least squares, where both branches were measured."""
    if not (np.any(branch > 0) and np.any(branch < 0)) or u.size < _FEWEST_FOR_LOOP:
        return np.zeros(4)
    root = np.sqrt(weights)
    columns = _loop_columns(u, branch) * root[:, None]
    return np.asarray(np.linalg.lstsq(columns, residual * root, rcond=1e-6)[0])


def _loop_columns(u: FloatArray, branch: FloatArray) -> FloatArray:
    """Return loops that are closed or open at zero, with and without the torque's sign."""
    x, side = np.abs(u), np.where(u < 0.0, -1.0, 1.0)  # at zero the limit from above
    rest = branch * np.clip(1.0 - x, 0.0, None)
    return np.column_stack([rest * x, rest, side * rest * x, side * rest])


def _kernel(u: FloatArray, length: float) -> FloatArray:
    local = np.exp(-0.5 * ((u[:, None] - u[None, :]) / length) ** 2)
    step = np.tanh(u / _REVERSAL_WIDTH) * np.exp(-np.abs(u) / _STEP_REACH)
    return np.asarray(local + np.outer(step, step))


def _diagonal(u: FloatArray) -> FloatArray:
    return np.asarray(1.0 + (np.tanh(u / _REVERSAL_WIDTH) * np.exp(-np.abs(u) / _STEP_REACH)) ** 2)
