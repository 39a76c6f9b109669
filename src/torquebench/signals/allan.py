"""Allan deviation: averaging time after which drift outweighs the gain of averaging."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["AllanDeviation", "allan_deviation"]

_POINTS_PER_DECADE = 8
# Smallest number of averages in a record for a meaningful deviation.
_FEWEST_AVERAGES = 4


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AllanDeviation:
    """Allan deviation against averaging time.

    Parameters
    ----------
    averaging_s : float64 array, shape (k,)
        Averaging times in seconds, growing.
    deviation : float64 array, shape (k,)
        Overlapping Allan deviation in the samples' unit.
    independent : int64 array, shape (k,)
        Independent pairs of averages in the record: each deviation is certain to about
        1/√(2·independent) of itself.
    """

    averaging_s: NDArray[np.float64]
    deviation: NDArray[np.float64]
    independent: NDArray[np.int64]


def allan_deviation(value: ArrayLike, interval_s: float) -> AllanDeviation:
    """Overlapping Allan deviation of evenly sampled frequency or torque.

    σ²(τ) = ½⟨(ȳ₂ − ȳ₁)²⟩ over all pairs of adjacent averages over τ (IEEE Std 1139; W. J. Riley,
    Handbook of Frequency Stability Analysis, NIST SP 1065, 5.2.4). It falls with 1/√τ for
    white noise and rises where drift takes over; the lowest point is the best averaging time.

    Parameters
    ----------
    value : array_like, shape (n,)
        Samples, all finite, eight or more.
    interval_s : float
        Distance of the samples in seconds.

    Raises
    ------
    InputError
        When samples are too few or not finite.

    Examples
    --------
    >>> noise = np.random.default_rng(1).normal(size=20_000)
    >>> allan = allan_deviation(noise, 0.01)
    >>> bool(np.allclose(allan.deviation[:9], np.sqrt(0.01 / allan.averaging_s[:9]), rtol=0.1))
    True
    """
    samples = np.asarray(value, dtype=np.float64)
    if samples.ndim != 1 or samples.size < 2 * _FEWEST_AVERAGES:
        raise InputError(
            Message("{count} samples", samples.shape),
            Message("a row of {fewest_averages} or more", 2 * _FEWEST_AVERAGES),
        )
    if not np.all(np.isfinite(samples)):
        raise InputError("samples that aren't finite", "finite samples", "cut the faults out")
    if not (interval_s > 0 and np.isfinite(interval_s)):
        raise InputError(Message("interval {interval_s} s", interval_s), "a time above 0 s")
    longest = samples.size // _FEWEST_AVERAGES
    points = int(_POINTS_PER_DECADE * np.log10(longest)) + 2
    factors = np.unique(np.rint(np.geomspace(1, longest, points)).astype(np.int64))
    sums = np.concatenate(([0.0], np.cumsum(samples - samples.mean())))
    deviations = []
    for factor in factors.tolist():
        averages = (sums[factor:] - sums[:-factor]) / factor
        steps = averages[factor:] - averages[:-factor]
        deviations.append(np.sqrt(0.5 * np.mean(steps**2)))
    return AllanDeviation(
        averaging_s=np.asarray(factors * interval_s, dtype=np.float64),
        deviation=np.array(deviations),
        independent=samples.size // factors - 1,
    )
