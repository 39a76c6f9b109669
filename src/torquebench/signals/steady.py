"""Steady value of one step: settled part, mean over whole periods, and its standard error."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.units import TURN

# Number of tried starts between the first settled sample and the settling limit.
_HARMONICS = 2  # subtracted of a ripple, the fundamental included
_CANDIDATES = 8
# Number of robust standard deviations of the window beyond which a residual is an outlier, too.
_LIMIT = 6.0
# Ratio of standard deviation to median absolute deviation of normal noise.
_SPREAD = 1.4826
# Largest share of outliers; more of them aren't single values.
_MOST_OUTLIERS = 0.1
# Smallest number of samples per term of a fit.
_SAMPLES_PER_TERM = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyValue:
    """Steady value of a step.

    Parameters
    ----------
    value : float
        DC component of the settled part, in the unit of the samples.
    standard_error : float
        Standard error of `value`, valid under autocorrelated noise and ripple; same unit. For a
        constant reading it is 0, because resolution is a separate contribution.
    drift_per_s : float
        Slope of the settled part, in the samples' unit per second.
    drift_standard_error_per_s : float
        Standard error of that slope.
    settled : bool
        Whether the drift over the window is below its own standard error or below the tolerance.
        Otherwise wait longer, or mark the point.
    samples : int
        Number of samples in the value.
    rejected : int
        Number of outliers left out of the window.
    start_s, stop_s : float
        The window used, in the samples' time.
    period_s : float or None
        Period of the subtracted ripple, given or estimated.
    ripple : float
        Amplitude of that ripple's fundamental.
    """

    value: float
    standard_error: float
    drift_per_s: float
    drift_standard_error_per_s: float
    settled: bool
    samples: int
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
    tolerance: float = 0.0,
    minimum_samples: int = 8,
    settling_limit: float = 0.6,
) -> SteadyValue:
    """Find the settled part of a step and its steady value.

    Outliers are left out first. The settled part begins where the standard error of the mean of all
    later samples is smallest (the marginal standard error rule, K. P. White, Simulation 69 (1997)
    323). From there on, the first window is used whose drift is below its own standard error. It
    spans whole periods of the ripple, and a fit of mean, slope and the ripple's harmonics gives the
    DC component without leakage. The standard error comes from the residuals' spread and their
    correlation length.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Times of the samples in seconds, increasing, evenly spaced but for gaps.
    value : array_like, shape (n,)
        Samples, all finite (a fault must be handled before), in any unit.
    period_s : float, optional
        Known period of a ripple in seconds, such as the motor's rotation; by default a significant
        ripple is looked for. Two harmonics of it are subtracted.
    tolerance : float
        Negligible drift over the window, in the samples' unit.
    minimum_samples : int
        Smallest number of samples for a steady value.
    settling_limit : float
        Largest part of the record that may count as settling, 0 to 1.

    Returns
    -------
    SteadyValue
        Steady value; `settled` is False, without an error, if no part of the record is steady or
        more than a tenth of it are outliers.

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
    good_times, good = times[~outlying], samples[~outlying]
    latest = min(int(settling_limit * good.size), good.size - minimum_samples)
    first = settling_index(good, latest)
    period = period_s
    if period is None:
        period = estimate_period(good_times[first:], good[first:])
    if period is not None:
        ripple = _ripple(good_times, good, latest, period)
        first = settling_index(good - ripple, latest)
    starts = np.unique(np.linspace(first, max(latest, first), _CANDIDATES).astype(np.intp))
    best: SteadyValue | None = None
    for start in starts:
        window = _evaluate(good_times[start:], good[start:], period, tolerance)
        if window.samples < minimum_samples:
            break
        if best is None or _unsteadiness(window) < _unsteadiness(best) or window.settled:
            best = window
        if window.settled:
            break
    if best is None:
        best = replace(_evaluate(good_times[first:], good[first:], None, tolerance), settled=False)
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
        Index at which the variance of the remaining samples, divided by their number, is smallest.

    Examples
    --------
    >>> settling_index([9.0, 5.0, 2.0, 1.0, 1.1, 0.9, 1.0, 1.1, 0.9, 1.0])
    3
    """
    samples = np.asarray(value, dtype=np.float64)
    centred = samples - median(samples)
    last = max(samples.size // 2 if latest is None else latest, 0)
    counts = np.arange(1.0, samples.size + 1.0)
    total = np.add.accumulate(centred[::-1])
    squares = np.add.accumulate(np.square(centred[::-1]))
    spread = (np.maximum(squares - total * total / counts, 0.0) / (counts * counts))[::-1]
    return int(np.argmin(spread[: last + 1]))


def _checked(
    time_s: ArrayLike,
    value: ArrayLike,
    minimum_samples: int,
    period_s: float | None,
    settling_limit: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and values as finite, rising rows, or refuse them."""
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


