"""Digital filters along a stream, with the standard uncertainty of every sample."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["FilterStream", "Filtered", "UncertainFilter"]

FloatArray = NDArray[np.float64]

_NEGLIGIBLE = 1e-15  # of the largest eigenvalue: rounding of the covariance
_LONGEST_RESPONSE = 1_000_000


class Filtered(NamedTuple):
    """Filtered samples.

    Attributes
    ----------
    value : float64[n]
        NaN where the input is.
    of_coefficients : float64[n]
        Standard uncertainty by the filter's coefficients.
    of_noise : float64[n]
        Standard uncertainty by the input's.
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
    """A digital filter Σ bₖx[n−k] − Σ aₖy[n−k] whose coefficients are uncertain.

    Without feedback the variance is exact to second order (Elster and Link, Metrologia 45 (2008)
    464, equation 33); with feedback it is of first order (Link and Elster 2009).

    Parameters
    ----------
    numerator : array_like of shape (m,)
        b.
    denominator : array_like of shape (p,)
        a, beginning with 1; [1] without feedback.
    covariance : array_like, optional
        Of (a₁ …, b₀ …), for a filter without feedback of b. Exact coefficients without it.
        Uncorrelated ones are quick.

    Raises
    ------
    InputError
        No coefficients, a[0] other than 1, an unstable filter, or a covariance of another shape.

    Examples
    --------
    >>> smooth = UncertainFilter([0.25, 0.5, 0.25])
    >>> step = smooth.apply([0.0, 0.0, 1.0, 1.0, 1.0], [0.1, 0.1, 0.1, 0.1, 0.1])
    >>> step.value.tolist(), step.standard_uncertainty.round(4).tolist()
    ([0.0, 0.0, 0.25, 0.75, 1.0], [0.0612, 0.0612, 0.0612, 0.0612, 0.0612])
    """

    numerator: FloatArray
    denominator: FloatArray = field(default_factory=lambda: np.ones(1))
    covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        b, a = (np.array(each, np.float64, ndmin=1) for each in (self.numerator, self.denominator))
        if (
            b.ndim != 1
            or a.ndim != 1
            or not b.size
            or not np.isfinite(np.concatenate([b, a])).all()
        ):
            raise InputError("coefficients of a filter", "finite numbers, one at least")
        if a.size == 0 or a[0] != 1.0:
            raise InputError(
                Message("a filter whose a[0] is {a}", a[0] if a.size else "missing"),
                "1",
                "divide all coefficients by a[0]",
            )
        largest = float(np.max(np.abs(np.roots(a)), initial=0.0))
        if largest >= 1.0:
            raise InputError(
                Message("a filter with a pole at {largest:.6g}", largest),
                "poles inside of the unit circle",
            )
        object.__setattr__(self, "numerator", b)
        object.__setattr__(self, "denominator", a)
        if self.covariance is not None:
            covariance = np.array(self.covariance, np.float64)
            number = a.size - 1 + b.size
            if covariance.shape != (number, number) or not np.isfinite(covariance).all():
                raise InputError(
                    Message("a covariance of shape {shape}", covariance.shape),
                    Message("({number}, {number}), finite: of a without a[0], then b", number),
                )
            object.__setattr__(self, "covariance", covariance)

    @property
    def recursive(self) -> bool:
        """Whether the filter feeds its output back."""
        return self.denominator.size > 1

    @cached_property
    def factors(self) -> FloatArray:
        """Rows whose outer products sum up to the covariance; few where it is of low rank."""
        if self.covariance is None:
            return np.empty((0, self.numerator.size))
        values, vectors = np.linalg.eigh(0.5 * (self.covariance + self.covariance.T))
        largest = float(np.max(np.abs(values)))
        if values[0] < -1e-9 * largest:
            raise InputError(
                Message("a covariance with the eigenvalue {values:.3g}", values[0]), "none below 0"
            )
        kept = values > _NEGLIGIBLE * largest
        return np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T)

    def behind(self, low_pass: ArrayLike) -> UncertainFilter:
        """Return this filter after an exact one without feedback, as one filter.

        Raises
        ------
        InputError
            If this filter feeds its output back.
        """
        if self.recursive:
            raise InputError("a filter with feedback", "one without, to be joined with a low-pass")
        before = np.asarray(low_pass, np.float64)
        covariance = None
        if self.covariance is not None:
            matrix = np.array([np.convolve(row, before) for row in np.eye(self.numerator.size)])
            covariance = matrix.T @ self.covariance @ matrix
        return UncertainFilter(np.convolve(self.numerator, before), covariance=covariance)

    def stream(self, autocovariance: ArrayLike | None = None) -> FilterStream:
        """Return a filter for one stream.

        Parameters
        ----------
        autocovariance : array_like of shape (m,), optional
            Of stationary noise at lags of 0, 1, … samples, for noise that isn't white: then no
            uncertainties of single samples are taken.
        """
        return FilterStream(self, autocovariance)

    def apply(
        self,
        values: ArrayLike,
        uncertainty: ArrayLike | None = None,
        *,
        autocovariance: ArrayLike | None = None,
    ) -> Filtered:
        """Filter a whole signal, which was constant before its first sample.

        Parameters
        ----------
        values : array_like of shape (n,)
        uncertainty : array_like of shape (n,) or float, optional
            Standard uncertainties of samples with white noise, which may change with time.
        autocovariance : array_like, optional
            As of `stream`.
        """
        return self.stream(autocovariance).push(values, uncertainty)

    def response(self, frequency_hz: ArrayLike, interval_s: float) -> NDArray[np.complex128]:
        """Return the frequency response at a sample interval."""
        turn = np.exp(-2j * np.pi * np.asarray(frequency_hz, np.float64) * interval_s)
        above, below = (np.polyval(each[::-1], turn) for each in (self.numerator, self.denominator))
        return np.asarray(above / below)

    def noise_variance(self, autocovariance: ArrayLike) -> float:
        """Return the output's variance by stationary noise of an autocovariance."""
        covariance = np.asarray(autocovariance, np.float64)
        if covariance.ndim != 1 or not covariance.size or not np.isfinite(covariance).all():
            raise InputError("an autocovariance", "finite numbers from lag 0 on, one at least")
        rows = [self._impulse_response(), *self.factors] if not self.recursive else None
        if rows is None:
            rows = [self._impulse_response()]
        variance = 0.0
        for row in rows:
            for lag, value in enumerate(covariance[: row.size].tolist()):
                pairs = float(row[: row.size - lag] @ row[lag:])
                variance += (1.0 if lag == 0 else 2.0) * value * pairs
        return max(variance, 0.0)

    def _impulse_response(self) -> FloatArray:
        """Return the impulse response until it has decayed."""
        if not self.recursive:
            return self.numerator
        from scipy.signal import lfilter

        slowest = float(np.max(np.abs(np.roots(self.denominator)), initial=0.0))
        length = self.numerator.size + 8
        if slowest > 0.0:
            length += min(int(np.ceil(np.log(1e-17) / np.log(slowest))), _LONGEST_RESPONSE)
        impulse = np.zeros(length)
        impulse[0] = 1.0
        return np.asarray(lfilter(self.numerator, self.denominator, impulse))


