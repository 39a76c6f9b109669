"""A straight line through points, with the covariance of its coefficients."""

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty.propagation import propagate
from torquebench.uncertainty.quantity import Quantity

__all__ = ["LineFit", "fit_line"]


@dataclass(frozen=True)
class LineFit:
    """Ordinary least-squares line y = intercept + slope·(x − reference) (GUM, H.3).

    Attributes
    ----------
    intercept, slope : float
        Coefficients; the intercept is the line's value at `reference`.
    intercept_uncertainty, slope_uncertainty : float
        Their standard uncertainties.
    correlation : float
        Between the two.
    residual_deviation : float
        Standard deviation of a single point about the line.
    degrees_of_freedom : int
        Number of points less 2.
    reference : float
        Where x − reference is 0.
    """

    intercept: float
    slope: float
    intercept_uncertainty: float
    slope_uncertainty: float
    correlation: float
    residual_deviation: float
    degrees_of_freedom: int
    reference: float

    def at(self, x: float) -> Quantity:
        """Value of the line at `x`, with the standard uncertainty of the line there."""
        freedom = float(self.degrees_of_freedom)
        budget = propagate(
            lambda intercept, slope: intercept + slope * (x - self.reference),
            [
                Quantity("intercept", self.intercept, self.intercept_uncertainty, freedom),
                Quantity("slope", self.slope, self.slope_uncertainty, freedom),
            ],
            correlations={("intercept", "slope"): self.correlation},
            derivatives=[1.0, x - self.reference],
        )
        return Quantity("line", budget.value, budget.standard_uncertainty, freedom)


def fit_line(x: ArrayLike, y: ArrayLike, reference: float = 0.0) -> LineFit:
    """Fit a straight line by ordinary least squares.

    Parameters
    ----------
    x, y : array_like of shape (n,)
        Points; x is taken as exact.
    reference : float
        Where the intercept is stated.

    Returns
    -------
    LineFit
        Coefficients with their covariance. x is centred for the solution, so that offsets far
        larger than the spread cost no digits.

    Raises
    ------
    InputError
        With fewer than three points, unequal lengths, or one x only.

    Examples
    --------
    >>> line = fit_line([0.0, 1.0, 2.0, 3.0], [1.0, 3.1, 4.9, 7.0])
    >>> round(line.slope, 3), round(line.intercept, 3), round(line.correlation, 3)
    (1.98, 1.03, -0.802)
    """
    abscissa = np.asarray(x, dtype=np.float64)
    ordinate = np.asarray(y, dtype=np.float64)
    if abscissa.ndim != 1 or abscissa.shape != ordinate.shape or abscissa.size < 3:
        raise InputError(
            Message(
                "points of shapes {shape} and {ordinate_shape}", abscissa.shape, ordinate.shape
            ),
            "two columns of equal length, at least 3",
        )
    _require_finite(abscissa, ordinate)
    centre = float(np.mean(abscissa))
    offset = abscissa - centre
    squares = float(offset @ offset)
    if squares == 0.0:
        raise InputError(
            Message("all points lie at x = {centre:g}", centre), "at least two different x"
        )
    mean = float(np.mean(ordinate))
    slope = float(offset @ (ordinate - mean)) / squares
    residuals = ordinate - mean - slope * offset
    freedom = abscissa.size - 2
    deviation = sqrt(float(residuals @ residuals) / freedom)
    shift = reference - centre
    intercept_factor = sqrt(1.0 / abscissa.size + shift * shift / squares)
    slope_factor = sqrt(1.0 / squares)
    return LineFit(
        mean + slope * shift,
        slope,
        deviation * intercept_factor,
        deviation * slope_factor,
        (shift / squares) / (intercept_factor * slope_factor),
        deviation,
        freedom,
        reference,
    )


def _require_finite(*columns: NDArray[np.float64]) -> None:
    if not all(np.all(np.isfinite(column)) for column in columns):
        raise InputError("a point that is not finite", "finite points")
