"""Steady value of one step: settled part, mean over whole periods, and its standard error."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals._kernels import settled_from
from torquebench.signals.autocorrelation import correlation_length
from torquebench.signals.outliers import isolated, median, outliers
from torquebench.signals.ripple import estimate_period, ripple_terms

__all__ = ["SteadyValue", "settling_index", "steady_value"]

# Number of starts that are tried between the first settled sample and the settling limit.
_CANDIDATES = 8
# A residual beyond this many robust standard deviations of the window is an outlier, too.
_LIMIT = 6.0
_SPREAD = 1.4826
# A larger share of outliers means that they aren't single values.
_MOST_OUTLIERS = 0.1
# Fewest samples per term of a fit.
_SAMPLES_PER_TERM = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyValue:
    """Steady value of a step.

    Parameters
    ----------
    value : float
        DC component of the settled part, in the unit of the samples.
    standard_error : float
        Standard error of `value`, valid under autocorrelated noise and ripple; same unit.
        A reading that doesn't move at all has 0: its resolution is another contribution.
    drift_per_s : float
        Slope of the settled part, in the samples' unit per second.
    drift_standard_error_per_s : float
        Standard error of that slope.
    settled : bool
        True when the drift over the window is below its own standard error (or below the
        tolerance given): only then the value counts. Otherwise wait longer, or mark the point.
    samples : int
        Samples that the value rests on.
    effective_samples : float
        Effective number of independent samples.
    rejected : int
        Outliers left out of the window.
    start_s, stop_s : float
        The window used, in the samples' time.
    period_s : float or None
        Period of the ripple that was taken out, given or estimated.
    ripple : float
        Amplitude of that ripple's fundamental.
    """

    value: float
    standard_error: float
    drift_per_s: float
    drift_standard_error_per_s: float
    settled: bool
    samples: int
    effective_samples: float
    rejected: int
    start_s: float
    stop_s: float
    period_s: float | None = None
    ripple: float = 0.0

    @property
    def drift(self) -> float:
        """Drift over the window, in the samples' unit."""
        return abs(self.drift_per_s) * (self.stop_s - self.start_s)


def steady_value(
    time_s: ArrayLike,
    value: ArrayLike,
    *,
    period_s: float | None = None,
    estimate_ripple: bool = True,
    harmonics: int = 2,
    tolerance: float = 0.0,
    minimum_samples: int = 8,
    settling_limit: float = 0.6,
) -> SteadyValue:
    """Find the settled part of a step and its steady value.

    Outliers are left out first. The settled part begins where the standard error of
    the mean of all that follows is least (the marginal standard error rule, K. P. White,
    Simulation 69 (1997) 323). From there on, the first window counts whose drift is below its
    own standard error. It spans whole periods of the ripple, and a fit of mean, slope and the
    ripple's harmonics gives the DC component without leakage. The standard error comes from
    the residuals' spread and their correlation length.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Times of the samples in seconds, increasing, evenly spaced but for gaps.
    value : array_like, shape (n,)
        Samples, all finite (a fault must be handled before), in any unit.
    period_s : float, optional
        Known period of a ripple in seconds, such as the motor's rotation.
    estimate_ripple : bool
        Look for a significant ripple when no period is given.
    harmonics : int
        Harmonics of the ripple that are taken out, the fundamental among them.
    tolerance : float
        Drift over the window that doesn't matter, in the samples' unit.
    minimum_samples : int
        Fewest samples that a steady value may rest on.
    settling_limit : float
        Part of the record that may be given up as settling, 0 to 1.

    Returns
    -------
    SteadyValue
        With `settled` False when no part of the record is steady, or more than a tenth of it
        is made of outliers: a mark, not an error.

    Raises
    ------
    InputError
        When samples are too few, not finite, or times don't increase.

    Examples
    --------
    >>> generator = np.random.default_rng(1)
    >>> time = np.arange(100) * 0.01
    >>> step = 200.0 * (1 - np.exp(-time / 0.05)) + 0.5 * np.sin(2 * np.pi * time / 0.12)
    >>> steady = steady_value(time, step + generator.normal(0.0, 0.02, 100), period_s=0.12)
    >>> steady.settled, bool(abs(steady.value - 200.0) < 3 * steady.standard_error)
    (True, True)
    """
    times, samples = _checked(time_s, value, minimum_samples, period_s, settling_limit)
    outlying = outliers(samples)
    kept_times, kept = times[~outlying], samples[~outlying]
    latest = min(int(settling_limit * kept.size), kept.size - minimum_samples)
    first = settling_index(kept, latest)
    period = period_s
    if period is None and estimate_ripple:
        period = estimate_period(kept_times[first:], kept[first:])
    if period is not None:
        ripple = _ripple(kept_times, kept, latest, period, harmonics)
        first = settling_index(kept - ripple, latest)
    starts = np.unique(np.linspace(first, max(latest, first), _CANDIDATES).astype(np.intp))
    best: SteadyValue | None = None
    for start in starts:
        window = _evaluate(kept_times[start:], kept[start:], period, harmonics, tolerance)
        if window.samples < minimum_samples:
            break
        if best is None or _unsteadiness(window) < _unsteadiness(best) or window.settled:
            best = window
        if window.settled:
            break
    if best is None:
        best = replace(
            _evaluate(kept_times[first:], kept[first:], None, harmonics, tolerance), settled=False
        )
    dropped = best.rejected + int(
        np.sum(outlying & (times >= best.start_s) & (times <= best.stop_s))
    )
    few = dropped <= _MOST_OUTLIERS * (best.samples + dropped)
    return replace(best, rejected=dropped, settled=best.settled and few)


