"""Digital filters along a stream, with the standard uncertainty of every sample."""

from __future__ import annotations

from collections.abc import Iterable
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.dynamics.convolution import convolve_uncertain
from torquebench.elementwise import Values, elementwise, in_rows
from torquebench.errors import InputError
from torquebench.message import Message

FloatArray = NDArray[np.float64]

_NEGLIGIBLE = 1e-15  # of the largest eigenvalue, for rounding of the covariance


class Filtered(NamedTuple):
    """Filtered samples.

    Attributes
    ----------
    value : float64[n]
        Filtered values; NaN where the input is NaN.
    of_coefficients : float64[n]
        Standard uncertainty by the filter's coefficients.
    of_noise : float64[n]
        Standard uncertainty by that of the input.
    """

    value: FloatArray
    of_coefficients: FloatArray
    of_noise: FloatArray

    @property
    def standard_uncertainty(self) -> FloatArray:
        """Combined standard uncertainty u of every sample."""
        return np.asarray(np.hypot(self.of_coefficients, self.of_noise))


@dataclass(frozen=True, eq=False)
class UncertainFilter:
    """A digital filter Σ wₖx[n−k] without feedback whose coefficients are uncertain.

    The variance is exact to second order (Elster and Link, Metrologia 45 (2008) 464, equation 33).

    Parameters
    ----------
    weights : array_like of shape (m,)
        w.
    covariance : array_like of shape (m, m), optional
        Covariance of the coefficients; by default they are exact. Uncorrelated ones are faster.

    Raises
    ------
    InputError
        No coefficients, or a covariance of another shape.

    Examples
    --------
    >>> smooth = UncertainFilter([0.25, 0.5, 0.25])
    >>> step = smooth.stream().push(np.array([0.0, 0.0, 1.0, 1.0, 1.0]), np.full(5, 0.1))
    >>> step.value.tolist(), step.standard_uncertainty.round(4).tolist()
    ([0.0, 0.0, 0.25, 0.75, 1.0], [0.0612, 0.0612, 0.0612, 0.0612, 0.0612])
    """

    weights: FloatArray
    covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        weights = np.array(self.weights, np.float64, ndmin=1)
        if weights.ndim != 1 or not weights.size or not np.isfinite(weights).all():
            raise InputError("coefficients of a filter", "finite numbers, one at least")
        object.__setattr__(self, "weights", weights)
        if self.covariance is None:
            return
        covariance, number = np.array(self.covariance, np.float64), weights.size
        if covariance.shape != (number, number) or not np.isfinite(covariance).all():
            raise InputError(
                Message("a covariance of shape {shape}", covariance.shape),
                Message("({number}, {number}), finite", number),
            )
        object.__setattr__(self, "covariance", covariance)

    @cached_property
    def factors(self) -> FloatArray:
        """Rows whose outer products add up to the covariance; few rows if its rank is low."""
        if self.covariance is None:
            return np.empty((0, self.weights.size))
        values, vectors = np.linalg.eigh(0.5 * (self.covariance + self.covariance.T))
        largest = float(np.max(np.abs(values)))
        if values[0] < -1e-9 * largest:
            raise InputError(
                Message("a covariance with the eigenvalue {values:.3g}", values[0]), "none below 0"
            )
        significant = values > _NEGLIGIBLE * largest
        return np.ascontiguousarray((vectors[:, significant] * np.sqrt(values[significant])).T)

    def stream(self) -> FilterStream:
        """Return this filter for one stream."""
        return FilterStream(self)

    def response(self, frequency_hz: ArrayLike, interval_s: float) -> NDArray[np.complex128]:
        """Return the frequency response at a sample interval."""
        turn = np.exp(-2j * np.pi * np.asarray(frequency_hz, np.float64) * interval_s)
        return np.asarray(np.polyval(self.weights[::-1], turn))


