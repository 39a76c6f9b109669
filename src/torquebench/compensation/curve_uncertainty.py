"""The standard uncertainty of a model's curve, tabulated, and where it comes from.

The error of a simple form isn't scatter: a parabola through a chain with a loop and ripple has the
same error at the same reading every time, which the covariance of its coefficients doesn't contain.
The truth is unknown, but the hybrid model gives a posterior distribution of it, averaged over all
effects of a chain. A model's value m is therefore compared with this posterior. With the truth f
distributed as N(f̂, s²), the model's error is N(m − f̂, s²), a known bias with a known spread. This
is the discrepancy of M. C. Kennedy and A. O'Hagan (J. R. Stat. Soc. B 63 (2001) 425-464),
conditional on the calibration. The model's values don't change.

An uncorrected bias isn't normally distributed: adding its square to the variance (GUM F.2.4.5)
makes intervals too wide where the bias dominates, as ±1.96 |m − f̂| then covers nearly always. The
half-width U is therefore computed such that 95 % of the error's distribution at a reading, over all
branches that the model doesn't distinguish, are within ±U; the standard uncertainty is U / 1.96. U
is computed from the readings up to the next node of the table: wider neighbourhoods, over which the
bias changes, cover too often, and a mean over narrower ones too rarely where a model is rough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.state import storable
from torquebench.elementwise import Values, located, on_lines

COVERAGE_95 = 1.959964
_HALVINGS = 24


@storable
@dataclass(frozen=True)
class CurveUncertainty:
    """Standard uncertainty of a curve over the readings, on each branch.

    Attributes
    ----------
    nodes : float64 array of shape (n,)
        Readings as fractions of full scale, growing.
    up, down, unknown : float64 array of shape (n,)
        Standard uncertainty at the nodes, as fractions of full scale; linear between them.
    scatter : float or float64 array of shape (n,)
        Standard deviation of single readings about the truth by the same posterior, as a fraction
        of full scale, at the nodes or at all readings; NaN if the model's own noise is used.
    freedom : float
        Degrees of freedom of the scatter; NaN in models of version 0.2.0.
    """

    nodes: FloatArray
    up: FloatArray
    down: FloatArray
    unknown: FloatArray
    scatter: FloatArray | float = float("nan")
    freedom: float = float("nan")

    def at(self, u: FloatArray, branch: FloatArray) -> FloatArray:
        """Return the standard uncertainty at readings u (fractions of full scale).

        Examples
        --------
        >>> curve = CurveUncertainty(np.array([0.0, 1.0]), *np.array([[1, 3], [2, 2], [4, 4]]))
        >>> curve.at(np.array([0.5, 0.5, 0.5]), np.array([1.0, -1.0, 0.0]))
        array([2., 2., 4.])
        """
        std = np.empty(u.size)
        for values, rows in (
            (self.up, branch > 0),
            (self.down, branch < 0),
            (self.unknown, branch == 0),
        ):
            if np.any(rows):
                std[rows] = np.interp(u[rows], self.nodes, values)
        return std

    def scatter_at(self, u: Values) -> Values:
        """Return the scatter of single readings at readings u."""
        if not isinstance(self.scatter, np.ndarray):
            return self.scatter + 0.0 * u
        scatter: Values = on_lines(self.scatter[None], located(self.nodes, u))[0]
        return scatter


def half_widths(bias: FloatArray, spread: FloatArray) -> FloatArray:
    """Return half-widths that contain 95 % of equally weighted mixtures of normal distributions.

    Parameters
    ----------
    bias, spread : float64 array of shape (n, k)
        Mean and standard deviation of the k distributions in each of n mixtures.

    Returns
    -------
    half_width : float64 array of shape (n,)
        By bisection, within 1e-6 of the largest.

    Examples
    --------
    >>> half_widths(np.array([[0.0], [3.0]]), np.array([[1.0], [1.0]])).round(3)
    array([1.96 , 4.645])
    """
    from scipy.special import ndtr  # imported late: a server at rest doesn't need SciPy

    low = np.zeros(bias.shape[0])
    high = np.max(np.abs(bias) + 2.0 * spread, axis=1)
    safe = np.maximum(spread, 1e-12 * np.max(high, initial=1e-300))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        above, below = (middle[:, None] - bias) / safe, (-middle[:, None] - bias) / safe
        enough = np.mean(ndtr(above) - ndtr(below), axis=1) >= 0.95
        high = np.where(enough, middle, high)
        low = np.where(enough, low, middle)
    return np.asarray(high)


def student_widening(freedom: float) -> float:
    """Return Student's 95 % factor over the normal one, because the noise is only estimated.

    Parameters
    ----------
    freedom : float
        Degrees of freedom of the noise; less than 1 counts as 1.

    Examples
    --------
    >>> round(student_widening(20.0), 3)
    1.064
    """
    from scipy.special import stdtrit  # imported late: a server at rest doesn't need SciPy

    return float(stdtrit(max(freedom, 1.0), 0.975)) / COVERAGE_95