def _columns(times: NDArray[np.float64], period: float | None) -> list[NDArray[np.float64]]:
    """Return columns for mean, slope (about the middle) and all harmonics that can be sampled."""
    columns = [np.ones_like(times), times - times.mean()]
    if period is None:
        return columns
    interval = (times[-1] - times[0]) / (times.size - 1)
    carried = int(0.45 * period / interval)
    affordable = (times.size // _SAMPLES_PER_TERM - 2) // 2
    orders = max(min(_HARMONICS, carried, affordable), 0)
    return columns + ripple_terms(times, period, orders)


def _ripple(
    times: NDArray[np.float64],
    samples: NDArray[np.float64],
    start: int,
    period: float,
) -> NDArray[np.float64]:
    """Return the ripple over the whole record, fitted to its settled part."""
    columns = np.column_stack(_columns(times, period))
    coefficients, *_ = np.linalg.lstsq(columns[start:], samples[start:], rcond=None)
    return np.asarray(columns[:, 2:] @ coefficients[2:])


def _evaluate(
    times: NDArray[np.float64],
    samples: NDArray[np.float64],
    period: float | None,
    tolerance: float,
) -> SteadyValue:
    """Return mean, slope and errors of one window, cut at its beginning to whole periods."""
    enough = True
    if period is not None:
        interval = (times[-1] - times[0]) / (times.size - 1)
        periods = int((times[-1] - times[0] + interval) / period * (1 + 1e-9))
        enough = periods >= 1
        if enough:
            inside = times > times[-1] - periods * period + 1e-6 * interval
            times, samples = times[inside], samples[inside]
    columns = _columns(times, period if enough else None)
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
        settled=enough and abs(float(coefficients[1])) * span <= drift_allowed,
        samples=int(keep.sum()),
        rejected=int(np.sum(~keep)),
        start_s=float(times[0]),
        stop_s=float(times[-1]),
        period_s=period if len(columns) > 2 else None,
        ripple=float(np.hypot(*coefficients[2:4])) if len(columns) > 2 else 0.0,
    )


def _robust_fit(
    matrix: NDArray[np.float64], samples: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64]]:
    """Return a least-squares fit without outliers, and the remaining samples."""
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
    """Return the drift in units of its standard error."""
    if steady.drift_standard_error_per_s == 0:
        return 0.0 if steady.drift_per_s == 0 else np.inf
    return abs(steady.drift_per_s) / steady.drift_standard_error_per_s


# -- outliers -----------------------------------------------------------------------------------

# Number of samples in the running median, which tolerates up to three outliers.
_MEDIAN_WINDOW = 7
# Threshold of an outlier, in robust spreads of the steps between samples.
_STEP_LIMIT = 8.0
# Largest number of outliers in a row; more are a change of the signal.
_LONGEST_RUN = 2
# Checked multiples of the limit: within a fast change, whose samples also exceed the limit, a huge
# value still stands out by itself.
_HEIGHTS = (1.0, 10.0, 100.0, 1000.0)


def outliers(value: ArrayLike, limit: float = _STEP_LIMIT) -> NDArray[np.bool_]:
    """Find single values that deviate from their neighbours.

    A value is an outlier when it is farther from the running median of seven samples than `limit`
    times the robust spread of the steps from one sample to the next, and at most two such
    values follow each other. Steps, ramps and ripple have no outliers.

    Parameters
    ----------
    value : array_like, shape (n,)
        Samples in their order.
    limit : float
        Distance above which a value is an outlier, in robust standard deviations of the steps.

    Returns
    -------
    bool array, shape (n,)
        True at outliers.

    Examples
    --------
    >>> outliers([5.0, 5.1, 4.9, -8388608.0, 5.0, 5.1, 5.0]).nonzero()
    (array([3]),)
    """
    samples = np.asarray(value, dtype=np.float64)
    if samples.size < _MEDIAN_WINDOW:
        return np.zeros(samples.size, dtype=np.bool_)
    distance = np.abs(samples - running_median(samples, _MEDIAN_WINDOW))
    steps = np.abs(np.diff(samples))
    # If most samples repeat, the smallest step is the resolution.
    moved = steps[steps > 0]
    spread = max(_SPREAD * median(steps), float(moved.min()) if moved.size else 0.0)
    outlying = np.zeros(samples.size, dtype=np.bool_)
    for times in _HEIGHTS:
        far = distance > times * limit * spread
        if not far.any():
            break
        outlying |= isolated(far)
    return outlying


