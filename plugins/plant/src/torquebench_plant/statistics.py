"""Statistics of production and of many benches: pure, values in and values out."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from torquebench.errors import InputError
from torquebench.message import Message

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
        Mean and standard deviation of the values, in their unit.
    lower, upper : float or None
        Limits, in the unit of the values.
    cp : float or None
        Width between the limits over 6 s; None if there is only one limit.
    cp_interval : tuple of float or None
        Confidence interval of `cp` (χ²).
    cpk : float
        Distance of the mean from the nearer limit over 3 s.
    cpk_interval : tuple of float
        Confidence interval of `cpk`, from the number of values and from the uncertainty that all
        values share.
    level : float
        Confidence level of the intervals.
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

    s is the values' standard deviation. It includes the scatter of the measurement, so the
    capability of the process alone is higher.

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
        Level of the confidence intervals.

    Raises
    ------
    InputError
        Too few values, values without spread, or no valid limits.

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
    from scipy import stats  # imported only when needed

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
    """Return the lower and upper limits that the text in a test's record states.

    Examples
    --------
    >>> limits_in_words("≥ 0.5 arcmin, ≤ 1 arcmin"), limits_in_words("≤ 1e-3 N·m")
    ((0.5, 1.0), (None, 0.001))
    >>> limits_in_words("")
    (None, None)
    """
    found = {sign: float(number) for sign, number in _LIMIT.findall(words)}
    return found.get("≥"), found.get("≤")


FROM_RANGES = 1.128
"""d₂ for moving ranges of two."""


@dataclass(frozen=True, eq=False)
class EwmaChart:
    """EWMA chart of values in the order of time.

    Attributes
    ----------
    average : float64[n]
        Weighted average up to each value.
    centre, sigma : float
        Expected value, and standard deviation.
    lower, upper : float64[n]
        Limits of each average.
    outside : tuple of int
        Indices of the averages outside their limits, from 0.
    weight, width : float
        Weight of the newest value, and half the width of the limits in standard deviations.
    """

    average: NDArray[np.float64]
    centre: float
    sigma: float
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    outside: tuple[int, ...]
    weight: float
    width: float


def ewma_chart(
    values: ArrayLike,
    *,
    weight: float = 0.2,
    width: float = 2.9,
    centre: float | None = None,
    sigma: float | None = None,
    base: int | None = None,
) -> EwmaChart:
    """Return the EWMA chart of values in the order of time.

    Parameters
    ----------
    values : array of float, shape (n,)
        At least 3.
    weight : float, default 0.2
        Weight of the newest value, above 0 and up to 1.
    width : float, default 2.9
        Half the width of the limits in standard deviations of the average; with a weight of 0.2
        a false alarm comes once in about 500 values.
    centre, sigma : float, optional
        Expected values; by default mean and mean moving range/1.128 of the base values.
    base : int, optional
        Number of first values from which `centre` and `sigma` are computed; all by default.

    Raises
    ------
    InputError
        Too few values, or a weight or width out of range.

    References
    ----------
    D. C. Montgomery, Introduction to Statistical Quality Control, 6th ed., equations 9.22, 9.25
    and 9.26.

    Examples
    --------
    >>> chart = ewma_chart([10.0, 10.2, 9.9, 10.1, 11.5, 11.6], centre=10.0, sigma=0.2)
    >>> chart.outside
    (4, 5)
    """
    x = np.atleast_1d(np.asarray(values, dtype=np.float64))
    count = x.size if base is None else base
    if x.ndim != 1 or not 3 <= count <= x.size or not np.all(np.isfinite(x)):
        raise InputError(
            Message("a control chart over {count} values with {base} as its base", x.size, count),
            "at least 3 finite values, and no more base values than values",
        )
    if not 0.0 < weight <= 1.0 or not width > 0.0:
        raise InputError(
            Message("weight {weight:g}, width {width:g}", weight, width),
            "a weight up to 1 and a width, both above 0",
        )
    middle = float(x[:count].mean()) if centre is None else centre
    spread = float(np.abs(np.diff(x[:count])).mean()) / FROM_RANGES if sigma is None else sigma
    average = np.empty(x.size)
    last = middle
    for k, value in enumerate(x):
        last += weight * (value - last)
        average[k] = last
    ages = 2.0 * np.arange(1, x.size + 1)
    reach = width * spread * np.sqrt(weight / (2.0 - weight) * (1.0 - (1.0 - weight) ** ages))
    outside = tuple(int(k) for k in np.flatnonzero(np.abs(average - middle) > reach))
    return EwmaChart(
        average, middle, spread, middle - reach, middle + reach, outside, weight, width
    )


LIMIT = 3.5
"""Modified z-score of an outlier (Iglewicz and Hoaglin)."""


@dataclass(frozen=True)
class GroupDifference:
    """Difference of a group's mean from the mean of all others.

    Attributes
    ----------
    group : str
    count : int
        Number of values in the group.
    mean, difference : float
        Mean of the group, and its difference from the mean of the others.
    p_value : float
        Welch's test, times the number of groups (Bonferroni), at most 1.
    outlying : bool
        Whether the group differs by more than chance.
    """

    group: str
    count: int
    mean: float
    difference: float
    p_value: float
    outlying: bool


def outlying_values(values: ArrayLike, limit: float = LIMIT) -> tuple[int, ...]:
    """Return which values are outliers: |0.6745 (x - median)/MAD| above a limit.

    References
    ----------
    B. Iglewicz, D. Hoaglin, How to Detect and Handle Outliers (ASQC, 1993); NIST/SEMATECH
    e-Handbook of Statistical Methods, 1.3.5.17.

    Examples
    --------
    >>> outlying_values([0.81, 0.80, 0.83, 0.79, 1.60, 0.82])
    (4,)
    """
    x = np.asarray(values, dtype=np.float64)
    if x.size < 3:
        return ()
    away = np.abs(x - np.median(x))
    spread = float(np.median(away))
    # More than half of the values are equal, so the median deviation is zero.
    score = (
        0.6745 * away / spread if spread else away / (1.253314 * max(float(away.mean()), 1e-300))
    )
    return tuple(int(k) for k in np.flatnonzero(score > limit))


def outlying_groups(
    values: ArrayLike, groups: Sequence[str], *, level: float = 0.01
) -> list[GroupDifference]:
    """Return every group's difference from all others, the largest first.

    Parameters
    ----------
    values : array of float, shape (n,)
    groups : sequence of str, length n
        Bench or batch of each value.
    level : float, default 0.01
        Significance level of the test over all groups together.

    Raises
    ------
    InputError
        The numbers of values and groups differ.

    Examples
    --------
    >>> values = [1.0, 1.1, 0.9, 1.0, 1.1, 0.9, 1.4, 1.5, 1.45]
    >>> [each.group for each in outlying_groups(values, "AAABBBCCC") if each.outlying]
    ['C']
    """
    x, names = np.asarray(values, dtype=np.float64), np.array(list(groups), dtype=object)
    if x.shape != names.shape:
        raise InputError(
            Message("{size} values in {names_size} groups", x.size, names.size),
            "a group for each value",
        )
    from scipy import stats

    kinds = sorted(set(groups))
    found = []
    for kind in kinds:
        inside, others = x[names == kind], x[names != kind]
        if inside.size < 2 or others.size < 2:
            continue
        difference = float(inside.mean() - others.mean())
        if np.ptp(inside) == 0.0 and np.ptp(others) == 0.0:
            p = 0.0 if difference else 1.0
        else:
            p = float(stats.ttest_ind(inside, others, equal_var=False).pvalue)
        p = min(p * len(kinds), 1.0)
        found.append(
            GroupDifference(
                str(kind), int(inside.size), float(inside.mean()), difference, p, p < level
            )
        )
    return sorted(found, key=lambda each: (each.p_value, -abs(each.difference)))


@dataclass(frozen=True)
class BenchResult:
    """Result of one bench for the specimen.

    Parameters
    ----------
    bench : str
    value, expanded_uncertainty : float
        Mean of the bench's runs and its U (k = 2), in the same unit.
    runs : int
        Number of runs.
    """

    bench: str
    value: float
    expanded_uncertainty: float
    runs: int = 1


@dataclass(frozen=True)
class ComparedBench:
    """One bench against the reference.

    Attributes
    ----------
    result : BenchResult
    reference, reference_expanded_uncertainty : float
        Reference value.
    difference : float
        The bench's value less the reference value.
    en : float
        Difference over √(U² + U_ref²); 0 for the reference bench.
    """

    result: BenchResult
    reference: float
    reference_expanded_uncertainty: float
    difference: float
    en: float

    @property
    def agrees(self) -> bool:
        """Whether |E_n| is at most 1."""
        return abs(self.en) <= 1.0


@dataclass(frozen=True)
class TravellingComparison:
    """Results of all benches that tested the specimen, compared.

    Attributes
    ----------
    benches : tuple of ComparedBench
    mean, expanded_uncertainty : float
        Weighted mean of all benches with its U (k = 2).
    chi_squared, p_value : float
        p-value of their scatter given their uncertainties; below 0.05 it is too large.
    """

    benches: tuple[ComparedBench, ...]
    mean: float
    expanded_uncertainty: float
    chi_squared: float
    p_value: float


def compare_benches(
    results: Sequence[BenchResult], reference: str | None = None
) -> TravellingComparison:
    """Compare benches by their results for one specimen.

    Each bench is compared with the reference bench, or with the weighted mean of all other benches.

    Parameters
    ----------
    results : sequence of BenchResult
        One result for each bench; at least two, with U above 0.
    reference : str, optional
        The bench with which the others are compared.

    Raises
    ------
    InputError
        Fewer than two benches, a bench given twice, an unknown reference, or a result without U.

    References
    ----------
    ISO/IEC 17043:2010, B.3.1.3 e) and B.2; M. G. Cox, Metrologia 39 (2002) 589, procedure A.

    Examples
    --------
    >>> found = compare_benches([BenchResult("A", 10.0, 0.3), BenchResult("B", 10.5, 0.4)])
    >>> [round(each.en, 6) for each in found.benches]
    [-1.0, 1.0]
    """
    names = [each.bench for each in results]
    if len(set(names)) < max(2, len(names)):
        raise InputError(
            Message("{count} results of {benches} benches", len(names), len(set(names))),
            "two benches or more, each once",
        )
    if reference is not None and reference not in names:
        raise InputError(Message("reference bench {reference}", reference), ", ".join(names))
    for each in results:
        if not each.expanded_uncertainty > 0.0:
            raise InputError(
                Message(
                    "bench {bench} states U = {expanded_uncertainty:g}",
                    each.bench,
                    each.expanded_uncertainty,
                ),
                "a U above 0",
            )
    x = np.array([each.value for each in results])
    weight = np.array([4.0 / each.expanded_uncertainty**2 for each in results])
    mean = float(np.sum(weight * x) / weight.sum())
    chi_squared = float(np.sum(weight * (x - mean) ** 2))
    from scipy import stats

    def compared(k: int) -> ComparedBench:
        own = results[k]
        if reference is not None:
            other = results[names.index(reference)]
            value, expanded = other.value, other.expanded_uncertainty
        else:
            rest = np.arange(x.size) != k
            value = float(np.sum((weight * x)[rest]) / weight[rest].sum())
            expanded = 2.0 / sqrt(float(weight[rest].sum()))
        difference = own.value - value
        en = difference / sqrt(own.expanded_uncertainty**2 + expanded**2)
        return ComparedBench(own, value, expanded, difference, en)

    return TravellingComparison(
        benches=tuple(compared(k) for k in range(x.size)),
        mean=mean,
        expanded_uncertainty=2.0 / sqrt(float(weight.sum())),
        chi_squared=chi_squared,
        p_value=float(stats.chi2.sf(chi_squared, x.size - 1)),
    )
