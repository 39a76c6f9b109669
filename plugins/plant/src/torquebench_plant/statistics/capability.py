"""Process capability: distance of mean and spread from the limits."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import ArrayLike

from torquebench.errors import InputError
from torquebench.message import Message

__all__ = ["Capability", "capability", "limits_in_words"]

LEAST = 3
_LIMIT = re.compile(r"([≥≤])\s*([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)")


@dataclass(frozen=True)
class Capability:
    """Capability of a process, with its intervals.

    Attributes
    ----------
    count : int
        Values.
    mean, standard_deviation : float
        Of the values, in their unit.
    lower, upper : float or None
        Limits, in the unit of the values.
    cp : float or None
        Width between the limits over 6 s; None where there is only one limit.
    cp_interval : tuple of float or None
        Confidence interval of `cp` (χ²).
    cpk : float
        Distance of the mean from the nearer limit over 3 s.
    cpk_interval : tuple of float
        Confidence interval of `cpk`, from the number of values and from the uncertainty that all
        values share.
    level : float
        Of the intervals.
    measurement_share : float
        Share of the variance that comes from measuring: u² of a value over s².
    """

    count: int
    mean: float
    standard_deviation: float
    lower: float | None
    upper: float | None
    cp: float | None
    cp_interval: tuple[float, float] | None
    cpk: float
    cpk_interval: tuple[float, float]
    level: float
    measurement_share: float


def capability(
    values: ArrayLike,
    *,
    lower: float | None = None,
    upper: float | None = None,
    u_value: float = 0.0,
    u_common: float = 0.0,
    level: float = 0.95,
) -> Capability:
    """Return Cp and Cpk of values with their confidence intervals.

    s is the values', which includes the measurement's scatter: the process alone is better.

    Parameters
    ----------
    values : array of float, shape (n,)
        At least 3, not all equal.
    lower, upper : float, optional
        Limits; at least one.
    u_value : float
        Standard uncertainty of a single value that differs from value to value.
    u_common : float
        Standard uncertainty that all values share, which moves their mean.
    level : float, default 0.95
        Of the confidence intervals.

    Raises
    ------
    InputError
        Too few values, no spread, or limits that aren't.

    References
    ----------
    D. C. Montgomery, Introduction to Statistical Quality Control, 6th ed., equations 8.4, 8.8,
    8.19 (after Kushler and Hurley) and 8.21 (after Bissell).

    Examples
    --------
    >>> found = capability([4.9, 5.0, 5.1, 5.0, 5.2, 4.8], lower=4.0, upper=6.0)
    >>> round(found.cp, 3), round(found.cpk, 3)
    (2.357, 2.357)
    """
    x = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if x.ndim != 1 or x.size < LEAST or not np.all(np.isfinite(x)):
        raise InputError(
            Message("capability from {count} values", x.size),
            Message("at least {count} finite values", LEAST),
            "test more",
        )
    if lower is None and upper is None:
        raise InputError("capability without a limit", "a lower limit, an upper limit, or both")
    if lower is not None and upper is not None and not lower < upper:
        raise InputError(
            Message("limits {lower:g} and {upper:g}", lower, upper),
            "a lower one below the upper one",
        )
    mean, s = float(x.mean()), float(x.std(ddof=1))
    if s <= 4.0 * np.finfo(float).eps * max(abs(mean), float(np.abs(x).max())):
        raise InputError("values without any spread", "values that differ", "look at their source")
    from scipy import stats  # imported late

    freedom, tail = x.size - 1, 0.5 * (1.0 - level)
    cp = interval = None
    if lower is not None and upper is not None:
        cp = (upper - lower) / (6.0 * s)
        ends = [sqrt(float(stats.chi2.ppf(p, freedom)) / freedom) for p in (tail, 1.0 - tail)]
        interval = (cp * ends[0], cp * ends[1])
    below = inf if lower is None else mean - lower
    above = inf if upper is None else upper - mean
    cpk = min(below, above) / (3.0 * s)
    sampling = 1.0 / (9.0 * x.size) + cpk**2 / (2.0 * freedom)
    reach = float(stats.norm.ppf(1.0 - tail)) * sqrt(sampling + (u_common / (3.0 * s)) ** 2)
    return Capability(
        count=int(x.size),
        mean=mean,
        standard_deviation=s,
        lower=lower,
        upper=upper,
        cp=cp,
        cp_interval=interval,
        cpk=cpk,
        cpk_interval=(cpk - reach, cpk + reach),
        level=level,
        measurement_share=min((u_value / s) ** 2, 1.0),
    )


def limits_in_words(words: str) -> tuple[float | None, float | None]:
    """Return the lower and the upper limit that a test's record states in words.

    Examples
    --------
    >>> limits_in_words("≥ 0.5 arcmin, ≤ 1 arcmin"), limits_in_words("≤ 1e-3 N·m")
    ((0.5, 1.0), (None, 0.001))
    >>> limits_in_words("")
    (None, None)
    """
    found = {sign: float(number) for sign, number in _LIMIT.findall(words)}
    return found.get("≥"), found.get("≤")
