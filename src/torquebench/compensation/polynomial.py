"""Polynomials in the reading, orthogonal on the calibration points."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Integral
from typing import ClassVar

import numpy as np

from torquebench.compensation.columns import FloatArray
from torquebench.compensation.discrepancy import FormModel
from torquebench.compensation.estimator import Between, Truth, parameter
from torquebench.compensation.kinds import register
from torquebench.compensation.state import storable
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.progress import Progress


@storable
@dataclass(frozen=True)
class OrthogonalPolynomial:
    """A least-squares polynomial in the basis that is orthogonal over its own points.

    The basis follows the three-term recurrence p₍ₖ₊₁₎ = (u − αₖ) pₖ − βₖ p₍ₖ₋₁₎ in u = (x −
    centre)/scale (G. E. Forsythe, J. SIAM 5 (1957) 74-88), which avoids an ill-conditioned
    Vandermonde matrix. For a polynomial through zero every basis function is multiplied by u, with
    centre 0.

    Attributes
    ----------
    centre, scale : float
        Centre and half-span of the points.
    alpha, beta : float64 array of shape (degree + 1,)
        Recurrence coefficients.
    norms : float64 array of shape (degree + 1,)
        Weighted sum of squares of each basis function over the points.
    coefficients : float64 array of shape (degree + 1,)
        Coefficients of the basis functions.
    through_zero : bool
        Whether the polynomial vanishes at 0.
    """

    centre: float
    scale: float
    alpha: FloatArray
    beta: FloatArray
    norms: FloatArray
    coefficients: FloatArray
    through_zero: bool

    def basis(self, x: FloatArray) -> FloatArray:
        """Return the basis functions at x, shape (len(coefficients), n)."""
        u = (x - self.centre) / self.scale
        return _recurrence(u, self.alpha, self.beta, u if self.through_zero else np.ones_like(u))

    def __call__(self, x: FloatArray) -> FloatArray:
        """Evaluate the polynomial."""
        return np.asarray(self.coefficients @ self.basis(x))

    def relative_variance(self, x: FloatArray) -> FloatArray:
        """Return the variance of the fitted value at x, relative to the noise variance."""
        return np.asarray((1.0 / self.norms) @ self.basis(x) ** 2)


def _recurrence(
    u: FloatArray, alpha: FloatArray, beta: FloatArray, first: FloatArray
) -> FloatArray:
    """Return the orthogonal polynomials at u by their three-term recurrence."""
    basis = np.empty((alpha.size, u.size))
    basis[0] = first
    for k in range(alpha.size - 1):
        basis[k + 1] = (u - alpha[k]) * basis[k]
        if k > 0:
            basis[k + 1] -= beta[k] * basis[k - 1]
    return basis


def fit_orthogonal(
    x: FloatArray, y: FloatArray, weights: FloatArray, degree: int, through_zero: bool = False
) -> OrthogonalPolynomial:
    """Fit a polynomial by weighted least squares.

    Parameters
    ----------
    x, y, weights : float64 array of shape (n,)
        Points and their weights.
    degree : int
        Degree; n must be larger.
    through_zero : bool, default False
        Leave the constant out.

    Examples
    --------
    >>> x = np.linspace(0.0, 10.0, 6)
    >>> fit = fit_orthogonal(x, 1.0 + 2.0 * x**2, np.ones(6), degree=2)
    >>> fit(np.array([3.0])).round(9)
    array([19.])
    """
    low, high = float(np.min(x)), float(np.max(x))
    centre = 0.0 if through_zero else 0.5 * (low + high)
    scale = max(high - centre, centre - low)
    u = (x - centre) / scale
    count = degree + (0 if through_zero else 1)
    alpha, beta, norms = np.zeros(count), np.zeros(count), np.zeros(count)
    basis = np.empty((count, u.size))
    basis[0] = u if through_zero else 1.0
    for k in range(count):
        norms[k] = np.sum(weights * basis[k] ** 2)
        alpha[k] = np.sum(weights * u * basis[k] ** 2) / norms[k]
        if k > 0:
            beta[k] = norms[k] / norms[k - 1]
        if k + 1 < count:
            basis[k + 1] = (u - alpha[k]) * basis[k]
            if k > 0:
                basis[k + 1] -= beta[k] * basis[k - 1]
    coefficients = np.zeros(count)
    residual = y.copy()
    for _ in range(2):  # the second pass removes the rounding errors of the first
        for k in range(count):
            step = np.sum(weights * basis[k] * residual) / norms[k]
            coefficients[k] += step
            residual = residual - step * basis[k]
    return OrthogonalPolynomial(centre, scale, alpha, beta, norms, coefficients, through_zero)


@register("polynomial")
class PolynomialModel(FormModel):
    """Polynomial of any degree in the reading, joint or one per direction.

    Parameters
    ----------
    degree : int, default 2
        Degree; the sources use 2 (equation 15: c₀ + c₁T + c₂T²).
    per_direction : bool, default False
        One polynomial for readings above and one for readings below zero.
    through_zero : bool, default False
        Leave the constant out, so that the reading 0 is compensated to exactly 0.
    range_nm, range_margin, outliers
        See `CompensationModel`.

    Attributes
    ----------
    polynomials_ : list of OrthogonalPolynomial
        One joint polynomial, or one for negative and one for positive readings.

    Notes
    -----
    The basis is centred, scaled and orthogonal over the points, so that NIST's load-cell data
    (Pontius) are reproduced to 12 digits. With fewer than five points, the uncertainty is the usual
    covariance of least squares, with the noise from the residuals and n − p degrees of freedom.

    Examples
    --------
    >>> import numpy as np
    >>> reading = np.linspace(-2000.0, 2000.0, 21)
    >>> standard = reading + 2.0 + 1e-3 * reading + 1e-6 * reading**2
    >>> model = PolynomialModel(degree=2).fit(reading[:, None], standard)
    >>> model.predict([[1000.0]]).round(6)
    array([1004.])
    """

    degree: int = parameter(Between(Integral, 1, 30), default=2)
    per_direction: bool = parameter(Truth(), default=False)
    through_zero: bool = parameter(Truth(), default=False)

    complexity: ClassVar[int] = 10
    maximum_points = None

    def _minimum_points(self) -> int:
        return self.degree + (1 if self.through_zero else 2)

    def _minimum_distinct(self) -> int:
        return self.degree + (0 if self.through_zero else 1)

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, _progress: Progress) -> None:
        """Fit one polynomial to all readings, or one to each direction."""
        reading = X[:, 0]
        sides = [np.ones(reading.size, dtype=bool)]
        if self.per_direction:
            sides = [side for side in (reading <= 0.0, reading >= 0.0) if np.ptp(reading[side]) > 0]
        self.polynomials_: list[OrthogonalPolynomial] = []
        for side in sides:
            self._refuse_short_side(reading[side])
            self.polynomials_.append(
                fit_orthogonal(
                    reading[side], y[side], weights[side], self.degree, self.through_zero
                )
            )
        residual = y - self._evaluate(reading)
        self.effective_parameters_ = float(sum(p.norms.size for p in self.polynomials_))
        freedom = y.size - self.effective_parameters_
        self.noise_nm_ = float(np.sqrt(np.sum(weights * residual**2) / freedom))

    def _refuse_short_side(self, reading: FloatArray) -> None:
        """Refuse a direction with fewer distinct readings than its polynomial needs."""
        distinct = np.unique(reading).size
        if distinct < self._minimum_distinct():
            direction = "clockwise" if np.max(reading) > 0 else "counter-clockwise"
            raise InputError(
                Message("{distinct} readings in the {direction} direction", distinct, direction),
                Message(
                    "at least {minimum_distinct} for degree {degree}",
                    self._minimum_distinct(),
                    self.degree,
                ),
                "record more points there or take a joint polynomial",
            )

    @property
    def name(self) -> str:
        """The kind and the degree."""
        return f"{self.kind}-{self.degree}"

    def _predict(self, X: FloatArray) -> FloatArray:
        return self._evaluate(X[:, 0])

    def _coefficient_std(self, X: FloatArray) -> FloatArray:
        reading = X[:, 0]
        variance = self._pick(reading, [p.relative_variance(reading) for p in self.polynomials_])
        return np.asarray(self.noise_nm_ * np.sqrt(variance))

    def _evaluate(self, reading: FloatArray) -> FloatArray:
        return self._pick(reading, [polynomial(reading) for polynomial in self.polynomials_])

    def _pick(self, reading: FloatArray, values: list[FloatArray]) -> FloatArray:
        """Return each reading's value by the polynomial of its direction."""
        return values[0] if len(values) == 1 else np.where(reading < 0.0, values[0], values[1])