class FilterStream:
    """Filters a stream of consecutive blocks.

    The signal is assumed constant before its first sample and after a fault (NaN), which restarts
    the filter. Results don't depend on the division into blocks, to the last digit.

    Parameters
    ----------
    filter : UncertainFilter
    autocovariance : array_like, optional
        Of stationary noise, as of `UncertainFilter.stream`.
    """

    def __init__(
        self,
        filter: UncertainFilter,  # noqa: A002 - the field's word
        autocovariance: ArrayLike | None = None,
    ) -> None:
        self.filter = filter
        self._stationary = None if autocovariance is None else filter.noise_variance(autocovariance)
        self._line: _Convolving | _Recursive = (
            _Recursive(filter) if filter.recursive else _Convolving(filter)
        )

    def copy(self) -> FilterStream:
        """Return another stream in the same state."""
        other = FilterStream.__new__(FilterStream)
        other.filter, other._stationary = self.filter, self._stationary
        other._line = self._line.copy()
        return other

    def forget(self) -> None:
        """Restart with the next sample, as after a gap."""
        self._line.begun = False

    def correct(self, values: FloatArray, uncertainty: FloatArray) -> FloatArray | None:
        """Filter the next samples of a stream that goes on without a fault.

        Parameters
        ----------
        values, uncertainty : float64 array of shape (n,)

        Returns
        -------
        float64 array of shape (3, n) or None
            Correction, standard uncertainty by the coefficients, and what the filter adds to that
            of the samples. None, with nothing filtered, at the start, with a fault among the
            samples, or for a filter with feedback; `push` filters those.
        """
        line = self._line
        return line.correct(values, uncertainty) if isinstance(line, _Convolving) else None

    def push(self, values: ArrayLike, uncertainty: ArrayLike | None = None) -> Filtered:
        """Filter the next samples; a fault (NaN) gets no number.

        Raises
        ------
        InputError
            Uncertainties of another shape, below 0 or not finite, or beside an autocovariance.
        """
        samples = np.ascontiguousarray(values, np.float64)
        if samples.ndim != 1:
            raise InputError(Message("samples of shape {shape}", samples.shape), "one dimension")
        spread = self._uncertainties(samples, uncertainty)
        finite = np.isfinite(samples)
        if samples.size and finite.all():
            value, coefficients, noise = self._line.run(samples, spread)
            if self._stationary is not None:
                noise = np.full(samples.size, self._stationary)
            return Filtered(value, np.sqrt(coefficients), np.sqrt(noise))
        result = Filtered(*np.full((3, samples.size), np.nan))
        for start, stop in _runs(finite):
            if not finite[start]:
                self.forget()
                continue
            part = slice(start, stop)
            value, coefficients, noise = self._line.run(samples[part], spread[part])
            result.value[part] = value
            result.of_coefficients[part] = np.sqrt(coefficients)
            if self._stationary is not None:
                noise = np.full(stop - start, self._stationary)
            result.of_noise[part] = np.sqrt(noise)
        return result

    def _uncertainties(self, samples: FloatArray, uncertainty: ArrayLike | None) -> FloatArray:
        if uncertainty is None:
            return np.zeros(samples.size)
        if self._stationary is not None:
            raise InputError("uncertainties of samples beside an autocovariance", "one of the two")
        given = np.asarray(uncertainty, np.float64)
        if given.shape not in ((), samples.shape):
            raise InputError(
                Message("uncertainties of shape {shape}", given.shape),
                Message("one number or {size}", samples.size),
            )
        spread = np.ascontiguousarray(given) if given.shape else np.full(samples.shape, given)
        good = (spread >= 0.0) & (spread < np.inf)
        if not (good.all() or good[np.isfinite(samples)].all()):
            raise InputError("an uncertainty that isn't finite or is below 0", "0 or more")
        return spread