def settling_index(value: ArrayLike, latest: int | None = None) -> int:
    """Index from which on a record is settled, by the marginal standard error rule.

    Parameters
    ----------
    value : array_like, shape (n,)
        Samples without outliers.
    latest : int, optional
        Largest index that may be returned; half of the record when not given.

    Returns
    -------
    int
        Where the variance of the rest, divided by its number of samples, is least.

    Examples
    --------
    >>> settling_index([9.0, 5.0, 2.0, 1.0, 1.1, 0.9, 1.0, 1.1, 0.9, 1.0])
    3
    """
    samples = np.asarray(value, dtype=np.float64)
    centred = samples - median(samples)
    last = samples.size // 2 if latest is None else latest
    return int(settled_from(centred, max(last, 0)))


def _checked(
    time_s: ArrayLike,
    value: ArrayLike,
    minimum_samples: int,
    period_s: float | None,
    settling_limit: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    times = np.asarray(time_s, dtype=np.float64)
    samples = np.asarray(value, dtype=np.float64)
    if times.ndim != 1 or times.shape != samples.shape:
        raise InputError(
            Message("times {shape} and values {samples_shape}", times.shape, samples.shape),
            "two equal rows",
        )
    fewest = max(minimum_samples, 4)
    if times.size < fewest:
        raise InputError(
            Message("{count} samples", times.size),
            Message("at least {limit}", fewest),
            "record the step longer",
        )
    bad = np.flatnonzero(~(np.isfinite(times) & np.isfinite(samples)))
    if bad.size:
        raise InputError(
            Message(
                "sample {bad} is {samples} at {times} s", bad[0], samples[bad[0]], times[bad[0]]
            ),
            "finite samples",
            "handle the fault before asking for a steady value",
        )
    if np.any(np.diff(times) <= 0):
        raise InputError("times that don't increase", "increasing times")
    if period_s is not None and not (np.isfinite(period_s) and period_s > 0):
        raise InputError(Message("period {period_s} s", period_s), "a time above 0 s")
    if not 0 <= settling_limit < 1:
        raise InputError(
            Message("settling_limit {settling_limit}", settling_limit), "0 or more, below 1"
        )
    return times, samples


def _columns(
    times: NDArray[np.float64], period: float | None, harmonics: int
) -> list[NDArray[np.float64]]:
    """Mean, slope (around the middle) and as many harmonics as the sampling carries."""
    columns = [np.ones_like(times), times - times.mean()]
    if period is None:
        return columns
    interval = (times[-1] - times[0]) / (times.size - 1)
    carried = int(0.45 * period / interval)
    affordable = (times.size // _SAMPLES_PER_TERM - 2) // 2
    orders = max(min(harmonics, carried, affordable), 0)
    return columns + ripple_terms(times, period, orders)


def _ripple(
    times: NDArray[np.float64],
    samples: NDArray[np.float64],
    start: int,
    period: float,
    harmonics: int,
) -> NDArray[np.float64]:
    """Ripple over the whole record, fitted to its settled part."""
    columns = np.column_stack(_columns(times, period, harmonics))
    coefficients, *_ = np.linalg.lstsq(columns[start:], samples[start:], rcond=None)
    return np.asarray(columns[:, 2:] @ coefficients[2:])


def _evaluate(
    times: NDArray[np.float64],
    samples: NDArray[np.float64],
    period: float | None,
    harmonics: int,
    tolerance: float,
) -> SteadyValue:
    """Mean, slope and errors of one window, cut to whole periods at its beginning."""
    whole = True
    if period is not None:
        interval = (times[-1] - times[0]) / (times.size - 1)
        periods = int((times[-1] - times[0] + interval) / period * (1 + 1e-9))
        whole = periods >= 1
        if whole:
            inside = times > times[-1] - periods * period + 1e-6 * interval
            times, samples = times[inside], samples[inside]
    columns = _columns(times, period if whole else None, harmonics)
    matrix = np.column_stack(columns)
    keep, coefficients, residual = _robust_fit(matrix, samples)
    correlated = correlation_length(residual, fitted=2)
    freedom = max(keep.sum() - 2 * correlated - (len(columns) - 2), 1.0)
    variance = float(residual @ residual) / freedom * correlated
    covariance = variance * np.linalg.pinv(matrix[keep].T @ matrix[keep])
    errors = np.sqrt(np.diag(covariance))
    # A drift below the resolution of floating point is treated as zero.
    rounding = 8 * float(np.finfo(np.float64).eps * np.max(np.abs(samples)))
    span = float(times[-1] - times[0])
    drift_allowed = max(float(errors[1]) * span, tolerance, rounding)
    return SteadyValue(
        value=float(coefficients[0]),
        standard_error=float(errors[0]),
        drift_per_s=float(coefficients[1]),
        drift_standard_error_per_s=float(errors[1]),
        settled=whole and abs(float(coefficients[1])) * span <= drift_allowed,
        samples=int(keep.sum()),
        effective_samples=float(keep.sum() / correlated),
        rejected=int(np.sum(~keep)),
        start_s=float(times[0]),
        stop_s=float(times[-1]),
        period_s=period if len(columns) > 2 else None,
        ripple=float(np.hypot(*coefficients[2:4])) if len(columns) > 2 else 0.0,
    )


def _robust_fit(
    matrix: NDArray[np.float64], samples: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64]]:
    """Return a least-squares fit without outliers, and the samples kept."""
    keep = np.ones(samples.size, dtype=np.bool_)
    for _ in range(2):
        coefficients, *_ = np.linalg.lstsq(matrix[keep], samples[keep], rcond=None)
        residual = samples - matrix @ coefficients
        spread = _SPREAD * median(np.abs(residual[keep]))
        far = isolated(np.abs(residual) > _LIMIT * spread) if spread > 0 else ~keep
        if np.array_equal(far, ~keep) or samples.size - far.sum() < matrix.shape[1] + 2:
            break
        keep = ~far
    else:
        coefficients, *_ = np.linalg.lstsq(matrix[keep], samples[keep], rcond=None)
        residual = samples - matrix @ coefficients
    if keep.all():
        return keep, np.asarray(coefficients), residual
    return keep, np.asarray(coefficients), samples[keep] - matrix[keep] @ coefficients


def _unsteadiness(steady: SteadyValue) -> float:
    """Drift in units of its standard error."""
    if steady.drift_standard_error_per_s == 0:
        return 0.0 if steady.drift_per_s == 0 else np.inf
    return abs(steady.drift_per_s) / steady.drift_standard_error_per_s
