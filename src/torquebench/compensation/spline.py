"""Cubic smoothing spline with the smoothing inferred from the data, and its uncertainty."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_factor, cho_solve

from torquebench.compensation.base import CompensationModel, FloatArray
from torquebench.compensation.estimator import OneOf, parameter
from torquebench.compensation.kinds import register
from torquebench.progress import Progress

__all__ = ["SplineModel", "integrated_wiener_kernel"]

_MERGED_SHARE_OF_SPAN = 1e-5  # readings closer than this share one knot
_LEAST_SMOOTHING = 1e-11  # of the largest eigenvalue, for data without noise
_MOST_SMOOTHING = 1e4


def integrated_wiener_kernel(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the covariance of an integrated Wiener process, whose mean is a cubic spline.

    G. Wahba, J. Royal Statistical Society B 40 (1978) 364-372.

    Parameters
    ----------
    a : float64 array of shape (n,)
    b : float64 array of shape (m,)
        Positions from 0.

    Returns
    -------
    kernel : float64 array of shape (n, m)

    Examples
    --------
    >>> integrated_wiener_kernel(np.array([1.0]), np.array([1.0, 2.0])).round(6)
    array([[0.333333, 0.833333]])
    """
    smaller = np.minimum.outer(a, b)
    larger = np.maximum.outer(a, b)
    return np.asarray(smaller**2 * (larger / 2.0 - smaller / 6.0))


