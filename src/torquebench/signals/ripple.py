"""Periodic ripple on a steady value: its period and its removal."""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.fft import rfft
from scipy.optimize import minimize_scalar

from torquebench.signals._kernels import running_median
from torquebench.signals.outliers import median
from torquebench.units import TURN

__all__ = ["estimate_period", "ripple_terms"]

# Smallest number of periods that distinguishes a ripple from slow noise.
_FEWEST_PERIODS = 4
# Lines of the spectrum on each side that are a line's background: local, since noise may be red.
_BACKGROUND_LINES = 17
# Threshold, as a multiple of the level that white noise reaches once in a thousand records: with
# the scatter of the local background, about 1 % of records with red noise still show a false
# ripple.
_CHANCE = 1e-3
_ABOVE_CHANCE = 2.0
# In short records a ripple's own lines fill the background; one with this share of all power is a
# ripple as well (noise of 20 samples reaches it once in a hundred records).
_DOMINATES = 0.8


def estimate_period(time_s: ArrayLike, value: ArrayLike) -> float | None:
    """Find the period of a ripple above the noise.

    The line of the periodogram with the largest ratio to the median of its neighbours (Fisher's
    test with a robust local background), then refined by least squares.

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

    def misfit(frequency: float) -> float:
        columns = np.column_stack((np.ones_like(times), times, *ripple_terms(times, 1 / frequency)))
        return float(np.sum((samples - columns @ np.linalg.lstsq(columns, samples)[0]) ** 2))

    refined = minimize_scalar(misfit, bounds=(peak - width, peak + width), method="bounded")
    return 1 / float(refined.x)


def _power(even: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the one-sided periodogram less its trend, with Hann's window, in units of its own.

    The same as in scipy.signal, which takes long to import and is slow for short records.
    """
    count = even.size
    trend = np.column_stack((np.arange(1, count + 1) / count, np.ones(count)))
    flat = even - trend @ np.linalg.lstsq(trend, even)[0]
    window = 0.5 - 0.5 * np.cos(TURN * np.arange(count) / count)
    power = np.square(np.abs(rfft(window * flat)))
    power[1 : (count + 1) // 2] *= 2.0
    return np.asarray(power, dtype=np.float64)


def ripple_terms(
    time_s: NDArray[np.float64], period_s: float, harmonics: int = 1
) -> list[NDArray[np.float64]]:
    """Cosine and sine of each harmonic of a ripple, as columns of a fit.

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