def _runs(finite: NDArray[np.bool_]) -> Iterable[tuple[int, int]]:
    if not finite.size:
        return []
    cuts = (np.flatnonzero(np.diff(finite)) + 1).tolist()
    return list(zip([0, *cuts], [*cuts, finite.size], strict=True))


class _Convolving:
    """State of a filter without feedback: the past samples that it needs."""

    def __init__(self, filter: UncertainFilter) -> None:  # noqa: A002 - the field's word
        self.weights = np.ascontiguousarray(filter.numerator)
        self.factors = np.ascontiguousarray(filter.factors)
        self.variances = np.sum(np.square(self.factors), axis=0)
        self.squares = np.square(self.weights) + self.variances
        given = filter.covariance
        if given is not None and not np.any(given - np.diag(np.diag(given))):
            self.factors = self.factors[:0]
        self.begun = False
        self.past = np.empty((2, self.weights.size - 1))

    def copy(self) -> _Convolving:
        other = _Convolving.__new__(_Convolving)
        other.__dict__.update(self.__dict__, past=self.past.copy())
        return other

    def run(self, values: FloatArray, spread: FloatArray) -> tuple[FloatArray, ...]:
        from torquebench.dynamics._kernels import convolve_uncertain

        if not self.begun:
            self.begun = True
            self.past[0], self.past[1] = values[0], spread[0] ** 2
        value, coefficients, noise = convolve_uncertain(
            self.past, values, spread, self.weights, self.factors, self.variances, self.squares
        )
        return value, coefficients, noise

    def correct(self, values: FloatArray, spread: FloatArray) -> FloatArray | None:
        from torquebench.dynamics._kernels import correct_uncertain

        rows = np.empty((3, values.size))
        known = (self.weights, self.factors, self.variances, self.squares)
        if self.begun and correct_uncertain(self.past, values, spread, *known, rows):
            return rows
        return None


@dataclass
class _Recursive:
    """State of a filter with feedback, and of its uncertainty."""

    filter: UncertainFilter
    begun: bool = False
    state: FloatArray = field(default_factory=lambda: np.empty(0))
    derivative: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    spread: FloatArray = field(default_factory=lambda: np.empty((0, 0)))

    def __post_init__(self) -> None:
        b, a = self.filter.numerator, self.filter.denominator
        order = max(a.size, b.size) - 1
        self.b, self.a = (np.pad(each, (0, order + 1 - each.size)) for each in (b, a))
        self.covariance = np.empty((0, 0))
        if self.filter.covariance is not None:
            place = [*range(a.size - 1), *range(order, order + b.size)]
            self.covariance = np.zeros((2 * order + 1, 2 * order + 1))
            self.covariance[np.ix_(place, place)] = self.filter.covariance

    def copy(self) -> _Recursive:
        parts = (self.state.copy(), self.derivative.copy(), self.spread.copy())
        return replace(self, begun=self.begun, state=parts[0], derivative=parts[1], spread=parts[2])

    def _begin(self, value: float, spread: float) -> None:
        """Set the filter's state to that of a constant input."""
        from scipy.linalg import solve_discrete_lyapunov

        order = self.a.size - 1
        system = np.eye(order, k=1)
        system[-1] = -self.a[:0:-1]
        entry = np.zeros(order)
        entry[-1] = 1.0
        rest = np.linalg.inv(np.eye(order) - system)
        self.state = np.asarray(rest @ entry * value, np.float64)
        moved = np.zeros((order, order))
        moved[-1] = -self.state[::-1]
        self.derivative = np.asarray(rest @ moved, np.float64)
        noise = spread**2 * np.outer(entry, entry)
        self.spread = np.asarray(solve_discrete_lyapunov(system, noise), np.float64)
        self.begun = True

    def run(self, values: FloatArray, spread: FloatArray) -> tuple[FloatArray, ...]:
        from torquebench.dynamics._kernels import run_recursive

        if not self.begun:
            self._begin(float(values[0]), float(spread[0]))
        result = np.empty((3, values.size))
        run_recursive(
            self.b,
            self.a,
            self.covariance,
            self.state,
            self.derivative,
            self.spread,
            values,
            spread,
            result[0],
            result[1],
            result[2],
        )
        return result[0], np.maximum(result[1], 0.0), np.maximum(result[2], 0.0)