@register("spline")
class SplineModel(CompensationModel):
    """Cubic smoothing spline of the additional torque over the reading.

    Parameters
    ----------
    criterion : {"reml", "gcv"}, default "reml"
        Smoothing by restricted maximum likelihood, or by generalised cross-validation as SciPy's
        `make_smoothing_spline`. The former errs less often towards too little smoothing.
    range_nm, range_margin, outliers
        See `CompensationModel`.

    Attributes
    ----------
    smoothing_ : float
        λ of Σ w (y − f)² + λ ∫ f''² over the span of the readings scaled to 0 ... 1.

    Notes
    -----
    The spline is the posterior mean of a straight line with a flat prior plus an integrated Wiener
    process; the uncertainty is that posterior's (G. Wahba, J. Royal Statistical Society B 45
    (1983) 133-150).

    Examples
    --------
    >>> import numpy as np
    >>> reading = np.linspace(-2000.0, 2000.0, 41)
    >>> standard = reading + 2.0 + 1e-3 * reading + 1e-6 * reading**2
    >>> model = SplineModel().fit(reading[:, None], standard)
    >>> model.predict([[1000.0]]).round(3)
    array([1004.])
    """

    criterion: str = parameter("reml", OneOf(frozenset({"reml", "gcv"})))

    complexity: ClassVar[int] = 20
    maximum_points: int | None = 600

    knots_: FloatArray
    knot_weights_: FloatArray
    fitted_: FloatArray

    def _minimum_points(self) -> int:
        return 5

    def _fit(self, X: FloatArray, y: FloatArray, weights: FloatArray, _progress: Progress) -> None:
        reading, additional = X[:, 0], y - X[:, 0]
        self.span_nm_ = float(np.ptp(reading))
        step = np.diff(reading) > _MERGED_SHARE_OF_SPAN * self.span_nm_
        group = np.concatenate([[0], np.cumsum(step)])
        self.knot_weights_ = np.bincount(group, weights).astype(np.float64)
        self.knots_ = np.bincount(group, weights * reading) / self.knot_weights_
        means = np.bincount(group, weights * additional) / self.knot_weights_
        within = float(np.sum(weights * (additional - means[group]) ** 2))
        self._choose_smoothing(means, within, y.size)
        self._after_restore()
        line = self._line(self._positions(self.knots_))
        coefficients = cho_solve(self._system, means)
        slope = self._line_covariance @ (line.T @ coefficients)
        trend = line @ slope
        kernel = self._kernel(self._positions(self.knots_))
        self.fitted_ = trend + kernel @ cho_solve(self._system, means - trend)
        self._spline = CubicSpline(self.knots_, self.fitted_, bc_type="natural")

    def _positions(self, reading: FloatArray) -> FloatArray:
        """Scale readings to 0 ... 1 from the lowest accepted one."""
        return (reading - self.reading_low_nm_) / self.span_nm_

    @staticmethod
    def _line(positions: FloatArray) -> FloatArray:
        return np.column_stack([np.ones_like(positions), positions])

    def _kernel(self, positions: FloatArray) -> FloatArray:
        return integrated_wiener_kernel(positions, self._positions(self.knots_)) / self.smoothing_

    def _choose_smoothing(self, means: FloatArray, within: float, count: int) -> None:
        """Find λ in the basis that diagonalises both kernel and noise."""
        positions = self._positions(self.knots_)
        root = np.sqrt(self.knot_weights_)
        scaled_line = self._line(positions) * root[:, None]
        complement = np.linalg.qr(scaled_line, mode="complete")[0][:, 2:]
        kernel = integrated_wiener_kernel(positions, positions) * np.multiply.outer(root, root)
        values, vectors = np.linalg.eigh(complement.T @ kernel @ complement)
        values = np.maximum(values, 0.0)
        squares = (vectors.T @ (complement.T @ (root * means))) ** 2
        floor = 1e-24 * (float(np.sum(squares)) + within) + 1e-300

        def reml(log_smoothing: float) -> float:
            smoothing = np.exp(log_smoothing)
            noise = within + np.sum(squares * smoothing / (values + smoothing)) + floor
            log_determinant = np.sum(np.log1p(values / smoothing))
            return float((count - 2) * np.log(noise) + log_determinant)

        def gcv(log_smoothing: float) -> float:
            smoothing = np.exp(log_smoothing)
            left = smoothing / (values + smoothing)
            freedom = np.sum(left) + count - self.knots_.size
            return float(np.log(within + np.sum(squares * left**2) + floor) - 2 * np.log(freedom))

        largest = float(values[-1])
        limits = (np.log(_LEAST_SMOOTHING * largest), np.log(_MOST_SMOOTHING * largest))
        log_smoothing = _minimum(reml if self.criterion == "reml" else gcv, limits)
        self.smoothing_ = float(np.exp(log_smoothing))
        left = self.smoothing_ / (values + self.smoothing_)
        self.effective_parameters_ = float(2 + np.sum(1.0 - left))
        if self.criterion == "reml":
            noise_variance = (within + float(np.sum(squares * left))) / (count - 2)
        else:
            freedom = count - self.effective_parameters_
            noise_variance = (within + float(np.sum(squares * left**2))) / freedom
        self.noise_nm_ = float(np.sqrt(noise_variance))

    def _after_restore(self) -> None:
        positions = self._positions(self.knots_)
        system = self._kernel(positions)
        system[np.diag_indices_from(system)] += 1.0 / self.knot_weights_
        self._system = cho_factor(system, lower=True)
        self._line_solved = cho_solve(self._system, self._line(positions))
        self._line_covariance = np.linalg.inv(self._line(positions).T @ self._line_solved)
        if hasattr(self, "fitted_"):
            self._spline = CubicSpline(self.knots_, self.fitted_, bc_type="natural")

    def _predict(self, X: FloatArray, return_std: bool) -> tuple[FloatArray, FloatArray | None]:
        reading = X[:, 0]
        inside = np.clip(reading, self.knots_[0], self.knots_[-1])
        beyond = reading - inside  # a natural spline continues as a straight line
        torque = reading + self._spline(inside) + beyond * self._spline(inside, 1)
        if not return_std:
            return torque, None
        positions = self._positions(reading)
        cross = self._kernel(positions)
        own = positions**3 / (3.0 * self.smoothing_)
        explained = np.sum(cross.T * cho_solve(self._system, cross.T), axis=0)
        open_line = self._line(positions) - cross @ self._line_solved
        of_line = np.sum((open_line @ self._line_covariance) * open_line, axis=1)
        variance = np.maximum(own - explained + of_line, 0.0)
        return torque, self.noise_nm_ * np.sqrt(variance)


def _minimum(function: Callable[[float], float], limits: tuple[float, float]) -> float:
    """Return the minimum of a coarse grid, refined: the criteria have several minima."""
    from scipy.optimize import minimize_scalar  # imported late: other models don't need it

    grid = np.linspace(*limits, 60)
    best = int(np.argmin([function(position) for position in grid]))
    bracket = (grid[max(best - 1, 0)], grid[min(best + 1, grid.size - 1)])
    refined = minimize_scalar(function, bounds=bracket, method="bounded", options={"xatol": 1e-6})
    return float(refined.x)