class FilterStream:
    """Filter for a stream of consecutive blocks.

    The signal is assumed constant before its first sample and after a fault (NaN), which restarts
    the filter. Results don't depend on the division into blocks, to the last digit.
    """

    def __init__(self, filter: UncertainFilter) -> None:  # noqa: A002 - the field's word
        self._factors = np.ascontiguousarray(filter.factors)
        variances = np.sum(np.square(self._factors), axis=0)
        squares = np.square(filter.weights) + variances
        self._weights = np.stack((filter.weights, squares, variances))
        covariance = filter.covariance
        if covariance is not None and not np.any(covariance - np.diag(np.diag(covariance))):
            self._factors = self._factors[:0]
        self._begun = False
        self._past = np.empty((2, len(squares) - 1))

    def copy(self) -> FilterStream:
        """Return a second stream in the same state."""
        other = copy(self)
        other._past = self._past.copy()
        return other

    def forget(self) -> None:
        """Restart with the next sample, as after a gap."""
        self._begun = False

    def correct(self, values: FloatArray, uncertainty: FloatArray) -> Any:
        """Filter the next samples of a stream that continues without a fault.

        Parameters
        ----------
        values, uncertainty : float64 array of shape (n,)

        Returns
        -------
        float64 array of shape (3, n), three floats for a single sample, or None
            Correction, standard uncertainty by the coefficients, and the part that the filter adds
            to the uncertainty of the samples. None, without filtering, at the start or with a fault
            among the samples; these need `push`.
        """
        like: Values = values if values.size > 1 else values.item()
        number, (before, spread) = elementwise(like, values, uncertainty)
        usable = (abs(before) < np.inf) & (spread >= 0.0) & (spread < np.inf)
        if not self._begun or not number.all(usable):
            return None
        _, (value, coefficients, noise) = elementwise(like, *self._run(values, uncertainty))
        u = number.sqrt(noise)
        added = number.sqrt(number.maximum(u * u - spread * spread, 0.0))
        return in_rows(like, value - before, number.sqrt(coefficients), added)

    def push(self, values: FloatArray, uncertainty: FloatArray) -> Filtered:
        """Filter the next samples; a fault (NaN) gives NaN.

        Raises
        ------
        InputError
            Uncertainties of another shape, below 0 or not finite.
        """
        samples, spread = (
            np.ascontiguousarray(column, np.float64) for column in (values, uncertainty)
        )
        if samples.ndim != 1 or spread.shape != samples.shape:
            raise InputError(
                Message("samples {shape} and uncertainties {other}", samples.shape, spread.shape),
                "two equal rows",
            )
        finite = np.isfinite(samples)
        if not ((spread >= 0.0) & (spread < np.inf))[finite].all():
            raise InputError("an uncertainty that isn't finite or is below 0", "0 or more")
        result = Filtered(*np.full((3, samples.size), np.nan))
        for start, stop in _runs(finite):
            if not finite[start]:
                self.forget()
                continue
            part = slice(start, stop)
            value, coefficients, noise = self._run(samples[part], spread[part])
            result.value[part] = value
            result.of_coefficients[part] = np.sqrt(coefficients)
            result.of_noise[part] = np.sqrt(noise)
        return result

    def _run(self, values: FloatArray, spread: FloatArray) -> tuple[FloatArray, ...]:
        """Filter samples; before the first one the signal is taken for constant."""
        if not self._begun:
            self._begun = True
            self._past[0], self._past[1] = values[0], spread[0] ** 2
        return convolve_uncertain(self._past, values, spread, self._weights, self._factors)


def _runs(finite: NDArray[np.bool_]) -> Iterable[tuple[int, int]]:
    """Return begin and end of the runs of finite and of missing samples."""
    if not finite.size:
        return []
    cuts = (np.flatnonzero(np.diff(finite)) + 1).tolist()
    return list(zip([0, *cuts], [*cuts, finite.size], strict=True))
