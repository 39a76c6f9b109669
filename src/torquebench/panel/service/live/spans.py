"""Spectrum and histogram of a span of a live signal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message

Array = NDArray[np.float64]
LEAST_WINDOWS = 16
"""Smallest number of windows for a spectrum."""
LARGEST_GAP = 1.5
"""Largest distance between neighbouring windows of an even rate, in steps."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Amplitude spectrum of a signal without its mean.

    Parameters
    ----------
    frequency_hz : float64[n]
    amplitude_nm : float64[n]
        Amplitude of a sine of that frequency, N·m.
    resolution_hz : float
        Smallest frequency difference between two resolved sines.
    """

    frequency_hz: Array
    amplitude_nm: Array
    resolution_hz: float


@dataclass(frozen=True, eq=False)
class Histogram:
    """Histogram of a signal's values.

    Parameters
    ----------
    centre_nm : float64[n]
        Centre of each class, N·m.
    count : int64[n]
    mean_nm, deviation_nm : float
        Mean and standard deviation, N·m.
    """

    centre_nm: Array
    count: NDArray[np.int64]
    mean_nm: float
    deviation_nm: float


def _whole(time_s: Array, value_nm: Array) -> tuple[Array, Array]:
    """Return the longest part of a record without a gap."""
    there = np.isfinite(value_nm)
    time_s, value_nm = time_s[there], value_nm[there]
    if time_s.size < LEAST_WINDOWS:
        raise InputError(
            Message("{count} readings in this span", time_s.size),
            Message("at least {limit}", LEAST_WINDOWS),
            "choose a longer span of the last two minutes",
        )
    steps = np.diff(time_s)
    ends = np.flatnonzero(steps > LARGEST_GAP * np.median(steps)) + 1
    parts = np.split(np.arange(time_s.size), ends)
    longest = max(parts, key=len)
    if longest.size < LEAST_WINDOWS:
        raise InputError(
            Message("at most {count} readings without a gap", longest.size),
            Message("at least {limit}", LEAST_WINDOWS),
            "choose another span",
        )
    return time_s[longest], value_nm[longest]


def spectrum(time_s: Array, value_nm: Array) -> Spectrum:
    """Return the amplitude spectrum of the longest part without a gap, by a Hann window.

    Raises
    ------
    InputError
        There are too few readings.

    Examples
    --------
    >>> time = np.arange(1000) * 0.01
    >>> found = spectrum(time, 7.0 + 0.5 * np.sin(2.0 * np.pi * 4.0 * time))
    >>> peak = found.amplitude_nm.argmax()
    >>> round(float(found.frequency_hz[peak]), 3), round(float(found.amplitude_nm[peak]), 3)
    (4.0, 0.5)
    """
    time_s, value_nm = _whole(time_s, value_nm)
    rate_hz = (time_s.size - 1) / float(time_s[-1] - time_s[0])
    # As scipy.signal.periodogram, whose import takes 30 MB.
    window = np.hanning(time_s.size + 1)[:-1]
    lines = np.abs(np.fft.rfft((value_nm - value_nm.mean()) * window))
    amplitude: Array = lines.astype(np.float64) / (0.5 * window.sum())
    frequency_hz: Array = np.arange(lines.size, dtype=np.float64) * (rate_hz / time_s.size)
    # 1.5 bins: noise bandwidth of the Hann window
    return Spectrum(frequency_hz, amplitude, 1.5 * rate_hz / time_s.size)


def histogram(value_nm: Array, classes: int = 40) -> Histogram:
    """Return the histogram of values in classes of equal width.

    Raises
    ------
    InputError
        There are too few readings.

    Examples
    --------
    >>> found = histogram(np.repeat([1.0, 2.0, 3.0], 10), classes=3)
    >>> found.count.tolist(), round(found.mean_nm, 6)
    ([10, 10, 10], 2.0)
    """
    kept = value_nm[np.isfinite(value_nm)]
    if kept.size < LEAST_WINDOWS:
        raise InputError(
            Message("{count} readings in this span", kept.size),
            Message("at least {limit}", LEAST_WINDOWS),
        )
    count, edges = np.histogram(kept, classes)
    return Histogram(
        0.5 * (edges[1:] + edges[:-1]), count, float(kept.mean()), float(kept.std(ddof=1))
    )
