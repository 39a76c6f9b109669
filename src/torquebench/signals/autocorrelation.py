"""Effective number of independent samples in correlated ones."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["autocorrelation", "correlation_length"]

# Smallest number of independent samples of any record: an estimated correlation longer than a fifth
# of the record is noise.
_FEWEST_INDEPENDENT = 5


def autocorrelation(residual: ArrayLike, lags: int) -> NDArray[np.float64]:
    """Autocorrelation of residuals with mean 0 at lags 0 to `lags`.

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
    """Count samples per independent sample: 1 + 2·Σ of the autocorrelation.

    By the initial monotone sequence of C. J. Geyer, Practical Markov chain Monte Carlo,
    Statistical Science 7 (1992) 473, with the bias removed that fitting a mean (and a slope)
    brings into the autocorrelation. Never below 1, so anticorrelated samples gain nothing.
    Measured on white and first-order autoregressive noise (coefficient up to 0.6): with 30
    samples or more, twice the standard error from it covers in 90-97 %.

    Parameters
    ----------
    residual : array_like, shape (n,)
        Residuals in their order.
    fitted : int
        Slowly varying terms in the fit: 1 for a mean, 2 with a slope.

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