def median(values: NDArray[np.float64]) -> float:
    """Return the median of finite values; for few values, NumPy takes ten times as long."""
    ordered = np.sort(values)
    middle = ordered.size // 2
    if ordered.size % 2:
        return float(ordered[middle])
    return float(ordered[middle - 1] + ordered[middle]) / 2.0


def isolated(far: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Keep only marks that are single or in pairs."""
    edges = np.flatnonzero(np.diff(far.astype(np.int8), prepend=0, append=0))
    alone = np.zeros_like(far)
    for first, stop in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        alone[first:stop] = stop - first <= _LONGEST_RUN
    return alone


def running_median(values: NDArray[np.float64], size: int) -> NDArray[np.float64]:
    """Return the median of the `size` values around each value, mirrored at both ends.

    For an even size, it is the upper of the two middle values, with one more value before than
    after, as in scipy.ndimage, whose import takes longer than this calculation.
    """
    before = size // 2
    mirrored = np.pad(values, (before, size - 1 - before), mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(mirrored, size)
    return np.asarray(np.partition(windows, before, axis=1)[:, before])


# -- ripple -------------------------------------------------------------------------------------

# Smallest number of periods that distinguishes a ripple from slow noise.
_FEWEST_PERIODS = 4
# Number of spectral lines on each side that form a line's background, which is local because noise
# may be red.
_BACKGROUND_LINES = 17
# Threshold, as a multiple of the level that white noise reaches in one of a thousand records.
# Because of the scatter of the local background, about 1 % of records with red noise still show a
# false ripple.
_CHANCE = 1e-3
_ABOVE_CHANCE = 2.0
# In short records a ripple's own lines fill the background; a line with this share of all power
# also counts as ripple (noise of 20 samples reaches it in one of a hundred records).
_DOMINATES = 0.8


def estimate_period(time_s: ArrayLike, value: ArrayLike) -> float | None:
    """Find the period of a ripple above the noise.

    It is the line of the periodogram with the largest ratio to the median of its neighbours
    (Fisher's test with a robust local background), refined by least squares.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Times in seconds, evenly spaced but for a few missing samples.
    value : array_like, shape (n,)
        Samples.

    Returns
    -------
    float or None
        Period in seconds; None if no line is significant or it has fewer than four periods.

    Examples
    --------
    >>> time = np.arange(200) * 0.01
    >>> noise = np.random.default_rng(1).normal(0.0, 0.1, 200)
    >>> period = estimate_period(time, 5.0 + np.sin(2 * np.pi * time / 0.13) + noise)
    >>> round(period, 3)
    0.13
    >>> estimate_period(time, noise) is None
    True
    """
    times = np.asarray(time_s, dtype=np.float64)
    samples = np.asarray(value, dtype=np.float64)
    if times.size < 4 * _FEWEST_PERIODS:
        return None
    interval = median(np.diff(times))
    grid = times[0] + interval * np.arange(round((times[-1] - times[0]) / interval) + 1)
    even = np.interp(grid, times, samples)
    power = _power(even)
    lines = power[_FEWEST_PERIODS:]
    background = running_median(lines, min(_BACKGROUND_LINES, lines.size))
    height = lines / np.maximum(background / np.log(2), np.finfo(np.float64).tiny)
    highest = int(np.argmax(height))
    around = lines[max(highest - 1, 0) : highest + 2].sum()
    stands_out = height[highest] > _ABOVE_CHANCE * np.log(lines.size / _CHANCE)
    if not stands_out and around <= _DOMINATES * power[1:].sum():
        return None
    width = 1.0 / (even.size * interval)
    peak = (_FEWEST_PERIODS + highest) * width

    from scipy.optimize import minimize_scalar  # imported late: it takes 20 MB

    def misfit(frequency: float) -> float:
        columns = np.column_stack((np.ones_like(times), times, *ripple_terms(times, 1 / frequency)))
        return float(np.sum((samples - columns @ np.linalg.lstsq(columns, samples)[0]) ** 2))

    refined = minimize_scalar(misfit, bounds=(peak - width, peak + width), method="bounded")
    return 1 / float(refined.x)


def _power(even: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the one-sided periodogram of detrended values with Hann's window, in arbitrary units.

    It equals that of scipy.signal, whose import takes long and which is slow for short records.
    """
    count = even.size
    trend = np.column_stack((np.arange(1, count + 1) / count, np.ones(count)))
    flat = even - trend @ np.linalg.lstsq(trend, even)[0]
    window = 0.5 - 0.5 * np.cos(TURN * np.arange(count) / count)
    power = np.square(np.abs(np.fft.rfft(window * flat)))
    power[1 : (count + 1) // 2] *= 2.0
    return np.asarray(power, dtype=np.float64)


def ripple_terms(
    time_s: NDArray[np.float64], period_s: float, harmonics: int = 1
) -> list[NDArray[np.float64]]:
    """Return cosine and sine of each harmonic of a ripple, as columns for a fit.

    Parameters
    ----------
    time_s : float64 array, shape (n,)
        Times in seconds.
    period_s : float
        Period in seconds.
    harmonics : int
        Number of harmonics, including the fundamental.

    Returns
    -------
    list of float64 arrays, shape (n,)
        Two for each harmonic.
    """
    phase = TURN * (time_s - time_s[0]) / period_s
    return [wave(order * phase) for order in range(1, harmonics + 1) for wave in (np.cos, np.sin)]


# -- correlated noise ---------------------------------------------------------------------------

# Smallest number of independent samples of any record: an estimated correlation longer than a fifth
# of the record is noise.
_FEWEST_INDEPENDENT = 5


def autocorrelation(residual: ArrayLike, lags: int) -> NDArray[np.float64]:
    """Return the autocorrelation of residuals of mean 0 at lags 0 to `lags`.

    Parameters
    ----------
    residual : array_like, shape (n,)
        Residuals of a fit.
    lags : int
        Largest lag, below n.

    Returns
    -------
    float64 array, shape (lags + 1,)
        1 at lag 0; all 0 beyond it where the residuals vanish.
    """
    values = np.asarray(residual, dtype=np.float64)
    size = int(2 ** np.ceil(np.log2(2 * values.size)))
    spectrum = np.fft.rfft(values, size)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)[: lags + 1]
    if products[0] <= 0:
        return np.concatenate(([1.0], np.zeros(lags)))
    return np.asarray(products / products[0], dtype=np.float64)


def correlation_length(residual: ArrayLike, fitted: int = 1) -> float:
    """Return the number of samples per independent sample: 1 + 2·Σ of the autocorrelation.

    It uses the initial monotone sequence of C. J. Geyer, Practical Markov chain Monte Carlo,
    Statistical Science 7 (1992) 473, corrected for the bias of the autocorrelation due to a fitted
    mean (and slope). It is never below 1, so that anticorrelated samples have no advantage.
    Measured on white and first-order autoregressive noise (coefficient up to 0.6), twice the
    resulting standard error has a coverage of 90-97 % with 30 samples or more.

    Parameters
    ----------
    residual : array_like, shape (n,)
        Residuals in their order.
    fitted : int
        Number of slowly varying terms in the fit: 1 for a mean, 2 with a slope.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(size=2000)
    >>> bool(0.9 < correlation_length(noise) < 1.2)
    True
    >>> held = np.repeat(noise, 10)
    >>> bool(8 < correlation_length(held) < 12)
    True
    """
    values = np.asarray(residual, dtype=np.float64)
    count = values.size
    lags = max(count // 2, 1)
    raw = autocorrelation(values, lags)
    pairs_end = raw.size // 2 * 2
    length = 1.0
    for _ in range(2):
        corrected = raw + fitted * length / count
        pairs = corrected[0:pairs_end:2] + corrected[1:pairs_end:2]
        ends = np.flatnonzero(pairs <= 0)
        positive = pairs[: ends[0]] if ends.size else pairs
        total = float(np.minimum.accumulate(positive).sum()) if positive.size else 0.0
        length = min(max(2 * total - 1, 1.0), max(count / _FEWEST_INDEPENDENT, 1.0))
    return length
